//! How much of the trocar's force to compensate in a loop, and over which delays and fractions it is stable.

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::Trocar;

use super::config::{Config, ConfigError};
use super::merit::{Merit, STIFFNESS_NOTICEABLE};
use super::outcome::Outcome;
use super::stability::{ZWidth, bisect};

/// Largest fraction that is tried, beginning with 0, and the distance of two.
pub const MOST: f64 = 1.5;
const APART: f64 = 0.025;
/// Number of fractions that are tried.
pub(crate) const FRACTIONS: u32 = 61;
/// Tissue up to so many times as stiff is tried for a step that is noticed.
const STIFFEST_STEP: f64 = 10.0;
/// Stiffnesses that are tried up to there, even in their logarithm.
const STEPS_TRIED: u32 = 12;
/// Accuracy of that step, relative to the tissue's stiffness.
const STEP_ACCURACY: f64 = 0.01;

/// Advice on the fraction γ for one loop.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advice {
    /// γ with the least force error among those with which the loop is stable and the tip reaches the tissue; none if there
    /// is none. Where the tip does not reach it, the error tells nothing about what is felt of the tissue.
    pub fraction: Option<f64>,
    /// Intervals of γ, lowest and highest, over which the loop is stable with every pair.
    pub stable: Vec<[f64; 2]>,
    /// Figures with that γ, of the pair with the largest force error.
    pub with: Option<Merit>,
    /// Figures without compensation; none where the loop is then unstable.
    pub without: Option<Merit>,
    /// Each γ that was tried.
    pub tried: Vec<Tried>,
    /// Number of pairs of a compensator's model and a trocar.
    pub pairs: usize,
    /// Lowest and highest of the best γ of each pair by itself: stable, with the least force error. None where no pair has
    /// one.
    pub best: Option<[f64; 2]>,
    /// Least step of the tissue's stiffness that is noticed with that γ, with the first pair ([`noticeable_step`]); none where
    /// there is no such γ.
    pub noticeable_with: Option<NoticeableStep>,
    /// The same without compensation; none where the loop is then unstable.
    pub noticeable_without: Option<NoticeableStep>,
}

/// The least step by which tissue must be stiffer for a person to notice it ([`noticeable_step`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "finding", rename_all = "snake_case")]
pub enum NoticeableStep {
    /// There is one.
    Noticed {
        /// N/m
        step_n_m: f64,
    },
    /// No step up to the largest that is tried is noticed.
    NotNoticed {
        /// The largest that is tried, N/m.
        step_n_m: f64,
    },
    /// The loop is unstable with stiffer tissue before a step is noticed.
    Unstable {
        /// The step from which on it is unstable, N/m.
        step_n_m: f64,
    },
}

impl Advice {
    /// Why there is no fraction.
    pub fn refusal(&self) -> &'static str {
        match self.stable.is_empty() {
            true => "no fraction from 0 to 150 % makes the loop stable",
            false => {
                "no advice: the tip does not reach the tissue with any fraction that makes the loop stable"
            }
        }
    }
}

/// One fraction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tried {
    /// γ
    pub fraction: f64,
    /// Whether the loop is stable with every pair.
    pub stable: bool,
    /// Share of the pairs with which it is, 0 to 1.
    pub stable_share: f64,
    /// Figures of the pair with the largest force error; none where it is not stable.
    pub merit: Option<Merit>,
}

/// Tries the fractions from 0 to 1.5 in `config` with each of `pairs`: the model in the compensator, and the trocar
/// ([`super::candidates`]).
///
/// Stable means: with every pair the loop settles in the tissue of `config` ([`Outcome`]), and runs through
/// the motion of `config` without diverging. `done` is called after each fraction.
///
/// # Errors
/// A value of `config` out of its range.
pub fn advise<K: AsRef<[f64]> + Clone + Sync>(
    config: &Config,
    pairs: &[[Trocar<K>; 2]],
    done: impl Fn() + Sync,
) -> Result<Advice, ConfigError> {
    config.check()?;
    let outcomes = (0..FRACTIONS)
        .into_par_iter()
        .map(|k| {
            let outcomes = outcomes(config, pairs, f64::from(k) * APART);
            done();
            outcomes
        })
        .collect::<Result<Vec<Outcomes>, ConfigError>>()?;
    let tried: Vec<Tried> = outcomes.iter().map(Outcomes::tried).collect();
    let best = tried
        .iter()
        .filter(|t| t.merit.is_some_and(|merit| merit.reaches(config)))
        .min_by(|a, b| error(a.merit).total_cmp(&error(b.merit)));
    let stable = tried.chunk_by(|a, b| a.stable == b.stable).filter(|run| run[0].stable);
    let own = (0..pairs.len()).filter_map(|pair| own_best(config, &outcomes, pair));
    let step = |fraction: f64| match pairs.first() {
        Some([model, plant]) => noticeable_step(&with_fraction(config, fraction), [model, plant]),
        None => Ok(None),
    };
    let without = tried[0].merit.filter(|_| tried[0].stable);
    Ok(Advice {
        fraction: best.map(|best| best.fraction),
        stable: stable.map(|run| [run[0].fraction, run[run.len() - 1].fraction]).collect(),
        with: best.and_then(|best| best.merit),
        without,
        pairs: pairs.len(),
        best: own.fold(None, |range: Option<[f64; 2]>, own| {
            Some(range.map_or([own; 2], |[low, high]| [low.min(own), high.max(own)]))
        }),
        noticeable_with: best.map_or(Ok(None), |best| step(best.fraction))?,
        noticeable_without: without.map_or(Ok(None), |_| step(0.0))?,
        tried,
    })
}

fn error(merit: Option<Merit>) -> f64 {
    merit.map_or(f64::INFINITY, |merit| merit.force_error_rms_n)
}

/// Figures of every pair at one fraction; none where the loop is unstable.
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

/// γ with which the pair of this number is stable and reaches the tissue with the least force error.
fn own_best(config: &Config, outcomes: &[Outcomes], pair: usize) -> Option<f64> {
    let held = outcomes
        .iter()
        .filter(|outcome| outcome.merits[pair].is_some_and(|merit| merit.reaches(config)));
    let best = held.min_by(|a, b| error(a.merits[pair]).total_cmp(&error(b.merits[pair])));
    best.map(|best| best.fraction)
}

fn outcomes<K: AsRef<[f64]> + Clone>(
    config: &Config,
    pairs: &[[Trocar<K>; 2]],
    fraction: f64,
) -> Result<Outcomes, ConfigError> {
    let config = with_fraction(config, fraction);
    let merits = pairs
        .iter()
        .map(|[model, plant]| Outcome::of(&config, [model, plant]).map(|found| found.figures));
    Ok(Outcomes { fraction, merits: merits.collect::<Result<_, _>>()? })
}

/// What becomes of a step of the tissue's stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Felt {
    Alike,
    Different,
    Unstable,
}

/// The least step by which the tissue must be stiffer for the stiffness displayed to differ by 23 %, which a person notices
/// (JONES), with `model` in the compensator and `plant` as the trocar. Twelve stiffnesses up to ten times that of the tissue
/// are tried upwards, and the first change is bisected to within 1 % of the tissue's stiffness. `None` where the tip
/// does not touch the tissue, or the loop is unstable as it is.
///
/// # Errors
/// A value of `config` out of its range.
pub fn noticeable_step<K: AsRef<[f64]> + Clone>(
    config: &Config,
    models: [&Trocar<K>; 2],
) -> Result<Option<NoticeableStep>, ConfigError> {
    let stiffness = config.tissue.stiffness_n_m;
    let figures = |ratio: f64| {
        let mut config = config.clone();
        config.tissue.stiffness_n_m = ratio * stiffness;
        Ok::<_, ConfigError>(Outcome::of(&config, models)?.figures)
    };
    let Some(first) = figures(1.0)?.and_then(|merit| merit.displayed_stiffness_n_m) else {
        return Ok(None);
    };
    let felt = |ratio: f64| {
        Ok::<_, ConfigError>(match figures(ratio)?.map(|merit| merit.displayed_stiffness_n_m) {
            None => Felt::Unstable,
            Some(Some(other)) if (other - first).abs() > STIFFNESS_NOTICEABLE * first.abs() => {
                Felt::Different
            }
            Some(_) => Felt::Alike,
        })
    };
    let tried = |k: u32| STIFFEST_STEP.powf(f64::from(k) / f64::from(STEPS_TRIED));
    for k in 1..=STEPS_TRIED {
        if felt(tried(k))? == Felt::Alike {
            continue;
        }
        let [_, changed] = bisect([tried(k - 1), tried(k)], STEP_ACCURACY, |ratio| {
            Ok::<_, ConfigError>(felt(ratio)? == Felt::Alike)
        })?;
        let step_n_m = (changed - 1.0) * stiffness;
        return Ok(Some(match felt(changed)? {
            Felt::Unstable => NoticeableStep::Unstable { step_n_m },
            _ => NoticeableStep::Noticed { step_n_m },
        }));
    }
    let step_n_m = (STIFFEST_STEP - 1.0) * stiffness;
    Ok(Some(NoticeableStep::NotNoticed { step_n_m }))
}

fn with_fraction(config: &Config, fraction: f64) -> Config {
    let mut config = config.clone();
    config.compensation.fraction = fraction;
    config
}

/// Stiffnesses of the tissue with which a loop is stable, over delays and fractions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Map {
    /// Delays of one direction, s.
    pub delays_s: Vec<f64>,
    /// Fractions γ.
    pub fractions: Vec<f64>,
    /// By delay, then by fraction.
    pub z_width_n_m: Vec<Vec<ZWidth>>,
}

impl Map {
    /// Delay, fraction and stable stiffnesses of each cell, by delay, then by fraction.
    pub fn cells(&self) -> impl Iterator<Item = (f64, f64, &ZWidth)> {
        self.delays_s.iter().zip(&self.z_width_n_m).flat_map(|(delay, row)| {
            self.fractions.iter().zip(row).map(|(fraction, width)| (*delay, *fraction, width))
        })
    }
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
    let mut delays: Vec<f64> = (0..CELLS)
        .map(|k| (samples * f64::from(k) / last).round() * config.sample_time_s)
        .collect();
    delays.dedup();
    delays
}

/// Fractions of a map: 20 from 0 to 1.425.
pub(super) fn map_fractions() -> Vec<f64> {
    (0..CELLS).map(|k| f64::from(FRACTIONS_APART * k) / 1000.0).collect()
}

/// The map of `config` over `delays_s` (s) and `fractions`; of `models` the first is in the compensator, the second the
/// trocar. `done` is called after each cell. Without tissue the map has no cells.
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
        .collect::<Result<Option<Vec<ZWidth>>, ConfigError>>()?;
    let rows = widths.as_deref().unwrap_or_default().chunks(fractions.len().max(1));
    Ok(Map {
        delays_s: delays_s.to_vec(),
        fractions: fractions.to_vec(),
        z_width_n_m: rows.map(<[ZWidth]>::to_vec).collect(),
    })
}
