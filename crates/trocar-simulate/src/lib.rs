//! Trocar models under motion: one along a recording, many at once, and on a virtual test bench
//! that makes recordings.

#[cfg(feature = "bench")]
pub mod bench;
pub mod many;
pub mod motion_found;
pub mod profile;
pub mod replay;
pub mod scatter;
pub mod segment;
pub mod simulate;
pub mod stick_slip;
