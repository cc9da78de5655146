//! Self-excited oscillation of the force at constant speed: stick-slip.
//!
//! A model with correct forces soon loses phase with such readings, so the squared error does not
//! assess it, and a fit to them smooths the swings: its friction falls too little with speed.
//! Quantities independent of phase are therefore reported separately: the speeds, the frequency, and
//! the force range of the oscillation.
//!
//! A plateau swings where the autocorrelation of its force falls below zero and returns.
//!
//! A force may also oscillate because of the rig. Cogging of the drive or a rough shaft recurs at
//! the same positions at any speed, interference at the same frequency, a resonance of the rig at
//! some speeds but not at slower ones. None of them is stick-slip.

use std::ops::RangeInclusive;

use rayon::prelude::*;
use serde::Serialize;
use trocar_recording::{Recording, median, range};

use crate::segment::{Segments, SteadySegment};

mod left_out;

pub use left_out::{LeftOut, Piece};

/// Fewest periods, samples and longest period in samples of an oscillation; least correlation after
/// one period, also in units of its error of white noise; correlation that is a valley before.
const FEWEST_PERIODS: usize = 4;
const FEWEST_SAMPLES: usize = 48;
const LONGEST_PERIOD: usize = 600;
const LEAST_CORRELATION: f64 = 0.2;
const OVER_ERROR: f64 = 5.0;
const VALLEY: f64 = -0.05;
/// Least peak-to-peak amplitude of a large one: the sum of these multiples of the force and of the
/// sensor noise.
const LEAST_SWING: f64 = 0.06;
const OVER_NOISE: f64 = 6.0;
/// Fewest plateaus that oscillate.
const FEWEST_PLATEAUS: usize = 2;
/// Plateaus whose speeds differ by less than this factor may oscillate alike whatever the cause.
const OTHER_SPEED: f64 = 1.1;
/// Median correlation of such plateaus over the position above which the oscillation is attributed
/// to the position.
const SAME_PLACES: f64 = 0.5;
/// Cells per period over which they are compared, and the fewest cells.
const CELLS: f64 = 6.0;
const FEWEST_CELLS: usize = 24;
/// Part of the plateaus up to the fastest that oscillates which must oscillate: a seal that sticks and
/// slips at one speed does so at all slower ones.
const SLOWER_SWING: f64 = 0.5;
/// Ratio of the largest to the least frequency that counts as one frequency, and the ratio of
/// speeds required for that.
const ONE_FREQUENCY: f64 = 1.15;
const SPEEDS: f64 = 2.0;

/// Self-excited oscillation of the force: least and greatest value over the velocity plateaus that
/// oscillate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StickSlip {
    /// Velocity plateaus that oscillate.
    pub plateaus: usize,
    /// Speed of the instrument, m/s.
    pub speed_m_s: [f64; 2],
    /// Cycles per second.
    pub frequency_hz: [f64; 2],
    /// Magnitude of the force, N, without the sensor offset: the mean of the minima, at which a
    /// slip ends, and of the maxima, at which it begins: the static force F_s.
    pub force_n: [f64; 2],
}

/// Cause of a force oscillation at constant velocity.
#[derive(Debug, Clone, PartialEq)]
pub enum Swings {
    /// The seal.
    StickSlip(StickSlip),
    /// A position-dependent cause, with a period in m.
    Position {
        /// m.
        period: f64,
    },
    /// A cause with its own frequency, Hz.
    Interference {
        /// Hz.
        frequency: f64,
    },
    /// A resonance of the rig at some speeds, but not at slower ones.
    Rig {
        /// Of the plateaus that oscillate, m/s.
        speed_m_s: [f64; 2],
        /// Cycles per second.
        frequency_hz: [f64; 2],
    },
}

/// One plateau that oscillates.
struct Oscillation<'a> {
    frequency: f64,
    force: [f64; 2],
    /// Peak to peak without noise, of a force that rises and falls at constant rates, N.
    width: f64,
    speed: f64,
    inserts: bool,
    /// Those of its plateau.
    strokes: RangeInclusive<usize>,
    positions: &'a [f64],
    readings: &'a [f64],
}

impl Swings {
    /// `None` where the force oscillates on fewer than two plateaus.
    ///
    /// Where the model's sliding force `falls` with speed, small swings count, too.
    #[must_use]
    pub fn of(
        recordings: &[Recording],
        segments: &[Segments],
        offset: f64,
        falls: bool,
    ) -> Option<Self> {
        let each = wide_oscillations(recordings, segments, offset, falls);
        Self::caused(recordings, segments, &each)
    }

    /// The cause of the oscillations of each recording.
    fn caused(
        recordings: &[Recording],
        segments: &[Segments],
        each: &[Vec<Oscillation>],
    ) -> Option<Self> {
        let period = period_over_position(each);
        let all: Vec<&Oscillation> = each.iter().flatten().collect();
        let over = |of: fn(&Oscillation) -> f64| {
            let (low, high) = range(&all.iter().map(|o| of(o)).collect::<Vec<f64>>());
            [low, high]
        };
        let (speed_m_s, frequency_hz) = (over(|o| o.speed), over(|o| o.frequency));
        let is_wide = |[low, high]: [f64; 2], factor: f64| high > factor * low;
        let watched =
            watched_up_to(recordings, segments, speed_m_s[1], travel(each.iter().flatten())?);
        let swings = if let Some(period) = period {
            Self::Position { period }
        } else if is_wide(speed_m_s, SPEEDS) && !is_wide(frequency_hz, ONE_FREQUENCY) {
            Self::Interference { frequency: 0.5 * (frequency_hz[0] + frequency_hz[1]) }
        } else if (all.len() as f64) < SLOWER_SWING * watched as f64 {
            Self::Rig { speed_m_s, frequency_hz }
        } else {
            let plateaus = all.len();
            let force_n =
                [0, 1].map(|k| all.iter().map(|o| o.force[k]).sum::<f64>() / plateaus as f64);
            Self::StickSlip(StickSlip { plateaus, speed_m_s, frequency_hz, force_n })
        };
        (all.len() >= FEWEST_PLATEAUS).then_some(swings)
    }

    /// The oscillation of the seal itself.
    #[must_use]
    pub fn stick_slip(self) -> Option<StickSlip> {
        if let Self::StickSlip(found) = self { Some(found) } else { None }
    }
}

/// Least width of an oscillation, relative to the one that four fifths of those of its direction do not
/// exceed: a seal that sticks and slips does so between nearly the same two forces at most speeds, while
/// a drive vibrates less.
const WIDE: f64 = 0.5;

/// Those of each recording that are as wide as others of their direction.
fn wide_oscillations<'a>(
    recordings: &'a [Recording],
    segments: &[Segments],
    offset: f64,
    small: bool,
) -> Vec<Vec<Oscillation<'a>>> {
    let each = recordings.iter().zip(segments);
    let mut each: Vec<Vec<Oscillation>> =
        each.map(|(r, s)| oscillations(r, s, offset, small)).collect();
    for inserts in [false, true] {
        let own = each.iter().flatten().filter(|o| o.inserts == inserts);
        let mut widths: Vec<f64> = own.map(|o| o.width).collect();
        widths.sort_by(f64::total_cmp);
        if let Some(usual) = widths.get(4 * widths.len().saturating_sub(1) / 5) {
            let is_wide = |o: &Oscillation| o.inserts != inserts || o.width >= WIDE * usual;
            each.iter_mut().for_each(|own| own.retain(is_wide));
        }
    }
    each
}

/// Number of plateaus up to a speed, m/s, that would show an oscillation with a period of `travel`, m.
fn watched_up_to(
    recordings: &[Recording],
    segments: &[Segments],
    fastest: f64,
    travel: f64,
) -> usize {
    let plateaus = recordings.iter().zip(segments).flat_map(|(recording, segments)| {
        segments.plateaus().map(move |plateau| (recording, plateau))
    });
    let watched = plateaus.filter(|(recording, plateau)| {
        let Some((from, last)) = watched(plateau) else { return false };
        let samples = last + 1 - from;
        let periods = (recording.position[last] - recording.position[from]).abs() / travel;
        samples >= FEWEST_SAMPLES
            && periods >= FEWEST_PERIODS as f64
            && (samples as f64) < LONGEST_PERIOD as f64 * periods
            && plateau[0].velocity.abs() <= OTHER_SPEED.sqrt() * fastest
    });
    watched.count()
}

/// First and last sample of a plateau after its first third.
fn watched(plateau: &[SteadySegment]) -> Option<(usize, usize)> {
    let (start, end) = (plateau.first()?.start, plateau.last()?.end);
    Some((start + (end - start) / 3, end - 1))
}

/// Typical travel, m, within one period.
fn travel<'a>(all: impl Iterator<Item = &'a Oscillation<'a>>) -> Option<f64> {
    median(all.map(|o| o.speed / o.frequency).collect())
}

/// Period, m, of an oscillation that recurs at the same positions at other speeds of the same
/// direction; `None` if it does not, and where no two speeds can be compared.
fn period_over_position(recordings: &[Vec<Oscillation>]) -> Option<f64> {
    let period = travel(recordings.iter().flatten())?;
    let mut correlations = Vec::new();
    for all in recordings {
        for (k, one) in all.iter().enumerate() {
            let next = all[k + 1..].iter().find(|o| {
                o.inserts == one.inserts && (o.speed / one.speed).ln().abs() > OTHER_SPEED.ln()
            });
            correlations.extend(next.and_then(|other| correlation(one, other, period / CELLS)));
        }
    }
    median(correlations).filter(|middle| *middle > SAME_PLACES).map(|_| period)
}

/// Correlation of the forces of two plateaus over position cells of length `cell`, m.
fn correlation(one: &Oscillation, other: &Oscillation, cell: f64) -> Option<f64> {
    let (own, others) = (range(one.positions), range(other.positions));
    let (from, to) = (own.0.max(others.0), own.1.min(others.1));
    let cells = ((to - from) / cell).max(0.0) as usize;
    let [means, others] = [one, other].map(|of| {
        let mut sums = vec![(0.0, 0.0); cells];
        for (x, force) in of.positions.iter().zip(of.readings) {
            if let Some((sum, count)) =
                sums.get_mut(((x - from) / cell).floor() as usize).filter(|_| *x >= from)
            {
                (*sum, *count) = (*sum + force, *count + 1.0);
            }
        }
        sums.into_iter().map(|(sum, count)| sum / count)
    });
    let pairs: Vec<(f64, f64)> = means.zip(others).filter(|(a, b)| (a + b).is_finite()).collect();
    let n = pairs.len() as f64;
    let (a, b) = pairs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let product =
        |of: fn(f64, f64) -> f64| pairs.iter().map(|(x, y)| of(x - a, y - b)).sum::<f64>();
    let scale = (product(|x, _| x * x) * product(|_, y| y * y)).sqrt();
    (pairs.len() >= FEWEST_CELLS && scale > 0.0).then(|| product(|x, y| x * y) / scale)
}

/// Oscillations of the force about its mean on each velocity plateau after its first third. A
/// plateau is used as a whole because the slips of a seal disturb the drive, too. `small` ones count,
/// or only large ones.
fn oscillations<'a>(
    recording: &'a Recording,
    segments: &Segments,
    offset: f64,
    small: bool,
) -> Vec<Oscillation<'a>> {
    let plateaus = segments.plateaus().collect::<Vec<_>>().into_par_iter();
    let found = plateaus.filter_map(|plateau| {
        let (from, last) = watched(plateau)?;
        let force = &recording.force[from..=last];
        let mut sorted = force.to_vec();
        sorted.sort_by(f64::total_cmp);
        let [low, middle, high] =
            [0.02, 0.5, 0.98].map(|part| sorted[(part * (sorted.len() - 1) as f64) as usize]);
        let noise = OVER_NOISE * recording.quality.force_noise;
        if !small && high - low < LEAST_SWING * (middle - offset).abs() + noise {
            return None;
        }
        let (period, variance) = period_of(force)?;
        let own = (variance - recording.quality.force_noise.powi(2)).max(0.0);
        let [time, way] =
            [&recording.time, &recording.position].map(|column| column[last] - column[from]);
        let [one, other] = [low, high].map(|level| (level - offset).abs());
        Some(Oscillation {
            frequency: (last - from) as f64 / (period as f64 * time),
            force: [one.min(other), one.max(other)],
            width: (12.0 * own).sqrt(),
            speed: (way / time).abs(),
            inserts: recording.position[last] > recording.position[from],
            strokes: plateau[0].stroke..=plateau[plateau.len() - 1].stroke,
            positions: &recording.position[from..=last],
            readings: force,
        })
    });
    found.collect()
}

/// Period, in samples, and variance, N², of a force that oscillates about its straight trend.
fn period_of(force: &[f64]) -> Option<(usize, f64)> {
    let n = force.len();
    if n < FEWEST_SAMPLES {
        return None;
    }
    let about = 0.5 * (n - 1) as f64;
    let at = |i: usize| i as f64 - about;
    let mean = force.iter().sum::<f64>() / n as f64;
    let squares: f64 = (0..n).map(|i| at(i).powi(2)).sum();
    let slope = (0..n).map(|i| at(i) * force[i]).sum::<f64>() / squares;
    let off: Vec<f64> = (0..n).map(|i| force[i] - mean - slope * at(i)).collect();
    let product = |lag: usize| -> f64 { off.iter().zip(&off[lag..]).map(|(a, b)| a * b).sum() };
    let power = product(0);
    let least = LEAST_CORRELATION.max(OVER_ERROR / (n as f64).sqrt());
    let (mut is_past_valley, mut best) = (false, (0, least * power));
    for lag in 1..LONGEST_PERIOD.min(n / FEWEST_PERIODS) {
        let correlation = product(lag);
        if correlation < VALLEY * power {
            // Later periods correlate alike: the first is the period.
            if best.0 > 0 {
                break;
            }
            is_past_valley = true;
        } else if is_past_valley && correlation > best.1 {
            best = (lag, correlation);
        }
    }
    (best.0 > 0).then_some((best.0, power / n as f64))
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use super::*;
    use crate::segment::{SegmentOptions, segment};

    /// Strokes of 10 mm at the first six multiples of a speed, mm/s, during which the force swings by
    /// 0.4 N every 0.5 mm at those that `swing`.
    fn strokes(slowest: f64, swing: impl Fn(f64) -> bool) -> Recording {
        swinging(slowest, |speed| if swing(speed) { 0.4 } else { 0.0 })
    }

    /// The same by a width, N, at each speed.
    fn swinging(slowest: f64, width: impl Fn(f64) -> f64) -> Recording {
        at_speeds((0..12).map(|stroke| slowest * f64::from(1 + stroke / 2)), width)
    }

    /// Strokes of 10 mm, the next one back, at these speeds, mm/s.
    pub(super) fn at_speeds(
        speeds: impl Iterator<Item = f64>,
        width: impl Fn(f64) -> f64,
    ) -> Recording {
        let (mut time, mut position, mut force) = (vec![0.0], vec![0.0], vec![0.0]);
        for (stroke, speed) in (0..).zip(speeds) {
            let sign = if stroke % 2 == 0 { 1.0 } else { -1.0 };
            // Slips begin anywhere.
            let phase = 0.37 * f64::from(stroke);
            for k in 1..=(10e3 / speed) as u32 {
                let way = 1e-3 * speed * f64::from(k);
                let saw = (2.0 * way + phase).fract() - 0.5;
                time.push(1e-3 * time.len() as f64);
                position.push(1e-3 * if sign > 0.0 { way } else { 10.0 - way });
                force.push(sign * (2.0 + width(speed) * saw));
            }
        }
        Recording::from_columns("strokes", time, position, force).expect("a recording")
    }

    fn found(recording: Recording) -> Option<Swings> {
        let segments = [segment(&recording, &SegmentOptions::default())];
        Swings::of(&[recording], &segments, 0.0, false)
    }

    #[test]
    fn swings_too_slow_to_be_seen_at_the_slowest_speeds_are_no_resonance() {
        let all = found(strokes(0.2, |_| true));
        assert!(matches!(all, Some(Swings::StickSlip(StickSlip { plateaus: 4..=8, .. }))));
    }

    #[test]
    fn strokes_that_swing_are_left_out_where_enough_others_are_left() {
        let left_out = |recording: Recording| {
            let segments = [segment(&recording, &SegmentOptions::default())];
            let out = LeftOut::of(&[recording], &segments, 0.0).0.remove(0);
            (out, segments[0].strokes.clone())
        };
        let (out, strokes) = left_out(self::strokes(1.0, |speed| speed < 1.5));
        let slow: Vec<Range<usize>> = strokes[..2].iter().map(|s| s.start..s.end).collect();
        assert_eq!(out.strokes, slow);
        assert!(out.swings_at(slow[0].start) && !out.swings_at(strokes[2].start));
        // What slides without a swing is left in one piece, up to the last reversal.
        let last = out.rest.last().map(|piece| piece.samples.clone());
        assert_eq!(last, Some(strokes[2].start..strokes[11].end + 1));
        assert!(left_out(self::strokes(1.0, |speed| speed < 5.5)).0.strokes.is_empty());
        assert!(left_out(self::strokes(1.0, |_| false)).0.strokes.is_empty());
    }

    /// The force rises over 1 mm and falls within a sample.
    #[test]
    fn samples_at_which_the_seal_lets_go_are_found() {
        let (mut time, mut position, mut force) = (vec![0.0], vec![0.0], vec![-2.0]);
        for k in 1..=4000 {
            let (stroke, way) = (k / 1000, f64::from(k % 1000));
            let s = if stroke % 2 == 0 { 1.0 } else { -1.0 };
            let at = if s > 0.0 { way } else { 1000.0 - way };
            time.push(1e-3 * f64::from(k));
            position.push(1e-5 * at);
            force.push(s * if way < 100.0 { -2.0 + 0.045 * way } else { 2.0 });
        }
        let recording = Recording::from_columns("rises", time, position, force).unwrap();
        let segments = [segment(&recording, &SegmentOptions::default())];
        let found = LeftOut::of(&[recording], &segments, 0.0).0.remove(0).releases;
        assert_eq!(found, [99..101, 1099..1101, 2099..2101, 3099..3101]);
    }

    /// The drive vibrates at the fastest speeds, and the seal sticks and slips at the slowest.
    #[test]
    fn a_drive_that_vibrates_less_does_not_hide_a_seal_that_sticks_and_slips() {
        let both = |speed: f64| match speed {
            speed if speed < 3.5 => 0.4,
            speed if speed > 4.5 => 0.15,
            _ => 0.0,
        };
        match found(swinging(1.0, both)) {
            Some(Swings::StickSlip(all)) => assert!(all.speed_m_s[1] < 3.5e-3, "{all:?}"),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_seal_may_swing_less_in_one_direction() {
        let mut recording = strokes(1.0, |speed| speed < 4.5);
        let withdrawal = recording.force.iter_mut().filter(|force| **force < 0.0);
        withdrawal.for_each(|force| *force = -2.0 + 0.4 * (*force + 2.0));
        match found(recording) {
            Some(Swings::StickSlip(all)) => assert_eq!(all.plateaus, 8, "{all:?}"),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_swings_at_the_fastest_speed_alone_is_a_resonance() {
        assert!(matches!(found(strokes(1.0, |speed| speed > 5.5)), Some(Swings::Rig { .. })));
        assert!(found(strokes(1.0, |_| false)).is_none());
    }
}
