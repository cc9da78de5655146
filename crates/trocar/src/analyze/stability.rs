//! Proposition III.3, and the stick-slip where it fails.

use serde::Serialize;
use trocar_model::{Direction, Element, VelocityWeakening};

use super::{STEP, SteadyPoint};

/// Range of speeds searched for instability, m/s.
const SLOWEST: f64 = 1e-6;
const FASTEST: f64 = 1.0;

/// A range of speeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpeedRange {
    /// Lower end, m/s.
    pub from_m_s: f64,
    /// Upper end, m/s.
    pub to_m_s: f64,
}

/// Self-excited oscillation of the seal at a constant speed in the unstable range, simulated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StickSlip {
    /// Direction of the motion.
    #[serde(rename = "direction", serialize_with = "trocar_simulate::segment::direction_as_word")]
    pub direction: Direction,
    /// Speeds at which steady sliding is unstable.
    pub unstable: SpeedRange,
    /// Simulated speed, m/s.
    pub speed_m_s: f64,
    /// Lowest force, in the direction of the motion, N.
    pub lowest_force_n: f64,
    /// Highest force, in the direction of the motion, N.
    pub highest_force_n: f64,
    /// Frequency of the oscillation; 0 when fewer than two periods were found.
    pub frequency_hz: f64,
}

/// Proposition III.3 for the element's own sliding law.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stability {
    /// Whether each force determines one slip speed at all times, in both directions.
    pub unique_slip_speed: bool,
    /// Slip speeds between which the sliding force falls with speed (velocity weakening), for
    /// insertion and withdrawal.
    pub velocity_weakening: [Option<SpeedRange>; 2],
    /// Longest time constant of the stable steady states, s.
    pub longest_time_constant_s: f64,
    /// Simulated oscillations where steady sliding is unstable.
    pub stick_slip: Vec<StickSlip>,
    /// Whether every steady state from 1 um/s to 1 m/s is stable.
    pub holds: bool,
    /// The verdict in words.
    pub verdict: String,
}

/// Linearised dynamics of the deflection at a steady state.
pub(super) struct Rate {
    /// A of (22), 1/s.
    pub(super) eigenvalue: f64,
    /// A < 0 with a positive denominator.
    pub(super) stable: bool,
}

/// EMS (22) with g'(V) and σ(0) in the denominator, at `deflection`.
pub(super) fn rate(element: &Element, direction: Direction, speed: f64, deflection: f64) -> Rate {
    let deformation = &element.params().deformation;
    let (negative, positive) = deformation.end_stiffness();
    let stiffness = if deflection >= deformation.half_width() {
        positive
    } else if deflection <= -deformation.half_width() {
        negative
    } else {
        deformation
            .insertion()
            .stiffness(deflection)
            .min(deformation.withdrawal().stiffness(deflection))
    };
    let drag = drag(element, direction, speed);
    Rate { eigenvalue: -stiffness / drag, stable: stiffness > 0.0 && drag >= 0.0 }
}

/// β + σ(0) + g'(V), N·s/m.
fn drag(element: &Element, direction: Direction, speed: f64) -> f64 {
    let friction = element.params().sliding(direction);
    let damping = friction.viscous_damping + element.params().damping.coefficient(0.0);
    if friction.is_constant() {
        return damping;
    }
    let step = 1e-4 * speed;
    damping + (friction.level(speed + step) - friction.level(speed - step)) / (2.0 * step)
}

impl Stability {
    pub(super) fn of(element: &Element, table: &[SteadyPoint]) -> Self {
        let (insertion, withdrawal) = element.velocity_weakening();
        let velocity_weakening = [insertion, withdrawal].map(|weakening| match weakening {
            VelocityWeakening::Between { from, to } => {
                Some(SpeedRange { from_m_s: from, to_m_s: to })
            }
            VelocityWeakening::None => None,
        });
        let stick_slip: Vec<StickSlip> = Direction::BOTH
            .into_iter()
            .filter_map(|direction| StickSlip::of(element, direction))
            .collect();
        let stable = table.iter().filter(|point| point.stable);
        let longest = stable.map(|point| point.time_constant_s).fold(0.0, f64::max);
        let holds = stick_slip.is_empty() && table.iter().all(|point| point.stable);
        let verdict = match stick_slip.first() {
            None if holds => "steady sliding is stable at every speed".to_owned(),
            None => "at some speeds the seal comes to rest where it softens".to_owned(),
            Some(found) => format!(
                "steady sliding is unstable from {:.2} to {:.2} mm/s (β + σ + g' <= 0): the seal sticks and slips by \
                 itself, at {:.2} mm/s between {:.3} and {:.3} N",
                1e3 * found.unstable.from_m_s,
                1e3 * found.unstable.to_m_s,
                1e3 * found.speed_m_s,
                found.lowest_force_n,
                found.highest_force_n
            ),
        };
        let unique_slip_speed = velocity_weakening.iter().all(Option::is_none);
        Self {
            unique_slip_speed,
            velocity_weakening,
            longest_time_constant_s: longest,
            stick_slip,
            holds,
            verdict,
        }
    }
}

impl StickSlip {
    /// Simulates at the middle (geometric) of the unstable speeds; `None` when there are none.
    fn of(element: &Element, direction: Direction) -> Option<Self> {
        let unstable = unstable_speeds(element, direction)?;
        let speed = (unstable.from_m_s * unstable.to_m_s).sqrt();
        let params = element.params();
        let c = params.deformation.half_width();
        let relaxed = params.deformation.end_stiffness();
        // The seal is reloaded from F_c to F_s at this speed; ten such times and the way to the
        // limit are enough to see.
        let friction = element.params().sliding(direction);
        let reload =
            (friction.static_force - friction.coulomb_force) / (relaxed.0.min(relaxed.1) * speed);
        let step = STEP.min(reload / 500.0);
        let mut state = element.rest_state(0.0);
        let way = (10.0 * c / speed / step) as usize;
        let sign = direction.sign();
        for _ in 0..way.min(2_000_000) {
            element.step_velocity(&mut state, sign * speed, step);
        }
        let watched = (10.0 * reload / step) as usize;
        let forces =
            (0..watched).map(|_| sign * element.step_velocity(&mut state, sign * speed, step));
        let forces: Vec<f64> = forces.collect();
        let low = forces.iter().copied().fold(f64::INFINITY, f64::min);
        let high = forces.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let middle = 0.5 * (low + high);
        let rises = forces.windows(2).filter(|pair| pair[0] < middle && pair[1] >= middle).count();
        let frequency_hz = if rises > 1 { rises as f64 / (watched as f64 * step) } else { 0.0 };
        Some(Self {
            direction,
            unstable,
            speed_m_s: speed,
            lowest_force_n: low,
            highest_force_n: high,
            frequency_hz,
        })
    }
}

/// Speeds at which β + σ + g'(V) <= 0, from 1 um/s to 1 m/s.
fn unstable_speeds(element: &Element, direction: Direction) -> Option<SpeedRange> {
    const POINTS: i32 = 600;
    let at = |k: i32| SLOWEST * (FASTEST / SLOWEST).powf(f64::from(k) / f64::from(POINTS));
    let unstable = |k: &i32| drag(element, direction, at(*k)) < 0.0;
    let first = (0..=POINTS).find(unstable)?;
    let last = (0..=POINTS).rev().find(unstable)?;
    let edge = |inside: i32, outside: i32| {
        if !(0..=POINTS).contains(&outside) {
            return at(inside);
        }
        let (mut yes, mut no) = (at(inside), at(outside));
        for _ in 0..50 {
            let middle = 0.5 * (yes + no);
            if drag(element, direction, middle) < 0.0 { yes = middle } else { no = middle }
        }
        0.5 * (yes + no)
    };
    Some(SpeedRange { from_m_s: edge(first, first - 1), to_m_s: edge(last, last + 1) })
}
