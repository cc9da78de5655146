//! Energy that the trocar has dissipated at least, which the passivity control may count as dissipated by the network, FRANKEN.
//!
//! ```text
//! W_i(t) = ∫ F_i dx              work on trocar i along the follower's encoder, J, without the profile's offset F_0(x)
//! D_i(t) = max over τ ≤ t of W_i(τ) − S_i         S_i: most energy that trocar i can store and give back, J
//! D(t)   = min over i of D_i(t)
//! ```
//! No trocar of the set has dissipated less than D: what it has taken up and not dissipated is at most S_i, and
//! dissipated energy does not return. The set is the model at the least friction scale that is assumed
//! ([`super::config::Control::credit_friction_scale`]) and at its own, which bounds the scales in between for seals
//! that stick and slide: the work of a stroke is then concave in the scale. It is no bound for a trocar with
//! less friction than that, or of another law than the model's.
//!
//! S_i is the largest work that comes back when the seal, sliding, is reversed, at 1 and at 100 mm/s. Within a sample the
//! smaller of the forces at its ends counts.

use trocar_model::{ParamError, Seal, Trocar, TrocarState};

use super::model::scaled;

/// Speeds at which the stored energy is sought, m/s.
const SPEEDS: [f64; 2] = [1e-3, 0.1];
/// Steps to the slide: their number, and the length of each, m.
const SLIDES: u32 = 500;
const SLIDE: f64 = 2e-4;
/// Steps back: the first, the last, m, and their ratio. Seals deform over 10 nm to 10 mm.
const SHORTEST: f64 = 1e-9;
const LONGEST: f64 = 1e-3;
const GROWTH: f64 = 1.02;

/// A lower bound of the energy dissipated by a trocar.
#[derive(Debug, Clone)]
pub(crate) struct Credit<K> {
    accounts: [Account<K>; 2],
    dissipated: f64,
}

/// One trocar of the set.
#[derive(Debug, Clone)]
struct Account<K> {
    trocar: Trocar<K>,
    state: TrocarState,
    /// S_i, J.
    stored: f64,
    /// W_i, J.
    work: f64,
    /// D_i, J.
    dissipated: f64,
}

impl<K: AsRef<[f64]> + Clone> Credit<K> {
    /// Of `model` and of the same at the friction scale `least`, undeformed at `position`, m.
    ///
    /// # Errors
    /// Parameters that make no model at that scale.
    pub(crate) fn new(model: &Trocar<K>, least: f64, position: f64) -> Result<Self, ParamError> {
        let accounts = [scaled(model, least)?, model.clone()].map(|trocar| Account {
            state: trocar.rest(position),
            stored: most_stored(trocar.seal()) * greatest_gain(&trocar),
            trocar,
            work: 0.0,
            dissipated: 0.0,
        });
        Ok(Self { accounts, dissipated: 0.0 })
    }

    /// The bound, J.
    pub(crate) fn dissipated(&self) -> f64 {
        self.dissipated
    }

    /// Moves on to `position` (m) within `duration` (s); returns by how much the bound has grown, J, ≥ 0.
    pub(crate) fn advance(&mut self, position: f64, duration: f64) -> f64 {
        self.accounts.iter_mut().for_each(|account| account.advance(position, duration));
        let least = self.accounts.iter().map(|a| a.dissipated).fold(f64::INFINITY, f64::min);
        let grown = least - self.dissipated;
        self.dissipated = least;
        grown
    }
}

impl<K: AsRef<[f64]>> Account<K> {
    /// The force without the offset of the profile, N.
    fn force(&self) -> f64 {
        let profile = self.trocar.profile();
        self.state.force() - profile.map_or(0.0, |p| p.offset(self.state.position()))
    }

    fn advance(&mut self, position: f64, duration: f64) {
        let (from, before) = (self.state.position(), self.force());
        self.trocar.step_to(&mut self.state, position, duration);
        let way = self.state.position() - from;
        self.work += (before * way).min(self.force() * way);
        self.dissipated = self.dissipated.max(self.work - self.stored);
    }
}

/// Largest gain of the profile; 1 without.
fn greatest_gain<K: AsRef<[f64]>>(trocar: &Trocar<K>) -> f64 {
    trocar.profile().map_or(1.0, |profile| profile.gains().iter().copied().fold(0.0, f64::max))
}

/// Most energy, J, that a seal returns when it slides and is reversed.
fn most_stored(seal: &Seal) -> f64 {
    let alone = Trocar::of_seal(*seal);
    let mut most = 0.0_f64;
    for (there, back) in SPEEDS.into_iter().flat_map(|there| SPEEDS.map(|back| (there, back))) {
        for direction in [-1.0, 1.0] {
            let mut state = alone.rest(0.0);
            for _ in 0..SLIDES {
                alone.step(&mut state, direction * SLIDE, SLIDE / there);
            }
            let (mut returned, mut step) = (0.0, SHORTEST);
            while step < LONGEST {
                let before = direction * state.force();
                let after = direction * alone.step(&mut state, -direction * step, step / back);
                returned += step * before.max(after);
                most = most.max(returned);
                step *= GROWTH;
            }
        }
    }
    most
}
