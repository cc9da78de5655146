//! An experiment as the interfaces ask for it, and its recording as files.

use std::path::Path;

use trocar_model::Element;
use trocar_tables::error::OutputError;
use trocar_tables::table::{Column, Field, TableWriter};

use super::{BenchConfig, BenchError, BenchRun, Course, Protocol, RigEvents, run, run_motion};

/// Rows per write.
const PIECE: usize = 1 << 16;

/// What the rig does.
#[derive(Debug, Clone, PartialEq)]
pub enum Experiment {
    /// One of its own experiments.
    Protocol(Protocol),
    /// Any other motion.
    Motion(Course),
}

impl Experiment {
    /// The one of both that is given.
    ///
    /// # Errors
    /// [`BenchError::WhichExperiment`] for none, or both.
    pub fn of(protocol: Option<Protocol>, motion: Option<Course>) -> Result<Self, BenchError> {
        match (protocol, motion) {
            (Some(protocol), None) => Ok(Self::Protocol(protocol)),
            (None, Some(motion)) => Ok(Self::Motion(motion)),
            _ => Err(BenchError::WhichExperiment),
        }
    }

    /// Name of the recording.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Protocol(protocol) => protocol.name(),
            Self::Motion(_) => "motion",
        }
    }

    /// Whether the rod turns.
    pub fn turns(&self) -> bool {
        match self {
            Self::Protocol(protocol) => protocol.turns(),
            Self::Motion(course) => course.angle.is_some(),
        }
    }

    /// Records it, as [`run`] and [`run_motion`] do.
    ///
    /// # Errors
    /// As for these.
    pub fn run(
        &self,
        config: &BenchConfig,
        seal: &[Element],
        seed: u64,
    ) -> Result<BenchRun, BenchError> {
        match self {
            Self::Protocol(protocol) => run(config, *protocol, seal, seed),
            Self::Motion(course) => run_motion(config, course, seal, seed),
        }
    }
}

impl RigEvents {
    /// What makes the recording doubtful.
    pub fn warnings(&self) -> Vec<String> {
        let saturated =
            |sensor, samples| format!("the {sensor} sensor was saturated in {samples} samples");
        let stopped = format!("the carriage ran into a safety stop {} times", self.stop_hits);
        let all = [
            (self.saturated_samples, saturated("force", self.saturated_samples)),
            (self.saturated_torques, saturated("torque", self.saturated_torques)),
            (self.stop_hits, stopped),
        ];
        all.into_iter().filter(|(count, _)| *count > 0).map(|(_, words)| words).collect()
    }

    /// What does not.
    pub fn note(&self) -> Option<String> {
        let steps = self.motor_limited_steps;
        (steps > 0).then(|| format!("the motor was at its force limit in {steps} steps"))
    }
}

impl Course {
    /// Writes it as a table of times, positions and angles, if there are any, in the format that the
    /// extension of `path` selects.
    ///
    /// # Errors
    /// [`OutputError`] where it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        let named = [("time_s", Some(&self.time)), ("position_m", Some(&self.position))];
        let all = named.into_iter().chain([("angle_rad", self.angle.as_ref())]);
        let columns = all.filter_map(|(name, column)| Some((name.to_owned(), column?)));
        write(path, columns.collect())
    }
}

impl BenchRun {
    /// Writes what a rig records as a table in the format that the extension of `path` selects.
    ///
    /// # Errors
    /// [`OutputError`] where it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        let columns = [
            ("time_s", &self.time),
            ("position_m", &self.position),
            ("velocity_m_s", &self.velocity),
            ("force_n", &self.force),
        ];
        let mut columns = columns.map(|(name, column)| (name.to_owned(), column)).to_vec();
        if !self.angle.is_empty() {
            columns.push(("angle_rad".into(), &self.angle));
            columns.push(("torque_n_m".into(), &self.torque));
        }
        for (name, load) in ["side_force_n", "tilt_rad", "pressure_pa"].into_iter().zip(&self.loads)
        {
            columns.extend(load.iter().map(|load| (name.to_owned(), load)));
        }
        write(path, columns)
    }

    /// Writes the true values; each of several elements has its own deflection.
    ///
    /// # Errors
    /// [`OutputError`] where they cannot be written.
    pub fn write_truth(&self, path: &Path) -> Result<(), OutputError> {
        let truth = &self.truth;
        let columns = [
            ("time_s", &self.time),
            ("position_m", &truth.position),
            ("velocity_m_s", &truth.velocity),
            ("acceleration_m_s2", &truth.acceleration),
            ("reference_velocity_m_s", &truth.reference_velocity),
            ("motor_force_n", &truth.motor_force),
            ("seal_force_n", &truth.seal_force),
            ("tissue_force_n", &truth.tissue_force),
            ("wetting", &truth.wetting),
        ];
        let mut columns = columns.map(|(name, column)| (name.to_owned(), column)).to_vec();
        if !truth.torque.is_empty() {
            columns.push(("angle_rad".into(), &truth.angle));
            columns.push(("torque_n_m".into(), &truth.torque));
        }
        for (i, column) in truth.deflections.iter().enumerate() {
            columns.push((format!("deflection_{}_m", i + 1), column));
        }
        write(path, columns)
    }
}

/// Writes columns of equal length.
fn write(path: &Path, columns: Vec<(String, &Vec<f64>)>) -> Result<(), OutputError> {
    let (names, columns): (Vec<String>, Vec<&Vec<f64>>) = columns.into_iter().unzip();
    let fields: Vec<Field> = names.into_iter().map(Field::number).collect();
    let mut writer = TableWriter::create(path, &fields)?;
    let rows = columns.first().map_or(0, |column| column.len());
    for from in (0..rows).step_by(PIECE) {
        let piece = from..rows.min(from + PIECE);
        let cells = columns.iter().map(|column| Column::Number(column[piece.clone()].to_vec()));
        writer.write(&cells.collect::<Vec<_>>())?;
    }
    writer.commit()
}
