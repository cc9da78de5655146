//! Pointers from C: checked once, then safe to use.
//!
//! Callers' memory is never turned into a reference, so what a caller lets overlap stays defined: an array of forces may
//! be the array of positions.

use std::ffi::{CStr, c_char};
use std::marker::PhantomData;

use crate::status::Status;

/// `pointer`, where it is neither null nor misaligned.
pub(crate) fn checked<T>(pointer: *const T) -> Result<*const T, Status> {
    match pointer {
        p if p.is_null() => Err(Status::NullPointer),
        p if !p.is_aligned() => Err(Status::Misaligned),
        p => Ok(p),
    }
}

/// A place of C for one result.
pub(crate) struct OutPointer<'a, T>(*mut T, PhantomData<&'a mut T>);

impl<T: Copy> OutPointer<'_, T> {
    /// # Safety
    /// `pointer` must be null or misaligned, or stay writable as long as the place is used.
    pub(crate) unsafe fn new(pointer: *mut T) -> Result<Self, Status> {
        checked(pointer).map(|_| Self(pointer, PhantomData))
    }

    pub(crate) fn set(&mut self, value: T) {
        // SAFETY: checked by `new`, writable by its contract.
        unsafe { self.0.write(value) }
    }
}

/// An array of C.
pub(crate) struct Array<'a, T> {
    first: *mut T,
    count: usize,
    borrowed: PhantomData<&'a mut T>,
}

impl<T: Copy> Array<'_, T> {
    /// An array to read from; `first` is not checked where `count` is 0.
    ///
    /// # Safety
    /// `first` must be null or misaligned, or point to `count` values as long as the array is used.
    pub(crate) unsafe fn new(first: *const T, count: usize) -> Result<Self, Status> {
        if count > isize::MAX as usize / size_of::<T>() {
            return Err(Status::OutOfRange);
        }
        if count > 0 {
            checked(first)?;
        }
        Ok(Self { first: first.cast_mut(), count, borrowed: PhantomData })
    }

    pub(crate) fn get(&self, index: usize) -> Option<T> {
        // SAFETY: below `count`; checked by `new`, readable by its contract.
        (index < self.count).then(|| unsafe { self.first.add(index).read() })
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = T> + '_ {
        (0..self.count).filter_map(|index| self.get(index))
    }
}

/// The same to write to.
pub(crate) struct ArrayMut<'a, T>(Array<'a, T>);

impl<T: Copy> ArrayMut<'_, T> {
    /// # Safety
    /// As for [`Array::new`]; the values must be writable.
    pub(crate) unsafe fn new(first: *mut T, count: usize) -> Result<Self, Status> {
        // SAFETY: the same contract.
        unsafe { Array::new(first, count) }.map(Self)
    }

    pub(crate) fn set(&mut self, index: usize, value: T) {
        if index < self.0.count {
            // SAFETY: below `count`; checked by `new`, writable by its contract.
            unsafe { self.0.first.add(index).write(value) }
        }
    }
}

/// A text of C up to its NUL.
///
/// # Safety
/// `text` must be null, or point to bytes with a NUL among them that nobody changes during `'a`.
pub(crate) unsafe fn text<'a>(text: *const c_char) -> Result<&'a CStr, Status> {
    // SAFETY: not null; the rest is up to the caller.
    checked(text).map(|text| unsafe { CStr::from_ptr(text) })
}
