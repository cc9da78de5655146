//! Candidates with the force of another over full strokes: at another half width, or divided into
//! two stages. Starts of fits.

use trocar_model::SlidingFriction;

use super::candidate::Candidate;
use super::shape::{BranchShape, EndForces};
use super::stage::SecondStage;
use trocar_simulate::segment::Direction;

/// Part of a full stroke from which on a branch is as steep as at its end.
const END_FROM: f64 = 0.8;

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

    /// Gives the branches coefficients up to these degrees, of which those that are new are 0.
    pub(super) fn extend_branches(&mut self, [left, right]: [usize; 2]) {
        for branch in [&mut self.insertion_branch, &mut self.withdrawal_branch] {
            branch.left.resize(branch.left.len().max(left - 1), 0.0);
            branch.right.resize(branch.right.len().max(right - 1), 0.0);
        }
    }

    /// The candidate with another half width, m, and the same force over full strokes.
    pub(super) fn with_half_width(&self, half_width: f64) -> Option<Candidate> {
        self.rebuilt(1.0, half_width, |d, travel| self.first_upon_stroke(d, travel))
    }

    /// The candidate with static forces that exceed the Coulomb forces by `excess`, N, below `velocity`
    /// (m/s): its branches go on, beyond their ends, as steeply as just before them, or are cut short.
    pub(super) fn holding(
        &self,
        excess: impl Fn(&SlidingFriction) -> f64,
        velocity: f64,
    ) -> Option<Candidate> {
        let full = 2.0 * self.half_width;
        let stiffness = |direction| {
            let force = |part: f64| self.first_upon_stroke(direction, part * full);
            Some((force(1.0)? - force(END_FROM)?).abs() / (full * (1.0 - END_FROM)))
        };
        let [up, down] = Direction::BOTH.map(stiffness);
        let stiffness = 0.5 * (up? + down?);
        let mut longer = self.clone();
        for sliding in [&mut longer.insertion, &mut longer.withdrawal] {
            sliding.static_force = sliding.coulomb_force + excess(sliding);
            sliding.stribeck_velocity = velocity;
        }
        let (own, end) = (self.end_forces(), longer.end_forces());
        let [below, above] =
            [own.low - end.low, end.high - own.high].map(|change| change / stiffness);
        let half_width = 0.5 * (full + below + above);
        let is_sound = half_width > 0.25 * full && half_width < full;
        let force = |direction: Direction, travel: f64| {
            let on = travel - direction.pick([below, above]);
            let inside = on.clamp(0.0, full);
            let beyond = direction.sign() * stiffness * (on - inside);
            Some(self.first_upon_stroke(direction, inside)? + beyond)
        };
        is_sound.then(|| longer.rebuilt(1.0, half_width, force))?
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
