//! Hard benches with known true parameters, and the statements of the identification about each
//! parameter.
//!
//! Shared by the test `trust` and the example of the same name.

pub(crate) mod judge;
pub(crate) mod kinds;
mod random;
