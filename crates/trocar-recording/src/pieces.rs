//! A recording of any length in consecutive pieces, one at a time.

use std::collections::VecDeque;
use std::path::Path;

use super::block::SampleRow;
use super::collect::Collector;
use super::rows::Rows;
use super::screen::MIN_SAMPLES;
use super::units::Quantity;
use super::{Choice, ReadOptions, Recording, RecordingError, Warning, WarningKind, plausible};

/// Reads a recording piece by piece; each is checked separately. No piece holds more samples than
/// requested except the last, which may include the few that would be too few for a separate piece.
pub struct Pieces {
    file: String,
    name: String,
    choice: Choice,
    rows: Rows<'static>,
    /// The columns of the file.
    columns: Vec<Quantity>,
    /// Rows read and not yet returned.
    ahead: VecDeque<SampleRow>,
    samples: usize,
    sensor_limit: Option<f64>,
    found: u64,
}

impl Pieces {
    /// Opens the file at `path`, or standard input for `-`, to be read in pieces of `samples`
    /// samples, at least 8.
    ///
    /// # Errors
    /// As for [`read`](super::read), as far as they are detected before the first row.
    pub fn open(
        path: &Path,
        options: &ReadOptions,
        samples: usize,
    ) -> Result<Self, RecordingError> {
        crate::check_sensor_limit(options.sensor_limit)?;
        let file = path.display().to_string();
        let needed = [Quantity::Time, Quantity::Position, Quantity::Force];
        let rows = Rows::open(path, &options.choice, &needed, false)?;
        let name =
            path.file_name().map_or(file.clone(), |name| name.to_string_lossy().into_owned());
        let (samples, sensor_limit) = (samples.max(MIN_SAMPLES), options.sensor_limit);
        let columns =
            Quantity::ALL.into_iter().filter(|quantity| rows.layout().has(*quantity)).collect();
        Ok(Self {
            file,
            name,
            choice: options.choice.clone(),
            rows,
            columns,
            ahead: VecDeque::new(),
            samples,
            sensor_limit,
            found: 0,
        })
    }

    /// Fraction of the file read so far, 0 to 1 (0 for a stream), and the number of rows.
    pub fn progress(&self) -> (f64, u64) {
        (self.rows.part(), self.found)
    }

    /// The next piece, or `None` after the last. The hash of a piece is empty, since it is not a
    /// file.
    ///
    /// # Errors
    /// As for [`read`](super::read).
    pub fn next_piece(&mut self) -> Result<Option<Recording>, RecordingError> {
        let has = |quantity| self.columns.contains(&quantity);
        let mut collector =
            Collector::new(self.samples.min(1 << 16), has, None).counting(self.rows.count());
        let first = self.found == 0;
        loop {
            while self.ahead.len() < MIN_SAMPLES {
                let Some(row) = self.rows.next_row()? else { break };
                self.found += 1;
                match self.columns.iter().all(|quantity| row.get(*quantity).is_finite()) {
                    true => self.ahead.push_back(row),
                    // Only counted: it gives no sample.
                    false => collector.add(row),
                }
            }
            let others_follow = self.ahead.len() == MIN_SAMPLES;
            if collector.len() >= self.samples && others_follow {
                break;
            }
            let Some(row) = self.ahead.pop_front() else { break };
            collector.add(row);
        }
        if collector.len() == 0 && !first {
            return Ok(None);
        }
        let is_last = self.ahead.is_empty();
        let layout = self.rows.layout();
        let collected = collector
            .finish(&self.file, self.sensor_limit)
            .map_err(|error| plausible::ask_stroke(&self.choice, layout, error))?;
        if first {
            plausible::ask(&self.file, &self.choice, layout, &collected, is_last)?;
        }
        let mut piece = Recording::of(self.name.clone(), String::new(), collected);
        if first {
            piece.quality.notes.extend(self.rows.notes());
        }
        if is_last {
            for message in self.rows.warnings() {
                piece.quality.warnings.push(Warning::new(WarningKind::Source, message));
            }
        }
        Ok(Some(piece))
    }
}
