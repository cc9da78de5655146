//! Runs of a teleoperation loop.

use std::path::Path;

use rayon::prelude::*;
use trocar_model::Seal;

use super::draw::Drawn;
use super::{Seals, Sweep, SweepError, set_number, trace_file};
use crate::teleop::{Config, Outcome, write_course};

/// Names of the results of a loop, in the order of [`numbers`].
pub(crate) const RESULTS: [&str; 13] = [
    "settles",
    "unstable_after_s",
    "force_error_rms_n",
    "force_error_peak_n",
    "force_error_rms_jnd",
    "displayed_stiffness_n_m",
    "true_stiffness_n_m",
    "displayed_from_rest_n_m",
    "displayed_sliding_n_m",
    "position_error_rms_m",
    "master_energy_j",
    "slave_energy_j",
    "credit_j",
];

/// NaN for what there is not: figures of a loop that is unstable, and the time of one that does not diverge.
fn numbers(outcome: &Outcome) -> Vec<f64> {
    let settles = f64::from(u8::from(outcome.settles()));
    let unstable_after = outcome.course.as_ref().map_or_else(|why| why.time_s, |_| f64::NAN);
    let of = |merit: &crate::teleop::merit::Merit| {
        [
            merit.force_error_rms_n,
            merit.force_error_peak_n,
            merit.force_error_rms_jnd,
            merit.displayed_stiffness_n_m.unwrap_or(f64::NAN),
            merit.true_stiffness_n_m.unwrap_or(f64::NAN),
            merit.displayed_from_rest_n_m.unwrap_or(f64::NAN),
            merit.displayed_sliding_n_m.unwrap_or(f64::NAN),
            merit.position_error_rms_m,
            merit.master_energy_j,
            merit.slave_energy_j,
            merit.credit_j.unwrap_or(f64::NAN),
        ]
    };
    let figures = outcome.figures.as_ref().map_or([f64::NAN; 11], of);
    [settles, unstable_after].into_iter().chain(figures).collect()
}

impl Sweep {
    /// Runs of the loop, each with its own seal as the trocar and with its own numbers. The compensator has the model of the
    /// sweep; where the seal is drawn from published ranges, the seal's own.
    pub(super) fn loops(
        &self,
        seals: &[Result<Seal, String>],
        drawn: &[Drawn],
        first: u64,
        traces: Option<&Path>,
    ) -> Result<Vec<Result<Vec<f64>, String>>, SweepError> {
        let one = |(k, (seal, drawn)): (usize, (&Result<Seal, String>, &Drawn))| {
            let outcome =
                seal.as_ref().map_err(String::clone).and_then(|seal| self.outcome(seal, drawn));
            if let (Some(folder), Ok(Outcome { course: Ok(samples), .. })) = (traces, &outcome) {
                write_course(samples, trace_file(folder, first + k as u64))?;
            }
            Ok(outcome.map(|outcome| numbers(&outcome)))
        };
        seals.par_iter().zip(drawn).enumerate().map(one).collect()
    }

    fn outcome(&self, seal: &Seal, drawn: &Drawn) -> Result<Outcome, String> {
        let mut document = self.document.clone();
        for ((key, _), value) in self.config.surroundings().zip(&drawn.surroundings) {
            set_number(&mut document, key, *value)?;
        }
        let config: Config = document.try_into().map_err(|error| error.to_string())?;
        let config = Config { seed: drawn.seed, ..config }.with_force_error(&self.model);
        let plant = self.model.trocar.with_seal(*seal);
        let compensator = match self.seals {
            Seals::Like(_) => &plant,
            Seals::Model | Seals::Draws(_) => &self.model.trocar,
        };
        Outcome::of(&config, [compensator, &plant]).map_err(|error| {
            // A cell of a table: without the hint.
            let text = error.to_string();
            text.split("\n\n").next().unwrap_or_default().to_owned()
        })
    }
}
