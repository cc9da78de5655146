//! Time-domain passivity control of a network with delay, RYU.

/// Observer of the energy through one port of the network, and the damper that keeps the port from giving
/// more than the other one is known to have received.
///
/// ```text
/// ΔE = f(n−1)·(x(n) − x(n−1)) + credit        J, into the network; f is held between samples: exact
/// received += ΔE where it is above 0, given −= ΔE where it is below
/// given(n) <= received by the other port, as it arrives over the channel
/// f_d = α·v,  α = excess/(T_s·v²)
/// ```
/// The credit is energy that the device has dissipated at least since the last sample ([`super::credit`]): the port is then
/// that of network and dissipation together. While there is an excess the motor only brakes, by at most m·v/(2·T_s): more
/// could reverse the motion within the sample, and so give energy.
#[derive(Debug, Clone)]
pub(crate) struct Port {
    /// Mass of the device at the port, kg, and sample time, s.
    mass: f64,
    duration: f64,
    received: f64,
    given: f64,
    last: Option<Held>,
}

/// The port at the last sample.
#[derive(Debug, Clone, Copy)]
struct Held {
    /// m
    position: f64,
    /// With the damper's share, N.
    force: f64,
    /// The damper's share, N.
    damper: f64,
}

impl Port {
    pub(crate) fn new(mass: f64, duration: f64) -> Self {
        Self { mass, duration, received: 0.0, given: 0.0, last: None }
    }

    /// Adds the energy of the motion since the last sample to `position`, m, and `credit`, which the device has dissipated at
    /// least in the meantime, J; returns the energy received so far, J.
    pub(crate) fn observe(&mut self, position: f64, credit: f64) -> f64 {
        if let Some(held) = self.last {
            let energy = held.force * (position - held.position) + credit;
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
        self.last = Some(Held { position, force: sent, damper: sent - force });
        sent
    }

    /// The damper's share of the force of this sample, N.
    pub(crate) fn added(&self) -> f64 {
        self.last.map_or(0.0, |held| held.damper)
    }

    /// Energy received and given so far, J.
    pub(crate) fn energies(&self) -> [f64; 2] {
        [self.received, self.given]
    }
}
