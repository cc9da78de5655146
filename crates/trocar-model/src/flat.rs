//! Models and states as rows of numbers, for whoever cannot hold a Rust value: a file beside a
//! binary, the memory of a WebAssembly module, the serialised state of a co-simulation.
//!
//! A row begins with [`FORMAT`], then the kind, then the parameters in SI units in the order of the
//! parameter structs; numbers of parts stand before the parts. Reading checks everything that
//! building the model checks: the same parameters give the same model, to the last bit.

use crate::classical::{Classical, ClassicalState};
use crate::dahl::{Dahl, DahlParams, Remainder};
use crate::damping::SealDamping;
use crate::elastic::{Branch, DeformationForce, MAX_DEGREE, Piece};
use crate::ems::{Element, ElementParams, Mode, State};
use crate::error::ParamError;
use crate::gms::{Gms, GmsElement, SlipRate};
use crate::leuven::{Leuven, LeuvenParams};
use crate::lugre::{LuGre, LuGreParams, StribeckCurve};
use crate::maxwell_slip::{MAX_ELEMENTS, MaxwellSlip, SlipElement};
use crate::parallel::{MAX_STAGES, Stages};
use crate::parameter::{Blank, Parameters};
use crate::profile::PositionProfile;
use crate::relaxation::{MAX_ARMS, RelaxationArm};
use crate::seal::{Seal, SealState, Trocar, TrocarState};
use crate::sliding::SlidingFriction;
use crate::stribeck::StaticFriction;

/// First number of every row: the version of this form.
pub const FORMAT: f64 = 1.0;
/// Most numbers of a row without a position profile.
pub const SEAL_NUMBERS: usize = 4 + MAX_STAGES * ELEMENT_NUMBERS;
/// Numbers of a state, whatever the model: fixed, so that a state fits one place.
pub const STATE_NUMBERS: usize = 3 + SEAL_STATE_NUMBERS;
/// The same for the state of a seal alone, without format, position and force.
pub const SEAL_STATE_NUMBERS: usize = 2 + MAX_STAGES * STATE_OF_ELEMENT;

const ELEMENT_NUMBERS: usize = 4 * (4 + MAX_DEGREE)
    + 1
    + SealDamping::FIELDS.len()
    + 2 * SlidingFriction::FIELDS.len()
    + ElementParams::FIELDS.len()
    + MAX_ARMS * RelaxationArm::FIELDS.len();
const STATE_OF_ELEMENT: usize = 7 + MAX_ARMS;

const EMS: f64 = 0.0;
const STATIC: f64 = 1.0;
const DAHL: f64 = 2.0;
const LUGRE: f64 = 3.0;
const LEUVEN: f64 = 4.0;
const MAXWELL_SLIP: f64 = 5.0;
const GMS: f64 = 6.0;

/// Why a row is no model or no state.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlatError {
    /// The row ends too early, or the place for it is too small.
    Length {
        /// Numbers there are.
        found: usize,
    },
    /// A type tag, which determines what the next numbers are, is not valid.
    Tag {
        /// Where it stands, from 0.
        place: usize,
        /// What was found.
        found: f64,
    },
    /// Parameters that make no model.
    Parameter(ParamError),
}

impl From<ParamError> for FlatError {
    fn from(error: ParamError) -> Self {
        Self::Parameter(error)
    }
}

impl core::fmt::Display for FlatError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Length { found } => write!(f, "{found} numbers are too few"),
            Self::Tag { place, found } => {
                write!(f, "number {place} must be a valid type tag, got {found}")
            }
            Self::Parameter(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for FlatError {}

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

    fn put_bank<T: Parameters>(&mut self, elements: &[T]) {
        self.put(&[elements.len() as f64]);
        elements.iter().for_each(|element| self.put_fields(element));
    }

    fn done(self) -> Result<usize, FlatError> {
        if self.full { Err(FlatError::Length { found: self.row.len() }) } else { Ok(self.count) }
    }
}

/// The number at a place, or why there is none.
trait Numbers: Fn(usize) -> Result<f64, FlatError> {}

impl<F: Fn(usize) -> Result<f64, FlatError>> Numbers for F {}

/// Takes numbers from the front.
struct Reader<F> {
    number: F,
    place: usize,
}

/// The numbers of a row.
fn of_row(row: &[f64]) -> impl Numbers {
    |place| row.get(place).copied().ok_or(FlatError::Length { found: row.len() })
}

impl<F: Numbers> Reader<F> {
    fn new(number: F) -> Self {
        Self { number, place: 0 }
    }

    /// `params` with its numbers from the row.
    fn fields<T: Parameters>(&mut self, mut params: T) -> Result<T, FlatError> {
        for field in T::FIELDS {
            (field.set)(&mut params, self.one()?);
        }
        Ok(params)
    }

    fn bank<T: Blank>(&mut self) -> Result<([T; MAX_ELEMENTS], usize), FlatError> {
        let count = self.count(1, MAX_ELEMENTS)?;
        let mut bank = [T::BLANK; MAX_ELEMENTS];
        for element in bank.iter_mut().take(count) {
            *element = self.fields(T::BLANK)?;
        }
        Ok((bank, count))
    }

    fn fill(&mut self, values: &mut [f64]) -> Result<(), FlatError> {
        values.iter_mut().try_for_each(|value| self.one().map(|number| *value = number))
    }

    fn take<const N: usize>(&mut self) -> Result<[f64; N], FlatError> {
        let mut values = [0.0; N];
        self.fill(&mut values)?;
        Ok(values)
    }

    fn one(&mut self) -> Result<f64, FlatError> {
        let value = (self.number)(self.place)?;
        self.place += 1;
        Ok(value)
    }

    /// A whole number from `least` to `most`.
    fn count(&mut self, least: usize, most: usize) -> Result<usize, FlatError> {
        let found = self.one()?;
        if found >= least as f64 && found <= most as f64 && libm::floor(found) == found {
            return Ok(found as usize);
        }
        Err(FlatError::Tag { place: self.place - 1, found })
    }

    fn flag(&mut self) -> Result<bool, FlatError> {
        let found = self.one()?;
        match found {
            0.0 => Ok(false),
            1.0 => Ok(true),
            _ => Err(FlatError::Tag { place: self.place - 1, found }),
        }
    }

    fn expect(&mut self, value: f64) -> Result<(), FlatError> {
        let found = self.one()?;
        if found == value { Ok(()) } else { Err(FlatError::Tag { place: self.place - 1, found }) }
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
        write_seal(&mut out, self.seal());
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
        write_seal(&mut out, self.seal());
        2 + out.count + self.profile().map_or(0, |profile| 2 + 2 * profile.gains().len())
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
        let seal = read_seal(&mut from)?;
        let place = from.place;
        let knots = from.count(0, usize::MAX)?;
        if knots == 0 {
            return Ok(Self::new(seal, None));
        }
        let wrong = FlatError::Tag { place, found: knots as f64 };
        let [begin, end] = from.take()?;
        let rest = row.get(from.place..).unwrap_or_default();
        let short = FlatError::Length { found: row.len() };
        let (offset, rest) = rest.split_at_checked(knots).ok_or(short)?;
        let gain = rest.get(..knots).ok_or(short)?;
        let profile = PositionProfile::new(begin, end, offset, gain).map_err(|_| wrong)?;
        Ok(Self::new(seal, Some(profile)))
    }
}

fn write_seal(out: &mut Writer, seal: &Seal) {
    match seal {
        Seal::Ems(stages) => {
            out.put(&[EMS, stages.elements().len() as f64]);
            stages.elements().iter().for_each(|element| write_element(out, element.params()));
        }
        Seal::Classical(model) => write_classical(out, model),
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

fn write_classical(out: &mut Writer, model: &Classical) {
    match model {
        Classical::Static(model) => {
            out.put(&[STATIC]);
            out.put_fields(model.params());
        }
        Classical::Dahl(model) => {
            out.put(&[DAHL]);
            out.put_fields(model.params());
        }
        Classical::LuGre(model) => {
            let params = model.params();
            out.put(&[LUGRE]);
            out.put_fields(params);
            out.put(&[f64::from(u8::from(params.curve == StribeckCurve::Rational))]);
            out.put_fields(&params.sliding);
        }
        Classical::Leuven(model) => {
            out.put(&[LEUVEN]);
            out.put_fields(model.params());
            out.put_fields(&model.params().sliding);
            out.put_bank(model.elements());
        }
        Classical::MaxwellSlip(model) => {
            out.put(&[MAXWELL_SLIP, model.viscous_damping()]);
            out.put_bank(model.elements());
        }
        Classical::Gms(model) => {
            let limited = f64::from(u8::from(model.slip_rate() == SlipRate::Limited));
            out.put(&[GMS, limited]);
            out.put_fields(model.sliding());
            out.put_bank(model.elements());
        }
    }
}

fn read_seal(from: &mut Reader<impl Numbers>) -> Result<Seal, FlatError> {
    let place = from.place;
    let kind = from.one()?;
    Ok(Seal::Classical(match kind {
        EMS => return read_stages(from).map(Seal::Ems),
        STATIC => Classical::Static(StaticFriction::new(from.fields(SlidingFriction::BLANK)?)?),
        DAHL => Classical::Dahl(Dahl::new(from.fields(DahlParams::BLANK)?)?),
        LUGRE => {
            let mut params = from.fields(LuGreParams::BLANK)?;
            params.curve =
                if from.flag()? { StribeckCurve::Rational } else { StribeckCurve::Exponential };
            params.sliding = from.fields(SlidingFriction::BLANK)?;
            Classical::LuGre(LuGre::new(params)?)
        }
        LEUVEN => {
            let mut params = from.fields(LeuvenParams::BLANK)?;
            params.sliding = from.fields(SlidingFriction::BLANK)?;
            let (bank, count) = from.bank::<SlipElement>()?;
            Classical::Leuven(Leuven::new(&bank[..count], params)?)
        }
        MAXWELL_SLIP => {
            let viscous_damping = from.one()?;
            let (bank, count) = from.bank::<SlipElement>()?;
            Classical::MaxwellSlip(MaxwellSlip::new(&bank[..count], viscous_damping)?)
        }
        GMS => read_gms(from).map(Classical::Gms)?,
        found => return Err(FlatError::Tag { place, found }),
    }))
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

fn read_gms(from: &mut Reader<impl Numbers>) -> Result<Gms, FlatError> {
    let slip_rate = if from.flag()? { SlipRate::Limited } else { SlipRate::Free };
    let sliding = from.fields(SlidingFriction::BLANK)?;
    let (elements, count) = from.bank::<GmsElement>()?;
    Ok(Gms::new(&elements[..count], sliding, slip_rate)?)
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
        self.seal.for_each_number(see);
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
        set_seal(&mut self.seal, &mut from)
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
        row_of(|see| self.for_each_number(see))
    }

    fn for_each_number(&self, mut see: impl FnMut(f64)) {
        match self {
            Self::Ems(state) => {
                [EMS, state.count as f64].into_iter().for_each(&mut see);
                state.states().iter().for_each(|state| see_element(state, &mut see));
            }
            Self::Classical(state) => see_classical(state, &mut see),
        }
    }
}

impl Seal {
    /// The state that [`SealState::to_numbers`] wrote; it must be one of this seal.
    ///
    /// # Errors
    /// As for [`Trocar::state_from_numbers`].
    pub fn state_from_numbers(&self, row: &[f64]) -> Result<SealState, FlatError> {
        let row = row.get(..SEAL_STATE_NUMBERS).ok_or(FlatError::Length { found: row.len() })?;
        let number = |place: usize| row.get(place).copied().unwrap_or(f64::NAN);
        let mut state = self.rest();
        set_seal(&mut state, &mut Reader::new(finite(number)))?;
        Ok(state)
    }
}

fn set_seal(state: &mut SealState, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
    match state {
        SealState::Ems(state) => {
            from.expect(EMS)?;
            from.expect(state.count as f64)?;
            state.states.iter_mut().take(state.count).try_for_each(|own| set_element(own, from))
        }
        SealState::Classical(state) => set_classical(state, from),
    }
}

fn see_element(state: &State, see: &mut impl FnMut(f64)) {
    let State { deflection, yield_force, force, slip_velocity, contact_slope, rise, arms, mode } =
        state;
    [deflection, yield_force, force, slip_velocity, contact_slope, rise]
        .into_iter()
        .for_each(|number| see(*number));
    see(f64::from(u8::from(*mode == Mode::Sliding)));
    arms.iter().for_each(|arm| see(*arm));
}

fn set_element(state: &mut State, from: &mut Reader<impl Numbers>) -> Result<(), FlatError> {
    let State { deflection, yield_force, force, slip_velocity, contact_slope, rise, arms, mode } =
        state;
    for number in [deflection, yield_force, force, slip_velocity, contact_slope, rise] {
        *number = from.one()?;
    }
    *mode = if from.flag()? { Mode::Sliding } else { Mode::Deforming };
    from.fill(arms)
}

fn see_classical(state: &ClassicalState, see: &mut impl FnMut(f64)) {
    let mut put = |numbers: &[f64]| numbers.iter().for_each(|number| see(*number));
    match state {
        ClassicalState::Static(state) => put(&[STATIC, state.held_force, state.force]),
        ClassicalState::Dahl(state) => {
            let Remainder { y, inverse_power } = state.remainder;
            put(&[DAHL, state.hysteresis_force, state.force, state.direction, y, inverse_power]);
        }
        ClassicalState::LuGre(state) => put(&[LUGRE, state.deflection, state.force]),
        ClassicalState::Leuven(state) => {
            put(&[LEUVEN, state.count as f64, state.deflection, state.force]);
            put(&state.forces);
        }
        ClassicalState::MaxwellSlip(state) => {
            put(&[MAXWELL_SLIP, state.count as f64, state.force]);
            put(&state.forces);
        }
        ClassicalState::Gms(state) => {
            put(&[GMS, state.count as f64, state.direction, state.force]);
            put(&state.deflections);
            put(&state.slipping.map(|slips| f64::from(u8::from(slips))));
        }
    }
}

fn set_classical(
    state: &mut ClassicalState,
    from: &mut Reader<impl Numbers>,
) -> Result<(), FlatError> {
    match state {
        ClassicalState::Static(state) => {
            from.expect(STATIC)?;
            [state.held_force, state.force] = from.take()?;
        }
        ClassicalState::Dahl(state) => {
            from.expect(DAHL)?;
            [state.hysteresis_force, state.force, state.direction] = from.take()?;
            [state.remainder.y, state.remainder.inverse_power] = from.take()?;
        }
        ClassicalState::LuGre(state) => {
            from.expect(LUGRE)?;
            [state.deflection, state.force] = from.take()?;
        }
        ClassicalState::Leuven(state) => {
            from.expect(LEUVEN)?;
            from.expect(state.count as f64)?;
            [state.deflection, state.force] = from.take()?;
            from.fill(&mut state.forces)?;
        }
        ClassicalState::MaxwellSlip(state) => {
            from.expect(MAXWELL_SLIP)?;
            from.expect(state.count as f64)?;
            state.force = from.one()?;
            from.fill(&mut state.forces)?;
        }
        ClassicalState::Gms(state) => {
            from.expect(GMS)?;
            from.expect(state.count as f64)?;
            [state.direction, state.force] = from.take()?;
            from.fill(&mut state.deflections)?;
            for slips in &mut state.slipping {
                *slips = from.flag()?;
            }
        }
    }
    Ok(())
}
