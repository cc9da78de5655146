//! The loop in time.

use trocar_model::Trocar;

use super::channel::{Channel, Packet};
use super::config::{Config, ConfigError};
use super::control::{Controllers, Encoder, Reading};
use super::credit::Credit;
use super::estimate::{Estimator, unscaled};
use super::passivity::Port;
use super::plant::{Follower, Leader, Motion};
use trocar_recording::cancel;
use trocar_simulate::bench::noise::Source;

/// Beyond these a loop counts as unstable, m and m/s: far outside any device.
const FARTHEST_M: f64 = 10.0;
const FASTEST_M_S: f64 = 100.0;
/// Samples between two checks whether the work was cancelled: a millisecond of work.
const SAMPLES_BETWEEN_CHECKS: u64 = 1024;

/// The loop at one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub time: f64,
    /// Intended position of the hand, m.
    pub hand_position: f64,
    /// x_m and v_m, m and m/s.
    pub leader_position: f64,
    /// m/s
    pub leader_velocity: f64,
    /// x_s and v_s, m and m/s.
    pub follower_position: f64,
    /// m/s
    pub follower_velocity: f64,
    /// F_h, force of the operator on the leader, N.
    pub operator_force: f64,
    /// F_mc, force of the leader's motor against the operator, N: what is felt.
    pub leader_force: f64,
    /// F_sc, N.
    pub follower_force: f64,
    /// F_t, N.
    pub trocar_force: f64,
    /// F_e, N.
    pub tissue_force: f64,
    /// The tissue's force as sensor and compensation give it, N.
    pub estimate: f64,
    /// Energy that the network has received from and given to the leader, J.
    pub leader_energies: [f64; 2],
    /// Energy that it has received from and given to the follower, J; with a credit, from follower and trocar.
    pub follower_energies: [f64; 2],
    /// Energy that the trocar has dissipated at least, which the passivity control counts as dissipated by the network, J; 0
    /// without a credit.
    pub credit: f64,
    /// Forces that the passivity control adds to those of the motors at leader and follower, N, against the motion.
    pub passivity_forces: [f64; 2],
    /// Work of the operator on the leader, J.
    pub operator_work: f64,
    /// Work of the instrument on the trocar, J.
    pub trocar_work: f64,
    /// Work of the instrument on the tissue, J.
    pub tissue_work: f64,
}

impl Sample {
    /// Energy that the network has received from leader and follower less what it has given them, J, without a credit.
    pub fn network_energies(&self) -> [f64; 2] {
        let [leader, follower] = [self.leader_energies, self.follower_energies]
            .map(|[received, given]| received - given);
        [leader, follower - self.credit]
    }
}

/// A loop that runs.
///
/// # Invariants
/// The same configuration, models and hand give the same samples, to the last bit.
#[derive(Debug, Clone)]
pub struct Loop<K> {
    config: Config,
    leader: Leader,
    follower: Follower<K>,
    encoders: [Encoder; 2],
    controllers: Controllers,
    to_follower: Channel,
    to_leader: Channel,
    estimator: Estimator<K>,
    ports: [Port; 2],
    /// Of the passivity control, if it has one.
    credit: Option<Credit<K>>,
    /// F_mc and F_sc as held since the last sample, N.
    held: [f64; 2],
    /// The last packet of the follower that the leader has received.
    arrived: Packet,
    /// Number of the next sample.
    count: u64,
    position: f64,
    diverged: Option<Diverged>,
}

impl<K: AsRef<[f64]> + Clone> Loop<K> {
    /// A loop at rest at `position` (m) with the follower in `trocar`; `compensator` is the compensator's model, which need not be
    /// the same.
    ///
    /// # Errors
    /// A value of `config` out of its range, or a model that cannot be made with it.
    pub fn new(
        config: &Config,
        trocar: Trocar<K>,
        compensator: Trocar<K>,
        position: f64,
    ) -> Result<Self, ConfigError> {
        config.check()?;
        let turning = config.motion.turning_rad_s;
        if turning != 0.0 && trocar.rotation().is_none() {
            return Err(ConfigError::Unfit(format!(
                "motion.turning_rad_s = {turning} turns the instrument, and the trocar's model has no rotation\n\nhint: \
                 identify it from recordings that turn, with the diameter of the shaft (‹shaft_diameter_mm›)"
            )));
        }
        let encoders = [config.leader, config.follower]
            .map(|device| Encoder::new(device.encoder_step_m, config.sample_time_s));
        Ok(Self {
            leader: Leader::new(config, position),
            follower: Follower::new(config, trocar, position),
            encoders,
            controllers: Controllers::new(config, position),
            to_follower: Channel::new(config, Source::ToFollower, position)?,
            to_leader: Channel::new(config, Source::ToLeader, position)?,
            estimator: Estimator::new(config, &compensator, position)?,
            credit: credit(config, &compensator, position)?,
            ports: [config.leader, config.follower]
                .map(|device| Port::new(device.mass_kg, config.sample_time_s)),
            held: [0.0; 2],
            arrived: Packet::at_rest(position),
            count: 0,
            position,
            diverged: None,
            config: config.clone(),
        })
    }

    /// Time of the next sample, s.
    pub(super) fn time(&self) -> f64 {
        self.count as f64 * self.config.sample_time_s
    }

    /// Displaces the follower by `way`, m, and adds `velocity`, m/s, to its own, at once.
    pub(super) fn strike(&mut self, way: f64, velocity: f64) {
        self.follower.motion.position += way;
        self.follower.motion.velocity += velocity;
    }

    /// One sample: reads the sensors, exchanges packets, sets the motors and moves the plant to the next sample. `hand` gives the
    /// operator's intended position (m) and velocity (m/s) at a time (s).
    ///
    /// # Errors
    /// [`Diverged`] where a device has left 10 m or 100 m/s; the loop then stays so.
    pub fn step(&mut self, hand: impl Fn(f64) -> (f64, f64)) -> Result<Sample, Diverged> {
        if let Some(diverged) = self.diverged {
            return Err(diverged);
        }
        if self.count.is_multiple_of(SAMPLES_BETWEEN_CHECKS) {
            cancel::check();
        }
        let hand = |time: f64| {
            let (position, velocity) = hand(time);
            Motion { position, velocity }
        };
        let duration = self.config.sample_time_s;
        let time = self.time();
        let [own_leader, own_follower] = self.read();
        let estimate = self.estimator.estimate(&self.follower, &own_follower);
        let operator_force = self.leader.operator_force(hand(time), self.held[0]);
        let mut sent =
            self.controllers.sent_by_leader(&own_leader, operator_force, self.arrived.force);
        sent.energy = self.ports[0].observe(own_leader.position, 0.0);
        let at_follower = self.to_follower.send(sent);
        let (follower_force, mut back) =
            self.controllers.follower(at_follower, &own_follower, estimate);
        let credit = self
            .credit
            .as_mut()
            .map_or(0.0, |credit| credit.advance(own_follower.position, duration));
        back.energy = self.ports[1].observe(own_follower.position, credit);
        self.arrived = self.to_leader.send(back);
        let leader_force = self.controllers.leader(self.arrived, &own_leader, operator_force);
        let forces = [
            self.guard(0, &own_leader, leader_force, self.arrived.energy),
            -self.guard(1, &own_follower, -follower_force, at_follower.energy),
        ];
        self.held = forces;
        let sample = self.sample(time, hand(time), forces, operator_force, estimate);
        self.count += 1;
        self.move_on(time, forces, hand);
        let is_bounded = [self.leader.motion, self.follower.motion].iter().all(|motion| {
            (motion.position - self.position).abs() < FARTHEST_M
                && motion.velocity.abs() < FASTEST_M_S
        });
        if is_bounded {
            return Ok(sample);
        }
        let diverged = Diverged { time_s: time };
        self.diverged = Some(diverged);
        Err(diverged)
    }

    /// The next `count` samples.
    ///
    /// # Errors
    /// As for [`Loop::step`].
    pub fn run(
        &mut self,
        count: usize,
        hand: impl Fn(f64) -> (f64, f64),
    ) -> Result<Vec<Sample>, Diverged> {
        (0..count).map(|_| self.step(&hand)).collect()
    }

    fn read(&mut self) -> [Reading; 2] {
        let motions = [self.leader.motion, self.follower.motion];
        let [leader, follower] = &mut self.encoders;
        [
            leader.read(motions[0].position, motions[0].velocity),
            follower.read(motions[1].position, motions[1].velocity),
        ]
    }

    /// Force of a port against its motion, with the damper of the passivity control.
    fn guard(&mut self, port: usize, own: &Reading, force: f64, budget: f64) -> f64 {
        // Without the control the observer's budget has no end.
        let control = self.config.control;
        let reserve = 0.5 * control.passivity_reserve_j;
        let budget = if control.passivity { budget + reserve } else { f64::INFINITY };
        self.ports[port].guard(own.position, own.velocity, force, budget)
    }

    fn sample(
        &self,
        time: f64,
        hand: Motion,
        [leader_force, follower_force]: [f64; 2],
        operator_force: f64,
        estimate: f64,
    ) -> Sample {
        let (leader, follower) = (self.leader.motion, self.follower.motion);
        Sample {
            time,
            hand_position: hand.position,
            leader_position: leader.position,
            leader_velocity: leader.velocity,
            follower_position: follower.position,
            follower_velocity: follower.velocity,
            operator_force,
            leader_force,
            follower_force,
            trocar_force: self.follower.trocar_force,
            tissue_force: self.follower.tissue_force,
            estimate,
            leader_energies: self.ports[0].energies(),
            follower_energies: self.ports[1].energies(),
            credit: self.credit.as_ref().map_or(0.0, Credit::dissipated),
            passivity_forces: [self.ports[0].added(), self.ports[1].added()],
            operator_work: self.leader.work,
            trocar_work: self.follower.trocar_work,
            tissue_work: self.follower.tissue_work,
        }
    }

    fn move_on(&mut self, time: f64, [leader, follower]: [f64; 2], hand: impl Fn(f64) -> Motion) {
        let step = self.config.sample_time_s / f64::from(self.config.substeps);
        for k in 0..self.config.substeps {
            let (from, to) = (time + f64::from(k) * step, time + f64::from(k + 1) * step);
            self.leader.step(leader, [hand(from), hand(to)]);
            self.follower.step(follower, to);
        }
    }
}

/// The credit of the passivity control, of the model in the compensator.
fn credit<K: AsRef<[f64]> + Clone>(
    config: &Config,
    compensator: &Trocar<K>,
    position: f64,
) -> Result<Option<Credit<K>>, ConfigError> {
    if !config.has_credit() {
        return Ok(None);
    }
    let control = config.control;
    let scale = control.credit_friction_scale;
    let model = config.compensation.model(compensator)?;
    let credit = Credit::new(&model, scale, position);
    credit.map(Some).map_err(|why| unscaled("control.credit_friction_scale", scale, why))
}

/// The loop is unstable: a device left 10 m or 100 m/s.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("the loop is unstable: it diverged after {time_s} s")]
pub struct Diverged {
    /// When, s.
    pub time_s: f64,
}
