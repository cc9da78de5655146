//! Several elements under one motion, as in a trocar with several seals.

use crate::ems::{Element, State};

/// Advances every element by the same `displacement` (m) within `duration` (s); returns the sum of the forces (N).
///
/// Elements and states are taken in pairs; surplus ones on either side are left alone.
pub fn step_parallel(elements: &[Element], states: &mut [State], displacement: f64, duration: f64) -> f64 {
    elements.iter().zip(states).map(|(element, state)| element.step(state, displacement, duration)).sum()
}

/// Elements and their states under one motion: the force is the sum, EMS section III.
///
/// In steady sliding only ΣF_c and Σβ show; each element has its own deflection and begins to slide on its own.
#[derive(Debug)]
pub struct Parallel<'a> {
    elements: &'a [Element],
    states: &'a mut [State],
}

impl<'a> Parallel<'a> {
    /// Pairs `elements` with `states`; `None` when their numbers differ.
    pub fn new(elements: &'a [Element], states: &'a mut [State]) -> Option<Self> {
        (elements.len() == states.len()).then_some(Self { elements, states })
    }

    /// Advances by `displacement` (m) within `duration` (s); returns the total force (N).
    pub fn step(&mut self, displacement: f64, duration: f64) -> f64 {
        step_parallel(self.elements, self.states, displacement, duration)
    }

    /// Advances at constant `velocity` (m/s) for `duration` (s); returns the total force (N).
    pub fn step_velocity(&mut self, velocity: f64, duration: f64) -> f64 {
        self.step(velocity * duration, duration)
    }

    /// Total force after the last step, N.
    pub fn force(&self) -> f64 {
        self.states.iter().map(State::force).sum()
    }

    /// The states, one per element.
    pub fn states(&self) -> &[State] {
        self.states
    }
}
