//! The samples of a recording: its columns, and while it is read the line of each.

use std::io::Write;
use std::ops::{Deref, Range};

use sha2::{Digest, Sha256};
use trocar_tables::line::Line;

use super::Location;
use super::text::hex;
use super::units::Quantity;

/// Columns of the loads beside the force of the seal, where they were recorded: side force in N, tilt in rad, pressure in Pa.
pub type Recorded = [Option<Vec<f64>>; 3];

/// Columns that do not come from a file, in SI units.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Readings {
    /// Time in s.
    pub time: Vec<f64>,
    /// Position in m, increasing on insertion.
    pub position: Vec<f64>,
    /// Force in N, of the device on the seal.
    pub force: Vec<f64>,
    /// Velocity in m/s, if there is one.
    pub velocity: Option<Vec<f64>>,
    /// Angle of the instrument about its axis in rad, if there is one.
    pub angle: Option<Vec<f64>>,
    /// Torque of the instrument on the seal in N·m, positive with the angle, if there is one.
    pub torque: Option<Vec<f64>>,
    /// Loads beside the force of the seal, as [`crate::loads`] has them.
    pub loads: Recorded,
}

/// By index of the [`Quantity`].
pub(super) type ByQuantity<'a> = [Option<&'a Vec<f64>>; Quantity::ALL.len()];

pub(super) fn columns<'a>(
    needed: [&'a Vec<f64>; 3],
    optional: [&'a Option<Vec<f64>>; 3],
    loads: &'a Recorded,
) -> ByQuantity<'a> {
    let ([a, b, c], [d, e, f]) = (needed.map(Some), optional.map(Option::as_ref));
    let [g, h, i] = loads.each_ref().map(Option::as_ref);
    [a, b, c, d, e, f, g, h, i]
}

pub(super) fn cut(columns: ByQuantity<'_>, kept: impl Iterator<Item = usize> + Clone) -> Readings {
    columns
        .map(|own| own.map(|own| kept.clone().filter_map(|k| own.get(k).copied()).collect()))
        .into()
}

pub(super) fn write(columns: ByQuantity<'_>, mut output: impl Write) -> std::io::Result<()> {
    let named = Quantity::ALL.map(Quantity::column_name).into_iter().zip(columns);
    let (names, columns): (Vec<String>, Vec<&Vec<f64>>) =
        named.filter_map(|(name, own)| Some((name, own?))).unzip();
    writeln!(output, "{}", names.join(","))?;
    let mut line = Line::default();
    for k in 0..columns.first().map_or(0, |own| own.len()) {
        columns.iter().for_each(|own| _ = line.number(own[k]));
        line.finish(&mut output)?;
    }
    line.flush(&mut output)?;
    output.flush()
}

impl From<[Option<Vec<f64>>; Quantity::ALL.len()]> for Readings {
    fn from(columns: [Option<Vec<f64>>; Quantity::ALL.len()]) -> Self {
        let [time, position, force, velocity, angle, torque, loads @ ..] = columns;
        let [time, position, force] = [time, position, force].map(Option::unwrap_or_default);
        Self { time, position, force, velocity, angle, torque, loads }
    }
}

impl Readings {
    pub(super) fn columns(&self) -> ByQuantity<'_> {
        let Self { time, position, force, velocity, angle, torque, loads } = self;
        columns([time, position, force], [velocity, angle, torque], loads)
    }

    fn columns_mut(&mut self) -> [Option<&mut Vec<f64>>; Quantity::ALL.len()] {
        let Self { time, position, force, velocity, angle, torque, loads } = self;
        let [velocity, angle, torque] = [velocity, angle, torque].map(Option::as_mut);
        let [side, tilt, pressure] = loads.each_mut().map(Option::as_mut);
        [Some(time), Some(position), Some(force), velocity, angle, torque, side, tilt, pressure]
    }

    /// The samples at `kept`, in this order.
    #[must_use]
    pub fn at(&self, kept: impl Iterator<Item = usize> + Clone) -> Self {
        cut(self.columns(), kept)
    }

    /// Writes the columns as CSV in SI units, such as `time_s,position_m,force_n`.
    ///
    /// Every number is the shortest that reads back as the same value.
    ///
    /// # Errors
    /// The error of the operating system when the output cannot be written.
    pub fn write(&self, output: impl Write) -> std::io::Result<()> {
        write(self.columns(), output)
    }

    /// SHA-256 of the columns; lower-case hexadecimal.
    pub fn sha256(&self) -> String {
        let mut hash = Sha256::new();
        for column in self.columns().into_iter().flatten() {
            column.iter().for_each(|value| hash.update(value.to_le_bytes()));
        }
        hex(&hash.finalize())
    }
}

/// The columns of a recording with the line of every sample.
#[derive(Debug, Default)]
pub(super) struct Columns {
    pub(super) readings: Readings,
    pub(super) lines: Lines,
}

impl Deref for Columns {
    type Target = Readings;

    fn deref(&self) -> &Readings {
        &self.readings
    }
}

impl Columns {
    /// All that there are, with their quantities.
    pub(super) fn all_mut(&mut self) -> impl Iterator<Item = (Quantity, &mut Vec<f64>)> {
        let all = Quantity::ALL.into_iter().zip(self.readings.columns_mut());
        all.filter_map(|(quantity, own)| Some((quantity, own?)))
    }
}

/// Unit in which positions are counted.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Count {
    /// Lines of a text, from 1.
    #[default]
    Lines,
    /// Rows of a table, from 1.
    Rows,
    /// Samples without a file, from 0.
    Samples,
}

impl Count {
    pub(crate) fn place(self, number: u64) -> Location {
        match self {
            Self::Lines => Location::Line(number),
            Self::Rows => Location::Row(number),
            Self::Samples => Location::Sample(number as usize),
        }
    }

    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Lines => "line",
            Self::Rows => "row",
            Self::Samples => "sample",
        }
    }
}

/// Line numbers, stored only where they are not consecutive.
#[derive(Debug, Default)]
pub(super) struct Lines {
    pub(super) count: Count,
    /// Sample and its line, wherever lines were omitted before it.
    jumps: Vec<(usize, u64)>,
}

impl Lines {
    pub(super) fn counting(count: Count) -> Self {
        Self { count, jumps: Vec::new() }
    }

    pub(super) fn push(&mut self, index: usize, line: u64) {
        if self.of(index) != line {
            self.jumps.push((index, line));
        }
    }

    pub(super) fn of(&self, index: usize) -> u64 {
        let at = self.jumps.partition_point(|&(first, _)| first <= index);
        let (first, line) = at.checked_sub(1).map_or((0, 0), |at| self.jumps[at]);
        line + (index - first) as u64
    }

    /// The line numbers of the samples in `kept`, which become contiguous.
    pub(super) fn keep(&mut self, kept: &[Range<usize>]) {
        let old = std::mem::take(&mut self.jumps);
        let old = Self { count: self.count, jumps: old };
        let mut next = 0;
        for range in kept {
            let inside = old.jumps.iter().filter(|(first, _)| range.contains(first));
            let starts = std::iter::once(range.start).chain(inside.map(|(first, _)| *first));
            starts.for_each(|sample| self.push(next + sample - range.start, old.of(sample)));
            next += range.len();
        }
    }

    pub(super) fn place(&self, index: usize) -> Location {
        self.count.place(self.of(index))
    }
}
