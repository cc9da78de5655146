//! Online estimation of the friction scale and the viscosity.
//!
//! A force sensor outside the body cannot separate friction from tissue force in a single sample.
//! It can do so over a cycle (one stroke each way): at the same position x the friction reverses
//! with the motion, whereas an elastic tissue force, a constant load or a weight does not. The
//! track is therefore divided into cells of 1 mm. Whenever a cell is crossed in the direction
//! opposite to its last crossing, both times while sliding, the pair gives
//!
//! ```text
//! y₊ − y₋     = λ·(f₊ − f₋) + ν·(b₊ − b₋) + noise          reverses: friction, used for the update
//! (y₊ + y₋)/2 = [λ·(f₊ + f₋) + ν·(b₊ + b₋)]/2 + load       does not: tissue, if above 3 σ
//! ```
//! y reading, f and b the model's sliding force without its viscous part and its viscous part alone
//! (for λ = ν = 1), N. An update needs three successive crossings, there, back and there again, of
//! which the first and the last agree: a tissue force that appeared or changed between them is not
//! friction. A pair with load is not used, nor is any pair for some seconds after it.
//!
//! λ and ν are the states of a Kalman filter (key KALMAN) whose prior is the identified model:
//!
//! ```text
//! θ⁺ = θ + w     var w = q·Δt     P bounded by the prior (forgetting at a bounded rate)
//! ```
//!
//! - **Bounds**: λ in [0.1, 2], ν in [0, 4].
//! - **Outliers**: an innovation beyond 3 standard deviations is discarded. Eight in a row without
//!   load indicate a change of the friction, and the prior is widened. A change after which there
//!   are no more slides is detected by [`super::bank`].
//! - **Memory** is fixed: 512 cells for each direction; the oldest are overwritten.
//! - **Limit**: a tissue force that reverses with the motion and has the same magnitude in both
//!   directions is attributed to friction.

use super::saved::StateRow;

/// Length of a cell, m.
pub(super) const CELL: f64 = 1e-3;
/// Number of cells stored.
pub(super) const CELLS: usize = 512;
/// Longest time between the crossings of a pair, s.
pub(super) const LONGEST_AGE: f64 = 20.0;
/// Time after the last pair used for an update during which λ and ν count as being tracked, s.
const EXCITED: f64 = 5.0;
/// Errors of the model are correlated over the position: this many neighbouring pairs count as one.
const CORRELATED: f64 = 32.0;
/// Ratio of the load to its standard deviation above which tissue contact is detected.
pub(super) const CONTACT: f64 = 3.0;
/// Time after a load during which there are no updates, s.
const LATCH: f64 = 4.0;
/// Ratio of the innovation to its standard deviation above which it is an outlier.
const OUTLIER: f64 = 3.0;
/// Successive outliers that indicate a change.
const CHANGE: u32 = 8;
/// Standard deviations of the prior: wetting lowers friction by 15 to 45 %.
const PRIOR: [f64; 2] = [0.15, 0.3];
/// The same after a change was detected: silicone oil lowers friction by 75 %.
const OPENED: [f64; 2] = [0.5, 0.5];
/// Growth of the standard deviations per second.
const GROWTH: [f64; 2] = [0.0015, 0.01];
/// Bounds of λ and ν.
const BOUNDS: [[f64; 2]; 2] = [[0.1, 2.0], [0.0, 4.0]];
/// Sliding travel, as a fraction of the deformation range, after which sliding is certain.
const SETTLED: f64 = 0.25;

/// Current estimate of friction scale and viscosity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// λ: friction relative to that of the model, without the viscous part.
    pub level: f64,
    /// ν: viscous part relative to that of the model.
    pub viscosity: f64,
    /// Standard deviation of λ.
    pub level_std: f64,
    /// Standard deviation of ν.
    pub viscosity_std: f64,
}

/// One sample while sliding, all in N and without the position-dependent force.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sliding {
    /// Reading without offset, inertia and position-dependent force.
    pub(super) reading: f64,
    /// f: force of the model without its viscous part.
    pub(super) dry: f64,
    /// b: its viscous part.
    pub(super) viscous: f64,
}

impl Sliding {
    fn plus(self, other: Self) -> Self {
        Self {
            reading: self.reading + other.reading,
            dry: self.dry + other.dry,
            viscous: self.viscous + other.viscous,
        }
    }

    fn times(self, factor: f64) -> Self {
        Self {
            reading: factor * self.reading,
            dry: factor * self.dry,
            viscous: factor * self.viscous,
        }
    }

    fn exchange(&mut self, row: &mut StateRow) {
        let Self { reading, dry, viscous } = self;
        [reading, dry, viscous].into_iter().for_each(|value| row.number(value));
    }
}

/// The mean over one crossing of one cell.
#[derive(Debug, Clone, Copy, Default)]
struct Crossing {
    cell: i64,
    time: f64,
    mean: Sliding,
}

/// A crossing in progress.
#[derive(Debug, Clone, Copy, Default)]
struct Current {
    cell: i64,
    inserts: bool,
    sum: Sliding,
    samples: f64,
}

/// Start of a slide.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Slide {
    from: f64,
    inserts: bool,
}

#[derive(Debug, Clone)]
pub(super) struct Adapter {
    is_on: bool,
    /// Variances of λ and ν at the start.
    prior: [f64; 2],
    /// λ and ν.
    estimate: [f64; 2],
    /// P.
    covariance: [[f64; 2]; 2],
    /// Error of the model while sliding, N.
    sigma: f64,
    /// Last crossing by direction (withdrawal, insertion) and cell.
    memory: Box<[[Option<Crossing>; CELLS]; 2]>,
    current: Option<Current>,
    slide: Option<Slide>,
    time: f64,
    learnt: f64,
    contact: bool,
    /// Time at which the last load was detected, s.
    loaded: f64,
    outliers: u32,
}

impl Adapter {
    /// `spread` holds the relative standard deviations of Coulomb force and viscous damping.
    pub(super) fn new(is_on: bool, spread: [f64; 2], sigma: f64) -> Self {
        let variance = |k: usize| {
            let std = if is_on { spread[k].max(PRIOR[k]) } else { spread[k] };
            std * std
        };
        let prior = [variance(0), variance(1)];
        Self {
            is_on,
            prior,
            estimate: [1.0; 2],
            covariance: diagonal(prior),
            sigma,
            memory: Box::new([[None; CELLS]; 2]),
            current: None,
            slide: None,
            time: 0.0,
            learnt: f64::NEG_INFINITY,
            contact: false,
            loaded: f64::NEG_INFINITY,
            outliers: 0,
        }
    }

    /// Resets the filter.
    pub(super) fn reset(&mut self) {
        self.break_off();
        self.estimate = [1.0; 2];
        self.covariance = diagonal(self.prior);
        (self.time, self.learnt, self.loaded) = (0.0, f64::NEG_INFINITY, f64::NEG_INFINITY);
        (self.contact, self.outliers) = (false, 0);
    }

    /// Writes or reads all that changes.
    pub(super) fn exchange(&mut self, row: &mut StateRow) {
        row.numbers(&mut self.estimate);
        self.covariance.iter_mut().for_each(|variances| row.numbers(variances));
        for crossing in self.memory.iter_mut().flatten() {
            row.optional(crossing, Crossing::default(), |own, row| {
                row.cell(&mut own.cell);
                row.number(&mut own.time);
                own.mean.exchange(row);
            });
        }
        row.optional(&mut self.current, Current::default(), |own, row| {
            row.cell(&mut own.cell);
            row.flag(&mut own.inserts);
            own.sum.exchange(row);
            row.number(&mut own.samples);
        });
        row.optional(&mut self.slide, Slide::default(), |own, row| {
            row.number(&mut own.from);
            row.flag(&mut own.inserts);
        });
        let times = [&mut self.time, &mut self.learnt, &mut self.loaded];
        times.into_iter().for_each(|time| row.number(time));
        row.flag(&mut self.contact);
        row.count(&mut self.outliers, u64::from(CHANGE));
    }

    pub(super) fn drift(&self) -> Drift {
        Drift {
            level: self.estimate[0],
            viscosity: self.estimate[1],
            level_std: self.covariance[0][0].sqrt(),
            viscosity_std: self.covariance[1][1].sqrt(),
        }
    }

    /// Variances of λ and ν at the start.
    pub(super) fn prior(&self) -> [f64; 2] {
        self.prior
    }

    pub(super) fn is_in_contact(&self) -> bool {
        self.contact
    }

    pub(super) fn is_adapting(&self) -> bool {
        self.is_on && !self.is_latched() && self.time - self.learnt < EXCITED
    }

    /// Whether tissue contact was detected recently.
    fn is_latched(&self) -> bool {
        self.contact || self.time - self.loaded < LATCH
    }

    /// cov(λ, ν).
    pub(super) fn covariance(&self) -> f64 {
        self.covariance[0][1]
    }

    /// Advances the time: the uncertainty of λ and ν grows.
    pub(super) fn pass(&mut self, duration: f64) {
        self.time += duration;
        if !self.is_on {
            return;
        }
        for k in 0..2 {
            let (now, most) = (self.covariance[k][k], PRIOR[k] * PRIOR[k]);
            if now < most {
                self.covariance[k][k] = (now + GROWTH[k] * GROWTH[k] * duration).min(most);
            }
        }
    }

    /// The motion was interrupted: earlier crossings belong to another motion.
    pub(super) fn break_off(&mut self) {
        (self.current, self.slide) = (None, None);
        self.memory.iter_mut().for_each(|side| side.fill(None));
    }

    /// Tracks a slide; returns its direction once it has lasted for a fraction of the deformation
    /// `width`, m.
    pub(super) fn settle(
        &mut self,
        slides: bool,
        inserts: bool,
        position: f64,
        width: f64,
    ) -> Option<bool> {
        if !slides {
            self.slide = None;
            self.finish_crossing();
            return None;
        }
        let slide = self.slide.filter(|slide| slide.inserts == inserts);
        let slide = slide.unwrap_or(Slide { from: position, inserts });
        self.slide = Some(slide);
        ((position - slide.from).abs() >= SETTLED * width).then_some(inserts)
    }

    /// Adds a sample of a slide at `position`, m.
    pub(super) fn take(&mut self, position: f64, inserts: bool, now: Sliding) {
        let cell = (position / CELL).floor() as i64;
        let same =
            self.current.filter(|current| current.cell == cell && current.inserts == inserts);
        if same.is_none() {
            self.finish_crossing();
        }
        let (sum, samples) =
            same.map_or((Sliding::default(), 0.0), |current| (current.sum, current.samples));
        self.current = Some(Current { cell, inserts, sum: sum.plus(now), samples: samples + 1.0 });
    }

    fn finish_crossing(&mut self) {
        let Some(Current { cell, inserts, sum, samples }) = self.current.take() else { return };
        let mean = sum.times(1.0 / samples);
        let place = cell.rem_euclid(CELLS as i64) as usize;
        let recent =
            |crossing: &Crossing| crossing.cell == cell && self.time - crossing.time < LONGEST_AGE;
        let across = self.memory[usize::from(!inserts)][place].filter(recent);
        let along = self.memory[usize::from(inserts)][place].filter(recent);
        if let Some(across) = across {
            let first = along.filter(|along| along.time < across.time);
            self.learn(mean, across.mean, first.map(|along| along.mean));
        }
        self.memory[usize::from(inserts)][place] = Some(Crossing { cell, time: self.time, mean });
    }

    /// Reading less the model's force, N.
    fn residual(&self, of: &Sliding) -> f64 {
        of.reading - self.estimate[0] * of.dry - self.estimate[1] * of.viscous
    }

    /// Variance of the model's force, N², due to λ and ν: for an asymmetric seal, and for unequal
    /// speeds.
    fn variance(&self, of: &Sliding) -> f64 {
        let [[level, both], [_, viscosity]] = self.covariance;
        level * of.dry * of.dry
            + 2.0 * both * of.dry * of.viscous
            + viscosity * of.viscous * of.viscous
    }

    /// Updates the filter from a crossing, the opposite one before it, and the one in its own
    /// direction before that.
    fn learn(&mut self, now: Sliding, across: Sliding, first: Option<Sliding>) {
        let mean = now.plus(across).times(0.5);
        let load = self.residual(&mean);
        self.contact =
            load * load > CONTACT * CONTACT * (self.sigma * self.sigma + self.variance(&mean));
        if self.contact {
            self.loaded = self.time;
        }
        let same = first.is_some_and(|first| {
            let change = now.plus(first.times(-1.0));
            let noise = 2.0 * self.sigma * self.sigma + self.variance(&change);
            self.residual(&change).powi(2) < CONTACT * CONTACT * noise
        });
        if self.is_latched() || !same {
            return;
        }
        self.update(&now.plus(across.times(-1.0)));
    }

    /// One filter update with the part that reverses.
    fn update(&mut self, turns: &Sliding) {
        let row = [turns.dry, turns.viscous];
        let innovation = self.residual(turns);
        let gain = self.covariance.map(|p| p[0] * row[0] + p[1] * row[1]);
        let noise = 2.0 * self.sigma * self.sigma * CORRELATED;
        let variance = row[0] * gain[0] + row[1] * gain[1] + noise;
        if innovation * innovation > OUTLIER * OUTLIER * variance {
            self.outliers += 1;
            if self.outliers >= CHANGE {
                self.open();
            }
            return;
        }
        self.outliers = 0;
        self.learnt = self.time;
        for k in 0..2 {
            let [low, high] = BOUNDS[k];
            self.estimate[k] =
                (self.estimate[k] + gain[k] * innovation / variance).clamp(low, high);
            for j in 0..2 {
                self.covariance[k][j] -= gain[k] * gain[j] / variance;
            }
        }
    }

    /// Switches to another friction scale, with the variance of the prior.
    pub(super) fn restart_at(&mut self, level: f64) {
        self.break_off();
        self.outliers = 0;
        self.estimate[0] = level.clamp(BOUNDS[0][0], BOUNDS[0][1]);
        self.covariance = diagonal(PRIOR.map(|std| std * std));
    }

    /// A change was detected: widens the prior to cover any change.
    fn open(&mut self) {
        self.outliers = 0;
        self.covariance = diagonal(OPENED.map(|std| std * std));
    }
}

/// P of independent λ and ν.
fn diagonal(variances: [f64; 2]) -> [[f64; 2]; 2] {
    [[variances[0], 0.0], [0.0, variances[1]]]
}
