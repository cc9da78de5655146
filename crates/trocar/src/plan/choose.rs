//! How many of each block.

use nalgebra::DVector;
use rayon::prelude::*;
use trocar_model::ElementParams;

use super::blocks::{Block, Interruption, reserve};
use super::config::PlanConfig;
use super::course::{AT_REST, sampled};
use super::goal::Goal;
use super::{PlanError, Share, noiseless};
use crate::identify::{Force, Information, Rows};
use crate::recording::Recording;

/// What is known about one seal, and what each block would add.
pub(super) struct Known {
    already: Information,
    of_blocks: Vec<Information>,
    directions: Vec<DVector<f64>>,
    force: Force,
}

/// Motion before a block, so that its state is known: a cycle.
fn preamble(of: &Block) -> Block {
    Block { interruption: Interruption::None, speed_m_s: of.speed_m_s.max(0.02), ..*of }
}

impl Known {
    pub(super) fn new(
        config: &PlanConfig,
        goal: &Goal,
        seal: &ElementParams,
        blocks: &[Block],
        before: &[Recording],
    ) -> Result<Self, PlanError> {
        let rows_of = |recording: &Recording| {
            Rows::new(&[recording], seal, &config.noise)?.ok_or(PlanError::Singular)
        };
        let (rig, noise) = (&config.rig, &config.noise);
        let of_block = |block: &Block| {
            let before = preamble(block);
            let start = rig.lowest_m + 0.5 * (rig.travel_m() - block.length_m);
            let moves: Vec<_> =
                before.moves(start, start).into_iter().chain(block.moves(start, start)).collect();
            let course = sampled(rig, &moves);
            let rows = rows_of(&noiseless(seal, &course)?)?;
            Ok((rows.information(noise, [AT_REST + before.duration(rig), f64::INFINITY]), rows))
        };
        let found: Vec<(Information, Rows)> =
            blocks.par_iter().map(of_block).collect::<Result<_, PlanError>>()?;
        let (of_blocks, rows): (Vec<Information>, Vec<Rows>) = found.into_iter().unzip();
        let first = rows.first().ok_or(PlanError::Singular)?;
        // The motion of prediction: all interrupted cycles, or all where there are none.
        let of_prediction = |k: &usize| blocks[*k].interruption != Interruption::None;
        let interrupted: Vec<usize> = (0..blocks.len()).filter(of_prediction).collect();
        let chosen = if interrupted.is_empty() { (0..blocks.len()).collect() } else { interrupted };
        let force = Force::mean(chosen.iter().map(|k| rows[*k].force()));
        let rows = first;
        let ids = match goal {
            Goal::Parameter(id, _) => vec![*id],
            _ => Vec::new(),
        };
        let directions: Vec<DVector<f64>> =
            rows.directions(&ids).into_iter().map(|d| d.1).collect();
        if let (Goal::Parameter(id, _), true) = (goal, directions.is_empty()) {
            let all: Vec<String> = rows.directions(&[]).iter().map(|d| d.0.to_string()).collect();
            return Err(PlanError::NotThere(id.to_string(), all.join(", ")));
        }
        let mut already = rows.nothing_known(noise);
        for recording in before {
            already =
                already.with(&rows_of(recording)?.information(noise, [0.0, f64::INFINITY]), 1.0);
        }
        Ok(Self { already, of_blocks, directions, force })
    }

    fn after(&self, counts: &[usize]) -> Information {
        let blocks = self.of_blocks.iter().zip(counts).filter(|(_, count)| **count > 0);
        blocks.fold(self.already.clone(), |sum, (block, count)| sum.with(block, *count as f64))
    }

    /// Logarithm of the variance that the goal is about; infinite where it cannot be computed.
    fn criterion(&self, goal: &Goal, information: &Information) -> f64 {
        let found = match goal {
            Goal::Compensation => information.force_variance(&self.force).map(f64::ln),
            Goal::All => information.variances(&self.directions).map(|found| found.1),
            Goal::Parameter(..) => information.variances(&self.directions).map(|(v, _)| v[0].ln()),
        };
        found.filter(|value| value.is_finite()).unwrap_or(f64::INFINITY)
    }
}

/// The blocks of a motion.
pub(super) struct Chosen {
    pub(super) blocks: Vec<Block>,
    pub(super) shares: Vec<Share>,
}

/// Mean criterion over seals.
fn mean(goal: &Goal, known: &[Known], counts: &[usize]) -> f64 {
    let all = known.par_iter().map(|seal| seal.criterion(goal, &seal.after(counts)));
    all.sum::<f64>() / known.len() as f64
}

/// Blocks that take at most `time`, s: the reserve, then again and again the block that improves the mean criterion most in its time;
/// then exchanges as long as one improves it.
pub(super) fn choose(
    config: &PlanConfig,
    goal: &Goal,
    blocks: &[Block],
    known: &[Known],
    time: f64,
) -> Result<Chosen, PlanError> {
    let durations: Vec<f64> = blocks.iter().map(|block| block.duration(&config.rig)).collect();
    let of = |counts: &[usize]| -> f64 {
        counts.iter().zip(&durations).map(|(count, duration)| *count as f64 * duration).sum()
    };
    let least = reserve(blocks);
    let mut counts = least.clone();
    if of(&counts) > time {
        return Err(PlanError::TooShort {
            found: config.duration_s,
            least: (1.05 * of(&counts)).ceil(),
            with: if goal.needs_free_motion() { ", partial reversals, a rest" } else { "" },
        });
    }
    let changed = |counts: &[usize], more: usize, less: Option<usize>| {
        let mut counts = counts.to_vec();
        counts[more] += 1;
        if let Some(less) = less {
            counts[less] -= 1;
        }
        counts
    };
    let mut best = mean(goal, known, &counts);
    loop {
        let left = time - of(&counts);
        let gains = (0..blocks.len()).filter(|k| durations[*k] <= left).map(|k| {
            let value = mean(goal, known, &changed(&counts, k, None));
            ((best - value) / durations[k], value, k)
        });
        let Some((gain, value, k)) = gains.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        if gain <= 0.0 {
            break;
        }
        (counts, best) = (changed(&counts, k, None), value);
    }
    while let Some((value, better)) = exchange(&counts, &least, &durations, time - of(&counts))
        .map(|(more, less)| changed(&counts, more, Some(less)))
        .map(|counts| (mean(goal, known, &counts), counts))
        .filter(|(value, _)| *value < best - 1e-6)
        .min_by(|a, b| a.0.total_cmp(&b.0))
    {
        (counts, best) = (better, value);
    }
    let shares = shares(goal, blocks, &counts, known, &durations, best);
    let repeated = blocks.iter().zip(&counts);
    let blocks = repeated.flat_map(|(block, count)| std::iter::repeat_n(*block, *count)).collect();
    Ok(Chosen { blocks, shares })
}

/// Pairs of a block to add and one, beyond the reserve, to leave out, that fit the time left.
fn exchange(
    counts: &[usize],
    least: &[usize],
    durations: &[f64],
    left: f64,
) -> impl Iterator<Item = (usize, usize)> {
    let pairs = (0..counts.len()).flat_map(|more| (0..counts.len()).map(move |less| (more, less)));
    let fits = |(more, less): &(usize, usize)| {
        more != less && counts[*less] > least[*less] && durations[*more] - durations[*less] <= left
    };
    pairs.filter(fits).collect::<Vec<_>>().into_iter()
}

/// What each kind of block contributes: 1 − the precision of the goal without it over that with it.
fn shares(
    goal: &Goal,
    blocks: &[Block],
    counts: &[usize],
    known: &[Known],
    durations: &[f64],
    best: f64,
) -> Vec<Share> {
    let used = (0..blocks.len()).filter(|k| counts[*k] > 0);
    used.map(|k| {
        let mut without = counts.to_vec();
        without[k] = 0;
        Share {
            block: blocks[k],
            count: counts[k],
            duration_s: counts[k] as f64 * durations[k],
            information: 1.0 - (best - mean(goal, known, &without)).exp(),
        }
    })
    .collect()
}
