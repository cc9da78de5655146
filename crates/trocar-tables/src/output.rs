//! Atomic output: it appears completely or not at all.
//!
//! Results are written next to their destination and renamed at the end. So an error, a full disk
//! or an interruption never leaves a half-written file in place of a complete one. An interruption
//! that ends the process runs no destructors; its handler calls [`remove_unfinished`]. What a killed
//! process leaves, the next output into the same folder removes: unfinished files are locked by
//! their process, and the system unlocks them when it ends.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::{NamedTempFile, TempDir};

pub use crate::error::OutputError;

/// Prefix of all unfinished files; the dot hides it from plain listings.
const PREFIX: &str = ".trocar-unfinished-";

/// File in an unfinished folder that its process has locked.
const LOCK: &str = ".lock";

/// Unfinished temporary files and folders of this process.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes every temporary file and folder of this process. A Ctrl-C handler calls it last.
///
/// Writes still in progress in other threads fail afterwards.
pub fn remove_unfinished() {
    let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
    for path in unfinished.drain(..) {
        // No error can be reported any more, and the files are hidden.
        let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
    }
}

/// Lists a path as unfinished during its own lifetime.
#[derive(Debug)]
struct Unfinished(PathBuf);

impl Unfinished {
    fn new(path: &Path) -> Self {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_owned());
        Self(path.to_owned())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut unfinished = UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner);
        unfinished.retain(|path| *path != self.0);
    }
}

/// A file that gets its name only when it is complete; dropped before [`AtomicFile::commit`], it
/// leaves nothing.
///
/// `-` is standard output. Pipes and devices are written directly, since they cannot be replaced.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    target: Target,
}

#[derive(Debug)]
enum Target {
    Temporary { file: NamedTempFile, to: PathBuf, _unfinished: Unfinished },
    Direct(File),
    Stdout(io::Stdout),
}

impl AtomicFile {
    /// Opens the file for writing.
    ///
    /// # Errors
    /// [`OutputError::Create`] when the folder is missing or not writable, or `path` is a folder.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, OutputError> {
        let path = path.as_ref();
        let target = Target::open(path)
            .map_err(|source| OutputError::Create { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), target })
    }

    /// Gives the file its name and replaces an earlier one.
    ///
    /// # Errors
    /// [`OutputError::Write`] when the last bytes cannot be stored; an earlier file of that name
    /// then stays untouched.
    pub fn commit(mut self) -> Result<(), OutputError> {
        let path = self.path.clone();
        let finish = || {
            self.flush()?;
            match self.target {
                Target::Temporary { file, to, .. } => {
                    file.as_file().sync_all()?;
                    file.persist(to).map(drop).map_err(|error| error.error)
                }
                Target::Direct(_) | Target::Stdout(_) => Ok(()),
            }
        };
        finish().map_err(|source| OutputError::Write { path, source })
    }

    /// A write error of this file with its path.
    #[must_use]
    pub fn write_error(&self, source: io::Error) -> OutputError {
        OutputError::Write { path: self.path.clone(), source }
    }
}

impl Target {
    fn open(path: &Path) -> io::Result<Self> {
        if path == Path::new("-") {
            return Ok(Self::Stdout(io::stdout()));
        }
        let to = match fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
            Ok(metadata) if !metadata.is_file() => {
                return File::options().write(true).open(path).map(Self::Direct);
            }
            // Follows a link, so that the link stays and its target is replaced.
            Ok(_) => fs::canonicalize(path)?,
            Err(_) => path.to_owned(),
        };
        let folder = folder_of(&to);
        remove_abandoned(folder);
        let file = locked(|| {
            let file = hidden(0o666).tempfile_in(folder).map_err(without_name)?;
            let lock = file.as_file().try_clone()?;
            let path = file.path().to_owned();
            Ok((file, lock, path))
        })?
        .0;
        let unfinished = Unfinished::new(file.path());
        Ok(Self::Temporary { file, to, _unfinished: unfinished })
    }

    fn as_write(&mut self) -> &mut dyn Write {
        match self {
            Self::Temporary { file, .. } => file,
            Self::Direct(file) => file,
            Self::Stdout(stdout) => stdout,
        }
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.target.as_write().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.target.as_write().flush()
    }
}

/// Refuses outputs that would replace one of the `inputs`, also under another path, through a
/// symbolic link or as a hard link (this on Unix only).
///
/// An output may have a `*` in its name for any text: it stands for all files of such names that are
/// there. `-` is standard input or output; standard input is refused where it is redirected from
/// the output. An input folder is a bag, and stands for all of its files.
///
/// # Errors
/// [`OutputError::IsInput`] with the first such pair.
pub fn refuse_inputs(
    outputs: impl IntoIterator<Item = impl AsRef<Path>>,
    inputs: &[PathBuf],
) -> Result<(), OutputError> {
    let inputs: Vec<(&PathBuf, Identity)> =
        inputs.iter().flat_map(|input| identities(input).map(move |id| (input, id))).collect();
    for output in outputs.into_iter().flat_map(|output| existing(output.as_ref())) {
        let Some(own) = identity(&output) else { continue };
        if let Some((input, _)) = inputs.iter().find(|(_, id)| *id == own) {
            let input = (*input).clone();
            return Err(OutputError::IsInput { path: output, input });
        }
    }
    Ok(())
}

/// What two paths of the same regular file have in common.
#[cfg(unix)]
type Identity = (u64, u64);
#[cfg(not(unix))]
type Identity = PathBuf;

/// Of a regular file; nothing is lost of a pipe, a device or what does not exist.
fn identity(path: &Path) -> Option<Identity> {
    let metadata = fs::metadata(path).ok().filter(fs::Metadata::is_file)?;
    #[cfg(unix)]
    return Some((
        std::os::unix::fs::MetadataExt::dev(&metadata),
        std::os::unix::fs::MetadataExt::ino(&metadata),
    ));
    #[cfg(not(unix))]
    path.canonicalize().ok().filter(|_| metadata.is_file())
}

fn identities(input: &Path) -> impl Iterator<Item = Identity> {
    let files = match () {
        () if input == Path::new("-") => vec![PathBuf::from("/dev/stdin")],
        () if input.join("metadata.yaml").is_file() => existing(&input.join("*")),
        () => vec![input.to_owned()],
    };
    files.into_iter().filter_map(|file| identity(&file))
}

/// The path, or what is there of the names that it stands for.
fn existing(path: &Path) -> Vec<PathBuf> {
    let name = path.file_name().and_then(|name| name.to_str());
    let Some((start, end)) = name.and_then(|name| name.split_once('*')) else {
        return vec![path.to_owned()];
    };
    let entries = fs::read_dir(folder_of(path)).into_iter().flatten().flatten();
    entries
        .map(|entry| entry.path())
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.len() >= start.len() + end.len() && name.starts_with(start) && name.ends_with(end)
        })
        .collect()
}

/// Writes a file that appears whole or not at all.
///
/// # Errors
/// [`OutputError`] where it cannot be written.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(|source| file.write_error(source))?;
    file.commit()
}

/// Writes files that belong together, each whole; if one of them fails, all are as before.
///
/// # Errors
/// [`OutputError`] of the first file that cannot be written.
pub fn write_together(files: &[(&Path, &[u8])]) -> Result<(), OutputError> {
    let mut written = Vec::new();
    for (path, bytes) in files {
        let mut file = AtomicFile::create(path)?;
        file.write_all(bytes).map_err(|source| file.write_error(source))?;
        written.push((file, *path, fs::read(path).ok()));
    }
    let mut placed: Vec<(&Path, Option<Vec<u8>>)> = Vec::new();
    for (file, path, earlier) in written {
        if let Err(error) = file.commit() {
            for (path, earlier) in placed {
                // The first error is the one to report.
                let _ = earlier.map_or_else(|| fs::remove_file(path), |old| fs::write(path, old));
            }
            return Err(error);
        }
        placed.push((path, earlier));
    }
    Ok(())
}

/// A temporary name with the permissions that `File::create` and `create_dir` give. Otherwise
/// temporary files are private and stay private under their final name.
fn hidden(_mode: u32) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(_mode));
    builder
}

/// The error without the name of the temporary file, which is of no use to the user.
fn without_name(error: io::Error) -> io::Error {
    let text = error.to_string();
    match text.split_once(" at path ") {
        Some((what, _)) => io::Error::new(error.kind(), what.to_owned()),
        None => error,
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Several files that appear in a folder together; dropped before [`StagedFolder::commit`], they
/// leave nothing.
///
/// The folder may exist: files of the same names are replaced, others stay.
#[derive(Debug)]
pub struct StagedFolder {
    target: PathBuf,
    staging: TempDir,
    lock: File,
    _unfinished: Unfinished,
}

impl StagedFolder {
    /// Prepares to fill the folder `target`, which need not exist.
    ///
    /// # Errors
    /// [`OutputError::Create`] when the folder is not writable, so that this is found before the
    /// computation.
    pub fn create(target: impl AsRef<Path>) -> Result<Self, OutputError> {
        let target = target.as_ref();
        let (staging, lock) = stage(target)
            .map_err(|source| OutputError::Create { path: target.to_owned(), source })?;
        let unfinished = Unfinished::new(staging.path());
        Ok(Self { target: target.to_owned(), staging, lock, _unfinished: unfinished })
    }

    /// The final path of the folder.
    #[must_use]
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// The temporary folder of the files, for code that writes or reads them by path.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.staging.path()
    }

    /// Writes one file; `name` may contain a subfolder, as in `figures/residuals.svg`.
    ///
    /// # Errors
    /// [`OutputError::Write`], for example on a full disk.
    pub fn write(&self, name: impl AsRef<Path>, contents: &[u8]) -> Result<(), OutputError> {
        let path = self.staging.path().join(&name);
        let store = || {
            fs::create_dir_all(folder_of(&path))?;
            let mut file = File::create(&path)?;
            file.write_all(contents)?;
            file.sync_all()
        };
        store().map_err(|source| OutputError::Write { path: self.target.join(&name), source })
    }

    /// Moves all files to their final names.
    ///
    /// # Errors
    /// [`OutputError::Write`] when they cannot be moved into place.
    pub fn commit(self) -> Result<(), OutputError> {
        let place = || {
            fs::remove_file(self.staging.path().join(LOCK))?;
            drop(self.lock);
            if !self.target.exists() {
                fs::create_dir_all(folder_of(&self.target))?;
                return fs::rename(self.staging.path(), &self.target);
            }
            move_into(self.staging.path(), &self.target)
        };
        place().map_err(|source| OutputError::Write { path: self.target.clone(), source })
    }
}

/// A temporary folder on the same file system: inside the target, or next to it if it does not
/// exist.
fn stage(target: &Path) -> io::Result<(TempDir, File)> {
    let existing = target.ancestors().find(|path| path.exists());
    let folder = existing.filter(|path| !path.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(io::ErrorKind::NotADirectory.into());
    }
    remove_abandoned(folder);
    locked(|| {
        let staging = hidden(0o777).tempdir_in(folder).map_err(without_name)?;
        let path = staging.path().join(LOCK);
        let lock = File::create(&path)?;
        Ok((staging, lock, path))
    })
}

/// What `create` makes, locked for the life of this process: a temporary file or folder, its file
/// to lock, and the path of that.
///
/// Another process may take it for abandoned before it is locked, and remove it: then it is made
/// anew. Where the file system has no locks, nothing is ever taken for abandoned.
fn locked<T>(create: impl Fn() -> io::Result<(T, File, PathBuf)>) -> io::Result<(T, File)> {
    loop {
        let (made, file, path) = create()?;
        let _ = file.lock();
        if path.exists() {
            return Ok((made, file));
        }
    }
}

/// Removes what processes that were killed have left unfinished in `folder`; once a process, since
/// a run may write very many files into one folder.
fn remove_abandoned(folder: &Path) {
    static SEEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let Ok(folder) = folder.canonicalize() else { return };
    if !SEEN.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.clone()) {
        return;
    }
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if !entry.file_name().to_string_lossy().starts_with(PREFIX) {
            continue;
        }
        let path = entry.path();
        let is_folder = path.is_dir();
        let lock = if is_folder { path.join(LOCK) } else { path.clone() };
        let unlocked = File::options().write(true).open(&lock).ok();
        // Committed in the meantime, it is no longer there.
        if unlocked.is_some_and(|file| file.try_lock().is_ok() && lock.exists()) {
            // An error leaves a hidden file, and has nothing to do with this run's output.
            let _ = if is_folder { fs::remove_dir_all(path) } else { fs::remove_file(path) };
        }
    }
}

/// Moves all files, replacing those of the same name.
fn move_into(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let destination = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            move_into(&entry.path(), &destination)?;
        } else {
            fs::rename(entry.path(), destination)?;
        }
    }
    Ok(())
}
