//! Models of elements in parallel: their free parameters, and starts of their fits derived from the
//! data.

use trocar_model::{
    Classical, Gms, GmsElement, Leuven, LeuvenParams, MaxwellSlip, ParamError, Quantity as Q,
    SlipElement, SlipRate,
};

use super::coordinate::{Bank, Coordinate, Number, Scales};
use super::data::ClassicalData;
use super::family::{Family, Related, stribeck};

/// Limits of the longest elements of the banks from which fits start, relative to the half width.
const LONGEST: [f64; 3] = [0.7, 1.4, 2.8];
/// Limit of the shortest element relative to the longest.
const SHORTEST: f64 = 0.1;
/// Widths of the two elements into which an element is split, relative to its own.
const DIVIDED: [f64; 2] = [0.7, 1.3];

pub(super) const LEUVEN: Family = Family {
    name: "leuven",
    title: "Leuven",
    panel: "Leuven",
    elements: [4, 4],
    free: |scales, n| {
        let head = [
            scales.coulomb(),
            scales.rise(),
            scales.stribeck_velocity(),
            Coordinate::log(Q::Exponent, [0.1, 20.0]),
            scales.damping(Q::MicroDamping),
            scales.damping(Q::ViscousDamping),
        ];
        let inner = (0..n - 1).flat_map(|i| scales.element(i));
        let last = scales.stiffness(Q::Stiffness.id().of_element(n - 1));
        head.into_iter().chain(inner).chain([last]).collect()
    },
    build: |n, p| {
        let sliding = stribeck([p[0], p[1], p[2], 2.0, p[5]]);
        let params = LeuvenParams { sliding, exponent: p[3], micro_damping: p[4] };
        Ok(Classical::Leuven(Leuven::new(&leuven_elements(n, p), params)?))
    },
    starts: leuven,
    bank: None,
};

pub(super) const MAXWELL_SLIP: Family = Family {
    name: "maxwell-slip",
    title: "Maxwell-Slip",
    panel: "Maxwell-Slip",
    elements: [1, 12],
    free: |scales, n| {
        let elements = (0..n).flat_map(|i| scales.element(i));
        [scales.damping(Q::ViscousDamping)].into_iter().chain(elements).collect()
    },
    build: |_, p| {
        let elements: Vec<SlipElement> = p[1..].chunks_exact(2).map(slip_element).collect();
        Ok(Classical::MaxwellSlip(MaxwellSlip::new(&elements, p[0])?))
    },
    starts: |n, data, kin| {
        let banks = even_banks(n, data).into_iter().chain(divided(kin.smaller, 2, 2));
        banks.map(|bank| [vec![data.scales.viscous], flattened(&bank, None)].concat()).collect()
    },
    bank: Some(Bank { first: 2, stride: 2 }),
};

pub(super) const GMS: Family = Family {
    name: "gms",
    title: "GMS",
    panel: "Generalized Maxwell-Slip",
    elements: [1, 12],
    free: |scales, n| {
        let head = [
            scales.damping(Q::ViscousDamping),
            // Relative to the force of the elements: these then do not depend on each other.
            Coordinate::linear(Number::RelativeRise, [0.0, 20.0], 1e-4),
            scales.stribeck_velocity(),
            Coordinate::log(Number::Relative(Q::AttractionRate.id()), [1e-3, 1e4]),
        ];
        let elements = (0..n).flat_map(|i| {
            let [stiffness, limit] = scales.element(i);
            [stiffness, limit, scales.damping(Q::Damping.id().of_element(i))]
        });
        head.into_iter().chain(elements).collect()
    },
    build: |_, p| build_gms(p),
    starts: gms,
    bank: Some(Bank { first: 5, stride: 3 }),
};

/// Of a stiffness and a limit deflection.
fn slip_element(p: &[f64]) -> SlipElement {
    SlipElement { stiffness: p[0], limit_force: p[0] * p[1] }
}

/// The last element carries the whole static force, so the bank can hold every sliding force.
fn leuven_elements(n: usize, p: &[f64]) -> Vec<SlipElement> {
    let inner = p[6..4 + 2 * n].chunks_exact(2).map(slip_element);
    let last = SlipElement { stiffness: p[4 + 2 * n], limit_force: p[0] + p[1] };
    inner.chain([last]).collect()
}

/// F_c = Σ k_i·Δ_i. One attraction coefficient C, N/s, for all: C_i = C·ν_i with ν_i = α_i/k_i (GMS
/// in its force form, SOURCES.md). `p` has F_s/F_c − 1 and C/F_c: with ν_i·F_c = Δ_i, no element
/// depends on the numbers of another.
fn build_gms(p: &[f64]) -> Result<Classical, ParamError> {
    let [viscous, rise, velocity, attraction] = [p[0], p[1], p[2], p[3]];
    let elements = p[4..].chunks_exact(3);
    let coulomb: f64 = elements.clone().map(|own| own[0] * own[1]).sum();
    let elements: Vec<GmsElement> = elements
        .map(|own| {
            let [stiffness, limit, damping] = [own[0], own[1], own[2]];
            let share = stiffness * limit / coulomb;
            GmsElement { stiffness, share, attraction: attraction * limit, damping }
        })
        .collect();
    let sliding = stribeck([coulomb, rise * coulomb, velocity, 2.0, viscous]);
    Ok(Classical::Gms(Gms::new(&elements, sliding, SlipRate::Free)?))
}

/// Starts with the same forces as the fitted special cases, which the fit can only improve; the
/// sensor offset first.
pub(super) fn from_kin(bank: Option<Bank>, data: &ClassicalData, kin: Related) -> Vec<Vec<f64>> {
    let grown = kin.smaller.zip(bank).map(|(numbers, bank)| doubled(numbers, bank));
    let generalised = bank.zip(kin.special).map(|(_, numbers)| {
        let head = [numbers[0], numbers[1], 0.0, data.scales.speeds[0], 50.0];
        [head.to_vec(), generalised_elements(numbers, 0.0)].concat()
    });
    grown.into_iter().chain(generalised).collect()
}

/// The elements of a fitted Maxwell-Slip model as those of GMS.
fn generalised_elements(numbers: &[f64], damping: f64) -> Vec<f64> {
    numbers[2..].chunks_exact(2).flat_map(|element| [element[0], element[1], damping]).collect()
}

/// From LuGre, which is the Leuven model with one element and n = 1, and from even banks: for large n
/// it approaches Maxwell-Slip.
fn leuven(n: usize, data: &ClassicalData, kin: Related) -> Vec<Vec<f64>> {
    let Scales { force, viscous, half_width, speeds: [slowest, _], .. } = data.scales;
    let of = |head: [f64; 6], bank: &[[f64; 2]]| {
        let mut numbers = head.to_vec();
        numbers.extend(bank[..n - 1].iter().flatten());
        numbers.push(bank[n - 1][0]);
        numbers
    };
    let mut all = Vec::new();
    if let Some(&[_, stiffness, micro, coulomb, rise, velocity, beta]) = kin.special {
        for (exponent, softer, inner) in
            [(1.0, 1.0, 0.1), (1.0, 1.0, 0.5), (2.0, 0.7, 0.5), (3.0, 0.5, 0.7)]
        {
            let inner_stiffness = inner * softer * stiffness / (n - 1).max(1) as f64;
            let width = |i: usize| half_width * 0.2 * 4f64.powf(i as f64 / (n - 1).max(1) as f64);
            let mut bank: Vec<[f64; 2]> = (0..n - 1).map(|i| [inner_stiffness, width(i)]).collect();
            bank.push([softer * stiffness * if n > 1 { 1.0 - inner } else { 1.0 }, half_width]);
            all.push(of([coulomb, rise, velocity, exponent, micro, beta], &bank));
        }
    }
    let [_, bank, _] = even_banks(n, data);
    all.extend([2.0, 6.0].map(|exponent| {
        of([force, 0.05 * force, slowest, exponent, 0.1 * viscous, viscous], &bank)
    }));
    all
}

/// From Maxwell-Slip and from even banks, with different sliding.
fn gms(n: usize, data: &ClassicalData, kin: Related) -> Vec<Vec<f64>> {
    let Scales { force, viscous, speeds: [slowest, fastest], .. } = data.scales;
    let damping = viscous.max(1e-2 * force / fastest) / n as f64;
    let special = kin.special.map(|numbers| {
        [vec![viscous, 0.02, slowest, 50.0], generalised_elements(numbers, 0.0)].concat()
    });
    let divided = kin
        .smaller
        .zip(divided(kin.smaller, 5, 3))
        .map(|(numbers, bank)| [numbers[1..5].to_vec(), flattened(&bank, Some(0.0))].concat());
    let even = even_banks(n, data).into_iter().flat_map(|bank| {
        let heads =
            [([0.2, data.scales.middle_speed(), 5.0], 0.0), ([0.3, slowest, 50.0], damping)];
        heads.map(|(head, damping)| {
            [&[viscous], &head[..], &flattened(&bank, Some(damping))].concat()
        })
    });
    even.chain(special).chain(divided).collect()
}

/// The parameters of the smaller model with its first element duplicated, each half as stiff: the
/// same forces.
fn doubled(numbers: &[f64], Bank { first, stride }: Bank) -> Vec<f64> {
    let mut element = numbers[first..first + stride].to_vec();
    element.iter_mut().enumerate().filter(|(i, _)| *i != 1).for_each(|(_, x)| *x *= 0.5);
    let mut second = element.clone();
    second[1] *= 1.0 + 1e-6;
    let mut all = numbers.to_vec();
    all.splice(first..first + stride, element.into_iter().chain(second));
    all
}

/// Stiffness and limit of each element in sequence, with `damping` after each if there is one.
fn flattened(bank: &[[f64; 2]], damping: Option<f64>) -> Vec<f64> {
    bank.iter()
        .flat_map(|[k, limit]| [Some(*k), Some(*limit), damping].into_iter().flatten())
        .collect()
}

/// The bank of the smaller model with its strongest element split into a shorter and a longer one.
fn divided(smaller: Option<&[f64]>, first: usize, stride: usize) -> Option<Vec<[f64; 2]>> {
    let mut bank: Vec<[f64; 2]> =
        smaller?[first..].chunks_exact(stride).map(|element| [element[0], element[1]]).collect();
    let strength = |[k, limit]: &[f64; 2]| k * limit;
    let strongest =
        (0..bank.len()).max_by(|a, b| strength(&bank[*a]).total_cmp(&strength(&bank[*b])))?;
    let [k, limit] = bank.swap_remove(strongest);
    bank.extend(DIVIDED.map(|width| [0.5 * k, width * limit]));
    Some(bank)
}

/// Stiffness and limit of `n` elements that carry the force in equal parts, with limits in a geometric
/// sequence.
fn even_banks(n: usize, data: &ClassicalData) -> [Vec<[f64; 2]>; 3] {
    let Scales { force, half_width, stroke, .. } = data.scales;
    LONGEST.map(|longest| {
        let longest = (longest * half_width).min(0.45 * stroke);
        let limit = |i: usize| longest * SHORTEST.powf((n - 1 - i) as f64 / (n - 1).max(1) as f64);
        (0..n).map(|i| [force / n as f64 / limit(i), limit(i)]).collect()
    })
}
