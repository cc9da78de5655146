//! Many trocars along one motion: all their forces, or the squared error of each relative to a
//! recording.
//!
//! Trocars are constructed when needed ([`Ensemble`]): a hundred thousand draws of parameters need
//! the memory of a few dozen models. **Every force has the bits of [`Trocar::step_to`]**,
//! regardless of vectorisation and number of threads.
//!
//! Memory: 24 bytes for each sample of the motion, and for each thread some hundred kilobytes of
//! models.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use thiserror::Error;
use trocar_model::batch::{Batch, LANES, Lanes, Many, Observe, blocks};
use trocar_model::{
    Element, ParamError, PositionProfile, Seal, SealState, State, Trocar, TrocarState,
};

use super::{TASK, run};
use trocar_recording::cancel;

/// Samples between two checks for cancellation.
const PIECE: usize = 2048;

/// Samples buffered before they are written row by row. Writing 16 rows at once would address a
/// separate memory location for each, and for some numbers of samples all of them would share the
/// same cache set.
const TILE: usize = 32;

/// Trocars by index.
pub trait Ensemble: Sync {
    /// Number of trocars.
    fn count(&self) -> usize;

    /// Trocar `index`, from 0.
    ///
    /// # Errors
    /// [`ParamError`] for invalid parameters.
    fn trocar(&self, index: usize) -> Result<Trocar<&[f64]>, ParamError>;
}

/// One trocar with other parameters: for every adjusted parameter a column of values, one for each
/// member of the ensemble.
#[derive(Debug, Clone)]
pub struct Tuned<'a> {
    base: Trocar<&'a [f64]>,
    present: Vec<f64>,
    columns: Vec<(usize, &'a [f64])>,
    count: usize,
}

impl<'a> Tuned<'a> {
    /// `columns` by their index among [`Seal::tunables`]. There are as many trocars as the shortest
    /// column has values, and one without columns. `None` for an index beyond the tunables.
    pub fn new(base: Trocar<&'a [f64]>, columns: Vec<(usize, &'a [f64])>) -> Option<Self> {
        let present: Vec<f64> = base.seal().tunables().map(|tunable| tunable.value).collect();
        let count = columns.iter().map(|(_, values)| values.len()).min().unwrap_or(1);
        columns.iter().all(|(place, _)| *place < present.len()).then_some(Self {
            base,
            present,
            columns,
            count,
        })
    }

    /// The columns.
    pub fn columns(&self) -> &[(usize, &'a [f64])] {
        &self.columns
    }
}

impl Ensemble for Tuned<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn trocar(&self, index: usize) -> Result<Trocar<&[f64]>, ParamError> {
        let mut values = self.present.clone();
        for (place, column) in &self.columns {
            if let (Some(value), Some(new)) = (values.get_mut(*place), column.get(index)) {
                *value = *new;
            }
        }
        Ok(self.base.with_seal(self.base.seal().tuned(&values)?))
    }
}

/// Initial state of every seal: at rest at the first sample.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Start {
    /// Undeformed.
    #[default]
    Undeformed,
    /// With this force, N ([`Trocar::rest_at_force`]).
    Force(f64),
    /// With this deflection, m ([`Trocar::rest_at_deflection`]).
    Deflection(f64),
}

impl Start {
    /// `trocar` at `position`, m; `None` for a deflection of a classical model.
    pub fn state<K: AsRef<[f64]>>(self, trocar: &Trocar<K>, position: f64) -> Option<TrocarState> {
        match self {
            Self::Undeformed => Some(trocar.rest(position)),
            Self::Force(force) => Some(trocar.rest_at_force(position, force)),
            Self::Deflection(deflection) => trocar.rest_at_deflection(position, deflection),
        }
    }
}

/// Why an ensemble cannot be run.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum Refusal {
    /// Invalid parameters.
    #[error("model {index}: {why}")]
    Parameter {
        /// Index of the model, from 0.
        index: usize,
        /// The problem.
        why: ParamError,
    },
    /// An initial deflection was requested for a classical model.
    #[error("model {index} is a classical one, which has no deflection to start with")]
    NoDeflection {
        /// Index of the model, from 0.
        index: usize,
    },
}

impl Refusal {
    /// Index of the model, from 0.
    pub fn index(&self) -> usize {
        match self {
            Self::Parameter { index, .. } | Self::NoDeflection { index } => *index,
        }
    }
}

/// A motion as [`Trocar::step_to`] follows it from sample to sample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Motion {
    /// Position of the instrument at each sample, m.
    position: Vec<f64>,
    /// Displacement (m) and duration (s) to each sample except the first.
    steps: Vec<(f64, f64)>,
}

impl Motion {
    /// Samples at `time` (s) and `position` (m), up to the shorter length. The first is the start.
    /// A sample that no model can follow (the time does not increase, or a value is not finite) has
    /// no effect.
    pub fn new(time: &[f64], position: &[f64]) -> Self {
        let start = position.first().copied().filter(|x| x.is_finite()).unwrap_or(0.0);
        let mut now = (time.first().copied().unwrap_or(0.0), start);
        let samples = time.len().min(position.len());
        let mut motion =
            Self { position: Vec::with_capacity(samples), steps: Vec::with_capacity(samples) };
        motion.position.extend((samples > 0).then_some(start));
        for (&t, &x) in time.iter().zip(position).skip(1) {
            let (duration, displacement) = (t - now.0, x - now.1);
            let velocity = displacement / duration;
            let follows = duration > 0.0 && duration.is_finite() && velocity.is_finite();
            now = (t, if follows { x } else { now.1 });
            motion.position.push(now.1);
            motion.steps.push((displacement, duration));
        }
        motion
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.position.len()
    }
}

/// Writes the force of each trocar at each sample of `motion` into `forces`, N: trocar i at sample
/// k at `i * motion.samples() + k`; on all threads. Excess values are omitted.
///
/// # Errors
/// [`Refusal`] of the first trocar that cannot be run; those of others may have been written
/// already.
pub fn forces(
    ensemble: &impl Ensemble,
    start: Start,
    motion: &Motion,
    forces: &mut [f64],
) -> Result<(), Refusal> {
    let samples = motion.samples();
    if samples == 0 {
        return Ok(());
    }
    each_part(ensemble, start, motion, samples, forces, |part, rows| {
        for (row, force) in rows.chunks_exact_mut(samples).zip(&part.at_start) {
            row[0] = *force;
        }
        part.run(motion, Rows::new(rows, samples));
    })
}

/// Writes Σ(`measured` - F)², N², over the samples of `motion` that have a finite reading (N),
/// including the first, for each trocar into `sums`; on all threads. Excess values are omitted.
///
/// # Errors
/// [`Refusal`] of the first trocar that cannot be run; those of others may have been written
/// already.
pub fn squared_errors(
    ensemble: &impl Ensemble,
    start: Start,
    motion: &Motion,
    measured: &[f64],
    sums: &mut [f64],
) -> Result<(), Refusal> {
    each_part(ensemble, start, motion, 1, sums, |part, sums| {
        let first = measured.first().filter(|reading| reading.is_finite());
        for (sum, force) in sums.iter_mut().zip(&part.at_start) {
            *sum = first.map_or(0.0, |reading| (reading - force) * (reading - force));
        }
        part.run(motion, Sums { measured, sums, own: [0.0; LANES], from: 0 });
    })
}

/// Applies `work` to parts of the ensemble, each with its part of `places`, `width` per trocar;
/// returns the first refusal in the order of the ensemble.
fn each_part<E: Ensemble>(
    ensemble: &E,
    start: Start,
    motion: &Motion,
    width: usize,
    places: &mut [f64],
    work: impl Fn(TaskTrocars, &mut [f64]) + Sync,
) -> Result<(), Refusal> {
    let at = motion.position.first().copied().unwrap_or(0.0);
    let count = ensemble.count().min(places.len() / width);
    let task = task(count);
    let first_refused = AtomicUsize::new(usize::MAX);
    let parts = places[..count * width].par_chunks_mut(task * width).enumerate();
    let refused = parts
        .filter_map(|(k, places)| {
            // Saves work only: parts before the first refusal must run, or the answer would depend on
            // the threads.
            if cancel::is_requested() || k > first_refused.load(Ordering::Relaxed) {
                return None;
            }
            match TaskTrocars::of(ensemble, k * task..count.min((k + 1) * task), start, at) {
                Ok(part) => {
                    work(part, places);
                    None
                }
                Err(refusal) => {
                    first_refused.fetch_min(k, Ordering::Relaxed);
                    Some(refusal)
                }
            }
        })
        .min_by_key(|refusal| refusal.index());
    cancel::check();
    refused.map_or(Ok(()), Err)
}

/// Trocars of one task. A small number is spread over the threads: stepping them one by one on a
/// core is no slower than using a mostly empty vector.
fn task(count: usize) -> usize {
    let each = count.div_ceil(rayon::current_num_threads().max(1)).min(TASK);
    if each > LANES { each.next_multiple_of(LANES) } else { each.max(1) }
}

type Profile<'a> = PositionProfile<&'a [f64]>;

/// The trocars of a task at the start of the motion.
struct TaskTrocars<'a> {
    seals: Vec<Seal>,
    states: Vec<SealState>,
    profiles: Vec<Option<Profile<'a>>>,
    at_start: Vec<f64>,
}

impl<'a> TaskTrocars<'a> {
    fn of(
        ensemble: &'a impl Ensemble,
        indices: Range<usize>,
        start: Start,
        at: f64,
    ) -> Result<Self, Refusal> {
        let mut part = Self {
            seals: Vec::new(),
            states: Vec::new(),
            profiles: Vec::new(),
            at_start: Vec::new(),
        };
        for index in indices {
            let trocar = ensemble.trocar(index).map_err(|why| Refusal::Parameter { index, why })?;
            let state = start.state(&trocar, at).ok_or(Refusal::NoDeflection { index })?;
            part.seals.push(*trocar.seal());
            part.states.push(*state.seal());
            part.profiles.push(trocar.profile().copied());
            part.at_start.push(state.force());
        }
        Ok(part)
    }

    /// Runs along the whole motion.
    fn run(mut self, motion: &Motion, sink: impl Sink) {
        let singles: Option<Vec<(Element, State)>> = self
            .seals
            .iter()
            .zip(&self.states)
            .map(|(seal, state)| seal.single(state).map(|(element, state)| (*element, *state)))
            .collect();
        match singles {
            // A quarter of the memory of seals, which may have four elements.
            Some(singles) => {
                let (elements, mut states): (Vec<_>, Vec<_>) = singles.into_iter().unzip();
                along(&elements, &mut states, &self.profiles, motion, sink);
            }
            None => along(&self.seals, &mut self.states, &self.profiles, motion, sink),
        }
    }
}

fn along<M: Many>(
    models: &[M],
    states: &mut [M::State],
    profiles: &[Option<Profile<'_>>],
    motion: &Motion,
    sink: impl Sink,
) {
    let mut places = vec![Lanes::EMPTY; blocks(models.len())];
    let Some(mut batch) = Batch::new(models, states, &mut places) else { return };
    let mut observer = Along { profiles, shared: Shared::None, position: &[], sink };
    for (k, steps) in motion.steps.chunks(PIECE).enumerate() {
        cancel::check();
        let from = 1 + k * PIECE;
        observer.position = &motion.position[from..];
        observer.sink.go_on(from);
        run(&mut batch, steps, &mut observer);
    }
}

/// Destination of the forces of a block.
trait Sink {
    /// The next sample is number `sample` of the motion.
    fn go_on(&mut self, sample: usize);

    /// A block of `count` trocars from `first` follows.
    fn begin(&mut self, first: usize, count: usize);

    /// Its forces at `sample`, counted from [`Sink::go_on`].
    fn take(&mut self, sample: usize, forces: &[f64; LANES]);

    /// The block has reached the end of the piece.
    fn end(&mut self, first: usize, count: usize);
}

/// Converts the forces of the seals to those of the trocars.
struct Along<'a, S> {
    profiles: &'a [Option<Profile<'a>>],
    shared: Shared<'a>,
    /// Position after each step of the piece, m.
    position: &'a [f64],
    sink: S,
}

/// Dependence of the forces of a block on the position.
enum Shared<'a> {
    None,
    One(Profile<'a>),
    Own(&'a [Option<Profile<'a>>]),
}

impl<'a> Shared<'a> {
    fn of(profiles: &'a [Option<Profile<'a>>]) -> Self {
        let first = profiles.first().copied().flatten();
        match (profiles.iter().all(|profile| *profile == first), first) {
            (true, None) => Self::None,
            (true, Some(profile)) => Self::One(profile),
            (false, _) => Self::Own(profiles),
        }
    }

    /// [`PositionProfile::apply`] for each lane.
    #[inline(always)]
    fn apply(&self, position: f64, forces: &mut [f64; LANES]) {
        match self {
            Self::None => {}
            Self::One(profile) => {
                let (offset, gain) = (profile.offset(position), profile.gain(position));
                for force in forces {
                    *force = offset + gain * *force;
                }
            }
            Self::Own(profiles) => {
                for (force, profile) in forces.iter_mut().zip(*profiles) {
                    *force = profile.map_or(*force, |profile| profile.apply(position, *force));
                }
            }
        }
    }
}

impl<S: Sink> Observe for Along<'_, S> {
    fn begin(&mut self, first: usize, count: usize) {
        self.shared = Shared::of(&self.profiles[first..first + count]);
        self.sink.begin(first, count);
    }

    #[inline(always)]
    fn see(&mut self, sample: usize, lanes: &Lanes) {
        let mut forces = *lanes.forces();
        self.shared.apply(self.position[sample], &mut forces);
        self.sink.take(sample, &forces);
    }

    fn end(&mut self, first: usize, count: usize) {
        self.sink.end(first, count);
    }
}

/// Writes the forces, one row per trocar.
struct Rows<'a> {
    rows: &'a mut [f64],
    samples: usize,
    tile: [[f64; LANES]; TILE],
    /// Samples in the tile.
    waiting: usize,
    /// Index of the first of these, and of the first of the piece.
    from: usize,
    piece: usize,
    first: usize,
    count: usize,
}

impl<'a> Rows<'a> {
    fn new(rows: &'a mut [f64], samples: usize) -> Self {
        Self {
            rows,
            samples,
            tile: [[0.0; LANES]; TILE],
            waiting: 0,
            from: 0,
            piece: 0,
            first: 0,
            count: 0,
        }
    }

    #[inline(always)]
    fn write(&mut self) {
        let rows = self.rows.chunks_exact_mut(self.samples).skip(self.first).take(self.count);
        for (lane, row) in rows.enumerate() {
            for (place, forces) in row[self.from..].iter_mut().zip(&self.tile[..self.waiting]) {
                *place = forces[lane % LANES];
            }
        }
        self.from += self.waiting;
        self.waiting = 0;
    }
}

impl Sink for Rows<'_> {
    fn go_on(&mut self, sample: usize) {
        self.piece = sample;
    }

    fn begin(&mut self, first: usize, count: usize) {
        (self.first, self.count, self.from) = (first, count, self.piece);
    }

    #[inline(always)]
    fn take(&mut self, _: usize, forces: &[f64; LANES]) {
        self.tile[self.waiting] = *forces;
        self.waiting += 1;
        if self.waiting == TILE {
            self.write();
        }
    }

    fn end(&mut self, _: usize, _: usize) {
        self.write();
    }
}

/// Sums the squared errors.
struct Sums<'a> {
    measured: &'a [f64],
    sums: &'a mut [f64],
    own: [f64; LANES],
    from: usize,
}

impl Sink for Sums<'_> {
    fn go_on(&mut self, sample: usize) {
        self.from = sample;
    }

    fn begin(&mut self, first: usize, count: usize) {
        self.own[..count].copy_from_slice(&self.sums[first..first + count]);
    }

    #[inline(always)]
    fn take(&mut self, sample: usize, forces: &[f64; LANES]) {
        if let Some(reading) = self.measured.get(self.from + sample)
            && reading.is_finite()
        {
            for (sum, force) in self.own.iter_mut().zip(forces) {
                *sum += (reading - force) * (reading - force);
            }
        }
    }

    fn end(&mut self, first: usize, count: usize) {
        self.sums[first..first + count].copy_from_slice(&self.own[..count]);
    }
}
