//! Pieces of a motion: cycles of an insertion and a withdrawal.

use core::fmt;

use serde::Serialize;
use trocar_model::ElementParams;

use super::config::{PlanConfig, Rig};
use super::moves::Move;
use super::{Goal, PlanError};

/// A cycle of an insertion and a withdrawal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Block {
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// Length of each stroke, m.
    pub length_m: f64,
    /// What happens in the middle of each stroke.
    pub interruption: Interruption,
}

/// What interrupts a stroke in its middle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Interruption {
    /// Nothing.
    None,
    /// A reversal by this distance, m, and back.
    PartialReversal(f64),
    /// A rest, s.
    Rest(f64),
}

impl fmt::Display for Interruption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("full strokes"),
            Self::PartialReversal(depth) => write!(f, "partial reversals of {:.1} mm", 1e3 * depth),
            Self::Rest(rest) => write!(f, "rests of {rest} s"),
        }
    }
}

/// Speeds that are tried, evenly in their logarithm, and lengths as parts of the travel.
const SPEEDS: usize = 5;
pub(super) const LENGTHS: [f64; 3] = [0.95, 0.5, 0.3];
/// Shortest stroke, in half widths: the seal must slide over more than it deforms.
pub(super) const SHORTEST: f64 = 6.0;
/// Depths of partial reversals, in half widths of a seal in the middle of those planned for.
const DEPTHS: [f64; 3] = [0.3, 0.7, 1.4];
/// Rests, s: relaxation and creep show within seconds.
const RESTS: [f64; 2] = [0.5, 3.0];

/// The blocks from which a motion may be made, the cycles of the reserve first: [`reserve`].
///
/// # Errors
/// Too little travel for the seals.
pub(super) fn candidates(
    config: &PlanConfig,
    goal: &Goal,
    seals: &[ElementParams],
) -> Result<Vec<Block>, PlanError> {
    let rig = &config.rig;
    let mut widths: Vec<f64> = seals.iter().map(|seal| seal.deformation.half_width()).collect();
    widths.sort_by(f64::total_cmp);
    let (middle, widest) = (widths[widths.len() / 2], widths[widths.len() - 1]);
    let least = SHORTEST * widest;
    let travel = LENGTHS[0] * rig.travel_m();
    if travel < least {
        return Err(PlanError::TooNarrow {
            travel_m: rig.travel_m(),
            half_width_m: widest,
            least_m: least / LENGTHS[0],
        });
    }
    let mut lengths: Vec<f64> = LENGTHS.iter().map(|part| part * rig.travel_m()).collect();
    lengths.retain(|length| *length >= least);
    if lengths.len() < LENGTHS.len() && lengths[lengths.len() - 1] > 1.2 * least {
        lengths.push(least);
    }
    let ratio = (rig.fastest_m_s / rig.slowest_m_s).powf(1.0 / (SPEEDS - 1) as f64);
    let speeds = (0..SPEEDS).map(|k| rig.slowest_m_s * ratio.powi(k as i32));
    let mut blocks: Vec<Block> = Vec::new();
    for speed_m_s in speeds.clone() {
        blocks.extend(lengths.iter().rev().map(|length_m| Block {
            speed_m_s,
            length_m: *length_m,
            interruption: Interruption::None,
        }));
    }
    if goal.needs_free_motion() {
        let (speed_m_s, length_m) = (0.5 * rig.fastest_m_s, lengths[lengths.len() - 1]);
        let depths = DEPTHS.map(|depth| Interruption::PartialReversal(depth * middle));
        let rests = RESTS.map(Interruption::Rest);
        let all = depths.into_iter().chain(rests);
        blocks.extend(all.map(|interruption| Block { speed_m_s, length_m, interruption }));
    }
    Ok(blocks)
}

/// How many of each block any motion must hold: cycles at three speeds, of which the fast ones, which
/// take little time, are repeated (lack of fit, scatter of the strokes); where the goal is more than
/// a parameter, one cycle with each interruption but the longest rest.
pub(super) fn reserve(blocks: &[Block]) -> Vec<usize> {
    let shortest = blocks.iter().map(|block| block.length_m).fold(f64::INFINITY, f64::min);
    let cycles: Vec<usize> = (0..blocks.len())
        .filter(|k| blocks[*k].is_cycle() && blocks[*k].length_m == shortest)
        .collect();
    let mut counts = vec![0; blocks.len()];
    for (k, count) in [(1, 1), (cycles.len() / 2, 2), (cycles.len() - 1, 3)] {
        counts[cycles[k]] = count;
    }
    let longest = Interruption::Rest(RESTS[RESTS.len() - 1]);
    for (k, block) in blocks.iter().enumerate() {
        counts[k] += usize::from(!block.is_cycle() && block.interruption != longest);
    }
    counts
}

impl Block {
    /// Whether nothing interrupts its strokes.
    pub(super) fn is_cycle(&self) -> bool {
        self.interruption == Interruption::None
    }

    /// Its duration on `rig`, s.
    pub(super) fn duration(&self, rig: &Rig) -> f64 {
        self.moves(0.0, 0.0).iter().map(|step| step.duration(rig)).sum()
    }

    /// Its moves from `at` (m) to its length beyond `start`, and back to `start` (m).
    pub(super) fn moves(&self, at: f64, start: f64) -> Vec<Move> {
        let end = start + self.length_m;
        let middle = 0.5 * (start + end);
        let stops = match self.interruption {
            Interruption::PartialReversal(depth) => {
                vec![middle, middle - depth, end, middle, middle + depth, start]
            }
            Interruption::Rest(_) => vec![middle, end, middle, start],
            Interruption::None => vec![end, start],
        };
        let mut from_m = at;
        let mut moves = Vec::with_capacity(stops.len());
        for to_m in stops {
            let rest_s = match self.interruption {
                Interruption::Rest(rest_s) if to_m == middle => rest_s,
                _ => 0.0,
            };
            moves.push(Move { from_m, to_m, speed_m_s: self.speed_m_s, rest_s });
            from_m = to_m;
        }
        moves
    }
}
