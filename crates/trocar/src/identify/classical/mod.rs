//! Classical friction models from the recordings that an EMS element is identified from.
//!
//! Same data, same handling: the passes and stretches of the segmentation, samples taken together where the motion is
//! small, scored from where the start no longer matters, clusters of passes for the intervals. Every model is fitted by
//! free-run simulation (output-error least squares); linear ones are thereby solved in closed form, the stiffnesses of
//! Maxwell-Slip start from a convex problem (non-negative least squares for given limits, RIZOS).

mod data;
mod fit;
mod kind;
mod starts;

pub(crate) use data::{ASSUMED_WIDTH, ClassicalData};
pub use fit::ClassicalFit;
pub(crate) use fit::{Kin, LONG, SHORT, doubts, fit};
pub use kind::Kind;
