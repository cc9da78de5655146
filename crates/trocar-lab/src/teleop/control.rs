//! Controllers: motor forces from what each side reads and receives.

use super::channel::Packet;
use super::config::{Architecture, Config, Control, Device};

/// What one side reads at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reading {
    /// Position, m, as the encoder gives it.
    pub(crate) position: f64,
    /// Velocity, m/s, from the encoder.
    pub(crate) velocity: f64,
    /// Acceleration, m/s², from the velocity; only the four-channel architecture uses it.
    pub(crate) acceleration: f64,
}

impl Reading {
    fn sent_with(&self, force: f64) -> Packet {
        let Self { position, velocity, acceleration } = *self;
        Packet { position, velocity, acceleration, force, energy: 0.0 }
    }
}

/// Encoder with its differences.
#[derive(Debug, Clone)]
pub(crate) struct Encoder {
    step: f64,
    duration: f64,
    last: Option<Reading>,
}

impl Encoder {
    pub(crate) fn new(step: f64, duration: f64) -> Self {
        Self { step, duration, last: None }
    }

    /// An encoder without steps gives the true velocity; one with steps the difference of two samples.
    pub(crate) fn read(&mut self, position: f64, velocity: f64) -> Reading {
        let position =
            if self.step > 0.0 { (position / self.step).floor() * self.step } else { position };
        let (velocity, acceleration) = match self.last {
            None => (if self.step > 0.0 { 0.0 } else { velocity }, 0.0),
            Some(last) => {
                let difference = (position - last.position) / self.duration;
                let velocity = if self.step > 0.0 { difference } else { velocity };
                (velocity, (velocity - last.velocity) / self.duration)
            }
        };
        let reading = Reading { position, velocity, acceleration };
        self.last = Some(reading);
        reading
    }
}

/// Controllers of both sides, with what they remember.
#[derive(Debug, Clone)]
pub(crate) struct Controllers {
    control: Control,
    leader: Device,
    follower: Device,
    duration: f64,
    /// Position to which the waves have led the follower, m.
    wave_position: f64,
}

impl Controllers {
    pub(crate) fn new(config: &Config, position: f64) -> Self {
        let Config { control, leader, follower, sample_time_s: duration, .. } = *config;
        Self { control, leader, follower, duration, wave_position: position }
    }

    /// Spring and damper towards what the other side sent.
    fn follow(&self, from: Packet, own: &Reading) -> f64 {
        self.control.stiffness_n_m * (from.position - own.position)
            + self.control.damping_n_s_m * (from.velocity - own.velocity)
    }

    /// √(2b), √(N s/m)
    fn wave_scale(&self) -> f64 {
        (2.0 * self.control.wave_impedance_n_s_m).sqrt()
    }

    /// What the leader sends: its motion, with the operator's force or the wave
    ///
    /// ```text
    /// u = (b·v + F_mc)/√(2b) = √(2b)·v − w
    /// ```
    /// where `returned` is the wave w that it has from the follower.
    pub(crate) fn sent_by_leader(
        &self,
        own: &Reading,
        operator_force: f64,
        returned: f64,
    ) -> Packet {
        own.sent_with(match self.control.architecture {
            Architecture::Wave => self.wave_scale() * own.velocity - returned,
            _ => operator_force,
        })
    }

    /// F_sc, N, and what the follower sends; `estimate` is the force on the tissue, N, as its sensor gives it.
    pub(crate) fn follower(&mut self, from: Packet, own: &Reading, estimate: f64) -> (f64, Packet) {
        let force = match self.control.architecture {
            Architecture::PositionPosition | Architecture::PositionForce => self.follow(from, own),
            // HASHTRUDI: C_1 = Z_s + C_s, C_3 = 1 + C_5
            Architecture::FourChannel => {
                let local = self.control.follower_force_feedback;
                self.follow(from, own) + (1.0 + local) * from.force + momentum(&self.follower, from)
                    - local * estimate
            }
            Architecture::Wave => return self.wave_follower(from, own),
        };
        (force, own.sent_with(estimate))
    }

    /// ```text
    /// F_sc = K·(x_d − x_s) + B·(v_d − v_s),  v_d = (√(2b)·u − F_sc)/b,  w = u − √(2/b)·F_sc
    /// ```
    fn wave_follower(&mut self, from: Packet, own: &Reading) -> (f64, Packet) {
        let Control { stiffness_n_m, damping_n_s_m, wave_impedance_n_s_m: b, .. } = self.control;
        let arriving = self.wave_scale() * from.force;
        let spring = stiffness_n_m * (self.wave_position - own.position);
        let force =
            (spring + damping_n_s_m * (arriving / b - own.velocity)) / (1.0 + damping_n_s_m / b);
        self.wave_position += (arriving - force) / b * self.duration;
        (force, own.sent_with(from.force - 2.0 * force / self.wave_scale()))
    }

    /// F_mc, N, against the operator, whose force is `operator_force`, N.
    pub(crate) fn leader(&self, from: Packet, own: &Reading, operator_force: f64) -> f64 {
        match self.control.architecture {
            Architecture::PositionPosition => -self.follow(from, own),
            Architecture::PositionForce => self.control.force_gain * from.force,
            // HASHTRUDI: C_4 = −(Z_m + C_m), C_2 = 1 + C_6
            Architecture::FourChannel => {
                let local = self.control.leader_force_feedback;
                (1.0 + local) * from.force
                    - self.follow(from, own)
                    - momentum(&self.leader, from)
                    - local * operator_force
            }
            Architecture::Wave => {
                self.control.wave_impedance_n_s_m * own.velocity - self.wave_scale() * from.force
            }
        }
    }
}

/// Force that moves `device` as the other side moves, N.
fn momentum(device: &Device, other: Packet) -> f64 {
    device.mass_kg * other.acceleration + device.damping_n_s_m * other.velocity
}
