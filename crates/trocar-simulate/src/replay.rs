//! Simulates a model over a recording whose initial state is unknown.
//!
//! A recording begins with the seal in an unknown state. The replay starts at rest with the first
//! reading and reports from which sample on the initial state no longer matters. From there several
//! extreme initial states give the same force, since the seal forgets its past once it has slid.

use std::ops::Range;

use trocar_model::{
    Deformation, Friction, Mode, PartialReversals, Seal, SealState, Trocar, TrocarState,
};

use crate::many::along;
use crate::simulate::turn;
use crate::stick_slip::{LeftOut, Piece};
use trocar_recording::Recording;
use trocar_recording::cancel;

/// Initial states count as forgotten when their forces agree within this, N.
const FORGOTTEN: f64 = 1e-3;
/// Initial states, as arguments of [`Seal::rest_between`].
const STARTS: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];

/// First of the steps (displacement in m, duration in s) after which the initial state no longer
/// matters.
///
/// For EMS elements, initial states that agree once agree for ever. Those of a classical model must
/// agree up to the end of the motion: the force of a LuGre model does not show its state where
/// σ_1·|v| = g, and the memory of a Leuven model persists through sliding.
pub fn forgotten_after(seal: &Seal, steps: impl Iterator<Item = (f64, f64)>) -> Option<usize> {
    let mut states: Vec<SealState> = STARTS.iter().map(|part| seal.rest_between(*part)).collect();
    let mut since = None;
    for (i, (displacement, duration)) in steps.enumerate() {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for state in &mut states {
            let force = seal.step(state, displacement, duration);
            (low, high) = (low.min(force), high.max(force));
        }
        let agree = high - low < FORGOTTEN;
        since = agree.then(|| since.unwrap_or(i));
        if agree && seal.stages().is_some() {
            break;
        }
    }
    since
}

/// A model simulated over a recording, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct Replay {
    /// Seal force, N, without sensor offset.
    pub force: Vec<f64>,
    /// Torque on the seal, N·m; 0 without rotation in the model.
    pub torque: Vec<f64>,
    /// Deflection, m, the mean of several elements; empty for a model without one.
    pub deflection: Vec<f64>,
    /// Whether every element slides; empty for a model without a deflection.
    pub sliding: Vec<bool>,
    /// Whether the seal deforms after a partial reversal: the deflection has reversed since the
    /// seal last slid. Empty for a model without a deflection.
    pub turned: Vec<bool>,
    /// Samples whose force does not depend on the unknown initial state, as ranges.
    pub known: Vec<Range<usize>>,
}

/// Simulates `trocar` over the positions of `recording`, whose readings contain the sensor offset
/// `offset`, N.
///
/// The simulation restarts after gaps and resets.
pub fn replay<K: AsRef<[f64]>>(trocar: &Trocar<K>, recording: &Recording, offset: f64) -> Replay {
    replay_rest(trocar, recording, |i| recording.force[i] - offset, LeftOut::NONE)
}

/// The same where a model can follow only what is left of the recording; `force` is the one of the seal
/// at a sample, N.
///
/// The simulation also restarts with each piece that is left, from the readings at which it begins.
pub fn replay_rest<K: AsRef<[f64]>>(
    trocar: &Trocar<K>,
    recording: &Recording,
    force: impl Fn(usize) -> f64,
    left_out: &LeftOut,
) -> Replay {
    let mut out = Replay::default();
    let pieces = left_out.pieces(recording);
    for range in recording.unbroken() {
        let inside = pieces.iter().filter(|piece| range.contains(&piece.samples.start)).cloned();
        // Before the first piece nothing is known.
        let before = Piece::unknown(range.start..range.start);
        let all: Vec<Piece> = std::iter::once(before).chain(inside).collect();
        for (k, piece) in all.iter().enumerate() {
            let to = all.get(k + 1).map_or(range.end, |next| next.samples.start);
            if piece.samples.start < to {
                cancel::check();
                out.follow(trocar, recording, &force, (piece, to));
            }
        }
    }
    out
}

/// Force of `trocar` at every sample of `recording` without the sensor offset `offset`, N. The
/// model is at rest with the first reading at the start and after every gap, then follows the
/// positions.
pub fn forces<K: AsRef<[f64]>>(trocar: &Trocar<K>, recording: &Recording, offset: f64) -> Vec<f64> {
    let mut all = vec![0.0; recording.len()];
    for range in recording.unbroken() {
        let (x, t) = (&recording.position[range.clone()], &recording.time[range.clone()]);
        let mut state = trocar.rest_at_force(x[0], recording.force[range.start] - offset);
        let durations: Vec<f64> = t.windows(2).map(|t| t[1] - t[0]).collect();
        let forces = &mut all[range];
        forces[0] = state.force();
        along(trocar, &mut state, &x[1..], &durations, &mut forces[1..]);
    }
    all
}

impl Replay {
    /// Adds the samples from where a piece begins `to` where the next one does.
    fn follow<K: AsRef<[f64]>>(
        &mut self,
        trocar: &Trocar<K>,
        recording: &Recording,
        force: impl Fn(usize) -> f64,
        (Piece { samples, begins, .. }, to): (&Piece, usize),
    ) {
        let (range, end) = (samples.start..to, samples.end.min(to));
        let (x, t) = (&recording.position[range.clone()], &recording.time[range.clone()]);
        let mut state = match begins {
            Some((direction, about)) => {
                let mean = about.clone().map(&force).sum::<f64>() / about.len() as f64;
                self.known.push(samples.start..end);
                trocar.rest_after(x[0], *direction, mean)
            }
            None => {
                let increments = x.windows(2).zip(t.windows(2));
                let increments = increments.map(|(x, t)| (x[1] - x[0], t[1] - t[0]));
                if let Some(after) = forgotten_after(trocar.seal(), increments) {
                    let known = range.start + after + 1..end;
                    self.known.extend((!known.is_empty()).then_some(known));
                }
                trocar.rest_at_force(x[0], force(range.start))
            }
        };
        let angle = |k: usize| recording.angle.as_ref().map(|angle| angle[range.start + k]);
        state = state.with_angle(angle(0).unwrap_or(0.0));
        let (half_width, mut turns) = (trocar.seal().half_width(), PartialReversals::default());
        self.push(&state, half_width, &mut turns);
        for (k, (x, t)) in (1..).zip(x[1..].iter().zip(t.windows(2))) {
            turn(trocar, &mut state, *x, angle(k), t[1] - t[0]);
            self.push(&state, half_width, &mut turns);
        }
    }

    fn push(&mut self, state: &TrocarState, half_width: f64, turns: &mut PartialReversals) {
        self.force.push(state.force());
        self.torque.push(state.torque());
        if let Some(deformation) = state.deformation() {
            let Deformation { deflection, mode } = deformation;
            self.turned.push(turns.take(deformation, half_width));
            self.deflection.push(deflection);
            self.sliding.push(mode == Mode::Sliding);
        }
    }
}
