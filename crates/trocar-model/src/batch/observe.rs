//! What the forces of a batch are wanted for.

use super::lanes::{LANES, Lanes};

/// Sees a batch run, block after block: one block through the whole motion, then the next.
pub trait Observe {
    /// A block begins: `count` models (at most [`LANES`]) from number `first` on.
    fn begin(&mut self, first: usize, count: usize);

    /// The block after `sample`, counted from 0. Make it `#[inline(always)]`.
    fn see(&mut self, sample: usize, lanes: &Lanes);

    /// The block is through.
    fn end(&mut self, first: usize, count: usize);
}

/// Writes all forces: model i after sample k at `forces[k * models + i]`, N. What does not fit is
/// left out.
#[derive(Debug)]
pub struct Forces<'a> {
    forces: &'a mut [f64],
    models: usize,
    first: usize,
    count: usize,
}

impl<'a> Forces<'a> {
    /// For a batch of `models`; `forces` holds a multiple of it.
    pub fn new(models: usize, forces: &'a mut [f64]) -> Self {
        Self { forces, models, first: 0, count: 0 }
    }
}

impl Observe for Forces<'_> {
    fn begin(&mut self, first: usize, count: usize) {
        (self.first, self.count) = (first, count);
    }

    #[inline(always)]
    fn see(&mut self, sample: usize, lanes: &Lanes) {
        let from = sample * self.models + self.first;
        if let Some(places) = self.forces.get_mut(from..from + self.count) {
            places.iter_mut().zip(lanes.forces()).for_each(|(place, force)| *place = *force);
        }
    }

    fn end(&mut self, _: usize, _: usize) {}
}

/// Sums up (measured - F)² for each model: what a fit or a sweep wants of a whole recording.
#[derive(Debug)]
pub struct Squares<'a> {
    measured: &'a [f64],
    sums: &'a mut [f64],
    own: [f64; LANES],
}

impl<'a> Squares<'a> {
    /// Against the forces `measured` (N) after each sample, missing ones left out, into `sums`, N²,
    /// one for each model.
    pub fn new(measured: &'a [f64], sums: &'a mut [f64]) -> Self {
        Self { measured, sums, own: [0.0; LANES] }
    }
}

impl Observe for Squares<'_> {
    fn begin(&mut self, _: usize, _: usize) {
        self.own = [0.0; LANES];
    }

    #[inline(always)]
    fn see(&mut self, sample: usize, lanes: &Lanes) {
        if let Some(measured) = self.measured.get(sample) {
            for (sum, force) in self.own.iter_mut().zip(lanes.forces()) {
                let error = measured - force;
                *sum += error * error;
            }
        }
    }

    fn end(&mut self, first: usize, count: usize) {
        self.sums
            .iter_mut()
            .skip(first)
            .zip(self.own)
            .take(count)
            .for_each(|(place, sum)| *place = sum);
    }
}
