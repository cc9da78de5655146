//! The fit of one classical model, with intervals and warnings.

use std::sync::Arc;

use nalgebra::DMatrix;
use rayon::prelude::*;
use trocar_model::{ClassicalState, Passivity, SlipRate};

use crate::estimate::Estimate;
use crate::findings::{Parameter, Warning};
use crate::likelihood::{self, Column, Fitted, Free, Stop, Trial};
use crate::spread::{Reported, Spread};
use crate::training::{Step, Training};
use trocar_model::Classical;

use super::banks::from_kin;
use super::coordinate::{self, Coordinate, reported};
use super::data::ClassicalData;
use super::elements::Elements;
use super::family::Related;
use super::kind::Kind;

/// Starts with the least errors that are fitted at all.
const STARTS: usize = 6;
/// Rounds of fits in longer steps: the stopping criteria of each, and how many go on.
const SEARCH: [(Stop, usize); 3] =
    [(Stop { iterations: 3, ..SHORT }, 4), (SHORT, 2), (Stop { iterations: 20, ..LONG }, 1)];
pub(crate) const SHORT: Stop = Stop { iterations: 6, fall: 1e-3, promise: f64::INFINITY };
pub(crate) const LONG: Stop = Stop { iterations: 60, fall: 1e-6, promise: f64::INFINITY };
/// Largest relative decrease of the squared error still predicted for a fit that counts as
/// converged.
const WORST_PROMISE: f64 = 2e-3;
/// Scale of a parameter in steps of its difference quotient.
const SCALE: f64 = 1e4;

/// A classical model identified from the recordings.
#[derive(Debug, Clone)]
pub struct ClassicalFit {
    /// Which model.
    pub kind: Kind,
    /// The model, ready to run.
    pub model: Classical,
    /// Sensor offset F_0, N.
    pub offset: f64,
    /// All parameters with intervals, including the sensor offset.
    pub parameters: Vec<Parameter>,
    /// Root mean square error, N, over the steps fitted.
    pub rms: f64,
    /// Warnings about the result.
    pub warnings: Vec<Warning>,
    /// The free parameters, the offset first: a start for a larger model of the family.
    numbers: Vec<f64>,
}

/// A classical model under trial; logarithms where the fit uses them.
#[derive(Debug, Clone)]
pub(super) struct ClassicalTrial {
    kind: Kind,
    coordinates: Arc<[Coordinate]>,
    values: Vec<f64>,
}

impl ClassicalTrial {
    /// A trial at `numbers`, each clamped to its range.
    pub(super) fn new(kind: Kind, coordinates: &Arc<[Coordinate]>, numbers: &[f64]) -> Self {
        let values = numbers.iter().zip(coordinates.iter()).map(|(x, c)| {
            let held = x.clamp(c.range[0], c.range[1]);
            if c.log { held.ln() } else { held }
        });
        Self { kind, coordinates: coordinates.clone(), values: values.collect() }
    }

    /// The parameter values, the offset first.
    fn numbers(&self) -> Vec<f64> {
        let all = self.values.iter().zip(self.coordinates.iter());
        all.map(|(u, c)| if c.log { u.exp() } else { *u }).collect()
    }

    fn range(coordinate: &Coordinate) -> [f64; 2] {
        if coordinate.log { coordinate.range.map(f64::ln) } else { coordinate.range }
    }
}

impl Trial for ClassicalTrial {
    type Model = Classical;
    type Followers = Elements;

    fn model(&self) -> Option<Classical> {
        self.kind.build(&self.numbers()[1..]).ok()
    }

    fn free(&self) -> Vec<Free> {
        let bank = self.kind.bank();
        let of = |(j, (value, c)): (usize, (&f64, &Coordinate))| {
            let [low, high] = Self::range(c);
            let followed = bank.and_then(|bank| bank.followed(j));
            Free {
                kind: None,
                value: *value,
                step: c.step,
                low,
                high,
                expected: f64::INFINITY,
                column: followed.map_or(Column::Simulated, Column::Followed),
            }
        };
        let numbers = self.values.iter().zip(self.coordinates.iter());
        let mut free: Vec<Free> = numbers.enumerate().map(of).collect();
        free[0].column = Column::Offset;
        free
    }

    fn with(&self, values: &[f64]) -> Self {
        let within = values.iter().zip(self.coordinates.iter()).map(|(u, c)| {
            let [low, high] = Self::range(c);
            u.clamp(low, high)
        });
        self.with_any(&within.collect::<Vec<_>>())
    }

    fn with_any(&self, values: &[f64]) -> Self {
        Self { values: values.to_vec(), ..self.clone() }
    }

    fn offset(&self) -> f64 {
        self.values[0]
    }

    fn followers(&self) -> Elements {
        Elements::new(self.kind.bank(), &self.numbers())
    }

    fn follow(
        elements: &mut Elements,
        model: &Classical,
        state: &mut ClassicalState,
        steps: &[Step],
    ) -> DMatrix<f64> {
        elements.follow(model, state, steps)
    }
}

/// What a fit may start from, and what it is for.
#[derive(Clone, Copy, Default)]
pub struct RelatedFits<'a> {
    /// Same family with one element less.
    pub smaller: Option<&'a ClassicalFit>,
    /// Fit of [`Kind::special`].
    pub special: Option<&'a ClassicalFit>,
    /// Error, N, above which a model after short fits is not fitted further.
    pub most: Option<f64>,
}

/// Fits one model, from starts derived from the data and from its special cases.
///
/// Only the best of the starts are fitted, and only the best of these to convergence. Of banks, a start
/// from a special case has its error, so none ends with a larger error than a smaller one.
///
/// # Errors
/// A message when no start gives a model that runs, or none within [`RelatedFits::most`].
pub fn fit(kind: Kind, data: &ClassicalData, kin: RelatedFits) -> Result<ClassicalFit, String> {
    let special = match (kin.special, kind.special()) {
        (None, Some(special)) => fit(special, data, RelatedFits::default()).ok(),
        _ => None,
    };
    let related = Related {
        smaller: kin.smaller.map(|fit| &*fit.numbers),
        special: kin.special.or(special.as_ref()).map(|fit| &*fit.numbers),
    };
    let coordinates: Arc<[Coordinate]> = kind.coordinates(&data.scales).into();
    let trials = |starts: Vec<Vec<f64>>| -> Vec<ClassicalTrial> {
        starts.iter().map(|numbers| ClassicalTrial::new(kind, &coordinates, numbers)).collect()
    };
    let from_kin = trials(from_kin(kind.bank(), data, related));
    let starts = [trials(kind.starts(data, related)), from_kin.clone()].concat();
    let mut from = cheapest(&data.search, starts, STARTS);
    let fitted = |(_, from): &(f64, ClassicalTrial), stop| {
        likelihood::fit(&data.search, from, stop).map(|fit| (fit.rms[1], fit.best))
    };
    for (round, (stop, count)) in SEARCH.into_iter().enumerate() {
        from = least(from.par_iter().filter_map(|from| fitted(from, stop)).collect(), count);
        let most = kin.most.filter(|_| round > 0).unwrap_or(f64::INFINITY);
        if from.first().is_some_and(|(error, _)| *error > most) {
            return Err(format!("its error is above {most} N"));
        }
    }
    let finalists = from.into_iter().map(|(_, trial)| trial).chain(from_kin).collect();
    let best = cheapest(&data.training, finalists, 1).pop();
    let found = best.and_then(|(_, from)| likelihood::fit(&data.training, &from, LONG));
    let found = found.ok_or("no initial values gave a model that runs")?;
    let model = found.best.model().ok_or("the best parameters form no valid model")?;
    let parameters = parameters(&found);
    let mut warnings = doubts(&found, &parameters);
    warnings.extend(energy_warning(&model));
    Ok(ClassicalFit {
        kind,
        model,
        offset: found.best.offset(),
        parameters,
        rms: found.rms[1],
        warnings,
        numbers: found.best.numbers(),
    })
}

/// The `count` trials with the least costs, with these.
fn cheapest(
    training: &Training,
    trials: Vec<ClassicalTrial>,
    count: usize,
) -> Vec<(f64, ClassicalTrial)> {
    let of = |trial: ClassicalTrial| (likelihood::cost(training, &trial), trial);
    least(trials.into_par_iter().map(of).collect(), count)
}

/// The `count` with the least errors, of trials with theirs.
fn least(mut all: Vec<(f64, ClassicalTrial)>, count: usize) -> Vec<(f64, ClassicalTrial)> {
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all.truncate(count);
    all
}

fn parameters(found: &Fitted<ClassicalTrial>) -> Vec<Parameter> {
    let best = &found.best;
    let spread = Spread::new(found);
    let estimate = |q: coordinate::Reported| {
        let of = |t: &ClassicalTrial| (q.of)(&t.numbers());
        let numbers = best.numbers();
        let change = |j: &usize| {
            let mut moved = numbers.clone();
            moved[*j] += SCALE * best.coordinates[*j].step;
            if q.log { moved[*j] - numbers[*j] } else { (q.of)(&moved) - (q.of)(&numbers) }
        };
        let scale = q.from.iter().map(change).fold(0.0, f64::max);
        let how = Reported {
            unit: q.id.unit().si,
            log: q.log,
            scale,
            least: q.least(&numbers),
            factor: 1.0,
        };
        let estimate = match q.from.iter().any(|j| found.held[*j]) {
            true => Estimate::undetermined(
                of(best),
                q.id.unit().si,
                "the fit holds it at an end of its range",
            ),
            false => spread.estimate(how, &of),
        };
        Parameter::new(q.id, estimate)
    };
    reported(best.kind.bank(), &best.coordinates).into_iter().map(estimate).collect()
}

/// Warnings about a fit: lack of convergence, and parameters that the data do not determine.
pub(crate) fn doubts<T: Trial>(found: &Fitted<T>, parameters: &[Parameter]) -> Vec<Warning> {
    let unrest = unrest(found).map(|message| Warning::doubt("fit", message));
    let mut all: Vec<Warning> = unrest.into_iter().collect();
    let undetermined = parameters.iter().filter(|p| !p.estimate.determined);
    // Of a model with few numbers each matters.
    all.extend(undetermined.map(|p| Warning { doubtful: true, ..Warning::undetermined(p) }));
    all
}

/// Why a fit has not converged; `None` if it has.
fn unrest<T: Trial>(found: &Fitted<T>) -> Option<String> {
    if !found.converged {
        return Some(format!("the fit did not converge in {} iterations", found.iterations));
    }
    let promised = found.promised_fall();
    (promised > WORST_PROMISE).then(|| {
        format!(
            "the fit did not converge: a further decrease of {:.1} % of the squared error is predicted",
            1e2 * promised
        )
    })
}

/// Warning about the passivity of the model.
fn energy_warning(model: &Classical) -> Option<Warning> {
    let message = match model {
        Classical::LuGre(lugre) => match lugre.passivity() {
            Passivity::Passive => return None,
            Passivity::NotGuaranteed { viscous_damping_needed, damping_velocity_needed } => format!(
                "may give back more energy than it was given: passive from a viscous damping of {viscous_damping_needed:.3} N s/m on, or with \
                 micro-damping that fades over {damping_velocity_needed:.4} m/s"
            ),
        },
        Classical::Gms(gms) if !gms.sliding().is_constant() && gms.slip_rate() == SlipRate::Free => {
            "can yield energy, since its static force exceeds the Coulomb force; limit its slip rate where that matters"
                .to_owned()
        }
        _ => return None,
    };
    Some(Warning::remark("energy", message))
}
