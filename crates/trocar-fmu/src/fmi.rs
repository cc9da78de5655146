//! The functions that FMI 2.0 and FMI 3.0 have in common, each under both names.
#![allow(unsafe_code)]
#![allow(non_snake_case, reason = "names of the standard")]
#![allow(clippy::missing_safety_doc, reason = "the contract of every function is that of FMI")]

use std::ffi::{c_int, c_void};

use crate::ffi::{self, Status, functions};

functions! {
    /// Ends the simulation.
    fmi2Terminate, fmi3Terminate = () |c| { c.instance.terminate().map(|()| Status::Ok) }

    /// Returns to instantiation.
    fmi2Reset, fmi3Reset = () |c| {
        c.instance.reset();
        Ok(Status::Ok)
    }

    /// Stores the present state.
    fmi2GetFMUstate, fmi3GetFMUState = (slot: *mut *mut c_void) |c| { ffi::get_state(c, slot) }

    /// Restores a state.
    fmi2SetFMUstate, fmi3SetFMUState = (state: *mut c_void) |c| {
        c.instance.set_state(ffi::state_at(state)?).map(|()| Status::Ok)
    }

    /// Frees a state; null is ignored.
    fmi2FreeFMUstate, fmi3FreeFMUState = (slot: *mut *mut c_void) |_| { ffi::free_state(slot) }

    /// Size of a serialized state in bytes.
    fmi2SerializedFMUstateSize, fmi3SerializedFMUStateSize = (state: *mut c_void, size: *mut usize) |c| {
        ffi::state_size(c, state, size)
    }

    /// Serializes a state.
    fmi2SerializeFMUstate, fmi3SerializeFMUState = (state: *mut c_void, bytes: *mut u8, size: usize) |_| {
        ffi::serialise(state, bytes, size)
    }

    /// Restores a state from its bytes.
    fmi2DeSerializeFMUstate, fmi3DeserializeFMUState = (bytes: *const u8, size: usize, slot: *mut *mut c_void) |c| {
        ffi::deserialise(c, bytes, size, slot)
    }
}

/// Frees an instance; null is ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(handle: *mut c_void) {
    // SAFETY: handle as FMI requires.
    unsafe { ffi::free(handle) }
}

/// Frees an instance; null is ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(handle: *mut c_void) {
    // SAFETY: handle as FMI requires.
    unsafe { ffi::free(handle) }
}
