//! Trocar seals for programs in C and C++: the functions of `include/trocar.h`.
//!
//! The header is made from this crate and states for each function what it takes, gives and may refuse; `docs/reference/c-and-cpp.md`
//! shows how to build and link. Everything runs the one step of `trocar-model`, so the forces are the same to the last bit.
//!
//! # Safety
//! A pointer that is null or misaligned is refused. Any other must point to a value of its type, for as long as the call
//! lasts; a model, until it is freed. That much no library can check.
//!
//! # Where this departs from what one might expect
//!
//! - **A state is numbers, not a copy of the Rust value.** C owns that memory and may hand over any bytes. Some bytes are
//!   no Rust enum, and to read them as one would be undefined; any bytes are numbers, and numbers can be checked. A step
//!   therefore reads and writes [`STATE_NUMBERS`] of them, some 80 ns. [`trocar_simulate`] does so once for a whole array.
//! - **The mark of a state is also its lock.** Two threads stepping one state is a mistake of the caller; it is reported
//!   ([`Status::StateBusy`]) instead of mixing two steps. All words of a state are read and written as atomics, so even
//!   that mistake is defined.
//! - **A compensator is the library's, behind a pointer.** It remembers a thousand crossings of places, some 140 kB; nobody
//!   wants that on the stack of a loop.
//! - **No thread-local last error.** A long message goes to the buffer of the caller.

mod compensator;
mod message;
mod model;
mod pointer;
mod state;
mod status;
mod step;

pub use compensator::*;
pub use model::*;
pub use state::*;
pub use status::*;
pub use step::*;

use std::ffi::{CStr, c_char};

/// Version of this interface: of its functions, their meaning, and the layout of a state and of all structs. Programs
/// compiled for one version must not run with a library of another; compare with trocar_abi_version().
pub const ABI_VERSION: u32 = 5;

const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");

/// Version of the interface that the library was built with: TROCAR_ABI_VERSION of its header. Never fails.
#[unsafe(no_mangle)]
pub extern "C" fn trocar_abi_version() -> u32 {
    ABI_VERSION
}

/// Version of the library, such as "0.1.0". Lives as long as the program. Never fails.
#[unsafe(no_mangle)]
pub extern "C" fn trocar_version() -> *const c_char {
    CStr::from_bytes_with_nul(VERSION.as_bytes()).map_or(c"".as_ptr(), CStr::as_ptr)
}
