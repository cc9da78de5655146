//! Runs identified elements over a recording, from a start that nobody measured.
//!
//! A recording begins with the seal in an unknown deflection. The replay starts at rest where the mid curve gives
//! the first reading, and says from which sample on the start no longer matters: there several extreme starts give
//! one force (the seal forgets its past once it has slid).

use std::ops::Range;

use trocar_model::{Element, Mode, State};

use crate::recording::Recording;

/// Unknown starts count as forgotten when their forces agree within this, N.
const FORGOTTEN: f64 = 1e-3;
/// Starts compared: deflections as fractions of the half width.
const STARTS: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];

/// States at rest that together give `force`, N, each element bearing the share of its sliding limit.
pub fn start_states(elements: &[Element], force: f64) -> Vec<State> {
    let limit = |e: &Element| e.params().insertion.static_force + e.params().withdrawal.static_force;
    let total: f64 = elements.iter().map(limit).sum();
    elements.iter().map(|e| e.rest_at_force(force * limit(e) / total)).collect()
}

/// First of the steps (displacement in m, duration in s) after which the start no longer matters.
pub fn forgotten_after(elements: &[Element], steps: impl Iterator<Item = (f64, f64)>) -> Option<usize> {
    let mut states: Vec<Vec<State>> = STARTS
        .iter()
        .map(|u| elements.iter().map(|e| e.rest_state(u * e.params().deformation.half_width())).collect())
        .collect();
    for (i, (displacement, duration)) in steps.enumerate() {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for start in &mut states {
            let force: f64 = elements.iter().zip(start).map(|(e, s)| e.step(s, displacement, duration)).sum();
            (low, high) = (low.min(force), high.max(force));
        }
        if high - low < FORGOTTEN {
            return Some(i);
        }
    }
    None
}

/// A model run over a recording, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct Replay {
    /// Seal force, N, without sensor offset.
    pub force: Vec<f64>,
    /// Deflection, m, of the first element.
    pub deflection: Vec<f64>,
    /// Whether every element slides.
    pub sliding: Vec<bool>,
    /// Samples whose force does not depend on the unknown start, as ranges.
    pub known: Vec<Range<usize>>,
}

/// Runs `elements` over the positions of `recording`, whose readings hold the sensor offset `offset`, N.
///
/// Gaps and resets start anew.
pub fn replay(elements: &[Element], recording: &Recording, offset: f64) -> Replay {
    let mut out = Replay::default();
    for range in recording.unbroken() {
        let (x, t) = (&recording.position[range.clone()], &recording.time[range.clone()]);
        let increments = || x.windows(2).zip(t.windows(2)).map(|(x, t)| (x[1] - x[0], t[1] - t[0]));
        if let Some(after) = forgotten_after(elements, increments()) {
            out.known.push(range.start + after + 1..range.end);
        }
        let mut states = start_states(elements, recording.force[range.start] - offset);
        push(&mut out, &states);
        for (displacement, duration) in increments() {
            elements.iter().zip(&mut states).for_each(|(e, s)| {
                e.step(s, displacement, duration);
            });
            push(&mut out, &states);
        }
    }
    out
}

fn push(out: &mut Replay, states: &[State]) {
    out.force.push(states.iter().map(State::force).sum());
    out.deflection.push(states.first().map_or(0.0, State::deflection));
    out.sliding.push(states.iter().all(|s| s.mode() == Mode::Sliding));
}
