//! What no fit can follow of a recording of a seal that lets go by a jump, and what is left of it.
//!
//! When each slip begins no model tells, so after the first slip of a stroke the state of the seal is
//! known again only where it slides faster than it swings. At a reversal the reading tells it: the seal let
//! go at the end of its branch and has moved back from there. From that reading on it deforms until it lets
//! go, at its static force.

use std::ops::Range;

use trocar_recording::{Recording, local_velocity, median, velocity_window};

use super::{OTHER_SPEED, OVER_NOISE, Oscillation, StickSlip, Swings, travel, wide_oscillations};
use crate::segment::{Direction, Segments, Stroke};

/// Fewest strokes that are left in each direction: with one there would be no scatter.
const FEWEST_KEPT: usize = 2;

/// Samples of a recording at which no fit can follow the seal, in order.
#[derive(Debug, Clone, Default)]
pub struct LeftOut {
    /// Strokes during which it sticks and slips: the mean of its force over a swing is not its sliding
    /// force.
    pub strokes: Vec<Range<usize>>,
    /// Instants at which it lets go by a jump. When it does, no model tells to a sample, and being a
    /// sample late costs as much there as all other samples together: a fit would rather have no jump
    /// at all.
    pub releases: Vec<Range<usize>>,
    /// What is left of a recording of a seal that sticks and slips, in order. Empty for another seal.
    pub rest: Vec<Piece>,
    /// Travel, m, from each reversal to where the seal is seen to let go.
    pub to_release: Vec<f64>,
}

/// A part of a recording through which a model can follow a seal that sticks and slips.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece {
    /// Its samples.
    pub samples: Range<usize>,
    /// The direction of the motion before the reversal with which it begins, and the samples about that
    /// whose readings tell the state; `None` where the state is unknown.
    pub begins: Option<(Direction, Range<usize>)>,
    /// Direction of the motion and reading, N, at which the seal lets go at its end, between two samples.
    pub lets_go: Option<(Direction, f64)>,
}

impl Piece {
    /// From an unknown state.
    #[must_use]
    pub fn unknown(samples: Range<usize>) -> Self {
        Self { samples, begins: None, lets_go: None }
    }
}

impl LeftOut {
    /// Nothing.
    pub const NONE: &Self = &Self {
        strokes: Vec::new(),
        releases: Vec::new(),
        rest: Vec::new(),
        to_release: Vec::new(),
    };

    /// Whether the seal sticks and slips in the stroke with the sample `i`.
    #[must_use]
    pub fn swings_at(&self, i: usize) -> bool {
        self.strokes.iter().any(|stroke| stroke.contains(&i))
    }

    /// The parts of its recording through which a model can follow the seal: the unbroken ones where
    /// nothing is left out.
    #[must_use]
    pub fn pieces(&self, recording: &Recording) -> Vec<Piece> {
        let all = match self.strokes.is_empty() && self.rest.is_empty() {
            true => recording.unbroken().map(Piece::unknown).collect(),
            false => self.rest.clone(),
        };
        all.into_iter().filter(|piece| piece.samples.len() > 1).collect()
    }

    /// The segmentation without constant-velocity segments during which the seal sticks and slips.
    #[must_use]
    pub fn smooth(&self, segments: &Segments) -> Segments {
        let mut smooth = segments.clone();
        smooth.steady_segments.retain(|segment| !self.swings_at(segment.start));
        smooth
    }

    /// Of each recording, whose readings contain the sensor offset `offset`, N, and how the seal sticks
    /// and slips if what is left begins at reversals. No stroke where too few would be left.
    #[must_use]
    pub fn of(
        recordings: &[Recording],
        segments: &[Segments],
        offset: f64,
    ) -> (Vec<Self>, Option<StickSlip>) {
        let swings = wide_oscillations(recordings, segments, offset, true);
        let found = Swings::caused(recordings, segments, &swings).and_then(Swings::stick_slip);
        let fastest = segments.iter().flat_map(|s| &s.steady_segments).map(|s| s.velocity.abs());
        let fastest = fastest.fold(0.0, f64::max);
        let is_slow = found.as_ref().is_some_and(|found| found.speed_m_s[1] < SLOW * fastest);
        let whole = || {
            let each = recordings.iter().zip(&swings).zip(segments);
            let all: Vec<Self> = each.map(|((r, own), s)| Self::whole(r, own, s)).collect();
            Self::leave_enough(&all, segments, false).then_some(all)
        };
        let from_readings = || {
            let all = Swinging::rest(&swings, recordings, segments);
            Self::leave_enough(&all, segments, true).then_some(all)
        };
        let whole = if is_slow { whole() } else { None };
        let anew = found.as_ref().filter(|_| whole.is_none()).and_then(|_| from_readings());
        let found = found.filter(|_| anew.is_some());
        let all = whole.or(anew).unwrap_or_else(|| vec![Self::default(); recordings.len()]);
        let each = recordings.iter().zip(segments).zip(all);
        let with_releases = each.map(|((recording, segments), more)| {
            let releases = releases(recording, segments, offset);
            Self { releases, ..more }
        });
        (with_releases.collect(), found)
    }

    /// Without the strokes during which the seal is seen to swing.
    fn whole(recording: &Recording, swings: &[Oscillation], segments: &Segments) -> Self {
        let mut all: Vec<usize> = swings.iter().flat_map(|o| o.strokes.clone()).collect();
        all.dedup();
        let mut out = Self::default();
        for Range { start, end } in recording.unbroken() {
            let mut from = start;
            for stroke in all.iter().map(|k| &segments.strokes[*k]) {
                if stroke.start < end && stroke.end > start {
                    // The last sample of a stroke is the first of the next one.
                    out.rest.push(Piece::unknown(from..stroke.start + 1));
                    out.strokes.push(stroke.start..stroke.end);
                    from = stroke.end;
                }
            }
            out.rest.push(Piece::unknown(from..end));
        }
        out
    }

    /// Whether enough strokes in each direction are left.
    fn leave_enough(all: &[Self], segments: &[Segments], from_readings: bool) -> bool {
        Direction::BOTH.into_iter().all(|direction| {
            let left = segments.iter().zip(all).flat_map(|(segments, out)| {
                segments.strokes.windows(2).filter(move |pair| {
                    // Without a reading to begin with, a stroke shows its deformation only after one
                    // that is left, too.
                    let before = from_readings || !out.swings_at(pair[0].start);
                    pair[1].direction == direction && before && !out.swings_at(pair[1].start)
                })
            });
            left.count() >= FEWEST_KEPT
        })
    }
}

/// Part of the fastest speed up to which swings concern but the slow strokes: these are left out as a
/// whole, since others tell the same.
const SLOW: f64 = 0.5;

/// How the force swings in one direction: the upper of its two values, with the sensor offset, its
/// width, N, the travel of one swing, m, the time of the shortest, s, and the fastest speed at which it
/// does, m/s.
struct Swinging {
    direction: Direction,
    upper: f64,
    width: f64,
    travel: f64,
    period: f64,
    fastest: f64,
}

/// Least part of a stroke that is faster than the seal swings, for the stroke to be one of sliding.
const LEAST_SMOOTH: f64 = 0.3;
/// Part of the travel, or of the time, of a swing within which a seal that slid does not begin to swing
/// before it turns, and part of that travel over which readings about a reversal are of the same state.
const NO_SWING: f64 = 0.5;
const AT_REST: f64 = 0.02;
/// Acceleration, m/s², about a reversal above which a reading there is no force of the seal: 0.1 kg then
/// has 0.3 N, and how much it is, is known to a tenth only. Time about the reversal over which it is taken,
/// s, and in samples.
const VIOLENT: f64 = 3.0;
const TURNS: f64 = 0.01;
const TURNS_SAMPLES: f64 = 3.0;
/// Travels from a reversal to where the seal lets go, as parts of the usual one: at others the force falls
/// for another reason.
const USUAL: [f64; 2] = [0.75, 1.33];
/// Samples before the seal lets go that tell how its force rises.
const RISING: usize = 4;

impl Swinging {
    /// What is left of recordings of a seal that sticks and slips.
    fn rest(
        swings: &[Vec<Oscillation>],
        recordings: &[Recording],
        segments: &[Segments],
    ) -> Vec<LeftOut> {
        let both: Vec<Self> =
            Direction::BOTH.into_iter().filter_map(|own| Self::of(swings, own)).collect();
        let all: Vec<Followed> = recordings.iter().map(|own| Followed::new(&both, own)).collect();
        let to_release = |(own, segments): (&Followed, &Segments)| {
            segments.strokes.iter().filter_map(|stroke| own.to_release(stroke)).collect::<Vec<_>>()
        };
        let usual = median(all.iter().zip(segments).flat_map(to_release).collect());
        all.iter().zip(segments).map(|(own, segments)| own.left_out(segments, usual)).collect()
    }

    fn of(each: &[Vec<Oscillation>], direction: Direction) -> Option<Self> {
        let inserts = direction == Direction::Insertion;
        let own = || each.iter().flatten().filter(|o| o.inserts == inserts);
        let upper = |o: &Oscillation| {
            let mut all: Vec<f64> = o.readings.iter().map(|f| direction.sign() * f).collect();
            all.sort_by(f64::total_cmp);
            all[(0.98 * (all.len() - 1) as f64) as usize]
        };
        Some(Self {
            direction,
            upper: median(own().map(upper).collect())?,
            width: median(own().map(|o| o.force[1] - o.force[0]).collect())?,
            travel: travel(own())?,
            period: 1.0 / own().map(|o| o.frequency).fold(0.0, f64::max),
            fastest: OTHER_SPEED.sqrt() * own().map(|o| o.speed).fold(0.0, f64::max),
        })
    }

    /// Where the seal lets go for the first time in a stroke, and the reading at which it does: the sample
    /// after which its force has fallen by half of a swing, and the straight line through those before
    /// it, half a sample later.
    fn release(&self, force: &[f64], stroke: &Stroke) -> Option<(usize, f64)> {
        let (s, half) = (self.direction.sign(), 0.5 * self.width);
        let (mut peak, mut highest) = (stroke.start, f64::NEG_INFINITY);
        for i in stroke.start..stroke.end {
            if s * force[i] > highest {
                (peak, highest) = (i, s * force[i]);
            } else if highest > self.upper - half && s * force[i] < highest - half {
                let last = &force[(peak + 1).saturating_sub(RISING).max(stroke.start)..=peak];
                let steps = (last.len() - 1) as f64;
                let mean = last.iter().sum::<f64>() / last.len() as f64;
                let slope = (last[last.len() - 1] - last[0]) / steps.max(1.0);
                return Some((peak, mean + 0.5 * slope * (steps + 1.0)));
            }
        }
        None
    }
}

/// A recording of a seal that sticks and slips.
struct Followed<'a> {
    both: &'a [Swinging],
    recording: &'a Recording,
    /// m/s.
    velocity: Vec<f64>,
    /// Time over which it is taken, s.
    window: f64,
}

/// The state with which a piece begins, as in [`Piece::begins`].
type Begins = Option<(Direction, Range<usize>)>;

impl<'a> Followed<'a> {
    fn new(both: &'a [Swinging], recording: &'a Recording) -> Self {
        let window = velocity_window(recording);
        Self { both, recording, velocity: local_velocity(recording, window), window }
    }

    /// Distance of two samples, m.
    fn travel(&self, from: usize, to: usize) -> f64 {
        (self.recording.position[to] - self.recording.position[from]).abs()
    }

    /// How the seal swings in a direction.
    fn own(&self, direction: Direction) -> Option<&Swinging> {
        self.both.iter().find(|own| own.direction == direction)
    }

    /// First and last sample of a stroke at which the seal slides without swings, where that is most of
    /// the stroke.
    fn slides(&self, stroke: &Stroke) -> Option<[usize; 2]> {
        let fastest = self.own(stroke.direction).map_or(0.0, |own| own.fastest);
        let is_fast = |i: &usize| self.velocity[*i].abs() > fastest;
        let mut all = stroke.start..stroke.end;
        let (first, last) = (all.clone().find(is_fast)?, all.rfind(is_fast)?);
        let is_most =
            self.travel(first, last) > LEAST_SMOOTH * self.travel(stroke.start, stroke.end);
        is_most.then_some([first, last])
    }

    fn release(&self, stroke: &Stroke) -> Option<(usize, f64)> {
        self.own(stroke.direction)?.release(&self.recording.force, stroke)
    }

    /// Travel to where the seal lets go in a stroke with swings, m.
    fn to_release(&self, stroke: &Stroke) -> Option<f64> {
        let (at, _) = self.release(stroke).filter(|_| self.slides(stroke).is_none())?;
        Some(self.travel(stroke.start, at))
    }

    /// Whether a seal that slides up to the sample `last` does not begin to swing before the stroke ends.
    fn keeps_sliding(&self, stroke: &Stroke, last: usize) -> bool {
        let time = self.recording.time[stroke.end] - self.recording.time[last];
        self.own(stroke.direction).is_none_or(|own| {
            self.travel(last, stroke.end) < NO_SWING * own.travel || time < NO_SWING * own.period
        })
    }

    /// What tells the state at the reversal with which a stroke begins.
    fn begins(&self, stroke: &Stroke) -> Begins {
        let (time, at) = (&self.recording.time, stroke.start);
        let quality = &self.recording.quality;
        let swing = self.both.iter().map(|own| own.travel).fold(f64::INFINITY, f64::min);
        let near = (AT_REST * swing).max(1.5 * quality.position_resolution);
        let is_near =
            |i: &usize| self.travel(*i, at) <= near && (time[*i] - time[at]).abs() < self.window;
        let from = (0..at).rev().take_while(is_near).last().unwrap_or(at);
        let to = (at + 1..stroke.end).take_while(is_near).last().unwrap_or(at);
        let turns = TURNS.max(TURNS_SAMPLES * quality.median_interval);
        let [before, after] = [-turns, turns]
            .map(|more| time.partition_point(|t| *t < time[at] + more).min(time.len() - 1));
        let speed = |a: usize, b: usize| self.travel(a, b) / (time[b] - time[a]);
        // It turns in between.
        let change = speed(before, at) + speed(at, after);
        let is_gentle = 2.0 * change < VIOLENT * (time[after] - time[before]);
        let is_known = stroke.starts_at_reversal && before < at && is_gentle;
        is_known.then(|| (stroke.direction.opposite(), from..to + 1))
    }

    /// What is left; `usual` is the travel from a reversal to where the seal lets go, m.
    fn left_out(&self, Segments { strokes, .. }: &Segments, usual: Option<f64>) -> LeftOut {
        let mut out = LeftOut::default();
        let mut open: Option<(usize, Begins)> = None;
        for (k, stroke) in strokes.iter().enumerate() {
            let is_usual = |(at, _): &(usize, f64)| {
                let part = usual.map(|usual| self.travel(stroke.start, *at) / usual);
                part.is_some_and(|part| USUAL[0] < part && part < USUAL[1])
            };
            let release = self.release(stroke).filter(is_usual);
            let (from, begins) = open.take().unwrap_or_else(|| (stroke.start, self.begins(stroke)));
            let up_to = |end: usize, reading: Option<f64>| Piece {
                samples: from..end + 1,
                begins: begins.clone(),
                lets_go: reading.map(|reading| (stroke.direction, reading)),
            };
            out.to_release.extend(release.map(|(at, _)| self.travel(stroke.start, at)));
            let Some([first, last]) = self.slides(stroke) else {
                out.strokes.push(stroke.start..stroke.end);
                // What slid before ends here at the latest.
                let (end, reading) = release.map_or((stroke.start, None), |(at, f)| (at, Some(f)));
                out.rest.push(up_to(end, reading));
                continue;
            };
            // Where a stroke begins with a known state, its deformation ends where the seal lets go.
            let (from, begins) = match release.filter(|_| from == stroke.start && begins.is_some())
            {
                Some((at, reading)) => {
                    out.rest.push(up_to(at, Some(reading)));
                    (first.max(at + 1), None)
                }
                None => (from, begins),
            };
            let keeps = self.keeps_sliding(stroke, last);
            if keeps && strokes.get(k + 1).is_some_and(|next| next.start == stroke.end) {
                open = Some((from, begins));
                continue;
            }
            let end = if keeps { stroke.end } else { last };
            out.rest.push(Piece { samples: from..end + 1, begins, lets_go: None });
        }
        out
    }
}

/// Least excess of the force at which the seal lets go over that of the plateau that follows, as a
/// part of that force and in units of the noise.
const LEAST_EXCESS: f64 = 0.02;
/// Part of the excess below which the force has fallen; longest time for that, s, and longest where it
/// is but a few samples.
const FALLEN: f64 = 0.2;
const LONGEST_FALL: f64 = 0.02;
const LONGEST_FEW: f64 = 0.05;
const FEW: usize = 4;

fn releases(recording: &Recording, segments: &Segments, offset: f64) -> Vec<Range<usize>> {
    let (force, time) = (&recording.force, &recording.time);
    let releases = segments.strokes.iter().filter_map(|stroke| {
        let s = stroke.direction.sign();
        let settled = segments
            .steady_segments
            .iter()
            .filter(|part| stroke.start <= part.start && part.end <= stroke.end);
        let settled = settled.flat_map(|part| part.start..part.end).map(|i| s * force[i]);
        let level = median(settled.collect())?;
        let above = |i: usize| s * force[i] - level;
        let peak = (stroke.start..stroke.end).max_by(|a, b| above(*a).total_cmp(&above(*b)))?;
        let noise = OVER_NOISE * recording.quality.force_noise;
        let is_large = above(peak) > LEAST_EXCESS * (level - s * offset).abs() + noise;
        let fallen = (peak..stroke.end).find(|i| above(*i) < FALLEN * above(peak))?;
        let longest = if fallen - peak <= FEW { LONGEST_FEW } else { LONGEST_FALL };
        let is_sudden = time[fallen] - time[peak] <= longest;
        (is_large && is_sudden).then(|| peak..fallen + 1)
    });
    releases.collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::at_speeds;
    use super::*;
    use crate::replay::{replay, replay_rest};
    use crate::segment::{SegmentOptions, segment};
    use trocar_model::{Classical, Dahl, DahlParams, Trocar};

    /// Strokes of 10 mm at these speeds, mm/s, without a swing.
    fn strokes(speeds: &[f64]) -> Recording {
        at_speeds(speeds.iter().copied(), |_| 0.0)
    }

    fn one(stroke: Range<usize>) -> Vec<Range<usize>> {
        vec![stroke]
    }

    #[test]
    fn what_slides_before_a_stroke_that_is_not_seen_to_let_go_is_left() {
        let recording = strokes(&[20.0, 20.0, 20.0, 2.0, 20.0, 20.0]);
        let both = Direction::BOTH.map(|direction| {
            let (upper, width, travel, period) = (2.2, 0.4, 5e-4, 0.05);
            Swinging { direction, upper, width, travel, period, fastest: 0.01 }
        });
        let segments = segment(&recording, &SegmentOptions::default());
        let out = Followed::new(&both, &recording).left_out(&segments, Some(1e-3));
        let slow = &segments.strokes[3];
        assert_eq!(out.strokes, one(slow.start..slow.end));
        let left: Vec<_> = out.pieces(&recording).into_iter().map(|own| own.samples).collect();
        assert_eq!(left, [0..slow.start + 1, slow.end..recording.len()]);
    }

    #[test]
    fn where_no_piece_is_left_nothing_is_followed() {
        let recording = strokes(&[20.0, 20.0]);
        let out = LeftOut { strokes: one(0..recording.len()), ..LeftOut::default() };
        assert!(out.pieces(&recording).is_empty());
        assert_eq!(LeftOut::NONE.pieces(&recording), [Piece::unknown(0..recording.len())]);
    }

    #[test]
    fn what_lies_before_the_first_piece_is_not_known() {
        let recording = strokes(&[20.0, 20.0, 20.0, 20.0]);
        let (stiffness, coulomb_force, exponent) = (2e4, 2.0, 1.0);
        let dahl = DahlParams { stiffness, coulomb_force, exponent, viscous_damping: 1.0 };
        let trocar = Trocar::of_seal(Classical::Dahl(Dahl::new(dahl).expect("a model")));
        let whole = replay(&trocar, &recording, 0.0);
        let begin = recording.len() / 2;
        let rest = vec![Piece::unknown(begin..recording.len())];
        let out = LeftOut { strokes: one(0..begin), rest, ..LeftOut::default() };
        let run = replay_rest(&trocar, &recording, |i| recording.force[i], &out);
        assert!(whole.known[0].start < begin);
        assert!(!run.known.is_empty() && run.known.iter().all(|known| known.start > begin));
        assert_eq!(run.force[..begin], whole.force[..begin]);
    }
}
