//! Starting points of the fits of the classical models, derived from the data.

use nalgebra::{DMatrix, DVector};

use crate::nnls::non_negative;

use super::data::ClassicalData;
use super::fit::{ClassicalFit, RelatedFits, fit};
use super::kind::{Kind, Scales};

/// Limits tried for the elements of a bank.
const GRID: usize = 24;
/// Widths of the two elements into which an element is split, relative to its own.
const DIVIDED: [f64; 2] = [0.7, 1.3];

/// Starts with the same forces as the fitted special cases, which the fit can only improve; the
/// sensor offset first.
pub(super) fn from_kin(kind: Kind, data: &ClassicalData, kin: RelatedFits) -> Vec<Vec<f64>> {
    let Scales { force, speeds: [slowest, _], .. } = data.scales;
    let grown = kin.smaller.and_then(|fit| match kind {
        Kind::MaxwellSlip(_) => Some(doubled(&fit.numbers, 2, 2)),
        Kind::Gms(_) => Some(doubled(&fit.numbers, 5, 3)),
        _ => None,
    });
    let generalised = kin.special.map(|fit| {
        let elements =
            fit.numbers[2..].chunks_exact(2).flat_map(|element| [element[0], element[1], 0.0]);
        fit.numbers[..2]
            .iter()
            .copied()
            .chain([0.0, slowest, 50.0 * force])
            .chain(elements)
            .collect()
    });
    grown.into_iter().chain(generalised).collect()
}

/// Several starts derived from the data, each with the sensor offset first.
pub(super) fn fresh(kind: Kind, data: &ClassicalData, kin: RelatedFits) -> Vec<Vec<f64>> {
    let Scales { offset, force, viscous, half_width, speeds: [slowest, fastest], .. } = data.scales;
    let stiffnesses = [0.5, 2.0, 8.0].map(|factor| factor * force / half_width);
    let middle = (slowest * fastest).sqrt();
    let small_rise = 0.05 * force;
    let after_offset: Vec<Vec<f64>> = match kind {
        Kind::Coulomb => vec![vec![force]],
        Kind::CoulombViscous => vec![vec![force, viscous]],
        Kind::Stribeck => {
            let of = |v: f64| vec![force, 0.2 * force, v, 2.0, viscous];
            [0.3 * slowest, slowest, middle, 0.7 * fastest].map(of).to_vec()
        }
        Kind::Dahl => stiffnesses.map(|k| vec![k, force, 1.0, viscous]).to_vec(),
        Kind::LuGre | Kind::LuGreRational => {
            let of = |k: f64, rise: f64, v: f64| {
                vec![k, 0.1 * viscous, force - 0.5 * rise, rise, v, viscous]
            };
            let heads = [
                (small_rise, slowest),
                (small_rise, middle),
                (0.3 * force, slowest),
                (0.3 * force, middle),
            ];
            stiffnesses.iter().flat_map(|k| heads.map(|(rise, v)| of(*k, rise, v))).collect()
        }
        Kind::Leuven(n) => leuven(n, data),
        Kind::MaxwellSlip(n) => {
            let banks =
                [Some(convex_bank(n, data)), divided(kin.smaller, 2, 2)].into_iter().flatten();
            banks.map(|bank| [vec![viscous], flattened(&bank, None)].concat()).collect()
        }
        Kind::Gms(n) => gms(n, data, kin),
    };
    after_offset.into_iter().map(|numbers| [vec![offset], numbers].concat()).collect()
}

/// From LuGre, which is the Leuven model with one element and n = 1, and from Maxwell-Slip, which
/// it approaches for large n.
fn leuven(n: usize, data: &ClassicalData) -> Vec<Vec<f64>> {
    let Scales { force, viscous, half_width, speeds: [slowest, _], .. } = data.scales;
    let of = |head: [f64; 6], bank: &[[f64; 2]]| {
        let mut numbers = head.to_vec();
        numbers.extend(bank[..n - 1].iter().flatten());
        numbers.push(bank[n - 1][0]);
        numbers
    };
    let mut all = Vec::new();
    if let Ok(lugre) = fit(Kind::LuGre, data, RelatedFits::default()) {
        let [_, stiffness, micro, coulomb, rise, velocity, beta] = lugre.numbers[..] else {
            return all;
        };
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
    let bank = convex_bank(n, data);
    all.extend([2.0, 6.0].map(|exponent| {
        of([force, 0.05 * force, slowest, exponent, 0.1 * viscous, viscous], &bank)
    }));
    all
}

fn gms(n: usize, data: &ClassicalData, kin: RelatedFits) -> Vec<Vec<f64>> {
    let Scales { force, viscous, speeds: [slowest, fastest], .. } = data.scales;
    let bank = convex_bank(n, data);
    let of = |rise: f64, v: f64, attraction: f64, damping: f64| {
        [vec![viscous, rise * force, v, attraction * force], flattened(&bank, Some(damping))]
            .concat()
    };
    let middle = (slowest * fastest).sqrt();
    let damping = viscous.max(1e-2 * force / fastest) / n as f64;
    let mut all = vec![
        of(0.02, slowest, 50.0, 0.0),
        of(0.2, middle, 5.0, 0.0),
        of(0.3, slowest, 50.0, damping),
    ];
    if let (Some(fit), Some(bank)) = (kin.smaller, divided(kin.smaller, 5, 3)) {
        all.push([fit.numbers[1..5].to_vec(), flattened(&bank, Some(0.0))].concat());
    }
    if let Some(bank) = kin.special {
        let elements =
            bank.numbers[2..].chunks_exact(2).flat_map(|element| [element[0], element[1], 0.0]);
        all.push(
            vec![bank.numbers[1], 0.02 * force, slowest, 50.0 * force]
                .into_iter()
                .chain(elements)
                .collect(),
        );
    }
    all
}

/// The parameters of the smaller model with its first element duplicated, each half as stiff: the
/// same forces.
fn doubled(numbers: &[f64], first: usize, stride: usize) -> Vec<f64> {
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
fn divided(smaller: Option<&ClassicalFit>, first: usize, stride: usize) -> Option<Vec<[f64; 2]>> {
    let numbers = &smaller?.numbers;
    let mut bank: Vec<[f64; 2]> =
        numbers[first..].chunks_exact(stride).map(|element| [element[0], element[1]]).collect();
    let strength = |[k, limit]: &[f64; 2]| k * limit;
    let strongest =
        (0..bank.len()).max_by(|a, b| strength(&bank[*a]).total_cmp(&strength(&bank[*b])))?;
    let [k, limit] = bank.swap_remove(strongest);
    bank.extend(DIVIDED.map(|width| [0.5 * k, width * limit]));
    Some(bank)
}

/// Stiffness and limit of `n` elements: non-negative least squares over a grid of limits. The `n`
/// strongest are kept and solved again; if fewer are found, the strongest are split.
fn convex_bank(n: usize, data: &ClassicalData) -> Vec<[f64; 2]> {
    let Scales { half_width, stroke, force, .. } = data.scales;
    let (shortest, longest) = (0.02 * half_width, (4.0 * half_width).min(0.45 * stroke));
    let ratio = (longest / shortest).powf(1.0 / (GRID - 1) as f64);
    let grid: Vec<f64> = (0..GRID).map(|i| shortest * ratio.powi(i as i32)).collect();
    let strongest = |limits: &[f64]| -> Vec<[f64; 2]> {
        let mut bank: Vec<[f64; 2]> =
            bank_at(limits, data).into_iter().filter(|[k, _]| *k > 0.0).collect();
        bank.sort_by(|a, b| (b[0] * b[1]).total_cmp(&(a[0] * a[1])));
        bank.truncate(n);
        bank
    };
    let few: Vec<f64> = strongest(&grid).iter().map(|[_, limit]| *limit).collect();
    let mut bank = strongest(&few);
    if bank.is_empty() {
        bank.push([force / half_width, half_width]);
    }
    let mut next = 0;
    while bank.len() < n {
        let [k, limit] = bank[next];
        bank[next] = [0.5 * k, DIVIDED[0] * limit];
        bank.push([0.5 * k, (DIVIDED[1] * limit).min(longest)]);
        next += 1;
    }
    bank.sort_by(|a, b| a[1].total_cmp(&b[1]));
    bank
}

/// Stiffnesses for given limits: the force is linear in them (RIZOS), together with a viscous term
/// and the offset.
fn bank_at(limits: &[f64], data: &ClassicalData) -> Vec<[f64; 2]> {
    let p = limits.len() + 2;
    let (mut gram, mut moment) = (DMatrix::zeros(p, p), DVector::zeros(p));
    let mut row = vec![0.0; p];
    for run in &data.training.runs {
        let mut deflections = vec![0.0_f64; limits.len()];
        for step in &run.steps {
            for (j, (z, limit)) in deflections.iter_mut().zip(limits).enumerate() {
                *z = (*z + step.displacement).clamp(-limit, *limit);
                row[j] = *z;
            }
            row[p - 2] = step.displacement / step.duration;
            row[p - 1] = 1.0;
            if step.weight > 0.0 {
                for (j, a) in row.iter().enumerate() {
                    moment[j] += step.weight * a * step.force;
                    row.iter().enumerate().for_each(|(i, b)| gram[(i, j)] += step.weight * a * b);
                }
            }
        }
    }
    let free: Vec<bool> = (0..p).map(|j| j == p - 1).collect();
    let solution = non_negative(&gram, &moment, &free);
    let stiffness = |j: usize| solution.as_ref().map_or(0.0, |s| s[j]);
    limits.iter().enumerate().map(|(j, limit)| [stiffness(j), *limit]).collect()
}
