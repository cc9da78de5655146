//! Models and states as rows of numbers, for whoever cannot hold a Rust value: a file beside a
//! binary, the memory of a WebAssembly module, the serialised state of a co-simulation.
//!
//! A row begins with [`FORMAT`], then the kind, then the parameters in SI units in the order of the
//! parameter structs; numbers of parts stand before the parts. Reading checks everything that
//! building the model checks: the same parameters give the same model, to the last bit.

use core::convert::Infallible;

use crate::classical::Classical;
use crate::damping::SealDamping;
use crate::elastic::{Branch, DeformationForce, MAX_DEGREE, Piece};
use crate::ems::{Element, ElementParams, Mode, State};
use crate::law::{Choice, Elements, MAX_ELEMENTS, Visit};
use crate::parallel::{MAX_STAGES, Stages, StagesState};
use crate::parameter::{Blank, Parameters, Quantity};
use crate::profile::PositionProfile;
use crate::relaxation::{MAX_ARMS, RelaxationArm};
use crate::rotation::Rotation;
pub use crate::row::FlatError;
use crate::row::{Numbers, Reader, Row, row};
use crate::seal::{Seal, SealState, Trocar, TrocarState};
use crate::sliding::SlidingFriction;

/// First number of every row: the version of this form.
pub const FORMAT: f64 = 1.0;
/// Most numbers of a row without a position profile.
pub const SEAL_NUMBERS: usize = 4 + MAX_STAGES * ELEMENT_NUMBERS;
/// Numbers of a state, whatever the model: fixed, so that a state fits one place.
pub const STATE_NUMBERS: usize = 3 + SEAL_STATE_NUMBERS + TURNING_NUMBERS;
/// The same for the state of a seal alone, without format, position and force.
pub(crate) const SEAL_STATE_NUMBERS: usize = 2 + MAX_STAGES * STATE_OF_ELEMENT;

const ELEMENT_NUMBERS: usize = 4 * (4 + MAX_DEGREE)
    + 1
    + SealDamping::FIELDS.len()
    + 2 * SlidingFriction::FIELDS.len()
    + ElementParams::FIELDS.len()
    + MAX_ARMS * RelaxationArm::FIELDS.len();
const STATE_OF_ELEMENT: usize = 8 + MAX_ARMS;
const TURNING_NUMBERS: usize = 2 + 2 * MAX_STAGES;

/// In place of the kind: the numbers of a rotation follow, then the kind.
const TURNS: f64 = -1.0;
/// Kind of EMS elements; the others: [`Classical::tag`].
const EMS: f64 = 0.0;

/// Fills a row from the front.
struct Writer<'a> {
    row: &'a mut [f64],
    count: usize,
    full: bool,
}

impl<'a> Writer<'a> {
    fn new(row: &'a mut [f64]) -> Self {
        Self { row, count: 0, full: false }
    }

    fn put(&mut self, values: &[f64]) {
        for value in values {
            match self.row.get_mut(self.count) {
                Some(slot) => *slot = *value,
                None => self.full = true,
            }
            self.count += 1;
        }
    }

    fn put_fields<T: Parameters>(&mut self, params: &T) {
        T::FIELDS.iter().for_each(|field| self.put(&[(field.get)(params)]));
    }

    fn done(self) -> Result<usize, FlatError> {
        if self.full { Err(FlatError::Length { found: self.row.len() }) } else { Ok(self.count) }
    }
}

/// Puts the members of a model.
impl Visit for Writer<'_> {
    type Error = Infallible;

    fn number(&mut self, _: Quantity, value: &mut f64) -> Result<(), Infallible> {
        self.put(&[*value]);
        Ok(())
    }

    fn choice<T: Choice>(&mut self, chosen: &mut T) -> Result<(), Infallible> {
        let place = T::ALL.iter().position(|(one, _)| one == chosen);
        self.put(&[place.unwrap_or_default() as f64]);
        Ok(())
    }

    fn sliding(&mut self, sliding: &mut SlidingFriction) -> Result<(), Infallible> {
        self.numbers(sliding)
    }

    fn elements<T: Blank>(&mut self, elements: &mut Elements<T>) -> Result<(), Infallible> {
        self.put(&[elements.as_slice().len() as f64]);
        elements.as_mut_slice().iter_mut().try_for_each(|element| self.numbers(element))
    }
}

/// The numbers of a row.
fn of_row(row: &[f64]) -> impl Numbers {
    |place| row.get(place).copied().ok_or(FlatError::Length { found: row.len() })
}

/// Takes the members of a model.
impl<F: Numbers> Visit for Reader<F> {
    type Error = FlatError;

    fn number(&mut self, _: Quantity, value: &mut f64) -> Result<(), FlatError> {
        *value = self.one()?;
        Ok(())
    }

    fn choice<T: Choice>(&mut self, chosen: &mut T) -> Result<(), FlatError> {
        let (place, found) = (self.place, self.one()?);
        let mut all = T::ALL.iter().zip(0u8..);
        let (one, _) = all
            .find(|(_, number)| f64::from(*number) == found)
            .ok_or(FlatError::Tag { place, found })?;
        *chosen = one.0;
        Ok(())
    }

    fn sliding(&mut self, sliding: &mut SlidingFriction) -> Result<(), FlatError> {
        self.numbers(sliding)
    }

    fn elements<T: Blank>(&mut self, elements: &mut Elements<T>) -> Result<(), FlatError> {
        elements.resize(self.count(1, MAX_ELEMENTS)?)?;
        elements.as_mut_slice().iter_mut().try_for_each(|element| self.numbers(element))
    }
}

impl<K: AsRef<[f64]>> Trocar<K> {
    /// Writes the trocar to the front of `row`; returns how many numbers it took.
    ///
    /// # Errors
    /// [`FlatError::Length`] where `row` is too short.
    pub fn write_numbers(&self, row: &mut [f64]) -> Result<usize, FlatError> {
        let mut out = Writer::new(row);
        out.put(&[FORMAT]);
        self.write_ahead(&mut out);
        match self.profile() {
            None => out.put(&[0.0]),
            Some(profile) => {
                out.put(&[profile.gains().len() as f64, profile.from(), profile.to()]);
                out.put(profile.offsets());
                out.put(profile.gains());
            }
        }
        out.done()
    }

    /// Numbers that [`Trocar::write_numbers`] takes.
    pub fn count_numbers(&self) -> usize {
        let mut out = Writer::new(&mut []);
        self.write_ahead(&mut out);
        2 + out.count + self.profile().map_or(0, |profile| 2 + 2 * profile.gains().len())
    }
}

impl<K: AsRef<[f64]>> Trocar<K> {
    /// What stands before the profile.
    fn write_ahead(&self, out: &mut Writer) {
        if let Some(rotation) = self.rotation() {
            out.put(&[TURNS]);
            out.put_fields(rotation);
        }
        write_seal(out, self.seal());
    }
}

impl<'a> Trocar<&'a [f64]> {
    /// The trocar that [`Trocar::write_numbers`] wrote to the front of `row`; its position profile
    /// borrows from `row`.
    ///
    /// # Errors
    /// [`FlatError`]: too short a row, a tag that is none, parameters that make no model.
    pub fn from_numbers(row: &'a [f64]) -> Result<Self, FlatError> {
        let mut from = Reader::new(of_row(row));
        from.expect(FORMAT)?;
        let rotation = read_rotation(&mut from)?;
        let seal = read_seal(&mut from)?;
        let place = from.place;
        let knots = from.count(0, usize::MAX)?;
        if knots == 0 {
            return Ok(Self::new(seal, None).with_rotation(rotation)?);
        }
        let wrong = FlatError::Tag { place, found: knots as f64 };
        let [begin, end] = from.take()?;
        let rest = row.get(from.place..).unwrap_or_default();
        let short = FlatError::Length { found: row.len() };
        let (offset, rest) = rest.split_at_checked(knots).ok_or(short)?;
        let gain = rest.get(..knots).ok_or(short)?;
        let profile = PositionProfile::new(begin, end, offset, gain).map_err(|_| wrong)?;
        Ok(Self::new(seal, Some(profile)).with_rotation(rotation)?)
    }
}

fn write_seal(out: &mut Writer, seal: &Seal) {
    match seal {
        Seal::Ems(stages) => {
            out.put(&[EMS, stages.elements().len() as f64]);
            stages.elements().iter().for_each(|element| write_element(out, element.params()));
        }
        Seal::Classical(model) => {
            out.put(&[model.tag()]);
            let Ok(()) = model.visit(out);
        }
    }
}

fn write_element(out: &mut Writer, params: &ElementParams) {
    let force = &params.deformation;
    for branch in [force.insertion(), force.withdrawal()] {
        for piece in [branch.left(), branch.right()] {
            out.put(&[piece.from(), piece.to(), piece.legendre().len() as f64]);
            out.put(piece.legendre());
        }
    }
    out.put(&[force.yield_stiffness()]);
    out.put_fields(&params.damping);
    out.put_fields(&params.insertion);
    out.put_fields(&params.withdrawal);
    out.put_fields(params);
    params.relaxation.arms.iter().for_each(|arm| out.put_fields(arm));
}

fn read_rotation(from: &mut Reader<impl Numbers>) -> Result<Option<Rotation>, FlatError> {
    if from.one()? == TURNS {
        return from.fields(Rotation::BLANK).map(Some);
    }
    from.place -= 1;
    Ok(None)
}

fn read_seal(from: &mut Reader<impl Numbers>) -> Result<Seal, FlatError> {
    let place = from.place;
    let tag = from.count(0, Classical::KINDS.len())?;
    let Some(index) = tag.checked_sub(1) else { return read_stages(from).map(Seal::Ems) };
    let kind = Classical::KINDS.get(index).copied().unwrap_or_default();
    let wrong = FlatError::Tag { place, found: tag as f64 };
    Classical::build(kind, from).ok_or(wrong)?.map(Seal::Classical)
}

fn read_stages(from: &mut Reader<impl Numbers>) -> Result<Stages, FlatError> {
    let place = from.place;
    let count = from.count(1, MAX_STAGES)?;
    let first = read_element(from)?;
    let mut elements = [first; MAX_STAGES];
    for element in elements.iter_mut().take(count).skip(1) {
        *element = read_element(from)?;
    }
    Stages::new(&elements[..count]).ok_or(FlatError::Tag { place, found: count as f64 })
}

fn read_element(from: &mut Reader<impl Numbers>) -> Result<Element, FlatError> {
    let branches = [
        Branch::new(read_piece(from)?, read_piece(from)?)?,
        Branch::new(read_piece(from)?, read_piece(from)?)?,
    ];
    let deformation = DeformationForce::new(branches[0], branches[1], Some(from.one()?))?;
    let damping = from.fields(SealDamping::BLANK)?;
    let (insertion, withdrawal) =
        (from.fields(SlidingFriction::BLANK)?, from.fields(SlidingFriction::BLANK)?);
    let plain = ElementParams { damping, ..ElementParams::new(deformation, insertion, withdrawal) };
    let mut params = from.fields(plain)?;
    for arm in &mut params.relaxation.arms {
        *arm = from.fields(*arm)?;
    }
    Ok(Element::new(params)?)
}

fn read_piece(from: &mut Reader<impl Numbers>) -> Result<Piece, FlatError> {
    let [begin, end] = from.take()?;
    let count = from.count(1, MAX_DEGREE + 1)?;
    let mut legendre = [0.0; MAX_DEGREE + 1];
    from.fill(&mut legendre[..count])?;
    Ok(Piece::new(begin, end, &legendre[..count])?)
}

/// The numbers that `each` gives, and zeros after them.
fn row_of<const N: usize>(each: impl FnOnce(&mut dyn FnMut(f64))) -> [f64; N] {
    let mut row = [0.0; N];
    let mut places = row.iter_mut();
    each(&mut |number| {
        if let Some(place) = places.next() {
            *place = number;
        }
    });
    row
}

/// The number at `place` that `number` gives, where it is finite.
fn finite(number: impl Fn(usize) -> f64) -> impl Numbers {
    move |place| {
        let found = number(place);
        if found.is_finite() { Ok(found) } else { Err(FlatError::Tag { place, found }) }
    }
}

impl TrocarState {
    /// The state as numbers; unused ones are 0.
    pub fn to_numbers(&self) -> [f64; STATE_NUMBERS] {
        row_of(|see| self.for_each_number(see))
    }

    /// Calls `see` with the numbers of [`TrocarState::to_numbers`] in order, up to the last one that
    /// this kind of state uses.
    pub fn for_each_number(&self, mut see: impl FnMut(f64)) {
        [FORMAT, self.position, self.force].into_iter().for_each(&mut see);
        self.seal.see(&mut see);
        if let Some(turning) = &self.turning {
            turning.see(&mut see);
        }
    }

    /// Becomes the state of the same kind whose [`TrocarState::to_numbers`] has `number(place)` at
    /// each place. Only the numbers that this kind of state uses are asked for.
    ///
    /// # Errors
    /// [`FlatError::Tag`] for another kind's state or a number that is not finite; the state is then
    /// one of its kind, but not to be used.
    pub fn set_numbers(&mut self, number: impl Fn(usize) -> f64) -> Result<(), FlatError> {
        let mut from = Reader::new(finite(number));
        from.expect(FORMAT)?;
        [self.position, self.force] = from.take()?;
        self.seal.set(&mut from)?;
        self.turning.as_mut().map_or(Ok(()), |turning| turning.set(&mut from))
    }
}

impl<K: AsRef<[f64]>> Trocar<K> {
    /// The state that [`TrocarState::to_numbers`] wrote; it must be one of this model.
    ///
    /// # Errors
    /// [`FlatError::Length`] for too few numbers, [`FlatError::Tag`] for another model's state or a
    /// number that is not finite.
    pub fn state_from_numbers(&self, row: &[f64]) -> Result<TrocarState, FlatError> {
        let row = row.get(..STATE_NUMBERS).ok_or(FlatError::Length { found: row.len() })?;
        let mut state = self.rest(0.0);
        state.set_numbers(|place| row.get(place).copied().unwrap_or(f64::NAN))?;
        Ok(state)
    }
}

impl SealState {
    /// The state as numbers; unused ones are 0.
    pub fn to_numbers(&self) -> [f64; SEAL_STATE_NUMBERS] {
        row_of(|mut see| self.see(&mut see))
    }
}

impl Seal {
    /// The state that [`SealState::to_numbers`] wrote; it must be one of this seal.
    ///
    /// # Errors
    /// As for [`Trocar::state_from_numbers`].
    pub fn state_from_numbers(&self, row: &[f64]) -> Result<SealState, FlatError> {
        let row = row.get(..SEAL_STATE_NUMBERS).ok_or(FlatError::Length { found: row.len() })?;
        let mut state = self.rest();
        state.set(&mut Reader::new(finite(|place| row.get(place).copied().unwrap_or(f64::NAN))))?;
        Ok(state)
    }
}

impl Row for Mode {
    fn see(&self, see: &mut impl FnMut(f64)) {
        (*self == Mode::Sliding).see(see);
    }

    fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
        *self = if from.flag()? { Mode::Sliding } else { Mode::Deforming };
        Ok(())
    }
}

row!(State {
    deflection,
    yield_force,
    force,
    slip_velocity,
    contact_slope,
    rise,
    mode,
    arms,
    contact_age,
});

impl Row for StagesState {
    fn see(&self, see: &mut impl FnMut(f64)) {
        self.count.see(see);
        self.states().iter().for_each(|state| state.see(see));
    }

    fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
        self.count.set(from)?;
        self.states.iter_mut().take(self.count).try_for_each(|state| state.set(from))
    }
}

impl Row for SealState {
    fn see(&self, see: &mut impl FnMut(f64)) {
        match self {
            Self::Ems(state) => {
                see(EMS);
                state.see(see);
            }
            Self::Classical(state) => state.see(see),
        }
    }

    fn set(&mut self, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
        match self {
            Self::Ems(state) => {
                from.expect(EMS)?;
                state.set(from)
            }
            Self::Classical(state) => state.set(from),
        }
    }
}
