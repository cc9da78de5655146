//! Models as arguments: lists of friction models (`ems,lugre,gms:4-10`), and model files.

use std::path::{Path, PathBuf};

use trocar::compare::Choice;
use trocar::draws;
use trocar::model_file::ModelFile;
use trocar_model::Stages;

use crate::console::BadArgument;

/// Models given on the command line, without duplicates.
#[derive(Debug, Clone)]
pub(crate) struct Models(pub(crate) Vec<Choice>);

/// Parses a list; duplicates count once.
pub(crate) fn models(text: &str) -> Result<Models, String> {
    Choice::list(text).map(Models)
}

/// The default seal of the bench, as a model on the command line.
pub(crate) const PLAUSIBLE: &str = "plausible";

/// The model at `path`: a file, the folder of a result, or `plausible`. If it is none and one of the
/// recordings is, the arguments were exchanged.
pub(crate) fn read_model(path: &Path, recordings: &[PathBuf]) -> anyhow::Result<ModelFile> {
    if path == Path::new(PLAUSIBLE) && !path.exists() {
        return Ok(ModelFile::plausible_10_5_mm()?);
    }
    let error = match ModelFile::read(path) {
        Ok(model) => return Ok(model),
        Err(error) => error,
    };
    if let Some(model) =
        recordings.iter().find(|other| is_small(other) && ModelFile::read(other).is_ok())
    {
        let (path, model) = (path.display(), model.display());
        let text = format!(
            "{path} is no model, but {model} is\n\nhint: give the model first: {model} {path}"
        );
        return Err(BadArgument(text).into());
    }
    if path.is_dir() {
        Err(BadArgument(folder_without_model(path)).into())
    } else {
        Err(error.into())
    }
}

/// The posterior draws in the file `path` of the parameters of `model`, the file `of`.
pub(crate) fn read_draws(
    path: &Path,
    (model, of): (&ModelFile, &Path),
) -> anyhow::Result<Vec<Stages>> {
    model.stages().map_err(|error| error.in_file(of))?;
    Ok(draws::read_models(path)?)
}

/// Whether it may be a model: a recording is not read just to see that it is none.
fn is_small(path: &Path) -> bool {
    std::fs::metadata(path)
        .is_ok_and(|data| data.is_dir() || (data.is_file() && data.len() < 1_000_000))
}

fn folder_without_model(folder: &Path) -> String {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut models: Vec<String> = entries
        .map(|entry| entry.path())
        .filter(|path| {
            path.extension().is_some_and(|ending| ending == "json") && ModelFile::read(path).is_ok()
        })
        .map(|path| path.display().to_string())
        .collect();
    models.sort_unstable();
    let folder = folder.display();
    match models.len() {
        0 => format!(
            "{folder}: a folder without model.json, expected a model file or the folder of a result"
        ),
        _ => format!(
            "{folder}: a folder without model.json\n\nhint: give one of its models: {}",
            models.join(", ")
        ),
    }
}
