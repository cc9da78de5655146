//! The functions of FMI 3.0 for co-simulation, as importers call them.
//!
//! A C `bool` is passed as one byte; every value except 0 is true.
#![allow(unsafe_code)]
#![allow(non_snake_case, reason = "names of the standard")]
#![allow(clippy::missing_safety_doc, reason = "the contract of every function is that of FMI 3.0")]

use std::ffi::{c_char, c_int, c_void};
use std::path::Path;

use crate::error::FmuError;
use crate::ffi::{
    self, Logger, Logger3, Room, Status, functions, no_variables, paired, unsupported,
};
use crate::instance::{Instance, Type};

const FLOAT: Type = Type { name: "Float64", is_mode: false };
const ENUMERATION: Type = Type { name: "Int64 or Enumeration", is_mode: true };

/// Version of FMI.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Creates an instance; null and a message if that fails.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: u8,
    _logging: u8,
    event_mode: u8,
    _early_return: u8,
    _required: *const u32,
    _required_count: usize,
    environment: *mut c_void,
    callback: Option<Logger3>,
    _intermediate: *const c_void,
) -> *mut c_void {
    ffi::instantiate("fmi3InstantiateCoSimulation", Logger::Fmi3 { callback, environment }, || {
        // SAFETY: null or C strings, as FMI requires.
        let (_, token, resources) = unsafe {
            (
                ffi::text(name, "the instance name")?,
                ffi::text(token, "the token")?,
                ffi::text(resources, "the resources")?,
            )
        };
        if event_mode != 0 {
            return Err(FmuError::unsupported("this FMU has no event mode"));
        }
        Instance::new(Path::new(resources), token)
    })
}

/// Fails: this FMU supports co-simulation only.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateModelExchange(
    _name: *const c_char,
    _token: *const c_char,
    _resources: *const c_char,
    _visible: u8,
    _logging: u8,
    environment: *mut c_void,
    callback: Option<Logger3>,
) -> *mut c_void {
    ffi::instantiate("fmi3InstantiateModelExchange", Logger::Fmi3 { callback, environment }, || {
        Err(FmuError::unsupported("this FMU is for co-simulation only"))
    })
}

/// Fails: this FMU supports co-simulation only.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateScheduledExecution(
    _name: *const c_char,
    _token: *const c_char,
    _resources: *const c_char,
    _visible: u8,
    _logging: u8,
    environment: *mut c_void,
    callback: Option<Logger3>,
    _clock_update: *const c_void,
    _lock: *const c_void,
    _unlock: *const c_void,
) -> *mut c_void {
    ffi::instantiate(
        "fmi3InstantiateScheduledExecution",
        Logger::Fmi3 { callback, environment },
        || Err(FmuError::unsupported("this FMU is for co-simulation only")),
    )
}

functions! {
    /// Sets start and stop time (s) and enters initialization mode; the tolerance is not used.
    fmi3EnterInitializationMode = (_: u8, _: f64, start: f64, has_stop: u8, stop: f64) |c| {
        c.instance.set_time(start, (has_stop != 0).then_some(stop))?;
        c.instance.enter_initialization().map(|()| Status::Ok)
    }

    /// Leaves initialization mode; warns if the seal cannot hold the requested force or deflection.
    fmi3ExitInitializationMode = () |c| { c.exit_initialization("fmi3ExitInitializationMode") }

    /// Checks the categories; errors and warnings are always logged.
    fmi3SetDebugLogging = (_: u8, count: usize, names: *const *const c_char) |_| {
        ffi::categories(names, count)
    }

    /// Reads real variables.
    fmi3GetFloat64 = (vr: *const u32, count: usize, out: *mut f64, out_count: usize) |c| {
        paired(count, out_count)?;
        ffi::get(c, vr, count, (out, |value| value), FLOAT)
    }

    /// Reads enumeration variables: the mode.
    fmi3GetInt64 = (vr: *const u32, count: usize, out: *mut i64, out_count: usize) |c| {
        paired(count, out_count)?;
        ffi::get(c, vr, count, (out, |value| value as i64), ENUMERATION)
    }

    /// Sets all given real variables or none.
    fmi3SetFloat64 = (vr: *const u32, count: usize, new: *const f64, new_count: usize) |c| {
        paired(count, new_count)?;
        ffi::set(c, vr, count, (new, |value| value), FLOAT)
    }

    /// No enumeration variable can be set.
    fmi3SetInt64 = (vr: *const u32, count: usize, new: *const i64, new_count: usize) |c| {
        paired(count, new_count)?;
        ffi::set(c, vr, count, (new, |value| value as f64), ENUMERATION)
    }

    /// Advances by one communication step, s.
    fmi3DoStep = (
        point: f64, size: f64, _: u8, event: *mut bool, terminate: *mut bool, early: *mut bool, last_time: *mut f64
    ) |c| {
        let name = "a result";
        let flags =
            [Room::new(event, 1, name)?, Room::new(terminate, 1, name)?, Room::new(early, 1, name)?];
        let mut time = Room::new(last_time, 1, name)?;
        let outcome = c.instance.step(point, size);
        flags.into_iter().for_each(|mut flag| flag.put(0, false));
        time.put(0, c.instance.time());
        outcome.map(|()| Status::Ok)
    }
}

no_variables! {
    fmi3GetFloat32(*mut f32, usize): "Float32";
    fmi3GetInt8(*mut i8, usize): "Int8";
    fmi3GetUInt8(*mut u8, usize): "UInt8";
    fmi3GetInt16(*mut i16, usize): "Int16";
    fmi3GetUInt16(*mut u16, usize): "UInt16";
    fmi3GetInt32(*mut i32, usize): "Int32";
    fmi3GetUInt32(*mut u32, usize): "UInt32";
    fmi3GetUInt64(*mut u64, usize): "UInt64";
    fmi3GetBoolean(*mut bool, usize): "Boolean";
    fmi3GetString(*mut *const c_char, usize): "String";
    fmi3GetBinary(*mut usize, *mut *const u8, usize): "Binary";
    fmi3GetClock(*mut bool): "Clock";
    fmi3SetFloat32(*const f32, usize): "Float32";
    fmi3SetInt8(*const i8, usize): "Int8";
    fmi3SetUInt8(*const u8, usize): "UInt8";
    fmi3SetInt16(*const i16, usize): "Int16";
    fmi3SetUInt16(*const u16, usize): "UInt16";
    fmi3SetInt32(*const i32, usize): "Int32";
    fmi3SetUInt32(*const u32, usize): "UInt32";
    fmi3SetUInt64(*const u64, usize): "UInt64";
    fmi3SetBoolean(*const bool, usize): "Boolean";
    fmi3SetString(*const *const c_char, usize): "String";
    fmi3SetBinary(*const usize, *const *const u8, usize): "Binary";
    fmi3SetClock(*const bool): "Clock";
    fmi3GetIntervalDecimal(*mut f64, *mut c_int): "Clock";
    fmi3GetIntervalFraction(*mut u64, *mut u64, *mut c_int): "Clock";
    fmi3GetShiftDecimal(*mut f64): "Clock";
    fmi3GetShiftFraction(*mut u64, *mut u64): "Clock";
    fmi3SetIntervalDecimal(*const f64): "Clock";
    fmi3SetIntervalFraction(*const u64, *const u64): "Clock";
    fmi3SetShiftDecimal(*const f64): "Clock";
    fmi3SetShiftFraction(*const u64, *const u64): "Clock";
}

unsupported! {
    fmi3EnterStepMode(): "this FMU has no event mode";
    fmi3EnterEventMode(): "this FMU has no event mode";
    fmi3EvaluateDiscreteStates(): "this FMU has no event mode";
    fmi3UpdateDiscreteStates(*mut bool, *mut bool, *mut bool, *mut bool, *mut bool, *mut f64):
        "this FMU has no event mode";
    fmi3EnterConfigurationMode(): "there are no structural parameters";
    fmi3ExitConfigurationMode(): "there are no structural parameters";
    fmi3GetNumberOfVariableDependencies(u32, *mut usize): "there are no arrays";
    fmi3GetVariableDependencies(u32, *mut usize, *mut u32, *mut usize, *mut c_int, usize): "there are no arrays";
    fmi3GetDirectionalDerivative(*const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize):
        "there are no derivatives";
    fmi3GetAdjointDerivative(*const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize):
        "there are no derivatives";
    fmi3GetOutputDerivatives(*const u32, usize, *const c_int, *mut f64, usize): "there are no derivatives";
    fmi3EnterContinuousTimeMode(): "this FMU is for co-simulation only";
    fmi3CompletedIntegratorStep(u8, *mut bool, *mut bool): "this FMU is for co-simulation only";
    fmi3SetTime(f64): "this FMU is for co-simulation only";
    fmi3SetContinuousStates(*const f64, usize): "this FMU is for co-simulation only";
    fmi3GetContinuousStates(*mut f64, usize): "this FMU is for co-simulation only";
    fmi3GetContinuousStateDerivatives(*mut f64, usize): "this FMU is for co-simulation only";
    fmi3GetNominalsOfContinuousStates(*mut f64, usize): "this FMU is for co-simulation only";
    fmi3GetNumberOfContinuousStates(*mut usize): "this FMU is for co-simulation only";
    fmi3GetEventIndicators(*mut f64, usize): "this FMU is for co-simulation only";
    fmi3GetNumberOfEventIndicators(*mut usize): "this FMU is for co-simulation only";
    fmi3ActivateModelPartition(u32, f64): "this FMU is for co-simulation only";
}
