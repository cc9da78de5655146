//! Whether another level of friction explains the readings better than the present one.
//!
//! The filter of [`super::adapt`] learns from slides, and a seal that is suddenly oiled may slide all the time while the model
//! still believes that it bends. So the model also runs at seven levels side by side, each with its own state. Whenever a
//! cell of the way is crossed against the direction of its last crossing, bending or sliding, each is held against what turned:
//!
//! ```text
//! e_h = (y₊ − y₋) − (F_h₊ − F_h₋)          an elastic tissue or a constant load is in neither
//! S_h = mean of e_h² over the last pairs
//! ```
//! A pair counts if the levels disagree about it, and if some level leaves no load in the mean of both crossings: else tissue is
//! touched. Once S of the level nearest to the present one is far above the noise, and that of another far below it, the
//! observer goes over to that level, with its state.

use trocar_model::{Friction, Seal, SealState};

use super::adapt::{CELL, CELLS, CONTACT, LONGEST_AGE};

/// Levels side by side, evenly spaced in proportion.
const LEVELS: [f64; COUNT] = [0.18, 0.25, 0.35, 0.5, 0.71, 1.0, 1.41];
const COUNT: usize = 7;
/// Pairs in the mean.
const PAIRS: f64 = 12.0;
/// Range of F_h₊ − F_h₋ over the standard deviation of the model from which on a pair tells levels apart.
const TELLING: f64 = 12.0;
/// e_h over the standard deviation of the model that is too much.
const WRONG: f64 = 6.0;
/// Part of S that a better level leaves.
const BETTER: f64 = 0.25;

/// The mean of one crossing of one cell: reading and forces by level, N.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    cell: i64,
    time: f64,
    reading: f64,
    forces: [f64; COUNT],
}

/// A crossing under way.
#[derive(Debug, Clone, Copy)]
struct Current {
    cell: i64,
    inserts: bool,
    samples: f64,
    reading: f64,
    forces: [f64; COUNT],
}

/// The model at several levels.
#[derive(Debug, Clone)]
pub(super) struct Bank {
    states: [SealState; COUNT],
    sigma: f64,
    memory: Box<[[Option<Crossing>; CELLS]; 2]>,
    current: Option<Current>,
    /// S, N².
    scores: [f64; COUNT],
    pairs: f64,
    time: f64,
}

impl Bank {
    pub(super) fn new(seal: &Seal, sigma: f64) -> Self {
        Self {
            states: [seal.rest_at_force(0.0); COUNT],
            sigma,
            memory: Box::new([[None; CELLS]; 2]),
            current: None,
            scores: [0.0; COUNT],
            pairs: 0.0,
            time: 0.0,
        }
    }

    /// As new.
    pub(super) fn reset(&mut self, seal: &Seal) {
        self.start(seal, 0.0);
        self.time = 0.0;
    }

    /// All at rest with `force`, N.
    pub(super) fn start(&mut self, seal: &Seal, force: f64) {
        let states = LEVELS.map(|level| seal.rest_at_force(force / level));
        self.states = states;
        self.break_off();
    }

    /// Crossings of before are crossings of another motion.
    pub(super) fn break_off(&mut self) {
        self.current = None;
        self.memory.iter_mut().for_each(|side| side.fill(None));
        (self.scores, self.pairs) = ([0.0; COUNT], 0.0);
    }

    pub(super) fn advance(&mut self, seal: &Seal, displacement: f64, duration: f64) {
        for (state, level) in self.states.iter_mut().zip(LEVELS) {
            seal.step(state, displacement / level, duration);
        }
        self.time += duration;
    }

    /// Takes a reading (without offset, inertia and way, N) at `position`, m, on the way in or out.
    pub(super) fn take(&mut self, position: f64, inserts: bool, reading: f64) {
        let cell = (position / CELL).floor() as i64;
        if self.current.is_some_and(|current| (current.cell, current.inserts) != (cell, inserts)) {
            self.finish_crossing();
        }
        let fresh = Current { cell, inserts, samples: 0.0, reading: 0.0, forces: [0.0; COUNT] };
        let current = self.current.get_or_insert(fresh);
        current.samples += 1.0;
        current.reading += reading;
        for ((sum, state), level) in current.forces.iter_mut().zip(&self.states).zip(LEVELS) {
            *sum += level * Seal::force(state);
        }
    }

    fn finish_crossing(&mut self) {
        let Some(Current { cell, inserts, samples, reading, forces }) = self.current.take() else { return };
        let (reading, forces) = (reading / samples, forces.map(|sum| sum / samples));
        let now = Crossing { cell, time: self.time, reading, forces };
        let place = cell.rem_euclid(CELLS as i64) as usize;
        let across = self.memory[usize::from(!inserts)][place];
        if let Some(before) = across.filter(|b| b.cell == cell && self.time - b.time < LONGEST_AGE) {
            self.compare(&now, &before);
        }
        self.memory[usize::from(inserts)][place] = Some(now);
    }

    fn compare(&mut self, now: &Crossing, before: &Crossing) {
        let turns: [f64; COUNT] = core::array::from_fn(|h| now.forces[h] - before.forces[h]);
        let load = |h: usize| 0.5 * (now.reading + before.reading - now.forces[h] - before.forces[h]);
        let (low, high) = turns.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(*t), h.max(*t)));
        let is_free = (0..COUNT).any(|h| load(h).abs() < CONTACT * self.sigma);
        if high - low < TELLING * self.sigma || !is_free {
            return;
        }
        self.pairs = (self.pairs + 1.0).min(PAIRS);
        for (score, turn) in self.scores.iter_mut().zip(turns) {
            let error = now.reading - before.reading - turn;
            *score += (error * error - *score) / self.pairs;
        }
    }

    /// Variance of the force, N², by which the last pairs contradict the level `present` beyond the noise.
    pub(super) fn doubt(&self, present: f64) -> f64 {
        let noise = 2.0 * CONTACT * CONTACT * self.sigma * self.sigma;
        (0.25 * (self.scores[nearest(present)] - noise)).max(0.0)
    }

    /// A level that explains the last pairs where `present` does not, with its state; once.
    pub(super) fn better_than(&mut self, present: f64) -> Option<(f64, SealState)> {
        if self.pairs < PAIRS {
            return None;
        }
        let own = self.scores[nearest(present)];
        let best = (0..COUNT).min_by(|a, b| self.scores[*a].total_cmp(&self.scores[*b]))?;
        let wrong = WRONG * self.sigma;
        if own < wrong * wrong || self.scores[best] > BETTER * own {
            return None;
        }
        (self.scores, self.pairs) = ([0.0; COUNT], 0.0);
        Some((LEVELS[best], self.states[best]))
    }
}

/// The level of the bank nearest to `present`, in proportion.
fn nearest(present: f64) -> usize {
    let apart = |h: &usize| (LEVELS[*h] / present).ln().abs();
    (0..COUNT).min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(0)
}
