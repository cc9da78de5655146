//! The least work of a closed motion, searched over random cycles.
//!
//! A motion that ends where it began may leave the seal in another state, and one cycle may release
//! energy that the history before it stored. So a cycle is repeated until its response repeats, and
//! its work is
//!
//! ```text
//! W = ∮ F dx over the last repetition, where the seal ends it in the state it began it in
//! ```
//!
//! Why W >= 0: each part of the seal either stores or dissipates energy. Stored are ∫M dz, q²/(2κ)
//! (`elastic.rs`) and a²/(2E) of a relaxing arm. Dissipative are F·v_sl of the contact, whose force
//! has the sign of v_sl with or without creep (11), σ·ż² (9), a²/(E·τ), and the stop at ±h,
//! since κ >= |dh/dz|. The stored energy is the same at both ends of such a repetition, so W is the
//! dissipated energy.
//!
//! The seal may converge slowly to that response, and a seal with stick-slip may never converge. So
//! a bound on the change of stored energy over the repetition accompanies W. Where that bound stays
//! above a thousandth of W, W is the mean over many repetitions, which divides the bound by their
//! number. Only W below minus that bound violates passivity. The search needs no knowledge of the
//! state: it compares repetitions by their forces, sample by sample, and by the deflections at
//! their ends.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use trocar_model::{Element, Stages};

use super::energy::Run;

/// Cycles tried by `analyze`.
pub(super) const CYCLES: u32 = 300;

/// Smallest excursion to either side, m, and largest, in half widths.
const SMALLEST: f64 = 20e-6;
const LARGEST: f64 = 4.0;

/// Speeds, m/s.
const SLOWEST: f64 = 1e-3;
const FASTEST: f64 = 0.15;

/// Rests, s.
const SHORTEST_REST: f64 = 10e-3;
const LONGEST_REST: f64 = 1.0;

/// Most targets of a cycle before it returns to the start.
const MOST_TARGETS: u32 = 8;

/// Moves of the history before a cycle.
const HISTORY: u32 = 6;

/// Steps per half width; fewest and most steps of an amplitude; steps of a rest.
const STEPS_OF_WIDTH: f64 = 128.0;
const FEWEST_STEPS: f64 = 32.0;
const MOST_STEPS: f64 = 512.0;
const STEPS_OF_REST: u32 = 8;

/// Refinement of the steps for a cycle with negative work, applied up to twice.
const FINER: u32 = 8;

/// Most steps spent on the repetitions of one cycle, and fewest and most repetitions. The mean is
/// taken over the second half of them.
const STEPS: usize = 16_000;
const FEWEST_REPETITIONS: usize = 8;
const MOST_REPETITIONS: usize = 512;

/// Two repetitions count as equal when their stored energies differ by less than this fraction of
/// the work.
const EQUAL: f64 = 1e-3;

/// Work that rounding can produce, as a fraction of ∮|F dx|.
const ROUND_OFF: f64 = 1e-9;

/// The cycle of least work among those tried.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WorstCycle {
    /// W, J; a negative value would violate passivity.
    pub work_j: f64,
    /// Upper bound of the change of stored energy over the repetition, J.
    pub stored_j: f64,
    /// Work that rounding can produce, J.
    pub round_off_j: f64,
    /// Half the distance between its extreme positions, m.
    pub amplitude_m: f64,
    /// Slowest motion, m/s.
    pub slowest_m_s: f64,
    /// Fastest motion, m/s.
    pub fastest_m_s: f64,
    /// Time at rest in one repetition, s.
    pub rest_s: f64,
    /// Reversals in one repetition.
    pub turning_points: usize,
    /// Repetitions until the response repeated, or the most tried.
    pub repetitions: usize,
    /// Seed of this cycle; a search with this seed tries it first.
    pub seed: u64,
}

/// Work of random closed cycles, each repeated until the response repeats.
///
/// Excursions from 20 µm to four half widths to either side and speeds from 1 to 150 mm/s, each
/// log-uniform; rests, nested loops, and a random history before each.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RandomCycles {
    /// Cycles tried.
    pub cycles: u32,
    /// Seed of the first; the others use the consecutive numbers.
    pub seed: u64,
    /// Cycles with negative work beyond rounding and stored energy.
    pub giving_work: u32,
    /// Cycles whose response did not become periodic: more than a thousandth of their work may be
    /// stored energy.
    pub unsettled: u32,
    /// The cycle with the least sum of work and stored energy.
    pub worst_cycle: WorstCycle,
    /// Whether no cycle has negative work.
    pub holds: bool,
    /// The same in words.
    pub verdict: String,
}

impl RandomCycles {
    /// Tries `cycles` cycles (at least one) on one seal.
    pub fn search(stages: &Stages, cycles: u32, seed: u64) -> Self {
        let static_force =
            |e: &Element| e.params().insertion.static_force.max(e.params().withdrawal.static_force);
        let scale = Scale {
            half_width: stages.half_width(),
            force: stages.elements().iter().map(static_force).sum(),
        };
        let seal = |random: &mut ChaCha8Rng| {
            Run::at(stages, |element| {
                element.params().deformation.half_width() * random.random_range(-1.0..1.0)
            })
        };
        search(seal, scale, cycles, seed)
    }
}

impl WorstCycle {
    fn gives_work(&self) -> bool {
        self.work_j + self.stored_j < -self.round_off_j
    }

    fn is_settled(&self) -> bool {
        self.stored_j <= (EQUAL * self.work_j.abs()).max(self.round_off_j)
    }
}

/// A model that is driven through a cycle.
trait Driven: Clone {
    /// Advances by `displacement` (m) within `duration` (s); returns the force (N) at the end.
    fn step(&mut self, displacement: f64, duration: f64) -> f64;
    /// Force after the last step, N.
    fn force(&self) -> f64;
    /// Deflection of each element, m.
    fn deflections(&self) -> Vec<f64>;
}

impl Driven for Run<'_> {
    fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        Run::step(self, displacement, duration)
    }

    fn force(&self) -> f64 {
        Run::force(self)
    }

    fn deflections(&self) -> Vec<f64> {
        Run::deflections(self)
    }
}

/// Size of a seal: its half width, m, and its static force, N.
#[derive(Clone, Copy)]
struct Scale {
    half_width: f64,
    force: f64,
}

/// Cycle `k` depends on `seed` + k only.
fn search<S: Driven>(
    start: impl Fn(&mut ChaCha8Rng) -> S + Sync,
    scale: Scale,
    cycles: u32,
    seed: u64,
) -> RandomCycles {
    let tried: Vec<WorstCycle> = (0..u64::from(cycles.max(1)))
        .into_par_iter()
        .map(|k| {
            let seed = seed.wrapping_add(k);
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut seal = start(&mut random);
            wander(&mut seal, scale, &mut random);
            least_work(&seal, &Motion::draw(scale, &mut random), scale, seed)
        })
        .collect();
    RandomCycles::of(&tried, seed)
}

/// The work of one cycle. A negative result is accepted only after it is confirmed with finer
/// steps.
fn least_work<S: Driven>(seal: &S, motion: &Motion, scale: Scale, seed: u64) -> WorstCycle {
    let mut found = motion.work(seal.clone(), 1, scale, seed);
    for fineness in [FINER, FINER * FINER] {
        if !found.gives_work() {
            break;
        }
        found = motion.work(seal.clone(), fineness, scale, seed);
    }
    found
}

impl RandomCycles {
    fn of(tried: &[WorstCycle], seed: u64) -> Self {
        let cycles = tried.len() as u32;
        let giving_work = tried.iter().filter(|cycle| cycle.gives_work()).count() as u32;
        let unsettled = tried.iter().filter(|cycle| !cycle.is_settled()).count() as u32;
        let least = |cycle: &WorstCycle| cycle.work_j + cycle.stored_j;
        let worst_cycle =
            tried.iter().copied().reduce(|a, b| if least(&b) < least(&a) { b } else { a });
        let worst_cycle = worst_cycle.expect("at least one cycle is tried");
        let verdict = match giving_work {
            0 => format!("none of {cycles} random closed cycles gives work"),
            _ => format!(
                "{giving_work} of {cycles} random closed cycles give work: the seal is not passive"
            ),
        };
        let holds = giving_work == 0;
        Self { cycles, seed, giving_work, unsettled, worst_cycle, holds, verdict }
    }
}

/// A random history: moves within two half widths to either side, and rests.
fn wander<S: Driven>(seal: &mut S, scale: Scale, random: &mut ChaCha8Rng) {
    let step = scale.half_width / STEPS_OF_WIDTH;
    for _ in 0..HISTORY {
        let steps = (2.0 * STEPS_OF_WIDTH * random.random_range(-1.0..1.0_f64)) as i32;
        let speed = between(SLOWEST, FASTEST, random);
        for _ in 0..steps.abs() {
            seal.step(f64::from(steps.signum()) * step, step / speed);
        }
        rest(random).map(|time| seal.step(0.0, time));
    }
}

/// A log-uniform random number.
fn between(low: f64, high: f64, random: &mut ChaCha8Rng) -> f64 {
    low * (high / low).powf(random.random_range(0.0..1.0))
}

/// Duration of a rest, s; in three of four cases there is none.
fn rest(random: &mut ChaCha8Rng) -> Option<f64> {
    (random.random_range(0..4) == 0).then(|| between(SHORTEST_REST, LONGEST_REST, random))
}

/// A closed motion on a grid, so that it ends exactly where it began and visits the same positions
/// in both directions.
#[derive(Debug, Clone, PartialEq)]
struct Motion {
    /// Grid, m.
    step: f64,
    legs: Vec<Leg>,
}

/// A move at constant speed and the rest after it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Leg {
    /// Steps of the grid, negative on withdrawal.
    steps: i32,
    /// m/s.
    speed: f64,
    /// s; 0 for none.
    rest: f64,
}

/// Result of one repetition.
#[derive(Clone)]
struct Repetition {
    work: f64,
    /// ∮|F dx|, J.
    traffic: f64,
    forces: Vec<f64>,
    deflections: Vec<f64>,
}

impl Motion {
    fn draw(scale: Scale, random: &mut ChaCha8Rng) -> Self {
        let largest = LARGEST * scale.half_width;
        let amplitude = between(SMALLEST.min(0.5 * largest), largest, random);
        let steps =
            (STEPS_OF_WIDTH * amplitude / scale.half_width).clamp(FEWEST_STEPS, MOST_STEPS).round();
        let targets = random.random_range(1..=MOST_TARGETS);
        let nested = random.random_range(0..2) == 0;
        let (mut at, mut reach, mut side) =
            (0, 1.0, if random.random_range(0..2) == 0 { 1.0 } else { -1.0 });
        let mut legs = Vec::new();
        for k in 0..=targets {
            let target = if k == targets {
                0
            } else if nested {
                // Nested loops of decreasing size.
                reach *= random.random_range(0.5..1.0);
                side = -side;
                (side * reach * steps) as i32
            } else {
                (steps * random.random_range(-1.0..1.0)).round() as i32
            };
            let speed = between(SLOWEST, FASTEST, random);
            legs.push(Leg { steps: target - at, speed, rest: rest(random).unwrap_or(0.0) });
            at = target;
        }
        if legs.iter().all(|leg| leg.steps == 0) {
            legs[0].steps = steps as i32;
            legs[1].steps = -legs[0].steps;
        }
        Self { step: amplitude / steps, legs }
    }

    /// Displacements, m, and durations, s, on a grid refined by `fineness`.
    fn moves(&self, fineness: u32) -> Vec<(f64, f64)> {
        let fine = f64::from(fineness);
        let mut moves = Vec::new();
        for leg in &self.legs {
            let step = self.step / fine;
            let count = (leg.steps.unsigned_abs() * fineness) as usize;
            moves.extend(std::iter::repeat_n(
                (f64::from(leg.steps.signum()) * step, step / leg.speed),
                count,
            ));
            let parts = if leg.rest > 0.0 { STEPS_OF_REST * fineness } else { 0 };
            moves.extend(std::iter::repeat_n(
                (0.0, leg.rest / f64::from(parts.max(1))),
                parts as usize,
            ));
        }
        moves
    }

    /// Repeats the motion until the response of `seal` repeats, and returns the work of the last
    /// repetition.
    fn work<S: Driven>(&self, mut seal: S, fineness: u32, scale: Scale, seed: u64) -> WorstCycle {
        let moves = self.moves(fineness);
        let most = (STEPS / moves.len()).clamp(FEWEST_REPETITIONS, MOST_REPETITIONS);
        let mut last = repeat(&mut seal, &moves);
        let (mut middle, mut work) = (None, 0.0);
        for repetition in 2..=most {
            let next = repeat(&mut seal, &moves);
            let stored = next.may_have_stored(&last, scale);
            if stored <= (EQUAL * next.work.abs()).max(next.round_off()) {
                return self.cycle(&next, stored, repetition, seed);
            }
            work += next.work;
            if repetition == most / 2 {
                (middle, work) = (Some(next.clone()), 0.0);
            }
            last = next;
        }
        let counted = (most - most / 2) as f64;
        let stored = middle.map_or(0.0, |middle| last.may_have_stored(&middle, scale)) / counted;
        self.cycle(&Repetition { work: work / counted, ..last }, stored, most, seed)
    }

    fn cycle(&self, last: &Repetition, stored_j: f64, repetitions: usize, seed: u64) -> WorstCycle {
        let moving = || self.legs.iter().filter(|leg| leg.steps != 0);
        let (mut at, mut lowest, mut highest) = (0, 0, 0);
        for leg in &self.legs {
            at += leg.steps;
            (lowest, highest) = (lowest.min(at), highest.max(at));
        }
        let senses: Vec<i32> = moving().map(|leg| leg.steps.signum()).collect();
        let followers = senses.iter().cycle().skip(1);
        WorstCycle {
            work_j: last.work,
            stored_j,
            round_off_j: last.round_off(),
            amplitude_m: 0.5 * f64::from(highest - lowest) * self.step,
            slowest_m_s: moving().map(|leg| leg.speed).fold(f64::INFINITY, f64::min),
            fastest_m_s: moving().map(|leg| leg.speed).fold(0.0, f64::max),
            rest_s: self.legs.iter().map(|leg| leg.rest).sum(),
            turning_points: senses.iter().zip(followers).filter(|(one, next)| one != next).count(),
            repetitions,
            seed,
        }
    }
}

/// Runs once through `moves`; the work is integrated by the trapezoidal rule.
fn repeat<S: Driven>(seal: &mut S, moves: &[(f64, f64)]) -> Repetition {
    let (mut work, mut traffic, mut before) = (0.0, 0.0, seal.force());
    let forces = moves.iter().map(|&(displacement, duration)| {
        let force = seal.step(displacement, duration);
        let part = 0.5 * (before + force) * displacement;
        (work, traffic) = (work + part, traffic + part.abs());
        before = force;
        force
    });
    let forces = forces.collect();
    Repetition { work, traffic, forces, deflections: seal.deflections() }
}

impl Repetition {
    fn round_off(&self) -> f64 {
        ROUND_OFF * self.traffic
    }

    /// Largest difference of force, N, over all samples, and of deflection, m, at the end.
    fn differs_from(&self, other: &Self) -> (f64, f64) {
        let largest = |one: &[f64], two: &[f64]| {
            one.iter().zip(two).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        (largest(&self.forces, &other.forces), largest(&self.deflections, &other.deflections))
    }

    /// Upper bound of the difference in stored energy between the ends of two repetitions, J. A
    /// spring between two deflections stores at most the highest force times their distance. An
    /// internal one, no softer than F_s/c, stores at most F·ΔF/(F_s/c).
    fn may_have_stored(&self, other: &Self, scale: Scale) -> f64 {
        let highest = self
            .forces
            .iter()
            .chain(&other.forces)
            .fold(0.0_f64, |highest, force| highest.max(force.abs()));
        let (force, deflection) = self.differs_from(other);
        highest
            * (deflection * self.deflections.len() as f64 + force * scale.half_width / scale.force)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trocar_model::{ElementParams, Friction, Gms, GmsElement, SlidingFriction, SlipRate};

    const SCALE: Scale = Scale { half_width: 3e-3, force: 3.0 };

    /// A friction model without deflection.
    #[derive(Clone)]
    struct Bare<M: Friction> {
        model: M,
        state: M::State,
    }

    impl<M: Friction + Clone> Driven for Bare<M> {
        fn step(&mut self, displacement: f64, duration: f64) -> f64 {
            self.model.step(&mut self.state, displacement, duration)
        }

        fn force(&self) -> f64 {
            M::force(&self.state)
        }

        fn deflections(&self) -> Vec<f64> {
            Vec::new()
        }
    }

    /// A spring whose force leads its position by 1 ms: a negative damper.
    #[derive(Clone)]
    struct Ahead {
        position: f64,
        force: f64,
    }

    impl Driven for Ahead {
        fn step(&mut self, displacement: f64, duration: f64) -> f64 {
            self.position += displacement;
            self.force = 1000.0 * (self.position - 1e-3 * displacement / duration);
            self.force
        }

        fn force(&self) -> f64 {
            self.force
        }

        fn deflections(&self) -> Vec<f64> {
            vec![self.position]
        }
    }

    fn gms(slip_rate: SlipRate) -> RandomCycles {
        let element = GmsElement { stiffness: 1000.0, share: 1.0, attraction: 0.1, damping: 0.0 };
        let friction = SlidingFriction {
            coulomb_force: 2.0,
            static_force: 3.0,
            stribeck_velocity: 0.01,
            stribeck_exponent: 2.0,
            viscous_damping: 0.0,
        };
        let model = Gms::new(&[element], friction, slip_rate).unwrap();
        search(|_| Bare { model, state: Friction::rest_at_force(&model, 0.0) }, SCALE, CYCLES, 1)
    }

    #[test]
    fn a_negative_damper_is_found() {
        let found = search(|_| Ahead { position: 0.0, force: 0.0 }, SCALE, CYCLES, 1);
        assert!(!found.holds && found.giving_work > CYCLES / 2, "{found:#?}");
        assert!(found.worst_cycle.work_j < -1e-3, "{found:#?}");
    }

    /// With F_s > F_c an element of the law as printed loads from F_c to F_s without moving (GMS in
    /// SOURCES.md); with a limited rate it does not.
    #[test]
    fn a_law_known_to_give_work_is_found_and_its_cure_is_not() {
        let (printed, cured) = (gms(SlipRate::Free), gms(SlipRate::Limited));
        assert!(!printed.holds && printed.worst_cycle.work_j < -1e-4, "{printed:#?}");
        assert!(cured.holds, "{cured:#?}");
    }

    #[test]
    fn the_worst_cycle_is_the_first_one_of_its_own_seed() {
        let stages =
            Stages::new(&[Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap(); 2])
                .unwrap();
        let found = RandomCycles::search(&stages, 50, 7);
        let alone = RandomCycles::search(&stages, 1, found.worst_cycle.seed);
        assert_eq!(alone.worst_cycle, found.worst_cycle);
        assert!((7..57).contains(&found.worst_cycle.seed));
    }

    #[test]
    fn cycles_are_closed_and_cover_what_they_are_said_to() {
        let motions: Vec<Motion> = (0..2000)
            .map(|seed| Motion::draw(SCALE, &mut ChaCha8Rng::seed_from_u64(seed)))
            .collect();
        assert!(
            motions.iter().all(|motion| motion.legs.iter().map(|leg| leg.steps).sum::<i32>() == 0)
        );
        let worst: Vec<WorstCycle> = motions
            .iter()
            .map(|motion| {
                motion.cycle(
                    &repeat(&mut Ahead { position: 0.0, force: 0.0 }, &motion.moves(1)),
                    0.0,
                    1,
                    0,
                )
            })
            .collect();
        assert!(
            worst.iter().all(|cycle| cycle.turning_points >= 2 && cycle.turning_points % 2 == 0)
        );
        let some = |what: &dyn Fn(&WorstCycle) -> bool| worst.iter().any(what);
        assert!(
            some(&|cycle| cycle.amplitude_m < 30e-6)
                && some(&|cycle| cycle.amplitude_m > 3.0 * SCALE.half_width)
        );
        assert!(
            some(&|cycle| cycle.slowest_m_s < 1.2e-3) && some(&|cycle| cycle.fastest_m_s > 0.14)
        );
        assert!(some(&|cycle| cycle.turning_points >= 8) && some(&|cycle| cycle.rest_s > 1.0));
    }
}
