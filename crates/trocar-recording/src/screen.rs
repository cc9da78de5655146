//! Checks a recording: drops unusable rows, rejects invalid data, and records the quality of the
//! rest.

use std::ops::Range;

use super::RecordingError;
use super::plausible::{self, LONGEST_STROKE};
use super::quality::{Gap, Quality, Reset, RowList, Saturation, Warning, WarningKind};
use super::samples::{Columns, Lines, Readings};
use super::statistics::{median, range};

/// Fewest samples of a recording.
pub(crate) const MIN_SAMPLES: usize = 8;

/// Ratio of a gap to the 95th percentile of the intervals: two lost samples still count as jitter.
const GAP_FACTOR: f64 = 3.0;

/// Jitter, as a fraction of the interval, above which there is a warning.
const DOUBTFUL_JITTER: f64 = 0.2;

/// Fraction of the rows that may have the time of the previous row.
const TOLERATED_COINCIDENT: f64 = 0.05;

/// A jump is faster by this factor than the samples on both sides ...
const JUMP_FACTOR: f64 = 10.0;

/// ... and larger by this factor than noise and resolution explain.
const JUMP_OVER_NOISE: f64 = 20.0;

/// ... and larger than this, in m: less is rounding, whatever the noise.
const LEAST_JUMP: f64 = 1e-9;

/// Samples on each side with which a jump is compared.
const JUMP_NEIGHBOURS: usize = 4;

/// The step at the end of a stall covers at least three intervals: this many are told from one.
const CAUGHT_UP: f64 = 1.5;

/// Largest ratio between the mean speed over a stall including the step that ends it, and the mean
/// speed around it.
const STALL_FACTOR: f64 = 3.0;

/// Samples on each side over which that mean speed is computed.
const STALL_NEIGHBOURS: usize = 25;

/// Consecutive identical extreme readings that noise does not produce.
const SATURATED_RUN: usize = 5;

/// Values used to determine resolution and noise: enough for three digits, at negligible cost.
pub(super) const LOOKED_AT: usize = 1 << 16;

/// Deviations above this many standard deviations are not noise.
const NOISE_LIMIT: f64 = 5.0;

/// Ratio of a Gaussian's standard deviation to its median absolute value.
const MEDIAN_TO_SD: f64 = 1.0 / 0.674_489_75;

/// Drops redundant rows and describes the rest. `excerpts` are the times, s, at which another
/// excerpt begins: the interval before them is not a gap.
pub(super) fn screen(
    file: &str,
    mut columns: Columns,
    non_finite_rows: RowList,
    sensor_limit: Option<f64>,
    excerpts: &[f64],
) -> Result<(Columns, Quality), RecordingError> {
    let mut quality = Quality { non_finite_rows, ..Quality::default() };
    check_length(file, columns.time.len(), quality.non_finite_rows.count)?;
    drop_standing_time(file, &mut columns, &mut quality)?;
    check_length(file, columns.time.len(), quality.non_finite_rows.count)?;
    describe_time(&columns, &mut quality);
    describe_values(&columns, &mut quality);
    if quality.stroke > LONGEST_STROKE {
        let (file, stroke) = (file.to_owned(), quality.stroke);
        return Err(RecordingError::StrokeTooLong { file, stroke, limit: LONGEST_STROKE });
    }
    let begins = |index: usize| {
        excerpts.binary_search_by(|time| time.total_cmp(&columns.time[index])).is_ok()
    };
    let (cuts, gaps): (Vec<Gap>, Vec<Gap>) =
        quality.gaps.drain(..).partition(|gap| begins(gap.index));
    quality.gaps = gaps;
    find_jumps(&columns, &mut quality);
    quality.resets.retain(|reset| !begins(reset.index));
    find_saturation(&columns, &mut quality, sensor_limit);
    quality.force_opposes_motion = force_opposes_motion(&columns);
    quality.breaks = quality.gaps.iter().chain(&cuts).map(|gap| gap.index).collect();
    quality.breaks.extend(quality.resets.iter().map(|reset| reset.index));
    quality.breaks.sort_unstable();
    quality.breaks.dedup();
    quality.warnings = warnings(&quality, columns.lines.count.unit());
    let Readings { time, position, force, .. } = &columns.readings;
    let doubts = plausible::doubts(time, position, force, quality.median_interval);
    quality.warnings.extend(doubts.iter().map(plausible::Doubt::warning));
    Ok((columns, quality))
}

fn check_length(file: &str, found: usize, empty: usize) -> Result<(), RecordingError> {
    if found < MIN_SAMPLES {
        let lost = match empty {
            0 => String::new(),
            _ => format!(
                ", and {} with an empty, NaN or infinite cell\n\nhint: `trocar inspect` shows which column has no numbers",
                counted(empty, "row")
            ),
        };
        let (file, needed) = (file.to_owned(), MIN_SAMPLES);
        return Err(RecordingError::TooFewSamples { file, found, needed, lost });
    }
    Ok(())
}

/// Omits rows whose time does not increase, and rejects a clock that decreases or is constant.
fn drop_standing_time(
    file: &str,
    columns: &mut Columns,
    quality: &mut Quality,
) -> Result<(), RecordingError> {
    if columns.time.windows(2).all(|pair| pair[1] > pair[0]) {
        return Ok(());
    }
    let steps = columns.time.windows(2).map(|pair| pair[1] - pair[0]);
    let samples = columns.time.len();
    let Some(median) = median(steps.filter(|&step| step > 0.0).collect()) else {
        return Err(never_advances(file, columns));
    };
    let (mut kept, mut coincident, mut first_coincident) = (0, 0, 0);
    let mut lines = Lines::counting(columns.lines.count);
    lines.push(0, columns.lines.of(0));
    for k in 1..samples {
        let step = columns.time[k] - columns.time[kept];
        let line = columns.lines.of(k);
        if step > 0.0 {
            kept += 1;
            columns.keep(k, kept);
            lines.push(kept, line);
            continue;
        } else if step < -median {
            let (from, to, place) = (columns.time[kept], columns.time[k], columns.lines.place(k));
            return Err(RecordingError::time_goes_back(file, place, from, to));
        } else if step < 0.0 {
            quality.unordered_rows.add(line);
            continue;
        }
        quality.repeated_rows.add(line);
        if columns.position[k] != columns.position[kept] || columns.force[k] != columns.force[kept]
        {
            first_coincident = if coincident == 0 { k } else { first_coincident };
            coincident += 1;
        }
    }
    if coincident as f64 > TOLERATED_COINCIDENT * samples as f64 {
        let place = columns.lines.place(first_coincident);
        let problem = format!(
            "{coincident} of {samples} samples carry the same time as the one before but other values, expected time to advance\n\nhint: the clock is coarser than the sampling; record time with more digits"
        );
        return Err(RecordingError::unusable(format_args!("{file} {place}"), problem));
    }
    columns.truncate(kept + 1);
    columns.lines = lines;
    Ok(())
}

fn never_advances(file: &str, columns: &Columns) -> RecordingError {
    let time = &columns.time;
    if let Some(k) = time.windows(2).position(|pair| pair[1] < pair[0]) {
        let place = columns.lines.place(k + 1);
        return RecordingError::time_goes_back(file, place, time[k], time[k + 1]);
    }
    let problem = format!(
        "time stays at {} s in all {} samples, expected it to advance\n\nhint: another column may hold the times; `trocar inspect` shows all",
        time[0],
        time.len()
    );
    RecordingError::unusable(format_args!("{file} {}", columns.lines.place(0)), problem)
}

impl Columns {
    /// Moves sample `from` to the earlier index `to`.
    fn keep(&mut self, from: usize, to: usize) {
        if from == to {
            return;
        }
        self.all_mut().for_each(|(_, own)| own[to] = own[from]);
    }

    fn truncate(&mut self, length: usize) {
        self.all_mut().for_each(|(_, own)| own.truncate(length));
    }
}

fn describe_time(columns: &Columns, quality: &mut Quality) {
    let steps: Vec<f64> = columns.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    quality.longest_interval = steps.iter().copied().fold(0.0, f64::max);
    let mut sorted = steps.clone();
    let upper = sorted.len() * 95 / 100;
    let usual = *sorted.select_nth_unstable_by(upper, f64::total_cmp).1;
    quality.median_interval = median(sorted).unwrap_or_default();
    let threshold = GAP_FACTOR * usual;
    let (mut sum, mut count) = (0.0, 0_usize);
    for (k, &step) in steps.iter().enumerate() {
        if step > threshold {
            let (from, to) = (columns.time[k], columns.time[k + 1]);
            quality.gaps.push(Gap { index: k + 1, line: columns.lines.of(k + 1), from, to });
        } else {
            sum += (step - quality.median_interval).powi(2);
            count += 1;
        }
    }
    quality.jitter = (sum / count.max(1) as f64).sqrt();
}

fn describe_values(columns: &Columns, quality: &mut Quality) {
    let (low, high) = range(&columns.position);
    quality.stroke = high - low;
    quality.position_resolution = resolution(&columns.position);
    quality.force_resolution = resolution(&columns.force);
    quality.position_noise = noise(&columns.time, &columns.position, quality.position_resolution);
    quality.force_noise = noise(&columns.time, &columns.force, quality.force_resolution);
}

/// Standard deviation about the straight line through the two neighbours, which removes slow
/// motion.
///
/// Jumps are excluded by comparison with the median. The median itself would be coarse if the noise
/// is only a few steps of `resolution`.
fn noise(time: &[f64], values: &[f64], resolution: f64) -> f64 {
    let stride = (values.len() / LOOKED_AT).max(1);
    let deviations = (1..values.len() - 1).step_by(stride).map(|k| {
        let weight = (time[k] - time[k - 1]) / (time[k + 1] - time[k - 1]);
        let between = values[k - 1] + weight * (values[k + 1] - values[k - 1]);
        // Variance of the difference of one value and a weighted mean of two.
        let scale = (1.0 + weight * weight + (1.0 - weight) * (1.0 - weight)).sqrt();
        (values[k] - between).abs() / scale
    });
    let deviations: Vec<f64> = deviations.collect();
    let typical = median(deviations.clone()).unwrap_or_default() * MEDIAN_TO_SD;
    let limit = NOISE_LIMIT * typical.max(resolution / 12_f64.sqrt());
    let (sum, count) = deviations
        .iter()
        .filter(|&&deviation| deviation <= limit)
        .fold((0.0, 0_usize), |(sum, count), deviation| (sum + deviation * deviation, count + 1));
    (sum / count.max(1) as f64).sqrt()
}

/// The step of a sensor, of which nearly all differences are integer multiples; else the unit of the
/// last digit of the values, or 0 where they have none or do not show it.
///
/// Motion at constant speed makes all differences alike without any encoder. An encoder shows where
/// neighbouring differences differ by one step.
pub(super) fn resolution(values: &[f64]) -> f64 {
    let looked_at = &values[..values.len().min(LOOKED_AT)];
    let largest = looked_at.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    let unit = last_digit(looked_at, largest);
    let differences: Vec<f64> =
        looked_at.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let shown = unit.and_then(|unit| Some((unit, commonest_divisor(looked_at, unit)?)));
    let decimal = shown.filter(|(_, units)| *units > 1).map(|(unit, units)| unit * units as f64);
    let least = unit.map_or(SINGLE_PRECISION * largest, |unit| 1.5 * unit);
    // Of numbers with few digits a step is known to a part of the last one only, and of long
    // differences nothing follows.
    let (rounding, reach) = unit.map_or((0.0, 200.0), |unit| (unit, 10.0));
    decimal
        .filter(|step| is_step(&differences, *step, 0.0, f64::INFINITY))
        .or_else(|| {
            let change = smallest_change(&differences, least)?;
            is_step(&differences, change, rounding, reach).then_some(change)
        })
        .or(shown.map(|(unit, _)| unit))
        .unwrap_or(0.0)
}

/// Rounding of values that were once numbers of single precision, relative to the largest.
const SINGLE_PRECISION: f64 = 1e-7;
/// Part of a step within which a difference is a multiple of it, the part of the differences that
/// have to be, and the part of those that differ by one step from the next.
const NEAR_A_STEP: f64 = 0.02;
const NEARLY_ALL: f64 = 0.98;
const ENOUGH_CHANGES: f64 = 0.02;

/// The unit of the last decimal digit of the values, none above `largest`; `None` where they have
/// more digits than a sensor.
fn last_digit(values: &[f64], largest: f64) -> Option<f64> {
    let scales = (0..=10).map(|digits| 10_f64.powi(digits));
    // Less than a unit in all rounds to nothing, and above 2^43 units the last digits of a double no
    // longer distinguish integers from other numbers.
    let mut scales = scales.filter(|scale| (1.0..8.8e12).contains(&(largest * scale)));
    scales
        .find(|scale| values.iter().all(|x| (x * scale - (x * scale).round()).abs() < 1e-3))
        .map(f64::recip)
}

/// Each block of differences that shows a step has its own greatest common divisor, in units; the
/// one of most blocks, so a few odd values have no effect.
fn commonest_divisor(values: &[f64], unit: f64) -> Option<u64> {
    let whole: Vec<i64> = values.iter().map(|x| (x / unit).round() as i64).collect();
    let mut divisors: Vec<u64> =
        whole.chunks(64).filter(|block| shows_a_step(block)).map(common_divisor).collect();
    divisors.sort_unstable();
    let runs = divisors.chunk_by(|a, b| a == b);
    runs.rev().max_by_key(|run| run.len()).map(|run| run[0])
}

/// The common size of the smallest changes from one difference to the next, of those above `least`.
fn smallest_change(differences: &[f64], least: f64) -> Option<f64> {
    let changes = differences.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let mut changes: Vec<f64> = changes.filter(|change| *change > least).collect();
    changes.sort_unstable_by(f64::total_cmp);
    let first = *changes.get(changes.len() / 20)?;
    let single = &changes[..changes.partition_point(|change| *change < 1.5 * first)];
    let near = single.iter().filter(|change| **change > 0.5 * first);
    let (sum, count) = near.fold((0.0, 0.0), |(sum, count), change| (sum + change, count + 1.0));
    Some(sum / count)
}

/// Whether nearly all differences of up to `reach` steps are multiples of `step`, each with an error
/// of `rounding`, and enough differ by one step from the next.
fn is_step(differences: &[f64], step: f64, rounding: f64, reach: f64) -> bool {
    let tolerance = rounding + NEAR_A_STEP * step;
    let short: Vec<f64> = differences.iter().copied().filter(|d| *d < reach * step).collect();
    let near = short.iter().filter(|d| (**d - (*d / step).round() * step).abs() <= tolerance);
    let one_apart = differences.windows(2).filter(|pair| {
        let [before, after] = [pair[0], pair[1]].map(|d| (d / step).round());
        pair[1] < reach * step && (after - before).abs() == 1.0
    });
    4.0 * rounding < step
        && near.count() as f64 >= NEARLY_ALL * short.len() as f64
        && one_apart.count() as f64 >= ENOUGH_CHANGES * differences.len() as f64
}

/// Whether the differences of a block tell the step of an encoder from a constant speed times the
/// interval: they have two sizes, or the motion pauses between equal ones.
fn shows_a_step(block: &[i64]) -> bool {
    let mut steps: Vec<u64> = block.windows(2).map(|pair| pair[1].abs_diff(pair[0])).collect();
    let pauses = steps.split(|step| *step > 0).filter(|pause| !pause.is_empty()).count();
    steps.retain(|step| *step > 0);
    steps.sort_unstable();
    steps.dedup();
    steps.len() > 1 || steps.len() == 1 && pauses > 2
}

fn common_divisor(block: &[i64]) -> u64 {
    block.windows(2).fold(0, |divisor, pair| gcd(divisor, pair[1].abs_diff(pair[0])))
}

fn gcd(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Position steps that are much faster than the motion before and after: resets, or the end of a
/// stall.
fn find_jumps(columns: &Columns, quality: &mut Quality) {
    let path = Path { time: &columns.time, position: &columns.position };
    let noise = quality.position_noise.max(quality.position_resolution);
    let least = (JUMP_OVER_NOISE * noise + 1e-9 * quality.stroke).max(LEAST_JUMP);
    for k in 1..path.time.len() {
        let jump = path.position[k] - path.position[k - 1];
        if jump.abs() <= least {
            continue;
        }
        let stalled = path.stalled_before(k);
        // A single equal position is chance if the noise is a few steps of the resolution.
        if k - stalled > 2 && path.catches_up(stalled, k) {
            (stalled + 1..k).for_each(|j| quality.held_rows.add(columns.lines.of(j)));
        } else if path.speed(k - 1, k) > JUMP_FACTOR * path.typical_speed_around(k) {
            quality.resets.push(Reset { index: k, line: columns.lines.of(k), jump });
        }
    }
}

/// Speeds along the positions.
struct Path<'a> {
    time: &'a [f64],
    position: &'a [f64],
}

impl Path<'_> {
    /// Mean speed between two samples, m/s.
    fn speed(&self, from: usize, to: usize) -> f64 {
        ((self.position[to] - self.position[from]) / (self.time[to] - self.time[from])).abs()
    }

    /// Larger of the median speeds over the few samples before and after the step to `k`.
    fn typical_speed_around(&self, k: usize) -> f64 {
        let before = k.saturating_sub(JUMP_NEIGHBOURS).max(1)..k;
        let after = k + 1..(k + 1 + JUMP_NEIGHBOURS).min(self.time.len());
        self.typical_speed(before).max(self.typical_speed(after))
    }

    /// Median of the speeds up to each of at most [`JUMP_NEIGHBOURS`] samples; 0 without any.
    fn typical_speed(&self, range: Range<usize>) -> f64 {
        let mut speeds = [0.0; JUMP_NEIGHBOURS];
        let count = range.len();
        speeds.iter_mut().zip(range).for_each(|(slot, j)| *slot = self.speed(j - 1, j));
        speeds[..count].sort_unstable_by(f64::total_cmp);
        if count == 0 { 0.0 } else { speeds[count / 2] }
    }

    /// The first of the samples before `k` that have the same position as sample `k - 1`.
    fn stalled_before(&self, k: usize) -> usize {
        let position = self.position[k - 1];
        k - self.position[..k].iter().rev().take_while(|&&x| x == position).count()
    }

    /// Whether the mean speed from `from` to `to` is about that of the motion before or after it,
    /// since its last step is longer than those after it: a motion that goes on from a short rest
    /// has nothing to catch up.
    fn catches_up(&self, from: usize, to: usize) -> bool {
        let first = from.saturating_sub(STALL_NEIGHBOURS);
        let last = (to + STALL_NEIGHBOURS).min(self.time.len() - 1);
        if first == from || to == last {
            return false;
        }
        let (before, after) = (self.speed(first, from), self.speed(to, last));
        let usual = before.min(after) / STALL_FACTOR..=before.max(after) * STALL_FACTOR;
        before.min(after) > 0.0
            && usual.contains(&self.speed(from, to))
            && self.speed(to - 1, to) > CAUGHT_UP * after
    }
}

/// Runs of the same extreme reading; with noise on the force, only the limit of the range produces
/// them.
fn find_saturation(columns: &Columns, quality: &mut Quality, sensor_limit: Option<f64>) {
    let (low, high) = range(&columns.force);
    // If the sensor is saturated for most of the time, the readings as a whole appear to be free of
    // noise.
    let inside = columns
        .time
        .iter()
        .zip(&columns.force)
        .filter(|(_, force)| low < **force && **force < high);
    let (time, force): (Vec<f64>, Vec<f64>) = inside.unzip();
    let noisy = force.len() >= MIN_SAMPLES
        && noise(&time, &force, quality.force_resolution) > quality.force_resolution;
    for (level, sign) in [(high, 1.0), (low, -1.0)] {
        let limit = sensor_limit.filter(|limit| sign * level >= *limit);
        // Without noise any constant force repeats exactly, so repetition is no evidence.
        if limit.is_none() && !noisy {
            continue;
        }
        let threshold = limit.unwrap_or(sign * level);
        let stuck: Vec<bool> =
            columns.force.iter().map(|force| sign * force >= threshold).collect();
        let runs = stuck.chunk_by(|a, b| a == b).filter(|run| run[0]);
        let longest = runs.map(<[bool]>::len).max().unwrap_or(0);
        if limit.is_some() || longest >= SATURATED_RUN {
            let count = stuck.iter().filter(|is_stuck| **is_stuck).count();
            let first = stuck.iter().position(|is_stuck| *is_stuck).unwrap_or_default();
            quality.saturated.push(Saturation {
                count,
                level,
                first_line: columns.lines.of(first),
            });
        }
    }
}

/// Whether the mean force during insertion is clearly below that during withdrawal.
///
/// An offset cancels in the difference. Both directions and a difference above half the scatter are
/// required.
fn force_opposes_motion(columns: &Columns) -> bool {
    let (time, position, force) = (&columns.time, &columns.position, &columns.force);
    let travel: f64 = position.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
    let mean_speed = travel / (time[time.len() - 1] - time[0]);
    let mut sides = [Moments::default(), Moments::default()];
    for k in 1..time.len() {
        let velocity = (position[k] - position[k - 1]) / (time[k] - time[k - 1]);
        if velocity.abs() > 0.5 * mean_speed {
            sides[usize::from(velocity > 0.0)].add(force[k]);
        }
    }
    let [withdrawing, inserting] = sides;
    let least = 0.05 * time.len() as f64;
    let scatter = (withdrawing.variance() + inserting.variance()).sqrt();
    withdrawing.count > least
        && inserting.count > least
        && inserting.mean - withdrawing.mean < -0.5 * scatter
        && inserting.mean < withdrawing.mean
}

/// Running mean and variance.
#[derive(Default)]
struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, x: f64) {
        self.count += 1.0;
        let delta = x - self.mean;
        self.mean += delta / self.count;
        self.squares += delta * (x - self.mean);
    }

    fn variance(&self) -> f64 {
        self.squares / self.count.max(1.0)
    }
}

/// Warnings about everything lost or doubtful. `unit` is the unit of positions: `line` or `sample`.
fn warnings(quality: &Quality, unit: &str) -> Vec<Warning> {
    let mut warnings = warnings_of_rows(quality, unit);
    let longest = quality.gaps.iter().max_by(|a, b| (a.to - a.from).total_cmp(&(b.to - b.from)));
    if let Some(gap) = longest {
        let (count, line) = (counted(quality.gaps.len(), "gap"), gap.line);
        let length = gap.to - gap.from;
        warnings.push(Warning::new(
            WarningKind::Gaps,
            format!("{count} in time, the longest of {length:.3} s before {unit} {line}"),
        ));
    }
    if quality.jitter > DOUBTFUL_JITTER * quality.median_interval {
        let (jitter, interval) = (quality.jitter * 1e3, quality.median_interval * 1e3);
        warnings.push(Warning::new(
            WarningKind::Jitter,
            format!("intervals of {interval:.3} ms scatter by {jitter:.3} ms"),
        ));
    }
    if let Some(reset) = quality.resets.first() {
        let (count, line) = (counted(quality.resets.len(), "position jump"), reset.line);
        let jump = reset.jump * 1e3;
        warnings.push(Warning::new(
            WarningKind::Resets,
            format!("{count}, the first of {jump:.3} mm at {unit} {line}"),
        ));
    }
    for Saturation { count, level, first_line: line } in &quality.saturated {
        let hint = "forces beyond the sensor's range are lost; leave these strokes out or use a larger sensor";
        warnings.push(Warning {
            kind: WarningKind::Saturation,
            message: format!("force stuck at {level} N in {count} samples, first at {unit} {line}"),
            hint: Some(hint.to_owned()),
        });
    }
    if quality.force_opposes_motion {
        let message = "the force opposes the motion: lower on insertion than on withdrawal";
        warnings.push(Warning {
            kind: WarningKind::ForceSign,
            message: message.to_owned(),
            hint: Some(OPPOSED.to_owned()),
        });
    }
    warnings
}

/// Warnings about rows that are left out, or kept with a doubt.
fn warnings_of_rows(quality: &Quality, unit: &str) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for (kind, rows, what) in [
        (
            WarningKind::NonFiniteRows,
            &quality.non_finite_rows,
            "with an empty, NaN or infinite cell left out",
        ),
        (
            WarningKind::RepeatedRows,
            &quality.repeated_rows,
            "with the time of the row above left out",
        ),
        (WarningKind::UnorderedRows, &quality.unordered_rows, "out of order left out"),
        (
            WarningKind::HeldRows,
            &quality.held_rows,
            "hold an old position in the middle of motion, kept as they are",
        ),
    ] {
        if rows.count > 0 {
            let message = format!("{} {what}: {}", counted(rows.count, "row"), rows.places(unit));
            warnings.push(Warning::new(kind, message));
        }
    }
    warnings
}

/// The ways out where the force opposes the motion. A sensor and an encoder that are mounted the
/// other way round give the same sign of the work, so the data do not tell which of them it is.
pub const OPPOSED: &str = "use ‹flip_force=True› if the sensor is mounted the other way round; if the encoder counts the other way round, \
     reverse the position, with a minus before the name of its column";

/// `1 gap`, `3 gaps`.
fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}
