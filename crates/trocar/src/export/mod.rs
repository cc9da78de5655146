//! Export of models to other programs, one module per format.

pub mod c;
pub mod values;
