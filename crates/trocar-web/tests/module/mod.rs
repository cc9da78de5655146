//! The module in an interpreter, driven as a page drives it.

use std::error::Error;
use std::path::{Path, PathBuf};

use trocar_model::Trocar;
use wasmi::{Engine, Instance, Linker, Memory, Module, Store, TypedFunc, WasmParams, WasmResults};

/// Columns of the block.
const POSITION: usize = 0;
const DURATION: usize = 1;
const ANGLE: usize = 2;
const FORCE: usize = 3;
const DEFLECTION: usize = 4;
const TORQUE: usize = 6;

/// The artefact that reports carry.
pub(crate) fn artefact() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../trocar-report/src/assets/model.wasm")
}

/// A running module.
pub(crate) struct Page {
    store: Store<()>,
    instance: Instance,
    memory: Memory,
}

impl Page {
    /// Starts the module in `file`.
    pub(crate) fn start(file: &Path) -> Result<Self, Box<dyn Error>> {
        let engine = Engine::default();
        let module = Module::new(&engine, &std::fs::read(file)?[..])?;
        let mut store = Store::new(&engine, ());
        let instance = Linker::new(&engine).instantiate_and_start(&mut store, &module)?;
        let memory = instance.get_memory(&store, "memory").ok_or("no memory")?;
        Ok(Self { store, instance, memory })
    }

    /// Calls an export.
    pub(crate) fn call<P: WasmParams, R: WasmResults>(
        &mut self,
        name: &str,
        with: P,
    ) -> Result<R, Box<dyn Error>> {
        let export: TypedFunc<P, R> = self.instance.get_typed_func(&self.store, name)?;
        Ok(export.call(&mut self.store, with)?)
    }

    fn write(&mut self, address: usize, values: &[f64]) -> Result<(), Box<dyn Error>> {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        Ok(self.memory.write(&mut self.store, address, &bytes)?)
    }

    fn read(&self, address: usize, count: usize) -> Result<Vec<f64>, Box<dyn Error>> {
        let mut bytes = vec![0; 8 * count];
        self.memory.read(&self.store, address, &mut bytes)?;
        Ok(bytes
            .chunks_exact(8)
            .map(|b| f64::from_le_bytes(b.try_into().expect("eight")))
            .collect())
    }

    /// Loads a row of numbers; whether they are a model.
    pub(crate) fn load_row(&mut self, row: &[f64]) -> Result<bool, Box<dyn Error>> {
        let address: u32 = self.call("row", ())?;
        self.write(address as usize, row)?;
        Ok(self.call::<u32, u32>("load", row.len() as u32)? == 1)
    }

    /// Loads a model.
    pub(crate) fn load(&mut self, trocar: &Trocar<&[f64]>) -> Result<(), Box<dyn Error>> {
        let mut row = vec![0.0; trocar.count_numbers()];
        trocar.write_numbers(&mut row)?;
        if self.load_row(&row)? {
            Ok(())
        } else {
            Err("the module reads no model from the row".into())
        }
    }

    /// Turns the tunables; whether they make a model.
    pub(crate) fn tune(&mut self, values: &[f64]) -> Result<bool, Box<dyn Error>> {
        let address: u32 = self.call("values", ())?;
        self.write(address as usize, values)?;
        Ok(self.call::<u32, u32>("tune", values.len() as u32)? == 1)
    }

    /// Force (N) and deflection (m) at every row of a motion, time (s) and position (m), from rest
    /// at the first.
    pub(crate) fn drive(
        &mut self,
        motion: &[(f64, f64)],
    ) -> Result<Vec<(f64, f64)>, Box<dyn Error>> {
        let Some(first) = motion.first() else { return Ok(Vec::new()) };
        let mut all = vec![(self.call("rest", first.1)?, 0.0)];
        let steps: Vec<(f64, f64)> =
            motion.windows(2).map(|pair| (pair[1].1, pair[1].0 - pair[0].0)).collect();
        all.extend(self.drive_on(&steps)?);
        Ok(all)
    }

    /// Force (N) and torque (N·m) after steps, no more than a block: position (m), duration (s), angle (rad).
    #[allow(dead_code)] // the example does not turn
    pub(crate) fn turn(&mut self, steps: &[[f64; 3]]) -> Result<Vec<(f64, f64)>, Box<dyn Error>> {
        let length = self.call::<(), u32>("block_length", ())? as usize;
        let block = self.call::<(), u32>("block", ())? as usize;
        for (at, column) in [POSITION, DURATION, ANGLE].into_iter().enumerate() {
            let values: Vec<f64> = steps.iter().map(|step| step[at]).collect();
            self.write(block + 8 * length * column, &values)?;
        }
        let made = self.call::<u32, u32>("run", steps.len() as u32)? as usize;
        let forces = self.read(block + 8 * length * FORCE, made)?;
        Ok(forces.into_iter().zip(self.read(block + 8 * length * TORQUE, made)?).collect())
    }

    /// The same for steps, position (m) and duration (s), from the present state.
    pub(crate) fn drive_on(
        &mut self,
        steps: &[(f64, f64)],
    ) -> Result<Vec<(f64, f64)>, Box<dyn Error>> {
        let mut all = Vec::new();
        let length = self.call::<(), u32>("block_length", ())? as usize;
        let block = self.call::<(), u32>("block", ())? as usize;
        let column = |number: usize| block + 8 * length * number;
        for some in steps.chunks(length) {
            let (positions, durations): (Vec<f64>, Vec<f64>) = some.iter().copied().unzip();
            self.write(column(POSITION), &positions)?;
            self.write(column(DURATION), &durations)?;
            let made: u32 = self.call("run", some.len() as u32)?;
            let forces = self.read(column(FORCE), made as usize)?;
            let deflections = self.read(column(DEFLECTION), made as usize)?;
            all.extend(forces.into_iter().zip(deflections));
        }
        Ok(all)
    }
}

/// Time and position of every row of a CSV file with these as its first columns.
pub(crate) fn read_motion(path: &Path) -> Result<Vec<(f64, f64)>, Box<dyn Error>> {
    let text = std::fs::read_to_string(path)?;
    let row = |line: &str| -> Result<(f64, f64), Box<dyn Error>> {
        let (time, rest) = line.split_once(',').ok_or("a row has fewer than two columns")?;
        Ok((time.parse()?, rest.split(',').next().unwrap_or(rest).parse()?))
    };
    text.lines().skip(1).map(row).collect()
}
