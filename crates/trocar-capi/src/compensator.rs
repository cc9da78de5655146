//! The observer of the tissue force: made once, owned by the library, stepped in the loop.

use std::cell::UnsafeCell;
use std::ffi::{CStr, c_char};
use std::mem::offset_of;
use std::sync::atomic::{AtomicU64, Ordering};

use trocar_runtime::compensate::{self, CompensateError, CompensateOptions};

use crate::message::{Failure, Message};
use crate::model::Model;
use crate::pointer::{OutPointer, checked};
use crate::status::{Status, guarded};

/// First word of every compensator, "TROCARC1".
const MARK: u64 = u64::from_le_bytes(*b"TROCARC1");
/// The same while a function is using it, "TROCARC!".
const BUSY: u64 = u64::from_le_bytes(*b"TROCARC!");
/// The same after a panic, "TROCARC?": the observer may be half changed. It can only be freed.
const LOST: u64 = u64::from_le_bytes(*b"TROCARC?");

/// An observer of the force on the tissue: what a sensor outside the body reads less what the trocar takes. Made by
/// trocar_compensator_new(), ended by trocar_compensator_free(). It keeps a copy of what it needs of its model.
///
/// One thread at a time may use a compensator. A second one gets TROCAR_STATUS_STATE_BUSY. After a call that ended with
/// TROCAR_STATUS_INTERNAL it is lost: all calls but trocar_compensator_free() give that status from then on.
pub struct Compensator {
    content: Content,
}

/// The mark stands first: whatever a wrong pointer points to, no more than its first word is read. It is the lock, too.
#[repr(C)]
struct Content {
    mark: AtomicU64,
    observer: UnsafeCell<compensate::Compensator>,
}

const _: () = assert!(offset_of!(Compensator, content) == 0 && offset_of!(Content, mark) == 0);
/// One thread may make a compensator, another use it.
const _: fn() = || {
    fn may_move<T: Send>() {}
    may_move::<compensate::Compensator>();
};

/// How a compensator is set up. trocar_compensator_options_init() fills it; NaN stands for the value in the model file.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct CompensatorOptions {
    /// Size of this struct in bytes; a library that knows another one refuses it.
    pub struct_size: usize,
    /// Reading without any force, N, with the sign of the readings; NaN: as in the model file, else 0.
    pub offset_n: f64,
    /// Mass between sensor and seal, kg, 0 or more; NaN: as in the model file, else 0.
    pub moving_mass_kg: f64,
    /// Gravity as it acts on the reading of the moving mass, m/s²; 0 where the weight is part of the offset,
    /// as it is of the offset of a model file: with gravity, state offset_n without the weight.
    pub gravity_m_s2: f64,
    /// Largest force that the sensor can read, N, above 0; NaN: none is known.
    pub sensor_limit_n: f64,
    /// Standard deviation of the model's force, N, 0 or more; NaN: as in the model file, by phase.
    pub force_error_n: f64,
    /// 1: friction and viscosity are adapted in use; 0: they stay those of the model.
    pub adaptation: i32,
    /// Whether the sign of each reading is reversed, 1 or 0; -1: as the recordings of the model file were, else 0.
    pub flip_force: i32,
}

/// What cannot be right about a sample. No error of the call: what the compensator makes of it is defined.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Nothing.
    None = 0,
    /// The reading is NaN or infinite: no tissue force, the model goes on.
    NoReading = 1,
    /// The position, or the angle, is NaN or infinite: no tissue force, the model waits.
    NoPosition = 2,
    /// The duration is not above 0 and finite: the model waits.
    NoDuration = 3,
    /// The reading is at the sensor's limit: no tissue force, it is larger.
    Saturated = 4,
    /// The reading has not changed although the force must have: no tissue force.
    Frozen = 5,
    /// The position, or the surface of a turning shaft, moved faster than 1 m/s, and by more than 1 mm: a new zero of the encoder, not a motion.
    Jump = 6,
    /// More than 0.2 s since the last sample: the state of the seal is unknown until it has slid.
    Gap = 7,
    /// The reading, or the position, has the opposite sign of the model's over several strokes: no tissue force.
    OppositeSign = 8,
}

/// Estimate of a compensator after each sample. Forces are those of the instrument on what it touches.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Force on seal and trocar, N.
    pub trocar_force_n: f64,
    /// Force on the tissue, N; NaN where the reading does not determine it.
    pub tissue_force_n: f64,
    /// Standard deviation of both, N; NaN before the first position.
    pub tissue_force_std_n: f64,
    /// 1 while friction and viscosity are being adapted, 0 during contact with tissue or without informative motion.
    pub adapting: i32,
    /// What cannot be right about this sample.
    pub fault: Fault,
}

/// Where friction and viscosity stand, over those of the model.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Drift {
    /// Friction without its viscous part; wetting lowers it.
    pub level: f64,
    /// Viscous part.
    pub viscosity: f64,
    /// Standard deviation of level.
    pub level_std: f64,
    /// Standard deviation of viscosity.
    pub viscosity_std: f64,
}

impl Fault {
    const ALL: [(Self, &CStr); 9] = [
        (Self::None, c"nothing is wrong"),
        (Self::NoReading, c"no force reading: no tissue force"),
        (Self::NoPosition, c"no position or angle: no tissue force, the model waits"),
        (Self::NoDuration, c"time does not advance: the model waits"),
        (Self::Saturated, c"the force reading is at the sensor's limit: no tissue force"),
        (Self::Frozen, c"the force reading is frozen while the force must have changed: no tissue force"),
        (Self::Jump, c"the position jumps (over 1 m/s): a new zero of the encoder, not a motion; the seal's state is unknown until it has slid"),
        (Self::Gap, c"more than 0.2 s without a sample: the seal's state is unknown until it has slid"),
        (Self::OppositeSign, c"the force reading, or the position, has the opposite sign of the model's over several strokes: no tissue force"),
    ];
}

impl From<Option<compensate::Fault>> for Fault {
    fn from(fault: Option<compensate::Fault>) -> Self {
        // Both number their faults in one order; here 0 is none.
        Self::ALL[fault.map_or(0, |fault| fault as usize + 1)].0
    }
}

impl Estimate {
    /// Of a call that was refused.
    const NONE: Self = Self {
        trocar_force_n: 0.0,
        tissue_force_n: f64::NAN,
        tissue_force_std_n: f64::NAN,
        adapting: 0,
        fault: Fault::None,
    };
}

impl From<compensate::Estimate> for Estimate {
    fn from(estimate: compensate::Estimate) -> Self {
        Self {
            trocar_force_n: estimate.trocar_force,
            tissue_force_n: estimate.tissue_force,
            tissue_force_std_n: estimate.std,
            adapting: estimate.adapting.into(),
            fault: estimate.fault.into(),
        }
    }
}

impl CompensatorOptions {
    const DEFAULT: Self = Self {
        struct_size: size_of::<Self>(),
        offset_n: f64::NAN,
        moving_mass_kg: f64::NAN,
        gravity_m_s2: 0.0,
        sensor_limit_n: f64::NAN,
        force_error_n: f64::NAN,
        adaptation: 1,
        flip_force: -1,
    };

    /// # Safety
    /// `options` must be null, misaligned, or point to a struct of the size in its first field.
    unsafe fn read(options: *const Self) -> Result<CompensateOptions, Failure> {
        if options.is_null() {
            return Ok(CompensateOptions::default());
        }
        let options = checked(options)?;
        // The size first: what is smaller must not be read as a whole.
        // SAFETY: not null, aligned; the rest by contract.
        let size = unsafe { options.cast::<usize>().read() };
        check_size(size)?;
        // SAFETY: of the size in its first field.
        let options = unsafe { options.read() };
        let known = |value: f64| (!value.is_nan()).then_some(value);
        let adaptation = match options.adaptation {
            0 => false,
            1 => true,
            other => {
                return Err(out_of_range(format_args!("adaptation must be 0 or 1, got {other}")));
            }
        };
        let flip_force = match options.flip_force {
            -1 => None,
            0 => Some(false),
            1 => Some(true),
            other => {
                return Err(out_of_range(format_args!(
                    "flip_force must be -1, 0 or 1, got {other}"
                )));
            }
        };
        Ok(CompensateOptions {
            offset_n: known(options.offset_n),
            flip_force,
            moving_mass_kg: known(options.moving_mass_kg),
            gravity_m_s2: options.gravity_m_s2,
            sensor_limit_n: known(options.sensor_limit_n),
            force_error_n: known(options.force_error_n),
            adaptation,
        })
    }
}

fn check_size(size: usize) -> Result<(), Failure> {
    let known = size_of::<CompensatorOptions>();
    let text = format_args!(
        "struct_size must be {known}, got {size}: call trocar_compensator_options_init() first"
    );
    if size == known { Ok(()) } else { Err(out_of_range(text)) }
}

fn out_of_range(text: std::fmt::Arguments) -> Failure {
    Failure::new(Status::OutOfRange, text)
}

fn refused(error: CompensateError) -> Failure {
    match error {
        CompensateError::OutOfRange { .. }
        | CompensateError::WeightTwice { .. }
        | CompensateError::GravityWithoutMass { .. } => Failure::new(Status::OutOfRange, error),
        CompensateError::NoForceError => {
            let text = "the model does not state the error of its force (force_error): identify it again with \
                        validate, or set force_error_n";
            Failure::new(Status::Unsupported, text)
        }
        CompensateError::SignUnknown => {
            let text = "some recordings of the model were read with the sign of the force reversed and some without: \
                        set flip_force";
            Failure::new(Status::Unsupported, text)
        }
        error => Failure::new(Status::ModelInvalid, error),
    }
}

/// A compensator during a call. When dropped it is given back, or lost where a panic ended the call.
struct Taken<'a> {
    content: &'a Content,
    whole: bool,
}

impl<'a> Taken<'a> {
    /// Takes the compensator for one call.
    ///
    /// # Safety
    /// `compensator` must be null, misaligned, or readable for the size of a compensator during `'a`.
    unsafe fn new(compensator: *const Compensator) -> Result<Self, Status> {
        // SAFETY: by contract.
        unsafe { Self::marked(compensator, MARK) }
    }

    /// The same for one that bears `wanted`.
    ///
    /// # Safety
    /// As for [`Self::new`].
    unsafe fn marked(compensator: *const Compensator, wanted: u64) -> Result<Self, Status> {
        let compensator = checked(compensator)?;
        // The mark first: what is no compensator must not be read as one, nor written to.
        // SAFETY: not null, aligned; the rest by contract. Only ever used as an atomic.
        let mark = unsafe { &*compensator.cast::<AtomicU64>() };
        if !matches!(mark.load(Ordering::Relaxed), MARK | BUSY | LOST) {
            return Err(Status::NotACompensator);
        }
        match mark.compare_exchange(wanted, BUSY, Ordering::Acquire, Ordering::Relaxed) {
            // SAFETY: it bears the mark of a compensator, which nobody else writes.
            Ok(_) => Ok(Self { content: unsafe { &(*compensator).content }, whole: true }),
            Err(BUSY) => Err(Status::StateBusy),
            Err(LOST) => Err(Status::Internal),
            Err(_) => Err(Status::NotACompensator),
        }
    }

    /// What `body` returns for the observer.
    fn with<T>(&mut self, body: impl FnOnce(&mut compensate::Compensator) -> T) -> T {
        self.whole = false;
        // SAFETY: whoever has taken it is alone with it, and `self` is borrowed for as long.
        let estimate = body(unsafe { &mut *self.content.observer.get() });
        self.whole = true;
        estimate
    }
}

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        self.content.mark.store(if self.whole { MARK } else { LOST }, Ordering::Release);
    }
}

/// Fills options with what trocar_compensator_new() takes for NULL: all as in the model file, with adaptation.
/// struct_size is sizeof *options.
///
/// Refuses: TROCAR_STATUS_OUT_OF_RANGE where the library knows a struct of another size; it then writes nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_compensator_options_init(
    options: *mut CompensatorOptions,
    struct_size: usize,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let mut place = unsafe { OutPointer::new(options) }?;
        if struct_size != size_of::<CompensatorOptions>() {
            return Err(Status::OutOfRange);
        }
        place.set(CompensatorOptions::DEFAULT);
        Ok(())
    })
}

/// Makes a compensator for model and gives it to *compensator; NULL where it is refused. options may be NULL. The model
/// may be freed afterwards. It starts with the first sample. Give it back with trocar_compensator_free(). Allocates;
/// message as for trocar_model_load().
///
/// Refuses: TROCAR_STATUS_OUT_OF_RANGE for an option, TROCAR_STATUS_UNSUPPORTED where neither the model file nor
/// force_error_n states how far off the model's force is, and where neither the model file nor flip_force states the sign.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_compensator_new(
    model: *const Model,
    options: *const CompensatorOptions,
    compensator: *mut *mut Compensator,
    message: *mut c_char,
    message_size: usize,
) -> Status {
    // SAFETY: by the rule of the crate.
    let message = unsafe { Message::new(message, message_size) };
    message.report(|| {
        // SAFETY: by the rule of the crate.
        let mut place = unsafe { OutPointer::new(compensator) }?;
        place.set(std::ptr::null_mut());
        // SAFETY: by the rule of the crate.
        let (model, options) =
            unsafe { (Model::borrowed(model)?, CompensatorOptions::read(options)?) };
        let seal = *model.trocar.seal();
        let observer =
            compensate::Compensator::with_seal(&model.file, seal, &options).map_err(refused)?;
        let content = Content { mark: AtomicU64::new(MARK), observer: UnsafeCell::new(observer) };
        place.set(Box::into_raw(Box::new(Compensator { content })));
        Ok(())
    })
}

/// Frees a compensator; NULL is allowed. No thread may use it later.
///
/// Refuses: TROCAR_STATUS_NOT_A_COMPENSATOR, TROCAR_STATUS_STATE_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_compensator_free(compensator: *mut Compensator) -> Status {
    guarded(|| {
        if compensator.is_null() {
            return Ok(());
        }
        // SAFETY: by the rule of the crate.
        let taken = match unsafe { Taken::new(compensator) } {
            // SAFETY: by the rule of the crate.
            Err(Status::Internal) => unsafe { Taken::marked(compensator, LOST) },
            other => other,
        }?;
        // For whoever frees twice. Atomic writes are not dropped.
        taken.content.mark.store(0, Ordering::Release);
        std::mem::forget(taken);
        // SAFETY: it bore the mark of a compensator, all of which come from `Box::into_raw`, and nobody uses it.
        drop(unsafe { Box::from_raw(compensator) });
        Ok(())
    })
}

/// Takes the next sample: instrument at position_m (m, positive is insertion), reading force_n (N) with the sign that the
/// sensor gives it (see flip_force of the options), duration_s (s) after the last one; the first sample starts, whatever its
/// duration. No allocation, bounded work.
///
/// Any number is accepted, also NaN: see the fault in *estimate. If the call is refused, *estimate has no tissue force
/// (NaN) and a trocar force of 0.
///
/// Refuses: TROCAR_STATUS_NOT_A_COMPENSATOR, TROCAR_STATUS_STATE_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_compensator_step(
    compensator: *mut Compensator,
    position_m: f64,
    force_n: f64,
    duration_s: f64,
    estimate: *mut Estimate,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let mut place = unsafe { OutPointer::new(estimate) }?;
        place.set(Estimate::NONE);
        // SAFETY: by the rule of the crate.
        let mut taken = unsafe { Taken::new(compensator) }?;
        place.set(taken.with(|observer| observer.step(position_m, force_n, duration_s)).into());
        Ok(())
    })
}

/// The same where the instrument is at angle_rad (rad), with the torque of the instrument on the seal (N·m) in *torque_n_m, 0
/// if the call is refused. trocar_compensator_step() leaves the angle as it is.
///
/// Refuses: as trocar_compensator_step(), and TROCAR_STATUS_UNSUPPORTED for a model without rotation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_compensator_turn(
    compensator: *mut Compensator,
    position_m: f64,
    angle_rad: f64,
    force_n: f64,
    duration_s: f64,
    estimate: *mut Estimate,
    torque_n_m: *mut f64,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (mut place, mut torque) =
            unsafe { (OutPointer::new(estimate)?, OutPointer::new(torque_n_m)?) };
        place.set(Estimate::NONE);
        torque.set(0.0);
        // SAFETY: by the rule of the crate.
        let found = unsafe { Taken::new(compensator) }?.with(|observer| {
            let turns = observer.turns();
            turns.then(|| observer.turn(position_m, angle_rad, force_n, duration_s))
        });
        let found = found.ok_or(Status::Unsupported)?;
        place.set(found.into());
        torque.set(found.trocar_torque);
        Ok(())
    })
}

/// Where friction and viscosity stand.
///
/// Refuses: TROCAR_STATUS_NOT_A_COMPENSATOR, TROCAR_STATUS_STATE_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_compensator_drift(
    compensator: *const Compensator,
    drift: *mut Drift,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (mut taken, mut place) = unsafe { (Taken::new(compensator)?, OutPointer::new(drift)?) };
        let compensate::Drift { level, viscosity, level_std, viscosity_std } =
            taken.with(|observer| observer.drift());
        place.set(Drift { level, viscosity, level_std, viscosity_std });
        Ok(())
    })
}

/// Forgets all samples: the compensator is as new and starts with the next one. No allocation.
///
/// Refuses: TROCAR_STATUS_NOT_A_COMPENSATOR, TROCAR_STATUS_STATE_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_compensator_reset(compensator: *mut Compensator) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        unsafe { Taken::new(compensator) }?.with(compensate::Compensator::reset);
        Ok(())
    })
}

/// What a fault means, in English. Lives as long as the program. Never fails: a number that is no fault is called
/// "unknown fault".
#[unsafe(no_mangle)]
pub extern "C" fn trocar_fault_message(fault: i32) -> *const c_char {
    let known = Fault::ALL.iter().find(|(known, _)| *known as i32 == fault);
    known.map_or(c"unknown fault", |(_, text)| text).as_ptr()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_panic_a_compensator_is_lost_and_can_be_freed() {
        let file = trocar_runtime::model_file::ModelFile::plausible_10_5_mm().unwrap();
        let options =
            CompensateOptions { force_error_n: Some(0.1), ..CompensateOptions::default() };
        let observer = compensate::Compensator::new(&file, &options).unwrap();
        let content = Content { mark: AtomicU64::new(MARK), observer: UnsafeCell::new(observer) };
        let own = Box::into_raw(Box::new(Compensator { content }));
        let mut estimate = Estimate::NONE;
        // SAFETY: a live compensator of this thread alone.
        let mut step =
            || unsafe { trocar_compensator_step(own, 0.1, 0.0, 1e-3, &raw mut estimate) };
        assert_eq!(step(), Status::Ok);
        // SAFETY: the same.
        let panics =
            guarded(|| unsafe { Taken::new(own) }?.with(|_| panic!("a defect, on purpose")));
        assert_eq!(panics, Status::Internal);
        assert_eq!((step(), step()), (Status::Internal, Status::Internal));
        assert!(estimate.tissue_force_n.is_nan());
        // SAFETY: the same; freed last.
        let ends = unsafe { (trocar_compensator_reset(own), trocar_compensator_free(own)) };
        assert_eq!(ends, (Status::Internal, Status::Ok));
    }

    #[test]
    fn faults_are_those_of_rust_in_its_words() {
        assert_eq!(Fault::ALL.len(), compensate::Fault::ALL.len() + 1);
        for fault in compensate::Fault::ALL {
            let number = Fault::from(Some(fault)) as usize;
            assert_eq!(Fault::ALL[number].1.to_str(), Ok(fault.words()));
        }
        assert!(
            Fault::ALL.iter().enumerate().all(|(number, (fault, _))| *fault as usize == number)
        );
    }
}
