//! The force along the way beside the element: F_0(x) + level(x)·F ([`crate::travel`]).
//!
//! Fitted where strokes repeat, and kept where it predicts strokes left out. Readings levelled by it then give the
//! element once more, from the beginning, as long as that predicts better still.

use super::{Identification, IdentifyError, IdentifyOptions, inertia, timing};
use crate::recording::Recording;
use crate::replay::{replay, replay_along};
use crate::scatter::StrokeScatter;
use crate::segment::{passes, reversal_threshold};
use crate::travel::{self, NoProfile, TravelFit, TravelProfile, TravelSample};

/// Most times that the element is identified anew.
const ROUNDS: usize = 3;
/// Least part by which the error on strokes left out falls each time.
const LEAST_GAIN: f64 = 0.005;

/// The identification with a profile, if one predicts strokes left out better; `again` identifies from levelled
/// readings.
pub(super) fn extend(
    mut found: Identification,
    recordings: &[Recording],
    options: &IdentifyOptions,
    again: impl Fn(&[Recording]) -> Result<Identification, IdentifyError>,
) -> Identification {
    if !options.along || !repeats(recordings) {
        return found;
    }
    let mut best = match profile(&found, recordings) {
        Ok(fit) => fit,
        Err(why) => {
            found.travel_missing = Some(why.to_string());
            return found;
        }
    };
    // A fit to all motion takes its time, and weighs all positions anyway.
    let rounds = if found.motion.is_some() { 0 } else { ROUNDS };
    for _ in 0..rounds {
        let levelled: Vec<Recording> = recordings.iter().map(|r| levelled(r, &best.profile, best.offset_n)).collect();
        let Ok(refitted) = again(&levelled) else { break };
        let Ok(fit) = profile(&refitted, recordings) else { break };
        if fit.held_out_rms_n > (1.0 - LEAST_GAIN) * best.held_out_rms_n {
            break;
        }
        (found, best) = (refitted, fit);
    }
    let shift = best.offset_n - found.model.offset;
    for p in found.parameters.iter_mut().filter(|p| p.name == "offset_n") {
        p.estimate.value += shift;
        p.estimate.ci95.iter_mut().for_each(|bound| *bound += shift);
    }
    found.model.offset = best.offset_n;
    found.free_parameters += best.profile.free_parameters();
    found.residual_rms = best.rms_n;
    found.travel = Some(best);
    found
}

/// Whether any of the recordings is made of strokes that repeat each other.
pub(super) fn repeats(recordings: &[Recording]) -> bool {
    recordings.iter().any(|recording| StrokeScatter::of(recording).is_ok_and(|scatter| scatter.rules(recording)))
}

/// Root mean square error, N, with the best profile there is, and number of the samples: those that are common to all delays of the
/// positions; `lag`, s, is the one taken out.
pub(super) fn error(found: &Identification, recordings: &[Recording], lag: f64) -> Option<(f64, usize)> {
    let fit = profile(found, recordings).ok();
    let elements = found.stages.elements();
    let offset = fit.as_ref().map_or(found.model.offset, |fit| fit.offset_n);
    let (mut squares, mut samples) = (0.0, 0);
    for recording in recordings {
        let run = replay_along(elements, fit.as_ref().map(|fit| &fit.profile), recording, offset);
        for known in run.known {
            let last = recording.time[known.end - 1];
            for i in known.filter(|i| timing::is_common(recording.time[*i], last, lag)) {
                squares += (recording.force[i] - offset - run.force[i]).powi(2);
                samples += 1;
            }
        }
    }
    (samples > 0).then(|| ((squares / samples as f64).sqrt(), samples))
}

/// The readings as they would be with the mean level throughout; the sensor's `offset`, N, stays.
fn levelled(recording: &Recording, profile: &TravelProfile, offset: f64) -> Recording {
    let mut levelled = recording.clone();
    for (force, x) in levelled.force.iter_mut().zip(&recording.position) {
        *force = offset + profile.without(*x, *force - offset);
    }
    levelled
}

fn profile(found: &Identification, recordings: &[Recording]) -> Result<TravelFit, NoProfile> {
    let elements = found.stages.elements();
    let (mut samples, mut strokes) = (Vec::new(), 0);
    for recording in recordings {
        let run = replay(elements, recording, found.model.offset);
        let inertia = inertia(recording, found.model.hidden_mass);
        let stroke = travel::strokes(recording, &passes(recording, reversal_threshold(recording)));
        samples.extend(run.known.into_iter().flatten().map(|i| TravelSample {
            position: recording.position[i],
            seal_force: run.force[i],
            reading: recording.force[i] - inertia[i],
            stroke: strokes + stroke[i],
        }));
        strokes += stroke.iter().max().map_or(0, |last| last + 1);
    }
    travel::fit(&samples, elements.iter().map(travel::storage_length).fold(0.0, f64::max))
}
