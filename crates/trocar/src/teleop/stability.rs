//! Where a loop is stable: by running it.

use serde::Serialize;
use trocar_model::Trocar;

use super::config::{Config, ConfigError, TissueKind};
use super::simulation::Loop;

/// How a loop is tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Distance by which the hand pushes at the beginning, m.
    pub push_m: f64,
    /// Time after which the loop must have settled, s.
    pub settle_s: f64,
    /// Time over which it is watched then, s.
    pub watch_s: f64,
    /// Largest rms velocity of both devices in the second half of that time, m/s, with which they count as at rest.
    pub at_rest_m_s: f64,
}

/// Velocity below which nothing counts as growing, m/s: above what rounding and the iterations of the plant leave.
const STILL_M_S: f64 = 1e-10;
/// Velocity with which the slave is struck, m/s: the push alone is too smooth to excite what oscillates fast.
const STRUCK_M_S: f64 = 1e-3;
/// Most times that half of the watch is repeated while the velocity grows from below rest, or decays towards it.
const LONGEST_WATCH: u32 = 60;
/// Part of the least velocity so far below which a half counts as decay, and halves in a row without decay after which a loop
/// is unstable: those of a slow swing are not of equal velocity.
const SLOWEST_DECAY: f64 = 0.9;
const PATIENCE: u32 = 2;

impl Default for Trial {
    /// A push by 10 mm, 1 s to settle, watched for 1 s, at rest below 1 mm/s.
    fn default() -> Self {
        Self { push_m: 0.01, settle_s: 1.0, watch_s: 1.0, at_rest_m_s: 1e-3 }
    }
}

impl Trial {
    /// Whether the loop, at rest at `position` (m), comes to rest after the hand has moved by
    /// [`Trial::push_m`] within 0.1 s and the slave was struck, at 1 mm/s: the rms velocity of both devices over the second half of
    /// [`Trial::watch_s`] is below [`Trial::at_rest_m_s`], and does not grow from the first half. The watch goes on, for up to
    /// sixty halves, while the velocity grows from below rest (a slow growth is unstable, too), or decays towards rest: at least
    /// every third half is a tenth below the least so far.
    /// Both times are longer where the channel's delay asks for it. The sensor's noise and breathing,
    /// which keep a stable loop in motion, are left out.
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
        let mut quiet = config.clone();
        (quiet.tissue.breathing_m, quiet.sensor.noise_n) = (0.0, 0.0);
        let tried = Loop::new(&quiet, trocar.clone(), compensator.clone(), position)?;
        let mut tried = tried.with_slave_velocity(STRUCK_M_S);
        let hand = |time: f64| {
            let part = (time / 0.1).min(1.0);
            // Minimum jerk.
            let way = part * part * part * (10.0 + part * (6.0 * part - 15.0));
            let rate = 30.0 * part * part * (1.0 - part) * (1.0 - part) / 0.1;
            (position + self.push_m * way, self.push_m * rate)
        };
        let round_trip = 2.0 * (config.channel.delay_s + config.channel.jitter_s);
        let samples = |seconds: f64, trips: f64| {
            (seconds.max(trips * round_trip) / config.sample_time_s).ceil() as usize
        };
        // `None` where the loop diverges.
        let mut rms = |count: usize| {
            let mut squares = 0.0;
            for _ in 0..count {
                let sample = tried.step(hand).ok()?;
                squares += sample.master_velocity.powi(2) + sample.slave_velocity.powi(2);
            }
            Some((squares / count.max(1) as f64).sqrt())
        };
        let half = samples(0.5 * self.watch_s, 2.0);
        let windows = [samples(self.settle_s, 5.0), half, half].map(&mut rms);
        let [Some(_), Some(mut first), Some(mut second)] = windows else { return Ok(false) };
        let (mut least, mut without_decay) = (first, 0);
        for _ in 0..=LONGEST_WATCH {
            let is_below = second < self.at_rest_m_s;
            let grows = second > first && second > STILL_M_S;
            if is_below && !grows {
                return Ok(true);
            }
            without_decay = if second < SLOWEST_DECAY * least { 0 } else { without_decay + 1 };
            least = least.min(second);
            if !is_below && without_decay > PATIENCE {
                return Ok(false);
            }
            let Some(next) = rms(half) else { return Ok(false) };
            (first, second) = (second, next);
        }
        Ok(false)
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
    /// compensator and `plant` as the trocar. Tried are 0, 1 and 20 000 N/m, eleven in between and that of `config`; between two
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
        let between = |k: u32| softest + (stiffest - softest) * f64::from(k) / f64::from(TRIED);
        let own = config.tissue.stiffness_n_m;
        let ends = [0.0, own, RANGE_N_M[1]];
        let mut tried: Vec<f64> = (0..TRIED).map(|k| between(k).exp()).chain(ends).collect();
        tried.sort_by(f64::total_cmp);
        let mut config = config.clone();
        let settles = |stiffness: f64| {
            config.tissue.stiffness_n_m = stiffness;
            Trial::default().is_stable(&config, plant, model, config.tissue.surface_m)
        };
        Ok(Some(Self { ranges_n_m: ranges(&tried, settles)? }))
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
