//! The models of `trocar-model` for a page: a WebAssembly module that knows numbers alone.
//!
//! The module has one model, its state, and three places in its memory that the page fills and
//! reads:
//!
//! ```text
//! row      a model as trocar_model::flat writes it
//! values   the numbers of trocar_model::tuning, in their order
//! block    columns of BLOCK numbers: position (m), duration (s), angle (rad) in; force (N), deflection (m), sliding (0 or 1),
//!          torque (N m) out
//! ```
//! | export | what it does | returns |
//! |---|---|---|
//! | `row()`, `values()`, `block()` | | address |
//! | `row_length()`, `values_length()`, `block_length()` | | most numbers, steps |
//! | `load(n)` | reads the model from the first n numbers of the row; at rest at 0 | 1, or 0: there is none |
//! | `tune(n)` | the loaded model with the first n values; at rest where it was, with the force it had | 1, or 0: as before |
//! | `rest(x)` | undeformed at rest at x, m, and at the angle 0 | force, N |
//! | `rest_at_force(x, f)` | at rest at x with f, N, or what of it the model can hold | force, N |
//! | `run(n)` | the first n steps of the block | steps made |
//!
//! A call that fails changes nothing. Deflection and sliding of a model that knows none are NaN; one without rotation heeds no
//! angle.
//! The script `build` makes the module; the reports of the crate `trocar` carry it.
//!
//! - **Invariant:** no step but [`Trocar::turn_to`]: the forces are those of every other program, to the last bit.
#![no_std]

#[cfg(target_arch = "wasm32")]
mod exports;

use trocar_model::tuning::MAX_TUNABLES;
use trocar_model::{Mode, Seal, Trocar, TrocarState};

/// Most numbers of a model's row: any model, with some ten thousand knots over the position.
pub const ROW: usize = 24_576;
/// Most steps of one [`Page::run`].
pub const BLOCK: usize = 1_024;

/// Columns of the block.
pub const COLUMNS: usize = 7;

/// The places that a page fills and reads.
#[derive(Debug)]
pub struct Memory {
    /// A model as numbers.
    pub row: [f64; ROW],
    /// Its tunables.
    pub values: [f64; MAX_TUNABLES],
    /// Position (m), duration (s), angle (rad), force (N), deflection (m), sliding, torque (N·m).
    pub block: [[f64; BLOCK]; COLUMNS],
}

impl Memory {
    /// All zero: apart from the model, so that the module need not carry it.
    pub const ZERO: Self =
        Self { row: [0.0; ROW], values: [0.0; MAX_TUNABLES], block: [[0.0; BLOCK]; COLUMNS] };
}

/// The model of a page and its state.
#[derive(Debug)]
pub struct Page {
    /// Numbers of the row that are the model.
    count: usize,
    running: Running,
}

/// Laid out so that nothing is all zero, which the module need not carry.
#[repr(u8)]
#[derive(Debug)]
#[allow(clippy::large_enum_variant)] // one a module
enum Running {
    Nothing,
    Model { loaded: Seal, tuned: Seal, state: TrocarState },
}

impl Page {
    /// Without a model.
    pub const EMPTY: Self = Self { count: 0, running: Running::Nothing };

    /// Reads the model from the first `count` numbers of the row; whether there is one.
    pub fn load(&mut self, memory: &Memory, count: usize) -> bool {
        let Some(trocar) = read(&memory.row, count) else { return false };
        let (state, seal) = (trocar.rest(0.0), *trocar.seal());
        *self = Self { count, running: Running::Model { loaded: seal, tuned: seal, state } };
        true
    }

    /// Turns the tunables of the loaded model to the first `count` values; whether they make a
    /// model.
    pub fn tune(&mut self, memory: &Memory, count: usize) -> bool {
        let Running::Model { loaded, tuned, state } = &mut self.running else { return false };
        let Some(new) = memory.values.get(..count).and_then(|values| loaded.tuned(values).ok())
        else {
            return false;
        };
        *tuned = new;
        let (position, force) = (state.position(), state.force());
        self.rest_at_force(memory, position, force);
        true
    }

    /// Undeformed at rest at `position`, m; the force, N.
    pub fn rest(&mut self, memory: &Memory, position: f64) -> f64 {
        self.begin(memory, |trocar| trocar.rest(position))
    }

    /// At rest at `position` (m) with `force` (N) or what of it the model can hold; the force, N.
    pub fn rest_at_force(&mut self, memory: &Memory, position: f64, force: f64) -> f64 {
        self.begin(memory, |trocar| trocar.rest_at_force(position, force))
    }

    fn begin(
        &mut self,
        memory: &Memory,
        at_rest: impl FnOnce(&Trocar<&[f64]>) -> TrocarState,
    ) -> f64 {
        let Running::Model { tuned, state, .. } = &mut self.running else { return f64::NAN };
        let Some(trocar) = read(&memory.row, self.count) else { return f64::NAN };
        *state = at_rest(&trocar.with_seal(*tuned));
        state.force()
    }

    /// Makes the first `count` steps of the block; how many were made.
    pub fn run(&mut self, memory: &mut Memory, count: usize) -> usize {
        let Memory { row, block, .. } = memory;
        let Running::Model { tuned, state, .. } = &mut self.running else { return 0 };
        let Some(trocar) = read(row, self.count) else { return 0 };
        let trocar = trocar.with_seal(*tuned);
        let [position, duration, angle, force, deflection, sliding, torque] = block;
        let count = count.min(BLOCK);
        for k in 0..count {
            force[k] = trocar.turn_to(state, position[k], angle[k], duration[k]);
            (deflection[k], sliding[k]) =
                state.deformation().map_or((f64::NAN, f64::NAN), |deformation| {
                    (deformation.deflection, f64::from(u8::from(deformation.mode == Mode::Sliding)))
                });
            torque[k] = state.torque();
        }
        count
    }
}

fn read(row: &[f64; ROW], count: usize) -> Option<Trocar<&[f64]>> {
    Trocar::from_numbers(row.get(..count)?).ok()
}
