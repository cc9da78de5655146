//! The position profile in addition to the element: F_0(x) + gain(x)·F ([`trocar_simulate::profile`]).
//!
//! The profile is fitted where strokes repeat, and only to readings taken while sliding. If all
//! strokes reverse at the same positions, position and deflection cannot be separated while the
//! seal deforms. The profile is kept if it improves the prediction of held-out cycles. The element
//! is then refitted to the readings with the profile removed. Together they stay passive.

use super::element::{self, ElementFit, Input};
use rayon::prelude::*;
use trocar_model::Trocar;

use trocar_recording::{Recording, range};
use trocar_simulate::profile::{
    self, NoProfile, ProfileFit, ProfileSample, is_passive, longest_storage,
};
use trocar_simulate::replay::replay;
use trocar_simulate::scatter::StrokeScatter;
use trocar_simulate::segment::{Segments, reversal_threshold, strokes};

/// The profile, or why repeated strokes gave none; `Ok(None)` where none was requested or possible.
pub(super) type Profile = Result<Option<ProfileFit>, String>;

/// The element with its position profile, if there is one.
pub(super) fn profiled(input: &Input, fit: Option<ElementFit>) -> (Option<ElementFit>, Profile) {
    let Some(fit) = fit else { return (None, Ok(None)) };
    if !(input.options.along && repeats(input.recordings)) {
        return (Some(fit), Ok(None));
    }
    // With the position dependence removed, the deformation force may no longer fall.
    let (profile, unless_refitted) = match profile(input, &fit) {
        Ok(profile) => (profile, None),
        Err(reason) => {
            let words = reason.to_string();
            let NoProfile::NotDissipative { any, .. } = reason else {
                return (Some(fit), Err(words));
            };
            (*any, Some(words))
        }
    };
    let without = |r: &Recording| {
        let mut without = r.clone();
        for (force, x) in without.force.iter_mut().zip(&r.position) {
            *force = profile.offset_n + profile.profile.without(*x, *force - profile.offset_n);
        }
        without
    };
    let recordings: Vec<Recording> = input.recordings.iter().map(without).collect();
    let without = Input { recordings: &recordings, ..*input };
    // A refit with a larger error than its start has failed, and so has one with which the seal yields energy.
    let error =
        |input: &Input, f: &ElementFit| element::sampled_rms(input, &f.fitted.best.candidate);
    let (constant, kept) = (error(input, &fit), error(&without, &fit));
    let again = element::again(&without, &fit).map(|again| (error(&without, &again), again));
    let stays_passive = |fit: &ElementFit| {
        let stages = fit.fitted.best.candidate.stages();
        stages.is_ok_and(|stages| is_passive(&profile.profile, longest_storage(&stages)))
    };
    let (along, again) = again
        .filter(|(along, again)| *along <= kept && stays_passive(again))
        .map_or((kept, None), |(e, again)| (e, Some(again)));
    if let Some(why) = unless_refitted.filter(|_| again.is_none()) {
        return (Some(fit), Err(why));
    }
    if along > constant {
        let why = format!(
            "with a profile the error over the whole motion is {along:.4} N rms, without {constant:.4} N"
        );
        return (Some(fit), Err(why));
    }
    (Some(again.unwrap_or(fit)), Ok(Some(profile)))
}

/// Whether any of the recordings consists of repeated strokes.
pub(super) fn repeats(recordings: &[Recording]) -> bool {
    recordings.iter().any(|recording| {
        StrokeScatter::of(recording).is_some_and(|scatter| scatter.rules(recording))
    })
}

fn profile(input: &Input, fit: &ElementFit) -> Result<ProfileFit, NoProfile> {
    let candidate = &fit.fitted.best.candidate;
    let stages = candidate.stages().expect("it was fitted");
    let trocar = Trocar::of_seal(stages);
    let (mut samples, mut cycles) = (Vec::new(), 0);
    let run = |recording: &Recording| {
        let reading = recording.force_without(&candidate.loads, candidate.offset);
        (replay(&trocar, recording, candidate.offset), reading)
    };
    let runs: Vec<_> = input.recordings.par_iter().map(run).collect();
    for (index, (recording, (run, reading))) in input.recordings.iter().zip(runs).enumerate() {
        let cycle = profile::cycles(recording, &strokes(recording, reversal_threshold(recording)));
        let slides = |i: &usize| run.sliding[*i];
        samples.extend(run.known.iter().cloned().flatten().filter(slides).map(|i| ProfileSample {
            position: recording.position[i],
            seal_force: fit.scale.at(index, recording.time[i] - recording.time[0]) * run.force[i],
            reading: reading[i],
            cycle: cycles + cycle[i],
        }));
        cycles += cycle.iter().max().map_or(0, |last| last + 1);
    }
    profile::fit(&samples, longest_storage(&stages))
}

/// Whether all strokes reverse at the same two positions, within a tenth of their length.
pub(super) fn turn_at_same_places(segments: &Segments, recording: &Recording) -> bool {
    let x = &recording.position;
    let ends = |of: fn(f64, f64) -> f64| {
        let all: Vec<f64> = segments.strokes.iter().map(|p| of(x[p.start], x[p.end])).collect();
        let (low, high) = range(&all);
        high - low
    };
    segments.strokes.len() >= 4 && ends(f64::min) + ends(f64::max) < 0.1 * recording.quality.stroke
}
