//! What is done with identified models: validated on other recordings, compared with other models,
//! planned for, put into loops of teleoperation, and made from whole fleets of recordings.

pub mod compare;
pub mod draws;
pub mod fleet;
pub mod margin;
pub mod motion;
#[cfg(feature = "bench")]
pub mod plan;
pub mod simpler;
pub mod summary;
#[cfg(feature = "bench")]
pub mod teleop;
pub mod validate;
pub mod workflow;
