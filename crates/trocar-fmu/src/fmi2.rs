//! The functions of FMI 2.0 for co-simulation, as importers call them.
#![allow(unsafe_code)]
#![allow(non_snake_case, reason = "names of the standard")]
#![allow(clippy::missing_safety_doc, reason = "the contract of every function is that of FMI 2.0")]

use std::ffi::{CStr, CString, c_char, c_int, c_void};

use crate::error::FmuError;
use crate::ffi::{self, Logger, Logger2, Room, Status, call, unsupported, values};
use crate::instance::Instance;
use crate::resource::folder_of_uri;

/// `fmi2CallbackFunctions`.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Callbacks {
    /// Receives messages.
    pub logger: Option<Logger2>,
    /// Not used.
    pub allocate_memory: *const c_void,
    /// Not used.
    pub free_memory: *const c_void,
    /// Not used.
    pub step_finished: *const c_void,
    /// First argument of the logger.
    pub environment: *mut c_void,
}

const REAL: &str = "Real";
const INTEGER: &str = "Integer or Enumeration";
/// `fmi2CoSimulation`.
const CO_SIMULATION: c_int = 1;
/// `fmi2LastSuccessfulTime`.
const LAST_TIME: c_int = 2;
/// `fmi2Terminated`.
const TERMINATED: c_int = 3;
const REFERENCES: &str = "value references";
const VALUES: &str = "values";

/// Name of the platform types.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

/// Version of FMI.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// Checks the categories; errors and warnings are always logged.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetDebugLogging(
    handle: *mut c_void,
    _on: c_int,
    count: usize,
    names: *const *const c_char,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2SetDebugLogging", |_| ffi::categories(names, count)) }
}

/// Creates an instance; null and a message if that fails.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_int,
    guid: *const c_char,
    resources: *const c_char,
    callbacks: *const Callbacks,
    _visible: c_int,
    _logging: c_int,
) -> *mut c_void {
    // SAFETY: null or valid, as FMI requires. Without callbacks no message can be sent.
    let Some(callbacks) = (unsafe { callbacks.as_ref() }) else { return std::ptr::null_mut() };
    // SAFETY: null or a C string, as FMI requires.
    let named = (!name.is_null()).then(|| unsafe { CStr::from_ptr(name) }.to_owned());
    let (callback, environment) = (callbacks.logger, callbacks.environment);
    let logger =
        Logger::Fmi2 { callback, environment, name: named.unwrap_or_else(|| CString::from(c"")) };
    ffi::instantiate("fmi2Instantiate", logger, || {
        // SAFETY: null or C strings, as FMI requires.
        let (_, guid, resources) = unsafe {
            (
                ffi::text(name, "the instance name")?,
                ffi::text(guid, "the GUID")?,
                ffi::text(resources, "the resources")?,
            )
        };
        if kind != CO_SIMULATION {
            return Err(FmuError::Unsupported { why: "this FMU is for co-simulation only" });
        }
        Instance::new(&folder_of_uri(resources)?, guid)
    })
}

/// Frees an instance; null is ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(handle: *mut c_void) {
    // SAFETY: handle as FMI requires.
    unsafe { ffi::free(handle) }
}

/// Sets start and stop time, s; the tolerance is not used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetupExperiment(
    handle: *mut c_void,
    _has_tolerance: c_int,
    _tolerance: f64,
    start: f64,
    has_stop: c_int,
    stop: f64,
) -> c_int {
    let stop = (has_stop != 0).then_some(stop);
    // SAFETY: handle as FMI requires.
    unsafe {
        call(handle, "fmi2SetupExperiment", |c| {
            c.instance.set_time(start, stop).map(|()| Status::Ok)
        })
    }
}

/// Enters initialization mode.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2EnterInitializationMode(handle: *mut c_void) -> c_int {
    const NAME: &str = "fmi2EnterInitializationMode";
    // SAFETY: handle as FMI requires.
    unsafe { call(handle, NAME, |c| c.instance.enter_initialization().map(|()| Status::Ok)) }
}

/// Leaves initialization mode; warns if the seal cannot hold the requested force or deflection.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2ExitInitializationMode(handle: *mut c_void) -> c_int {
    const NAME: &str = "fmi2ExitInitializationMode";
    // SAFETY: handle as FMI requires.
    unsafe {
        call(handle, NAME, |c| {
            let remark = c.instance.exit_initialization()?;
            Ok(remark.map_or(Status::Ok, |remark| c.remark(NAME, remark)))
        })
    }
}

/// Ends the simulation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Terminate(handle: *mut c_void) -> c_int {
    // SAFETY: handle as FMI requires.
    unsafe { call(handle, "fmi2Terminate", |c| c.instance.terminate().map(|()| Status::Ok)) }
}

/// Returns to instantiation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Reset(handle: *mut c_void) -> c_int {
    let reset = |c: &mut ffi::Component| {
        c.instance.reset();
        Ok(Status::Ok)
    };
    // SAFETY: handle as FMI requires.
    unsafe { call(handle, "fmi2Reset", reset) }
}

/// Reads real variables.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetReal(
    handle: *mut c_void,
    vr: *const u32,
    count: usize,
    out: *mut f64,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe {
        call(handle, "fmi2GetReal", |c| {
            let (vr, mut room) = (values(vr, count, REFERENCES)?, Room::new(out, count, VALUES)?);
            c.instance
                .get_reals(vr, REAL, |place, value| room.put(place, value))
                .map(|()| Status::Ok)
        })
    }
}

/// Reads integer and enumeration variables: the mode.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetInteger(
    handle: *mut c_void,
    vr: *const u32,
    count: usize,
    out: *mut c_int,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe {
        call(handle, "fmi2GetInteger", |c| {
            let (vr, mut room) = (values(vr, count, REFERENCES)?, Room::new(out, count, VALUES)?);
            c.instance
                .get_integers(vr, INTEGER, |place, value| room.put(place, value as c_int))
                .map(|()| Status::Ok)
        })
    }
}

/// There are no boolean variables.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetBoolean(
    handle: *mut c_void,
    vr: *const u32,
    count: usize,
    _: *mut c_int,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2GetBoolean", |_| ffi::none_of(vr, count, "Boolean")) }
}

/// There are no string variables.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetString(
    handle: *mut c_void,
    vr: *const u32,
    count: usize,
    _: *mut *const c_char,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2GetString", |_| ffi::none_of(vr, count, "String")) }
}

/// Sets all given real variables or none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetReal(
    handle: *mut c_void,
    vr: *const u32,
    count: usize,
    new: *const f64,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe {
        call(handle, "fmi2SetReal", |c| {
            let (vr, new) = (values(vr, count, REFERENCES)?, values(new, count, VALUES)?);
            c.instance.set_reals(vr, new, REAL).map(|()| Status::Ok)
        })
    }
}

/// No integer or enumeration variable can be set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetInteger(
    handle: *mut c_void,
    vr: *const u32,
    count: usize,
    _: *const c_int,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe {
        call(handle, "fmi2SetInteger", |c| {
            c.instance.set_integers(values(vr, count, REFERENCES)?, INTEGER).map(|()| Status::Ok)
        })
    }
}

/// There are no boolean variables.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetBoolean(
    handle: *mut c_void,
    vr: *const u32,
    count: usize,
    _: *const c_int,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2SetBoolean", |_| ffi::none_of(vr, count, "Boolean")) }
}

/// There are no string variables.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetString(
    handle: *mut c_void,
    vr: *const u32,
    count: usize,
    _: *const *const c_char,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2SetString", |_| ffi::none_of(vr, count, "String")) }
}

/// Stores the present state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetFMUstate(handle: *mut c_void, slot: *mut *mut c_void) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2GetFMUstate", |c| ffi::get_state(c, slot)) }
}

/// Restores a state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetFMUstate(handle: *mut c_void, state: *mut c_void) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe {
        call(handle, "fmi2SetFMUstate", |c| {
            c.instance.set_state(ffi::state_at(state)?).map(|()| Status::Ok)
        })
    }
}

/// Frees a state; null is ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeFMUstate(handle: *mut c_void, slot: *mut *mut c_void) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2FreeFMUstate", |_| ffi::free_state(slot)) }
}

/// Size of a serialized state in bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SerializedFMUstateSize(
    handle: *mut c_void,
    state: *mut c_void,
    size: *mut usize,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2SerializedFMUstateSize", |c| ffi::state_size(c, state, size)) }
}

/// Serializes a state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SerializeFMUstate(
    handle: *mut c_void,
    state: *mut c_void,
    bytes: *mut u8,
    size: usize,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2SerializeFMUstate", |_| ffi::serialise(state, bytes, size)) }
}

/// Restores a state from its bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DeSerializeFMUstate(
    handle: *mut c_void,
    bytes: *const u8,
    size: usize,
    slot: *mut *mut c_void,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe { call(handle, "fmi2DeSerializeFMUstate", |c| ffi::deserialise(c, bytes, size, slot)) }
}

/// Advances by one communication step, s.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DoStep(
    handle: *mut c_void,
    point: f64,
    size: f64,
    _keeps_past: c_int,
) -> c_int {
    // SAFETY: handle as FMI requires.
    unsafe { call(handle, "fmi2DoStep", |c| c.instance.step(point, size).map(|()| Status::Ok)) }
}

/// The time of the last step; no other status of this type exists.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetRealStatus(
    handle: *mut c_void,
    kind: c_int,
    out: *mut f64,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe {
        call(handle, "fmi2GetRealStatus", |c| {
            if kind != LAST_TIME {
                return Err(FmuError::Unsupported {
                    why: "the only real status is fmi2LastSuccessfulTime",
                });
            }
            Room::new(out, 1, "the status")?.put(0, c.instance.time());
            Ok(Status::Ok)
        })
    }
}

/// Whether the FMU requests the end of the simulation: never. No other status of this type exists.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetBooleanStatus(
    handle: *mut c_void,
    kind: c_int,
    out: *mut c_int,
) -> c_int {
    // SAFETY: pointers as FMI requires.
    unsafe {
        call(handle, "fmi2GetBooleanStatus", |_| {
            if kind != TERMINATED {
                return Err(FmuError::Unsupported {
                    why: "the only boolean status is fmi2Terminated",
                });
            }
            Room::new(out, 1, "the status")?.put(0, 0);
            Ok(Status::Ok)
        })
    }
}

unsupported! {
    fmi2GetStatus(c_int, *mut c_int): "no step is ever pending";
    fmi2GetIntegerStatus(c_int, *mut c_int): "there is no integer status";
    fmi2GetStringStatus(c_int, *mut *const c_char): "no step is ever pending";
    fmi2CancelStep(): "no step is ever pending";
    fmi2GetDirectionalDerivative(*const u32, usize, *const u32, usize, *const f64, *mut f64): "there are no derivatives";
    fmi2SetRealInputDerivatives(*const u32, usize, *const c_int, *const f64): "inputs are not interpolated";
    fmi2GetRealOutputDerivatives(*const u32, usize, *const c_int, *mut f64): "there are no derivatives";
    fmi2EnterEventMode(): "this FMU is for co-simulation only";
    fmi2NewDiscreteStates(*mut c_void): "this FMU is for co-simulation only";
    fmi2EnterContinuousTimeMode(): "this FMU is for co-simulation only";
    fmi2CompletedIntegratorStep(c_int, *mut c_int, *mut c_int): "this FMU is for co-simulation only";
    fmi2SetTime(f64): "this FMU is for co-simulation only";
    fmi2SetContinuousStates(*const f64, usize): "this FMU is for co-simulation only";
    fmi2GetContinuousStates(*mut f64, usize): "this FMU is for co-simulation only";
    fmi2GetDerivatives(*mut f64, usize): "this FMU is for co-simulation only";
    fmi2GetEventIndicators(*mut f64, usize): "this FMU is for co-simulation only";
    fmi2GetNominalsOfContinuousStates(*mut f64, usize): "this FMU is for co-simulation only";
}
