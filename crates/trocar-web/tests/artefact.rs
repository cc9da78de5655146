//! The module that reports carry against the library: the same forces, to the last bit.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

use trocar::model_file::ModelFile;
use trocar_model::{Rotation, Trocar};

use module::{Page, artefact, read_motion};
use skipped::skipped;

mod module;
#[path = "../../trocar-model/tests/common/skipped.rs"]
mod skipped;

/// Largest module that a report may carry, bytes: a tenth of a report, before compression. The declarations of all parameters, which
/// turning them checks, took it from 61 to 73 kB, the Bouc–Wen model to 79,
/// the step of a turning instrument to 100.
const LARGEST: u64 = 104_000;
/// Fewest models to compare on: one of every kind.
const KINDS: usize = 15;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn models() -> Result<Vec<(String, ModelFile)>, Box<dyn Error>> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(repository().join("conformance/models"))?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<_, _>>()?;
    paths.sort();
    let name = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    paths.into_iter().map(|path| Ok((name(&path), ModelFile::read(&path)?))).collect()
}

fn motion() -> Result<Vec<(f64, f64)>, Box<dyn Error>> {
    read_motion(&repository().join("conformance/motion.csv"))
}

/// Force and deflection by the library.
fn host(trocar: &Trocar<&[f64]>, motion: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut state = trocar.rest(motion[0].1);
    let mut all = vec![(state.force(), 0.0)];
    for pair in motion.windows(2) {
        let force = trocar.step_to(&mut state, pair[1].1, pair[1].0 - pair[0].0);
        all.push((
            force,
            state.deformation().map_or(f64::NAN, |deformation| deformation.deflection),
        ));
    }
    all
}

fn assert_same(name: &str, ours: &[(f64, f64)], theirs: &[(f64, f64)]) {
    assert_eq!(ours.len(), theirs.len(), "{name}");
    let same = |a: f64, b: f64| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
    let differs = ours.iter().zip(theirs).position(|(a, b)| !same(a.0, b.0) || !same(a.1, b.1));
    if let Some(row) = differs {
        panic!(
            "{name}, row {row}: {:?} N and m by the library, {:?} by the module; after a change of trocar-model run \
             crates/trocar-web/build",
            ours[row], theirs[row]
        );
    }
}

fn compare(file: &Path) -> Result<(), Box<dyn Error>> {
    let (models, motion) = (models()?, motion()?);
    assert!(
        models.len() >= KINDS && motion.len() > 1000,
        "{} models, {} rows",
        models.len(),
        motion.len()
    );
    let mut page = Page::start(file)?;
    for (name, model) in &models {
        let trocar = model.trocar.borrowed();
        page.load(&trocar)?;
        assert_same(name, &host(&trocar, &motion), &page.drive(&motion)?);
        // Every tunable by itself, and all at once.
        let tunables: Vec<_> = trocar.seal().tunables().collect();
        let turned = |k: usize| {
            1.125 * tunables[k].value
                + if tunables[k].id.declaration().range.excludes_least() { 0.0 } else { 1e-3 }
        };
        let identified: Vec<f64> = tunables.iter().map(|tunable| tunable.value).collect();
        let some = &motion[..motion.len() / 8];
        for k in 0..=tunables.len() {
            let chosen =
                |i: usize| if i == k || k == tunables.len() { turned(i) } else { identified[i] };
            let values: Vec<f64> = (0..tunables.len()).map(chosen).collect();
            let seal = trocar.seal().tuned(&values);
            assert_eq!(page.tune(&values)?, seal.is_ok(), "{name}, tunable {k}: {seal:?}");
            if let Ok(seal) = seal {
                assert_same(
                    &format!("{name}, tunable {k}"),
                    &host(&trocar.with_seal(seal), some),
                    &page.drive(some)?,
                );
            }
        }
        assert!(page.tune(&identified)?);
        assert_same(&format!("{name}, turned back"), &host(&trocar, some), &page.drive(some)?);
    }
    Ok(())
}

#[test]
fn the_module_of_the_reports_gives_the_forces_of_the_library() -> Result<(), Box<dyn Error>> {
    compare(&artefact())
}

/// Strokes while the instrument turns to and fro.
#[test]
fn the_module_turns_as_the_library_does() -> Result<(), Box<dyn Error>> {
    let mut page = Page::start(&artefact())?;
    let models = models()?;
    let rotation = Rotation {
        shaft_radius: 5e-3,
        circumferential_stiffness: 400.0,
        circumferential_ratio: 0.8,
    };
    let mut turned = 0;
    for (name, model) in &models {
        // Classical models stay along the axis.
        let Ok(trocar) = model.trocar.borrowed().with_rotation(Some(rotation)) else { continue };
        page.load(&trocar)?;
        let steps: Vec<[f64; 3]> = (1..1000)
            .map(|k| {
                let time = 1e-3 * f64::from(k);
                [0.02 * (9.0 * time).sin(), 1e-3, 2.0 * (7.0 * time).sin()]
            })
            .collect();
        page.call::<f64, f64>("rest", 0.0)?;
        let ours = page.turn(&steps)?;
        let mut state = trocar.rest(0.0);
        let theirs: Vec<(f64, f64)> = steps
            .iter()
            .map(|[x, duration, angle]| {
                let force = trocar.turn_to(&mut state, *x, *angle, *duration);
                (force, state.torque())
            })
            .collect();
        assert_same(name, &theirs, &ours);
        assert!(theirs.iter().any(|(_, torque)| torque.abs() > 1e-3), "{name}");
        turned += 1;
    }
    assert!(turned > 3, "{turned} models");
    Ok(())
}

#[test]
fn the_module_of_the_reports_is_small() -> Result<(), Box<dyn Error>> {
    let size = std::fs::metadata(artefact())?.len();
    assert!(size <= LARGEST, "{size} bytes");
    Ok(())
}

#[test]
fn what_is_no_model_is_refused_and_changes_nothing() -> Result<(), Box<dyn Error>> {
    let mut page = Page::start(&artefact())?;
    assert!(page.call::<f64, f64>("rest", 0.1)?.is_nan(), "no model, no force");
    assert_eq!(page.call::<u32, u32>("run", 10)?, 0);
    let (models, motion) = (models()?, motion()?);
    let (_, model) = models.iter().find(|(name, _)| name == "ems").ok_or("no EMS model")?;
    let trocar = model.trocar.borrowed();
    page.load(&trocar)?;
    assert!(!page.load_row(&[7.0; 20])?, "a row of another form");
    assert!(!page.tune(&[-0.008])?, "a negative half width");
    assert_eq!(page.call::<u32, u32>("load", u32::MAX)?, 0);
    assert_eq!(page.call::<u32, u32>("tune", u32::MAX)?, 0);
    page.load(&trocar)?;
    let length = page.call::<(), u32>("block_length", ())?;
    assert_eq!(
        page.call::<u32, u32>("run", u32::MAX)?,
        length,
        "no more steps than there is room for"
    );
    assert_same("ems", &host(&trocar, &motion), &page.drive(&motion)?);
    Ok(())
}

#[test]
fn turning_a_parameter_keeps_place_and_force() -> Result<(), Box<dyn Error>> {
    let (models, motion) = (models()?, motion()?);
    let (_, model) =
        models.iter().find(|(name, _)| name == "ems_profile").ok_or("no model with a profile")?;
    let trocar = model.trocar.borrowed();
    let mut page = Page::start(&artefact())?;
    page.load(&trocar)?;
    let (force, _) = *page.drive(&motion[..500])?.last().ok_or("no row")?;
    let mut values: Vec<f64> = trocar.seal().tunables().map(|tunable| tunable.value).collect();
    values[4] += 10.0; // viscous: the seal at rest holds what it held
    assert!(page.tune(&values)?);
    let here = motion[499];
    let again = page.drive_on(&[(here.1, 1e-3)])?;
    let (state, seal) = (trocar.rest_at_force(here.1, force), trocar.seal().tuned(&values)?);
    let mut state = trocar.with_seal(seal).rest_at_force(state.position(), state.force());
    assert_eq!(
        trocar.with_seal(seal).step_to(&mut state, here.1, 1e-3).to_bits(),
        again[0].0.to_bits()
    );
    Ok(())
}

/// The committed module may come from another compiler, but not from other sources.
#[test]
fn a_fresh_build_gives_the_same_forces() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("model.wasm");
    let built =
        Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("build")).arg(&folder).output()?;
    match built.status.code() {
        Some(0) => compare(&folder),
        Some(2) => {
            skipped(&String::from_utf8_lossy(&built.stderr));
            Ok(())
        }
        _ => Err(String::from_utf8_lossy(&built.stderr).into()),
    }
}
