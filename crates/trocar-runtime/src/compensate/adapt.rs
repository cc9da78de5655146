//! Level and viscosity of the friction, followed in use.
//!
//! A force sensor outside the body cannot tell friction from tissue at one moment. It can over a pass there and back: at one
//! place x the friction turns with the motion, an elastic tissue, a constant load, a weight do not. So the track is divided into
//! cells of 1 mm, and whenever a cell is crossed against the direction of its last crossing, both sliding, the pair gives
//!
//! ```text
//! y₊ − y₋     = λ·(f₊ − f₋) + ν·(b₊ − b₋) + noise          what turns: learnt
//! (y₊ + y₋)/2 = [λ·(f₊ + f₋) + ν·(b₊ + b₋)]/2 + load       what does not: tissue, if it is more than 3 σ
//! ```
//! y reading, f and b the model's sliding force without and with its viscous part alone (of λ = ν = 1), N. Learnt is only from
//! three crossings in turn, there, back and there again, of which the first and the last agree: a tissue force that came or changed
//! between them is no friction. A pair with load is not learnt from, nor is anything for some seconds after it.
//!
//! λ and ν are the states of a Kalman filter (key KALMAN) whose prior is the identified model:
//!
//! ```text
//! θ⁺ = θ + w     var w = q·Δt          P bounded by the prior: what is not observed is forgotten at a bounded rate
//! ```
//!
//! - **Bounds**: λ in [0.1, 2], ν in [0, 4].
//! - **Outliers**: an innovation beyond 3 standard deviations is left out; eight in a row without load are a change of the
//!   friction, and the prior is opened. A change that leaves no slides to learn from is found by [`super::bank`].
//! - **Memory** is fixed: 512 cells of either direction, the oldest are overwritten.
//! - **Limit**: a tissue force that turns with the motion and is as large both ways is taken for friction.

/// Length of a cell, m.
pub(super) const CELL: f64 = 1e-3;
/// Cells remembered.
pub(super) const CELLS: usize = 512;
/// Longest time between the crossings of a pair, s.
pub(super) const LONGEST_AGE: f64 = 20.0;
/// Time after the last pair that was learnt from during which λ and ν count as followed, s.
const EXCITED: f64 = 5.0;
/// Errors of the model are correlated over the position: as many neighbouring pairs count as one.
const CORRELATED: f64 = 32.0;
/// Load, over its standard deviation, from which on tissue is touched.
pub(super) const CONTACT: f64 = 3.0;
/// Time after a load during which nothing is learnt, s.
const LATCH: f64 = 4.0;
/// Innovation over its standard deviation that is no longer believed.
const OUTLIER: f64 = 3.0;
/// Outliers in a row that are a change.
const CHANGE: u32 = 8;
/// Standard deviations of the prior: wetting takes 15 to 45 % off.
const PRIOR: [f64; 2] = [0.15, 0.3];
/// The same once a change was seen: silicone oil takes 75 % off.
const OPENED: [f64; 2] = [0.5, 0.5];
/// Growth of the standard deviations within a second.
const GROWTH: [f64; 2] = [0.0015, 0.01];
/// Bounds of λ and ν.
const BOUNDS: [[f64; 2]; 2] = [[0.1, 2.0], [0.0, 4.0]];
/// Part of the deformation range that must be slid before the slide is beyond doubt.
const SETTLED: f64 = 0.25;

/// Where level and viscosity stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// λ: friction over that of the model, without the viscous part.
    pub level: f64,
    /// ν: viscous part over that of the model.
    pub viscosity: f64,
    /// Standard deviation of λ.
    pub level_std: f64,
    /// Standard deviation of ν.
    pub viscosity_std: f64,
}

/// One moment of a slide, all in N and without what depends on the way.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sliding {
    /// Reading without offset, inertia and way.
    pub(super) reading: f64,
    /// f: force of the model without its viscous part.
    pub(super) dry: f64,
    /// b: its viscous part.
    pub(super) viscous: f64,
}

impl Sliding {
    fn plus(self, other: Self) -> Self {
        Self { reading: self.reading + other.reading, dry: self.dry + other.dry, viscous: self.viscous + other.viscous }
    }

    fn times(self, factor: f64) -> Self {
        Self { reading: factor * self.reading, dry: factor * self.dry, viscous: factor * self.viscous }
    }
}

/// The mean of one crossing of one cell.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    cell: i64,
    time: f64,
    mean: Sliding,
}

/// A crossing under way.
#[derive(Debug, Clone, Copy)]
struct Current {
    cell: i64,
    inserts: bool,
    sum: Sliding,
    samples: f64,
}

/// Where a slide began.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    /// By direction (withdrawal, insertion) and cell.
    memory: Box<[[Option<Crossing>; CELLS]; 2]>,
    current: Option<Current>,
    slide: Option<Slide>,
    time: f64,
    learnt: f64,
    contact: bool,
    /// When the last load was seen, s.
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

    /// As new.
    pub(super) fn reset(&mut self) {
        self.break_off();
        self.estimate = [1.0; 2];
        self.covariance = diagonal(self.prior);
        (self.time, self.learnt, self.loaded) = (0.0, f64::NEG_INFINITY, f64::NEG_INFINITY);
        (self.contact, self.outliers) = (false, 0);
    }

    pub(super) fn drift(&self) -> Drift {
        Drift {
            level: self.estimate[0],
            viscosity: self.estimate[1],
            level_std: self.covariance[0][0].sqrt(),
            viscosity_std: self.covariance[1][1].sqrt(),
        }
    }

    pub(super) fn is_in_contact(&self) -> bool {
        self.contact
    }

    pub(super) fn is_adapting(&self) -> bool {
        self.is_on && !self.is_latched() && self.time - self.learnt < EXCITED
    }

    /// Whether tissue was touched of late.
    fn is_latched(&self) -> bool {
        self.contact || self.time - self.loaded < LATCH
    }

    /// cov(λ, ν).
    pub(super) fn covariance(&self) -> f64 {
        self.covariance[0][1]
    }

    /// Time goes on: what is known of λ and ν fades.
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

    /// The motion was interrupted: crossings of before are crossings of another motion.
    pub(super) fn break_off(&mut self) {
        (self.current, self.slide) = (None, None);
        self.memory.iter_mut().for_each(|side| side.fill(None));
    }

    /// Follows a slide; tells its direction once it has gone on for a part of the deformation `width`, m.
    pub(super) fn settle(&mut self, slides: bool, inserts: bool, position: f64, width: f64) -> Option<bool> {
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

    /// Takes a moment of a slide at `position`, m.
    pub(super) fn take(&mut self, position: f64, inserts: bool, now: Sliding) {
        let cell = (position / CELL).floor() as i64;
        let same = self.current.filter(|current| current.cell == cell && current.inserts == inserts);
        if same.is_none() {
            self.finish_crossing();
        }
        let (sum, samples) = same.map_or((Sliding::default(), 0.0), |current| (current.sum, current.samples));
        self.current = Some(Current { cell, inserts, sum: sum.plus(now), samples: samples + 1.0 });
    }

    fn finish_crossing(&mut self) {
        let Some(Current { cell, inserts, sum, samples }) = self.current.take() else { return };
        let mean = sum.times(1.0 / samples);
        let place = cell.rem_euclid(CELLS as i64) as usize;
        let recent = |crossing: &Crossing| crossing.cell == cell && self.time - crossing.time < LONGEST_AGE;
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

    /// Variance of the model's force, N², that λ and ν leave: of a seal that is not the same both ways, of unequal speeds.
    fn variance(&self, of: &Sliding) -> f64 {
        let [[level, both], [_, viscosity]] = self.covariance;
        level * of.dry * of.dry + 2.0 * both * of.dry * of.viscous + viscosity * of.viscous * of.viscous
    }

    /// Learns from a crossing, the one back before it, and the one of its own direction before that.
    fn learn(&mut self, now: Sliding, across: Sliding, first: Option<Sliding>) {
        let mean = now.plus(across).times(0.5);
        let load = self.residual(&mean);
        self.contact = load * load > CONTACT * CONTACT * (self.sigma * self.sigma + self.variance(&mean));
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

    /// One step of the filter with what turned.
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
            self.estimate[k] = (self.estimate[k] + gain[k] * innovation / variance).clamp(low, high);
            for j in 0..2 {
                self.covariance[k][j] -= gain[k] * gain[j] / variance;
            }
        }
    }

    /// Goes over to another level of friction, which the prior's spread leaves open again.
    pub(super) fn restart_at(&mut self, level: f64) {
        self.break_off();
        self.outliers = 0;
        self.estimate[0] = level.clamp(BOUNDS[0][0], BOUNDS[0][1]);
        self.covariance = diagonal(PRIOR.map(|std| std * std));
    }

    /// A change was seen: the prior is as wide as any change may be.
    fn open(&mut self) {
        self.outliers = 0;
        self.covariance = diagonal(OPENED.map(|std| std * std));
    }
}

/// P of independent λ and ν.
fn diagonal(variances: [f64; 2]) -> [[f64; 2]; 2] {
    [[variances[0], 0.0], [0.0, variances[1]]]
}
