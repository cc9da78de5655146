//! From recordings to a validated model of the force between a surgical instrument and a trocar seal.

pub mod error;
pub mod recording;
