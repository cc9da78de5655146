//! Whether the readings have the sign of the model.
//!
//! When the motion reverses, so does the friction of a seal that slides, and the force of passive
//! tissue, elastic or viscous, changes in the same direction. So of the end of one slide and the
//! beginning of the next one, in the opposite direction,
//!
//! ```text
//! r = Δy/Δf          Δy change of the reading, Δf that of the model's force (λ = ν = 1), N
//! ```
//! is λ or more, and with the opposite sign of the readings -λ or less. Three reversals in
//! succession with r < -0.1 are a fault, which ends after three in succession with r > 0.1: λ is at
//! least 0.1.
//!
//! - **Limit**: a force that changes against the motion by more than the friction does, in three
//!   reversals in succession, such as that of a second instrument which pulls in time with it,
//!   cannot be distinguished from a reading of the opposite sign.

use trocar_model::Seal;

use super::saved::StateRow;

/// Reversals in succession that decide.
const ENOUGH: i32 = 3;
/// Least size of r that counts.
const LEAST_RATIO: f64 = 0.1;
/// Travel of a slide, m, before its mean counts, and the same as a fraction of the half width.
const SETTLED: f64 = 2e-3;
const SETTLED_PART: f64 = 0.5;
/// Weight of the newest sample in the mean.
const NEWEST: f64 = 0.0625;

/// Forces of a sample while the seal slides, N, without the position-dependent force.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slid {
    /// Reading without offset and inertia.
    pub(super) reading: f64,
    /// Model with λ = ν = 1.
    pub(super) model: f64,
}

/// Motion in one direction.
#[derive(Debug, Clone, Copy, Default)]
struct Slide {
    inserts: bool,
    from: f64,
    /// Over the last samples.
    mean: Slid,
}

/// Compares readings and model over reversals.
#[derive(Debug, Clone)]
pub(super) struct SignWatch {
    least_change: f64,
    settled: f64,
    slide: Option<Slide>,
    /// The last slide that was long enough.
    before: Option<Slide>,
    /// Reversals in succession with the sign of the model, or, negative, against it.
    run: i32,
    is_opposite: bool,
}

impl SignWatch {
    /// `least_change` of the model's force, N, from which a reversal counts.
    pub(super) fn new(seal: &Seal, least_change: f64) -> Self {
        let settled = SETTLED.max(SETTLED_PART * seal.half_width());
        Self { least_change, settled, slide: None, before: None, run: 0, is_opposite: false }
    }

    pub(super) fn reset(&mut self) {
        self.break_off();
        (self.run, self.is_opposite) = (0, false);
    }

    /// The motion was interrupted.
    pub(super) fn break_off(&mut self) {
        (self.slide, self.before) = (None, None);
    }

    /// Writes or reads all that changes.
    pub(super) fn exchange(&mut self, row: &mut StateRow) {
        for slide in [&mut self.slide, &mut self.before] {
            row.optional(slide, Slide::default(), |own, row| {
                row.flag(&mut own.inserts);
                let numbers = [&mut own.from, &mut own.mean.reading, &mut own.mean.model];
                numbers.into_iter().for_each(|number| row.number(number));
            });
        }
        let mut run = (self.run + ENOUGH) as u32;
        row.count(&mut run, 2 * ENOUGH as u64);
        self.run = run as i32 - ENOUGH;
        row.flag(&mut self.is_opposite);
    }

    pub(super) fn is_opposite(&self) -> bool {
        self.is_opposite
    }

    /// Distance of a slide, m, from which its mean counts.
    pub(super) fn settled(&self) -> f64 {
        self.settled
    }

    /// Adds a sample of a slide at `position`, m.
    pub(super) fn take(&mut self, position: f64, inserts: bool, now: Slid) {
        let fresh = Slide { inserts, from: position, mean: now };
        let mut slide = self.slide.filter(|slide| slide.inserts == inserts).unwrap_or(fresh);
        slide.mean.reading += NEWEST * (now.reading - slide.mean.reading);
        slide.mean.model += NEWEST * (now.model - slide.mean.model);
        self.slide = Some(slide);
        if (position - slide.from).abs() < self.settled {
            return;
        }
        if let Some(before) = self.before.filter(|before| before.inserts != inserts) {
            let change = slide.mean.model - before.mean.model;
            if change.abs() < self.least_change {
                return;
            }
            self.judge((slide.mean.reading - before.mean.reading) / change);
        }
        self.before = Some(slide);
    }

    fn judge(&mut self, ratio: f64) {
        if ratio > LEAST_RATIO {
            self.run = (self.run.max(0) + 1).min(ENOUGH);
        } else if ratio < -LEAST_RATIO {
            self.run = (self.run.min(0) - 1).max(-ENOUGH);
        } else {
            self.run = 0;
        }
        if self.run.abs() == ENOUGH {
            self.is_opposite = self.run < 0;
        }
    }
}
