//! States: plain words in the caller's memory.

use std::ffi::c_char;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use trocar_model::{Mode, TrocarState};

use crate::message::{Failure, Message};
use crate::model::{Content, Model};
use crate::pointer::{Array, ArrayMut, OutPointer};
use crate::status::{Status, guarded};

/// Bytes of a state.
pub const STATE_SIZE: usize = 480;
/// Numbers of a saved state, trocar_state_save().
pub const STATE_NUMBERS: usize = 55;
/// Bytes that do for nearly all messages.
pub const MESSAGE_SIZE: usize = 512;
/// Mode of a seal that sticks to the instrument and deforms, trocar_state_mode().
pub const MODE_DEFORMING: i32 = 0;
/// Mode of a seal that the instrument slides through.
pub const MODE_SLIDING: i32 = 1;

/// Words of a state.
const WORDS: usize = STATE_SIZE / 8;

/// First word of a state, "TROCARS3"; the digit is its layout.
const MARK: u64 = u64::from_le_bytes(*b"TROCARS3");
/// The same while a function is changing the state, "TROCARS!".
const BUSY: u64 = u64::from_le_bytes(*b"TROCARS!");

/// Where the words stand: the mark, the tag of the model, then `TrocarState::to_numbers`.
const TAG: usize = 1;
const NUMBERS: usize = 2;
const POSITION: usize = NUMBERS + 1;
const FORCE: usize = NUMBERS + 2;

const _: () = assert!(STATE_NUMBERS == trocar_model::flat::STATE_NUMBERS);
const _: () = assert!(NUMBERS + STATE_NUMBERS <= WORDS && size_of::<State>() == STATE_SIZE);

/// What changes while a model runs. The caller owns it: on the stack, in a struct, in an array, TROCAR_STATE_SIZE bytes
/// aligned to 8. It holds no pointer and need not be freed; a copy made while nobody steps it is a valid state. Before the
/// first use trocar_state_init() or its like must fill it: memory without its mark, or with a number that is not finite, is
/// refused, TROCAR_STATUS_NOT_A_STATE. Finite numbers written over its own are not noticed.
///
/// One thread at a time may use a state. A second one gets TROCAR_STATUS_STATE_BUSY.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct State {
    /// Not for the caller.
    pub words: [u64; 60],
}

/// The caller's state as atomic words: defined whatever other threads do to it.
pub(crate) struct Words<'a>(*mut AtomicU64, PhantomData<&'a State>);

impl<'a> Words<'a> {
    /// # Safety
    /// `state` must be null, misaligned, or point to [`STATE_SIZE`] bytes that stay valid during `'a`.
    pub(crate) unsafe fn new(state: *const State) -> Result<Self, Status> {
        let first = state.cast::<AtomicU64>().cast_mut();
        match first {
            p if p.is_null() => Err(Status::NullPointer),
            p if !p.is_aligned() => Err(Status::Misaligned),
            p => Ok(Self(p, PhantomData)),
        }
    }

    fn word(&self, index: usize) -> &'a AtomicU64 {
        let inside = index.min(WORDS - 1);
        // SAFETY: inside the state, which `new` checked; its memory is only ever used as atomics.
        unsafe { &*self.0.add(inside) }
    }

    fn number(&self, index: usize) -> f64 {
        f64::from_bits(self.word(index).load(Ordering::Relaxed))
    }

    /// Takes the state for one call; it must be one of `model`.
    pub(crate) fn taken(&self, model: &Content) -> Result<Taken<'_, 'a>, Status> {
        match self.word(0).compare_exchange(MARK, BUSY, Ordering::Acquire, Ordering::Relaxed) {
            Ok(_) => {}
            Err(BUSY) => return Err(Status::StateBusy),
            Err(_) => return Err(Status::NotAState),
        }
        let words = Taken(self);
        if self.word(TAG).load(Ordering::Relaxed) != model.tag {
            return Err(Status::OtherModel);
        }
        Ok(words)
    }

    /// Whether this is a state at rest.
    fn check(&self) -> Result<(), Status> {
        match self.word(0).load(Ordering::Acquire) {
            MARK => Ok(()),
            BUSY => Err(Status::StateBusy),
            _ => Err(Status::NotAState),
        }
    }

    /// One finite number of a state.
    fn read(&self, index: usize) -> Result<f64, Status> {
        self.check()?;
        Some(self.number(index)).filter(|number| number.is_finite()).ok_or(Status::NotAState)
    }

    /// All numbers of a state that nobody changes meanwhile.
    fn read_all(&self) -> Result<[f64; STATE_NUMBERS], Status> {
        self.check()?;
        let numbers = std::array::from_fn(|index| self.number(NUMBERS + index));
        fence(Ordering::Acquire);
        self.check()?;
        Ok(numbers)
    }

    /// The state as `model` knows it.
    fn decoded(&self, model: &Content) -> Result<TrocarState, Status> {
        let numbers = self.read_all()?;
        if self.word(TAG).load(Ordering::Relaxed) != model.tag {
            return Err(Status::OtherModel);
        }
        model.trocar.state_from_numbers(&numbers).map_err(|_| Status::NotAState)
    }

    /// Last force for a call that fails, N; 0 where there is no state.
    pub(crate) fn last_force(&self) -> f64 {
        let known = matches!(self.word(0).load(Ordering::Acquire), MARK | BUSY);
        Some(self.number(FORCE)).filter(|force| known && force.is_finite()).unwrap_or(0.0)
    }

    /// Fills the memory, whatever it held.
    fn fill(&self, model: &Content, numbers: &[f64; STATE_NUMBERS]) {
        self.word(0).store(0, Ordering::Relaxed);
        fence(Ordering::Release);
        (NUMBERS + STATE_NUMBERS..WORDS)
            .for_each(|index| self.word(index).store(0, Ordering::Relaxed));
        self.word(TAG).store(model.tag, Ordering::Relaxed);
        self.write(numbers);
        self.word(0).store(MARK, Ordering::Release);
    }

    fn write(&self, numbers: &[f64; STATE_NUMBERS]) {
        for (index, number) in numbers.iter().enumerate() {
            self.word(NUMBERS + index).store(number.to_bits(), Ordering::Relaxed);
        }
    }
}

/// A state during a call that may change it; given back when dropped.
pub(crate) struct Taken<'w, 'a>(&'w Words<'a>);

impl Taken<'_, '_> {
    /// Puts the numbers into `state`, a state of the model.
    pub(crate) fn read_into(&self, state: &mut TrocarState) -> Result<(), Status> {
        state.set_numbers(|place| self.0.number(NUMBERS + place)).map_err(|_| Status::NotAState)
    }

    /// What is not finite is not written: the next step would refuse it.
    pub(crate) fn write(&self, state: &TrocarState) -> Result<(), Status> {
        let mut finite = true;
        state.for_each_number(|number| finite &= number.is_finite());
        if !finite {
            return Err(Status::NotFinite);
        }
        let mut place = NUMBERS;
        state.for_each_number(|number| {
            self.0.word(place).store(number.to_bits(), Ordering::Relaxed);
            place += 1;
        });
        Ok(())
    }
}

impl Drop for Taken<'_, '_> {
    fn drop(&mut self) {
        self.0.word(0).store(MARK, Ordering::Release);
    }
}

/// Fills `state` with what `start` makes of the model.
///
/// # Safety
/// By the rule of the crate.
unsafe fn begin(
    model: *const Model,
    state: *mut State,
    numbers: &[f64],
    start: impl FnOnce(&Content) -> Option<TrocarState>,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (model, words) = unsafe { (Model::borrowed(model)?, Words::new(state)?) };
        if !numbers.iter().all(|number| number.is_finite()) {
            return Err(Status::NotFinite);
        }
        words.fill(model, &start(model).ok_or(Status::Unsupported)?.to_numbers());
        Ok(())
    })
}

/// Fills state: an undeformed seal at rest, with the instrument at position_m (m, positive is insertion). To be called
/// before anything else is done with a state, and again at any time; no other thread may use the state meanwhile.
///
/// Refuses: TROCAR_STATUS_NOT_FINITE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_init(
    model: *const Model,
    state: *mut State,
    position_m: f64,
) -> Status {
    // SAFETY: by the rule of the crate.
    unsafe { begin(model, state, &[position_m], |model| Some(model.trocar.rest(position_m))) }
}

/// The same with a seal that holds force_n (N, of the instrument on the seal, positive on insertion), clamped to what
/// the model can hold at rest.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_init_at_force(
    model: *const Model,
    state: *mut State,
    position_m: f64,
    force_n: f64,
) -> Status {
    // SAFETY: by the rule of the crate.
    unsafe {
        begin(model, state, &[position_m, force_n], |model| {
            Some(model.trocar.rest_at_force(position_m, force_n))
        })
    }
}

/// The same with A seal deformed by deflection_m (m, positive with insertion).
///
/// Refuses: TROCAR_STATUS_UNSUPPORTED for a classical model, which knows no deflection.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_init_at_deflection(
    model: *const Model,
    state: *mut State,
    position_m: f64,
    deflection_m: f64,
) -> Status {
    // SAFETY: by the rule of the crate.
    unsafe {
        begin(model, state, &[position_m, deflection_m], |model| {
            model.trocar.rest_at_deflection(position_m, deflection_m)
        })
    }
}

/// Where the instrument is after the last step, m.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_position(
    state: *const State,
    position_m: *mut f64,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (words, mut place) = unsafe { (Words::new(state)?, OutPointer::new(position_m)?) };
        place.set(words.read(POSITION)?);
        Ok(())
    })
}

/// Force after the last step, N: that of the instrument on the seal, positive on insertion. The instrument feels its
/// negative.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_force(state: *const State, force_n: *mut f64) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (words, mut place) = unsafe { (Words::new(state)?, OutPointer::new(force_n)?) };
        place.set(words.read(FORCE)?);
        Ok(())
    })
}

/// Deflection of the seal after the last step, m, positive with insertion; the mean of several elements.
///
/// Refuses: TROCAR_STATUS_UNSUPPORTED for a classical model.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_deflection(
    model: *const Model,
    state: *const State,
    deflection_m: *mut f64,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (model, words, mut place) = unsafe {
            (Model::borrowed(model)?, Words::new(state)?, OutPointer::new(deflection_m)?)
        };
        place.set(words.decoded(model)?.deformation().ok_or(Status::Unsupported)?.deflection);
        Ok(())
    })
}

/// TROCAR_MODE_SLIDING once every element slides, else TROCAR_MODE_DEFORMING.
///
/// Refuses: TROCAR_STATUS_UNSUPPORTED for a classical model.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_mode(
    model: *const Model,
    state: *const State,
    mode: *mut i32,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (model, words, mut place) =
            unsafe { (Model::borrowed(model)?, Words::new(state)?, OutPointer::new(mode)?) };
        place.set(match words.decoded(model)?.deformation().ok_or(Status::Unsupported)?.mode {
            Mode::Deforming => MODE_DEFORMING,
            Mode::Sliding => MODE_SLIDING,
        });
        Ok(())
    })
}

/// Torque after the last step, N·m: that of the instrument on the seal, positive with the angle; 0 for a model without
/// rotation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_torque(
    model: *const Model,
    state: *const State,
    torque_n_m: *mut f64,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (model, words, mut place) =
            unsafe { (Model::borrowed(model)?, Words::new(state)?, OutPointer::new(torque_n_m)?) };
        place.set(words.decoded(model)?.torque());
        Ok(())
    })
}

/// Writes the state as TROCAR_STATE_NUMBERS finite numbers, for a file or another program; count is the number that there is
/// place for. The numbers do not name their model.
///
/// Refuses: TROCAR_STATUS_OUT_OF_RANGE where count is smaller.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_save(
    state: *const State,
    numbers: *mut f64,
    count: usize,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (words, mut place) = unsafe { (Words::new(state)?, ArrayMut::new(numbers, count)?) };
        if count < STATE_NUMBERS {
            return Err(Status::OutOfRange);
        }
        let saved = words.read_all()?;
        if !saved.iter().all(|number| number.is_finite()) {
            return Err(Status::NotAState);
        }
        saved.into_iter().enumerate().for_each(|(index, number)| place.set(index, number));
        Ok(())
    })
}

/// Fills state with what trocar_state_save() wrote; from there on it gives the same forces, to the last bit. The numbers
/// must be those of a model of this kind with as many elements; so a state also moves from one such model to another.
/// message as for trocar_model_load().
///
/// Refuses: TROCAR_STATUS_OUT_OF_RANGE where count is smaller than TROCAR_STATE_NUMBERS, TROCAR_STATUS_NOT_A_STATE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_state_restore(
    model: *const Model,
    state: *mut State,
    numbers: *const f64,
    count: usize,
    message: *mut c_char,
    message_size: usize,
) -> Status {
    // SAFETY: by the rule of the crate.
    let message = unsafe { Message::new(message, message_size) };
    message.report(|| {
        // SAFETY: by the rule of the crate.
        let (model, words, numbers) =
            unsafe { (Model::borrowed(model)?, Words::new(state)?, Array::new(numbers, count)?) };
        if count < STATE_NUMBERS {
            let text = format!("a saved state has {STATE_NUMBERS} numbers, got {count}");
            return Err(Failure::new(Status::OutOfRange, text));
        }
        let row: [f64; STATE_NUMBERS] =
            std::array::from_fn(|index| numbers.get(index).unwrap_or(f64::NAN));
        let state = model.trocar.state_from_numbers(&row);
        words.fill(
            model,
            &state.map_err(|error| Failure::new(Status::NotAState, error))?.to_numbers(),
        );
        Ok(())
    })
}
