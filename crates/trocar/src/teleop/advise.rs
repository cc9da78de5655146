//! How much of the trocar's force to take out in a loop, and over which delays and fractions it is stable.

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::Trocar;

use super::config::{Config, ConfigError};
use super::merit::{Merit, STIFFNESS_NOTICEABLE};
use super::outcome::Outcome;
use super::stability::{ZWidth, boundary};

/// Largest fraction that is tried, beginning with 0, and the distance of two.
pub const MOST: f64 = 1.5;
const APART: f64 = 0.025;
/// Tissue up to so many times as stiff is tried for a step that is noticed.
const STIFFEST_STEP: f64 = 10.0;
/// Accuracy of that step, relative to the tissue's stiffness.
const STEP_ACCURACY: f64 = 0.01;

/// Advice on the fraction γ for one loop.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advice {
    /// γ with the least force error among those with which the loop is stable; none if it is never.
    pub fraction: Option<f64>,
    /// Intervals of γ, lowest and highest, over which the loop is stable with every plant.
    pub stable: Vec<[f64; 2]>,
    /// Figures with that γ, of the plant with the largest force error.
    pub with: Option<Merit>,
    /// Figures without compensation; none where the loop is then unstable.
    pub without: Option<Merit>,
    /// Each γ that was tried.
    pub tried: Vec<Tried>,
    /// Number of plants.
    pub plants: usize,
    /// Lowest and highest of the best γ of each plant by itself: stable, with the least force error. None where no plant has
    /// one.
    pub best: Option<[f64; 2]>,
    /// Least step of the tissue's stiffness that is noticed with that γ, N/m, with the first plant
    /// ([`noticeable_step`]); none where there is no such γ or step.
    pub noticeable_with_n_m: Option<f64>,
    /// The same without compensation; none where the loop is then unstable, too.
    pub noticeable_without_n_m: Option<f64>,
}

/// One fraction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tried {
    /// γ
    pub fraction: f64,
    /// Whether the loop is stable with every plant.
    pub stable: bool,
    /// Share of the plants with which it is, 0 to 1.
    pub stable_share: f64,
    /// Figures of the plant with the largest force error; none where it is not stable.
    pub merit: Option<Merit>,
}

/// Tries the fractions from 0 to 1.5 in `config`, with `model` in the compensator and each of `plants` as the
/// trocar, such as draws from the model's intervals.
///
/// Stable means: with every plant the loop settles in the tissue of `config` ([`Outcome`]), and runs through
/// the motion of `config` without diverging.
///
/// # Errors
/// A value of `config` out of its range.
pub fn advise<K: AsRef<[f64]> + Clone + Sync>(
    config: &Config,
    model: &Trocar<K>,
    plants: &[Trocar<K>],
) -> Result<Advice, ConfigError> {
    config.check()?;
    let count = (MOST / APART).round() as u32;
    let outcomes = (0..=count)
        .into_par_iter()
        .map(|k| outcomes(config, model, plants, f64::from(k) * APART))
        .collect::<Result<Vec<Outcomes>, ConfigError>>()?;
    let tried: Vec<Tried> = outcomes.iter().map(Outcomes::tried).collect();
    let best =
        tried.iter().filter(|t| t.stable).min_by(|a, b| error(a.merit).total_cmp(&error(b.merit)));
    let stable = tried.chunk_by(|a, b| a.stable == b.stable).filter(|run| run[0].stable);
    let own = (0..plants.len()).filter_map(|plant| own_best(&outcomes, plant));
    let step = |fraction: f64| match plants.first() {
        Some(plant) => noticeable_step(&with_fraction(config, fraction), [model, plant]),
        None => Ok(None),
    };
    let without = tried[0].merit.filter(|_| tried[0].stable);
    Ok(Advice {
        fraction: best.map(|best| best.fraction),
        stable: stable.map(|run| [run[0].fraction, run[run.len() - 1].fraction]).collect(),
        with: best.and_then(|best| best.merit),
        without,
        plants: plants.len(),
        best: own.fold(None, |range: Option<[f64; 2]>, own| {
            Some(range.map_or([own; 2], |[low, high]| [low.min(own), high.max(own)]))
        }),
        noticeable_with_n_m: best.map_or(Ok(None), |best| step(best.fraction))?,
        noticeable_without_n_m: without.map_or(Ok(None), |_| step(0.0))?,
        tried,
    })
}

fn error(merit: Option<Merit>) -> f64 {
    merit.map_or(f64::INFINITY, |merit| merit.force_error_rms_n)
}

/// Figures of every plant at one fraction; none where the loop is unstable.
struct Outcomes {
    fraction: f64,
    merits: Vec<Option<Merit>>,
}

impl Outcomes {
    fn tried(&self) -> Tried {
        let held = self.merits.iter().flatten().count();
        let stable = held == self.merits.len() && held > 0;
        let worst = self.merits.iter().max_by(|a, b| error(**a).total_cmp(&error(**b)));
        Tried {
            fraction: self.fraction,
            stable,
            stable_share: held as f64 / self.merits.len().max(1) as f64,
            merit: worst.copied().flatten().filter(|_| stable),
        }
    }
}

/// γ with which `plant` is stable with the least force error.
fn own_best(outcomes: &[Outcomes], plant: usize) -> Option<f64> {
    let held = outcomes.iter().filter(|outcome| outcome.merits[plant].is_some());
    let best = held.min_by(|a, b| error(a.merits[plant]).total_cmp(&error(b.merits[plant])));
    best.map(|best| best.fraction)
}

fn outcomes<K: AsRef<[f64]> + Clone>(
    config: &Config,
    model: &Trocar<K>,
    plants: &[Trocar<K>],
    fraction: f64,
) -> Result<Outcomes, ConfigError> {
    let config = with_fraction(config, fraction);
    let merit = |plant: &Trocar<K>| Outcome::of(&config, [model, plant]).map(|found| found.figures);
    Ok(Outcomes { fraction, merits: plants.iter().map(merit).collect::<Result<_, _>>()? })
}

/// The least step by which the tissue must be stiffer for the stiffness displayed to differ by 23 %, which a person notices
/// (JONES), N/m, with `model` in the compensator and `plant` as the trocar. `None` where the tip does not touch the
/// tissue, the loop is unstable, or no step up to ten times the stiffness makes that difference before the loop
/// is unstable with it.
///
/// # Errors
/// A value of `config` out of its range.
pub fn noticeable_step<K: AsRef<[f64]> + Clone>(
    config: &Config,
    models: [&Trocar<K>; 2],
) -> Result<Option<f64>, ConfigError> {
    let stiffness = config.tissue.stiffness_n_m;
    // `None`: the loop is unstable.
    let displayed = |ratio: f64| {
        let mut config = config.clone();
        config.tissue.stiffness_n_m = ratio * stiffness;
        let figures = Outcome::of(&config, models)?.figures;
        Ok::<_, ConfigError>(figures.map(|merit| merit.displayed_stiffness_n_m))
    };
    let Some(Some(first)) = displayed(1.0)? else { return Ok(None) };
    let differs = |other: Option<f64>| {
        other.is_some_and(|other| (other - first).abs() >= STIFFNESS_NOTICEABLE * first.abs())
    };
    let stays = |ratio: f64| Ok(displayed(ratio)?.is_some_and(|other| !differs(other)));
    let found = boundary([1.0, STIFFEST_STEP], STEP_ACCURACY, stays)?;
    // The boundary may be that of stability.
    let Some(ratio) = found else { return Ok(None) };
    let beyond = displayed(ratio + STEP_ACCURACY)?;
    Ok(beyond.filter(|other| differs(*other)).map(|_| (ratio - 1.0) * stiffness))
}

fn with_fraction(config: &Config, fraction: f64) -> Config {
    let mut config = config.clone();
    config.compensation.fraction = fraction;
    config
}

/// Stiffnesses of the tissue with which a loop is stable, over delays and fractions ([`ZWidth`]).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Map {
    /// Delays of one direction, s.
    pub delays_s: Vec<f64>,
    /// Fractions γ.
    pub fractions: Vec<f64>,
    /// Greatest stiffness, N/m, by delay, then by fraction; 0 where the loop is stable with no stiffness that is tried, 20 000
    /// where it is up to there.
    pub stiffness_n_m: Vec<Vec<f64>>,
    /// Least stiffness, N/m; none where the loop is stable with no stiffness that is tried.
    pub least_stiffness_n_m: Vec<Vec<Option<f64>>>,
}

/// Delays and fractions of a map, along each axis.
const CELLS: u32 = 20;
/// Distance of the fractions of a map, in thousandths.
const FRACTIONS_APART: u32 = 75;

/// Delays of a map, s: 20 from 0 to `longest` (s; without it 19 samples), each a whole number of samples, fewer where that makes
/// some equal.
pub fn map_delays(config: &Config, longest: Option<f64>) -> Vec<f64> {
    let last = f64::from(CELLS - 1);
    let samples = longest.map_or(last, |longest| longest / config.sample_time_s);
    let delay = |k: u32| (samples * f64::from(k) / last).round() * config.sample_time_s;
    let mut delays: Vec<f64> = (0..CELLS).map(delay).collect();
    delays.dedup();
    delays
}

/// Fractions of a map: 20 from 0 to 1.425.
pub fn map_fractions() -> Vec<f64> {
    (0..CELLS).map(|k| f64::from(FRACTIONS_APART * k) / 1000.0).collect()
}

/// The map of `config` over `delays_s` (s) and `fractions`; of `models` the first is in the compensator, the second the
/// trocar.
/// `done` is called after each cell.
///
/// # Errors
/// A value of `config` or a delay out of its range.
pub fn map<K: AsRef<[f64]> + Clone + Sync>(
    config: &Config,
    models: [&Trocar<K>; 2],
    delays_s: &[f64],
    fractions: &[f64],
    done: impl Fn() + Sync,
) -> Result<Map, ConfigError> {
    let cells = delays_s.len() * fractions.len();
    let widths = (0..cells)
        .into_par_iter()
        .map(|cell| {
            let mut config = with_fraction(config, fractions[cell % fractions.len()]);
            config.channel.delay_s = delays_s[cell / fractions.len()];
            let width = ZWidth::of(&config, models);
            done();
            width
        })
        .collect::<Result<Vec<Option<ZWidth>>, ConfigError>>()?;
    let rows = || widths.chunks(fractions.len().max(1));
    let greatest = |width: &Option<ZWidth>| width.map_or(0.0, |width| width.greatest_n_m);
    let least = |width: &Option<ZWidth>| width.map(|width| width.least_n_m);
    Ok(Map {
        delays_s: delays_s.to_vec(),
        fractions: fractions.to_vec(),
        stiffness_n_m: rows().map(|row| row.iter().map(greatest).collect()).collect(),
        least_stiffness_n_m: rows().map(|row| row.iter().map(least).collect()).collect(),
    })
}
