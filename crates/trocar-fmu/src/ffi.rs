//! Interface between C and the instance, common to both versions of FMI: checks pointers, catches
//! panics and reports errors.

use std::any::Any;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::error::FmuError;
use crate::instance::{Instance, Type};
use crate::snapshot::Snapshot;

/// `fmi2Status` and `fmi3Status`, which have the same values.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Status {
    Ok = 0,
    Warning = 1,
    Error = 3,
    Fatal = 4,
}

/// Log categories, as in the description.
pub(crate) const ERRORS: &CStr = c"logStatusError";
pub(crate) const WARNINGS: &CStr = c"logStatusWarning";

const REFERENCES: &str = "value references";
const VALUES: &str = "values";

/// Logger of FMI 2.0: environment, instance, status, category, format, arguments.
pub type Logger2 =
    unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char, ...);
/// Logger of FMI 3.0: environment, status, category, message.
pub(crate) type Logger3 = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);

/// The importer's logger.
pub(crate) enum Logger {
    Fmi2 { callback: Option<Logger2>, environment: *mut c_void, name: CString },
    Fmi3 { callback: Option<Logger3>, environment: *mut c_void },
}

impl Logger {
    fn log(&self, status: Status, text: &str) {
        let category = if status == Status::Warning { WARNINGS } else { ERRORS };
        let plain = text.replace('\0', "?");
        match self {
            Self::Fmi2 { callback: Some(callback), environment, name } => {
                // The message of FMI 2.0 is a printf format, in which # also has a special meaning.
                let Ok(text) = CString::new(plain.replace('%', "%%").replace('#', "##")) else {
                    return;
                };
                // SAFETY: the importer's function, called as FMI 2.0 requires; all strings
                // outlive the call.
                unsafe {
                    callback(
                        *environment,
                        name.as_ptr(),
                        status as c_int,
                        category.as_ptr(),
                        text.as_ptr(),
                    )
                }
            }
            Self::Fmi3 { callback: Some(callback), environment } => {
                let Ok(text) = CString::new(plain) else { return };
                // SAFETY: the importer's function, called as FMI 3.0 requires; all strings
                // outlive the call.
                unsafe { callback(*environment, status as c_int, category.as_ptr(), text.as_ptr()) }
            }
            _ => {}
        }
    }
}

/// What a handle points to.
pub(crate) struct Component {
    pub(crate) instance: Instance,
    logger: Logger,
    /// Set by a panic: the instance is in an unknown state.
    lost: bool,
}

impl Component {
    /// Leaves initialization mode; warns if the seal cannot hold the requested force or deflection.
    pub(crate) fn exit_initialization(&mut self, function: &str) -> Result<Status, FmuError> {
        let Some(remark) = self.instance.exit_initialization()? else { return Ok(Status::Ok) };
        self.logger.log(Status::Warning, &format!("{function}: {remark}"));
        Ok(Status::Warning)
    }
}

fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "panic".to_owned())
}

/// Creates a component; null and a message if `make` fails.
pub(crate) fn instantiate(
    function: &str,
    logger: Logger,
    make: impl FnOnce() -> Result<Instance, FmuError>,
) -> *mut c_void {
    let made = catch_unwind(AssertUnwindSafe(make))
        .unwrap_or_else(|panic| Err(FmuError::Internal(said(panic.as_ref()))));
    match made {
        Ok(instance) => Box::into_raw(Box::new(Component { instance, logger, lost: false })).cast(),
        Err(error) => {
            logger.log(Status::Error, &format!("{function}: {error}"));
            std::ptr::null_mut()
        }
    }
}

/// Runs `body` on the component behind `handle` and logs an error. A null handle is an error
/// without a message.
///
/// # Safety
/// `handle` is null or from [`instantiate`], not freed, and not in use elsewhere during the call.
pub(crate) unsafe fn call(
    handle: *mut c_void,
    function: &str,
    body: impl FnOnce(&mut Component) -> Result<Status, FmuError>,
) -> c_int {
    // SAFETY: null or a live component that is ours alone, by the contract of this function.
    let Some(component) = (unsafe { handle.cast::<Component>().as_mut() }) else {
        return Status::Error as c_int;
    };
    let outcome = match component.lost {
        true => Err(FmuError::Internal("an earlier call failed".to_owned())),
        false => catch_unwind(AssertUnwindSafe(|| body(component)))
            .unwrap_or_else(|panic| Err(FmuError::Internal(said(panic.as_ref())))),
    };
    let status = match outcome {
        Ok(status) => status,
        Err(error) => {
            component.lost |= matches!(error, FmuError::Internal(_));
            let status = if component.lost { Status::Fatal } else { Status::Error };
            component.logger.log(status, &format!("{function}: {error}"));
            status
        }
    };
    status as c_int
}

/// Frees a component; null is ignored.
///
/// # Safety
/// As for [`call`]; the handle is invalid afterwards.
pub(crate) unsafe fn free(handle: *mut c_void) {
    if !handle.is_null() {
        // SAFETY: made by `Box::into_raw` in `instantiate`, by the contract of this function.
        drop(unsafe { Box::from_raw(handle.cast::<Component>()) });
    }
}

/// A text of the importer; `what` names it in messages.
///
/// # Safety
/// `text` is null or a NUL-terminated string that is valid for `'a`.
pub(crate) unsafe fn text<'a>(
    text: *const c_char,
    what: &'static str,
) -> Result<&'a str, FmuError> {
    if text.is_null() {
        return Err(FmuError::null(what));
    }
    // SAFETY: not null, and a C string by the contract of this function.
    unsafe { CStr::from_ptr(text) }
        .to_str()
        .map_err(|_| FmuError::refused(format!("{what} is not UTF-8")))
}

/// Values of the importer; `what` names them in messages.
///
/// # Safety
/// `values` is null or points to `count` values that are valid for `'a`.
pub(crate) unsafe fn values<'a, T>(
    values: *const T,
    count: usize,
    what: &'static str,
) -> Result<&'a [T], FmuError> {
    if count == 0 {
        return Ok(&[]);
    }
    if values.is_null() {
        return Err(FmuError::null(what));
    }
    // SAFETY: not null, and `count` long by the contract of this function.
    Ok(unsafe { std::slice::from_raw_parts(values, count) })
}

/// A buffer of the importer for values, which may be uninitialized.
pub(crate) struct Room<T> {
    values: *mut T,
    count: usize,
}

impl<T> Room<T> {
    /// A buffer for `count` values; `what` names it in messages.
    ///
    /// # Safety
    /// `values` is null or points to space for `count` values as long as this exists.
    pub(crate) unsafe fn new(
        values: *mut T,
        count: usize,
        what: &'static str,
    ) -> Result<Self, FmuError> {
        if values.is_null() && count > 0 {
            Err(FmuError::null(what))
        } else {
            Ok(Self { values, count })
        }
    }

    pub(crate) fn put(&mut self, place: usize, value: T) {
        if place < self.count {
            // SAFETY: within the buffer, which is valid by the contract of `new`.
            unsafe { self.values.add(place).write(value) }
        }
    }
}

/// Checks that there are as many values as references.
pub(crate) fn paired(references: usize, values: usize) -> Result<(), FmuError> {
    let wrong = || {
        FmuError::refused(format!(
            "{references} value references need as many values, got {values}"
        ))
    };
    if references == values { Ok(()) } else { Err(wrong()) }
}

/// Rejects access to a type that no variable has, unless no variable is requested.
///
/// # Safety
/// As for [`values`].
pub(crate) unsafe fn none_of(
    references: *const u32,
    count: usize,
    kind: &'static str,
) -> Result<Status, FmuError> {
    // SAFETY: by the contract of this function.
    match unsafe { values(references, count, REFERENCES) }?.first() {
        None => Ok(Status::Ok),
        Some(reference) => Err(FmuError::unknown(*reference, kind)),
    }
}

/// Checks the categories of a call that switches logging on or off; errors and warnings are always
/// logged.
///
/// # Safety
/// As for [`values`] and [`text`].
pub(crate) unsafe fn categories(
    names: *const *const c_char,
    count: usize,
) -> Result<Status, FmuError> {
    // SAFETY: by the contract of this function.
    for name in unsafe { values(names, count, "categories") }? {
        // SAFETY: by the contract of this function.
        let given = unsafe { text(*name, "category") }?;
        if ![ERRORS, WARNINGS].iter().any(|category| category.to_bytes() == given.as_bytes()) {
            return Err(FmuError::refused(format!("no log category \"{given}\"")));
        }
    }
    Ok(Status::Ok)
}

/// Stores the present state in `slot`: in the existing state there, or in a new one.
///
/// # Safety
/// `slot` is null or points to null or to a state of this library that was not freed.
pub(crate) unsafe fn get_state(
    component: &mut Component,
    slot: *mut *mut c_void,
) -> Result<Status, FmuError> {
    let state = component.instance.state()?;
    // SAFETY: by the contract of this function.
    unsafe { put_state(state, slot) }
}

unsafe fn put_state(state: Snapshot, slot: *mut *mut c_void) -> Result<Status, FmuError> {
    // SAFETY: null or a valid place, by the contract of the callers.
    let slot = unsafe { slot.as_mut() }.ok_or_else(|| FmuError::null("the place for the state"))?;
    // SAFETY: null or a live state, by the contract of the callers.
    match unsafe { slot.cast::<Snapshot>().as_mut() } {
        Some(old) => *old = state,
        None => *slot = Box::into_raw(Box::new(state)).cast(),
    }
    Ok(Status::Ok)
}

/// The state that `state` points to.
///
/// # Safety
/// `state` is null or a state of this library that was not freed.
pub(crate) unsafe fn state_at<'a>(state: *mut c_void) -> Result<&'a Snapshot, FmuError> {
    // SAFETY: null or a live state, by the contract of this function.
    unsafe { state.cast::<Snapshot>().as_ref() }.ok_or_else(|| FmuError::null("the state"))
}

/// Frees the state in `slot` and empties it; null is ignored.
///
/// # Safety
/// As for [`get_state`].
pub(crate) unsafe fn free_state(slot: *mut *mut c_void) -> Result<Status, FmuError> {
    // SAFETY: null or a valid place, by the contract of this function.
    if let Some(slot) = unsafe { slot.as_mut() }
        && !slot.is_null()
    {
        // SAFETY: made by `Box::into_raw` in `put_state`, by the contract of this function.
        drop(unsafe { Box::from_raw(slot.cast::<Snapshot>()) });
        *slot = std::ptr::null_mut();
    }
    Ok(Status::Ok)
}

/// Writes the size of `state` in bytes to `size`.
///
/// # Safety
/// `state` as for [`state_at`]; `size` is null or valid.
pub(crate) unsafe fn state_size(
    component: &Component,
    state: *mut c_void,
    size: *mut usize,
) -> Result<Status, FmuError> {
    // SAFETY: by the contract of this function.
    unsafe { state_at(state) }?;
    // SAFETY: by the contract of this function.
    unsafe { Room::new(size, 1, "the size") }?.put(0, component.instance.state_length());
    Ok(Status::Ok)
}

/// Writes the bytes of `state`.
///
/// # Safety
/// `state` as for [`state_at`]; `bytes` is null or points to space for `size` bytes.
pub(crate) unsafe fn serialise(
    state: *mut c_void,
    bytes: *mut u8,
    size: usize,
) -> Result<Status, FmuError> {
    // SAFETY: by the contract of this function.
    let serialised = unsafe { state_at(state) }?.to_bytes();
    if size < serialised.len() {
        return Err(FmuError::state_length(size, serialised.len()));
    }
    // SAFETY: by the contract of this function.
    let mut room = unsafe { Room::new(bytes, size, "the serialised state") }?;
    serialised.into_iter().enumerate().for_each(|(place, byte)| room.put(place, byte));
    Ok(Status::Ok)
}

/// Reads a state from its bytes and stores it in `slot`.
///
/// # Safety
/// `bytes` is null or points to `size` bytes; `slot` as for [`get_state`].
pub(crate) unsafe fn deserialise(
    component: &Component,
    bytes: *const u8,
    size: usize,
    slot: *mut *mut c_void,
) -> Result<Status, FmuError> {
    // SAFETY: by the contract of this function.
    let bytes = unsafe { values(bytes, size, "the serialised state") }?;
    let state = component.instance.read_state(bytes)?;
    // SAFETY: by the contract of this function.
    unsafe { put_state(state, slot) }
}

/// Passes on the values of variables.
///
/// # Safety
/// As FMI requires: `references` and `out` are null or `count` long.
pub(crate) unsafe fn get<T>(
    component: &mut Component,
    references: *const u32,
    count: usize,
    (out, to_own): (*mut T, fn(f64) -> T),
    kind: Type,
) -> Result<Status, FmuError> {
    // SAFETY: by the contract of this function.
    let (references, mut room) =
        unsafe { (values(references, count, REFERENCES)?, Room::new(out, count, VALUES)?) };
    component.instance.get(references, kind, |place, value| room.put(place, to_own(value)))?;
    Ok(Status::Ok)
}

/// Sets variables, all or none.
///
/// # Safety
/// As for [`get`].
pub(crate) unsafe fn set<T: Copy>(
    component: &mut Component,
    references: *const u32,
    count: usize,
    (new, to_number): (*const T, fn(T) -> f64),
    kind: Type,
) -> Result<Status, FmuError> {
    // SAFETY: by the contract of this function.
    let (references, new) =
        unsafe { (values(references, count, REFERENCES)?, values(new, count, VALUES)?) };
    component.instance.set(references, new.iter().map(|value| to_number(*value)), kind)?;
    Ok(Status::Ok)
}

/// Declares functions of FMI over an instance, each under the names that it has in the versions of
/// FMI.
macro_rules! functions {
    ($(#[$doc:meta] $($name:ident),+ = $arguments:tt |$component:pat_param| $body:block)*) => { $($(
        $crate::ffi::function! { #[$doc] $name $arguments |$component| $body }
    )+)* };
}

/// One function of FMI.
macro_rules! function {
    (#[$doc:meta] $name:ident($($argument:tt: $type:ty),*) |$component:pat_param| $body:block) => {
        #[$doc]
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(handle: *mut c_void $(, $argument: $type)*) -> c_int {
            // SAFETY: handle and pointers are as FMI requires.
            unsafe { $crate::ffi::call(handle, stringify!($name), |$component| $body) }
        }
    };
}

/// Declares access to types that no variable has.
macro_rules! no_variables {
    ($($name:ident($($argument:ty),*): $kind:expr;)*) => { $(
        $crate::ffi::function! {
            #[doc = concat!("There are no variables of type ", $kind, ".")]
            $name(vr: *const u32, count: usize $(, _: $argument)*)
            |_| { $crate::ffi::none_of(vr, count, $kind) }
        }
    )* };
}

/// Declares functions of FMI that this FMU does not support: they fail with a message that gives
/// the reason.
macro_rules! unsupported {
    ($($name:ident($($argument:ty),*): $why:expr;)*) => { $(
        $crate::ffi::function! {
            #[doc = concat!("`", stringify!($name), "`: refused, ", $why, ".")]
            $name($(_: $argument),*)
            |_| { Err($crate::error::FmuError::unsupported($why)) }
        }
    )* };
}

pub(crate) use {function, functions, no_variables, unsupported};

#[cfg(test)]
mod tests {
    use trocar_model::{Element, ElementParams, Trocar};

    use super::*;
    use crate::resource::{Resource, to_bytes, to_row};
    use crate::variables::{Input, token};

    #[test]
    fn a_panic_ends_the_instance_and_not_the_importer() {
        let element = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
        let row = to_row(&Trocar::of_seal(element));
        let wanted = token(&row, Input::Position);
        let logger = || Logger::Fmi3 { callback: None, environment: std::ptr::null_mut() };
        assert!(instantiate("", logger(), || panic!("on purpose")).is_null());
        let handle = instantiate("", logger(), || {
            Instance::from_resource(Resource::from_bytes(&to_bytes(&row), "")?, &wanted)
        });
        // SAFETY: a live handle.
        unsafe {
            assert_eq!(call(handle, "", |_| Ok(Status::Ok)), Status::Ok as c_int);
            assert_eq!(call(handle, "", |_| panic!("on purpose")), Status::Fatal as c_int);
            assert_eq!(call(handle, "", |_| Ok(Status::Ok)), Status::Fatal as c_int);
            free(handle);
        }
    }
}
