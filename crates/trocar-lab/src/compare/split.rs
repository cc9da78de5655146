//! Recordings divided into a part for the fit and a part for scoring, when no validation recording
//! is given.

use super::{CompareError, CompareOptions, Outcome, compare};
use crate::workflow::MovingMass;
use trocar_identify::Progress;
use trocar_recording::loads::Loads;
use trocar_recording::{Recording, RecordingError};
use trocar_simulate::segment::{reversal_threshold, strokes};

/// Fraction of the time that is used for the fit.
const FITTED: f64 = 2.0 / 3.0;

/// The recordings of a comparison, without the moving mass.
#[derive(Debug, Clone)]
pub struct Divided {
    /// To fit to.
    pub training: Vec<Recording>,
    /// To score on.
    pub validation: Vec<Recording>,
    /// Whether these are the last thirds of the recordings ([`split`]), because no others were given.
    pub held_out: bool,
    /// The mass.
    pub moving_mass: MovingMass,
}

impl Divided {
    /// Of recordings to fit to and to score on; without the latter, [`split`].
    ///
    /// # Errors
    /// The same recording twice; a part or a mass that makes no recording.
    pub fn of(
        recordings: Vec<Recording>,
        validation: Vec<Recording>,
        moving_mass: MovingMass,
    ) -> Result<Self, CompareError> {
        let all: Vec<&Recording> = recordings.iter().chain(&validation).collect();
        for (i, second) in all.iter().enumerate() {
            if let Some(first) = all[..i].iter().find(|first| first.sha256 == second.sha256) {
                let (first, second) = (first.name.clone(), second.name.clone());
                return Err(CompareError::Twice { first, second });
            }
        }
        let recordings = moving_mass.subtracted_from_all(recordings, &Loads::default(), 0.0)?;
        let validation = moving_mass.subtracted_from_all(validation, &Loads::default(), 0.0)?;
        let held_out = validation.is_empty();
        let (training, validation) =
            if held_out { split(&recordings)? } else { (recordings, validation) };
        Ok(Self { training, validation, held_out, moving_mass })
    }

    /// Fits all models and scores them.
    ///
    /// # Errors
    /// [`CompareError`]; a doubtful fit is not an error but part of the result.
    pub fn compared(
        self,
        mut options: CompareOptions,
        progress: Progress,
    ) -> Result<Outcome, CompareError> {
        let Self { training, validation, held_out, moving_mass } = self;
        options.identify.inertia_removed = moving_mass.mass > 0.0;
        let comparison = compare(&training, &validation, &options, progress)?;
        Ok(Outcome { comparison, seed: options.identify.seed, held_out, moving_mass })
    }
}

/// Divides each recording at the first reversal after two thirds of its time, and returns the
/// training and the validation parts.
///
/// Both parts keep the hash of the whole recording, which is that of its file.
///
/// # Errors
/// A part is too short for a recording.
pub fn split(recordings: &[Recording]) -> Result<(Vec<Recording>, Vec<Recording>), RecordingError> {
    let (mut fitted, mut held_out) = (Vec::new(), Vec::new());
    for recording in recordings {
        let at = place(recording);
        let ranges = [0..at + 1, at..recording.len()];
        let parts = [(&mut fitted, "fitted part"), (&mut held_out, "held-out part")];
        for (range, (parts, what)) in ranges.into_iter().zip(parts) {
            let part = recording.part(range, what)?;
            parts.push(Recording { sha256: recording.sha256.clone(), ..part });
        }
    }
    Ok((fitted, held_out))
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
