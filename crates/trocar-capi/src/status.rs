//! What became of a call.

use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What became of a call. Whatever is not TROCAR_STATUS_OK left model, state and compensator as they were.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Done.
    Ok = 0,
    /// A pointer is NULL.
    NullPointer = 1,
    /// A pointer is not aligned for what it points to.
    Misaligned = 2,
    /// The pointer to a model does not point to one; it may have been freed.
    NotAModel = 3,
    /// The memory of a state holds none: not initialised, its mark overwritten or a number no longer finite, or of another
    /// version of the library.
    NotAState = 4,
    /// The state was initialised for another model.
    OtherModel = 5,
    /// Another thread is using the state or the compensator.
    StateBusy = 6,
    /// A number is NaN or infinite, or the position, velocity or state it leads to is.
    NotFinite = 7,
    /// The duration of a step is zero or negative.
    DurationNotPositive = 8,
    /// An index or a number of elements is out of range.
    OutOfRange = 9,
    /// The model has no such quantity: classical models have no deflection and no mode, and not every model states how
    /// far off its force is.
    Unsupported = 10,
    /// The model file cannot be read.
    ModelUnreadable = 11,
    /// The text is no model, or its values make none.
    ModelInvalid = 12,
    /// The model was written by another version of trocar.
    ModelNewer = 13,
    /// A defect of the library; please report it. The compensator of such a call is lost.
    Internal = 14,
    /// The pointer to a compensator does not point to one; it may have been freed.
    NotACompensator = 15,
}

impl Status {
    const ALL: [(Self, &CStr); 16] = [
        (Self::Ok, c"done"),
        (Self::NullPointer, c"a pointer is null"),
        (Self::Misaligned, c"a pointer is not aligned for what it points to"),
        (Self::NotAModel, c"not a model: a wrong pointer, or the model was freed"),
        (
            Self::NotAState,
            c"not a state: not initialised, overwritten, or of another version of the library",
        ),
        (Self::OtherModel, c"the state was initialised for another model"),
        (Self::StateBusy, c"another thread is using the state or the compensator"),
        (
            Self::NotFinite,
            c"a number is not finite, or leads to a position, velocity or state that is not",
        ),
        (Self::DurationNotPositive, c"the duration of a step must be positive"),
        (Self::OutOfRange, c"an index or a number of elements is out of range"),
        (Self::Unsupported, c"the model knows no such quantity"),
        (Self::ModelUnreadable, c"the model file cannot be read"),
        (Self::ModelInvalid, c"the text is no model, or its values make none"),
        (Self::ModelNewer, c"the model was written by another version of trocar"),
        (Self::Internal, c"a defect of trocar, please report it"),
        (Self::NotACompensator, c"not a compensator: a wrong pointer, or it was freed"),
    ];

    pub(crate) fn text(self) -> &'static CStr {
        Self::ALL.iter().find(|(status, _)| *status == self).map_or(c"", |(_, text)| text)
    }
}

/// What a status means, in English. Lives as long as the program. Never fails: a number that is no status is
/// called "unknown status".
#[unsafe(no_mangle)]
pub extern "C" fn trocar_status_message(status: i32) -> *const c_char {
    let known = Status::ALL.iter().find(|(known, _)| *known as i32 == status);
    known.map_or(c"unknown status", |(_, text)| text).as_ptr()
}

/// Runs the body of a function that C calls. A panic would be a defect; it must not unwind into C.
pub(crate) fn guarded(body: impl FnOnce() -> Result<(), Status>) -> Status {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => Status::Ok,
        Ok(Err(status)) => status,
        Err(_) => Status::Internal,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_a_status() {
        assert_eq!(guarded(|| panic!("a defect, on purpose")), Status::Internal);
    }

    #[test]
    fn every_number_up_to_the_last_has_a_message_of_its_own() {
        let mut texts: Vec<_> = Status::ALL.iter().map(|(_, text)| text).collect();
        assert!(
            Status::ALL.iter().enumerate().all(|(number, (status, _))| *status as usize == number)
        );
        texts.sort();
        texts.dedup();
        assert_eq!(texts.len(), Status::ALL.len());
    }
}
