//! What the page calls.
#![allow(unsafe_code)] // exported names, and the one page of the module

use core::cell::UnsafeCell;

use crate::{BLOCK, Memory, Page, ROW, TEXT};

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
extern "C" fn text() -> *mut u8 {
    with(|_, memory| memory.text.as_mut_ptr())
}

#[unsafe(no_mangle)]
extern "C" fn text_length() -> usize {
    TEXT
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
extern "C" fn block() -> *mut f64 {
    with(|_, memory| memory.block.as_mut_ptr().cast())
}

#[unsafe(no_mangle)]
extern "C" fn block_length() -> usize {
    BLOCK
}

#[unsafe(no_mangle)]
extern "C" fn start(length: usize, trocar: usize, compensator: usize, position: f64) -> bool {
    with(|page, memory| page.start(memory, length, [trocar, compensator], position))
}

#[unsafe(no_mangle)]
extern "C" fn message() -> usize {
    with(|page, _| page.message())
}

#[unsafe(no_mangle)]
extern "C" fn run(count: usize) -> usize {
    with(|page, memory| page.run(memory, count))
}

#[unsafe(no_mangle)]
extern "C" fn settles() -> bool {
    with(|page, _| page.settles())
}

#[unsafe(no_mangle)]
extern "C" fn figures() -> usize {
    with(|page, memory| page.figures(memory))
}
