//! The loop of `trocar::teleop` for a page: a WebAssembly module that knows text and numbers alone.
//!
//! The module has one loop, and three places in its memory that the page fills and reads:
//!
//! ```text
//! text     the configuration as JSON, with the keys of `trocar teleop --print-config`; why it was refused
//! row      the models of trocar and compensator, one after the other, as trocar_model::flat writes them
//! block    columns of BLOCK numbers: intended position of the hand at the end of a sample (m) in; what the loop
//!          was at its beginning out, in the order of [`COLUMNS`]
//! ```
//! | export | what it does | returns |
//! |---|---|---|
//! | `text()`, `row()`, `block()` | | address |
//! | `text_length()`, `row_length()`, `block_length()` | | most bytes, numbers, samples |
//! | `start(t, n, m, x)` | a loop at rest at x, m, from t bytes of the text and n and m numbers of the row | 1, or 0: there is none |
//! | `message()` | | bytes of the text that say why the last start was refused |
//! | `run(n)` | the first n samples of the block | samples made; fewer where the loop diverged |
//! | `settles()` | | 1 where the loop comes to rest after pushes and pulls, `trocar::teleop::stability` |
//! | `figures()` | puts [`FIGURES`] of all samples so far into the block | how many |
//!
//! A start that is refused leaves no loop. The script `build` makes the module; the report of `trocar teleop` carries it.
//!
//! - **Invariant:** no step but [`Loop::step`]: the same hand gives the samples of every other program.

#[cfg(target_arch = "wasm32")]
mod exports;

use std::fmt::Display;

use trocar::option::{Interface, spelt};
use trocar::teleop::merit::Merit;
use trocar::teleop::stability::Disturbance;
use trocar::teleop::{Config, Loop, Sample};
use trocar_model::Trocar;

/// Most bytes of a configuration.
pub const TEXT: usize = 16_384;
/// Most numbers of both models: any two, with some ten thousand knots over the position each.
pub const ROW: usize = 2 * 24_576;
/// Most samples of one [`Page::run`].
pub const BLOCK: usize = 1_024;

/// A column of the block: its name and what it holds of a sample.
type BlockColumn = (&'static str, fn(&Config, &Sample) -> f64);

/// What the block holds after a run, in this order.
pub const COLUMNS: [BlockColumn; 7] = [
    ("hand_position_m", |_, s| s.hand_position),
    ("leader_position_m", |_, s| s.leader_position),
    ("follower_position_m", |_, s| s.follower_position),
    ("felt_force_n", Config::felt),
    ("trocar_force_n", |_, s| s.trocar_force),
    ("tissue_force_n", |_, s| s.tissue_force),
    ("estimate_n", |_, s| s.estimate),
];

/// A figure of merit: its name and value; NaN where there is none.
type Figure = (&'static str, fn(&Merit) -> f64);

/// What the block holds after `figures`, in this order.
pub const FIGURES: [Figure; 4] = [
    ("displayed_stiffness_n_m", |m| m.displayed_stiffness_n_m.unwrap_or(f64::NAN)),
    ("true_stiffness_n_m", |m| m.true_stiffness_n_m.unwrap_or(f64::NAN)),
    ("force_error_rms_n", |m| m.force_error_rms_n),
    ("force_error_rms_jnd", |m| m.force_error_rms_jnd),
];

/// The places that a page fills and reads.
#[derive(Debug)]
pub struct Memory {
    /// Configuration, or why it was refused.
    pub text: [u8; TEXT],
    /// Models of trocar and compensator.
    pub row: [f64; ROW],
    /// [`COLUMNS`].
    pub block: [[f64; BLOCK]; COLUMNS.len()],
}

impl Memory {
    /// All zero.
    pub const ZERO: Self =
        Self { text: [0; TEXT], row: [0.0; ROW], block: [[0.0; BLOCK]; COLUMNS.len()] };
}

/// The loop of a page.
#[derive(Debug)]
pub struct Page {
    running: Option<Running>,
    /// Bytes of the message in [`Memory::text`].
    message: usize,
}

#[derive(Debug)]
struct Running {
    config: Config,
    trocar: Trocar<Vec<f64>>,
    compensator: Trocar<Vec<f64>>,
    teleop: Loop<Vec<f64>>,
    /// All so far.
    samples: Vec<Sample>,
    /// Where the hand is, m.
    hand: f64,
}

impl Page {
    /// Without a loop.
    pub const EMPTY: Self = Self { running: None, message: 0 };

    /// A loop at rest at `position` (m), from `length` bytes of the text and from the models of trocar and compensator with so many
    /// numbers; whether there is one.
    pub fn start(
        &mut self,
        memory: &mut Memory,
        length: usize,
        models: [usize; 2],
        position: f64,
    ) -> bool {
        let text = memory.text.get(..length).unwrap_or_default();
        match begin(text, &memory.row, models, position) {
            Ok(running) => *self = Self { running: Some(running), message: 0 },
            Err(why) => {
                let said = &why.as_bytes()[..why.len().min(TEXT)];
                memory.text[..said.len()].copy_from_slice(said);
                *self = Self { running: None, message: said.len() };
            }
        }
        self.running.is_some()
    }

    /// Bytes of the text that say why the last start was refused.
    pub fn message(&self) -> usize {
        self.message
    }

    /// Makes the first `count` samples of the block; how many were made.
    pub fn run(&mut self, memory: &mut Memory, count: usize) -> usize {
        let Some(running) = &mut self.running else { return 0 };
        let count = count.min(BLOCK);
        for k in 0..count {
            let Some(sample) = running.step(memory.block[0][k]) else { return k };
            for (column, (_, of)) in memory.block.iter_mut().zip(COLUMNS) {
                column[k] = of(&running.config, &sample);
            }
        }
        count
    }

    /// Whether the loop comes to rest after pushes and pulls; false without a loop.
    pub fn settles(&self) -> bool {
        let Some(Running { config, trocar, compensator, .. }) = &self.running else { return false };
        Disturbance::unsettling(config, [compensator, trocar]).is_ok_and(|by| by.is_none())
    }

    /// Puts [`FIGURES`] of all samples so far into the block; how many.
    pub fn figures(&self, memory: &mut Memory) -> usize {
        let Some(Running { config, samples, .. }) = &self.running else { return 0 };
        let merit = Merit::of(config, samples);
        for (place, (_, of)) in memory.block[0].iter_mut().zip(FIGURES) {
            *place = of(&merit);
        }
        FIGURES.len()
    }
}

impl Running {
    /// One sample, over which the hand moves evenly to `to`, m; nothing once the loop has diverged.
    fn step(&mut self, to: f64) -> Option<Sample> {
        let duration = self.config.sample_time_s;
        let (from, begin) = (self.hand, self.samples.len() as f64 * duration);
        let velocity = (to - from) / duration;
        let sample = self.teleop.step(|time| (from + velocity * (time - begin), velocity)).ok()?;
        self.hand = to;
        self.samples.push(sample);
        Some(sample)
    }
}

fn begin(
    text: &[u8],
    row: &[f64; ROW],
    [trocar, compensator]: [usize; 2],
    position: f64,
) -> Result<Running, String> {
    let config: Config = serde_json::from_slice(text).map_err(in_words)?;
    let numbers = |from: usize, count: usize| row.get(from..from.checked_add(count)?);
    let model = |numbers: Option<&[f64]>| {
        let numbers =
            numbers.ok_or_else(|| "too many numbers for the memory of the page".to_owned())?;
        let trocar = Trocar::from_numbers(numbers).map_err(in_words)?;
        Ok::<_, String>(trocar.stored_as(<[f64]>::to_vec))
    };
    let (trocar, compensator) = (model(numbers(0, trocar))?, model(numbers(trocar, compensator))?);
    let teleop =
        Loop::new(&config, trocar.clone(), compensator.clone(), position).map_err(in_words)?;
    Ok(Running { config, trocar, compensator, teleop, samples: Vec::new(), hand: position })
}

fn in_words(error: impl Display) -> String {
    spelt(&error.to_string(), Interface::CommandLine)
}
