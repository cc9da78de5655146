//! The way of samples from one side to the other: delay, jitter and loss.

use super::config::{Config, ConfigError, OnLoss};
use trocar_simulate::bench::noise::{Noise, Source};

/// One sample on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Packet {
    /// Position, m.
    pub(crate) position: f64,
    /// Velocity, m/s.
    pub(crate) velocity: f64,
    /// Acceleration, m/s².
    pub(crate) acceleration: f64,
    /// Force, N, or a wave variable, √W.
    pub(crate) force: f64,
    /// Energy that the sender's port has received so far, J.
    pub(crate) energy: f64,
}

impl Packet {
    /// At rest at `position`, m.
    pub(crate) fn at_rest(position: f64) -> Self {
        Self { position, velocity: 0.0, acceleration: 0.0, force: 0.0, energy: 0.0 }
    }
}

/// One direction of the channel.
#[derive(Debug, Clone)]
pub(crate) struct Channel {
    delay: usize,
    jitter: usize,
    loss: f64,
    on_loss: OnLoss,
    noise: Noise,
    /// Number of the next sample.
    now: usize,
    /// What arrives at a sample, by its number modulo the length, with the number under which it was sent.
    way: Vec<Option<(usize, Packet)>>,
    /// What arrived last, and its number.
    last: Option<(usize, Packet)>,
    /// In place of it before the first arrival.
    rest: Packet,
}

impl Channel {
    /// A direction with its `source` of chance; until the first sample arrives, the sender rests at
    /// `position`.
    pub(crate) fn new(config: &Config, source: Source, position: f64) -> Result<Self, ConfigError> {
        let (delay, jitter) = (config.delay_samples()?, config.jitter_samples()?);
        Ok(Self {
            delay,
            jitter,
            loss: config.channel.loss,
            on_loss: config.channel.on_loss,
            noise: Noise::new(config.seed, source),
            now: 0,
            way: vec![None; delay + jitter + 1],
            last: None,
            rest: Packet::at_rest(position),
        })
    }

    /// Sends `packet` and returns what the receiver has at this sample.
    pub(crate) fn send(&mut self, packet: Packet) -> Packet {
        let places = self.way.len();
        let is_lost = self.loss > 0.0 && self.noise.unit() < self.loss;
        let late = if self.jitter > 0 {
            (self.noise.unit() * (self.jitter + 1) as f64) as usize
        } else {
            0
        };
        if !is_lost {
            // A later sample at the same place has overtaken the earlier one.
            self.way[(self.now + self.delay + late) % places] = Some((self.now, packet));
        }
        let arrived = self.way[self.now % places].take();
        let newer = arrived.filter(|(number, _)| self.last.is_none_or(|(last, _)| *number > last));
        self.last = newer.or(self.last);
        self.now += 1;
        let last = self.last.map_or(self.rest, |(_, packet)| packet);
        match self.on_loss {
            OnLoss::Zero if newer.is_none() => {
                Packet { energy: last.energy, ..Packet::at_rest(last.position) }
            }
            _ => last,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(change: impl FnOnce(&mut Config)) -> Vec<f64> {
        let mut config = Config::default();
        change(&mut config);
        let mut channel = Channel::new(&config, Source::ToFollower, 0.0).unwrap();
        let sent = (1..=2000).map(|k| Packet::at_rest(f64::from(k)));
        sent.map(|packet| channel.send(packet).position).collect()
    }

    #[test]
    fn a_delay_of_three_samples_is_three_samples() {
        let found = received(|config| config.channel.delay_s = 3e-3);
        assert_eq!(found[..6], [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
        assert_eq!(received(|_| ())[..3], [1.0, 2.0, 3.0]);
    }

    #[test]
    fn what_is_overtaken_is_dropped_and_what_is_lost_is_held() {
        let late = received(|config| config.channel.jitter_s = 5e-3);
        assert!(late.windows(2).all(|pair| pair[0] <= pair[1]), "never backwards");
        assert!(late.iter().enumerate().all(|(k, x)| *x <= (k + 1) as f64 && *x >= k as f64 - 5.0));
        let lossy = received(|config| config.channel.loss = 0.3);
        let held = lossy.windows(2).filter(|pair| pair[0] == pair[1]).count();
        assert!((450..750).contains(&held), "{held} of 2000 lost at a probability of 0.3");
        assert_eq!(lossy, received(|config| config.channel.loss = 0.3), "same seed, same losses");
    }
}
