//! Motor, guide, rod and seal, integrated together.

use trocar_model::{
    Element, SealState, SlidingFriction, Stages, State, Trocar, TrocarState, Turning, step_parallel,
};

use super::config::{BenchConfig, Controller, Motor, PushCycles};
use super::fluctuation::{SealLevel, drift};
use super::motion::Reference;
use super::surroundings::{Wetting, loads_at, tissue_force};
use super::{BenchError, Course, Log, RigEvents};

/// PI speed controller with anti-windup: the integral is held while the motor is at its limit and
/// the error would increase it.
#[derive(Debug)]
struct SpeedControl {
    gains: Controller,
    integral: f64,
}

impl SpeedControl {
    fn command(&mut self, error: f64, duration: f64, limit: (f64, f64)) -> f64 {
        let raised = self.integral + self.gains.integral_n_m * error * duration;
        let command = self.gains.proportional_n_s_m * error + raised;
        let winding_up = (command > limit.1 && error > 0.0) || (command < limit.0 && error < 0.0);
        if winding_up {
            self.gains.proportional_n_s_m * error + self.integral
        } else {
            self.integral = raised;
            command
        }
    }
}

/// Constant force on insertion and on withdrawal, reversed at the ends of the stroke.
#[derive(Debug)]
pub(super) struct Push {
    cycles: PushCycles,
    insertion: f64,
    withdrawal: f64,
}

impl Push {
    /// The force that keeps this seal and the guide sliding at the requested speed, as an operator
    /// would find it.
    pub(super) fn new(config: &BenchConfig, seal: &[Element]) -> Self {
        let cycles = config.protocol.dynamic.clone();
        let motor = &config.motor;
        let speed = cycles.sliding_speed_m_s;
        let guide = motor.drag_n_s_m * speed + motor.guide_friction_n;
        let total = |friction: fn(&Element) -> &SlidingFriction| {
            guide + seal.iter().map(|element| friction(element).force(speed)).sum::<f64>()
        };
        // The weight that is not counterbalanced and the gas pressure act alike in both directions.
        let moving_mass = motor.slider_mass_kg + config.rod.mass_kg;
        let carried = (1.0 - motor.balanced_fraction) * moving_mass * config.rod.gravity_m_s2;
        let bias = config.rod.gas_force() - carried;
        Self {
            insertion: total(|element| &element.params().insertion) + bias,
            withdrawal: -total(|element| &element.params().withdrawal) + bias,
            cycles,
        }
    }
}

/// Travel over which the friction of the cannula takes the direction of the motion, m.
const REACH: f64 = 2e-5;

/// The moving rig.
#[derive(Debug)]
pub(super) struct RigState<'a> {
    config: &'a BenchConfig,
    seal: &'a [Element],
    states: Vec<State>,
    /// The seal where it resists rotation, and what turns the rod.
    turning: Option<(Trocar, TrocarState)>,
    course: Option<Course>,
    level: SealLevel,
    control: SpeedControl,
    moving_mass: f64,
    step_duration: f64,
    force_lag: f64,
    position: f64,
    velocity: f64,
    acceleration: f64,
    reference_velocity: f64,
    motor_force: f64,
    seal_force: f64,
    torque: f64,
    /// Side force, N, tilt, rad, and pressure, Pa.
    loads: [f64; 3],
    /// Direction in which the cannula rubs, −1 to 1.
    direction: f64,
    tissue_force: f64,
    /// Since the first sample, s; below 0 before.
    time: f64,
    events: RigEvents,
}

impl<'a> RigState<'a> {
    /// At rest before the start by the homing distance, in a seal that was never moved.
    pub(super) fn new(config: &'a BenchConfig, seal: &'a [Element], seed: u64) -> Self {
        let rig = &config.rig;
        let step_duration = 1.0 / (rig.sample_rate_hz * f64::from(rig.substeps));
        let position = rig.start_m + rig.homing_m;
        let states: Vec<State> = seal.iter().map(|element| element.rest_state(0.0)).collect();
        let lag = -libm::expm1(-step_duration / config.motor.force_time_constant_s);
        let turning = config.rotation.and_then(|rotation| {
            let trocar = Trocar::of_seal(Stages::new(seal)?).with_rotation(Some(rotation)).ok()?;
            let state = trocar.rest(position);
            Some((trocar, state))
        });
        let mut this = Self {
            config,
            seal,
            turning,
            course: None,
            level: SealLevel::new(&config.fluctuation, position, seed),
            control: SpeedControl { gains: config.controller.clone(), integral: 0.0 },
            moving_mass: config.motor.slider_mass_kg + config.rod.mass_kg,
            step_duration,
            force_lag: lag,
            position,
            velocity: 0.0,
            acceleration: 0.0,
            reference_velocity: 0.0,
            motor_force: 0.0,
            seal_force: states.iter().map(State::force).sum(),
            torque: 0.0,
            loads: [0.0; 3],
            direction: 0.0,
            tissue_force: 0.0,
            time: f64::NEG_INFINITY,
            states,
            events: RigEvents::default(),
        };
        // The drive holds the load when it is switched on, so there is no jerk at the start.
        let load = this.load();
        this.motor_force = load;
        this.control.integral = load;
        this
    }

    /// Turns the rod as `course` says.
    pub(super) fn turn_along(&mut self, course: Course) {
        self.course = Some(course).filter(|course| course.angle.is_some());
    }

    /// Angle of the rod, rad, and torque on the seal, N·m, of a motion with an angle.
    pub(super) fn roll(&self) -> Option<(f64, f64)> {
        Some((self.course.as_ref()?.angle_at(self.time), self.torque))
    }

    pub(super) fn position(&self) -> f64 {
        self.position
    }

    pub(super) fn velocity(&self) -> f64 {
        self.velocity
    }

    pub(super) fn acceleration(&self) -> f64 {
        self.acceleration
    }

    pub(super) fn reference_velocity(&self) -> f64 {
        self.reference_velocity
    }

    pub(super) fn motor_force(&self) -> f64 {
        self.motor_force
    }

    pub(super) fn seal_force(&self) -> f64 {
        self.seal_force
    }

    /// Side force, N, tilt, rad, and pressure, Pa.
    pub(super) fn loads(&self) -> [f64; 3] {
        self.loads
    }

    /// Gravity in the direction of insertion, m/s².
    pub(super) fn gravity(&self) -> f64 {
        self.config.rod.gravity_m_s2 * libm::cos(self.loads[1])
    }

    /// Friction of the cannula, N.
    pub(super) fn side_friction(&self) -> f64 {
        self.config.loads.side_friction * self.loads[0] * self.direction
    }

    /// Force of the tip on the tissue, N.
    pub(super) fn tissue_force(&self) -> f64 {
        self.tissue_force
    }

    /// Friction of the seal relative to the dry one.
    pub(super) fn wetting(&self) -> f64 {
        Wetting::at(&self.config.lubrication, self.time).level
    }

    pub(super) fn deflections(&self) -> impl Iterator<Item = f64> + '_ {
        self.states.iter().map(State::deflection)
    }

    pub(super) fn events(&self) -> RigEvents {
        self.events
    }

    /// Withdraws to the start and rests, without recording.
    pub(super) fn home(&mut self) {
        let mut reference = Reference::homing(self.config);
        let steps = (reference.duration() / self.step_duration).ceil() as usize;
        for i in 0..steps {
            self.speed_step(reference.velocity(i as f64 * self.step_duration));
        }
        self.events = RigEvents::default();
    }

    /// Follows `reference` under speed control from the first to the last sample.
    pub(super) fn follow(
        &mut self,
        mut reference: Reference,
        log: &mut Log,
    ) -> Result<(), BenchError> {
        self.time = 0.0;
        let rig = &self.config.rig;
        // The small margin keeps a duration of a whole number of samples from being rounded up by
        // one.
        let samples = (reference.duration() * rig.sample_rate_hz - 1e-6).ceil() as usize;
        self.reference_velocity = reference.velocity(0.0);
        log.sample(self);
        for sample in 0..samples {
            for substep in 0..rig.substeps as usize {
                let step = sample * rig.substeps as usize + substep;
                self.speed_step(reference.velocity(step as f64 * self.step_duration));
            }
            log.sample(self);
        }
        Ok(())
    }

    /// Pushes back and forth with constant force.
    pub(super) fn push(&mut self, push: Push, log: &mut Log) -> Result<(), BenchError> {
        let rig = &self.config.rig;
        self.time = 0.0;
        self.reference_velocity = 0.0;
        self.events.push = (push.insertion, push.withdrawal);
        let longest_stroke = (push.cycles.stroke_timeout_s * rig.sample_rate_hz).ceil() as usize;
        let (near, far) = (rig.start_m, rig.start_m + push.cycles.stroke_m);
        log.sample(self);
        for stroke in 0..2 * push.cycles.cycles {
            let (force, inward) = match stroke % 2 {
                0 => (push.insertion, true),
                _ => (push.withdrawal, false),
            };
            let arrived = |x: f64| if inward { x >= far } else { x <= near };
            let mut samples = 0;
            while !arrived(self.position) {
                if samples == longest_stroke {
                    return Err(BenchError::Stalled {
                        stroke: stroke + 1,
                        position: self.position,
                        push: force,
                    });
                }
                for _ in 0..rig.substeps {
                    self.step(force);
                }
                log.sample(self);
                samples += 1;
            }
        }
        Ok(())
    }

    fn speed_step(&mut self, reference_velocity: f64) {
        self.reference_velocity = reference_velocity;
        let limit = force_limits(&self.config.motor, self.velocity);
        let error = reference_velocity - self.velocity;
        let command = self.control.command(error, self.step_duration, limit);
        self.step(command);
    }

    /// One step of semi-implicit Euler: velocity from the forces at the start, position from the
    /// new velocity.
    fn step(&mut self, command: f64) {
        let dt = self.step_duration;
        let (lowest, highest) = force_limits(&self.config.motor, self.velocity);
        let possible = command.clamp(lowest, highest);
        self.events.motor_limited_steps += usize::from(possible != command);
        self.motor_force += self.force_lag * (possible - self.motor_force);
        let velocity = self.velocity + dt * (self.motor_force - self.load()) / self.moving_mass;
        let free = self.position + dt * velocity;
        // Safety stops stop the carriage without rebound.
        let reached = free.clamp(0.0, self.config.rig.stroke_limit_m);
        let stopped = reached != free;
        self.events.stop_hits += usize::from(stopped && self.velocity != 0.0);
        let velocity = if stopped { 0.0 } else { velocity };
        let displacement = reached - self.position;
        self.acceleration = (velocity - self.velocity) / dt;
        self.velocity = velocity;
        self.position = reached;
        self.time += dt;
        let wetting = Wetting::at(&self.config.lubrication, self.time);
        let force = self.step_seal(displacement, wetting, dt);
        let viscous = self
            .seal
            .iter()
            .zip(&self.states)
            .map(|(element, state)| element.viscous_force(state))
            .sum();
        let fluctuation =
            self.level.advance(displacement, reached) * drift(&self.config.fluctuation, self.time);
        self.loads = loads_at(&self.config.loads, self.time);
        let gain = 1.0 + self.config.loads.pressure_gain_per_pa * self.loads[2];
        self.seal_force = wetting.of_wet(force, viscous) * fluctuation * gain;
        self.direction = (self.direction + displacement / REACH).clamp(-1.0, 1.0);
        // Its viscous part is small, and wetted like the rest.
        let torque = self.turning.as_ref().map_or(0.0, |(_, state)| state.torque());
        self.torque = wetting.of_wet(torque, 0.0) * fluctuation;
        self.tissue_force = tissue_force(&self.config.tissue, self.time, reached, velocity);
    }

    /// Force of the dry seal, N, after `displacement`, m.
    fn step_seal(&mut self, displacement: f64, wetting: Wetting, dt: f64) -> f64 {
        let displacement = wetting.of_dry(displacement);
        let Some((trocar, state)) = &mut self.turning else {
            return step_parallel(self.seal, &mut self.states, displacement, dt);
        };
        let position = state.position() + displacement;
        let force = match &self.course {
            Some(course) => {
                let turned = course.angle_at(self.time) - course.angle_at(self.time - dt);
                let from = state.turning().map_or(0.0, Turning::angle);
                trocar.turn_to(state, position, from + wetting.of_dry(turned), dt)
            }
            None => trocar.step(state, displacement, dt),
        };
        if let SealState::Ems(own) = state.seal() {
            self.states.copy_from_slice(own.states());
        }
        force
    }

    /// All forces against the motor except inertia, N.
    fn load(&self) -> f64 {
        let motor = &self.config.motor;
        let rod = &self.config.rod;
        let guide = motor.drag_n_s_m * self.velocity
            // Smooth through zero velocity, so that the guide creeps and does not stick.
            + motor.guide_friction_n * libm::tanh(self.velocity / motor.guide_creep_m_s);
        let phase = core::f64::consts::TAU * self.position / motor.cogging_pitch_m;
        let cogging = motor.cogging_n * libm::sin(phase);
        let weight = (1.0 - motor.balanced_fraction) * self.moving_mass * self.gravity();
        let sliding = guide + cogging - weight + rod.gas_force();
        sliding + self.seal_force + self.tissue_force + self.side_friction()
    }
}

/// Lowest and highest force of the motor at `velocity`: back-EMF reduces the force in the direction
/// of motion.
fn force_limits(motor: &Motor, velocity: f64) -> (f64, f64) {
    let ratio = velocity / motor.no_load_speed_m_s;
    let peak = motor.peak_force_n;
    (-peak * (1.0 + ratio).clamp(0.0, 1.0), peak * (1.0 - ratio).clamp(0.0, 1.0))
}
