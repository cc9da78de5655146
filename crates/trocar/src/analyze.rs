//! The paper's propositions III.1 to III.3 for one given seal, and what happens where their
//! assumptions fail.
//!
//! ```text
//! III.1  dF_e/dz > 0 outside an interval (15)           => the element reaches sliding at constant velocity
//! III.2  F_ss = g(V)·sgn V + β·V (16)                    F_e(z_ss) = F_ss (17)
//! III.3  A = -F_e'(z_ss)/(σ + β + g'(V)) (22)            A < 0: the steady state is stable
//! ```
//! EMS states III.3 for constant g and remarks that it also holds for a Stribeck curve. It does
//! not: where β + σ + g'(V) <= 0 the steady state is unstable and the seal shows stick-slip without
//! external excitation. Each value from theory is compared with a simulation of the same element.

use serde::Serialize;
use trocar_model::{Branch, Direction, Element, Mode, Stages, State, VelocityWeakening};

mod energy;
mod stability;

pub use energy::{Cycle, CycleWork, StepError};
pub use stability::{SpeedRange, Stability, StickSlip};

/// Speeds of the tables, m/s: the paper's range (EMS section IV) and slower.
pub const SPEEDS: [f64; 8] = [0.001, 0.005, 0.015, 0.03, 0.05, 0.08, 0.1, 0.2];

/// Points at which a branch is evaluated.
const BRANCH_POINTS: u32 = 2000;

/// Step of the simulations, s.
const STEP: f64 = 1e-4;

/// Range of deflections.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// Lower end, m.
    pub from_m: f64,
    /// Upper end, m.
    pub to_m: f64,
}

/// How the deflection follows one branch until sliding.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BranchPassage {
    /// Motion along the branch.
    #[serde(rename = "direction", serialize_with = "trocar_simulate::segment::direction_as_word")]
    pub direction: Direction,
    /// Where dF_e/dz <= 0, from the start of the motion on. (15) speaks of one such interval, but
    /// its proof asks only that F_e rises outside all of them.
    pub softening: Vec<Interval>,
    /// Highest force in the direction of the motion before the seal snaps through, N; `None` when
    /// the branch rises throughout.
    pub hump_force_n: Option<f64>,
    /// Lowest force after it, N.
    pub dip_force_n: Option<f64>,
    /// F_s, N.
    pub static_force_n: f64,
    /// Whether the seal snaps through before the instrument slides: the hump is below F_s.
    pub snaps_through_first: bool,
    /// Speed above which the seal snaps through although the hump exceeds F_s: (F_hump - F_c)/β,
    /// m/s; infinite without β. `None` when it snaps through at any speed.
    pub critical_speed_m_s: Option<f64>,
    /// Speeds at which the deflection has two equilibria; the history decides which one it reaches.
    pub bistable: Option<SpeedRange>,
    /// Longest travel until sliding over all simulated initial deflections and speeds, m; `None`
    /// when one never slid.
    pub longest_travel_to_sliding_m: Option<f64>,
    /// Whether F_e rises outside the softening intervals and sliding is reached.
    pub holds: bool,
    /// The same in words.
    pub verdict: String,
}

/// Proposition III.1: at constant velocity the element reaches sliding.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReachesSliding {
    /// Both branches.
    pub branches: Vec<BranchPassage>,
    /// Interval outside which the law between the branches also rises, whatever the history.
    pub softening_of_partial_reversals: Option<Interval>,
    /// Whether it holds on both branches.
    pub holds: bool,
}

/// One row of the table of proposition III.2.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SteadyPoint {
    /// V, m/s.
    pub velocity_m_s: f64,
    /// F_ss of (16), N.
    pub force_n: f64,
    /// Deflection at which the simulation settles, m; F_e there is F_ss (17).
    pub deflection_m: f64,
    /// Simulated minus F_ss, N.
    pub simulated_difference_n: f64,
    /// A of (22), 1/s; minus infinity without damping.
    pub eigenvalue_1_s: f64,
    /// -1/A, s; 0 without damping.
    pub time_constant_s: f64,
    /// Whether A < 0 and β + σ + g'(V) > 0.
    pub stable: bool,
}

/// Propositions III.2 and III.3.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SteadyState {
    /// Table over [`SPEEDS`] in both directions.
    pub table: Vec<SteadyPoint>,
    /// Largest difference between simulation and (16) where the steady state is stable, N.
    pub largest_difference_n: f64,
    /// Whether the simulation settles at (16) wherever the steady state is stable.
    pub holds: bool,
    /// The same in words.
    pub verdict: String,
}

/// One element.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ElementAnalysis {
    /// Proposition III.1.
    pub reaches_sliding: ReachesSliding,
    /// Proposition III.2 with the eigenvalues of III.3.
    pub steady_state: SteadyState,
    /// Proposition III.3 for this sliding law.
    pub stability: Stability,
}

/// A seal.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Analysis {
    /// Its elements.
    pub elements: Vec<ElementAnalysis>,
    /// Work dissipated over full cycles.
    pub cycle_work: CycleWork,
    /// Error of the step.
    pub step_error: StepError,
    /// Whether everything holds.
    pub holds: bool,
}

/// Analyses one seal.
pub fn analyze(stages: &Stages) -> Analysis {
    let each: Vec<ElementAnalysis> = stages.elements().iter().map(analyze_element).collect();
    let cycle_work = CycleWork::of(stages);
    let step_error = StepError::of(stages);
    let whole = cycle_work.holds && step_error.holds;
    let holds = whole
        && each
            .iter()
            .all(|e| e.reaches_sliding.holds && e.steady_state.holds && e.stability.holds);
    Analysis { elements: each, cycle_work, step_error, holds }
}

fn analyze_element(element: &Element) -> ElementAnalysis {
    let steady_state = SteadyState::of(element);
    let stability = Stability::of(element, &steady_state.table);
    ElementAnalysis { reaches_sliding: ReachesSliding::of(element), steady_state, stability }
}

impl ReachesSliding {
    fn of(element: &Element) -> Self {
        let branches: Vec<BranchPassage> = Direction::BOTH
            .into_iter()
            .map(|direction| BranchPassage::of(element, direction))
            .collect();
        let partial = element.params().deformation.softening_interval();
        Self {
            holds: branches.iter().all(|branch| branch.holds),
            branches,
            softening_of_partial_reversals: partial.map(|(from_m, to_m)| Interval { from_m, to_m }),
        }
    }
}

impl BranchPassage {
    fn of(element: &Element, direction: Direction) -> Self {
        let c = element.params().deformation.half_width();
        let branch = element.params().deformation.branch(direction);
        let friction = element.params().sliding(direction);
        let softening = softening(branch, c, direction);
        // Seen along the motion: u runs from -c to c, the force counts in the direction of the
        // motion.
        let force = |u: f64| direction.sign() * branch.force(direction.sign() * u);
        let along = |interval: &Interval| match direction {
            Direction::Insertion => (interval.from_m, interval.to_m),
            Direction::Withdrawal => (-interval.to_m, -interval.from_m),
        };
        let hump = softening.iter().map(|i| force(along(i).0)).reduce(f64::max);
        let dip = softening.iter().map(|i| force(along(i).1)).reduce(f64::min);
        let snaps_through_first = hump.is_none_or(|hump| hump < friction.static_force);
        let excess =
            |force: f64| (force - friction.coulomb_force).max(0.0) / friction.viscous_damping;
        let critical = hump.filter(|_| !snaps_through_first).map(excess);
        let bistable =
            critical.zip(dip).map(|(to_m_s, dip)| SpeedRange { from_m_s: excess(dip), to_m_s });
        let travel = longest_travel_to_sliding(element, direction);
        let holds = travel.is_some();
        let mut passage = Self {
            direction,
            softening,
            hump_force_n: hump,
            dip_force_n: dip,
            static_force_n: friction.static_force,
            snaps_through_first,
            critical_speed_m_s: critical,
            bistable,
            longest_travel_to_sliding_m: travel,
            holds,
            verdict: String::new(),
        };
        passage.verdict = passage.in_words();
        passage
    }

    fn in_words(&self) -> String {
        if self.longest_travel_to_sliding_m.is_none() {
            return "sliding is not reached within ten half widths of travel".to_owned();
        }
        let many = match self.softening.len() {
            0 | 1 => String::new(),
            intervals => format!(
                "; (15) holds with one interval around the {intervals} on which the branch softens"
            ),
        };
        match (self.hump_force_n, self.critical_speed_m_s) {
            (None, _) => {
                "the branch rises throughout; the seal deforms until the instrument slides"
                    .to_owned()
            }
            (Some(hump), None) => format!(
                "the seal snaps through at {hump:.3} N, below F_s = {:.3} N, then slides{many}",
                self.static_force_n
            ),
            (Some(hump), Some(speed)) => format!(
                "the hump of {hump:.3} N exceeds F_s = {:.3} N: the instrument slides before the seal snaps through, which \
                 happens above {:.1} mm/s only; the deflection then has two equilibria{many}",
                self.static_force_n,
                1e3 * speed
            ),
        }
    }
}

/// Where the branch does not rise, in the order of the motion.
fn softening(branch: &Branch, c: f64, direction: Direction) -> Vec<Interval> {
    let mut found: Vec<Interval> = Vec::new();
    let mut start = None;
    for k in 0..=BRANCH_POINTS {
        let z = c * (2.0 * f64::from(k) / f64::from(BRANCH_POINTS) - 1.0);
        match (branch.stiffness(z) <= 0.0, start) {
            (true, None) => start = Some(z),
            (false, Some(from_m)) => {
                found.push(Interval { from_m, to_m: z });
                start = None;
            }
            _ => {}
        }
    }
    found.extend(start.map(|from_m| Interval { from_m, to_m: c }));
    if direction == Direction::Withdrawal {
        found.reverse();
    }
    found
}

/// Travel, m, until the instrument slides, the longest over starts across [-c, c] and [`SPEEDS`].
fn longest_travel_to_sliding(element: &Element, direction: Direction) -> Option<f64> {
    const STARTS: u32 = 16;
    let c = element.params().deformation.half_width();
    let starts = (0..=STARTS).map(|k| c * (2.0 * f64::from(k) / f64::from(STARTS) - 1.0));
    let mut longest = 0.0_f64;
    for start in starts {
        for speed in SPEEDS {
            longest = longest.max(travel_to_sliding(element, start, direction.sign() * speed)?);
        }
    }
    Some(longest)
}

fn travel_to_sliding(element: &Element, start: f64, velocity: f64) -> Option<f64> {
    const PARTS: u32 = 1000;
    let c = element.params().deformation.half_width();
    let part = 10.0 * c / f64::from(PARTS);
    let mut state = element.rest_state(start);
    for k in 1..=PARTS {
        element.step(&mut state, velocity.signum() * part, part / velocity.abs());
        if state.mode() == Mode::Sliding && state.slip_velocity() * velocity > 0.0 {
            return Some(f64::from(k) * part);
        }
    }
    None
}

impl SteadyState {
    fn of(element: &Element) -> Self {
        let velocities = Direction::BOTH
            .into_iter()
            .flat_map(|direction| SPEEDS.map(|speed| (direction, speed)));
        let table: Vec<SteadyPoint> = velocities
            .map(|(direction, speed)| SteadyPoint::of(element, direction, speed))
            .collect();
        let stable = table.iter().filter(|point| point.stable);
        let largest = stable.map(|point| point.simulated_difference_n.abs()).fold(0.0, f64::max);
        let allowed = 1e-6
            * element.params().insertion.static_force.max(element.params().withdrawal.static_force);
        let holds = largest <= allowed;
        let verdict = if holds {
            "at constant velocity the simulated force comes to rest at g(V)·sgn V + β·V wherever this is stable"
        } else {
            "the simulated force does not come to rest at g(V)·sgn V + β·V, although this is stable"
        };
        Self { table, largest_difference_n: largest, holds, verdict: verdict.to_owned() }
    }
}

impl SteadyPoint {
    fn of(element: &Element, direction: Direction, speed: f64) -> Self {
        let friction = element.params().sliding(direction);
        let velocity = direction.sign() * speed;
        let force_n = direction.sign() * friction.force(speed); // EMS (16)
        let state = settled(element, velocity);
        let rate = stability::rate(element, direction, speed, state.deflection());
        Self {
            velocity_m_s: velocity,
            force_n,
            deflection_m: state.deflection(),
            simulated_difference_n: state.force() - force_n,
            eigenvalue_1_s: rate.eigenvalue,
            time_constant_s: -1.0 / rate.eigenvalue,
            stable: rate.stable,
        }
    }
}

/// State after sliding at `velocity` (m/s) until all transients have decayed.
fn settled(element: &Element, velocity: f64) -> State {
    const PARTS: u32 = 400;
    let params = element.params();
    let deformation = &params.deformation;
    let softest = deformation.end_stiffness().0.min(deformation.end_stiffness().1);
    let damping = params.insertion.viscous_damping.max(params.withdrawal.viscous_damping);
    let slowest = (damping + params.damping.coefficient(0.0)) / softest;
    let time = 10.0 * deformation.half_width() / velocity.abs() + 60.0 * slowest;
    let mut state = element.rest_state(-velocity.signum() * deformation.half_width());
    for _ in 0..PARTS {
        element.step_velocity(&mut state, velocity, time / f64::from(PARTS));
    }
    state
}

/// Whether the step is exact: constant friction, no damping of the seal, no creep or relaxation,
/// and branches that stay within the limits.
fn is_exact(element: &Element) -> bool {
    let params = element.params();
    let unique = element.velocity_weakening() == (VelocityWeakening::None, VelocityWeakening::None);
    let humps = Direction::BOTH
        .into_iter()
        .all(|direction| BranchPassage::of(element, direction).snaps_through_first);
    let slow =
        params.creep_velocity > 0.0 || params.dwell_force > 0.0 || !params.relaxation.is_none();
    unique
        && humps
        && !slow
        && params.insertion.is_constant()
        && params.withdrawal.is_constant()
        && params.damping.is_zero()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trocar_model::{
        DeformationForce, ElementParams, Piece, Relaxation, SealDamping, SlidingFriction,
    };

    fn plausible() -> ElementParams {
        ElementParams::plausible_10_5_mm().unwrap()
    }

    /// A linear spring of K = 500 N/m that slides with F_c 2, F_s 3 N, v_s 20 mm/s, β = 5 N·s/m.
    fn stribeck() -> Element {
        let friction = SlidingFriction {
            coulomb_force: 2.0,
            static_force: 3.0,
            stribeck_velocity: 0.02,
            stribeck_exponent: 2.0,
            viscous_damping: 5.0,
        };
        Element::new(ElementParams {
            deformation: DeformationForce::linear(500.0, 3.0 / 500.0).unwrap(),
            damping: SealDamping::ZERO,
            insertion: friction,
            withdrawal: friction,
            creep_velocity: 0.0,
            friction_lag: 0.0,
            dwell_force: 0.0,
            relaxation: Relaxation::NONE,
        })
        .unwrap()
    }

    #[test]
    fn everything_holds_for_the_plausible_seal() {
        let found = analyze(&Element::new(plausible()).unwrap().into());
        assert!(found.holds, "{found:#?}");
        let insertion = &found.elements[0].reaches_sliding.branches[0];
        assert!(
            insertion.softening[0].from_m < -2.2e-3
                && insertion.softening.last().unwrap().to_m < 2e-3
        );
        assert!((insertion.hump_force_n.unwrap() - 1.15).abs() < 0.01, "{insertion:?}");
        assert!((insertion.dip_force_n.unwrap() - 0.64).abs() < 0.01, "{insertion:?}");
        let travel = insertion.longest_travel_to_sliding_m.unwrap();
        assert!(
            (0.016..0.017).contains(&travel),
            "one full snap-through of 2c = 16 mm, got {travel}"
        );
    }

    /// From an independent computation: at 15 mm/s the force oscillates between 2.22 and 3.00 N and
    /// never reaches the steady 2.64 N; at 60 mm/s it does.
    #[test]
    fn strong_stribeck_friction_sticks_and_slips() {
        let found = analyze(&stribeck().into());
        let stability = &found.elements[0].stability;
        assert!(!stability.holds && !stability.unique_slip_speed && !found.holds);
        let range = stability.stick_slip[0].unstable;
        assert!(range.from_m_s < 0.015 && 0.015 < range.to_m_s && range.to_m_s < 0.06, "{range:?}");
        assert!((stability.stick_slip[0].highest_force_n - 3.0).abs() < 0.01, "{stability:?}");
        assert!((stability.stick_slip[0].lowest_force_n - 2.22).abs() < 0.02, "{stability:?}");
        let at = |v: f64| {
            *found.elements[0].steady_state.table.iter().find(|p| p.velocity_m_s == v).unwrap()
        };
        assert!(!at(0.015).stable && (at(0.015).force_n - 2.64).abs() < 0.01);
        assert!(at(0.08).stable && at(0.08).simulated_difference_n.abs() < 1e-6);
        assert!(found.elements[0].steady_state.holds);
    }

    /// A hump above F_s: the seal snaps through only above (F_hump - F_c)/β.
    #[test]
    fn a_hump_above_the_static_force_is_passed_at_speed_only() {
        let plausible = plausible();
        let scaled = |branch: &Branch| {
            let ends = [branch.force(-8e-3), branch.force(8e-3)];
            let piece = |p: &Piece| {
                // From 3 N at the ends to 1 N with the interior unchanged: a straight line is
                // subtracted.
                let mut legendre: Vec<f64> = p.legendre().to_vec();
                let slope = (ends[1] - 2.0 * 1.0 - ends[0]) / (2.0 * 8e-3);
                legendre[0] -= slope * 0.5 * (p.from() + p.to());
                legendre[1] -= slope * 0.5 * (p.to() - p.from());
                Piece::new(p.from(), p.to(), &legendre).unwrap()
            };
            Branch::new(piece(branch.left()), piece(branch.right())).unwrap()
        };
        let friction = SlidingFriction::coulomb(1.0, 5.0);
        let element = Element::new(ElementParams {
            deformation: DeformationForce::new(
                scaled(plausible.deformation.insertion()),
                scaled(plausible.deformation.withdrawal()),
                None,
            )
            .unwrap(),
            damping: SealDamping::ZERO,
            insertion: friction,
            withdrawal: friction,
            creep_velocity: 0.0,
            friction_lag: 0.0,
            dwell_force: 0.0,
            relaxation: Relaxation::NONE,
        })
        .unwrap();
        let passage = &analyze(&element.into()).elements[0].reaches_sliding.branches[0];
        assert!(!passage.snaps_through_first, "{passage:?}");
        let critical = passage.critical_speed_m_s.unwrap();
        let rests_at = |speed: f64| settled(&element, speed).deflection();
        assert!(rests_at(0.9 * critical) < 0.0, "in front of the hump below the critical speed");
        assert!(rests_at(1.1 * critical) > 0.0, "behind it above");
    }
}
