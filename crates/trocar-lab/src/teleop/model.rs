//! Trocars of a model file for a loop.

use trocar_model::{Element, ParamError, Seal, Stages, Trocar, Tunable};

use trocar_runtime::model_file::ModelFile;
use trocar_simulate::bench::noise::{Noise, Source};
use trocar_simulate::many::evenly;

/// Which trocars and which models in the compensator advice is for, besides the models themselves.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidates {
    /// Draws of the trocar from the 95 % intervals of its model, or from its posterior.
    pub draws: usize,
    /// Posterior draws of the trocar's model, in place of the ends of its intervals and of draws from them. They have the
    /// covariance of the parameters.
    pub posterior: Option<Vec<Stages>>,
    /// Draws of the compensator's model from its 95 % intervals.
    pub compensator_draws: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Least friction scale of the trocar, above 0, at most 1: wetting lowers the friction of a seal by 15 to 45 %, more than
    /// the intervals of its model cover.
    pub least_friction_scale: f64,
}

impl Default for Candidates {
    /// The models and the ends of the intervals of the trocar's.
    fn default() -> Self {
        Self { draws: 0, posterior: None, compensator_draws: 0, seed: 1, least_friction_scale: 1.0 }
    }
}

/// Pairs of a compensator's model and a trocar, of the files `compensator` and `plant`. The first pair is that of the files. In
/// the following ones
///
/// - the trocar has all parameters that have a 95 % interval at its lower and at its upper end,
/// - the trocar is drawn from these intervals,
/// - or, in place of both, the trocar is one of the posterior draws,
/// - the trocar is at the least friction scale ([`scaled`]) and halfway to it,
/// - the compensator's model is drawn from its own intervals; if there are such draws, also at their lower and upper ends.
///
/// All parameters at the same end is more than the intervals of single parameters claim together: a loop that is
/// stable at both ends has some margin. In a draw each parameter with an interval is drawn from a normal distribution that has
/// this interval, each side by itself; a draw that makes no model is drawn again. Parameters are drawn independently,
/// since a model file holds no covariance: that exaggerates the scatter of what depends on several of them.
///
/// # Errors
/// Parameters that make no model: at an end of their intervals, in a thousand draws in a row, or at the friction scale.
pub fn candidates(
    [compensator, plant]: [&ModelFile; 2],
    wanted: &Candidates,
) -> Result<Vec<[Trocar<Vec<f64>>; 2]>, ParamError> {
    let mut plants = match &wanted.posterior {
        Some(draws) => {
            let drawn = evenly(draws, wanted.draws).into_iter();
            let drawn = drawn.map(|draw| plant.trocar.with_seal(draw.into()));
            std::iter::once(plant.trocar.clone()).chain(drawn).collect()
        }
        None => within_intervals(plant, wanted.draws, &mut Noise::new(wanted.seed, Source::Draws))?,
    };
    plants.extend(wetted(&plant.trocar, wanted.least_friction_scale)?);
    let models = match wanted.compensator_draws {
        0 => Vec::new(),
        count => {
            let mut noise = Noise::new(wanted.seed, Source::CompensatorDraws);
            within_intervals(compensator, count, &mut noise)?
        }
    };
    let of_plants = plants.into_iter().map(|plant| [compensator.trocar.clone(), plant]);
    // The first model is that of the file, which all trocars have met.
    let of_models = models.into_iter().skip(1).map(|model| [model, plant.trocar.clone()]);
    Ok(of_plants.chain(of_models).collect())
}

/// The trocar of `file`, those at both ends of its intervals, and draws from them.
fn within_intervals(
    file: &ModelFile,
    draws: usize,
    noise: &mut Noise,
) -> Result<Vec<Trocar<Vec<f64>>>, ParamError> {
    let mut trocars = vec![file.trocar.clone()];
    for index in [0, 1] {
        let end = at_end(file, index)?;
        if end != file.trocar {
            trocars.push(end);
        }
    }
    for _ in 0..draws {
        trocars.push(drawn(file, noise)?);
    }
    Ok(trocars)
}

/// `trocar` at the friction scale `least` and halfway to it; none at 1.
fn wetted(trocar: &Trocar<Vec<f64>>, least: f64) -> Result<Vec<Trocar<Vec<f64>>>, ParamError> {
    let scales = [0.5 * (1.0 + least), least].into_iter().filter(|_| least < 1.0);
    scales.map(|scale| scaled(trocar, scale)).collect()
}

/// The trocar of `file` with all its intervals at their lower (0) or upper (1) end.
fn at_end(file: &ModelFile, index: usize) -> Result<Trocar<Vec<f64>>, ParamError> {
    let seal = file.trocar.seal();
    let values = seal.tunables().map(|Tunable { id, value }| {
        let interval = file.intervals.get(&id.to_string());
        interval.and_then(|interval| interval.ci95[index]).unwrap_or(value)
    });
    Ok(file.trocar.with_seal(seal.tuned(&values.collect::<Vec<_>>())?))
}

fn drawn(file: &ModelFile, noise: &mut Noise) -> Result<Trocar<Vec<f64>>, ParamError> {
    let mut tried = drawn_seal(file, noise);
    for _ in 1..MOST_DRAWS {
        if tried.is_ok() {
            break;
        }
        tried = drawn_seal(file, noise);
    }
    Ok(file.trocar.with_seal(tried?))
}

fn drawn_seal(file: &ModelFile, noise: &mut Noise) -> Result<Seal, ParamError> {
    let seal = file.trocar.seal();
    let values = seal.tunables().map(|Tunable { id, value }| {
        let [low, high] = file.intervals.get(&id.to_string()).map_or([None; 2], |i| i.ci95);
        let deviate = noise.normal();
        let end = if deviate < 0.0 { low } else { high };
        end.map_or(value, |end| value + deviate.abs() * (end - value) / NORMAL_95)
    });
    seal.tuned(&values.collect::<Vec<_>>())
}

/// Draws in a row that may make no model.
const MOST_DRAWS: u32 = 1000;
/// 95 % quantile of a normal distribution, two-sided.
const NORMAL_95: f64 = 1.96;

/// The trocar with the friction scale λ = `scale`, above 0: its seal has the force λ·F(x/λ), as that of a seal once it is wetted
/// (`docs/explanation/compensation.md`); viscous damping and the offset of its profile stay.
///
/// # Errors
/// Parameters that make no model at this scale.
pub fn scaled<K: AsRef<[f64]> + Clone>(
    trocar: &Trocar<K>,
    scale: f64,
) -> Result<Trocar<K>, ParamError> {
    let seal = trocar.seal();
    // Forces and lengths are proportional to λ.
    let values = seal.tunables().map(|Tunable { id, value }| match id.unit().si {
        "N" | "m" | "m/s" | "N/s" => value * scale,
        _ => value,
    });
    let seal = match seal.tuned(&values.collect::<Vec<_>>())? {
        Seal::Ems(stages) => with_damping_at(&stages, scale)?,
        other => other,
    };
    Ok(trocar.with_seal(seal))
}

/// Seal damping that depends on the speed: of its polynomial only the first coefficient is tunable.
fn with_damping_at(stages: &Stages, scale: f64) -> Result<Seal, ParamError> {
    let elements = stages
        .elements()
        .iter()
        .map(|element| {
            let mut params = *element.params();
            let [s0, s1, s2] = params.damping.coefficients;
            params.damping.coefficients = [s0, s1 / scale, s2 / (scale * scale)];
            Element::new(params)
        })
        .collect::<Result<Vec<Element>, ParamError>>()?;
    Ok(Seal::Ems(Stages::new(&elements).expect("as many elements as before")))
}
