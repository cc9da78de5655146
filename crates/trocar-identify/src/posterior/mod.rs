//! Draws of the parameters of an identified element from their posterior: what intervals cannot
//! say about several parameters at once.
//!
//! ```text
//! structures with weights (structures.rs) -> density of each (density.rs) -> 4 chains (slice.rs) -> R-hat, ESS (diagnostics.rs)
//!                                                                          -> draws in the ratio of the weights
//! ```
//! Each structure is sampled by four chains from different starts. A warm-up finds location and
//! scale of the reference of the slice sampler; its draws are not used. The draw `i` of a chain is
//! the i-th of that chain of one structure; which one follows the weights. The same seed gives the
//! same draws on any number of threads.

use nalgebra::DVector;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use trocar_model::{Direction, ParameterId, Quantity, Stages};

pub use density::Density;
pub use diagnostics::Convergence;

use super::candidate::EmsTrial;
use super::element::ElementFit;
use super::findings::Warning;
use super::likelihood::Trial;
use super::numbers;
use super::random::normal;
use super::spread::Dependent;
use diagnostics::quantile;
use slice::{Chain, Reference};
use structures::Structure;

mod data;
mod density;
mod diagnostics;
mod joins;
mod slice;
mod structures;

pub use super::options::{CHAINS, Draws};
pub use super::prior::weak_priors;

/// Steps of a chain before the reference is adapted, those of which it is adapted to the last half,
/// and steps after that before the draws.
const WARM_UP: usize = 300;
const SETTLING: usize = 50;
/// Steps between two draws.
const THINNING: usize = 4;
/// Largest R-hat and smallest effective sample size of draws that may be used (RHAT).
const LARGEST_R_HAT: f64 = 1.01;
const SMALLEST_ESS: f64 = 400.0;
/// A parameter whose draws are wider than this fraction of its prior is not informed by the data.
const UNINFORMED: f64 = 0.7;

/// A structure of the element: which optional terms it has.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PosteriorStructure {
    /// Names of its terms, joined by `+`; `base` without any.
    pub name: String,
    /// Posterior probability among the structures compared.
    pub weight: f64,
    /// Draws that it has.
    pub draws: usize,
    /// Steps of its chains that found no other point; 0 in a chain that works.
    pub stuck: usize,
    /// Evaluations of the likelihood, including the warm-up.
    pub evaluations: usize,
}

/// A parameter in the draws.
#[derive(Debug, Clone, PartialEq)]
pub struct PosteriorParameter {
    /// Which.
    pub id: ParameterId,
    /// Mean of the draws that have it, SI.
    pub mean: f64,
    /// Their standard deviation, SI.
    pub standard_deviation: f64,
    /// Their 2.5 % and 97.5 % quantiles, SI.
    pub ci95: [f64; 2],
    /// The worst over the structures; `None` where it does not change.
    pub convergence: Option<Convergence>,
    /// Standard deviation relative to that of the prior, in the heaviest structure that has it:
    /// near 1 where the data say nothing about it. `None` where it has no prior.
    pub prior_ratio: Option<f64>,
}

/// One draw.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw {
    /// Chain, from 0.
    pub chain: usize,
    /// Number within the chain, from 0.
    pub draw: usize,
    /// Index of its structure.
    pub structure: usize,
    /// Values of [`Posterior::parameters`], SI; NaN for what its structure does not have.
    pub values: Vec<f64>,
    /// The elements.
    pub model: Stages,
}

/// Draws of the parameters of an element, with their diagnostics.
#[derive(Debug, Clone, PartialEq)]
pub struct Posterior {
    /// Structures, the most probable first.
    pub structures: Vec<PosteriorStructure>,
    /// Parameters, in the order of the columns.
    pub parameters: Vec<PosteriorParameter>,
    /// Draws, chain by chain.
    pub draws: Vec<Draw>,
}

/// Draws of one density, chain by chain.
#[derive(Debug, Clone)]
pub struct Sampled<T> {
    /// The draws.
    pub chains: Vec<Vec<T>>,
    /// Evaluations of the density, including the warm-up.
    pub evaluations: usize,
    /// Steps that found no other point.
    pub stuck: usize,
}

impl Posterior {
    /// `count` draws about a fit, and the density of the heaviest structure; `speeds` are the slowest
    /// and fastest of the sliding, m/s. `None` where the density has no maximum to start from.
    pub(super) fn of(
        found: &ElementFit,
        speeds: [f64; 2],
        count: Draws,
        seed: u64,
    ) -> Option<(Self, Density)> {
        let structures = structures::weighted(found, speeds);
        let per_chain = count.count() / CHAINS;
        let densities: Vec<Density> =
            structures.iter().map(Structure::density).collect::<Option<_>>()?;
        let sampled: Vec<Sampled<EmsTrial>> = densities
            .iter()
            .enumerate()
            .map(|(k, density)| {
                let Sampled { chains, evaluations, stuck } =
                    density.sample(per_chain, (seed, k))?;
                let at = |chain: Vec<Vec<f64>>| chain.iter().map(|z| density.at(z)).collect();
                Some(Sampled { chains: chains.into_iter().map(at).collect(), evaluations, stuck })
            })
            .collect::<Option<_>>()?;
        let density = densities.into_iter().next()?;
        Some((Self::assembled(&structures, &sampled)?, density))
    }

    /// The draws in turn; `None` where one of them makes no model, and so none that was simulated.
    fn assembled(structures: &[Structure], sampled: &[Sampled<EmsTrial>]) -> Option<Self> {
        let ids = parameters_of(structures);
        let values =
            |trial: &EmsTrial| -> Vec<f64> { ids.iter().map(|id| value(trial, *id)).collect() };
        let rows: Vec<Vec<Vec<Vec<f64>>>> = sampled
            .iter()
            .map(|s| s.chains.iter().map(|chain| chain.par_iter().map(values).collect()).collect())
            .collect();
        let weights: Vec<f64> = structures.iter().map(|s| s.weight).collect();
        let order = in_turn(&weights, rows[0][0].len());
        let draws: Vec<Draw> = (0..CHAINS)
            .flat_map(|chain| order.iter().enumerate().map(move |(i, k)| (chain, i, *k)))
            .map(|(chain, draw, structure)| {
                let trial = &sampled[structure].chains[chain][draw];
                let model = trial.candidate.stages().ok()?;
                let values = rows[structure][chain][draw].clone();
                Some(Draw { chain, draw, structure, values, model })
            })
            .collect::<Option<_>>()?;
        let parameter = |(j, id): (usize, &ParameterId)| {
            let of = |k: usize| -> Vec<Vec<f64>> {
                rows[k].iter().map(|chain| chain.iter().map(|row| row[j]).collect()).collect()
            };
            summarised(structures, *id, &draws, j, of)
        };
        Some(Self {
            parameters: ids.iter().enumerate().map(parameter).collect(),
            structures: structures
                .iter()
                .zip(sampled)
                .enumerate()
                .map(|(k, (structure, sampled))| PosteriorStructure {
                    name: structure.name(),
                    weight: structure.weight,
                    draws: draws.iter().filter(|d| d.structure == k).count(),
                    stuck: sampled.stuck,
                    evaluations: sampled.evaluations,
                })
                .collect(),
            draws,
        })
    }

    /// Largest R-hat of all parameters.
    #[must_use]
    pub fn r_hat(&self) -> f64 {
        self.convergences().map(|c| c.r_hat).fold(1.0, f64::max)
    }

    /// Smallest effective sample size of all parameters, of bulk and tails.
    #[must_use]
    pub fn ess(&self) -> f64 {
        self.convergences().map(|c| c.ess_bulk.min(c.ess_tail)).fold(f64::INFINITY, f64::min)
    }

    fn convergences(&self) -> impl Iterator<Item = &Convergence> {
        self.parameters.iter().filter_map(|p| p.convergence.as_ref())
    }

    /// The parameter called `name`.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<&PosteriorParameter> {
        let id = ParameterId::named(name)?;
        self.parameters.iter().find(|p| p.id == id)
    }

    /// Reasons to doubt the draws, and the parameters about which the data say nothing.
    pub(super) fn warnings(&self) -> Vec<Warning> {
        let mut all = Vec::new();
        let (r_hat, ess) = (self.r_hat(), self.ess());
        let stuck: usize = self.structures.iter().map(|s| s.stuck).sum();
        if !(r_hat <= LARGEST_R_HAT && ess >= SMALLEST_ESS) {
            let message = format!(
                "the draws did not converge: R-hat {r_hat:.3} (at most {LARGEST_R_HAT}), effective sample size {ess:.0} (at least \
                 {SMALLEST_ESS}): draw more (‹posterior›)"
            );
            all.push(Warning::doubt("posterior", message));
        }
        if stuck > 0 {
            let message = format!(
                "{stuck} steps of the sampler found no other point: the density has an isolated peak, and the draws may miss others"
            );
            all.push(Warning::doubt("posterior", message));
        }
        let is_prior = |p: &&PosteriorParameter| p.prior_ratio.is_some_and(|r| r > UNINFORMED);
        let as_wide = self.parameters.iter().filter(is_prior).map(|p| {
            let ratio = p.prior_ratio.unwrap_or_default();
            let message = format!(
                "its draws are {:.0} % as wide as its prior: the recordings contain almost no information about it",
                1e2 * ratio
            );
            Warning::remark(p.id, message)
        });
        all.extend(as_wide);
        all
    }

    /// Structures and convergence in one line.
    #[must_use]
    pub fn in_words(&self) -> String {
        let of = |s: &PosteriorStructure| format!("{} ({:.0} %)", s.name, 1e2 * s.weight);
        let structures: Vec<String> = self.structures.iter().map(of).collect();
        let evaluations: usize = self.structures.iter().map(|s| s.evaluations).sum();
        let stuck: usize = self.structures.iter().map(|s| s.stuck).sum();
        format!(
            "{} posterior draws of {}: R-hat at most {:.3}, effective sample size at least {:.0}, {stuck} steps stuck, {evaluations} evaluations",
            self.draws.len(),
            structures.join(", "),
            self.r_hat(),
            self.ess()
        )
    }
}

/// All parameters of the structures, in the order of tables.
fn parameters_of(structures: &[Structure]) -> Vec<ParameterId> {
    let mut ids: Vec<ParameterId> = Vec::new();
    for structure in structures {
        for id in own_parameters(&structure.fitted.best) {
            if !ids.contains(&id) {
                ids.push(id);
            }
        }
    }
    let is_coefficient = |id: &ParameterId| matches!(id.quantity, Quantity::Coefficient { .. });
    ids.sort_by_key(|id| (is_coefficient(id), numbers::rank(*id)));
    ids
}

/// The parameters of one structure.
fn own_parameters(trial: &EmsTrial) -> Vec<ParameterId> {
    let EmsTrial { candidate, layout, .. } = trial;
    let mut ids: Vec<ParameterId> =
        numbers::quantities(*layout).into_iter().map(|(id, _)| id).collect();
    ids.push(Quantity::Offset.id());
    if layout.own_levels || layout.own_slopes {
        let static_force = layout.stribeck.then_some(Quantity::StaticForce);
        let by_direction = [Quantity::CoulombForce].into_iter().chain(static_force);
        ids.extend(by_direction.flat_map(|q| Direction::BOTH.map(|direction| q.of(direction))));
    }
    ids.extend(numbers::shape_ids(candidate));
    ids
}

/// The value of a parameter; NaN where the structure does not have it.
fn value(trial: &EmsTrial, id: ParameterId) -> f64 {
    if own_parameters(trial).contains(&id) { trial.candidate.value(id) } else { f64::NAN }
}

/// Which structure each of `count` draws has: in the ratio of the weights, evenly mixed.
fn in_turn(weights: &[f64], count: usize) -> Vec<usize> {
    let mut credit = vec![0.0; weights.len()];
    let next = |_| {
        credit.iter_mut().zip(weights).for_each(|(credit, weight)| *credit += weight);
        let best =
            (0..credit.len()).max_by(|a, b| credit[*a].total_cmp(&credit[*b]).then(b.cmp(a)));
        let best = best.expect("there is a structure");
        credit[best] -= 1.0;
        best
    };
    (0..count).map(next).collect()
}

fn summarised(
    structures: &[Structure],
    id: ParameterId,
    draws: &[Draw],
    column: usize,
    of_structure: impl Fn(usize) -> Vec<Vec<f64>>,
) -> PosteriorParameter {
    let mut values: Vec<f64> =
        draws.iter().map(|d| d.values[column]).filter(|v| v.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let has = |k: &usize| value(&structures[*k].fitted.best, id).is_finite();
    let convergence = (0..structures.len())
        .filter(has)
        .filter_map(|k| Convergence::of(&of_structure(k)))
        .reduce(|a, b| Convergence {
            r_hat: a.r_hat.max(b.r_hat),
            ess_bulk: a.ess_bulk.min(b.ess_bulk),
            ess_tail: a.ess_tail.min(b.ess_tail),
        });
    let prior_ratio = (0..structures.len()).find(has).and_then(|k| {
        let own: Vec<f64> = of_structure(k).into_iter().flatten().collect();
        let mean = own.iter().sum::<f64>() / own.len() as f64;
        let variance = own.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / own.len() as f64;
        Some(variance.sqrt() / prior_deviation(&structures[k], id)?)
    });
    PosteriorParameter {
        id,
        mean,
        standard_deviation: (squares / (n - 1.0)).sqrt(),
        ci95: [0.025, 0.975].map(|part| quantile(&values, part)),
        convergence,
        prior_ratio,
    }
}

/// Standard deviation of a parameter under the priors, to first order; `None` where it has none.
fn prior_deviation(structure: &Structure, id: ParameterId) -> Option<f64> {
    let best = &structure.fitted.best;
    let Dependent { gradient, .. } = Dependent::on(best, false, &|t| t.candidate.value(id));
    let free = best.free();
    let own = gradient.iter().zip(&free).zip(&structure.training.prior);
    let variance: f64 =
        own.map(|((g, free), prior)| (g * prior.deviation_within(free.range())).powi(2)).sum();
    (variance.is_finite() && variance > 0.0).then(|| variance.sqrt())
}

impl Density {
    /// Four chains of `count` draws z each, with the streams of `number` of the generator `seed`;
    /// `None` where the density is not finite at its maximum.
    #[must_use]
    pub fn sample(&self, count: usize, (seed, number): (u64, usize)) -> Option<Sampled<Vec<f64>>> {
        sample(&|z| self.log(z), self.dimension(), count, (seed, number))
    }
}

fn sample(
    log: &(impl Fn(&DVector<f64>) -> f64 + Sync),
    d: usize,
    count: usize,
    (seed, number): (u64, usize),
) -> Option<Sampled<Vec<f64>>> {
    let begin = |k: usize| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream((1 + number * CHAINS + k) as u64);
        let start = DVector::from_fn(d, |_, _| 1.5 * normal(&mut rng));
        Chain::new(log, start, rng)
    };
    let mut chains: Vec<Chain> = (0..CHAINS).map(begin).collect::<Option<_>>()?;
    let steps = |chain: &mut Chain, reference: &Reference, count: usize| -> Vec<DVector<f64>> {
        (0..count)
            .map(|_| {
                chain.step(log, reference);
                chain.at.clone()
            })
            .collect()
    };
    let standard = Reference::standard(d);
    let warm: Vec<Vec<DVector<f64>>> =
        chains.par_iter_mut().map(|chain| steps(chain, &standard, WARM_UP)).collect();
    let last: Vec<DVector<f64>> =
        warm.into_iter().flat_map(|chain| chain.into_iter().skip(WARM_UP / 2)).collect();
    let reference = Reference::of(&last)?;
    let drawn = |chain: &mut Chain| -> Vec<Vec<f64>> {
        steps(chain, &reference, SETTLING);
        chain.stuck = 0;
        (0..count)
            .map(|_| {
                steps(chain, &reference, THINNING);
                chain.at.as_slice().to_vec()
            })
            .collect()
    };
    let drawn: Vec<Vec<Vec<f64>>> = chains.par_iter_mut().map(drawn).collect();
    Some(Sampled {
        chains: drawn,
        evaluations: chains.iter().map(|c| c.evaluations).sum(),
        stuck: chains.iter().map(|c| c.stuck).sum(),
    })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// There are no divergences to report, but steps that found no other point, and these make the
    /// result doubtful (exit code 3): here every step once no further point has a density.
    #[test]
    fn steps_without_another_point_are_reported_and_make_the_draws_doubtful() {
        let normal = |z: &DVector<f64>| -0.5 * z.norm_squared();
        let free = sample(&normal, 2, 100, (1, 0)).expect("a density");
        assert_eq!(free.stuck, 0);
        let left = AtomicUsize::new(free.evaluations - 100);
        let ends = |z: &DVector<f64>| {
            let spend = |left: usize| left.checked_sub(1);
            match left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, spend) {
                Ok(_) => normal(z),
                Err(_) => f64::NEG_INFINITY,
            }
        };
        assert!(sample(&ends, 2, 100, (1, 0)).is_some_and(|sampled| sampled.stuck > 0));
        let structure = |stuck: usize| PosteriorStructure {
            name: "base".to_owned(),
            weight: 1.0,
            draws: 400,
            stuck,
            evaluations: 1,
        };
        let warnings = |stuck: usize| {
            let structures = vec![structure(stuck)];
            Posterior { structures, parameters: Vec::new(), draws: Vec::new() }.warnings()
        };
        assert!(warnings(0).is_empty());
        let [warning] = &warnings(3)[..] else { panic!("one warning") };
        assert!(warning.message.starts_with("3 steps of the sampler"), "{}", warning.message);
        assert!(warning.doubtful);
    }
}
