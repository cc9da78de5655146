//! Leader and follower between two samples.

use nalgebra::Matrix4;
use trocar_model::{Trocar, TrocarState};

use super::config::{Config, Device, Operator, Press, Tissue};

/// Iterations for a force that changes within a substep, before the substep counts as stiff.
const ITERATIONS: usize = 5;
/// Change of force below which the iteration ends, N.
const CONVERGED_N: f64 = 1e-9;
/// Part of a substep after which a force is compared with that at its end, and change that counts as a jump, N.
const SHORT: f64 = 1e-6;
const JUMP_N: f64 = 0.05;
/// Bisections for the velocity at the end of a stiff substep.
const BISECTIONS: usize = 80;
/// Doublings of the interval that contains it.
const DOUBLINGS: usize = 60;

/// Position, m, and velocity, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Motion {
    pub(crate) position: f64,
    pub(crate) velocity: f64,
}

/// A damped mass on a spring under a force that is linear in time, over one substep: exact.
///
/// ```text
/// m·dv/dt = f(t) − b·v − k·x
/// ```
#[derive(Debug, Clone, Copy)]
struct Mass {
    /// Position and velocity at the end, from those at the start and from the forces at start and end.
    from_state: [[f64; 2]; 2],
    from_force: [[f64; 2]; 2],
}

impl Mass {
    fn new(mass: f64, damping: f64, stiffness: f64, duration: f64) -> Self {
        // x, v, f and df/dt as one linear system.
        let system = Matrix4::new(
            0.0,
            1.0,
            0.0,
            0.0, //
            -stiffness / mass,
            -damping / mass,
            1.0 / mass,
            0.0, //
            0.0,
            0.0,
            0.0,
            1.0, //
            0.0,
            0.0,
            0.0,
            0.0,
        );
        let end = (system * duration).exp();
        let [(x, fx), (v, fv)] = [0, 1].map(|row| {
            // A force at the end of 1 and at the start of 0 rises at the rate 1/duration.
            let rise = end[(row, 3)] / duration;
            ([end[(row, 0)], end[(row, 1)]], [end[(row, 2)] - rise, rise])
        });
        Self { from_state: [x, v], from_force: [fx, fv] }
    }

    fn moved(&self, from: Motion, [first, last]: [f64; 2]) -> Motion {
        let [position, velocity] = [0, 1].map(|row| {
            let ([a, b], [c, d]) = (self.from_state[row], self.from_force[row]);
            a * from.position + b * from.velocity + c * first + d * last
        });
        Motion { position, velocity }
    }
}

/// Leader with the operator's hand: linear.
#[derive(Debug, Clone)]
pub(crate) struct Leader {
    mass: Mass,
    operator: Operator,
    device: Device,
    pub(crate) motion: Motion,
    /// Of the operator on the leader, J.
    pub(crate) work: f64,
}

impl Leader {
    pub(crate) fn new(config: &Config, position: f64) -> Self {
        let (operator, device) = (config.operator, config.leader);
        let duration = config.sample_time_s / f64::from(config.substeps);
        let mass = Mass::new(
            device.mass_kg + operator.mass_kg,
            device.damping_n_s_m + operator.damping_n_s_m,
            operator.stiffness_n_m,
            duration,
        );
        let motion = Motion { position, velocity: 0.0 };
        Self { mass, operator, device, motion, work: 0.0 }
    }

    /// One substep under the motor force `motor` (N, against the operator); `hand` is the intended motion at its
    /// start and end.
    pub(crate) fn step(&mut self, motor: f64, hand: [Motion; 2]) {
        let forces = hand.map(|hand| self.pull(hand) - motor);
        let (before, from) = (self.operator_force(hand[0], motor), self.motion.position);
        self.motion = self.mass.moved(self.motion, forces);
        let mean = 0.5 * (before + self.operator_force(hand[1], motor));
        self.work += mean * (self.motion.position - from);
    }

    fn pull(&self, hand: Motion) -> f64 {
        self.operator.stiffness_n_m * hand.position + self.operator.damping_n_s_m * hand.velocity
    }

    /// F_h, N: force of the operator on the leader, with `hand` as the intended motion and `motor` as the force
    /// of the motor.
    pub(crate) fn operator_force(&self, hand: Motion, motor: f64) -> f64 {
        let Motion { position, velocity } = self.motion;
        let spring = self.pull(hand)
            - self.operator.stiffness_n_m * position
            - self.operator.damping_n_s_m * velocity;
        let acceleration = (spring - motor - self.device.damping_n_s_m * velocity)
            / (self.device.mass_kg + self.operator.mass_kg);
        spring - self.operator.mass_kg * acceleration
    }
}

/// Follower with instrument, trocar and tissue.
#[derive(Debug, Clone)]
pub(crate) struct Follower<K> {
    mass: Mass,
    device: Device,
    duration: f64,
    tissue: Tissue,
    trocar: Trocar<K>,
    seal: TrocarState,
    press: Press,
    pub(crate) motion: Motion,
    /// Angle of the instrument, rad.
    pub(crate) angle: f64,
    /// F_t, N.
    pub(crate) trocar_force: f64,
    /// F_e, N.
    pub(crate) tissue_force: f64,
    /// Acceleration, m/s².
    pub(crate) acceleration: f64,
    /// Of the instrument on the trocar, J.
    pub(crate) trocar_work: f64,
    /// Of the instrument on the tissue, J.
    pub(crate) tissue_work: f64,
}

/// What the follower meets at the end of a substep.
struct Met {
    seal: TrocarState,
    trocar_force: f64,
    tissue_force: f64,
}

impl Met {
    fn force(&self) -> f64 {
        self.trocar_force + self.tissue_force
    }
}

impl<K: AsRef<[f64]>> Follower<K> {
    pub(crate) fn new(config: &Config, trocar: Trocar<K>, position: f64) -> Self {
        let duration = config.sample_time_s / f64::from(config.substeps);
        let (seal, tissue) = (trocar.rest(position), config.tissue);
        Self {
            mass: Mass::new(config.follower.mass_kg, config.follower.damping_n_s_m, 0.0, duration),
            device: config.follower,
            duration,
            tissue,
            trocar_force: seal.force(),
            tissue_force: tissue.force(0.0, position, 0.0),
            trocar,
            seal,
            press: config.motion,
            motion: Motion { position, velocity: 0.0 },
            angle: 0.0,
            acceleration: 0.0,
            trocar_work: 0.0,
            tissue_work: 0.0,
        }
    }

    /// One substep under the motor force `motor`, N, that ends at `time`, s.
    pub(crate) fn step(&mut self, motor: f64, time: f64) {
        self.angle = self.press.angle(time);
        let first = motor - self.trocar_force - self.tissue_force;
        let mut force = self.trocar_force + self.tissue_force;
        for _ in 0..ITERATIONS {
            let motion = self.mass.moved(self.motion, [first, motor - force]);
            let met = self.met(motion, time);
            let change = met.force() - force;
            force = met.force();
            if change.abs() <= CONVERGED_N {
                if self.jumps(motion, &met) {
                    break;
                }
                let way = motion.position - self.motion.position;
                // ∫F·v dt of a force and a velocity that are linear in time.
                let beside = (motion.velocity - self.motion.velocity) * self.duration / 12.0;
                return self.arrive(motion, met, motor, |before, after| {
                    0.5 * way * (before + after) + beside * (after - before)
                });
            }
        }
        self.step_stiffly(motor, time);
    }

    /// Forces at the end of a substep that leads to `motion`.
    fn met(&self, motion: Motion, time: f64) -> Met {
        let mut seal = self.seal;
        let trocar_force =
            self.trocar.turn_to(&mut seal, motion.position, self.angle, self.duration);
        let tissue_force = self.tissue.force(time, motion.position, motion.velocity);
        Met { seal, trocar_force, tissue_force }
    }

    /// Whether friction jumps where the motion turned within the substep that leads to `motion`: its force, which follows from the
    /// way of the substep, then has the wrong sign for the velocity at its end.
    fn jumps(&self, motion: Motion, met: &Met) -> bool {
        let way = motion.position - self.motion.position;
        if way * motion.velocity >= 0.0 {
            return false;
        }
        let (mut seal, duration) = (met.seal, SHORT * self.duration);
        let position = motion.position + motion.velocity * duration;
        let angle = self.angle + self.press.angle(duration);
        let force = self.trocar.turn_to(&mut seal, position, angle, duration);
        (force - met.trocar_force).abs() > JUMP_N
    }

    /// `work` is that of a force with its values before and after the substep, by the rule by which it was taken.
    fn arrive(&mut self, motion: Motion, met: Met, motor: f64, work: impl Fn(f64, f64) -> f64) {
        let Met { seal, trocar_force, tissue_force } = met;
        self.trocar_work += work(self.trocar_force, trocar_force);
        self.tissue_work += work(self.tissue_force, tissue_force);
        (self.seal, self.trocar_force, self.tissue_force) = (seal, trocar_force, tissue_force);
        self.motion = motion;
        self.acceleration =
            (motor - trocar_force - tissue_force - self.device.damping_n_s_m * motion.velocity)
                / self.device.mass_kg;
    }

    /// The same by the implicit rule of Euler, which holds for seals of any stiffness, up to friction that jumps
    /// where the velocity changes its sign: the velocity at the end is the root of the rising function
    ///
    /// ```text
    /// m·(v − v₀)/h + b·v + F_t(x₀ + h·v) + F_e(x₀ + h·v, v) − F_sc
    /// ```
    fn step_stiffly(&mut self, motor: f64, time: f64) {
        let Device { mass_kg, damping_n_s_m, .. } = self.device;
        let (from, h) = (self.motion, self.duration);
        let motion = |velocity: f64| Motion { position: from.position + h * velocity, velocity };
        let needed = |velocity: f64| {
            motor - mass_kg * (velocity - from.velocity) / h - damping_n_s_m * velocity
        };
        let excess = |velocity: f64| self.met(motion(velocity), time).force() - needed(velocity);
        let Some([mut low, mut high]) = bracket(excess, from.velocity, h / mass_kg) else {
            // Numbers that are not finite; the loop reports them.
            self.motion.velocity = f64::NAN;
            return;
        };
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if excess(middle) > 0.0 {
                high = middle
            } else {
                low = middle
            }
            if middle == low && middle == high {
                break;
            }
        }
        let velocity = 0.5 * (low + high);
        let mut met = self.met(motion(velocity), time);
        // Friction that jumps gives the force that the balance asks for.
        met.trocar_force = needed(velocity) - met.tissue_force;
        let motion = motion(velocity);
        let way = motion.position - from.position;
        self.arrive(motion, met, motor, |_, after| way * after);
    }
}

/// An interval around the root of a rising function; `per_newton` scales its first width.
fn bracket(excess: impl Fn(f64) -> f64, around: f64, per_newton: f64) -> Option<[f64; 2]> {
    let mut width = per_newton.max(1e-9);
    let (mut low, mut high) = (around - width, around + width);
    for _ in 0..DOUBLINGS {
        let signs = (excess(low) > 0.0, excess(high) > 0.0);
        match signs {
            (false, true) => return Some([low, high]),
            (false, false) => high += width,
            (true, _) => low -= width,
        }
        width *= 2.0;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pendulum of mass and spring under a ramp of force, beside the closed form.
    #[test]
    fn a_mass_under_a_ramp_moves_exactly() {
        let (m, k, duration) = (0.5, 200.0, 0.01);
        let moved = Mass::new(m, 0.0, k, duration)
            .moved(Motion { position: 0.01, velocity: 0.3 }, [1.0, 3.0]);
        let (w, rate) = ((k / m).sqrt(), 2.0 / duration);
        let (sin, cos) = (w * duration).sin_cos();
        // Particular solution (f + rate·t)/k, the rest swings.
        let (x, v) = (0.01 - 1.0 / k, 0.3 - rate / k);
        let position = x * cos + v / w * sin + 3.0 / k;
        let velocity = -x * w * sin + v * cos + rate / k;
        assert!((moved.position - position).abs() < 1e-14, "{moved:?} {position}");
        assert!((moved.velocity - velocity).abs() < 1e-12, "{moved:?} {velocity}");
    }
}
