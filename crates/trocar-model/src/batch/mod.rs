//! Many seals under one motion: sweeps, ensembles of a fit, a fleet of what-ifs.
//!
//! A [`Batch`] steps N models by the same displacement and duration. Elements with constant sliding
//! friction, no seal damping, no creep and no relaxation (those that [`crate::Element::step`]
//! solves exactly) run [`LANES`] at a time as vectors; all other models run their own step, one
//! after the other, at its speed. Any mix is allowed. **Every force and every state has the bits of
//! the model's own step.**
//!
//! The caller owns the memory: the models, a state for each, and [`blocks`] places of [`Lanes`].
//! Nothing allocates.
//!
//! ```
//! use trocar_model::batch::{Batch, Lanes, blocks};
//! use trocar_model::{Element, ElementParams, SlidingFriction};
//!
//! # fn main() -> Result<(), trocar_model::ParamError> {
//! let plausible = ElementParams::plausible_10_5_mm()?;
//! let mut elements = [Element::new(plausible)?; 100];
//! for (k, element) in elements.iter_mut().enumerate() {
//!     let insertion = SlidingFriction { viscous_damping: 0.1 * k as f64, ..plausible.insertion };
//!     *element = Element::new(ElementParams { insertion, ..plausible })?;
//! }
//! let mut states = elements.map(|element| element.rest_state(0.0));
//! let mut lanes = [Lanes::EMPTY; blocks(100)];
//! let mut batch = Batch::new(&elements, &mut states, &mut lanes).expect("as many states and blocks as elements");
//! for _ in 0..1000 {
//!     batch.step(50e-6, 1e-3);
//! }
//! assert!(batch.force(99) > batch.force(0));
//! # Ok(())
//! # }
//! ```
//!
//! # Speed
//!
//! [`Batch::run`] takes a whole motion, block by block, so that a block stays in the processor's
//! first cache. What the forces are wanted for is computed where they arise, [`Observe`]: written
//! away, compared with a measured force, summed up. All of it is `#[inline(always)]`: a program
//! that is compiled for, or chooses at run time, wider vectors gets them (and the same bits: no
//! operation is fused or reordered).

mod lanes;
mod observe;

use crate::ems::{Element, Mode, State};
use crate::friction::{Friction, velocity};
use crate::seal::{Seal, SealState};
use lanes::{LaneSet, Stride};

pub use lanes::{LANES, Lanes};
pub use observe::{Forces, Observe, Squares};

/// Fewer elements than this in a block are stepped one by one: that is faster than all lanes.
const FEWEST: u32 = 8;

/// Blocks of [`Lanes`] that `count` models need.
pub const fn blocks(count: usize) -> usize {
    count.div_ceil(LANES)
}

/// A model that a [`Batch`] can step.
pub trait Many: Friction {
    /// The element that the model is, with its state; `None` for what is more than one element.
    fn single<'a>(&'a self, state: &'a Self::State) -> Option<(&'a Element, &'a State)>;

    /// Puts a new state of that element back.
    fn put_single(state: &mut Self::State, single: State);

    /// Whether the model slides; `None` for one without a mode.
    fn slides(state: &Self::State) -> Option<bool>;
}

impl Many for Element {
    fn single<'a>(&'a self, state: &'a State) -> Option<(&'a Element, &'a State)> {
        Some((self, state))
    }

    fn put_single(state: &mut State, single: State) {
        *state = single;
    }

    fn slides(state: &State) -> Option<bool> {
        Some(state.mode == Mode::Sliding)
    }
}

impl Many for Seal {
    fn single<'a>(&'a self, state: &'a SealState) -> Option<(&'a Element, &'a State)> {
        match (self, state) {
            (Self::Ems(stages), SealState::Ems(states)) => {
                match (stages.elements(), states.states()) {
                    ([element], [state]) => Some((element, state)),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    fn put_single(state: &mut SealState, single: State) {
        if let SealState::Ems(states) = state {
            states.states[0] = single;
        }
    }

    fn slides(state: &SealState) -> Option<bool> {
        state.deformation().map(|deformation| deformation.mode == Mode::Sliding)
    }
}

/// Models with their states under one motion; see the [module](self).
#[derive(Debug)]
pub struct Batch<'a, M: Many> {
    models: &'a [M],
    states: &'a mut [M::State],
    blocks: &'a mut [Lanes],
}

/// One block of a batch: its models, at most [`LANES`].
struct Block<'a, M: Many> {
    models: &'a [M],
    states: &'a mut [M::State],
    lanes: &'a mut Lanes,
}

impl<'a, M: Many> Batch<'a, M> {
    /// `models`, each from its state in `states`, and [`blocks`] places to work in, whose content
    /// does not matter.
    ///
    /// `None` when the numbers of models, states and blocks do not match.
    pub fn new(
        models: &'a [M],
        states: &'a mut [M::State],
        blocks: &'a mut [Lanes],
    ) -> Option<Self> {
        if models.len() != states.len() || blocks.len() != self::blocks(models.len()) {
            return None;
        }
        let mut batch = Self { models, states, blocks };
        batch.each().for_each(|mut block| block.load());
        Some(batch)
    }

    /// Number of models.
    pub fn len(&self) -> usize {
        self.models.len()
    }

    /// Whether there is no model.
    pub fn is_empty(&self) -> bool {
        self.models.is_empty()
    }

    /// Models that run as vectors.
    pub fn vectorised(&self) -> usize {
        self.blocks.iter().map(|lanes| lanes.fast.count_ones() as usize).sum()
    }

    /// Advances all by `displacement` (m) within `duration` (s) at constant velocity.
    ///
    /// A duration that is not positive, or a displacement, duration or velocity that is not finite,
    /// leaves all states untouched. So does, for a single model, a number that would grow beyond
    /// all bounds.
    #[inline(always)]
    pub fn step(&mut self, displacement: f64, duration: f64) {
        if let Some(velocity) = velocity(displacement, duration) {
            let stride = Stride { velocity, time: duration };
            // No closures on the way to the lanes: one of its own would not be compiled for the
            // caller's vectors.
            for mut block in self.each() {
                block.step(stride, displacement);
            }
        }
    }

    /// Advances all through `motion`, pairs of displacement (m) and duration (s), block after
    /// block; `observer` sees every block after every sample, also after those that change nothing.
    #[inline(always)]
    pub fn run(
        &mut self,
        motion: impl Iterator<Item = (f64, f64)> + Clone,
        observer: &mut impl Observe,
    ) {
        for (k, mut block) in self.each().enumerate() {
            let (first, count) = (k * LANES, block.models.len());
            observer.begin(first, count);
            for (sample, (displacement, duration)) in motion.clone().enumerate() {
                if let Some(velocity) = velocity(displacement, duration) {
                    block.step(Stride { velocity, time: duration }, displacement);
                }
                observer.see(sample, block.lanes);
            }
            observer.end(first, count);
        }
    }

    /// Force of model `index` after the last step, N: that of the instrument on the seal. NaN for a
    /// model that is not there.
    pub fn force(&self, index: usize) -> f64 {
        let lane = index % LANES;
        self.blocks
            .get(index / LANES)
            .filter(|_| index < self.len())
            .map_or(f64::NAN, |lanes| lanes.force[lane])
    }

    /// State of model `index` after the last step.
    pub fn state(&self, index: usize) -> Option<M::State> {
        let mut state = *self.states.get(index)?;
        let lanes = self.blocks.get(index / LANES)?;
        if lanes.fast >> (index % LANES) & 1 == 1 {
            M::put_single(&mut state, lanes.state(index % LANES));
        }
        Some(state)
    }

    /// The caller's states become those after the last step: until then they are those of before
    /// the first, for models that run as vectors.
    pub fn finish(mut self) {
        self.each().for_each(|mut block| block.unload());
    }

    #[inline(always)]
    fn each(&mut self) -> impl Iterator<Item = Block<'_, M>> {
        let parts = self
            .models
            .chunks(LANES)
            .zip(self.states.chunks_mut(LANES))
            .zip(self.blocks.iter_mut());
        parts.map(|((models, states), lanes)| Block { models, states, lanes })
    }
}

impl<M: Many> Block<'_, M> {
    /// Fills the lanes; those without an element of their own repeat the first that has one.
    fn load(&mut self) {
        *self.lanes = Lanes::EMPTY;
        let pairs = || self.models.iter().zip(self.states.iter());
        let singles = || {
            pairs().map(|(model, state)| model.single(state).filter(|(e, s)| Lanes::can_run(e, s)))
        };
        let set: LaneSet = singles()
            .enumerate()
            .filter(|(_, single)| single.is_some())
            .fold(0, |set, (i, _)| set | 1 << i);
        if set.count_ones() >= FEWEST {
            if let Some((element, state)) = singles().flatten().next() {
                (0..LANES).for_each(|lane| self.lanes.load(lane, element, state));
            }
            for (lane, single) in singles().enumerate() {
                if let Some((element, state)) = single {
                    self.lanes.load(lane, element, state);
                }
            }
            self.lanes.fast = set;
        }
        self.show_others();
    }

    #[inline(always)]
    fn step(&mut self, stride: Stride, displacement: f64) {
        let fast = self.lanes.fast;
        if fast != 0 {
            let (models, states) = (self.models, &*self.states);
            let untouched = self
                .lanes
                .advance(stride, |lanes, stale| bring(models, states, lanes, stale, stride));
            if untouched != 0 {
                self.step_lanes(untouched, displacement, stride.time);
            }
        }
        if fast.count_ones() as usize != self.models.len() {
            self.step_others(displacement, stride.time);
        }
    }

    /// The scalar step for the lanes `set`.
    #[cold]
    fn step_lanes(&mut self, set: LaneSet, displacement: f64, duration: f64) {
        let fast = self.lanes.fast;
        for (lane, (model, place)) in self.models.iter().zip(self.states.iter()).enumerate() {
            if set & fast & (1 << lane) != 0
                && let Some((element, _)) = model.single(place)
            {
                let mut state = self.lanes.state(lane);
                element.step(&mut state, displacement, duration);
                self.lanes.store(lane, &state);
            }
        }
        let first = first_of(fast);
        (0..LANES)
            .filter(|lane| set & !fast & (1 << lane) != 0)
            .for_each(|lane| self.lanes.copy_state(lane, first));
    }

    /// The models that are not in lanes.
    #[inline(never)]
    fn step_others(&mut self, displacement: f64, duration: f64) {
        let fast = self.lanes.fast;
        for (lane, (model, state)) in self.models.iter().zip(self.states.iter_mut()).enumerate() {
            if fast & (1 << lane) == 0 {
                model.step(state, displacement, duration);
            }
        }
        self.show_others();
    }

    /// Their forces, among those of the lanes.
    fn show_others(&mut self) {
        for (lane, state) in self.states.iter().enumerate() {
            if self.lanes.fast & (1 << lane) == 0 {
                self.lanes.show(lane, M::force(state), M::slides(state));
            }
        }
    }

    fn unload(&mut self) {
        for (lane, state) in self.states.iter_mut().enumerate() {
            if self.lanes.fast & (1 << lane) != 0 {
                M::put_single(state, self.lanes.state(lane));
            }
        }
    }
}

/// Brings the span that they need into the lanes `stale`.
#[cold]
fn bring<M: Many>(
    models: &[M],
    states: &[M::State],
    lanes: &mut Lanes,
    stale: LaneSet,
    stride: Stride,
) {
    let fast = lanes.fast;
    for lane in (0..LANES).filter(|lane| stale & (1 << lane) != 0) {
        let own = if fast & (1 << lane) != 0 { lane } else { first_of(fast) };
        if let Some((element, _)) =
            models.get(own).zip(states.get(own)).and_then(|(model, state)| model.single(state))
        {
            lanes.bring(lane, element, lanes.target(lane, stride));
        }
    }
}

fn first_of(set: LaneSet) -> usize {
    set.trailing_zeros() as usize % LANES
}
