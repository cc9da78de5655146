//! Time-domain passivity control of a network with delay, RYU.

/// Observer of the energy through one port of the network, and the damper that keeps the port from giving
/// more than the other one is known to have received.
///
/// ```text
/// ΔE = f(n−1)·(x(n) − x(n−1))                 J, into the network; f is held between samples: exact
/// received += ΔE where it is above 0, given −= ΔE where it is below
/// given(n) <= received by the other port, as it arrives over the channel
/// f_d = α·v,  α = excess/(T_s·v²)
/// ```
/// While there is an excess the motor only brakes, by at most m·v/(2·T_s): more could turn the motion round
/// within the sample, and so give energy.
#[derive(Debug, Clone)]
pub(crate) struct Port {
    /// Mass of the device at the port, kg, and sample time, s.
    mass: f64,
    duration: f64,
    received: f64,
    given: f64,
    /// Position, m, and force, N, of the last sample, with the damper's share.
    last: Option<(f64, f64)>,
}

impl Port {
    pub(crate) fn new(mass: f64, duration: f64) -> Self {
        Self { mass, duration, received: 0.0, given: 0.0, last: None }
    }

    /// Notes the motion since the last sample to `position`, m; returns the energy received so far, J.
    pub(crate) fn observe(&mut self, position: f64) -> f64 {
        if let Some((before, force)) = self.last {
            let energy = force * (position - before);
            self.received += energy.max(0.0);
            self.given -= energy.min(0.0);
        }
        self.received
    }

    /// The force of the port against the motion for this sample, N, where the network asks for `force`, at `position` (m) and
    /// `velocity` (m/s); `budget` is what the other port has received, J.
    pub(crate) fn guard(&mut self, position: f64, velocity: f64, force: f64, budget: f64) -> f64 {
        let ahead = self.given - (force * velocity * self.duration).min(0.0) - budget;
        let mut sent = force;
        if ahead > 0.0 {
            // At rest the quotient is infinite or not a number; the other limit holds then.
            let damping = ahead / (self.duration * velocity * velocity);
            let most = 0.5 * self.mass / self.duration;
            let along = (force + damping.min(most) * velocity) * velocity.signum();
            sent = along.clamp(0.0, most * velocity.abs()) * velocity.signum();
        }
        self.last = Some((position, sent));
        sent
    }

    /// Energy received and given so far, J.
    pub(crate) fn energies(&self) -> [f64; 2] {
        [self.received, self.given]
    }
}
