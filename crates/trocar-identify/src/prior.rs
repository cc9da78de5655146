//! Priors of the free parameters of a fit: what is assumed of a trocar before it is recorded.
//!
//! ```text
//! θ_j ~ N(μ_j, s_j²) within the range of θ_j      μ_j, s_j by what the parameter is
//! ```
//! A parameter that cannot be negative and has μ_j = 0 thus has a half-normal prior. The widths are
//! several times those of published trocars: friction of 0.25 to 8 N (DOBBELSTEEN, IMECHE2015).

use statrs::distribution::{Continuous, ContinuousCDF, Normal};

/// Normal prior of one free parameter, in its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prior {
    /// μ.
    pub(crate) mean: f64,
    /// s; infinite without a prior.
    pub(crate) deviation: f64,
}

impl Prior {
    pub(crate) const fn new(mean: f64, deviation: f64) -> Self {
        Self { mean, deviation }
    }

    pub(crate) const fn about_zero(deviation: f64) -> Self {
        Self::new(0.0, deviation)
    }

    /// Standard deviation of the prior within a range.
    pub(super) fn deviation_within(self, [low, high]: [f64; 2]) -> f64 {
        let Self { mean, deviation } = self;
        let Ok(normal) = Normal::new(0.0, 1.0) else { return deviation };
        let ends = [low, high].map(|end| (end - mean) / deviation);
        let density = ends.map(|end| normal.pdf(end));
        let moment = |k: usize| if ends[k].is_finite() { ends[k] * density[k] } else { 0.0 };
        let mass = (normal.cdf(ends[1]) - normal.cdf(ends[0])).max(f64::MIN_POSITIVE);
        let shift = (density[0] - density[1]) / mass;
        deviation * (1.0 + (moment(0) - moment(1)) / mass - shift * shift).max(0.0).sqrt()
    }

    /// Probability of N(mean, deviation²) within a range.
    pub(super) fn mass_within(self, [low, high]: [f64; 2]) -> f64 {
        let Ok(normal) = Normal::new(self.mean, self.deviation) else { return 1.0 };
        normal.cdf(high) - normal.cdf(low)
    }
}

/// What a free parameter is. Those whose logarithm is free come last, and their names begin with `Log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// Sensor offset, N.
    Offset,
    /// Unmodelled mass, kg.
    UnmodelledMass,
    SideFriction,
    /// N.
    TiltedWeight,
    /// 1/Pa.
    PressureGain,
    /// Coulomb or static force, N.
    SlidingForce,
    /// Viscous damping or seal damping, N s/m.
    Damping,
    /// m/s.
    StribeckVelocity,
    StribeckExponent,
    /// m.
    HalfWidth,
    /// Relative to the half width.
    Join,
    /// N.
    JoinForce,
    /// Curvature term of a branch, N.
    Bend,
    /// Friction after rest, N.
    DwellForce,
    /// Minor-loop stiffness relative to its least value.
    YieldRatio,
    /// m/s.
    LogCreepVelocity,
    /// s.
    LogFrictionLag,
    /// Stiffness of a relaxing spring, N/m.
    LogStiffness,
    /// s.
    LogRelaxationTime,
    /// Sliding force of a second stage relative to the first.
    LogShare,
    /// Half width of a second stage, m.
    LogHalfWidth,
}

/// ln 10: a factor of ten either way is one standard deviation.
const DECADE: f64 = std::f64::consts::LN_10;

impl Kind {
    /// All in the order of tables, in words, with symbol and unit.
    const ALL: [(Self, &str, &str, &str); 21] = [
        (Self::SlidingForce, "Coulomb force, static force", "F_c, F_s", "N"),
        (Self::Damping, "viscous damping, seal damping", "β, σ", "N·s/m"),
        (Self::Offset, "sensor offset", "F_0", "N"),
        (Self::UnmodelledMass, "unmodelled mass", "m", "kg"),
        (Self::SideFriction, "friction of the cannula under side load", "μ", ""),
        (Self::TiltedWeight, "weight that the tilt turns", "W", "N"),
        (Self::PressureGain, "gain of the force with the gas pressure", "κ_p", "1/Pa"),
        (Self::HalfWidth, "half width of the deformation", "c", "m"),
        (Self::Join, "join, relative to the half width", "a/c", ""),
        (Self::JoinForce, "force at the join", "F(a)", "N"),
        (Self::Bend, "curvature of a branch", "", "N"),
        (Self::StribeckVelocity, "Stribeck velocity", "v_s", "m/s"),
        (Self::StribeckExponent, "Stribeck exponent", "δ", ""),
        (Self::DwellForce, "friction after rest, per e-fold", "ΔF", "N"),
        (Self::YieldRatio, "minor-loop stiffness over its least value", "κ/κ_min", ""),
        (Self::LogCreepVelocity, "creep velocity", "v_c", "m/s"),
        (Self::LogFrictionLag, "lag of the Stribeck curve", "T", "s"),
        (Self::LogStiffness, "stiffness of a relaxing spring", "E", "N/m"),
        (Self::LogRelaxationTime, "relaxation time", "τ", "s"),
        (Self::LogShare, "second stage: share of the sliding force", "", ""),
        (Self::LogHalfWidth, "second stage: half width", "", "m"),
    ];

    /// The weakly informative prior; `None` where the fit has one of its own.
    pub(super) fn weak(self) -> Option<Prior> {
        let about = |median: f64| Prior::new(median.ln(), DECADE);
        Some(match self {
            Self::Offset | Self::SlidingForce | Self::JoinForce | Self::TiltedWeight => {
                Prior::about_zero(10.0)
            }
            Self::UnmodelledMass | Self::DwellForce | Self::SideFriction => Prior::about_zero(1.0),
            Self::PressureGain => Prior::about_zero(1e-3),
            Self::Damping => Prior::about_zero(50.0),
            Self::StribeckVelocity => Prior::about_zero(0.05),
            Self::StribeckExponent => Prior::new(1.5, 1.0),
            Self::HalfWidth => Prior::about_zero(0.01),
            Self::Join => Prior::about_zero(0.5),
            Self::YieldRatio => Prior::new(1.0, 3.0),
            Self::LogCreepVelocity => about(1e-4),
            Self::LogFrictionLag => about(0.03),
            Self::LogStiffness => about(300.0),
            Self::LogRelaxationTime => about(1.0),
            Self::LogShare => about(1.0),
            Self::LogHalfWidth => about(1e-3),
            Self::Bend => return None,
        })
    }
}

/// The weakly informative priors as rows of words: parameter, symbol, prior with its unit.
pub fn weak_priors() -> Vec<[String; 3]> {
    let of = |(kind, words, symbol, unit): (Kind, &str, &str, &str)| {
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        let prior = match kind.weak() {
            Some(Prior { mean, .. }) if kind >= Kind::LogCreepVelocity => {
                let median = (1e6 * mean.exp()).round() / 1e6;
                format!("log-normal, median {median}{unit}, a factor of 10 either way")
            }
            Some(Prior { mean, deviation }) => format!("normal, {mean} ± {deviation}{unit}"),
            None => "normal, 0 ± 6 times the sliding force".to_owned(),
        };
        [words.to_owned(), symbol.to_owned(), prior]
    };
    Kind::ALL.into_iter().map(of).collect()
}
