//! The module that the report of `trocar teleop` carries against the library: the same loop, to the last bit.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

use trocar::model_file::ModelFile;
use trocar::teleop::config::{Architecture, Config, OnLoss};
use trocar_model::Trocar;
use trocar_web_teleop::{COLUMNS, FIGURES, Memory, Page};
use wasmi::{Engine, Instance, Linker, Module, Store, TypedFunc, WasmParams, WasmResults};

use skipped::skipped;

#[path = "../../trocar-model/tests/common/skipped.rs"]
mod skipped;

/// Largest module that a report may carry, bytes. Half of it reads the configuration and says what is wrong with it; a model that
/// turns takes 20 kB.
const LARGEST: u64 = 395_000;
/// Rounding of a sine in another library, m.
const SINE: f64 = 1e-9;
/// Samples of a run: more than a block.
const SAMPLES: usize = 1_500;

fn artefact() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../trocar-report/src/assets/teleop.wasm")
}

/// All columns of some samples.
type Columns = Vec<Vec<f64>>;

/// A running module, driven as a page drives it.
struct Driven {
    store: Store<()>,
    instance: Instance,
}

impl Driven {
    fn start(file: &Path) -> Result<Self, Box<dyn Error>> {
        let engine = Engine::default();
        let module = Module::new(&engine, &std::fs::read(file)?[..])?;
        let mut store = Store::new(&engine, ());
        let instance = Linker::new(&engine).instantiate_and_start(&mut store, &module)?;
        Ok(Self { store, instance })
    }

    fn call<P: WasmParams, R: WasmResults>(
        &mut self,
        name: &str,
        with: P,
    ) -> Result<R, Box<dyn Error>> {
        let export: TypedFunc<P, R> = self.instance.get_typed_func(&self.store, name)?;
        Ok(export.call(&mut self.store, with)?)
    }

    fn write(&mut self, place: &str, bytes: &[u8]) -> Result<(), Box<dyn Error>> {
        let address = self.call::<(), u32>(place, ())? as usize;
        let memory = self.instance.get_memory(&self.store, "memory").ok_or("no memory")?;
        Ok(memory.write(&mut self.store, address, bytes)?)
    }

    fn read(&mut self, place: &str, from: usize, count: usize) -> Result<Vec<u8>, Box<dyn Error>> {
        let address = self.call::<(), u32>(place, ())? as usize;
        let memory = self.instance.get_memory(&self.store, "memory").ok_or("no memory")?;
        let mut bytes = vec![0; count];
        memory.read(&self.store, address + from, &mut bytes)?;
        Ok(bytes)
    }

    fn numbers(&mut self, from: usize, count: usize) -> Result<Vec<f64>, Box<dyn Error>> {
        let bytes = self.read("block", 8 * from, 8 * count)?;
        let number = |b: &[u8]| f64::from_le_bytes(b.try_into().expect("eight"));
        Ok(bytes.chunks_exact(8).map(number).collect())
    }

    /// Begins a loop; why there is none.
    fn begin(&mut self, config: &str, row: &[f64], at: f64) -> Result<String, Box<dyn Error>> {
        self.write("text", config.as_bytes())?;
        self.write("row", &row.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
        let half = row.len() as u32 / 2;
        if self.call::<_, u32>("start", (config.len() as u32, half, half, at))? == 1 {
            return Ok(String::new());
        }
        let length = self.call::<(), u32>("message", ())? as usize;
        Ok(String::from_utf8(self.read("text", 0, length)?)?)
    }

    /// All columns of the samples along these positions of the hand, and the figures.
    fn along(&mut self, hands: &[f64]) -> Result<(Columns, Vec<f64>), Box<dyn Error>> {
        let length = self.call::<(), u32>("block_length", ())? as usize;
        let mut columns = vec![Vec::new(); COLUMNS.len()];
        for some in hands.chunks(length) {
            self.write("block", &some.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
            let made = self.call::<u32, u32>("run", some.len() as u32)? as usize;
            for (k, column) in columns.iter_mut().enumerate() {
                column.extend(self.numbers(k * length, made)?);
            }
        }
        assert_eq!(self.call::<(), u32>("figures", ())? as usize, FIGURES.len());
        Ok((columns, self.numbers(0, FIGURES.len())?))
    }
}

/// The same by the library.
fn host(config: &str, row: &[f64], at: f64, hands: &[f64]) -> (Columns, Vec<f64>, bool) {
    let mut memory = Box::new(Memory::ZERO);
    let mut page = Page::EMPTY;
    memory.text[..config.len()].copy_from_slice(config.as_bytes());
    memory.row[..row.len()].copy_from_slice(row);
    assert!(page.start(&mut memory, config.len(), [row.len() / 2; 2], at));
    let mut columns = vec![Vec::new(); COLUMNS.len()];
    for some in hands.chunks(memory.block[0].len()) {
        memory.block[0][..some.len()].copy_from_slice(some);
        let made = page.run(&mut memory, some.len());
        for (column, found) in columns.iter_mut().zip(&memory.block) {
            column.extend(&found[..made]);
        }
    }
    let count = page.figures(&mut memory);
    (columns, memory.block[0][..count].to_vec(), page.settles())
}

/// The plausible seal twice: in the trocar, and 10 % weaker in the compensator.
fn row() -> Result<Vec<f64>, Box<dyn Error>> {
    let trocar = ModelFile::plausible_10_5_mm()?.trocar;
    let values: Vec<f64> = trocar.seal().tunables().map(|tunable| tunable.value).collect();
    let force = trocar.seal().tunables().position(|t| t.id.to_string().contains("coulomb"));
    let mut weaker = values;
    weaker[force.ok_or("no Coulomb force")?] *= 0.9;
    let weaker: Trocar<Vec<f64>> = trocar.with_seal(trocar.seal().tuned(&weaker)?);
    let mut row = vec![0.0; 2 * trocar.count_numbers()];
    let (first, second) = row.split_at_mut(trocar.count_numbers());
    trocar.write_numbers(first)?;
    weaker.write_numbers(second)?;
    Ok(row)
}

/// A hand that goes into the tissue and out again, without a sine.
fn hands() -> Vec<f64> {
    let part = |k: usize| (k as f64 / SAMPLES as f64 - 0.5).abs();
    (1..=SAMPLES).map(|k| 0.14 - 0.16 * part(k) * part(k)).collect()
}

fn loops() -> Vec<(&'static str, Config)> {
    let with = |change: &dyn Fn(&mut Config)| {
        let mut config = Config::default();
        config.compensation.fraction = 0.9;
        change(&mut config);
        config
    };
    vec![
        ("position-force", with(&|_| ())),
        (
            "position-position, delay, passivity",
            with(&|c| {
                c.control.architecture = Architecture::PositionPosition;
                (c.channel.delay_s, c.control.passivity) = (0.01, true);
            }),
        ),
        ("four channels", with(&|c| c.control.architecture = Architecture::FourChannel)),
        (
            "waves, jitter and loss",
            with(&|c| {
                c.control.architecture = Architecture::Wave;
                (c.channel.delay_s, c.channel.jitter_s, c.channel.loss) = (0.02, 0.005, 0.1);
                c.channel.on_loss = OnLoss::Zero;
            }),
        ),
        (
            "noise, encoders",
            with(&|c| {
                (c.sensor.noise_n, c.sensor.resolution_n) = (0.05, 0.01);
                (c.leader.encoder_step_m, c.follower.encoder_step_m) = (1e-5, 1e-5);
            }),
        ),
        (
            "a loop that diverges",
            with(&|c| {
                (c.control.stiffness_n_m, c.channel.delay_s) = (2e5, 0.05);
            }),
        ),
    ]
}

fn compare(file: &Path) -> Result<(), Box<dyn Error>> {
    let (mut page, row, hands) = (Driven::start(file)?, row()?, hands());
    let mut diverged = Vec::new();
    for (name, config) in loops() {
        let text = serde_json::to_string(&config)?;
        assert_eq!(page.begin(&text, &row, 0.1)?, "", "{name}");
        let settles = page.call::<(), u32>("settles", ())? == 1;
        let (columns, figures) = page.along(&hands)?;
        let (ours, our_figures, our_verdict) = host(&text, &row, 0.1, &hands);
        assert_eq!(settles, our_verdict, "{name}: settles");
        diverged.extend((columns[0].len() < SAMPLES).then_some(name));
        let same = |a: &f64, b: &f64| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
        for ((column, own), (what, _)) in columns.iter().zip(&ours).zip(COLUMNS) {
            assert_eq!(column.len(), own.len(), "{name}, {what}");
            let differs = column.iter().zip(own).position(|(a, b)| !same(a, b));
            assert_eq!(
                differs.map(|k| (k, column[k], own[k])),
                None,
                "{name}, {what}: sample, module, library; after a change of trocar::teleop run crates/trocar-web-teleop/build"
            );
        }
        assert!(figures.iter().zip(&our_figures).all(|(a, b)| same(a, b)), "{name}: {figures:?}");
    }
    assert!(diverged.contains(&"a loop that diverges") && diverged.len() < 3, "{diverged:?}");
    Ok(())
}

#[test]
fn the_module_of_the_report_gives_the_samples_of_the_library() -> Result<(), Box<dyn Error>> {
    compare(&artefact())
}

#[test]
fn breathing_differs_by_the_rounding_of_a_sine_only() -> Result<(), Box<dyn Error>> {
    let mut config = Config::default();
    (config.tissue.breathing_m, config.tissue.breathing_hz) = (0.005, 0.3);
    let (text, row, hands) = (serde_json::to_string(&config)?, row()?, hands());
    let mut page = Driven::start(&artefact())?;
    assert_eq!(page.begin(&text, &row, 0.1)?, "");
    let (columns, _) = page.along(&hands)?;
    let (ours, _, _) = host(&text, &row, 0.1, &hands);
    let follower = |columns: &[Vec<f64>]| columns[2].clone();
    let far = follower(&columns)
        .iter()
        .zip(follower(&ours))
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    assert!(columns[2].len() == SAMPLES && far < SINE, "{far} m");
    Ok(())
}

#[test]
fn the_module_of_the_report_is_small() -> Result<(), Box<dyn Error>> {
    let size = std::fs::metadata(artefact())?.len();
    assert!(size <= LARGEST, "{size} bytes");
    Ok(())
}

#[test]
fn what_is_no_loop_is_refused_with_the_words_of_the_library() -> Result<(), Box<dyn Error>> {
    let (mut page, row) = (Driven::start(&artefact())?, row()?);
    assert_eq!(page.call::<u32, u32>("run", 10)?, 0, "no loop, no samples");
    let mut config = Config::default();
    config.leader.mass_kg = -1.0;
    let refused = page.begin(&serde_json::to_string(&config)?, &row, 0.1)?;
    assert_eq!(refused, config.check().expect_err("a negative mass").to_string());
    config.leader.mass_kg = 0.5;
    let good = serde_json::to_string(&config)?;
    assert!(page.begin(&good, &vec![7.0; row.len()], 0.1)?.len() > 10, "a row of another form");
    assert!(page.begin("{\"masses\": 1}", &row, 0.1)?.contains("masses"));
    assert_eq!(page.call::<u32, u32>("run", 10)?, 0);
    assert_eq!(page.call::<_, u32>("start", (u32::MAX, 1u32, u32::MAX, 0.0))?, 0);
    assert_eq!(page.begin(&good, &row, 0.1)?, "");
    let length = page.call::<(), u32>("block_length", ())?;
    assert!(page.call::<u32, u32>("run", u32::MAX)? <= length, "no more than there is room for");
    Ok(())
}

/// The committed module may come from another compiler, but not from other sources.
#[test]
fn a_fresh_build_gives_the_same_samples() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("teleop.wasm");
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
