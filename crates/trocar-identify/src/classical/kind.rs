//! Classical friction models, their free parameters, and their construction from these.

use std::fmt;

use trocar_model::Quantity as Q;
use trocar_model::{
    Classical, Dahl, DahlParams, Gms, GmsElement, Leuven, LeuvenParams, LuGre, LuGreParams,
    MaxwellSlip, ParamError, ParameterId, SlidingFriction, SlipElement, SlipRate, StaticFriction,
    StribeckCurve,
};

/// A classical friction model, with its number of elements where that is variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// F_c·sgn v.
    Coulomb,
    /// Coulomb and viscous, EMS (23).
    CoulombViscous,
    /// Stribeck with shape exponent, EMS (11).
    Stribeck,
    /// Dahl with exponent, and a viscous part.
    Dahl,
    /// LuGre with the exponential Stribeck curve of EMS (6).
    LuGre,
    /// LuGre with the rational Stribeck curve.
    LuGreRational,
    /// Modified Leuven with this many hysteresis elements.
    Leuven(usize),
    /// Maxwell-Slip with this many elements, EMS (1)-(4).
    MaxwellSlip(usize),
    /// Generalized Maxwell-Slip with this many elements, EMS (5)-(7).
    Gms(usize),
}

impl Kind {
    /// One of each family, in the order of tables, with the number of elements that is compared
    /// unless another is asked for; where that is a range, its end.
    pub const FAMILIES: [Self; 9] = [
        Self::Coulomb,
        Self::CoulombViscous,
        Self::Stribeck,
        Self::Dahl,
        Self::LuGre,
        Self::LuGreRational,
        Self::Leuven(4),
        Self::MaxwellSlip(12),
        Self::Gms(12),
    ];

    /// All that are compared unless others are asked for.
    pub fn compared() -> impl Iterator<Item = Self> {
        Self::FAMILIES.into_iter().flat_map(|family| {
            let least = match family {
                Self::MaxwellSlip(_) | Self::Gms(_) => 1,
                other => other.elements(),
            };
            (least..=family.elements()).map(move |count| family.with_elements(count))
        })
    }

    /// Whether the number of elements can be chosen.
    pub fn is_bank(self) -> bool {
        matches!(self, Self::Leuven(_) | Self::MaxwellSlip(_) | Self::Gms(_))
    }

    /// Title of the panel in which a figure shows the family.
    pub fn panel(self) -> &'static str {
        match self {
            Self::Coulomb | Self::CoulombViscous | Self::Stribeck => "Static",
            Self::Dahl | Self::LuGre | Self::LuGreRational => "Dahl and LuGre",
            Self::Leuven(_) => "Leuven",
            Self::MaxwellSlip(_) => "Maxwell-Slip",
            Self::Gms(_) => "Generalized Maxwell-Slip",
        }
    }

    /// Name of the family, without the number of elements.
    pub fn family(self) -> &'static str {
        match self {
            Self::Coulomb => "coulomb",
            Self::CoulombViscous => "coulomb-viscous",
            Self::Stribeck => "stribeck",
            Self::Dahl => "dahl",
            Self::LuGre => "lugre",
            Self::LuGreRational => "lugre-rational",
            Self::Leuven(_) => "leuven",
            Self::MaxwellSlip(_) => "maxwell-slip",
            Self::Gms(_) => "gms",
        }
    }

    /// Name of the family in texts.
    pub fn title(self) -> &'static str {
        match self {
            Self::Coulomb => "Coulomb",
            Self::CoulombViscous => "Coulomb and viscous",
            Self::Stribeck => "Stribeck",
            Self::Dahl => "Dahl",
            Self::LuGre => "LuGre",
            Self::LuGreRational => "LuGre, rational",
            Self::Leuven(_) => "Leuven",
            Self::MaxwellSlip(_) => "Maxwell-Slip",
            Self::Gms(_) => "GMS",
        }
    }

    /// Number of elements; 1 for models with a fixed structure.
    pub fn elements(self) -> usize {
        match self {
            Self::Leuven(n) | Self::MaxwellSlip(n) | Self::Gms(n) => n,
            _ => 1,
        }
    }

    /// The same family with `count` elements; unchanged for models with a fixed structure.
    pub fn with_elements(self, count: usize) -> Self {
        match self {
            Self::Leuven(_) => Self::Leuven(count),
            Self::MaxwellSlip(_) => Self::MaxwellSlip(count),
            Self::Gms(_) => Self::Gms(count),
            other => other,
        }
    }

    /// The same family with one element less.
    pub fn smaller(self) -> Option<Self> {
        (self.elements() > 1).then(|| self.with_elements(self.elements() - 1))
    }

    /// The model of another family that results when some parameters are zero.
    pub fn special(self) -> Option<Self> {
        match self {
            Self::Gms(n) => Some(Self::MaxwellSlip(n)),
            _ => None,
        }
    }

    /// Number of free parameters, without the sensor offset.
    pub fn parameters(self) -> usize {
        match self {
            Self::Coulomb => 1,
            Self::CoulombViscous => 2,
            Self::Stribeck => 5,
            Self::Dahl => 4,
            Self::LuGre | Self::LuGreRational => 6,
            Self::Leuven(n) => 5 + 2 * n,
            Self::MaxwellSlip(n) => 1 + 2 * n,
            Self::Gms(n) => 4 + 3 * n,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.family())?;
        if self.is_bank() { write!(f, ":{}", self.elements()) } else { Ok(()) }
    }
}

/// Scales of the data, determined before any classical model is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scales {
    /// F_0, N.
    pub(crate) offset: f64,
    /// F_c, N.
    pub(crate) force: f64,
    /// β, N s/m.
    pub(crate) viscous: f64,
    /// Half of the travel between sliding in one direction and sliding in the other, m.
    pub(crate) half_width: f64,
    /// Longest stroke, m.
    pub(crate) stroke: f64,
    /// Slowest and fastest steady sliding, m/s.
    pub(crate) speeds: [f64; 2],
}

/// What a free parameter is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Number {
    /// A parameter that is reported as it is.
    Reported(ParameterId),
    /// F_s − F_c, N.
    Rise,
    /// Deflection at which the element of this id slips, m; the free parameter before it is the
    /// stiffness.
    LimitDeflection(ParameterId),
}

impl<T: Into<ParameterId>> From<T> for Number {
    fn from(id: T) -> Self {
        Self::Reported(id.into())
    }
}

/// One free parameter.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coordinate {
    pub(super) number: Number,
    /// Whether the fit uses the logarithm.
    pub(super) log: bool,
    /// Range of the parameter itself.
    pub(super) range: [f64; 2],
    /// Step of the difference quotient, in the parameter or its logarithm.
    pub(super) step: f64,
}

impl Coordinate {
    fn log(number: impl Into<Number>, range: [f64; 2]) -> Self {
        Self { number: number.into(), log: true, range, step: 1e-4 }
    }

    fn linear(number: impl Into<Number>, range: [f64; 2], step: f64) -> Self {
        Self { number: number.into(), log: false, range, step }
    }
}

/// The free parameters of a kind, the sensor offset first, in the order that [`build`] expects.
pub(super) fn coordinates(kind: Kind, scales: &Scales) -> Vec<Coordinate> {
    let Scales { force, stroke, half_width, speeds: [slowest, fastest], .. } = *scales;
    let most = 1e3 * force / fastest;
    let coulomb = || Coordinate::log(Q::CoulombForce, [1e-2 * force, 1e2 * force]);
    let rise = || Coordinate::linear(Number::Rise, [0.0, 20.0 * force], 1e-4 * force);
    let velocity = || Coordinate::log(Q::StribeckVelocity, [0.1 * slowest, 3.0 * fastest]);
    let damping = |id: ParameterId| Coordinate::linear(id, [0.0, most], 1e-3 * force / fastest);
    let [viscous, micro] = [Q::ViscousDamping, Q::MicroDamping].map(|q| move || damping(q.id()));
    let stiffness =
        |id: ParameterId| Coordinate::log(id, [1e-4 * force / stroke, 1e4 * force / half_width]);
    let limit = |i: usize| {
        let id = Q::LimitForce.id().of_element(i);
        Coordinate::log(Number::LimitDeflection(id), [1e-3 * half_width, 0.5 * stroke])
    };
    let element = |i: usize| [stiffness(Q::Stiffness.id().of_element(i)), limit(i)];
    let mut all =
        vec![Coordinate::linear(Q::Offset, [f64::NEG_INFINITY, f64::INFINITY], 1e-4 * force)];
    match kind {
        Kind::Coulomb => all.push(coulomb()),
        Kind::CoulombViscous => all.extend([coulomb(), viscous()]),
        Kind::Stribeck => {
            let exponent = Coordinate::log(Q::StribeckExponent, [0.2, 8.0]);
            all.extend([coulomb(), rise(), velocity(), exponent, viscous()]);
        }
        Kind::Dahl => {
            let exponent = Coordinate::log(Q::Exponent, [0.05, 8.0]);
            all.extend([stiffness(Q::Stiffness.id()), coulomb(), exponent, viscous()]);
        }
        Kind::LuGre | Kind::LuGreRational => {
            all.extend([
                stiffness(Q::Stiffness.id()),
                micro(),
                coulomb(),
                rise(),
                velocity(),
                viscous(),
            ]);
        }
        Kind::Leuven(n) => {
            let exponent = Coordinate::log(Q::Exponent, [0.1, 20.0]);
            all.extend([coulomb(), rise(), velocity(), exponent, micro(), viscous()]);
            all.extend((0..n - 1).flat_map(element));
            all.push(stiffness(Q::Stiffness.id().of_element(n - 1)));
        }
        Kind::MaxwellSlip(n) => {
            all.push(viscous());
            all.extend((0..n).flat_map(element));
        }
        Kind::Gms(n) => {
            let attraction = Coordinate::log(Q::AttractionRate, [1e-3 * force, 1e4 * force]);
            all.extend([viscous(), rise(), velocity(), attraction]);
            for i in 0..n {
                all.extend(element(i));
                all.push(damping(Q::Damping.id().of_element(i)));
            }
        }
    }
    all
}

fn stribeck(
    [coulomb_force, rise, stribeck_velocity, stribeck_exponent, viscous_damping]: [f64; 5],
) -> SlidingFriction {
    let static_force = coulomb_force + rise;
    SlidingFriction {
        coulomb_force,
        static_force,
        stribeck_velocity,
        stribeck_exponent,
        viscous_damping,
    }
}

/// The model with the parameters `p`, which start after the sensor offset.
pub(super) fn build(kind: Kind, p: &[f64]) -> Result<Classical, ParamError> {
    Ok(match kind {
        Kind::Coulomb => {
            Classical::Static(StaticFriction::new(SlidingFriction::coulomb(p[0], 0.0))?)
        }
        Kind::CoulombViscous => {
            Classical::Static(StaticFriction::new(SlidingFriction::coulomb(p[0], p[1]))?)
        }
        Kind::Stribeck => {
            Classical::Static(StaticFriction::new(stribeck([p[0], p[1], p[2], p[3], p[4]]))?)
        }
        Kind::Dahl => Classical::Dahl(Dahl::new(DahlParams {
            stiffness: p[0],
            coulomb_force: p[1],
            exponent: p[2],
            viscous_damping: p[3],
        })?),
        Kind::LuGre | Kind::LuGreRational => Classical::LuGre(LuGre::new(LuGreParams {
            stiffness: p[0],
            micro_damping: p[1],
            damping_velocity: f64::INFINITY,
            sliding: stribeck([p[2], p[3], p[4], 2.0, p[5]]),
            curve: if kind == Kind::LuGre {
                StribeckCurve::Exponential
            } else {
                StribeckCurve::Rational
            },
        })?),
        Kind::Leuven(n) => {
            let sliding = stribeck([p[0], p[1], p[2], 2.0, p[5]]);
            Classical::Leuven(Leuven::new(
                &leuven_elements(n, p),
                LeuvenParams { sliding, exponent: p[3], micro_damping: p[4] },
            )?)
        }
        Kind::MaxwellSlip(n) => {
            let element = |i: usize| SlipElement {
                stiffness: p[1 + 2 * i],
                limit_force: p[1 + 2 * i] * p[2 + 2 * i],
            };
            Classical::MaxwellSlip(MaxwellSlip::new(
                &(0..n).map(element).collect::<Vec<_>>(),
                p[0],
            )?)
        }
        Kind::Gms(n) => {
            let sliding = stribeck([gms_coulomb_force(n, p), p[1], p[2], 2.0, p[0]]);
            Classical::Gms(Gms::new(&gms_elements(n, p), sliding, SlipRate::Free)?)
        }
    })
}

/// The last element carries the whole static force, so the bank can hold every sliding force.
fn leuven_elements(n: usize, p: &[f64]) -> Vec<SlipElement> {
    let inner = (0..n - 1)
        .map(|i| SlipElement { stiffness: p[6 + 2 * i], limit_force: p[6 + 2 * i] * p[7 + 2 * i] });
    let last = SlipElement { stiffness: p[4 + 2 * n], limit_force: p[0] + p[1] };
    inner.chain([last]).collect()
}

/// F_c = Σ k_i·Δ_i, N: the force of the elements at Coulomb friction.
fn gms_coulomb_force(n: usize, p: &[f64]) -> f64 {
    (0..n).map(|i| p[4 + 3 * i] * p[5 + 3 * i]).sum()
}

/// One attraction coefficient C, N/s, for all: C_i = C·ν_i with ν_i = α_i/k_i (GMS in its force
/// form, SOURCES.md).
fn gms_elements(n: usize, p: &[f64]) -> Vec<GmsElement> {
    let coulomb = gms_coulomb_force(n, p);
    let element = |i: usize| {
        let [stiffness, limit, damping] = [p[4 + 3 * i], p[5 + 3 * i], p[6 + 3 * i]];
        let share = stiffness * limit / coulomb;
        GmsElement { stiffness, share, attraction: p[3] * share / stiffness, damping }
    };
    (0..n).map(element).collect()
}

/// A quantity as a function of the free parameters.
type Formula = Box<dyn Fn(&[f64]) -> f64>;

/// A reported quantity as a function of the free parameters, the offset first.
pub(super) struct Reported {
    pub(super) id: ParameterId,
    /// Whether its interval is taken on the logarithm.
    pub(super) log: bool,
    pub(super) of: Formula,
    /// Free parameters that it represents. It is not determined if one of them is held at a bound.
    pub(super) from: Vec<usize>,
}

impl Reported {
    /// Least meaningful value: the value at the lower bound of the parameter that it represents.
    pub(super) fn least(&self, numbers: &[f64]) -> f64 {
        let [only] = self.from[..] else { return f64::NEG_INFINITY };
        if self.log || only == 0 {
            return f64::NEG_INFINITY;
        }
        let mut lowest = numbers.to_vec();
        lowest[only] = 0.0;
        (self.of)(&lowest)
    }
}

/// The reported parameters of a kind: its free parameters, some replaced by the customary ones.
pub(super) fn reported(kind: Kind, coordinates: &[Coordinate]) -> Vec<Reported> {
    let usual = |(j, c): (usize, &Coordinate)| match c.number {
        Number::LimitDeflection(id) => {
            Reported { id, log: true, of: Box::new(move |p| p[j - 1] * p[j]), from: vec![j - 1, j] }
        }
        Number::Rise => static_force(kind, j),
        Number::Reported(id) => {
            Reported { id, log: c.log, of: Box::new(move |p| p[j]), from: vec![j] }
        }
    };
    let sum = match kind {
        Kind::MaxwellSlip(n) => Some(bank_force(n, 2, 2)),
        Kind::Gms(n) => Some(bank_force(n, 5, 3)),
        _ => None,
    };
    sum.into_iter().chain(coordinates.iter().enumerate().map(usual)).collect()
}

/// Σ k_i·Δ_i, N, of a bank whose elements start at parameter `first`, with `stride` parameters
/// each.
fn bank_force(n: usize, first: usize, stride: usize) -> Reported {
    let of =
        move |p: &[f64]| (0..n).map(|i| p[first + stride * i] * p[first + stride * i + 1]).sum();
    Reported { id: Q::CoulombForce.id(), log: true, of: Box::new(of), from: Vec::new() }
}

fn static_force(kind: Kind, rise: usize) -> Reported {
    let of: Formula = match kind {
        Kind::Gms(n) => Box::new(move |p| gms_coulomb_force(n, &p[1..]) + p[rise]),
        _ => Box::new(move |p| p[rise - 1] + p[rise]),
    };
    Reported { id: Q::StaticForce.id(), log: false, of, from: vec![rise] }
}
