//! Models written out for other programs, one module per form.

pub mod c;
