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
    /// What is left of the deflection at the start of the run, m: its force is a reading, whatever the
    /// stiffness; NaN before.
    start: f64,
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
            start: f64::NAN,
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
            let velocity = step.displacement / step.duration;
            self.after(model, [&before, state], (velocity, step.duration));
            for (value, after) in row.iter_mut().zip(&self.derivatives) {
                *value = step.at_centre(*value, *after);
            }
        }
        rows
    }

    /// After a step at a velocity, m/s, over a duration, s, between two states.
    fn after(&mut self, model: &Classical, states: [&ClassicalState; 2], step: (f64, f64)) {
        self.derivatives[0] = step.0;
        let all = self.derivatives[1..].chunks_exact_mut(self.stride);
        let slip = Slip::new(model, step);
        for (i, (own, derivatives)) in self.own.iter_mut().zip(all).enumerate() {
            let [before, after] = states.map(|state| own.place(state, i));
            own.start = if own.start.is_nan() { before.0 } else { own.start };
            let (rate, rate_by_limit) = slip.follow(own, before, after);
            let by_limit = own.stiffness * own.by_limit + own.damping * rate_by_limit;
            let all = [own.stiffness * (after.0 - own.start), own.limit * by_limit, rate];
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
    fn new(model: &Classical, (velocity, duration): (f64, f64)) -> Self {
        let Classical::Gms(gms) = model else {
            return Self { velocity, level: 1.0, rate: 0.0, left: 0.0 };
        };
        let level = gms.sliding().level(velocity.abs());
        let rate = gms.rates()[0] / level;
        let level = level / gms.sliding().coulomb_force;
        Self { velocity, level, rate, left: (-rate * duration).exp() }
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
        own.start *= left;
        own.by_limit = sign * self.level * (1.0 - left) + left * own.by_limit;
        let rate = self.rate * (sign * limit - deflection);
        (rate, self.rate * (sign * self.level - own.by_limit))
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::super::kind::Kind;
    use super::*;

    const DURATION: f64 = 1e-3;

    /// Forces at the ends of steps over `ways`, m, from `held`, N, with the modes of the elements.
    fn run(kind: Kind, numbers: &[f64], held: f64, ways: &[f64]) -> Vec<(f64, Vec<bool>)> {
        let model = kind.build(&numbers[1..]).unwrap();
        let mut state = model.rest_at_force(held);
        let own = Elements::new(kind.bank(), numbers).own;
        let of = |way: &f64| {
            let force = model.step(&mut state, *way, DURATION);
            (force, own.iter().enumerate().map(|(i, own)| own.place(&state, i).1).collect())
        };
        ways.iter().map(of).collect()
    }

    /// Numbers of a bank, the sensor offset first.
    fn drawn(kind: Kind, random: &mut ChaCha8Rng) -> Vec<f64> {
        let elements = (0..kind.elements()).flat_map(|_| {
            let own = [random.random_range(50.0..900.0), random.random_range(2e-4..4e-3)];
            let damping = matches!(kind, Kind::Gms(_)).then(|| random.random_range(0.0..3.0));
            own.into_iter().chain(damping).collect::<Vec<_>>()
        });
        let elements: Vec<f64> = elements.collect();
        let head = match kind {
            Kind::Gms(_) => vec![0.0, random.random_range(0.0..9.0), 0.4, 0.02, 30.0],
            _ => vec![0.0, random.random_range(0.0..9.0)],
        };
        [head, elements].concat()
    }

    #[test]
    fn derivatives_that_follow_a_bank_are_difference_quotients() {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut compared = 0;
        for kind in [1, 3, 6].into_iter().flat_map(|n| [Kind::Gms(n), Kind::MaxwellSlip(n)]) {
            let numbers = drawn(kind, &mut random);
            let rates = [3.1, 7.7, 0.4].map(|rate| (rate, random.random_range(0.0..6.0)));
            let speed = |k: usize| {
                let time = k as f64 * DURATION;
                rates.iter().map(|(rate, at)| 0.03 * (rate * time + at).sin()).sum::<f64>()
            };
            let ways: Vec<f64> = (0..6000).map(|k| DURATION * speed(k)).collect();
            let model = kind.build(&numbers[1..]).unwrap();
            let mut elements = Elements::new(kind.bank(), &numbers);
            let mut state = model.rest_at_force(0.0);
            let mut followed = Vec::new();
            for way in &ways {
                let before = state;
                model.step(&mut state, *way, DURATION);
                elements.after(&model, [&before, &state], (way / DURATION, DURATION));
                followed.push(elements.derivatives.clone());
            }
            let base = run(kind, &numbers, 0.0, &ways);
            for j in 1..numbers.len() {
                let Some(row) = kind.bank().unwrap().followed(j) else { continue };
                let is_log = j > 1 && (row - 1) % kind.bank().unwrap().stride < 2;
                let step = if is_log { 1e-6 * numbers[j] } else { 1e-5 };
                let [low, high] = [-step, step].map(|step| {
                    let mut changed = numbers.clone();
                    changed[j] += step;
                    run(kind, &changed, 0.0, &ways)
                });
                let per_unit = if is_log { numbers[j] } else { 1.0 };
                // Once the start is forgotten, and where no element changes its mode between the three.
                for k in (3000..ways.len()).filter(|k| low[*k].1 == high[*k].1) {
                    let quotient = per_unit * (high[k].0 - low[k].0) / (2.0 * step);
                    let off = (followed[k][row] - quotient).abs();
                    let size = base.iter().map(|b| b.0.abs()).fold(0.0, f64::max);
                    compared += 1;
                    assert!(
                        off < 2e-3 * size,
                        "{kind}, number {j}, step {k}: {} for {quotient}",
                        followed[k][row]
                    );
                }
            }
        }
        assert!(compared > 50_000, "{compared}");
    }

    /// One element, which does not slip yet, from a force that is a reading.
    #[test]
    fn a_force_held_at_the_start_does_not_depend_on_the_stiffness() {
        for (kind, head) in [(Kind::MaxwellSlip(1), 2), (Kind::Gms(1), 5)] {
            let mut numbers =
                [vec![0.0, 2.0, 0.4, 0.02, 30.0][..head].to_vec(), vec![400.0, 4e-3]].concat();
            numbers.extend(matches!(kind, Kind::Gms(_)).then_some(0.5));
            let ways = [1e-6; 300];
            let model = kind.build(&numbers[1..]).unwrap();
            let mut state = model.rest_at_force(1.0);
            let mut elements = Elements::new(kind.bank(), &numbers);
            for way in &ways {
                let before = state;
                model.step(&mut state, *way, DURATION);
                elements.after(&model, [&before, &state], (way / DURATION, DURATION));
            }
            let stiffer = 400.0 * 1e-6;
            let base = run(kind, &numbers, 1.0, &ways)[299].0;
            numbers[head] += stiffer;
            let quotient = 400.0 * (run(kind, &numbers, 1.0, &ways)[299].0 - base) / stiffer;
            assert!((elements.derivatives[1] - quotient).abs() < 1e-6, "{kind}: {quotient}");
            assert!((quotient - 400.0 * 300e-6).abs() < 1e-6, "{kind}: {quotient}");
        }
    }
}
