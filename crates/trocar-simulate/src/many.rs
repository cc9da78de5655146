//! Many models under one motion, or one model along whole arrays, with the widest vectors of the
//! processor and on all its cores.
//!
//! [`trocar_model::batch`] does the work. This module chooses at run time among machine codes for
//! the available vector instructions (on x86-64: SSE2, AVX2). All give the same bits, and so does
//! any number of threads. [`ensemble`] runs whole trocars with their position profiles, constructed
//! from columns of parameters.

pub mod ensemble;

use trocar_model::batch::{Batch, LANES, Many, Observe};
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

#[cfg(test)]
mod tests {
    use super::ensemble::{Ensemble, Motion, Start, forces, squared_errors};
    use trocar_model::{Element, ElementParams, ParamError, SlidingFriction, Trocar};

    struct Elements(Vec<Element>);

    impl Ensemble for Elements {
        fn count(&self) -> usize {
            self.0.len()
        }

        fn trocar(&self, index: usize) -> Result<Trocar<&[f64]>, ParamError> {
            Ok(Trocar::new(self.0[index], None))
        }
    }

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
        let elements = Elements(elements());
        let time: Vec<f64> = (0..3000).map(|k| 1e-3 * f64::from(k)).collect();
        let position: Vec<f64> = time.iter().map(|t| 0.03 * (1.0 - (13.0 * t).cos())).collect();
        let measured: Vec<f64> = (0..3000).map(|k| f64::from(k % 7)).collect();
        let motion = Motion::new(&time, &position);
        let mut all = vec![0.0; elements.count() * time.len()];
        forces(&elements, Start::Undeformed, &motion, &mut all).unwrap();
        let mut sums = vec![0.0; elements.count()];
        squared_errors(&elements, Start::Undeformed, &motion, &measured, &mut sums).unwrap();
        for (i, (element, forces)) in elements.0.iter().zip(all.chunks(time.len())).enumerate() {
            let (mut state, mut sum) = (element.rest_state(0.0), 0.0);
            for (k, expected) in forces.iter().enumerate() {
                if k > 0 {
                    let displacement = position[k] - position[k - 1];
                    element.step(&mut state, displacement, time[k] - time[k - 1]);
                }
                assert_eq!(expected.to_bits(), state.force().to_bits(), "model {i}, sample {k}");
                sum += (measured[k] - expected) * (measured[k] - expected);
            }
            assert_eq!(sums[i].to_bits(), f64::to_bits(sum), "model {i}");
        }
    }
}
