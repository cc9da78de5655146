//! One file per verb: its arguments and its output.

pub(crate) mod analyze;
pub(crate) mod bench;
pub(crate) mod compare;
pub(crate) mod compensate;
pub(crate) mod completions;
pub(crate) mod demo;
pub(crate) mod export;
pub(crate) mod fleet;
pub(crate) mod identify;
pub(crate) mod inspect;
pub(crate) mod man;
pub(crate) mod plan;
pub(crate) mod ranges;
pub(crate) mod simulate;
pub(crate) mod teleop;
pub(crate) mod validate;
