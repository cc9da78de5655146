//! Arguments that name what a verb writes, and the check that none of it replaces an input.

use std::ffi::OsString;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use clap::ArgMatches;
use clap::builder::{PathBufValueParser, TypedValueParser};
use trocar::model_file;
use trocar::output::refuse_inputs;
use trocar_fmu::Platform;

/// A file or folder to write. Every other path on the command line is an input, which no output may
/// replace.
#[derive(Debug, Clone)]
pub(crate) struct Output {
    path: PathBuf,
    /// All files that are written; a `*` in a name stands for any text.
    files: Vec<PathBuf>,
}

impl Output {
    /// A parser of a file beside which `others` writes more.
    pub(crate) fn with(others: fn(&Path) -> Vec<PathBuf>) -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new()
            .map(move |path| Self { files: [others(&path), vec![path.clone()]].concat(), path })
    }

    /// A parser of a folder with the files `names`.
    pub(crate) fn folder(names: &'static [&'static str]) -> impl TypedValueParser<Value = Self> {
        PathBufValueParser::new().map(move |path| Self {
            files: names.iter().map(|name| path.join(name)).collect(),
            path,
        })
    }
}

impl From<OsString> for Output {
    fn from(path: OsString) -> Self {
        let path = PathBuf::from(path);
        Self { files: vec![path.clone()], path }
    }
}

impl Deref for Output {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.path
    }
}

impl AsRef<Path> for Output {
    fn as_ref(&self) -> &Path {
        &self.path
    }
}

/// Refuses a command line whose verb would replace one of its inputs.
pub(crate) fn check(matches: &ArgMatches) -> anyhow::Result<()> {
    let mut verb = matches;
    while let Some((_, inner)) = verb.subcommand() {
        verb = inner;
    }
    let inputs = values::<PathBuf>(verb);
    let libraries = values::<(Platform, PathBuf)>(verb).into_iter().map(|(_, path)| path);
    let inputs = inputs.into_iter().chain(libraries);
    let inputs: Vec<PathBuf> = inputs.map(|path| model_file::file_of(&path)).collect();
    let outputs = values::<Output>(verb).into_iter().flat_map(|output| output.files);
    Ok(refuse_inputs(outputs, &inputs)?)
}

/// The values of all arguments of one type.
fn values<T: Clone + Send + Sync + 'static>(matches: &ArgMatches) -> Vec<T> {
    let ids = matches.ids();
    let given = ids.filter_map(|id| matches.try_get_many::<T>(id.as_str()).ok().flatten());
    given.flatten().cloned().collect()
}
