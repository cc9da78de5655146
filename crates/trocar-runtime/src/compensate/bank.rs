//! Tests whether another friction scale explains the readings better than the present one.
//!
//! The filter of [`super::adapt`] uses sliding samples only, and after a sudden lubrication the
//! seal may slide all the time while the model still predicts deformation. The model is therefore
//! also run at several friction scales in parallel, each with its own state. Whenever a cell of the
//! position is crossed in the direction opposite to its last crossing, deforming or sliding, the
//! bank determines the scale whose force would have reversed as the reading did, and the load that
//! it leaves:
//!
//! ```text
//! y₊ − y₋ = F_h₊ − F_h₋              h between two levels       an elastic tissue or a constant load is in neither
//! load    = (y₊ + y₋ − F_h₊ − F_h₋)/2
//! ```
//! The observer switches to the scale h only if 20 of the last 24 pairs, from at least three
//! strokes, agree about it and leave little load. A varying tissue force makes them disagree.

use trocar_model::{Trocar, TrocarState};

use super::adapt::{CELL, CELLS, CONTACT, LONGEST_AGE};
use super::move_by;
use super::saved::StateRow;

/// Friction scales run in parallel, evenly spaced on a logarithmic scale.
const LEVELS: [f64; COUNT] = [0.18, 0.25, 0.35, 0.5, 0.71, 1.0, 1.41];
const COUNT: usize = 7;
/// Pairs considered, the number of them that may disagree, and the fewest strokes that they come
/// from.
const PAIRS: usize = 24;
const MOST_APART: usize = 4;
const STROKES: u64 = 3;
/// Pairs used for the doubt: those after a change within 3 mm of travel, and those affected by it
/// afterwards.
const NEWEST: usize = 3;
const RECENT: usize = 12;
/// Most direction changes counted in a saved state: all that a number holds exactly.
const MOST_STROKES: u64 = 1 << 53;
/// Ratio of a pair's error to that explained by the model's error in both crossings, below which
/// there is no doubt.
const NOISE: f64 = 2.0;
/// Ratio of the range of F_h₊ − F_h₋ to the standard deviation of the model above which a pair
/// distinguishes scales.
const TELLING: f64 = 12.0;
/// Largest relative deviation from the median scale that counts as agreement; and the least
/// relative change for a switch.
const APART: f64 = 0.12;
const WORTH: f64 = 0.2;

/// The mean over one crossing of one cell: reading and forces by friction scale, N; variance of the
/// model's error, N².
#[derive(Debug, Clone, Copy, Default)]
struct Crossing {
    cell: i64,
    time: f64,
    reading: f64,
    variance: f64,
    forces: [f64; COUNT],
}

/// A crossing in progress.
#[derive(Debug, Clone, Copy, Default)]
struct Current {
    cell: i64,
    inserts: bool,
    samples: f64,
    reading: f64,
    variance: f64,
    forces: [f64; COUNT],
}

/// Result of one pair.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    /// Friction scale at which the force reverses as the reading did; NaN outside those tried.
    level: f64,
    /// Mean load that remains at that scale, N.
    load: f64,
    /// y₊ − y₋ and F_h₊ − F_h₋, N.
    turn: f64,
    turns: [f64; COUNT],
    /// Variance of `turn` due to the model's error in both crossings, N².
    variance: f64,
    stroke: u64,
}

/// The model at several friction scales.
#[derive(Debug, Clone)]
pub(super) struct Bank {
    states: [TrocarState; COUNT],
    sigma: f64,
    memory: Box<[[Option<Crossing>; CELLS]; 2]>,
    current: Option<Current>,
    /// Ring buffer.
    pairs: [Option<Pair>; PAIRS],
    next: usize,
    /// Number of direction changes between pairs.
    stroke: u64,
    inserted: bool,
    time: f64,
}

impl Bank {
    pub(super) fn new(model: &Trocar, sigma: f64) -> Self {
        Self {
            states: [model.rest_at_force(0.0, 0.0); COUNT],
            sigma,
            memory: Box::new([[None; CELLS]; 2]),
            current: None,
            pairs: [None; PAIRS],
            next: 0,
            stroke: 0,
            inserted: false,
            time: 0.0,
        }
    }

    /// Resets the bank.
    pub(super) fn reset(&mut self, model: &Trocar) {
        self.start(model, 0.0);
        (self.time, self.stroke, self.inserted) = (0.0, 0, false);
    }

    /// All models at rest with `force`, N.
    pub(super) fn start(&mut self, model: &Trocar, force: f64) {
        let states = LEVELS.map(|level| model.rest_at_force(0.0, force / level));
        self.states = states;
        self.break_off();
    }

    /// Earlier crossings belong to another motion.
    pub(super) fn break_off(&mut self) {
        self.current = None;
        self.memory.iter_mut().for_each(|side| side.fill(None));
        self.forget_pairs();
    }

    /// Writes or reads all that changes.
    pub(super) fn exchange(&mut self, model: &Trocar, row: &mut StateRow) {
        self.states.iter_mut().for_each(|state| row.state(model, state));
        for crossing in self.memory.iter_mut().flatten() {
            row.optional(crossing, Crossing::default(), |own, row| {
                row.cell(&mut own.cell);
                let numbers = [&mut own.time, &mut own.reading, &mut own.variance];
                numbers.into_iter().for_each(|number| row.number(number));
                row.numbers(&mut own.forces);
            });
        }
        row.optional(&mut self.current, Current::default(), |own, row| {
            row.cell(&mut own.cell);
            row.flag(&mut own.inserts);
            let numbers = [&mut own.samples, &mut own.reading, &mut own.variance];
            numbers.into_iter().for_each(|number| row.number(number));
            row.numbers(&mut own.forces);
        });
        for pair in &mut self.pairs {
            row.optional(pair, Pair::default(), |own, row| {
                let numbers = [&mut own.level, &mut own.load, &mut own.turn, &mut own.variance];
                numbers.into_iter().for_each(|number| row.number(number));
                row.numbers(&mut own.turns);
                row.count(&mut own.stroke, MOST_STROKES);
            });
        }
        row.count(&mut self.next, PAIRS as u64 - 1);
        row.count(&mut self.stroke, MOST_STROKES);
        row.flag(&mut self.inserted);
        row.number(&mut self.time);
    }

    fn forget_pairs(&mut self) {
        (self.pairs, self.next) = ([None; PAIRS], 0);
    }

    /// Moves by a displacement, m, and an angle, rad.
    pub(super) fn advance(&mut self, model: &Trocar, motion: [f64; 2], duration: f64) {
        for (state, level) in self.states.iter_mut().zip(LEVELS) {
            move_by(model, state, motion.map(|part| part / level), duration);
        }
        self.time += duration;
    }

    /// Adds a reading (without offset, inertia, position-dependent force and the increase of the
    /// viscous part, N) at `position`, m, during insertion or withdrawal; the model's error there
    /// has `variance`, N².
    pub(super) fn take(&mut self, position: f64, inserts: bool, reading: f64, variance: f64) {
        let cell = (position / CELL).floor() as i64;
        if self.current.is_some_and(|current| (current.cell, current.inserts) != (cell, inserts)) {
            self.finish_crossing();
        }
        let fresh = Current {
            cell,
            inserts,
            samples: 0.0,
            reading: 0.0,
            variance: 0.0,
            forces: [0.0; COUNT],
        };
        let current = self.current.get_or_insert(fresh);
        current.samples += 1.0;
        current.reading += reading;
        current.variance += variance;
        for ((sum, state), level) in current.forces.iter_mut().zip(&self.states).zip(LEVELS) {
            *sum += level * state.force();
        }
    }

    fn finish_crossing(&mut self) {
        let Some(Current { cell, inserts, samples, reading, variance, forces }) =
            self.current.take()
        else {
            return;
        };
        let (reading, variance) = (reading / samples, variance / samples);
        let forces = forces.map(|sum| sum / samples);
        let now = Crossing { cell, time: self.time, reading, variance, forces };
        let place = cell.rem_euclid(CELLS as i64) as usize;
        let across = self.memory[usize::from(!inserts)][place];
        if let Some(before) = across.filter(|b| b.cell == cell && self.time - b.time < LONGEST_AGE)
        {
            self.compare(&now, &before, inserts);
        }
        self.memory[usize::from(inserts)][place] = Some(now);
    }

    fn compare(&mut self, now: &Crossing, before: &Crossing, inserts: bool) {
        let turns: [f64; COUNT] = core::array::from_fn(|h| now.forces[h] - before.forces[h]);
        let (low, high) = turns
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(*t), h.max(*t)));
        if high - low < TELLING * self.sigma {
            return;
        }
        self.stroke += u64::from(inserts != self.inserted);
        self.inserted = inserts;
        let turn = now.reading - before.reading;
        let load =
            |h: usize| 0.5 * (now.reading + before.reading - now.forces[h] - before.forces[h]);
        let between = (0..COUNT - 1).find(|h| (turns[*h] - turn) * (turns[h + 1] - turn) <= 0.0);
        let (level, load) = match between {
            Some(h) => {
                let span = turns[h + 1] - turns[h];
                let part = if span == 0.0 { 0.0 } else { (turn - turns[h]) / span };
                (
                    LEVELS[h] + part * (LEVELS[h + 1] - LEVELS[h]),
                    load(h) + part * (load(h + 1) - load(h)),
                )
            }
            None => (f64::NAN, f64::NAN),
        };
        self.pairs[self.next] = Some(Pair {
            level,
            load,
            turn,
            turns,
            variance: now.variance + before.variance,
            stroke: self.stroke,
        });
        self.next = (self.next + 1) % PAIRS;
    }

    /// Variance of the force, N², by which the last pairs contradict the scale `present` beyond the
    /// noise. A change may lie between the two crossings of a pair, so its whole error may belong
    /// to the later one.
    pub(super) fn doubt(&self, present: f64) -> f64 {
        let (h, part) = place(present);
        let beyond = |pair: Pair| {
            let error = pair.turn - pair.turns[h] - part * (pair.turns[h + 1] - pair.turns[h]);
            error * error - NOISE * NOISE * pair.variance
        };
        let over = |number: usize| {
            let last =
                (1..=number).filter_map(|back| self.pairs[(self.next + PAIRS - back) % PAIRS]);
            let (squares, count) =
                last.fold((0.0, 0.0), |(s, n), pair| (s + beyond(pair), n + 1.0));
            if count > 0.0 { squares / count } else { 0.0 }
        };
        over(RECENT).max(over(NEWEST)).max(0.0)
    }

    /// A friction scale on which the last pairs agree and that differs from `present`, with the
    /// nearest state of the bank; returned once.
    pub(super) fn better_than(&mut self, present: f64) -> Option<(f64, TrocarState)> {
        let mut levels = [0.0; PAIRS];
        for (level, pair) in levels.iter_mut().zip(&self.pairs) {
            *level = pair.as_ref()?.level;
        }
        levels.sort_by(f64::total_cmp);
        let middle = levels[PAIRS / 2];
        let change = (middle / present).ln().abs();
        if change.is_nan() || change <= WORTH {
            return None;
        }
        let pairs = self.pairs.iter().flatten();
        let agrees = |pair: &&Pair| {
            (pair.level / middle).ln().abs() < APART
                && pair.load.abs() < CONTACT * self.sigma + APART * pair.turn.abs()
        };
        let first = pairs.clone().map(|pair| pair.stroke).min()?;
        let last = pairs.clone().map(|pair| pair.stroke).max()?;
        if pairs.filter(agrees).count() + MOST_APART < PAIRS || last - first + 1 < STROKES {
            return None;
        }
        self.forget_pairs();
        let (h, part) = place(middle);
        Some((middle, self.states[if part < 0.5 { h } else { h + 1 }]))
    }
}

/// Index of the scale of the bank below `level`, and the fraction of the distance to the next.
fn place(level: f64) -> (usize, f64) {
    let h = LEVELS.iter().rposition(|below| *below <= level).unwrap_or(0).min(COUNT - 2);
    (h, (level - LEVELS[h]) / (LEVELS[h + 1] - LEVELS[h]))
}
