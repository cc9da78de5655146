//! The functions of FMI 2.0 for co-simulation, as importers call them.
#![allow(unsafe_code)]
#![allow(non_snake_case, reason = "names of the standard")]
#![allow(clippy::missing_safety_doc, reason = "the contract of every function is that of FMI 2.0")]

use std::ffi::{CStr, CString, c_char, c_int, c_void};

use crate::error::FmuError;
use crate::ffi::{self, Logger, Logger2, Room, Status, functions, no_variables, unsupported};
use crate::instance::{Instance, Type};
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

const REAL: Type = Type { name: "Real", is_mode: false };
const INTEGER: Type = Type { name: "Integer or Enumeration", is_mode: true };
/// `fmi2CoSimulation`.
const CO_SIMULATION: c_int = 1;
/// `fmi2LastSuccessfulTime`.
const LAST_TIME: c_int = 2;
/// `fmi2Terminated`.
const TERMINATED: c_int = 3;

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
            return Err(FmuError::unsupported("this FMU is for co-simulation only"));
        }
        Instance::new(&folder_of_uri(resources)?, guid)
    })
}

functions! {
    /// Sets start and stop time, s; the tolerance is not used.
    fmi2SetupExperiment = (_: c_int, _: f64, start: f64, has_stop: c_int, stop: f64) |c| {
        c.instance.set_time(start, (has_stop != 0).then_some(stop)).map(|()| Status::Ok)
    }

    /// Enters initialization mode.
    fmi2EnterInitializationMode = () |c| { c.instance.enter_initialization().map(|()| Status::Ok) }

    /// Leaves initialization mode; warns if the seal cannot hold the requested force or deflection.
    fmi2ExitInitializationMode = () |c| { c.exit_initialization("fmi2ExitInitializationMode") }

    /// Checks the categories; errors and warnings are always logged.
    fmi2SetDebugLogging = (_: c_int, count: usize, names: *const *const c_char) |_| {
        ffi::categories(names, count)
    }

    /// Reads real variables.
    fmi2GetReal = (vr: *const u32, count: usize, out: *mut f64) |c| {
        ffi::get(c, vr, count, (out, |value| value), REAL)
    }

    /// Reads integer and enumeration variables: the mode.
    fmi2GetInteger = (vr: *const u32, count: usize, out: *mut c_int) |c| {
        ffi::get(c, vr, count, (out, |value| value as c_int), INTEGER)
    }

    /// Sets all given real variables or none.
    fmi2SetReal = (vr: *const u32, count: usize, new: *const f64) |c| {
        ffi::set(c, vr, count, (new, |value| value), REAL)
    }

    /// No integer or enumeration variable can be set.
    fmi2SetInteger = (vr: *const u32, count: usize, new: *const c_int) |c| {
        ffi::set(c, vr, count, (new, f64::from), INTEGER)
    }

    /// Advances by one communication step, s.
    fmi2DoStep = (point: f64, size: f64, _: c_int) |c| {
        c.instance.step(point, size).map(|()| Status::Ok)
    }

    /// The time of the last step; no other status of this type exists.
    fmi2GetRealStatus = (kind: c_int, out: *mut f64) |c| {
        if kind != LAST_TIME {
            return Err(FmuError::unsupported("the only real status is fmi2LastSuccessfulTime"));
        }
        Room::new(out, 1, "the status")?.put(0, c.instance.time());
        Ok(Status::Ok)
    }

    /// Whether the FMU requests the end of the simulation: never. No other status of this type exists.
    fmi2GetBooleanStatus = (kind: c_int, out: *mut c_int) |_| {
        if kind != TERMINATED {
            return Err(FmuError::unsupported("the only boolean status is fmi2Terminated"));
        }
        Room::new(out, 1, "the status")?.put(0, 0);
        Ok(Status::Ok)
    }
}

no_variables! {
    fmi2GetBoolean(*mut c_int): "Boolean";
    fmi2GetString(*mut *const c_char): "String";
    fmi2SetBoolean(*const c_int): "Boolean";
    fmi2SetString(*const *const c_char): "String";
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
