//! What is plausible in a recording of an instrument in its trocar, of a seal on a bench or of the
//! axis of a robot. Beyond these limits a unit or a column is probably another one than assumed.

use std::ops::RangeInclusive;

use super::choice::Choice;
use super::columns::{Layout, Quantity};
use super::header::{EXAMPLE_RATE, PLAUSIBLE_FORCE, PUT_IN_RATE, counts_by_one};
use super::samples::{Columns, Readings};
use super::statistics::{median, range};
use super::{Quality, RecordingError, Warning, WarningKind};

/// Intervals between samples, s. At less than 20 Hz a hand moves by more than the deformation of a
/// seal from one sample to the next; no logger is faster than 10 MHz.
const INTERVALS: RangeInclusive<f64> = 1e-7..=0.05;

/// Range of the positions, m: less is within the deformation of a seal, more than any instrument
/// moves through a trocar.
const STROKES: RangeInclusive<f64> = 1e-3..=LONGEST_STROKE;

/// Longest stroke accepted, in m: no instrument moves further through a trocar.
pub const LONGEST_STROKE: f64 = 2.0;

/// Speed of the motion, m/s: slower than any protocol that shows sliding, faster than a hand or the
/// axis of a robot.
const SPEEDS: RangeInclusive<f64> = 1e-4..=5.0;

/// Range of the forces and largest force, N: less than any seal, more than any instrument or axis
/// of a robot (the benchmark EMPS reaches 152 N).
const FORCES: RangeInclusive<f64> = 5e-3..=PLAUSIBLE_FORCE;

/// An unmodelled mass, kg, above which times or forces are probably in another unit: the heaviest
/// axis of the benchmarks has 95 kg.
pub const HEAVIEST_UNMODELLED_MASS: f64 = 500.0;

/// What a recording typically has: interval in s, stroke in m, force in N. Of several units that
/// would be plausible, the one that comes nearest is proposed.
const TYPICAL: [(Quantity, f64); 3] =
    [(Quantity::Time, 1e-3), (Quantity::Position, 0.05), (Quantity::Force, 3.0)];

/// Samples between two positions from which a speed is computed: noise and steps of the encoder
/// count little.
const SPEED_OVER: usize = 50;

/// Something implausible about a quantity.
pub(crate) struct Doubt {
    quantity: Quantity,
    /// The size concerned, in SI units, and its limits.
    size: f64,
    message: String,
}

impl Doubt {
    pub(crate) fn warning(&self) -> Warning {
        let kind = match self.quantity {
            Quantity::Position => WarningKind::Stroke,
            _ => WarningKind::Units,
        };
        let hint = "is the sensor connected, and the unit right? the unit in the name of the column, such as time_ms, position_mm or force_mn, decides";
        Warning { kind, message: self.message.clone(), hint: Some(hint.to_owned()) }
    }
}

/// All doubts about times in s, positions in m and forces in N.
pub(crate) fn doubts(time: &[f64], position: &[f64], force: &[f64], interval: f64) -> Vec<Doubt> {
    let mut all = Vec::new();
    let mut doubt = |quantity, size, message| all.push(Doubt { quantity, size, message });
    let is_paced = INTERVALS.contains(&interval);
    if !is_paced {
        let message = format!("the samples are {interval:.1e} s apart");
        doubt(Quantity::Time, interval, message);
    }
    let (low, high) = range(position);
    let stroke = high - low;
    if stroke < *STROKES.start() {
        let message = match stroke {
            0.0 => format!("the position is {:.4} mm throughout", 1e3 * low),
            _ => format!("the position covers only {:.4} mm", 1e3 * stroke),
        };
        doubt(Quantity::Position, stroke, message);
    }
    let (typical, fastest) = speeds(time, position);
    let is_slow = fastest < *SPEEDS.start();
    if is_paced && STROKES.contains(&stroke) && (is_slow || typical > *SPEEDS.end()) {
        let speed = if is_slow { fastest } else { typical };
        let message =
            format!("the position moves at {}{speed:.1e} m/s", if is_slow { "only " } else { "" });
        doubt(Quantity::Time, interval, message);
    }
    let (low, high) = range(force);
    let largest = if low.abs() > high.abs() { low } else { high };
    if largest.abs() > *FORCES.end() {
        doubt(Quantity::Force, largest.abs(), format!("the force reaches {largest:.0} N"));
    } else if high > low && high - low < *FORCES.start() {
        let message = format!("the force covers only {:.4} mN", 1e3 * (high - low));
        doubt(Quantity::Force, high - low, message);
    }
    all
}

/// The speed that one of twenty moments exceeds, and the largest, m/s.
fn speeds(time: &[f64], position: &[f64]) -> (f64, f64) {
    let over = SPEED_OVER.min(time.len() / 4).max(1);
    let pairs = (over..time.len()).step_by(1 + time.len() / (1 << 16));
    let mut all: Vec<f64> = pairs
        .map(|k| ((position[k] - position[k - over]) / (time[k] - time[k - over])).abs())
        .collect();
    all.sort_unstable_by(f64::total_cmp);
    let last = all.len().saturating_sub(1);
    (all.get(last * 95 / 100).copied().unwrap_or_default(), all.last().copied().unwrap_or_default())
}

/// Refuses what is implausible and has a likely way out, unless the caller has named the column of
/// that quantity with its unit, or the rate. What has none stays a warning. The beginning of a
/// longer recording may be a rest: of one that is not `whole` only the rate is judged.
pub(crate) fn ask(
    file: &str,
    choice: &Choice,
    layout: &Layout,
    collected: &(Columns, Quality),
    whole: bool,
) -> Result<(), RecordingError> {
    let (columns, quality) = collected;
    let Readings { time, position, force, .. } = &columns.readings;
    let mut doubts = doubts(time, position, force, quality.median_interval);
    doubts.retain(|own| {
        (whole || own.quantity == Quantity::Time) && !is_explicit(own.quantity, choice, layout)
    });
    if doubts.is_empty() { Ok(()) } else { question(file, layout, [time, position], &doubts) }
}

/// The question about a stroke that is too long, unless the unit was named.
pub(crate) fn ask_stroke(
    choice: &Choice,
    layout: &Layout,
    error: RecordingError,
) -> RecordingError {
    let RecordingError::StrokeTooLong { file, stroke, limit } = error else { return error };
    if is_explicit(Quantity::Position, choice, layout) {
        return RecordingError::StrokeTooLong { file, stroke, limit };
    }
    let message = format!("the position covers {stroke} m, expected at most {limit} m");
    let doubt = Doubt { quantity: Quantity::Position, size: stroke, message };
    implausible(&file, layout, &[doubt], None, false)
}

/// Whether the caller has said which column, in which unit, is the quantity; times of a log and
/// dates are certain.
fn is_explicit(quantity: Quantity, choice: &Choice, layout: &Layout) -> bool {
    let is_time = quantity == Quantity::Time;
    let is_certain = choice.rate_hz.is_some() || layout.origin.is_some() || layout.is_log;
    (is_time && is_certain)
        || choice.in_order().is_some()
        || choice.given().is_ok_and(|given| given.iter().any(|own| own.quantity == quantity))
}

fn question(
    file: &str,
    layout: &Layout,
    [time, position]: [&[f64]; 2],
    doubts: &[Doubt],
) -> Result<(), RecordingError> {
    let speeds = Some(speeds(time, position));
    let per_time = per_si(layout, Quantity::Time).unwrap_or(1.0);
    let own: Vec<f64> = time.iter().take(1 << 12).map(|time| (time * per_time).round()).collect();
    let steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let is_one = median(steps).is_some_and(|step| (step * per_time - 1.0).abs() < 1e-6);
    let is_doubtful = doubts.iter().any(|doubt| doubt.quantity == Quantity::Time);
    let numbers_rows = is_doubtful && is_one && counts_by_one(&own);
    let has_way = doubts.iter().any(|own| {
        let per_si = per_si(layout, own.quantity);
        per_si.is_some_and(|per_si| likely_unit(own, per_si, speeds).is_some())
    });
    if !numbers_rows && !has_way {
        return Ok(());
    }
    Err(implausible(file, layout, doubts, speeds, numbers_rows))
}

fn per_si(layout: &Layout, quantity: Quantity) -> Option<f64> {
    layout.slots.iter().flatten().find(|slot| slot.is(quantity)).map(|slot| slot.per_si.abs())
}

/// The unit, as its number per SI unit, that makes the size plausible and comes nearest to what is
/// typical; one of time also makes the `speeds`, typical and fastest, plausible.
fn likely_unit(doubt: &Doubt, per_si: f64, speeds: Option<(f64, f64)>) -> Option<f64> {
    let limits = match doubt.quantity {
        Quantity::Time => INTERVALS,
        Quantity::Position => STROKES,
        _ => FORCES,
    };
    let (_, typical) = TYPICAL.into_iter().find(|(quantity, _)| *quantity == doubt.quantity)?;
    let units = doubt.quantity.units().iter().map(|unit| unit.per_si);
    // Those of SI with prefixes by thousands.
    let usual = units.filter(|own| {
        let thousands = own.log10() / 3.0;
        (thousands - thousands.round()).abs() < 1e-9
    });
    let speeds = speeds.filter(|_| doubt.quantity == Quantity::Time);
    let paced = usual.filter(|own| {
        let factor = per_si.abs() / own;
        speeds.is_none_or(|(typical, fastest)| {
            fastest / factor >= *SPEEDS.start() && typical / factor <= *SPEEDS.end()
        })
    });
    let sizes = paced.map(|own| (own, doubt.size * per_si.abs() / own));
    let plausible = sizes.filter(|(_, size)| limits.contains(size));
    let distances = plausible.map(|(own, size)| (own, (size / typical).ln().abs()));
    distances.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(own, _)| own)
}

/// The error, with all columns in the likely units and as they were read.
fn implausible(
    file: &str,
    layout: &Layout,
    doubts: &[Doubt],
    speeds: Option<(f64, f64)>,
    numbers_rows: bool,
) -> RecordingError {
    let mut units = Vec::new();
    let better = layout.words_with(|quantity, per_si| {
        let doubt = doubts.iter().find(|own| own.quantity == quantity);
        let likely = doubt.and_then(|own| likely_unit(own, per_si, speeds));
        Some(likely.map_or(per_si, |own| own.copysign(per_si)))
    });
    let better = better.join(",");
    for doubt in doubts {
        let per_si = per_si(layout, doubt.quantity);
        let unit = per_si.and_then(|per_si| likely_unit(doubt, per_si, speeds));
        let all = doubt.quantity.units();
        let unit = all.iter().find(|own| Some(own.per_si) == unit);
        units.extend(unit.map(|own| format!("the {} is in {}", doubt.quantity.name(), own.symbol)));
    }
    let mut ways = Vec::new();
    if !units.is_empty() {
        ways.push(format!("‹columns='{better}'› if {}", units.join(" and ")));
    }
    if numbers_rows {
        let untimed =
            layout.words_with(|quantity, per_si| (quantity != Quantity::Time).then_some(per_si));
        let untimed = untimed.join(",");
        ways.push(format!(
            "‹columns='{untimed}'› {EXAMPLE_RATE} ({PUT_IN_RATE}) if the column of times numbers the rows"
        ));
    }
    let as_read = layout.words().join(",");
    ways.push(format!("‹columns='{as_read}'› if the numbers are right"));
    let problems: Vec<&str> = doubts.iter().map(|doubt| &*doubt.message).collect();
    let (problems, ways) = (problems.join("; "), ways.join("; "));
    RecordingError::unusable(file, format!("{problems}\n\nhint: is the unit right? {ways}"))
}
