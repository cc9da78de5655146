//! What the page calls.
#![allow(unsafe_code)] // exported names, and the one page of the module

use core::cell::UnsafeCell;
use core::panic::PanicInfo;

use crate::{BLOCK, Memory, Page, ROW};
use trocar_model::tuning::MAX_TUNABLES;

struct Only<T>(UnsafeCell<T>);

// SAFETY: the module is built without threads and shares no memory.
unsafe impl<T> Sync for Only<T> {}

static MEMORY: Only<Memory> = Only(UnsafeCell::new(Memory::ZERO));
static PAGE: Only<Page> = Only(UnsafeCell::new(Page::EMPTY));

fn with<T>(call: impl FnOnce(&mut Page, &mut Memory) -> T) -> T {
    // SAFETY: the references end with the call, and no export calls another.
    call(unsafe { &mut *PAGE.0.get() }, unsafe { &mut *MEMORY.0.get() })
}

#[unsafe(no_mangle)]
extern "C" fn row() -> *mut f64 {
    with(|_, memory| memory.row.as_mut_ptr())
}

#[unsafe(no_mangle)]
extern "C" fn row_length() -> usize {
    ROW
}

#[unsafe(no_mangle)]
extern "C" fn values() -> *mut f64 {
    with(|_, memory| memory.values.as_mut_ptr())
}

#[unsafe(no_mangle)]
extern "C" fn values_length() -> usize {
    MAX_TUNABLES
}

#[unsafe(no_mangle)]
extern "C" fn block() -> *mut f64 {
    with(|_, memory| memory.block.as_mut_ptr().cast())
}

#[unsafe(no_mangle)]
extern "C" fn block_length() -> usize {
    BLOCK
}

#[unsafe(no_mangle)]
extern "C" fn load(count: usize) -> bool {
    with(|page, memory| page.load(memory, count))
}

#[unsafe(no_mangle)]
extern "C" fn tune(count: usize) -> bool {
    with(|page, memory| page.tune(memory, count))
}

#[unsafe(no_mangle)]
extern "C" fn rest(position: f64) -> f64 {
    with(|page, memory| page.rest(memory, position))
}

#[unsafe(no_mangle)]
extern "C" fn rest_at_force(position: f64, force: f64) -> f64 {
    with(|page, memory| page.rest_at_force(memory, position, force))
}

#[unsafe(no_mangle)]
extern "C" fn run(count: usize) -> usize {
    with(|page, memory| page.run(memory, count))
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    core::arch::wasm32::unreachable()
}
