//! Several elements under one motion, as in a trocar with several seals.

use crate::direction::Direction;
use crate::ems::{Element, State};
use crate::friction::Friction;
use crate::relaxation::MAX_ARMS;
use crate::slip::beside::{Beside, Lead, Ordinate};

/// Advances every element by the same `displacement` (m) within `duration` (s); returns the sum of
/// the forces (N).
///
/// Elements and states are taken in pairs; surplus ones on either side are left alone.
pub fn step_parallel(
    elements: &[Element],
    states: &mut [State],
    displacement: f64,
    duration: f64,
) -> f64 {
    elements
        .iter()
        .zip(states)
        .map(|(element, state)| element.step(state, displacement, duration))
        .sum()
}

/// Most elements of [`Stages`].
pub const MAX_STAGES: usize = 4;

/// Up to [`MAX_STAGES`] elements under one motion: the stages of a trocar, such as a duckbill and a
/// lip. The force is the sum, EMS section III.
///
/// In steady sliding only ΣF_c and Σβ show; each element has its own deflection and begins to slide
/// on its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stages {
    /// Those past `count` repeat the first.
    elements: [Element; MAX_STAGES],
    count: usize,
}

impl Stages {
    /// The elements in parallel; `None` for none or more than [`MAX_STAGES`].
    pub fn new(elements: &[Element]) -> Option<Self> {
        let first = *elements.first()?;
        let mut own = [first; MAX_STAGES];
        own.get_mut(..elements.len())?.copy_from_slice(elements);
        Some(Self { elements: own, count: elements.len() })
    }

    /// The elements, at least one.
    pub fn elements(&self) -> &[Element] {
        &self.elements[..self.count.min(MAX_STAGES)]
    }

    /// The same up to the most there can be; those past the last repeat the first.
    pub(crate) fn all(&self) -> [Element; MAX_STAGES] {
        self.elements
    }

    /// State at rest with every element at `deflection`, m; one that is not finite counts as 0.
    pub fn rest_state(&self, deflection: f64) -> StagesState {
        self.rest_at(|_| deflection)
    }

    /// State at rest with every element at a deflection (m) of its own; one that is not finite
    /// counts as 0.
    pub fn rest_at(&self, mut deflection: impl FnMut(&Element) -> f64) -> StagesState {
        self.state(self.elements().iter().map(|element| element.rest_state(deflection(element))))
    }

    /// c of the widest element, m.
    pub fn half_width(&self) -> f64 {
        self.elements()
            .iter()
            .map(|element| element.params().deformation.half_width())
            .fold(0.0, f64::max)
    }

    /// One state an element; the places past them are all alike.
    pub(crate) fn state(&self, states: impl Iterator<Item = State>) -> StagesState {
        let mut own = [State::stuck(0.0, 0.0, 0.0, [0.0; MAX_ARMS]); MAX_STAGES];
        own.iter_mut().zip(states).for_each(|(place, state)| *place = state);
        StagesState { states: own, count: self.count }
    }

    /// The first element.
    pub fn first(&self) -> &Element {
        &self.elements[0]
    }
}

impl From<Element> for Stages {
    fn from(element: Element) -> Self {
        Self { elements: [element; MAX_STAGES], count: 1 }
    }
}

impl Stages {
    /// Element `stage` of up to [`BESIDE`](crate::BESIDE) models in their states, beside that of
    /// this model in `state`; `None` where one of them has no such element, or without any.
    pub fn beside<'a>(
        &self,
        state: &StagesState,
        stage: usize,
        others: &[(&'a Stages, StagesState)],
    ) -> Option<Beside<'a>> {
        let leader = (self.elements().get(stage)?, state.states().get(stage)?);
        if others.iter().any(|(model, own)| stage >= model.count.min(own.count)) {
            return None;
        }
        let elements =
            others.iter().map(|(model, own)| (&model.elements[stage], own.states[stage]));
        Beside::new(stage, leader, elements)
    }

    /// As [`Friction::step`]; `part` is given each part of it. Models that differ little follow them
    /// all in the same order ([`Beside::follow`]), at once or later, to first order in the
    /// differences: the derivatives of the force, at a fraction of the work of steps by themselves.
    /// What the models share is stepped once.
    ///
    /// Every model beside was put beside this one ([`Stages::beside`]), and has followed it since.
    ///
    /// ```
    /// # use trocar_model::{Element, ElementParams, Stages, Friction};
    /// # fn main() -> Result<(), trocar_model::ParamError> {
    /// let params = ElementParams { creep_velocity: 1e-4, ..ElementParams::plausible_10_5_mm()? };
    /// let model = Stages::from(Element::new(params)?);
    /// let other = Stages::from(Element::new(ElementParams { creep_velocity: 1.001e-4, ..params })?);
    /// let (mut state, own) = (model.rest_state(0.0), other.rest_state(0.0));
    /// let mut beside = model.beside(&state, 0, &[(&other, own)]).expect("both have one element");
    /// model.lead(&mut state, 50e-6, 1e-3, |part| beside.follow(&part));
    /// let rate = beside.forces()[0] / 1e-7; // of the force with the creep velocity, N·s/m
    /// assert!(rate < 0.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn lead<'a>(
        &'a self,
        state: &mut StagesState,
        displacement: f64,
        duration: f64,
        mut part: impl FnMut(Lead<'a>),
    ) -> f64 {
        for (k, (element, led)) in self.elements().iter().zip(&mut state.states).enumerate() {
            element.lead(k, led, (displacement, duration), &mut part);
        }
        Self::force(state)
    }
}

impl Beside<'_> {
    /// Puts the state of the element of model `i` into that of the whole model, where the leader is
    /// in `led`; to first order.
    pub fn put_state(&self, i: usize, led: &StagesState, state: &mut StagesState) {
        state.states[self.stage] = self.state(i, &led.states[self.stage]);
    }
}

impl Stages {
    /// As [`Friction::step`], and beside it the derivatives of the force by `ordinates` of the first
    /// element, to first order: what is known about its branches without a parametrisation. Where
    /// the element yields, turns or comes to rest, the step counts as if it were the same
    /// throughout.
    pub fn step_beside_ordinates(
        &self,
        state: &mut StagesState,
        ordinates: &mut [Ordinate],
        displacement: f64,
        duration: f64,
    ) -> f64 {
        for (k, (element, own)) in self.elements().iter().zip(&mut state.states).enumerate() {
            if k == 0 {
                element.lead(k, own, (displacement, duration), |lead| {
                    lead.take_ordinates(ordinates);
                });
            } else {
                element.step(own, displacement, duration);
            }
        }
        Self::force(state)
    }
}

/// States of [`Stages`], one an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StagesState {
    pub(crate) states: [State; MAX_STAGES],
    pub(crate) count: usize,
}

impl StagesState {
    /// The states, in the order of the elements.
    pub fn states(&self) -> &[State] {
        &self.states[..self.count.min(MAX_STAGES)]
    }

    pub(crate) fn states_mut(&mut self) -> &mut [State] {
        &mut self.states[..self.count.min(MAX_STAGES)]
    }
}

impl Friction for Stages {
    type State = StagesState;

    /// Each element bears the share of its static forces.
    fn rest_at_force(&self, force: f64) -> StagesState {
        self.state(rest_states(self.elements(), force))
    }

    /// Each element bears the share of its static forces; [`Element::rest_after`].
    fn rest_after(&self, direction: Direction, force: f64) -> StagesState {
        self.state(shared(self.elements(), force).map(|(e, force)| e.rest_after(direction, force)))
    }

    fn step(&self, state: &mut StagesState, displacement: f64, duration: f64) -> f64 {
        step_parallel(self.elements(), state.states_mut(), displacement, duration)
    }

    fn force(state: &StagesState) -> f64 {
        state.states().iter().map(State::force).sum()
    }
}

/// States at rest that together give `force`, N, each element bearing the share of its static
/// forces.
pub(crate) fn rest_states(elements: &[Element], force: f64) -> impl Iterator<Item = State> + '_ {
    shared(elements, force).map(|(e, force)| e.rest_at_force(force))
}

/// The elements, each with the share of `force`, N, that goes with its static forces.
fn shared(elements: &[Element], force: f64) -> impl Iterator<Item = (&Element, f64)> {
    let limit =
        |e: &Element| e.params().insertion.static_force + e.params().withdrawal.static_force;
    let total: f64 = elements.iter().map(limit).sum();
    elements.iter().map(move |e| (e, force * limit(e) / total))
}
