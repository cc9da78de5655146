//! Which ingredients the held-out cycles ask for.

use serde::Serialize;

use super::super::candidate::EmsTrial;
use super::super::output_error::{self, Fitted, Stop};
use super::super::training::Training;
use super::ingredient::Ingredient;

/// Fewest clusters that can tell one model from another.
const FEWEST_CLUSTERS: f64 = 4.0;
/// Parts in which clusters are held out.
const FOLDS: usize = 4;
/// An ingredient is kept if the squares held out grow without it by this part at least...
const LEAST_GAIN: f64 = 0.02;
/// ...and by this many standard errors of the growth over clusters.
const LEAST_SURETY: f64 = 2.0;

/// Held-out squares over fitted ones beyond which the first order is not believed, and the fold is fitted in full.
const FAR_OFF: f64 = 2.0;

/// The first fit, and those that start next to it.
const FIRST: Stop = Stop { iterations: 40, fall: 1e-4 };
const SHORT: Stop = Stop { iterations: 4, fall: 1e-2 };
const FOLD: Stop = Stop { iterations: 6, fall: 1e-2 };
const NEXT: Stop = Stop { iterations: 12, fall: 1e-3 };
const LAST: Stop = Stop { iterations: 40, fall: 1e-5 };

/// An ingredient on trial.
#[derive(Debug, Clone, Serialize)]
pub struct IngredientTrial {
    /// Which.
    pub ingredient: Ingredient,
    /// Whether the model has it.
    pub kept: bool,
    /// Root mean square error, N, on held-out cycles with it...
    pub held_out_with_n: f64,
    /// ...and without it: all that the table has above it, for those tried on top of the others, else all others.
    pub held_out_without_n: f64,
    /// Growth of the held-out squares without it, in standard errors over the cycles.
    pub surety: f64,
    /// Numbers it adds.
    pub parameters: usize,
}

impl IngredientTrial {
    fn new(ingredient: Ingredient, with: &Scored, without: &Scored) -> Self {
        let (growth, surety) = without.growth(with);
        let numbers = |scored: &Scored| scored.fitted.best.free_numbers();
        Self {
            ingredient,
            kept: is_better((growth, surety)),
            held_out_with_n: with.rms(),
            held_out_without_n: without.rms(),
            surety,
            parameters: numbers(with).saturating_sub(numbers(without)),
        }
    }
}

/// How the fit to all motion came out.
#[derive(Debug, Clone, Serialize)]
pub struct MotionFit {
    /// Each ingredient.
    pub ingredients: Vec<IngredientTrial>,
    /// Root mean square error, N, on held-out cycles with all ingredients.
    pub held_out_all_n: f64,
    /// The same of the model chosen.
    pub held_out_chosen_n: f64,
    /// The same of the paper's element alone, fitted to the same readings.
    pub held_out_paper_n: f64,
    /// Root mean square error, N, of the model chosen over the readings it was fitted to.
    pub fitted_rms_n: f64,
    /// Damped steps of the last fit.
    pub iterations: usize,
    /// Whether it came to rest.
    pub converged: bool,
}

/// A fit with its held-out squares by cluster.
#[derive(Clone)]
struct Scored {
    fitted: Fitted<EmsTrial>,
    held_out: Vec<f64>,
}

impl Scored {
    fn new(training: &Training, from: &EmsTrial, stop: Stop) -> Option<Self> {
        let fitted = output_error::fit(training, from, stop)?;
        let mut held_out = vec![0.0; training.clusters()];
        let own = output_error::costs(training, &fitted.best)?;
        for fold in 0..FOLDS {
            let out = |g: &usize| g % FOLDS == fold;
            let sum = |costs: &[f64]| (0..costs.len()).filter(out).map(|g| costs[g]).sum::<f64>();
            let first_order = fitted.without(&fitted.best, |g| out(&g));
            let mut costs = first_order.and_then(|part| output_error::costs(training, &part));
            let close = |costs: &Vec<f64>| sum(costs) < FAR_OFF * sum(&own);
            if !costs.as_ref().is_some_and(close) {
                let part = output_error::fit(&training.without(|g| out(&g)), &fitted.best, FOLD)?;
                costs = output_error::costs(training, &part.best);
            }
            let costs = costs?;
            (0..held_out.len()).filter(out).for_each(|g| held_out[g] = costs[g]);
        }
        Some(Self { fitted, held_out })
    }

    fn total(&self) -> f64 {
        self.held_out.iter().sum()
    }

    fn rms(&self) -> f64 {
        (self.total() / self.fitted.weight()).sqrt()
    }

    /// Growth of the held-out squares from `other` to this, as a part of the other's, and in its standard errors.
    fn growth(&self, other: &Self) -> (f64, f64) {
        // Clusters without a sample that is scored tell nothing.
        let scored = self.held_out.iter().zip(&other.held_out).filter(|(a, b)| **a > 0.0 || **b > 0.0);
        let differences: Vec<f64> = scored.map(|(a, b)| a - b).collect();
        let sum: f64 = differences.iter().sum();
        let n = differences.len() as f64;
        if n < FEWEST_CLUSTERS {
            return (0.0, 0.0);
        }
        let variance = differences.iter().map(|d| (d - sum / n).powi(2)).sum::<f64>() * n / (n - 1.0).max(1.0);
        (sum / other.total(), sum / variance.sqrt().max(f64::MIN_POSITIVE))
    }
}

/// What the fit to all motion gives.
pub(in super::super) struct Chosen {
    pub(in super::super) fitted: Fitted<EmsTrial>,
    pub(in super::super) summary: MotionFit,
}

/// Fits the element with all ingredients but those `excluded`, drops those that do not earn their keep, and fits what is
/// left.
///
/// `start` is an element of the paper. `None` when it makes no model that runs.
pub(super) fn choose(training: &Training, start: &EmsTrial, excluded: &[Ingredient]) -> Option<Chosen> {
    let bare =
        excluded.iter().filter(|i| i.is_in(&start.layout)).try_fold(start.clone(), |trial, i| i.remove(&trial))?;
    let paper = Scored::new(training, &bare, NEXT)?;
    let allowed = |i: &Ingredient| !excluded.contains(i);
    // All at once, since some only pay together; one by one where that leads nowhere.
    let together = with_base(training, &paper.fitted.best, excluded, FIRST).filter(|all| all.total() < paper.total());
    let together = together.map(|single| staged(training, &paper, excluded, &single).unwrap_or(single));
    let one_by_one = together.is_none();
    let mut all = together.unwrap_or(paper.clone());
    let mut ingredients = Vec::new();
    let base = Ingredient::ALL.into_iter().filter(|i| one_by_one && !Ingredient::LARGER.contains(i));
    let on_top = base.chain(Ingredient::LARGER);
    for ingredient in on_top.filter(allowed) {
        let Some((larger, trial)) = enlarged(training, &all, ingredient) else { continue };
        if trial.kept {
            all = larger;
        }
        ingredients.push(trial);
    }
    let mut chosen = all.fitted.best.clone();
    if !one_by_one {
        let (smaller, pruned) = pruned(training, &all);
        chosen = smaller;
        // What was kept on top is judged once more with everything else in place.
        ingredients.retain(|own: &IngredientTrial| pruned.iter().all(|p| p.ingredient != own.ingredient));
        ingredients.extend(pruned);
    }
    let mut last = Scored::new(training, &chosen, LAST)?;
    // Several that can be spared one at a time may not be spared together.
    if is_better(last.growth(&all)) {
        ingredients.iter_mut().filter(|t| t.ingredient.is_in(&all.fitted.best.layout)).for_each(|t| t.kept = true);
        last = Scored::new(training, &all.fitted.best, LAST)?;
    }
    let summary = MotionFit {
        ingredients,
        held_out_all_n: all.rms(),
        held_out_chosen_n: last.rms(),
        held_out_paper_n: paper.rms(),
        fitted_rms_n: last.fitted.rms[1],
        iterations: last.fitted.iterations,
        converged: last.fitted.converged,
    };
    Some(Chosen { fitted: last.fitted, summary })
}

/// The fit with all ingredients that are not only tried on top.
fn with_base(training: &Training, from: &EmsTrial, excluded: &[Ingredient], stop: Stop) -> Option<Scored> {
    let base = Ingredient::ALL.into_iter().filter(|i| !excluded.contains(i) && !Ingredient::LARGER.contains(i));
    let start = base.fold(from.clone(), |trial, i| i.starts(&trial).pop().unwrap_or(trial));
    Scored::new(training, &start, stop)
}

/// The same with a second stage, from the beginning or on top, where that is better: one element leads astray what two would
/// be, and two what one has found.
fn staged(training: &Training, paper: &Scored, excluded: &[Ingredient], single: &Scored) -> Option<Scored> {
    if excluded.contains(&Ingredient::SecondStage) {
        return None;
    }
    let divided = best_of(training, &Ingredient::SecondStage.starts(&paper.fitted.best));
    let from_start = divided.and_then(|start| with_base(training, &start, excluded, NEXT));
    let on_top = enlarged(training, single, Ingredient::SecondStage).map(|(larger, _)| larger);
    let both = [from_start, on_top].into_iter().flatten();
    let staged = both.min_by(|a, b| a.total().total_cmp(&b.total()))?;
    is_better(single.growth(&staged)).then(|| finer(training, &staged).unwrap_or(staged))
}

/// The fit with one ingredient more; `None` where it cannot be added.
fn enlarged(training: &Training, all: &Scored, ingredient: Ingredient) -> Option<(Scored, IngredientTrial)> {
    if !ingredient.can_join(&all.fitted.best.layout) {
        return None;
    }
    let start = best_of(training, &ingredient.starts(&all.fitted.best))?;
    let larger = Scored::new(training, &start, NEXT)?;
    let trial = IngredientTrial::new(ingredient, &larger, all);
    if trial.kept && ingredient == Ingredient::SecondStage {
        return Some((finer(training, &larger).unwrap_or(larger), trial));
    }
    Some((larger, trial))
}

/// With branches of the second stage as free as the first's, where held-out cycles ask for it.
fn finer(training: &Training, coarse: &Scored) -> Option<Scored> {
    let mut start = coarse.fitted.best.clone();
    start.candidate = start.candidate.with_finer_second()?;
    let finer = Scored::new(training, &start, NEXT)?;
    is_better(coarse.growth(&finer)).then_some(finer)
}

fn is_better((growth, surety): (f64, f64)) -> bool {
    growth > LEAST_GAIN && surety > LEAST_SURETY
}

/// The best of all ingredients without those that held-out cycles are predicted as well without, and their trials.
fn pruned(training: &Training, all: &Scored) -> (EmsTrial, Vec<IngredientTrial>) {
    let best = &all.fitted.best;
    let mut chosen = best.clone();
    let mut trials = Vec::new();
    for ingredient in Ingredient::ALL.into_iter().filter(|i| i.is_in(&best.layout)) {
        let Some(smaller) = ingredient.remove(best).and_then(|t| Scored::new(training, &t, NEXT)) else { continue };
        let trial = IngredientTrial::new(ingredient, all, &smaller);
        if !trial.kept && ingredient.is_in(&chosen.layout) {
            chosen = ingredient.remove(&chosen).unwrap_or(chosen);
        }
        trials.push(trial);
    }
    (chosen, trials)
}

/// Half widths tried once more, as parts of the best.
const OTHER_WIDTHS: [f64; 3] = [0.5, 0.7, 1.4];

/// The start that a fit carries farthest: a short one of all, a longer one of the best two.
pub(super) fn best_of(training: &Training, starts: &[EmsTrial]) -> Option<EmsTrial> {
    if let [only] = starts {
        return Some(only.clone());
    }
    let carried = |trials: Vec<EmsTrial>, stop| {
        let mut fits: Vec<_> = trials.iter().filter_map(|trial| output_error::fit(training, trial, stop)).collect();
        fits.sort_by(|a, b| a.rms[1].total_cmp(&b.rms[1]));
        fits.into_iter().map(|fitted| fitted.best).take(2).collect::<Vec<_>>()
    };
    let best_two = carried(carried(starts.to_vec(), SHORT), NEXT);
    // A wide element may stand in for a narrower one: the same full stroke at other widths.
    let best = best_two.first()?;
    let other = |part: &f64| {
        let candidate = best.candidate.with_half_width(part * best.candidate.half_width)?;
        Some(EmsTrial { candidate, layout: best.layout })
    };
    let others = OTHER_WIDTHS.iter().filter_map(other);
    carried(carried(others.chain([best.clone()]).collect(), SHORT), NEXT).into_iter().next()
}
