//! Models: read once, immutable, shared by as many states and threads as there are.

use std::ffi::{CStr, CString, OsStr, c_char};
use std::mem::offset_of;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

use trocar_model::{Classical, Seal, Trocar, TrocarState, Tunable as ModelTunable};
use trocar_runtime::model_file::{ModelFile, ModelFileError};

use crate::message::{Failure, Message};
use crate::pointer::{Array, OutPointer, checked, text};
use crate::status::{Status, guarded};

/// First word of every model, "TROCARM1".
const MARK: u64 = u64::from_le_bytes(*b"TROCARM1");

/// A model: a seal, and how its force depends on the way. Made by trocar_model_load() and its like, ended by
/// trocar_model_free(), immutable in between: any number of threads may use one at the same time.
pub struct Model {
    content: Content,
}

/// The mark stands first: whatever a wrong pointer points to, no more than its first word is read.
#[repr(C)]
pub(crate) struct Content {
    mark: u64,
    /// What its states carry: the same for all models tuned from one.
    pub(crate) tag: u64,
    pub(crate) trocar: Trocar<Vec<f64>>,
    /// A state of it, to read others into.
    pub(crate) rest: TrocarState,
    /// What it was read from; a tuned model has a seal of its own.
    pub(crate) file: Arc<ModelFile>,
    tunables: Vec<TunableText>,
}

const _: () = assert!(offset_of!(Model, content) == 0 && offset_of!(Content, mark) == 0);

struct TunableText {
    name: CString,
    unit: CString,
    description: CString,
    tunable: ModelTunable,
}

/// A number of a model that can be adjusted by itself, trocar_model_tunable(). The texts live as long as the model.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Tunable {
    /// Name with its unit at the end, such as "half_width_m", or "element_2_half_width_m" of one of several elements.
    pub name: *const c_char,
    /// Unit in SI such as "N s/m", "1" for a pure number.
    pub unit: *const c_char,
    /// What it is.
    pub description: *const c_char,
    /// Present value.
    pub value: f64,
    /// Least value allowed.
    pub least: f64,
    /// 1 where the least value itself is not allowed, else 0.
    pub above_least: i32,
    /// Which of several elements it belongs to, from 1; 0 for what the model has once.
    pub element: i32,
}

/// Kinds of the classical models as texts of C, made with the first model.
static CLASSICAL: LazyLock<Vec<CString>> = LazyLock::new(|| {
    Classical::KINDS.iter().map(|kind| CString::new(*kind).unwrap_or_default()).collect()
});

impl Model {
    fn new(
        trocar: Trocar<Vec<f64>>,
        file: Arc<ModelFile>,
        tag: Option<u64>,
    ) -> Result<Box<Self>, Failure> {
        LazyLock::force(&CLASSICAL); // asking for a kind later allocates nothing
        let mut numbers = vec![0.0; trocar.count_numbers()];
        trocar
            .write_numbers(&mut numbers)
            .map_err(|error| Failure::new(Status::Internal, error))?;
        let tag = tag.unwrap_or_else(|| tag_of(&numbers));
        let tunables = trocar.seal().tunables().map(TunableText::new).collect();
        let rest = trocar.rest(0.0);
        Ok(Box::new(Self { content: Content { mark: MARK, tag, trocar, rest, file, tunables } }))
    }

    fn from_file(file: ModelFile) -> Result<Box<Self>, Failure> {
        let file = Arc::new(file);
        Self::new(file.trocar.clone(), Arc::clone(&file), None)
    }

    /// # Safety
    /// `model` must be null, misaligned, or readable for the size of a model during `'a`.
    pub(crate) unsafe fn borrowed<'a>(model: *const Self) -> Result<&'a Content, Status> {
        let model = checked(model)?;
        // The mark first: what is no model must not be read as one.
        // SAFETY: not null, aligned; the rest by contract.
        let mark = unsafe { model.cast::<u64>().read() };
        if mark != MARK {
            return Err(Status::NotAModel);
        }
        // SAFETY: it bears the mark of a model, which nobody else writes.
        Ok(unsafe { &(*model).content })
    }
}

impl TunableText {
    fn new(tunable: ModelTunable) -> Self {
        let text = |text: &str| CString::new(text).unwrap_or_default();
        let id = tunable.id;
        Self {
            name: text(&id.to_string()),
            unit: text(id.unit().si),
            description: text(&format!("{}: {}", id.symbol(), id.words())),
            tunable,
        }
    }

    fn borrowed(&self) -> Tunable {
        let range = self.tunable.id.declaration().range;
        Tunable {
            name: self.name.as_ptr(),
            unit: self.unit.as_ptr(),
            description: self.description.as_ptr(),
            value: self.tunable.value,
            least: range.least(),
            above_least: range.excludes_least().into(),
            element: self.tunable.id.element.map_or(0, i32::from),
        }
    }
}

/// FNV-1a over the bits: the same model has the same tag in every process.
fn tag_of(numbers: &[f64]) -> u64 {
    let bytes = numbers.iter().flat_map(|number| number.to_bits().to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

fn refused(error: ModelFileError) -> Failure {
    Failure::new(status_of(&error), error)
}

fn status_of(error: &ModelFileError) -> Status {
    match error {
        ModelFileError::InFile { source, .. } => status_of(source),
        ModelFileError::Unreadable(_) => Status::ModelUnreadable,
        ModelFileError::OtherVersion { .. } => Status::ModelNewer,
        _ => Status::ModelInvalid,
    }
}

/// Hands a new model over to C.
///
/// # Safety
/// As for [`OutPointer::new`].
unsafe fn hand_over(
    place: *mut *mut Model,
    made: impl FnOnce() -> Result<Box<Model>, Failure>,
) -> Result<(), Failure> {
    // SAFETY: by contract.
    let mut place = unsafe { OutPointer::new(place) }?;
    place.set(std::ptr::null_mut());
    place.set(Box::into_raw(made()?));
    Ok(())
}

/// A path as the system has it: bytes on Unix, UTF-8 elsewhere.
fn path_of(text: &CStr) -> Result<PathBuf, Failure> {
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt;
        Ok(Path::new(OsStr::from_bytes(text.to_bytes())).to_owned())
    }
    #[cfg(not(unix))]
    {
        text.to_str()
            .map(|path| Path::new(OsStr::new(path)).to_owned())
            .map_err(|_| Failure::new(Status::ModelUnreadable, "the path is not UTF-8"))
    }
}

/// Reads and checks the model file at path and gives it to *model, which the caller ends with trocar_model_free().
/// Allocates, and takes its time: not for a control loop. Where it fails, *model is NULL and message holds what is
/// wrong, with the place in the file.
///
/// path is NUL-terminated (UTF-8 on Windows). message may be NULL; else it points to message_size bytes, and what does
/// not fit is cut; "" on success. TROCAR_MESSAGE_SIZE bytes do for nearly all messages.
///
/// Refuses: TROCAR_STATUS_MODEL_UNREADABLE, TROCAR_STATUS_MODEL_INVALID, TROCAR_STATUS_MODEL_NEWER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_model_load(
    path: *const c_char,
    model: *mut *mut Model,
    message: *mut c_char,
    message_size: usize,
) -> Status {
    // SAFETY: by the rule of the crate.
    let message = unsafe { Message::new(message, message_size) };
    message.report(|| {
        let made = || {
            // SAFETY: by the rule of the crate.
            let path = path_of(unsafe { text(path) }?)?;
            Model::from_file(ModelFile::read(&path).map_err(refused)?)
        };
        // SAFETY: by the rule of the crate.
        unsafe { hand_over(model, made) }
    })
}

/// The same from the text of a model file: json_length bytes of UTF-8 at json, which need no NUL at their end and may be
/// freed afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_model_parse(
    json: *const c_char,
    json_length: usize,
    model: *mut *mut Model,
    message: *mut c_char,
    message_size: usize,
) -> Status {
    // SAFETY: by the rule of the crate.
    let message = unsafe { Message::new(message, message_size) };
    message.report(|| {
        let made = || {
            // SAFETY: by the rule of the crate.
            let bytes: Vec<u8> =
                unsafe { Array::new(json.cast::<u8>(), json_length) }?.iter().collect();
            let text = String::from_utf8(bytes)
                .map_err(|error| Failure::new(Status::ModelInvalid, error))?;
            Model::from_file(ModelFile::from_json(&text).map_err(refused)?)
        };
        // SAFETY: by the rule of the crate.
        unsafe { hand_over(model, made) }
    })
}

/// A made-up one-stage 10.5 mm trocar, to try things with: no trocar was measured. Give it back with
/// trocar_model_free(). Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_model_plausible(model: *mut *mut Model) -> Status {
    // SAFETY: no message is wanted.
    let silent = unsafe { Message::new(std::ptr::null_mut(), 0) };
    silent.report(|| {
        // SAFETY: by the rule of the crate.
        unsafe {
            hand_over(model, || {
                let file = ModelFile::plausible_10_5_mm()
                    .map_err(|error| Failure::new(Status::Internal, error))?;
                Model::from_file(file)
            })
        }
    })
}

/// A copy of model with new values, SI, in the order of trocar_model_tunable(); those past count stay. The same values
/// give the same model, to the last bit. States of model go on under the copy. Give it back with trocar_model_free().
/// Allocates; message as for trocar_model_load().
///
/// Refuses: TROCAR_STATUS_OUT_OF_RANGE where count exceeds trocar_model_tunable_count(), TROCAR_STATUS_MODEL_INVALID.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_model_tuned(
    model: *const Model,
    values: *const f64,
    count: usize,
    tuned: *mut *mut Model,
    message: *mut c_char,
    message_size: usize,
) -> Status {
    // SAFETY: by the rule of the crate.
    let message = unsafe { Message::new(message, message_size) };
    message.report(|| {
        let made = || {
            // SAFETY: by the rule of the crate.
            let (old, values) = unsafe { (Model::borrowed(model)?, Array::new(values, count)?) };
            if count > old.tunables.len() {
                let text = format!(
                    "the model has {} adjustable parameters, got {count}",
                    old.tunables.len()
                );
                return Err(Failure::new(Status::OutOfRange, text));
            }
            let values: Vec<f64> = values.iter().collect();
            let seal = old
                .trocar
                .seal()
                .tuned(&values)
                .map_err(|error| Failure::new(Status::ModelInvalid, error))?;
            Model::new(old.trocar.with_seal(seal), Arc::clone(&old.file), Some(old.tag))
        };
        // SAFETY: by the rule of the crate.
        unsafe { hand_over(tuned, made) }
    })
}

/// Frees a model; NULL is allowed. No thread may use the model during the call or later. States are not touched.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_model_free(model: *mut Model) -> Status {
    guarded(|| {
        if model.is_null() {
            return Ok(());
        }
        // SAFETY: by the rule of the crate.
        unsafe { Model::borrowed(model) }?;
        // SAFETY: it bears the mark of a model, and all models come from `Box::into_raw`.
        let mut model = unsafe { Box::from_raw(model) };
        // SAFETY: the place of a live value. Volatile, or the compiler drops a write that nobody may read; it serves
        // whoever frees twice.
        unsafe { (&raw mut model.content.mark).write_volatile(0) };
        Ok(())
    })
}

/// Kind of the model: "ems", or the kind of a classical model as in its file. Lives as long as the program. NULL for a pointer
/// that is no model.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_model_kind(model: *const Model) -> *const c_char {
    // SAFETY: by the rule of the crate.
    match unsafe { Model::borrowed(model) }.map(|model| model.trocar.seal()) {
        Err(_) => std::ptr::null(),
        Ok(Seal::Ems(_)) => c"ems".as_ptr(),
        Ok(Seal::Classical(model)) => {
            let own = CLASSICAL.iter().find(|kind| kind.as_bytes() == model.kind().as_bytes());
            own.map_or(std::ptr::null(), |kind| kind.as_ptr())
        }
    }
}

/// How many numbers of the model can be adjusted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_model_tunable_count(
    model: *const Model,
    count: *mut usize,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (model, mut count) = unsafe { (Model::borrowed(model)?, OutPointer::new(count)?) };
        count.set(model.tunables.len());
        Ok(())
    })
}

/// The number at index, from 0, with its name, unit and range.
///
/// Refuses: TROCAR_STATUS_OUT_OF_RANGE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn trocar_model_tunable(
    model: *const Model,
    index: usize,
    tunable: *mut Tunable,
) -> Status {
    guarded(|| {
        // SAFETY: by the rule of the crate.
        let (model, mut tunable) = unsafe { (Model::borrowed(model)?, OutPointer::new(tunable)?) };
        tunable.set(model.tunables.get(index).ok_or(Status::OutOfRange)?.borrowed());
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_owns_what_it_borrows_from() {
        let path =
            concat!(env!("CARGO_MANIFEST_DIR"), "/../../conformance/models/ems_profile.json");
        let file = ModelFile::read(Path::new(path)).unwrap();
        let Ok(model) = Model::from_file(file.clone()) else { panic!("refused") };
        assert_eq!(model.content.trocar, file.trocar);
        let forces = |trocar: &Trocar<Vec<f64>>| trocar.step(&mut trocar.rest(0.1), 0.01, 0.1);
        let expected = forces(&file.trocar);
        drop(file);
        let moved = *model;
        assert_eq!(forces(&moved.content.trocar), expected);
    }
}
