//! Several elements under one motion, as in a trocar with several seals.

use crate::ems::{Element, State};
use crate::friction::Friction;
use crate::relaxation::MAX_ARMS;
use crate::slip::beside::{Apart, Different, Ordinate};

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

/// A model that differs little from another, and how its state differs from the other's; see
/// [`Stages::step_beside`].
#[derive(Debug)]
pub struct Beside<'a> {
    stages: &'a Stages,
    /// `None` where the elements are the same in the same state.
    different: [Option<Different>; MAX_STAGES],
    apart: [Apart; MAX_STAGES],
    /// States of elements beyond those of the other model.
    own: StagesState,
    force: f64,
}

impl Beside<'_> {
    /// State of the model, where the other is in `led`; to first order.
    pub fn state(&self, led: &StagesState) -> StagesState {
        let mut state = self.own;
        for ((own, apart), led) in state.states.iter_mut().zip(&self.apart).zip(led.states()) {
            *own = apart.state_beside(led);
        }
        state
    }

    /// Force of the model, N.
    pub fn force(&self) -> f64 {
        self.force
    }
}

impl Stages {
    /// `other`, in `own` state, beside this model in `state`.
    pub fn beside<'a>(
        &self,
        state: &StagesState,
        other: &'a Stages,
        own: StagesState,
    ) -> Beside<'a> {
        let mut beside = Beside {
            stages: other,
            different: [None; MAX_STAGES],
            apart: [Apart::default(); MAX_STAGES],
            own,
            force: Self::force(&own),
        };
        for k in 0..self.count.min(other.count) {
            let (element, its) = (&self.elements[k], &other.elements[k]);
            if element != its || state.states[k] != own.states[k] {
                beside.different[k] = Some(element.difference(its));
                beside.apart[k] = element.apart(&state.states[k], its, &own.states[k]);
            }
        }
        beside
    }

    /// As [`Friction::step`], and beside it the same step of models that differ little, to first
    /// order in the differences: the derivatives of the force, at a fraction of the work of steps
    /// by themselves. What the models share is stepped once.
    ///
    /// Every model of `beside` was put beside this one ([`Stages::beside`]), and both were stepped
    /// together since.
    ///
    /// ```
    /// # use trocar_model::{Element, ElementParams, Stages, Friction};
    /// # fn main() -> Result<(), trocar_model::ParamError> {
    /// let params = ElementParams { creep_velocity: 1e-4, ..ElementParams::plausible_10_5_mm()? };
    /// let model = Stages::from(Element::new(params)?);
    /// let other = Stages::from(Element::new(ElementParams { creep_velocity: 1.001e-4, ..params })?);
    /// let (mut state, own) = (model.rest_state(0.0), other.rest_state(0.0));
    /// let mut beside = [model.beside(&state, &other, own)];
    /// let force = model.step_beside(&mut state, &mut beside, 50e-6, 1e-3);
    /// let rate = (beside[0].force() - force) / 1e-7; // of the force with the creep velocity, N·s/m
    /// assert!(rate < 0.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn step_beside(
        &self,
        state: &mut StagesState,
        beside: &mut [Beside],
        displacement: f64,
        duration: f64,
    ) -> f64 {
        for (k, (element, led)) in self.elements().iter().zip(&mut state.states).enumerate() {
            element.lead(led, displacement, duration, |lead| {
                for Beside { stages, different, apart, .. } in beside.iter_mut() {
                    if let (Some(different), Some(element)) =
                        (&different[k], stages.elements().get(k))
                    {
                        lead.take(element, different, &mut apart[k]);
                    }
                }
            });
        }
        let force = Self::force(state);
        for Beside { stages, apart, own, force: its, .. } in beside {
            let count = self.count.min(stages.count);
            let led: f64 = if count < self.count {
                state.states[..count].iter().map(State::force).sum()
            } else {
                force
            };
            let more = stages.elements().iter().zip(&mut own.states).skip(count);
            let beyond: f64 =
                more.map(|(element, own)| element.step(own, displacement, duration)).sum();
            *its = led + apart[..count].iter().map(|a| a.force).sum::<f64>() + beyond;
        }
        force
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
                element.lead(own, displacement, duration, |lead| lead.take_ordinates(ordinates));
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
}

impl Friction for Stages {
    type State = StagesState;

    /// Each element bears the share of its static forces.
    fn rest_at_force(&self, force: f64) -> StagesState {
        self.state(rest_states(self.elements(), force))
    }

    fn step(&self, state: &mut StagesState, displacement: f64, duration: f64) -> f64 {
        step_parallel(
            self.elements(),
            &mut state.states[..self.count.min(MAX_STAGES)],
            displacement,
            duration,
        )
    }

    fn force(state: &StagesState) -> f64 {
        state.states().iter().map(State::force).sum()
    }
}

/// States at rest that together give `force`, N, each element bearing the share of its static
/// forces.
pub(crate) fn rest_states(elements: &[Element], force: f64) -> impl Iterator<Item = State> + '_ {
    let limit =
        |e: &Element| e.params().insertion.static_force + e.params().withdrawal.static_force;
    let total: f64 = elements.iter().map(limit).sum();
    elements.iter().map(move |e| e.rest_at_force(force * limit(e) / total))
}
