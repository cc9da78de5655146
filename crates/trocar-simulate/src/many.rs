//! Many models under one motion, or one model along whole arrays, with the widest vectors of the
//! processor and on all its cores.
//!
//! [`trocar_model::batch`] does the work. This module chooses at run time among machine codes for
//! the available vector instructions (on x86-64: SSE2, AVX2). All give the same bits, and so does
//! any number of threads. [`ensemble`] runs whole trocars with their position profiles, constructed
//! from columns of parameters.

pub mod ensemble;

use rayon::prelude::*;
use trocar_model::batch::{Batch, LANES, Lanes, Many, Observe, Squares, blocks};
use trocar_model::{Stages, Trocar, TrocarState};

/// Least number of models per task: several blocks, so that a task is worth its overhead.
const TASK: usize = 4 * LANES;

/// At most `most` of the draws `all`, evenly spaced, so that each chain has its share.
#[must_use]
pub fn evenly(all: &[Stages], most: usize) -> Vec<Stages> {
    let count = all.len().min(most);
    (0..count).map(|k| all[k * all.len() / count]).collect()
}

/// Code compiled once for each kind of processor.
trait Compiled {
    fn call(self);
}

/// Runs `code` in the version for this processor.
#[cfg(feature = "simd")]
fn dispatch(code: impl Compiled) {
    struct Run<C>(C);
    impl<C: Compiled> pulp::NullaryFnOnce for Run<C> {
        type Output = ();

        #[inline(always)]
        fn call(self) {
            self.0.call();
        }
    }
    pulp::Arch::new().dispatch(Run(code));
}

/// Runs `code`, which exists in one version only.
#[cfg(not(feature = "simd"))]
fn dispatch(code: impl Compiled) {
    code.call();
}

/// [`Batch::run`] on the current thread.
pub fn run<M: Many>(batch: &mut Batch<'_, M>, motion: &[(f64, f64)], observer: &mut impl Observe) {
    dispatch(Run { batch, motion, observer });
}

struct Run<'r, 'a, M: Many, O> {
    batch: &'r mut Batch<'a, M>,
    motion: &'r [(f64, f64)],
    observer: &'r mut O,
}

impl<M: Many, O: Observe> Compiled for Run<'_, '_, M, O> {
    #[inline(always)]
    fn call(self) {
        self.batch.run(self.motion.iter().copied(), self.observer);
    }
}

/// [`Trocar::run`]: one model along arrays of positions (m) and durations (s), on the current
/// thread.
pub fn along<K: AsRef<[f64]>>(
    trocar: &Trocar<K>,
    state: &mut TrocarState,
    positions: &[f64],
    durations: &[f64],
    forces: &mut [f64],
) {
    dispatch(Along { trocar: &trocar.borrowed(), state, positions, durations, forces });
}

struct Along<'r, 'a> {
    trocar: &'r Trocar<&'a [f64]>,
    state: &'r mut TrocarState,
    positions: &'r [f64],
    durations: &'r [f64],
    forces: &'r mut [f64],
}

impl Compiled for Along<'_, '_> {
    #[inline(always)]
    fn call(self) {
        self.trocar.run(self.state, self.positions, self.durations, self.forces);
    }
}

/// Σ(measured - F)², N², of each model along `motion` (displacement in m and duration in s of each
/// sample) against `measured` (N, after each sample), on all threads.
pub fn squares<M>(
    models: &[M],
    states: &[M::State],
    motion: &[(f64, f64)],
    measured: &[f64],
) -> Vec<f64>
where
    M: Many + Sync,
    M::State: Send + Sync,
{
    let mut sums = vec![0.0; models.len().min(states.len())];
    let tasks = models.par_chunks(TASK).zip(states.par_chunks(TASK)).zip(sums.par_chunks_mut(TASK));
    tasks.for_each(|((models, states), sums)| {
        alone(models, states, motion, &mut Squares::new(measured, sums))
    });
    sums
}

/// The force of each model after each sample, N: model i after sample k at `i * motion.len() + k`;
/// on all threads.
pub fn forces<M>(models: &[M], states: &[M::State], motion: &[(f64, f64)]) -> Vec<f64>
where
    M: Many + Sync,
    M::State: Send + Sync,
{
    let samples = motion.len();
    let mut forces = vec![0.0; models.len().min(states.len()) * samples];
    if samples > 0 {
        let tasks = models
            .par_chunks(TASK)
            .zip(states.par_chunks(TASK))
            .zip(forces.par_chunks_mut(TASK * samples));
        tasks.for_each(|((models, states), forces)| {
            alone(models, states, motion, &mut Traces { forces, samples, first: 0, count: 0 });
        });
    }
    forces
}

/// Runs a batch of `models` from copies of `states` along the whole motion.
fn alone<M: Many>(
    models: &[M],
    states: &[M::State],
    motion: &[(f64, f64)],
    observer: &mut impl Observe,
) {
    let mut states = states.to_vec();
    let mut places = vec![Lanes::EMPTY; blocks(models.len())];
    if let Some(mut batch) = Batch::new(models, &mut states, &mut places) {
        run(&mut batch, motion, observer);
        batch.finish();
    }
}

/// Writes the forces, model by model.
struct Traces<'a> {
    forces: &'a mut [f64],
    samples: usize,
    first: usize,
    count: usize,
}

impl Observe for Traces<'_> {
    fn begin(&mut self, first: usize, count: usize) {
        (self.first, self.count) = (first, count);
    }

    #[inline(always)]
    fn see(&mut self, sample: usize, lanes: &Lanes) {
        let own = self.forces.chunks_exact_mut(self.samples).skip(self.first).take(self.count);
        for (trace, force) in own.zip(lanes.forces()) {
            trace[sample] = *force;
        }
    }

    fn end(&mut self, _: usize, _: usize) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use trocar_model::{Element, ElementParams, SlidingFriction};

    /// Dry and viscous elements, and a few that no lane can run.
    fn elements() -> Vec<Element> {
        let plausible = ElementParams::plausible_10_5_mm().expect("made for it");
        (0..150)
            .map(|k: u32| {
                let viscous_damping = if k.is_multiple_of(3) { 0.0 } else { 0.2 * f64::from(k) };
                let insertion = SlidingFriction { viscous_damping, ..plausible.insertion };
                let creep_velocity = if k.is_multiple_of(17) { 1e-4 } else { 0.0 };
                Element::new(ElementParams { insertion, creep_velocity, ..plausible })
                    .expect("in range")
            })
            .collect()
    }

    #[test]
    fn wide_vectors_and_threads_give_the_bits_of_the_scalar_step() {
        let elements = elements();
        let states: Vec<_> = elements.iter().map(|element| element.rest_state(0.0)).collect();
        let motion: Vec<_> =
            (0..3000).map(|k| (4e-4 * f64::sin(f64::from(k) * 0.013), 1e-3)).collect();
        let forces = forces(&elements, &states, &motion);
        let measured: Vec<f64> = (0..3000).map(|k| f64::from(k % 7)).collect();
        let sums = squares(&elements, &states, &motion, &measured);
        for (i, (element, start)) in elements.iter().zip(&states).enumerate() {
            let (mut state, mut sum) = (*start, 0.0);
            for (k, (displacement, duration)) in motion.iter().enumerate() {
                let force = element.step(&mut state, *displacement, *duration);
                assert_eq!(
                    forces[i * motion.len() + k].to_bits(),
                    force.to_bits(),
                    "model {i}, sample {k}"
                );
                sum += (measured[k] - force) * (measured[k] - force);
            }
            assert_eq!(sums[i].to_bits(), f64::to_bits(sum), "model {i}");
        }
    }
}
