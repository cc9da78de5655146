//! Trajectories that are not part of this repository.

use std::path::PathBuf;

use crate::skipped::skipped;

/// Text of a shared trajectory, or `None` with the reason printed when the folder is not there.
pub(crate) fn shared_vector(name: &str) -> Option<String> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/vectors").join(name);
    match std::fs::read_to_string(&path) {
        Ok(text) => Some(text),
        Err(error) => {
            let required = std::env::var("TROCAR_REQUIRE_SHARED").is_ok_and(|value| value == "1");
            assert!(!required, "{}: {error}", path.display());
            skipped(&format!("{}: {error}", path.display()));
            None
        }
    }
}
