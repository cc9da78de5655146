//! Derivatives of the force of a bank by the numbers of its elements, followed beside one simulation:
//! given the motion, no element depends on another.

use nalgebra::DMatrix;
use trocar_model::{Classical, ClassicalState, Friction};

use crate::training::Step;

use super::coordinate::Bank;

/// The elements of a bank: numbers and derivatives.
#[derive(Debug, Default)]
pub(super) struct Elements {
    own: Vec<Own>,
    /// Numbers of each element.
    stride: usize,
    /// ∂F/∂β and those by the free numbers of the elements, at the end of the last step.
    derivatives: Vec<f64>,
}

/// One element: F_i = k·z + σ·dz/dt.
#[derive(Debug)]
struct Own {
    stiffness: f64,
    /// Δ, m.
    limit: f64,
    /// σ, N s/m.
    damping: f64,
    /// ∂z/∂Δ.
    by_limit: f64,
}

impl Elements {
    /// At the start of a run, from which on the force held by each is what it is.
    pub(super) fn new(bank: Option<Bank>, numbers: &[f64]) -> Self {
        let Some(Bank { first, stride }) = bank else { return Self::default() };
        let of = |n: &[f64]| Own {
            stiffness: n[0],
            limit: n[1],
            damping: n.get(2).copied().unwrap_or(0.0),
            by_limit: 0.0,
        };
        let own = numbers[first..].chunks_exact(stride).map(of).collect();
        Self { own, stride, derivatives: vec![0.0; 1 + numbers.len() - first] }
    }

    /// The derivatives by β, and by ln k, ln Δ and σ of each element, at the centres of the steps.
    pub(super) fn follow(
        &mut self,
        model: &Classical,
        state: &mut ClassicalState,
        steps: &[Step],
    ) -> DMatrix<f64> {
        let mut rows = DMatrix::zeros(self.derivatives.len(), steps.len());
        for (step, mut row) in steps.iter().zip(rows.column_iter_mut()) {
            let before = *state;
            model.step(state, step.displacement, step.duration);
            row.copy_from_slice(&self.derivatives);
            self.after(model, [&before, state], step);
            for (value, after) in row.iter_mut().zip(&self.derivatives) {
                *value = step.at_centre(*value, *after);
            }
        }
        rows
    }

    fn after(&mut self, model: &Classical, states: [&ClassicalState; 2], step: &Step) {
        self.derivatives[0] = step.displacement / step.duration;
        let all = self.derivatives[1..].chunks_exact_mut(self.stride);
        let slip = Slip::new(model, step);
        for (i, (own, derivatives)) in self.own.iter_mut().zip(all).enumerate() {
            let [before, after] = states.map(|state| own.place(state, i));
            let (rate, rate_by_limit) = slip.follow(own, before, after);
            let by_limit = own.stiffness * own.by_limit + own.damping * rate_by_limit;
            let all = [own.stiffness * after.0, own.limit * by_limit, rate];
            derivatives.copy_from_slice(&all[..self.stride]);
        }
    }
}

/// Deflection of an element, m, and whether it slips.
type Place = (f64, bool);

impl Own {
    /// Of element `i` in a state.
    fn place(&self, state: &ClassicalState, i: usize) -> Place {
        match state {
            ClassicalState::Gms(state) => (state.deflections()[i], state.slipping()[i]),
            ClassicalState::MaxwellSlip(state) => {
                let force = state.element_forces()[i];
                (force / self.stiffness, force.abs() >= self.stiffness * self.limit)
            }
            _ => (0.0, false),
        }
    }
}

/// How the elements slip in a step: towards γ·Δ, exponentially.
struct Slip {
    velocity: f64,
    /// γ = g(|v|)/F_c.
    level: f64,
    /// 1/s, and what is left after the step.
    rate: f64,
    left: f64,
}

impl Slip {
    fn new(model: &Classical, step: &Step) -> Self {
        let velocity = step.displacement / step.duration;
        let Classical::Gms(gms) = model else {
            return Self { velocity, level: 1.0, rate: 0.0, left: 0.0 };
        };
        let level = gms.sliding().level(velocity.abs());
        let rate = gms.rates()[0] / level;
        let level = level / gms.sliding().coulomb_force;
        Self { velocity, level, rate, left: (-rate * step.duration).exp() }
    }

    /// Follows ∂z/∂Δ of an element; dz/dt at the end of the step, and its derivative by Δ.
    fn follow(&self, own: &mut Own, before: Place, (deflection, slips): Place) -> (f64, f64) {
        if !slips {
            return (self.velocity, 0.0);
        }
        let sign = deflection.signum();
        let (limit, gone) = (self.level * own.limit, sign * before.0);
        let has_slipped = gone >= limit || before.1 && gone > 0.0;
        let left = if has_slipped { self.left } else { 0.0 };
        own.by_limit = sign * self.level * (1.0 - left) + left * own.by_limit;
        let rate = self.rate * (sign * limit - deflection);
        (rate, self.rate * (sign * self.level - own.by_limit))
    }
}
