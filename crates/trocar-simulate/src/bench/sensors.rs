//! Sensors of the rig: counts of the encoders, readings of force and torque.

use super::config::{Encoder, ForceSensor, Rounding};
use super::noise::{Noise, Source};

/// Position encoder and the speed signal of the drive.
#[derive(Debug)]
pub(super) struct PositionSensor {
    encoder: Encoder,
    position_noise: Noise,
    speed_noise: Noise,
}

impl PositionSensor {
    pub(super) fn new(encoder: &Encoder, seed: u64) -> Self {
        Self {
            encoder: encoder.clone(),
            position_noise: Noise::new(seed, Source::Encoder),
            speed_noise: Noise::new(seed, Source::DriveSpeed),
        }
    }

    /// A whole number of counts times the length of one count.
    pub(super) fn position(&mut self, position: f64) -> f64 {
        let noisy = position + self.encoder.noise_m * self.position_noise.normal();
        let counts = noisy / self.encoder.resolution_m;
        let whole = match self.encoder.rounding {
            Rounding::Nearest => counts.round(),
            Rounding::Down => counts.floor(),
        };
        whole * self.encoder.resolution_m
    }

    /// A whole number of counts of the roll axis.
    pub(super) fn angle(&self, angle: f64) -> f64 {
        (angle / self.encoder.angle_resolution_rad).round() * self.encoder.angle_resolution_rad
    }

    /// The drive interpolates between counts, so its speed has a finer resolution than their
    /// differences.
    pub(super) fn speed(&mut self, velocity: f64) -> f64 {
        velocity + self.encoder.speed_noise_m_s * self.speed_noise.normal()
    }
}

/// Force or torque sensor between motor and rod.
#[derive(Debug)]
pub(super) struct SensorReading {
    sensor: ForceSensor,
    noise: Noise,
    memory: f64,
    coloured: f64,
}

impl SensorReading {
    pub(super) fn new(sensor: &ForceSensor, sample_rate_hz: f64, mut noise: Noise) -> Self {
        let memory =
            libm::exp(-core::f64::consts::TAU * sensor.noise_bandwidth_hz / sample_rate_hz);
        // Starts in its stationary distribution, so the first samples are as noisy as the rest.
        let coloured = noise.normal();
        Self { sensor: sensor.clone(), noise, memory, coloured }
    }

    /// One logged reading of `force`, the load on the sensor, and whether it saturated.
    pub(super) fn read(&mut self, force: f64) -> (f64, bool) {
        let innovation = libm::sqrt(1.0 - self.memory * self.memory);
        self.coloured = self.memory * self.coloured + innovation * self.noise.normal();
        let analogue = force + self.sensor.tare_n + self.sensor.noise_n * self.coloured;
        let range = self.sensor.range_n;
        let limited = analogue.clamp(-range, range);
        let resolution = self.sensor.resolution_n;
        let reading = if resolution > 0.0 {
            ((limited / resolution).round() * resolution).clamp(-range, range)
        } else {
            limited
        };
        (reading, limited != analogue)
    }
}
