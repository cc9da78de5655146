//! Runs a model over a recording, from a start that nobody measured.
//!
//! A recording begins with the seal in an unknown state. The replay starts at rest with the first reading, and says
//! from which sample on the start no longer matters: there several extreme starts give one force (the seal forgets
//! its past once it has slid).

use std::ops::Range;

use trocar_model::{Classical, ClassicalState, Deformation, Element, Friction, Mode, State, rest_states};

use crate::cancel;
use crate::recording::Recording;
use crate::travel::TravelProfile;

/// Unknown starts count as forgotten when their forces agree within this, N.
const FORGOTTEN: f64 = 1e-3;
/// Starts of EMS elements: deflections as fractions of the half width.
const DEFLECTIONS: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
/// Starts of a classical model, N: clamped to what it can hold.
const FORCES: [f64; 3] = [-f64::MAX, 0.0, f64::MAX];

/// A model that can be run over a recording: EMS elements in parallel, or a classical one.
pub trait Replayable {
    /// Everything that changes.
    type State;

    /// Whether starts that agree once agree for ever. Otherwise they must agree up to the end of the motion: the force
    /// of a LuGre model does not show its state where σ_1·|v| = g, and the memory of a Leuven model outlives a slide.
    const FORGETS_FOR_GOOD: bool;

    /// At rest with `force`, N.
    fn at_rest(&self, force: f64) -> Self::State;

    /// At rest as far apart as can be, and between.
    fn extreme_starts(&self) -> Vec<Self::State>;

    /// Advances by `displacement` (m) within `duration` (s); returns the force (N) at the end.
    fn step(&self, state: &mut Self::State, displacement: f64, duration: f64) -> f64;

    /// Force after the last step, N.
    fn force(state: &Self::State) -> f64;

    /// How the seal is deformed, for a model that knows; throughout or never.
    fn deformation(state: &Self::State) -> Option<Deformation>;

    /// c of the widest element, m; 0 for a model that knows no deflection.
    fn half_width(&self) -> f64 {
        0.0
    }
}

/// Travel of the deflection back, as a part of the half width, that is a partial reversal: some ten counts of an encoder.
const TURN: f64 = 0.02;

/// Follows a deformation: whether the deflection has turned since the seal last slid. Full strokes never turn so, and tell
/// nothing of the force after it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Turns {
    /// Deflection farthest along `direction`, m.
    extreme: f64,
    direction: f64,
    has_turned: bool,
}

impl Turns {
    /// Takes the next deformation of a seal with half width `half_width`, m; whether it is one after a partial reversal.
    pub(crate) fn take(&mut self, now: Deformation, half_width: f64) -> bool {
        let way = now.deflection - self.extreme;
        if now.mode == Mode::Sliding {
            *self = Self { extreme: now.deflection, ..Self::default() };
        } else if way * self.direction > 0.0 {
            self.extreme = now.deflection;
        } else if way.abs() > TURN * half_width {
            self.has_turned |= self.direction != 0.0;
            (self.extreme, self.direction) = (now.deflection, way.signum());
        }
        self.has_turned
    }
}

/// Elements in parallel; the deflection is that of the first, and the seal slides once all of them do.
impl Replayable for [Element] {
    type State = Vec<State>;

    const FORGETS_FOR_GOOD: bool = true;

    fn at_rest(&self, force: f64) -> Vec<State> {
        start_states(self, force)
    }

    fn extreme_starts(&self) -> Vec<Vec<State>> {
        let start = |u: &f64| self.iter().map(|e| e.rest_state(u * e.params().deformation.half_width())).collect();
        DEFLECTIONS.iter().map(start).collect()
    }

    fn step(&self, states: &mut Vec<State>, displacement: f64, duration: f64) -> f64 {
        self.iter().zip(states).map(|(element, state)| element.step(state, displacement, duration)).sum()
    }

    fn force(states: &Vec<State>) -> f64 {
        states.iter().map(State::force).sum()
    }

    fn deformation(states: &Vec<State>) -> Option<Deformation> {
        let slides = states.iter().all(|state| state.mode() == Mode::Sliding);
        let mode = if slides { Mode::Sliding } else { Mode::Deforming };
        Some(Deformation { deflection: states.first().map_or(0.0, State::deflection), mode })
    }

    fn half_width(&self) -> f64 {
        self.iter().map(|element| element.params().deformation.half_width()).fold(0.0, f64::max)
    }
}

impl Replayable for Classical {
    type State = ClassicalState;

    const FORGETS_FOR_GOOD: bool = false;

    fn at_rest(&self, force: f64) -> ClassicalState {
        self.rest_at_force(force)
    }

    fn extreme_starts(&self) -> Vec<ClassicalState> {
        FORCES.map(|force| self.rest_at_force(force)).to_vec()
    }

    fn step(&self, state: &mut ClassicalState, displacement: f64, duration: f64) -> f64 {
        Friction::step(self, state, displacement, duration)
    }

    fn force(state: &ClassicalState) -> f64 {
        <Self as Friction>::force(state)
    }

    fn deformation(_: &ClassicalState) -> Option<Deformation> {
        None
    }
}

/// States at rest that together give `force`, N, each element bearing the share of its sliding limit.
pub fn start_states(elements: &[Element], force: f64) -> Vec<State> {
    rest_states(elements, force).collect()
}

/// First of the steps (displacement in m, duration in s) after which the start no longer matters.
pub fn forgotten_after<M: Replayable + ?Sized>(model: &M, steps: impl Iterator<Item = (f64, f64)>) -> Option<usize> {
    let mut states = model.extreme_starts();
    let mut since = None;
    for (i, (displacement, duration)) in steps.enumerate() {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for state in &mut states {
            let force = model.step(state, displacement, duration);
            (low, high) = (low.min(force), high.max(force));
        }
        let agree = high - low < FORGOTTEN;
        since = agree.then(|| since.unwrap_or(i));
        if agree && M::FORGETS_FOR_GOOD {
            break;
        }
    }
    since
}

/// A model run over a recording, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct Replay {
    /// Seal force, N, without sensor offset.
    pub force: Vec<f64>,
    /// Deflection, m, of the first element; empty for a model that knows none.
    pub deflection: Vec<f64>,
    /// Whether every element slides; empty for a model that does not tell.
    pub sliding: Vec<bool>,
    /// Whether the seal deforms after a partial reversal: the deflection has turned since the seal last slid. Empty for a model
    /// that knows none.
    pub turned: Vec<bool>,
    /// Samples whose force does not depend on the unknown start, as ranges.
    pub known: Vec<Range<usize>>,
}

/// Runs `model` over the positions of `recording`, whose readings hold the sensor offset `offset`, N.
///
/// Gaps and resets start anew.
pub fn replay<M: Replayable + ?Sized>(model: &M, recording: &Recording, offset: f64) -> Replay {
    replay_along(model, None, recording, offset)
}

/// The same with a force that depends on the position: `travel` turns the model's force into that of [`Replay::force`].
pub fn replay_along<M: Replayable + ?Sized>(
    model: &M,
    travel: Option<&TravelProfile>,
    recording: &Recording,
    offset: f64,
) -> Replay {
    let mut out = Replay::default();
    for range in recording.unbroken() {
        cancel::check();
        let (x, t) = (&recording.position[range.clone()], &recording.time[range.clone()]);
        let increments = || x.windows(2).zip(t.windows(2)).map(|(x, t)| (x[1] - x[0], t[1] - t[0]));
        if let Some(after) = forgotten_after(model, increments()) {
            out.known.push(range.start + after + 1..range.end);
        }
        let first = recording.force[range.start] - offset;
        let mut state = model.at_rest(travel.map_or(first, |profile| profile.without(x[0], first)));
        let (half_width, mut turns) = (model.half_width(), Turns::default());
        out.push::<M>(&state, half_width, &mut turns);
        for (displacement, duration) in increments() {
            model.step(&mut state, displacement, duration);
            out.push::<M>(&state, half_width, &mut turns);
        }
    }
    if let Some(profile) = travel {
        out.force.iter_mut().zip(&recording.position).for_each(|(force, x)| *force = profile.apply(*x, *force));
    }
    out
}

impl Replay {
    fn push<M: Replayable + ?Sized>(&mut self, state: &M::State, half_width: f64, turns: &mut Turns) {
        self.force.push(M::force(state));
        if let Some(deformation) = M::deformation(state) {
            let Deformation { deflection, mode } = deformation;
            self.turned.push(turns.take(deformation, half_width));
            self.deflection.push(deflection);
            self.sliding.push(mode == Mode::Sliding);
        }
    }
}
