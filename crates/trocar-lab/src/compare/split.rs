//! Recordings divided into a part for the fit and a part for scoring, when no validation recording
//! is given.

use trocar_recording::{Recording, RecordingError};
use trocar_simulate::segment::{reversal_threshold, strokes};

/// Fraction of the time that is used for the fit.
const FITTED: f64 = 2.0 / 3.0;

/// Divides each recording at the first reversal after two thirds of its time, and returns the
/// training and the validation parts.
///
/// Both parts keep the hash of the whole recording, which is that of its file.
///
/// # Errors
/// A part is too short for a recording.
pub fn split(recordings: &[Recording]) -> Result<(Vec<Recording>, Vec<Recording>), RecordingError> {
    let mut parts = (Vec::new(), Vec::new());
    for recording in recordings {
        let at = place(recording);
        let part = |range, what| {
            let part = recording.part(range, what)?;
            Ok::<_, RecordingError>(Recording { sha256: recording.sha256.clone(), ..part })
        };
        parts.0.push(part(0..at + 1, "fitted part")?);
        parts.1.push(part(at..recording.len(), "held-out part")?);
    }
    Ok(parts)
}

/// First reversal after two thirds of the time; without one, the sample there.
fn place(recording: &Recording) -> usize {
    let wanted = recording.time[0] + FITTED * recording.duration();
    let reversals = strokes(recording, reversal_threshold(recording))
        .into_iter()
        .filter(|p| p.starts_at_reversal);
    let behind = reversals.map(|p| p.start).find(|i| recording.time[*i] >= wanted);
    behind.unwrap_or_else(|| recording.time.partition_point(|t| *t < wanted))
}
