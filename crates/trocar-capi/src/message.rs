//! Long messages: text in the caller's memory.

use std::ffi::c_char;

use crate::pointer::ArrayMut;
use crate::status::{Status, guarded};

/// A place for a message; none where its pointer is null or its size 0.
pub(crate) struct Message<'a> {
    place: Option<ArrayMut<'a, c_char>>,
    size: usize,
}

impl Message<'_> {
    /// # Safety
    /// `place` must be null or point to `size` bytes that stay writable as long as the message is used.
    pub(crate) unsafe fn new(place: *mut c_char, size: usize) -> Self {
        // SAFETY: the same contract.
        let place = unsafe { ArrayMut::new(place, size) }.ok().filter(|_| size > 0);
        Self { place, size }
    }

    /// Writes `text`, cut before the first character that does not fit, and a NUL.
    fn set(&mut self, text: &str) {
        let Some(place) = &mut self.place else { return };
        let mut length = text.len().min(self.size - 1);
        while !text.is_char_boundary(length) {
            length -= 1;
        }
        let bytes = text.as_bytes().iter().take(length).take_while(|byte| **byte != 0);
        let mut end = 0;
        for byte in bytes {
            place.set(end, *byte as c_char);
            end += 1;
        }
        place.set(end, 0);
    }

    /// Runs `body` and writes its message: none on success.
    pub(crate) fn report(mut self, body: impl FnOnce() -> Result<(), Failure>) -> Status {
        let mut text = None;
        let status = guarded(|| {
            body().map_err(|failure| {
                text = failure.text;
                failure.status
            })
        });
        let plain = status.text().to_str().unwrap_or_default();
        self.set(text.as_deref().unwrap_or(if status == Status::Ok { "" } else { plain }));
        status
    }
}

/// A status and what there is to say about it.
pub(crate) struct Failure {
    status: Status,
    text: Option<String>,
}

impl Failure {
    pub(crate) fn new(status: Status, error: impl std::fmt::Display) -> Self {
        Self { status, text: Some(error.to_string()) }
    }
}

impl From<Status> for Failure {
    fn from(status: Status) -> Self {
        Self { status, text: None }
    }
}
