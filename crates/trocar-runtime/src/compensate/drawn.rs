//! Draws of the model's parameters, driven as the model is: how far its force may be off.
//!
//! ```text
//! δ_k = λ·s_k·[D_k + n_k·ν·V_k](x/(λ·s_k)) − F      draw k: D_k without its viscous part V_k, N
//! drawn² = Σ_k δ_k²/n                               mean square over the draws, N²
//! ```
//! Without adaptation s_k = n_k = 1. With adaptation λ and ν follow how strong and how viscous the
//! seal is, and var λ, var ν state how well; s_k and n_k then give each draw the Coulomb force and
//! the viscous damping of the model, so that δ_k is what λ and ν cannot follow.

use trocar_model::{Element, Seal, Stages, Trocar, TrocarState};

use super::move_by;
use super::saved::StateRow;

/// One draw.
#[derive(Debug, Clone)]
pub(super) struct Drawn {
    model: Trocar,
    state: TrocarState,
    /// s and n.
    scale: f64,
    viscosity: f64,
}

impl Drawn {
    /// `draws` of the element of `whole`, whose stages are `model`; each with the Coulomb force and viscous damping of the model where it
    /// `follows`.
    pub(super) fn all(
        draws: &[Stages],
        whole: &Trocar,
        model: &Stages,
        follows: bool,
    ) -> Vec<Self> {
        let ratio = |own: f64, wanted: f64| {
            if follows && own > 0.0 && wanted > 0.0 { wanted / own } else { 1.0 }
        };
        let drawn = draws.iter().map(|stages| {
            let own = whole.with_seal(Seal::Ems(*stages));
            let scale = ratio(coulomb_force(stages), coulomb_force(model));
            Self {
                model: own,
                state: own.rest_at_force(0.0, 0.0),
                scale,
                // Driven by x/s with the force multiplied by s, β stays what it is.
                viscosity: ratio(viscous_damping(stages), viscous_damping(model)),
            }
        });
        drawn.collect()
    }

    /// At rest with `force`, N.
    pub(super) fn rest(&mut self, force: f64) {
        self.state = self.model.rest_at_force(0.0, force / self.scale);
    }

    /// Moves by `displacement` (m) and `turn` (rad) of the model's own motion within `duration`, s.
    pub(super) fn step(&mut self, [displacement, turn]: [f64; 2], duration: f64) {
        let motion = [displacement / self.scale, turn / self.scale];
        move_by(&self.model, &mut self.state, motion, duration);
    }

    pub(super) fn exchange(&mut self, row: &mut StateRow) {
        row.state(&self.model, &mut self.state);
    }

    /// Its force with ν = `viscosity`, N; the seal slips with `speed`, m/s.
    fn force(&self, viscosity: f64, speed: f64) -> f64 {
        let viscous = self.model.seal().viscous_force(self.state.seal(), speed / self.scale);
        let dry = self.state.force() - viscous;
        self.scale * (dry + self.viscosity * viscosity * viscous)
    }
}

/// Mean square of the differences of the draws to `force` (N), N²; 0 without draws.
pub(super) fn mean_square(draws: &[Drawn], force: f64, viscosity: f64, speed: f64) -> f64 {
    draws.iter().map(|drawn| (drawn.force(viscosity, speed) - force).powi(2)).sum::<f64>()
        / draws.len().max(1) as f64
}

/// Mean over both directions of all stages, N.
fn coulomb_force(stages: &Stages) -> f64 {
    over(stages, |e| e.params().insertion.coulomb_force + e.params().withdrawal.coulomb_force)
}

/// The same of β, N s/m.
fn viscous_damping(stages: &Stages) -> f64 {
    over(stages, |e| e.params().insertion.viscous_damping + e.params().withdrawal.viscous_damping)
}

fn over(stages: &Stages, both: impl Fn(&Element) -> f64) -> f64 {
    stages.elements().iter().map(|element| 0.5 * both(element)).sum()
}
