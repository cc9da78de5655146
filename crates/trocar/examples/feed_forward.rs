//! A drive that follows cycles through a trocar, with the model as feed-forward: the table of
//! `docs/how-to/compensation.md`, by `cargo run --release -p trocar --example feed_forward`.
//!
//! ```text
//! m·dv/dt = u − F_seal(x)     u = u_c + γ·F     u_c = k·(x_ref − x) + 2ζ·√(k·m)·(v_ref − v)
//! ```
//! F is the model's force along the reference, or along the measured positions.

use std::f64::consts::TAU;

use trocar::model_file::ModelFile;
use trocar_model::{Trocar, TrocarState};

/// Mass of the drive, kg.
const MASS: f64 = 0.3;
/// Damping ratio of the controller.
const DAMPING_RATIO: f64 = 0.2;
/// Interval of the controller, s.
const INTERVAL: f64 = 1e-3;
/// Steps of the plant within it.
const SUBSTEPS: u32 = 10;
/// Cycles, each of 1 s, and seconds of rest after them.
const CYCLES: f64 = 5.0;
const REST: f64 = 2.0;
/// Half of a stroke, m.
const AMPLITUDE: f64 = 0.02;
/// Friction scale of a wetted seal, which loses most.
const WETTED: f64 = 0.55;
/// Motion at rest, m, from which a drive oscillates.
const SEEN: f64 = 1e-4;

/// A seal with its friction scale λ: λ·F(x/λ).
struct Scaled<'a> {
    trocar: &'a Trocar<Vec<f64>>,
    state: TrocarState,
    scale: f64,
}

impl<'a> Scaled<'a> {
    fn new(trocar: &'a Trocar<Vec<f64>>, scale: f64) -> Self {
        Self { trocar, state: trocar.rest(0.0), scale }
    }

    /// Force, N, at `position`, m, after `duration`, s.
    fn step(&mut self, position: f64, duration: f64) -> f64 {
        self.scale * self.trocar.step_to(&mut self.state, position / self.scale, duration)
    }
}

/// Where the feed-forward takes its motion from.
#[derive(Clone, Copy, PartialEq)]
enum Along {
    Reference,
    Measured,
}

/// A drive with its seal.
#[derive(Clone, Copy)]
struct Drive<'a> {
    trocar: &'a Trocar<Vec<f64>>,
    stiffness: f64,
    scale: f64,
}

impl Drive<'_> {
    /// Error of the position in the last cycles, m rms, and the range of the position in the last
    /// second of the rest, m.
    fn run(self, along: Along, gain: f64) -> [f64; 2] {
        let damping = 2.0 * DAMPING_RATIO * (self.stiffness * MASS).sqrt();
        let mut seal = Scaled::new(self.trocar, self.scale);
        let mut model = Scaled::new(self.trocar, 1.0);
        let ([mut x, mut v], mut squares, mut range) = ([0.0; 2], [0.0; 2], [f64::MAX, f64::MIN]);
        for k in 0..((CYCLES + REST) / INTERVAL) as u32 {
            let time = f64::from(k) * INTERVAL;
            let [reference, rate] = reference(time);
            let position = if along == Along::Reference { reference } else { x };
            let forward = gain * model.step(position, INTERVAL);
            let drive = self.stiffness * (reference - x) + damping * (rate - v) + forward;
            let dt = INTERVAL / f64::from(SUBSTEPS);
            for _ in 0..SUBSTEPS {
                v += dt * (drive - seal.scale * seal.state.force()) / MASS;
                x += dt * v;
                seal.step(x, dt);
            }
            if (2.0..CYCLES).contains(&time) {
                squares = [squares[0] + (reference - x).powi(2), squares[1] + 1.0];
            } else if time >= CYCLES + REST - 1.0 {
                range = [range[0].min(x), range[1].max(x)];
            }
        }
        [(squares[0] / squares[1]).sqrt(), range[1] - range[0]]
    }

    fn error_mm(self, gain: f64) -> String {
        format!("{:.1}", 1e3 * self.run(Along::Reference, gain)[0])
    }

    /// The least γ along measured positions, in quarters up to 1.5, from which on the drive oscillates.
    fn oscillates(self) -> String {
        let all = (1..=6).map(|quarters| 0.25 * f64::from(quarters));
        let mut found = all.map(|gain| (gain, self.run(Along::Measured, gain)[1]));
        found
            .find(|(_, range)| *range > SEEN)
            .map_or("not up to 1.5".to_owned(), |(gain, range)| {
                format!("from {gain:.2} on, by {:.0} mm", 1e3 * range)
            })
    }
}

/// Position, m, and velocity, m/s, of the reference: cycles that begin and end at rest.
fn reference(time: f64) -> [f64; 2] {
    let phase = TAU * time.min(CYCLES);
    [AMPLITUDE * (1.0 - phase.cos()), AMPLITUDE * TAU * phase.sin()]
}

/// The table.
pub(crate) fn table() -> String {
    let file = ModelFile::plausible_10_5_mm().expect("the shipped model is valid");
    let rows = [500.0, 2000.0].map(|stiffness| {
        let dry = Drive { trocar: &file.trocar, stiffness, scale: 1.0 };
        let wetted = Drive { scale: WETTED, ..dry };
        let errors = |drive: Drive, gains: &[f64]| {
            gains.iter().map(|gain| drive.error_mm(*gain)).collect::<Vec<_>>().join(", ")
        };
        format!(
            "| {stiffness} | {} | {} | {} | {} |\n",
            errors(dry, &[0.0, 1.0]),
            errors(wetted, &[0.0, 0.5, 1.0]),
            dry.oscillates(),
            wetted.oscillates()
        )
    });
    "| k, N/m | rms error with γ = 0, 1 | wetted: γ = 0, 0.5, 1 | oscillates along measured positions | wetted |\n|---|---|---|---|---|\n"
        .to_owned()
        + &rows.concat()
}

fn main() {
    print!("{}", table());
}
