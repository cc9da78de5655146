//! Candidates with the force of another over full strokes: at another half width, or divided into
//! two stages. Starts of fits.

use trocar_model::SlidingFriction;

use super::candidate::Candidate;
use super::shape::{BranchShape, EndForces};
use super::stage::SecondStage;
use trocar_simulate::segment::Direction;

/// Points of a full stroke to which branches are fitted.
const POINTS: usize = 200;

/// Force, N, of a stage at `travel`, m, after a reversal at the far end of its deflections.
fn upon_stroke(
    shape: &BranchShape,
    half_width: f64,
    end_forces: EndForces,
    direction: Direction,
    travel: f64,
) -> Option<f64> {
    let branch = shape.branch(half_width, end_forces).ok()?;
    let deflection = direction.sign() * (travel - half_width).min(half_width);
    Some(branch.force(deflection))
}

/// Branch of an element of half width `half_width` that has the given `force` (N) as a function of
/// travel (m) over a full stroke.
fn fitted(
    degrees: [usize; 2],
    (half_width, end_forces): (f64, EndForces),
    direction: Direction,
    force: impl Fn(f64) -> Option<f64>,
) -> Option<BranchShape> {
    let at = |k: usize| (2.0 * (k as f64 + 0.5) / POINTS as f64) - 1.0;
    let point = |u: f64| Some((u, force(half_width * (1.0 + direction.sign() * u))?));
    let points: Option<Vec<(f64, f64)>> = (0..POINTS).map(|k| point(at(k))).collect();
    BranchShape::fit(degrees, end_forces, &points?).map(|found| found.0)
}

fn scaled(sliding: &mut SlidingFriction, factor: f64) {
    sliding.coulomb_force *= factor;
    sliding.static_force *= factor;
    sliding.viscous_damping *= factor;
}

impl Candidate {
    /// Force, N, of the first stage over a full stroke.
    fn first_upon_stroke(&self, direction: Direction, travel: f64) -> Option<f64> {
        upon_stroke(self.branch(direction), self.half_width, self.end_forces(), direction, travel)
    }

    /// Force, N, of the second stage over a full stroke; 0 without one.
    fn second_upon_stroke(&self, direction: Direction, travel: f64) -> Option<f64> {
        let Some(second) = &self.second else { return Some(0.0) };
        let end_forces = second.end_forces(&self.insertion, &self.withdrawal);
        upon_stroke(second.branch(direction), second.half_width, end_forces, direction, travel)
    }

    /// The candidate with forces scaled by `factor` and branches that give `force` (N) over full
    /// strokes (m) in either direction.
    fn rebuilt(
        &self,
        factor: f64,
        half_width: f64,
        force: impl Fn(Direction, f64) -> Option<f64>,
    ) -> Option<Candidate> {
        let mut whole = Candidate { half_width, ..self.clone() };
        [&mut whole.insertion, &mut whole.withdrawal].into_iter().for_each(|s| scaled(s, factor));
        whole.seal_damping *= factor;
        let ends = (half_width, whole.end_forces());
        let degrees = self.insertion_branch.degrees();
        let [insertion_branch, withdrawal_branch] =
            Direction::BOTH.map(|d| fitted(degrees, ends, d, |travel| force(d, travel)));
        Some(Candidate {
            insertion_branch: insertion_branch?,
            withdrawal_branch: withdrawal_branch?,
            ..whole
        })
    }

    /// The candidate with another half width, m, and the same force over full strokes.
    pub(super) fn with_half_width(&self, half_width: f64) -> Option<Candidate> {
        self.rebuilt(1.0, half_width, |d, travel| self.first_upon_stroke(d, travel))
    }

    /// The candidate with the fraction `share_of_force` of its force moved to a second stage of
    /// straight branches, whose half width is `width` times the first's. The force over full
    /// strokes is unchanged; over partial ones it is not.
    pub(super) fn divided(&self, width: f64, share_of_force: f64) -> Option<Candidate> {
        let straight = BranchShape::straight(SecondStage::DEGREES);
        let share = share_of_force / (1.0 - share_of_force);
        let mut second = SecondStage {
            share,
            half_width: width * self.half_width,
            insertion_branch: straight.clone(),
            withdrawal_branch: straight,
        };
        let smaller = self.rebuilt(1.0 - share_of_force, self.half_width, |d, travel| {
            self.first_upon_stroke(d, travel)
        })?;
        let end_forces = second.end_forces(&smaller.insertion, &smaller.withdrawal);
        second.insertion_branch.join_force = 0.5 * (end_forces.low + end_forces.high);
        second.withdrawal_branch.join_force = second.insertion_branch.join_force;
        let with = Candidate { second: Some(second), ..smaller };
        let rest = self.rebuilt(1.0 - share_of_force, self.half_width, |d, travel| {
            Some(self.first_upon_stroke(d, travel)? - with.second_upon_stroke(d, travel)?)
        })?;
        Some(Candidate { second: with.second.clone(), ..rest })
    }
}
