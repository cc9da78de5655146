//! Which classical model, its free numbers, and the model that they make.

use std::fmt;

use trocar_model::{
    Dahl, DahlParams, Gms, GmsElement, Leuven, LeuvenParams, LuGre, LuGreParams, MaxwellSlip, ParamError,
    SlidingFriction, SlipElement, SlipRate, StaticFriction, StribeckCurve,
};

use trocar_model::Classical;

/// A classical friction model, with its number of elements where it has several.
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
    /// Modified Leuven with so many elements of hysteresis.
    Leuven(usize),
    /// Maxwell-Slip with so many elements, EMS (1)-(4).
    MaxwellSlip(usize),
    /// Generalized Maxwell-Slip with so many elements, EMS (5)-(7).
    Gms(usize),
}

impl Kind {
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

    /// Number of elements; 1 for models that have no choice.
    pub fn elements(self) -> usize {
        match self {
            Self::Leuven(n) | Self::MaxwellSlip(n) | Self::Gms(n) => n,
            _ => 1,
        }
    }

    /// The same family with `count` elements; unchanged where it has no choice.
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

    /// The model of another family that it becomes with some parameters at zero.
    pub fn special(self) -> Option<Self> {
        match self {
            Self::Gms(n) => Some(Self::MaxwellSlip(n)),
            _ => None,
        }
    }

    /// Number of free parameters, without the sensor's offset.
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
        match self {
            Self::Leuven(n) | Self::MaxwellSlip(n) | Self::Gms(n) => write!(f, "{}:{n}", self.family()),
            _ => f.write_str(self.family()),
        }
    }
}

/// What the data say about sizes, before any classical model is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scales {
    /// F_0, N.
    pub(crate) offset: f64,
    /// F_c, N.
    pub(crate) force: f64,
    /// β, N s/m.
    pub(crate) viscous: f64,
    /// Half of the travel from one sliding direction to the other, m.
    pub(crate) half_width: f64,
    /// Longest stroke, m.
    pub(crate) stroke: f64,
    /// Slowest and fastest steady sliding, m/s.
    pub(crate) speeds: [f64; 2],
}

/// One free number.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coordinate {
    pub(super) name: String,
    pub(super) unit: &'static str,
    /// Whether the fit moves the logarithm.
    pub(super) log: bool,
    /// Range of the number itself.
    pub(super) range: [f64; 2],
    /// Step of the difference quotient, in the number or its logarithm.
    pub(super) step: f64,
}

impl Coordinate {
    fn log(name: impl Into<String>, unit: &'static str, range: [f64; 2]) -> Self {
        Self { name: name.into(), unit, log: true, range, step: 1e-4 }
    }

    fn linear(name: impl Into<String>, unit: &'static str, range: [f64; 2], step: f64) -> Self {
        Self { name: name.into(), unit, log: false, range, step }
    }
}

/// The free numbers of a kind, the sensor's offset first, in the order in which [`build`] takes them.
pub(super) fn coordinates(kind: Kind, scales: &Scales) -> Vec<Coordinate> {
    let Scales { force, stroke, half_width, speeds: [slowest, fastest], .. } = *scales;
    let most = 1e3 * force / fastest;
    let coulomb = || Coordinate::log("coulomb_force_n", "N", [1e-2 * force, 1e2 * force]);
    let rise = || Coordinate::linear("rise_n", "N", [0.0, 20.0 * force], 1e-4 * force);
    let velocity = || Coordinate::log("stribeck_velocity_m_s", "m/s", [0.1 * slowest, 3.0 * fastest]);
    let damping = |name: &str| Coordinate::linear(name, "N s/m", [0.0, most], 1e-3 * force / fastest);
    let viscous = || damping("viscous_damping_n_s_m");
    let stiffness = |name: String| Coordinate::log(name, "N/m", [1e-4 * force / stroke, 1e4 * force / half_width]);
    let limit = |name: String| Coordinate::log(name, "m", [1e-3 * half_width, 0.5 * stroke]);
    let mut all = vec![Coordinate::linear("offset_n", "N", [f64::NEG_INFINITY, f64::INFINITY], 1e-4 * force)];
    match kind {
        Kind::Coulomb => all.push(coulomb()),
        Kind::CoulombViscous => all.extend([coulomb(), viscous()]),
        Kind::Stribeck => {
            let exponent = Coordinate::log("stribeck_exponent", "", [0.2, 8.0]);
            all.extend([coulomb(), rise(), velocity(), exponent, viscous()]);
        }
        Kind::Dahl => {
            let exponent = Coordinate::log("exponent", "", [0.05, 8.0]);
            all.extend([stiffness("stiffness_n_m".into()), coulomb(), exponent, viscous()]);
        }
        Kind::LuGre | Kind::LuGreRational => {
            let micro = damping("micro_damping_n_s_m");
            all.extend([stiffness("stiffness_n_m".into()), micro, coulomb(), rise(), velocity(), viscous()]);
        }
        Kind::Leuven(n) => {
            let exponent = Coordinate::log("exponent", "", [0.1, 20.0]);
            all.extend([coulomb(), rise(), velocity(), exponent, damping("micro_damping_n_s_m"), viscous()]);
            for i in 1..n {
                all.extend([stiffness(format!("stiffness_n_m_{i}")), limit(format!("limit_deflection_m_{i}"))]);
            }
            all.push(stiffness(format!("stiffness_n_m_{n}")));
        }
        Kind::MaxwellSlip(n) => {
            all.push(viscous());
            for i in 1..=n {
                all.extend([stiffness(format!("stiffness_n_m_{i}")), limit(format!("limit_deflection_m_{i}"))]);
            }
        }
        Kind::Gms(n) => {
            let attraction = Coordinate::log("attraction_n_s", "N/s", [1e-3 * force, 1e4 * force]);
            all.extend([viscous(), rise(), velocity(), attraction]);
            for i in 1..=n {
                all.extend([stiffness(format!("stiffness_n_m_{i}")), limit(format!("limit_deflection_m_{i}"))]);
                all.push(damping(&format!("damping_n_s_m_{i}")));
            }
        }
    }
    all
}

fn stribeck([coulomb_force, rise, stribeck_velocity, stribeck_exponent, viscous_damping]: [f64; 5]) -> SlidingFriction {
    let static_force = coulomb_force + rise;
    SlidingFriction { coulomb_force, static_force, stribeck_velocity, stribeck_exponent, viscous_damping }
}

/// The model of the numbers `p`, which begin after the sensor's offset.
pub(super) fn build(kind: Kind, p: &[f64]) -> Result<Classical, ParamError> {
    Ok(match kind {
        Kind::Coulomb => Classical::Static(StaticFriction::new(SlidingFriction::coulomb(p[0], 0.0))?),
        Kind::CoulombViscous => Classical::Static(StaticFriction::new(SlidingFriction::coulomb(p[0], p[1]))?),
        Kind::Stribeck => Classical::Static(StaticFriction::new(stribeck([p[0], p[1], p[2], p[3], p[4]]))?),
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
            curve: if kind == Kind::LuGre { StribeckCurve::Exponential } else { StribeckCurve::Rational },
        })?),
        Kind::Leuven(n) => {
            let sliding = stribeck([p[0], p[1], p[2], 2.0, p[5]]);
            Classical::Leuven(Leuven::new(
                &leuven_elements(n, p),
                LeuvenParams { sliding, exponent: p[3], micro_damping: p[4] },
            )?)
        }
        Kind::MaxwellSlip(n) => {
            let element = |i: usize| SlipElement { stiffness: p[1 + 2 * i], limit_force: p[1 + 2 * i] * p[2 + 2 * i] };
            Classical::MaxwellSlip(MaxwellSlip::new(&(0..n).map(element).collect::<Vec<_>>(), p[0])?)
        }
        Kind::Gms(n) => {
            let sliding = stribeck([gms_coulomb_force(n, p), p[1], p[2], 2.0, p[0]]);
            Classical::Gms(Gms::new(&gms_elements(n, p), sliding, SlipRate::Free)?)
        }
    })
}

/// The last element bears the whole static force: the bank can then hold every sliding force.
fn leuven_elements(n: usize, p: &[f64]) -> Vec<SlipElement> {
    let inner = (0..n - 1).map(|i| SlipElement { stiffness: p[6 + 2 * i], limit_force: p[6 + 2 * i] * p[7 + 2 * i] });
    let last = SlipElement { stiffness: p[4 + 2 * n], limit_force: p[0] + p[1] };
    inner.chain([last]).collect()
}

/// F_c = Σ k_i·Δ_i, N: what the elements hold at Coulomb friction.
fn gms_coulomb_force(n: usize, p: &[f64]) -> f64 {
    (0..n).map(|i| p[4 + 3 * i] * p[5 + 3 * i]).sum()
}

/// One attraction C, N/s, for all: C_i = C·ν_i with ν_i = α_i/k_i (GMS in its force form, SOURCES.md).
fn gms_elements(n: usize, p: &[f64]) -> Vec<GmsElement> {
    let coulomb = gms_coulomb_force(n, p);
    let element = |i: usize| {
        let [stiffness, limit, damping] = [p[4 + 3 * i], p[5 + 3 * i], p[6 + 3 * i]];
        let share = stiffness * limit / coulomb;
        GmsElement { stiffness, share, attraction: p[3] * share / stiffness, damping }
    };
    (0..n).map(element).collect()
}

/// How a number follows from the free ones.
type Formula = Box<dyn Fn(&[f64]) -> f64>;

/// A number to report: how it follows from the free numbers, the offset first.
pub(super) struct Quantity {
    pub(super) name: String,
    pub(super) unit: &'static str,
    /// Whether its interval is taken on the logarithm.
    pub(super) log: bool,
    pub(super) of: Formula,
    /// Free numbers that it stands for: held at an end of their range, it is not determined.
    pub(super) from: Vec<usize>,
}

impl Quantity {
    /// Least value that makes sense: what follows where the number that it stands for is at the lower end of its range.
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

/// What is reported of a kind: its free numbers, and in place of some the usual ones.
pub(super) fn quantities(kind: Kind, coordinates: &[Coordinate]) -> Vec<Quantity> {
    let usual = |(j, c): (usize, &Coordinate)| match c.name.strip_prefix("limit_deflection_m_") {
        Some(i) => Quantity {
            name: format!("limit_force_n_{i}"),
            unit: "N",
            log: true,
            of: Box::new(move |p| p[j - 1] * p[j]),
            from: vec![j - 1, j],
        },
        None if c.name == "rise_n" => static_force(kind, j),
        None => Quantity { name: c.name.clone(), unit: c.unit, log: c.log, of: Box::new(move |p| p[j]), from: vec![j] },
    };
    let sum = match kind {
        Kind::MaxwellSlip(n) => Some(bank_force(n, 2, 2)),
        Kind::Gms(n) => Some(bank_force(n, 5, 3)),
        _ => None,
    };
    sum.into_iter().chain(coordinates.iter().enumerate().map(usual)).collect()
}

/// Σ k_i·Δ_i, N, of a bank whose elements begin at number `first`, `stride` numbers each.
fn bank_force(n: usize, first: usize, stride: usize) -> Quantity {
    let of = move |p: &[f64]| (0..n).map(|i| p[first + stride * i] * p[first + stride * i + 1]).sum();
    Quantity { name: "coulomb_force_n".into(), unit: "N", log: true, of: Box::new(of), from: Vec::new() }
}

fn static_force(kind: Kind, rise: usize) -> Quantity {
    let of: Formula = match kind {
        Kind::Gms(n) => Box::new(move |p| gms_coulomb_force(n, &p[1..]) + p[rise]),
        _ => Box::new(move |p| p[rise - 1] + p[rise]),
    };
    Quantity { name: "static_force_n".into(), unit: "N", log: false, of, from: vec![rise] }
}
