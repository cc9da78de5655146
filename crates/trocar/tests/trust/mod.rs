//! Hard benches with known truth, and what the identification states about each parameter.
//!
//! Shared by the test `trust` and the example of the same name.

pub(crate) mod judge;
pub(crate) mod kinds;
