//! How many of each block.

use nalgebra::DVector;
use rayon::prelude::*;
use trocar_model::ElementParams;

use super::blocks::{Block, Interruption, reserve};
use super::config::PlanConfig;
use super::course::{AT_REST, sampled};
use super::goal::Goal;
use super::{PlanError, Share};
use trocar_identify::{Force, Information, Motion, Noise, Progress, Rows};
use trocar_recording::cancel;

/// What is known about one seal, and what each block would add.
struct Known {
    already: Information,
    of_blocks: Vec<Information>,
    directions: Vec<DVector<f64>>,
    force: Force,
}

/// A block after a cycle that makes its state known, and when it begins, s.
fn led_into(config: &PlanConfig, block: &Block) -> Result<(Motion, f64), PlanError> {
    let rig = &config.rig;
    let speed_m_s = block.speed_m_s.max(0.02);
    let cycle = Block { interruption: Interruption::None, speed_m_s, ..*block };
    let start = rig.lowest_m + 0.5 * (rig.travel_m() - block.length_m);
    let both = [cycle.moves(start, start), block.moves(start, start)].concat();
    let course = sampled(rig, &both);
    let motion = Motion::planned(&course.time, &course.position)?;
    Ok((motion, AT_REST + cycle.duration(rig)))
}

impl Known {
    fn new(
        noise: &Noise,
        goal: &Goal,
        seal: &ElementParams,
        blocks: &[Block],
        [motions, before]: [&[(Motion, f64)]; 2],
    ) -> Result<Self, PlanError> {
        let found = motions.iter().chain(before).map(|(motion, from)| {
            let rows = Rows::new(&[motion], seal, noise)?.ok_or(PlanError::Singular)?;
            Ok((rows.information(noise, [*from, f64::INFINITY]), rows))
        });
        let found: Vec<(Information, Rows)> = found.collect::<Result<_, PlanError>>()?;
        let (mut of_blocks, rows): (Vec<Information>, Vec<Rows>) = found.into_iter().unzip();
        let recorded = of_blocks.split_off(motions.len());
        // The motion of prediction: all interrupted cycles, or all where there are none.
        let interrupted: Vec<usize> =
            (0..blocks.len()).filter(|k| !blocks[*k].is_cycle()).collect();
        let chosen = if interrupted.is_empty() { (0..blocks.len()).collect() } else { interrupted };
        let force = Force::mean(chosen.iter().map(|k| rows[*k].force()));
        let rows = rows.first().ok_or(PlanError::Singular)?;
        let mut already = rows.nothing_known(noise);
        for information in &recorded {
            already = already.with(information, 1.0);
        }
        Ok(Self { already, of_blocks, directions: directions(goal, rows)?, force })
    }

    fn after(&self, counts: &[usize]) -> Information {
        let blocks = self.of_blocks.iter().zip(counts).filter(|(_, count)| **count > 0);
        blocks.fold(self.already.clone(), |sum, (block, count)| sum.with(block, *count as f64))
    }

    /// Logarithm of the variance that the goal is about; `None` where it cannot be computed.
    fn criterion(&self, goal: &Goal, information: &Information) -> Option<f64> {
        let found = match goal {
            Goal::Compensation => information.force_variance(&self.force).map(f64::ln),
            Goal::All => information.variances(&self.directions).map(|found| found.1),
            Goal::Parameter(..) => information.variances(&self.directions).map(|(v, _)| v[0].ln()),
        };
        found.filter(|value| value.is_finite())
    }
}

/// Gradients of the parameters that the goal is about.
fn directions(goal: &Goal, rows: &Rows) -> Result<Vec<DVector<f64>>, PlanError> {
    let Goal::Parameter(id, _) = goal else {
        return Ok(rows.directions(&[]).into_iter().map(|d| d.1).collect());
    };
    let found: Vec<DVector<f64>> = rows.directions(&[*id]).into_iter().map(|d| d.1).collect();
    if found.is_empty() {
        let all: Vec<String> = rows.directions(&[]).iter().map(|d| d.0.to_string()).collect();
        return Err(PlanError::NotThere(id.to_string(), all.join(", ")));
    }
    Ok(found)
}

/// What is known about all seals, in which the counts of the blocks are searched.
pub(super) struct Search<'a> {
    goal: &'a Goal,
    blocks: &'a [Block],
    durations: Vec<f64>,
    known: Vec<Known>,
}

/// Least decrease of the criterion for which blocks are exchanged.
const WORTH_IT: f64 = 1e-6;

impl<'a> Search<'a> {
    pub(super) fn new(
        config: &PlanConfig,
        goal: &'a Goal,
        seals: &[ElementParams],
        blocks: &'a [Block],
        before: &[Motion],
    ) -> Result<Self, PlanError> {
        let motions: Vec<(Motion, f64)> =
            blocks.par_iter().map(|block| led_into(config, block)).collect::<Result<_, _>>()?;
        let before: Vec<(Motion, f64)> = before.iter().map(|m| (m.clone(), 0.0)).collect();
        let found: Vec<Result<Known, PlanError>> = seals
            .par_iter()
            .map(|seal| Known::new(&config.noise, goal, seal, blocks, [&motions, &before]))
            .collect();
        // Of posterior draws, those whose structure has the parameter of the goal.
        let (without, with): (Vec<_>, Vec<_>) =
            found.into_iter().partition(|k| matches!(k, Err(PlanError::NotThere(..))));
        let known = if with.is_empty() { without } else { with };
        let known = known.into_iter().collect::<Result<_, _>>()?;
        let durations = blocks.iter().map(|block| block.duration(&config.rig)).collect();
        Ok(Self { goal, blocks, durations, known })
    }

    /// Mean criterion over the seals.
    fn value(&self, counts: &[usize]) -> Result<f64, PlanError> {
        cancel::check();
        let sum: Option<f64> =
            self.known.iter().map(|seal| seal.criterion(self.goal, &seal.after(counts))).sum();
        sum.map(|sum| sum / self.known.len() as f64).ok_or(PlanError::Singular)
    }

    fn duration(&self, counts: &[usize]) -> f64 {
        counts.iter().zip(&self.durations).map(|(n, duration)| *n as f64 * duration).sum()
    }

    /// Of several counts, each with a time, the one with the least rate (criterion − `from`)/time:
    /// rate, criterion and counts.
    fn best_of(
        &self,
        tried: Vec<(Vec<usize>, f64)>,
        from: f64,
    ) -> Result<Option<(f64, f64, Vec<usize>)>, PlanError> {
        let all = tried
            .into_par_iter()
            .map(|(counts, time)| {
                let value = self.value(&counts)?;
                Ok(((value - from) / time, value, counts))
            })
            .collect::<Result<Vec<_>, PlanError>>()?;
        Ok(all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)))
    }

    /// Counts that take at most `time`, s: the reserve, then again and again the block that improves
    /// the criterion most in its time; then exchanges as long as one improves it.
    pub(super) fn best(&self, time: f64, progress: Progress) -> Result<Vec<usize>, PlanError> {
        let mut counts = reserve(self.blocks);
        let mut best = self.value(&counts)?;
        loop {
            let used = self.duration(&counts);
            progress("choosing the cycles", 0.3 + 0.2 * (used / time).min(1.0));
            match self.best_of(
                (0..counts.len())
                    .filter(|k| used + self.durations[*k] <= time)
                    .map(|k| (changed(&counts, k, None), self.durations[k]))
                    .collect(),
                best,
            )? {
                Some((rate, value, better)) if rate < 0.0 => (counts, best) = (better, value),
                _ => break,
            }
        }
        loop {
            let exchanged = self.exchanged(&counts, time - self.duration(&counts));
            match self.best_of(exchanged, best)? {
                Some((change, value, better)) if change < -WORTH_IT => {
                    (counts, best) = (better, value);
                }
                _ => return Ok(counts),
            }
        }
    }

    /// Counts with a block more and one, beyond the reserve, less, that fit the time left.
    fn exchanged(&self, counts: &[usize], left: f64) -> Vec<(Vec<usize>, f64)> {
        let least = reserve(self.blocks);
        let n = counts.len();
        let pairs =
            (0..n).flat_map(|more| (0..n).map(move |less| (more, less))).filter(|(more, less)| {
                more != less
                    && counts[*less] > least[*less]
                    && self.durations[*more] - self.durations[*less] <= left
            });
        pairs.map(|(more, less)| (changed(counts, more, Some(less)), 1.0)).collect()
    }

    /// Counts without the block that is missed least; `None` where only the reserve is left.
    pub(super) fn with_one_less(&self, counts: &[usize]) -> Result<Option<Vec<usize>>, PlanError> {
        let least = reserve(self.blocks);
        let beyond = (0..counts.len()).filter(|k| counts[*k] > least[*k]);
        let fewer = beyond.map(|k| {
            let mut fewer = counts.to_vec();
            fewer[k] -= 1;
            (fewer, 1.0)
        });
        let best = self.best_of(fewer.collect(), 0.0)?;
        Ok(best.map(|(.., counts)| counts))
    }

    pub(super) fn repeated(&self, counts: &[usize]) -> Vec<Block> {
        let all = self.blocks.iter().zip(counts);
        all.flat_map(|(block, count)| std::iter::repeat_n(*block, *count)).collect()
    }

    /// What each kind of block contributes: 1 − the precision of the goal without it over that with
    /// it. Without blocks that alone determine a parameter nothing is left.
    pub(super) fn shares(&self, counts: &[usize]) -> Result<Vec<Share>, PlanError> {
        let best = self.value(counts)?;
        let used = (0..counts.len()).filter(|k| counts[*k] > 0);
        let shares = used.map(|k| {
            let [information, information_of_one] = [counts[k], 1].map(|less| {
                let mut without = counts.to_vec();
                without[k] -= less;
                self.value(&without).map_or(1.0, |value| 1.0 - (best - value).exp())
            });
            let duration_s = counts[k] as f64 * self.durations[k];
            let (block, count) = (self.blocks[k], counts[k]);
            Share { block, count, duration_s, information, information_of_one }
        });
        Ok(shares.collect())
    }
}

fn changed(counts: &[usize], more: usize, less: Option<usize>) -> Vec<usize> {
    let mut counts = counts.to_vec();
    counts[more] += 1;
    if let Some(less) = less {
        counts[less] -= 1;
    }
    counts
}
