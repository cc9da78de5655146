//! Friction between a surgical instrument and the seal of the trocar it passes through: the
//! Extended Maxwell-Slip (EMS) element, and the classical models that EMS section II names, without
//! allocation and without the standard library.
//!
//! A trocar seal deforms by millimetres with the instrument before it lets it slide. The element is
//! a spring `F_e(z)` with two branches (the seal snaps through), a damper `σ`, and a sliding
//! contact in series:
//!
//! ```text
//! v_d = dz/dt + v_sl                                       (8)     v_d velocity of the instrument, z deflection of the seal
//! F   = F_e(z) + σ(dz/dt)·dz/dt                            (9)     force of the instrument on the seal
//! F   ∈ [g(|v_sl|) + β·|v_sl|]·sgn(v_sl), [-F_s, F_s] at rest (11) (13)
//! ```
//!
//! Numbers in brackets are the equations of EMS, section III (key in SOURCES.md).
//!
//! ```
//! use trocar_model::{Element, ElementParams, Mode};
//!
//! # fn main() -> Result<(), trocar_model::ParamError> {
//! let element = Element::new(ElementParams::plausible_10_5_mm()?)?; // parameters: checked once, immutable
//! let mut state = element.rest_state(0.0);                          // state: small, `Copy`
//!
//! for _ in 0..1000 {
//!     element.step(&mut state, 50e-6, 1e-3); // 50 µm in 1 ms, from an encoder
//! }
//! assert_eq!(state.mode(), Mode::Sliding);
//! assert!((state.force() - (3.0 + 5.0 * 0.05)).abs() < 1e-9); // F_c + β·v_d (16)
//!
//! element.step_velocity(&mut state, -0.05, 0.1); // or driven by velocity: back by 5 mm
//! assert_eq!(state.mode(), Mode::Deforming);
//! # Ok(())
//! # }
//! ```
//!
//! # Other models
//!
//! Those of [`Classical`] have the same shape: parameters checked once, small state, `step` by
//! displacement. [`Friction`] is what all have in common.
//!
//! # Conventions
//!
//! - SI units throughout. Positive is insertion. The force is the one that moves the instrument; the instrument feels its
//!   negative.
//! - A step never fails, allocates or panics, and its work is bounded. A non-finite input or a duration that is not
//!   positive leaves the state untouched and returns the last force.
//! - All arithmetic is plain or from `libm`: the same bits on every machine.
//!
//! # Where this departs from the paper
//!
//! - **Contact as an inclusion.** EMS decides between deforming and sliding, and on the branch, by sgn(v_d). Here the force
//!   decides: the seal sticks while |F| <= F_s and slides otherwise, (13) with sgn(v_sl). Holds, encoder noise and the
//!   end of a braking then need no rule of their own. The example
//!   `literal_reading` has the printed reading and says where it fails.
//! - **Partial reversals.** EMS gives one branch per direction and nothing between; see [`elastic`] for the law that runs
//!   along both, without jumps and without producing energy.
//! - **Velocity weakening.** Where g falls faster than β + σ rise, one force belongs to several slip speeds (a multivalued
//!   friction law) and the seal sticks and slips, although the paper remarks that proposition III.3 holds for any Stribeck
//!   curve. [`Element::velocity_weakening`] gives the speeds; the step follows the present branch to its end.
//!
//! # Where it goes beyond the paper
//!
//! Held seals lose force, which EMS cannot show. Two laws may be added to an element, each
//! dissipative by itself: slip of the contact below the static force ([`creep`]) and relaxation of
//! the rubber ([`relaxation`]). Both are off by default.
//!
//! # Accuracy
//!
//! With constant friction, no damping, and branches that stay within ±F_s, sliding happens on the
//! straight ends of F_e only: the step is the exact solution at constant velocity, for any step
//! length and stiffness. Otherwise it is of second order and unconditionally stable (an
//! exponentially fitted θ method), apart from events within a step.
//!
//! # Limits
//!
//! No temperature, wear, wetting, tilt or gas pressure. The law between the branches follows from
//! the properties above, not from measured partial reversals. Not a medical device.
#![no_std]
#![forbid(unsafe_code)]

pub mod backlash;
pub mod batch;
mod block;
pub mod classical;
pub mod constants;
pub mod creep;
pub mod damping;
mod direction;
pub mod dwell;
pub mod elastic;
pub mod ems;
pub mod error;
mod exponential;
pub mod flat;
pub mod friction;
pub mod law;
pub mod parallel;
pub mod parameter;
pub mod partial;
mod plausible;
pub mod profile;
pub mod relaxation;
pub mod rotation;
mod row;
mod run;
pub mod seal;
pub mod sliding;
mod slip;
pub mod tuning;

pub use backlash::{BacklashFilter, BacklashState};
pub use classical::*;
pub use damping::SealDamping;
pub use direction::Direction;
pub use elastic::{Branch, DeformationForce, MAX_DEGREE, Piece};
pub use ems::{Element, ElementParams, Mode, State, VelocityWeakening};
pub use error::ParamError;
pub use friction::Friction;
pub use law::{Choice, Elements, MAX_ELEMENTS, Visit};
pub use parallel::{MAX_STAGES, Stages, StagesState, step_parallel};
pub use parameter::{Blank, Declaration, Field, ParameterId, Parameters, Quantity, Range, Unit};
pub use partial::PartialReversals;
pub use profile::{PositionProfile, ProfileError};
pub use relaxation::{MAX_ARMS, Relaxation, RelaxationArm};
pub use rotation::{Around, Rotation, Turning};
pub use seal::{Deformation, Seal, SealState, Trocar, TrocarState};
pub use sliding::SlidingFriction;
pub use slip::beside::{BESIDE, Beside, Lead, Ordinate};
pub use tuning::Tunable;
