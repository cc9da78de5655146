//! How much of the trocar's force to take out in a loop, and over which delays and fractions it is stable.

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::Trocar;

use super::config::{Config, ConfigError};
use super::merit::Merit;
use super::simulation::Loop;
use super::stability::{Trial, boundary};

/// Fractions that are tried, from 0, and their distance.
const MOST: f64 = 1.5;
const APART: f64 = 0.025;
/// Stiffest tissue that is tried, N/m, and the softest.
const STIFFEST: f64 = 20_000.0;
const SOFTEST: f64 = 1.0;
/// Stiffnesses in between, evenly in their logarithm.
const TRIED: u32 = 12;
/// Accuracy of a stiffness, relative.
const ACCURACY: f64 = 0.02;

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
}

/// One fraction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tried {
    /// γ
    pub fraction: f64,
    /// Whether the loop is stable with every plant.
    pub stable: bool,
    /// Figures of the plant with the largest force error; none where it is not stable.
    pub merit: Option<Merit>,
}

/// Tries the fractions from 0 to 1.5 in `config`, with `model` in the compensator and each of `plants` as the
/// trocar, such as draws from the model's intervals.
///
/// Stable means: with every plant the loop settles in the tissue of `config` ([`Trial`]), and runs through
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
    let tried = (0..=count)
        .into_par_iter()
        .map(|k| attempt(config, model, plants, f64::from(k) * APART))
        .collect::<Result<Vec<Tried>, ConfigError>>()?;
    let error = |tried: &Tried| tried.merit.map_or(f64::INFINITY, |merit| merit.force_error_rms_n);
    let best = tried.iter().filter(|t| t.stable).min_by(|a, b| error(a).total_cmp(&error(b)));
    let stable = tried.chunk_by(|a, b| a.stable == b.stable).filter(|run| run[0].stable);
    Ok(Advice {
        fraction: best.map(|best| best.fraction),
        stable: stable.map(|run| [run[0].fraction, run[run.len() - 1].fraction]).collect(),
        with: best.and_then(|best| best.merit),
        without: tried[0].merit.filter(|_| tried[0].stable),
        tried,
    })
}

fn attempt<K: AsRef<[f64]> + Clone>(
    config: &Config,
    model: &Trocar<K>,
    plants: &[Trocar<K>],
    fraction: f64,
) -> Result<Tried, ConfigError> {
    let config = with_fraction(config, fraction);
    let mut worst: Option<Merit> = None;
    for plant in plants {
        let is_stable =
            Trial::default().is_stable(&config, plant, model, config.tissue.surface_m)?;
        let Some(merit) = figures(&config, model, plant)?.filter(|_| is_stable) else {
            return Ok(Tried { fraction, stable: false, merit: None });
        };
        if worst.is_none_or(|worst| merit.force_error_rms_n > worst.force_error_rms_n) {
            worst = Some(merit);
        }
    }
    Ok(Tried { fraction, stable: worst.is_some(), merit: worst })
}

/// Figures along the motion of `config`; `None` where the loop diverges.
fn figures<K: AsRef<[f64]> + Clone>(
    config: &Config,
    model: &Trocar<K>,
    plant: &Trocar<K>,
) -> Result<Option<Merit>, ConfigError> {
    let samples = Loop::new(config, plant.clone(), model.clone(), config.motion.start_m())?
        .run(config.samples(), |time| config.motion.at(time));
    Ok(samples.ok().map(|samples| Merit::of(config, &samples)))
}

fn with_fraction(config: &Config, fraction: f64) -> Config {
    let mut config = config.clone();
    config.compensation.fraction = fraction;
    config
}

/// Greatest stiffness of the tissue at which a loop is stable, over delays and fractions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Map {
    /// Delays of one direction, s.
    pub delays_s: Vec<f64>,
    /// Fractions γ.
    pub fractions: Vec<f64>,
    /// Greatest stiffness, N/m, by delay, then by fraction; 0 where the loop is not even stable with
    /// tissue of 1 N/m, 20 000 where it is up to there.
    pub stiffness_n_m: Vec<Vec<f64>>,
}

/// The map of `config` over `delays_s` (s) and `fractions`, with `model` in the compensator and `plant` as the trocar.
/// `done` is called after each cell.
///
/// # Errors
/// A value of `config` or a delay out of its range.
pub fn map<K: AsRef<[f64]> + Clone + Sync>(
    config: &Config,
    [model, plant]: [&Trocar<K>; 2],
    delays_s: &[f64],
    fractions: &[f64],
    done: impl Fn() + Sync,
) -> Result<Map, ConfigError> {
    let cells = delays_s.len() * fractions.len();
    let values = (0..cells)
        .into_par_iter()
        .map(|cell| {
            let mut config = with_fraction(config, fractions[cell % fractions.len()]);
            config.channel.delay_s = delays_s[cell / fractions.len()];
            let value = greatest_stiffness(&config, model, plant);
            done();
            value
        })
        .collect::<Result<Vec<f64>, ConfigError>>()?;
    Ok(Map {
        delays_s: delays_s.to_vec(),
        fractions: fractions.to_vec(),
        stiffness_n_m: values.chunks(fractions.len().max(1)).map(<[f64]>::to_vec).collect(),
    })
}

/// Greatest stiffness of the tissue, N/m, up to which the loop settles: 0 where it does not with tissue of
/// 1 N/m, 20 000 where it does up to there. Twelve stiffnesses in between are tried upwards, and the first
/// change is bisected.
///
/// # Errors
/// A value of `config` out of its range.
pub fn greatest_stiffness<K: AsRef<[f64]> + Clone>(
    config: &Config,
    model: &Trocar<K>,
    plant: &Trocar<K>,
) -> Result<f64, ConfigError> {
    config.check()?;
    let settles = |stiffness: f64| {
        let mut config = config.clone();
        config.tissue.stiffness_n_m = stiffness;
        let tried = Trial::default().is_stable(&config, plant, model, config.tissue.surface_m);
        tried.is_ok_and(|is_stable| is_stable)
    };
    if !settles(SOFTEST) {
        return Ok(0.0);
    }
    let ratio = (STIFFEST / SOFTEST).ln() / f64::from(TRIED);
    let tried = (1..=TRIED).map(|k| SOFTEST.ln() + ratio * f64::from(k));
    let Some(above) = tried.into_iter().find(|log| !settles(log.exp())) else {
        return Ok(STIFFEST);
    };
    let found = boundary([above - ratio, above], ACCURACY, |log| settles(log.exp()));
    Ok(found.unwrap_or(above).exp())
}
