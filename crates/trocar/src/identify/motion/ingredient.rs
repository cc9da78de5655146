//! What an element may have beyond the paper's, and how a trial gains or loses it.

use serde::Serialize;
use trocar_model::RelaxationArm;

use super::super::candidate::{Candidate, EmsTrial, Layout};

/// Where the slow numbers start: creep velocity, m/s, stiffness of an arm as a part of F_c/c, relaxation times, s.
const FIRST_CREEP: f64 = 2e-4;
const FIRST_ARM: f64 = 0.1;
const FIRST_TIMES: [f64; 2] = [0.2, 3.0];
/// Half widths of the second stage, as parts of the first's, and its part of the sliding force.
const FIRST_WIDTHS: [f64; 2] = [0.3, 0.6];
const FIRST_PART: f64 = 0.3;
/// F_s over F_c and v_s, m/s, to start from; seal damping, N·s/m.
const FIRST_RISE: f64 = 1.08;
const FIRST_STRIBECK_VELOCITY: f64 = 0.01;
const FIRST_DAMPING: f64 = 1.0;
/// Lag of the Stribeck curve, s.
const FIRST_LAG: f64 = 0.01;

/// What an element may have besides constant and viscous friction and its branches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ingredient {
    /// Friction that rises towards rest, EMS (11).
    Stribeck,
    /// Damping of the deformation, EMS (9).
    SealDamping,
    /// Stiffness of partial reversals, other than the least one that follows both branches.
    MinorLoops,
    /// Slip below the static force.
    Creep,
    /// Relaxation of the rubber.
    Relaxation,
    /// A second relaxation time.
    SecondRelaxation,
    /// Inertia of a mass between sensor and seal that was not declared: not the seal's, but in its readings.
    HiddenMass,
    /// Sliding forces of their own for insertion and withdrawal.
    Asymmetry,
    /// A second element in parallel: a seal of its own, or the part of a lip that slides while the rest still holds.
    SecondStage,
}

impl Ingredient {
    /// All, in the order of the tables.
    pub const ALL: [Self; 9] = [
        Self::Stribeck,
        Self::SealDamping,
        Self::MinorLoops,
        Self::Creep,
        Self::Relaxation,
        Self::SecondRelaxation,
        Self::HiddenMass,
        Self::Asymmetry,
        Self::SecondStage,
    ];

    /// Those of which full strokes tell nothing.
    pub(super) const OF_FREE_MOTION: [Self; 5] =
        [Self::MinorLoops, Self::Creep, Self::Relaxation, Self::SecondRelaxation, Self::SecondStage];

    /// Those that are only tried on top of the others.
    pub(super) const LARGER: [Self; 4] = [Self::HiddenMass, Self::Asymmetry, Self::SecondStage, Self::SecondRelaxation];

    /// Name on the command line and in `summary.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stribeck => "stribeck",
            Self::SealDamping => "seal_damping",
            Self::MinorLoops => "minor_loops",
            Self::Creep => "creep",
            Self::Relaxation => "relaxation",
            Self::SecondRelaxation => "second_relaxation",
            Self::HiddenMass => "hidden_mass",
            Self::Asymmetry => "asymmetry",
            Self::SecondStage => "second_stage",
        }
    }

    /// Words for tables.
    pub fn words(self) -> &'static str {
        match self {
            Self::Stribeck => "Stribeck friction",
            Self::SealDamping => "seal damping",
            Self::MinorLoops => "minor-loop stiffness",
            Self::Creep => "creep of the contact",
            Self::Relaxation => "relaxation",
            Self::SecondRelaxation => "second relaxation time",
            Self::HiddenMass => "undeclared mass",
            Self::Asymmetry => "asymmetric sliding",
            Self::SecondStage => "second stage",
        }
    }

    pub(super) fn is_in(self, layout: &Layout) -> bool {
        match self {
            Self::Stribeck => layout.stribeck,
            Self::SealDamping => layout.damping,
            Self::MinorLoops => layout.yielding,
            Self::Creep => layout.creep,
            Self::Relaxation => layout.arms > 0,
            Self::SecondRelaxation => layout.arms > 1,
            Self::HiddenMass => layout.hidden_mass,
            Self::Asymmetry => !layout.symmetric,
            Self::SecondStage => layout.second,
        }
    }

    /// Trials with the ingredient to start from.
    pub(super) fn starts(self, from: &EmsTrial) -> Vec<EmsTrial> {
        let EmsTrial { mut candidate, mut layout } = from.clone();
        match self {
            Self::Stribeck => {
                layout.stribeck = true;
                for sliding in [&mut candidate.insertion, &mut candidate.withdrawal] {
                    sliding.static_force = sliding.static_force.max(FIRST_RISE * sliding.coulomb_force);
                    sliding.stribeck_velocity = FIRST_STRIBECK_VELOCITY;
                    sliding.stribeck_exponent = 2.0;
                }
            }
            Self::SealDamping => {
                layout.damping = true;
                candidate.seal_damping = candidate.seal_damping.max(FIRST_DAMPING);
            }
            Self::MinorLoops => {
                layout.yielding = true;
                candidate.yield_ratio = candidate.yield_ratio.max(1.1 * Candidate::DEFAULT_YIELD_RATIO);
            }
            Self::Creep => {
                layout.creep = true;
                candidate.creep_velocity = FIRST_CREEP;
                layout.lag = layout.stribeck;
                candidate.friction_lag = if layout.lag { FIRST_LAG } else { 0.0 };
            }
            Self::Relaxation | Self::SecondRelaxation => {
                let stiffness = FIRST_ARM * candidate.insertion.coulomb_force / candidate.half_width;
                candidate.relaxation.arms[layout.arms] = RelaxationArm { stiffness, time: FIRST_TIMES[layout.arms] };
                layout.arms += 1;
            }
            Self::HiddenMass => layout.hidden_mass = true,
            Self::Asymmetry => layout.symmetric = false,
            Self::SecondStage => {
                layout.second = true;
                let divided = FIRST_WIDTHS.iter().filter_map(|width| candidate.divided(*width, FIRST_PART));
                return divided.map(|candidate| EmsTrial { candidate, layout }).collect();
            }
        }
        vec![EmsTrial { candidate, layout }]
    }

    /// Whether the ingredient can be tried on top.
    pub(super) fn can_join(self, layout: &Layout) -> bool {
        !self.is_in(layout) && (self != Self::SecondRelaxation || layout.arms == 1)
    }

    /// The trial without the ingredient; `None` for stages that make no single element.
    pub(super) fn remove(self, from: &EmsTrial) -> Option<EmsTrial> {
        let EmsTrial { mut candidate, mut layout } = from.clone();
        match self {
            Self::Stribeck => {
                (layout.stribeck, layout.lag) = (false, false);
                candidate.friction_lag = 0.0;
            }
            Self::SealDamping => {
                layout.damping = false;
                candidate.seal_damping = 0.0;
            }
            Self::MinorLoops => {
                layout.yielding = false;
                candidate.yield_ratio = Candidate::DEFAULT_YIELD_RATIO;
            }
            Self::Creep => {
                (layout.creep, layout.lag) = (false, false);
                (candidate.creep_velocity, candidate.friction_lag) = (0.0, 0.0);
            }
            Self::Relaxation | Self::SecondRelaxation => {
                let kept = usize::from(self == Self::SecondRelaxation);
                layout.arms = kept;
                candidate.relaxation.arms[kept..].fill(RelaxationArm::NONE);
            }
            Self::HiddenMass => {
                layout.hidden_mass = false;
                candidate.hidden_mass = 0.0;
            }
            Self::Asymmetry => {
                layout.symmetric = true;
                candidate.insertion.coulomb_force =
                    0.5 * (candidate.insertion.coulomb_force + candidate.withdrawal.coulomb_force);
            }
            Self::SecondStage => {
                layout.second = false;
                candidate = candidate.joined()?;
            }
        }
        // Numbers that hang on others, such as F_s = F_c without Stribeck friction, follow.
        let values: Vec<f64> = layout.free(&candidate).iter().map(|free| free.value).collect();
        Some(EmsTrial { candidate: layout.with(&candidate, &values), layout })
    }
}
