//! Where a loop is stable: by running it.

use serde::Serialize;
use trocar_model::Trocar;

use super::config::{Config, ConfigError, TissueKind};
use super::simulation::{Loop, Sample};

/// How a loop is tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Distance by which the hand pushes, and then pulls back, m.
    pub push_m: f64,
    /// Time after each of these after which the loop must have settled, s.
    pub settle_s: f64,
    /// Time over which it is watched then, s.
    pub watch_s: f64,
    /// Largest rms velocity of both devices over half of that time, m/s, with which they count as at rest.
    pub at_rest_m_s: f64,
}

/// Change of the velocity in a sample below which nothing counts as growing, m/s: above what rounding and the iterations of the
/// plant leave.
const STILL_M_S: f64 = 1e-10;
/// Velocity with which the follower is struck, m/s: the push alone is too smooth to excite what oscillates fast. Two strikes
/// together are below rest.
const STRUCK_M_S: f64 = 3e-4;
/// Steps of the follower's encoder by which it is displaced as well: controllers do not see less.
const DISPLACED_STEPS: f64 = 2.0;
/// Most halves of the watch.
const LONGEST_WATCH: usize = 60;
/// Part of the least velocity so far below which a half counts as decay, and halves in a row without decay after which a loop
/// that oscillates evenly is unstable: those of a slow swing are not of equal velocity.
const SLOWEST_DECAY: f64 = 0.9;
const PATIENCE: u32 = 2;
/// Halves from which on a slow decay is told from an even oscillation.
const TOLD: usize = 8;
/// Standard errors by which an envelope must grow or decay, and the least rate, per half: above that of rounding.
const SIGNIFICANT: f64 = 3.0;
const SLOWEST_RATE: f64 = 1e-6;
/// Part of its earlier rate with which an envelope must still decay, or grow, at the end: one that tends to an even oscillation
/// does not.
const STEADY: f64 = 0.5;
/// Watches within which what decays at that rate must be at rest.
const LONGEST_DECAY: f64 = 20.0;
/// Part of the work on the trocar that it dissipates from which on it slides: a seal that only deforms gives nearly all back.
const SLIDES: f64 = 0.5;

/// What a loop does not come to rest after.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Disturbance {
    /// A push into the tissue.
    PushIntoTissue,
    /// A pull off the tissue.
    PullOffTissue,
    /// A push without tissue.
    PushWithoutTissue,
    /// A pull without tissue.
    PullWithoutTissue,
}

impl Disturbance {
    /// As the end of "does not come to rest after".
    pub fn in_words(self) -> &'static str {
        match self {
            Self::PushIntoTissue => "a push into the tissue",
            Self::PullOffTissue => "a pull off the tissue",
            Self::PushWithoutTissue => "a push without tissue",
            Self::PullWithoutTissue => "a pull without tissue",
        }
    }

    /// The one after which the loop of `config` does not come to rest, with `model` in the compensator and `plant` as the trocar:
    /// a push by 10 mm from the surface of the tissue and back ([`Trial`]). If the motion leaves the tissue, before that a push
    /// and a pull without tissue, and after it a pull from the surface. `None` where the loop is stable.
    ///
    /// # Errors
    /// A value of `config` out of its range.
    pub fn unsettling<K: AsRef<[f64]> + Clone>(
        config: &Config,
        models: [&Trocar<K>; 2],
    ) -> Result<Option<Self>, ConfigError> {
        let (mut free, surface) = (config.clone(), config.tissue.surface_m);
        free.tissue.kind = TissueKind::None;
        let trials = [(&free, 1.0), (&free, -1.0), (config, 1.0), (config, -1.0)];
        let needed = if config.leaves_the_tissue() { 0..4 } else { 2..3 };
        for (tried, first) in &trials[needed] {
            let failed = Trial::default().fails(tried, models, surface, *first)?;
            if let Some(direction) = failed {
                let is_free = tried.tissue.kind == TissueKind::None;
                return Ok(Some(match (is_free, direction > 0.0) {
                    (false, true) => Self::PushIntoTissue,
                    (false, false) => Self::PullOffTissue,
                    (true, true) => Self::PushWithoutTissue,
                    (true, false) => Self::PullWithoutTissue,
                }));
            }
        }
        Ok(None)
    }
}

impl Default for Trial {
    /// A push by 10 mm, 1 s to settle, watched for 1 s, at rest below 1 mm/s.
    fn default() -> Self {
        Self { push_m: 0.01, settle_s: 1.0, watch_s: 1.0, at_rest_m_s: 1e-3 }
    }
}

impl Trial {
    /// Whether the loop, at rest at `position` (m), comes to rest after the hand has moved by
    /// [`Trial::push_m`] within 0.1 s and the follower was struck, at 0.3 mm/s and by two steps of its encoder, and again after the same
    /// in the opposite direction. At rest the rms velocity of both devices over half of [`Trial::watch_s`] is below
    /// [`Trial::at_rest_m_s`], and what oscillates has died away. The watch goes on until then, for up to sixty halves. If
    /// something still oscillates at their end, the loop is unstable where
    ///
    /// - the oscillation grows, however slowly: over the last two thirds at a steady rate,
    /// - the velocity was never below rest, and does not decay at a steady rate,
    /// - the steps of an encoder keep the instrument sliding in the trocar (ABBOTT); to keep it deforming the seal, below
    ///   rest, is no instability.
    ///
    /// A velocity above rest that has not fallen by a tenth in three halves is unstable at once if the oscillation is even.
    /// Times are longer where the channel's delay asks for it. The sensor's noise and breathing, which keep a stable loop in
    /// motion, are left out. With an encoder the follower begins midway between two of its steps, where a controller never sees it
    /// at its target.
    ///
    /// # Errors
    /// A value of `config` out of its range.
    pub fn is_stable<K: AsRef<[f64]> + Clone>(
        &self,
        config: &Config,
        trocar: &Trocar<K>,
        compensator: &Trocar<K>,
        position: f64,
    ) -> Result<bool, ConfigError> {
        Ok(self.fails(config, [compensator, trocar], position, 1.0)?.is_none())
    }

    /// The direction in which the hand moved when the loop did not come to rest, of `first` and its opposite; `None` where it does.
    fn fails<K: AsRef<[f64]> + Clone>(
        &self,
        config: &Config,
        [model, plant]: [&Trocar<K>; 2],
        position: f64,
        first: f64,
    ) -> Result<Option<f64>, ConfigError> {
        let (quiet, step) = (config.quiet(), config.follower.encoder_step_m);
        let (start, push) = match step > 0.0 {
            true => (((position / step).floor() + 0.5) * step, (self.push_m / step).ceil() * step),
            false => (position, self.push_m),
        };
        let mut tried = Loop::new(&quiet, plant.clone(), model.clone(), start)?;
        let mut moves: Vec<(f64, f64)> = Vec::new();
        for direction in [first, -first] {
            moves.push((tried.time(), direction * push));
            tried.strike(direction * DISPLACED_STEPS * step, direction * STRUCK_M_S);
            if !self.comes_to_rest(&quiet, &mut tried, |time| {
                moves.iter().fold((start, 0.0), |(x, v), (begin, way)| {
                    let [moved, rate] = minimum_jerk(time - begin);
                    (x + way * moved, v + way * rate)
                })
            }) {
                return Ok(Some(direction));
            }
        }
        Ok(None)
    }

    fn comes_to_rest<K: AsRef<[f64]> + Clone>(
        &self,
        config: &Config,
        tried: &mut Loop<K>,
        hand: impl Fn(f64) -> (f64, f64),
    ) -> bool {
        let round_trip = 2.0 * (config.channel.delay_s + config.channel.jitter_s);
        let samples = |seconds: f64, trips: f64| {
            (seconds.max(trips * round_trip) / config.sample_time_s).ceil() as usize
        };
        if Half::of(tried, samples(self.settle_s, 5.0), &hand).is_none() {
            return false;
        }
        let count = samples(0.5 * self.watch_s, 2.0);
        let (mut halves, mut least, mut without_decay) = (Vec::new(), f64::INFINITY, 0);
        while halves.len() < LONGEST_WATCH {
            let Some(half) = Half::of(tried, count, &hand) else { return false };
            let is_below = half.speed < self.at_rest_m_s;
            if is_below && half.change < STILL_M_S && !halves.is_empty() {
                return true;
            }
            without_decay = if half.speed < SLOWEST_DECAY * least { 0 } else { without_decay + 1 };
            least = least.min(half.speed);
            halves.push(half);
            let is_even = !is_below && without_decay > PATIENCE && halves.len() >= TOLD;
            if is_even && !Growth::of(&halves[halves.len() - TOLD..]).decays() {
                return false;
            }
        }
        let has_encoder = config.leader.encoder_step_m + config.follower.encoder_step_m > 0.0;
        let third = LONGEST_WATCH / 3;
        let [earlier, last] = [&halves[third..2 * third], &halves[2 * third..]];
        let slides = has_encoder && slides(last);
        let [earlier, last] = [earlier, last].map(Growth::of);
        match least < self.at_rest_m_s {
            true => {
                let grows = earlier.grows() && last.grows() && last.rate > STEADY * earlier.rate;
                !grows && (!slides || last.decays())
            }
            false => {
                let in_time =
                    (self.at_rest_m_s / least).ln() / (LONGEST_DECAY * LONGEST_WATCH as f64);
                last.decays() && last.rate < in_time && last.rate < STEADY * earlier.rate
            }
        }
    }
}

/// Part of a movement of minimum jerk over 0.1 s that is done after `time` (s), and its rate, 1/s.
fn minimum_jerk(time: f64) -> [f64; 2] {
    let part = (time / 0.1).clamp(0.0, 1.0);
    let moved = part * part * part * (10.0 + part * (6.0 * part - 15.0));
    [moved, 30.0 * part * part * (1.0 - part) * (1.0 - part) / 0.1]
}

/// Half of the watch.
struct Half {
    /// Rms velocity of both devices, m/s.
    speed: f64,
    /// Largest change of a device's velocity in a sample, m/s. Unlike the velocity, it does not hide an oscillation behind a
    /// device that coasts.
    change: f64,
    /// Work on the trocar, and the sum of its magnitudes over the samples, J.
    works: [f64; 2],
}

/// Whether the instrument slides in the trocar, and not only deforms it.
fn slides(halves: &[Half]) -> bool {
    let [net, gross] = [0, 1].map(|k| halves.iter().map(|half| half.works[k]).sum::<f64>());
    net > SLIDES * gross
}

impl Half {
    /// The next `count` samples; `None` where the loop diverges.
    fn of<K: AsRef<[f64]> + Clone>(
        tried: &mut Loop<K>,
        count: usize,
        hand: impl Fn(f64) -> (f64, f64),
    ) -> Option<Self> {
        let (mut squares, mut change, mut works) = (0.0, 0.0_f64, [0.0; 2]);
        let mut last: Option<Sample> = None;
        for _ in 0..count {
            let now = tried.step(&hand).ok()?;
            squares += now.leader_velocity.powi(2) + now.follower_velocity.powi(2);
            if let Some(last) = last {
                let leader = now.leader_velocity - last.leader_velocity;
                let follower = now.follower_velocity - last.follower_velocity;
                change = change.max(leader.abs()).max(follower.abs());
                let work = now.trocar_work - last.trocar_work;
                works = [works[0] + work, works[1] + work.abs()];
            }
            last = Some(now);
        }
        Some(Self { speed: (squares / count.max(1) as f64).sqrt(), change, works })
    }
}

/// Exponential growth of the changes of velocity, by least squares through its logarithm.
#[derive(Debug)]
struct Growth {
    /// Per half.
    rate: f64,
    /// Standard error of the rate.
    error: f64,
}

impl Growth {
    fn of(halves: &[Half]) -> Self {
        let count = halves.len() as f64;
        let middle = 0.5 * (count - 1.0);
        let logs: Vec<f64> = halves.iter().map(|half| half.change.max(STILL_M_S).ln()).collect();
        let mean = logs.iter().sum::<f64>() / count;
        let points = (0..).map(|k: u32| f64::from(k) - middle).zip(&logs);
        let xx: f64 = points.clone().map(|(x, _)| x * x).sum();
        let rate = points.clone().map(|(x, log)| x * log).sum::<f64>() / xx;
        let squares: f64 = points.map(|(x, log)| (log - mean - rate * x).powi(2)).sum();
        Self { rate, error: (squares / (count - 2.0) / xx).sqrt() }
    }

    fn grows(&self) -> bool {
        self.rate > SIGNIFICANT * self.error + SLOWEST_RATE
    }

    fn decays(&self) -> bool {
        self.rate < -SIGNIFICANT * self.error - SLOWEST_RATE
    }
}

/// The value between `low`, where `holds` is true, and `high`, where it is not, at which that changes, to within
/// `accuracy`. `None` where it does not change: the whole interval holds, or not even `low`.
///
/// # Errors
/// Those of `holds`.
pub fn boundary<E>(
    [low, high]: [f64; 2],
    accuracy: f64,
    mut holds: impl FnMut(f64) -> Result<bool, E>,
) -> Result<Option<f64>, E> {
    if !holds(low)? || holds(high)? {
        return Ok(None);
    }
    bisect([low, high], accuracy, holds).map(|[low, high]| Some(0.5 * (low + high)))
}

/// The interval, no wider than `accuracy`, in which that changes, where `low` is known to hold, and `high` not to.
pub(super) fn bisect<E>(
    [mut low, mut high]: [f64; 2],
    accuracy: f64,
    mut holds: impl FnMut(f64) -> Result<bool, E>,
) -> Result<[f64; 2], E> {
    while high - low > accuracy {
        let middle = 0.5 * (low + high);
        if holds(middle)? { low = middle } else { high = middle }
    }
    Ok([low, high])
}

/// Softest and stiffest tissue that are tried, N/m; beside them, none at all and the loop's own.
const RANGE_N_M: [f64; 2] = [1.0, 20_000.0];
/// Intervals between them, even in their logarithm.
const TRIED: u32 = 12;
/// Accuracy of a stiffness, relative.
const ACCURACY: f64 = 0.02;

/// Stiffnesses of the tissue with which a loop is stable.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct ZWidth {
    /// Ranges, from the softest on: least and greatest stiffness of each, N/m. A range from 0 on holds without tissue; 20 000,
    /// the stiffest that is tried, may not be the end of one. Empty where the loop is stable with none that is tried.
    pub ranges_n_m: Vec<[f64; 2]>,
}

impl ZWidth {
    /// The stiffnesses with which the loop of `config` settles ([`Trial`]) at the surface of its tissue, with `model` in the
    /// compensator and `plant` as the trocar. Tried are 1 and 20 000 N/m, eleven in between, that of `config` and 0, which is no
    /// tissue: no damping either. Between two
    /// of which one settles and the other does not, the boundary is bisected to within 2 %, below 1 N/m to within 0.02 N/m. A
    /// range or a gap that lies between two of these stiffnesses is not found. `None` without tissue.
    ///
    /// # Errors
    /// A value of `config` out of its range.
    pub fn of<K: AsRef<[f64]> + Clone>(
        config: &Config,
        [model, plant]: [&Trocar<K>; 2],
    ) -> Result<Option<Self>, ConfigError> {
        if config.tissue.kind == TissueKind::None {
            return Ok(None);
        }
        let [softest, stiffest] = RANGE_N_M.map(f64::ln);
        let between =
            (0..TRIED).map(|k| softest + (stiffest - softest) * f64::from(k) / f64::from(TRIED));
        let own = config.tissue.stiffness_n_m;
        let ends = [0.0, own, RANGE_N_M[1]];
        let mut tried: Vec<f64> = between.map(f64::exp).chain(ends).collect();
        tried.sort_by(f64::total_cmp);
        let (mut config, kind) = (config.clone(), config.tissue.kind);
        Ok(Some(Self {
            ranges_n_m: ranges(&tried, |stiffness| {
                config.tissue.stiffness_n_m = stiffness;
                config.tissue.kind = if stiffness > 0.0 { kind } else { TissueKind::None };
                Trial::default().is_stable(&config, plant, model, config.tissue.surface_m)
            })?,
        }))
    }

    /// The softest of the ranges; `None` where there is none.
    pub fn first(&self) -> Option<[f64; 2]> {
        self.ranges_n_m.first().copied()
    }
}

/// Ranges in which `holds`, of `tried`, which rises; their ends are bisected.
fn ranges<E>(
    tried: &[f64],
    mut holds: impl FnMut(f64) -> Result<bool, E>,
) -> Result<Vec<[f64; 2]>, E> {
    let mut ranges: Vec<[f64; 2]> = Vec::new();
    let (mut below, mut held) = (0.0, false);
    for &here in tried {
        let holds_here = holds(here)?;
        match (held, holds_here) {
            (false, true) if here == 0.0 => ranges.push([0.0; 2]),
            (false, true) => ranges.push([edge([below, here], |s| Ok(!holds(s)?))?, here]),
            (true, false) => {
                let end = edge([below, here], &mut holds)?;
                ranges.last_mut().expect("one that holds")[1] = end;
            }
            (true, true) => ranges.last_mut().expect("one that holds")[1] = here,
            (false, false) => {}
        }
        (below, held) = (here, holds_here);
    }
    Ok(ranges)
}

/// The stiffness between `low`, which holds, and `high`, which does not, at which that changes: relative to it, and up to
/// the softest that is tried in N/m.
fn edge<E>([low, high]: [f64; 2], mut holds: impl FnMut(f64) -> Result<bool, E>) -> Result<f64, E> {
    let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
    if low < RANGE_N_M[0] {
        return bisect([low, high], ACCURACY, holds).map(middle);
    }
    bisect([low.ln(), high.ln()], ACCURACY, |log| holds(log.exp())).map(|e| middle(e).exp())
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    #[test]
    fn all_ranges_are_found_with_both_ends() {
        let tried: Vec<f64> =
            std::iter::once(0.0).chain((0..=12).map(|k| f64::from(k).exp())).collect();
        let found =
            |holds: fn(f64) -> bool| ranges(&tried, |s| Ok::<_, Infallible>(holds(s))).unwrap();
        assert_eq!(found(|_| false), Vec::<[f64; 2]>::new());
        assert_eq!(found(|_| true), [[0.0, 12f64.exp()]]);
        let [first, second] = found(|s| !(100.0..=3000.0).contains(&s))[..] else {
            panic!("two ranges")
        };
        assert!(first[0] == 0.0 && (first[1] / 100.0 - 1.0).abs() < ACCURACY, "{first:?}");
        assert!(
            second[1] == 12f64.exp() && (second[0] / 3000.0 - 1.0).abs() < ACCURACY,
            "{second:?}"
        );
        let [only] = found(|s| (0.4..=50.0).contains(&s))[..] else { panic!("one range") };
        assert!(
            (only[0] - 0.4).abs() < ACCURACY && (only[1] / 50.0 - 1.0).abs() < ACCURACY,
            "{only:?}"
        );
    }
}
