//! From recordings of an instrument in a trocar to a validated model of the force between them.

pub mod bench;
pub mod model_file;
