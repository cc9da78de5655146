//! Classical friction models, identified from the same recordings as an EMS element.
//!
//! Data and preprocessing are the same: strokes and constant-velocity segments from the
//! segmentation, samples averaged where the motion is small, scoring from where the initial state
//! no longer matters, and clusters of strokes for the intervals. Every model is fitted by free-run
//! simulation (output-error least squares). Linear models are thereby solved in closed form.

mod banks;
mod coordinate;
mod data;
mod elements;
mod family;
mod fit;
mod kind;

pub use data::ClassicalData;
pub use fit::ClassicalFit;
pub(crate) use fit::{LONG, SHORT, doubts};
pub use fit::{RelatedFits, fit};
pub use kind::Kind;
