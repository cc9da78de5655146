//! Differences between repeats of one stroke: a lower bound for the error of any model of the
//! position alone.
//!
//! Strokes are *repeats* when they have the same direction, the same range of positions and similar
//! speeds. A reading is compared with those of the other repeats at the same place:
//!
//! ```text
//! e_i = F_i − mean of the others at the place of i        s² = mean of e²/(1 + 1/m)        m others
//! ```
//! Thus s is the standard deviation of a single reading about the mean of infinitely many repeats.
//! The reading itself is not smoothed; the others are interpolated linearly, which makes s too
//! small by at most the fraction 1/(6m).
//!
//! # The same place
//!
//! While the seal slides, the place is the position. After a reversal the force depends on the
//! travel since then, and strokes reverse at slightly different positions. Before the next reversal
//! the instrument slows down, and the place is the remaining distance. The lengths over which
//! reversals count are chosen to minimise the squared error, among a few fractions of the range;
//! zero lengths mean that the position alone is as repeatable. Within these lengths of a start or
//! an end without reversal (of the recording, at a gap) nothing is compared.
//!
//! # What a model can reach
//!
//! A model that knows the mean of infinitely many repeats has the error s on a held-out stroke. One
//! that estimates the mean from n repeats has the error s·√(1 + 1/n) at best: for n = 5 that is
//! 1.095·s.

use rayon::prelude::*;
use serde::Serialize;

use super::segment::{Direction, Stroke, reversal_threshold, strokes};
use trocar_recording::{Recording, local_velocity};

/// Largest relative difference of the median speeds of repeats.
const LIKE_SPEED: f64 = 0.25;
/// Least fraction of the longer range of positions that two repeats share.
const LIKE_RANGE: f64 = 0.5;
/// Window of the velocity, s.
const VELOCITY_WINDOW: f64 = 0.05;
/// Lengths tried about a reversal, as fractions of the median range of the repeats.
const LENGTHS: [f64; 8] = [0.0025, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12];
/// Most repeats that one stroke is compared with.
const MOST_OTHERS: usize = 32;

/// Scatter between the repeats of one direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DirectionScatter {
    /// Direction.
    #[serde(serialize_with = "super::segment::direction_as_word")]
    pub direction: Direction,
    /// Standard deviation of a reading about the mean of infinitely many repeats, N.
    pub scatter_n: f64,
    /// The same with a line over the repeats removed at each place, N; `None` below four repeats.
    pub without_drift_n: Option<f64>,
    /// Strokes that have a repeat.
    pub strokes: usize,
}

/// Scatter between repeated strokes in one recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StrokeScatter {
    /// Standard deviation of a reading about the mean of infinitely many repeats, N.
    pub scatter_n: f64,
    /// The same with a drift removed that is linear in the number of the repeat, N; `None` below
    /// four repeats. If it is well below `scatter_n`, the strokes were a run-in, not repeats.
    pub without_drift_n: Option<f64>,
    /// Groups of repeats.
    pub groups: usize,
    /// Strokes in them.
    pub strokes: usize,
    /// Strokes less groups: degrees of freedom of the variance at one place. Neighbouring places
    /// are not independent.
    pub degrees_of_freedom: usize,
    /// Readings compared.
    pub samples: usize,
    /// By direction, insertion first; a direction without repeats is omitted.
    pub by_direction: Vec<DirectionScatter>,
    /// Travel after a reversal up to which repeats are compared at equal travel, m.
    pub after_reversals_m: f64,
    /// Distance before a reversal up to which repeats are compared at equal distance, m.
    pub before_reversals_m: f64,
    /// e²/(1 + 1/m) of every sample of the recording, N²; NaN without a repeat.
    #[serde(skip)]
    squares: Vec<f64>,
}

impl StrokeScatter {
    /// Scatter between the repeats in `recording`; `None` when no stroke has one: the same direction,
    /// median speeds within 25 %, more than half of the range of positions in common.
    pub fn of(recording: &Recording) -> Option<Self> {
        let strokes = strokes(recording, reversal_threshold(recording));
        let groups: Vec<Group> =
            groups(recording, &strokes).into_iter().filter(|g| g.tracks.len() > 1).collect();
        if groups.is_empty() {
            return None;
        }
        let compared: Vec<Compared> = groups.iter().map(|group| group.compare(recording)).collect();
        let mut squares = vec![f64::NAN; recording.len()];
        compared.iter().flat_map(|c| &c.readings).for_each(|r| squares[r.sample] = r.square());
        let all: Vec<&Compared> = compared.iter().collect();
        let number = groups.iter().map(|g| g.tracks.len()).sum::<usize>();
        let [after_reversals_m, before_reversals_m] =
            [0, 1].map(|side| compared.iter().map(|c| c.lengths[side]).fold(0.0, f64::max));
        Some(Self {
            scatter_n: pooled(&all, Reading::square)?,
            without_drift_n: without_drift(&all),
            groups: groups.len(),
            strokes: number,
            degrees_of_freedom: number - groups.len(),
            samples: squares.iter().filter(|s| s.is_finite()).count(),
            by_direction: by_direction(&groups, &compared),
            after_reversals_m,
            before_reversals_m,
            squares,
        })
    }

    /// Scatter, N, over the samples selected by `chosen`; `None` when nothing repeats there.
    pub fn over(&self, chosen: impl Fn(usize) -> bool) -> Option<f64> {
        root_mean((0..self.squares.len()).filter(|i| chosen(*i)).map(|i| self.squares[i]))
    }

    /// Whether at least half of the recording's samples have a repeat: the recording consists of
    /// repeated strokes. In hand-like motion some strokes are similar by chance, but the motion
    /// before them is not.
    pub fn rules(&self, recording: &Recording) -> bool {
        2 * self.samples >= recording.len()
    }

    /// Whether sample `i` has a repeat to be compared with.
    pub fn covers(&self, i: usize) -> bool {
        self.squares.get(i).is_some_and(|square| square.is_finite())
    }
}

/// Square root of the mean of the finite values.
fn root_mean(squares: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) =
        squares.filter(|s| s.is_finite()).fold((0.0, 0usize), |(sum, n), s| (sum + s, n + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

fn pooled(compared: &[&Compared], of: fn(&Reading) -> f64) -> Option<f64> {
    root_mean(compared.iter().flat_map(|c| &c.readings).map(of))
}

/// Scatter with a line over the repeats removed; `None` unless every group has four.
fn without_drift(compared: &[&Compared]) -> Option<f64> {
    let enough = compared.iter().all(|c| c.repeats >= 4);
    enough.then(|| pooled(compared, |reading| reading.steady_square)).flatten()
}

fn by_direction(groups: &[Group], compared: &[Compared]) -> Vec<DirectionScatter> {
    let parts = [Direction::Insertion, Direction::Withdrawal].into_iter().filter_map(|direction| {
        let own = groups.iter().zip(compared).filter(|(group, _)| group.direction == direction);
        let part: Vec<&Compared> = own.map(|(_, compared)| compared).collect();
        let strokes = part.iter().map(|c| c.repeats).sum();
        let scatter_n = pooled(&part, Reading::square)?;
        Some(DirectionScatter {
            direction,
            scatter_n,
            without_drift_n: without_drift(&part),
            strokes,
        })
    });
    parts.collect()
}

/// A stroke along its own direction: `way` = ±position increases along it.
struct Track {
    /// Number of the stroke in the recording.
    order: f64,
    stroke: Stroke,
    /// Whether it ends at a reversal within the recording.
    ends_at_reversal: bool,
    speed: f64,
    start: f64,
    end: f64,
    /// `way` and reading, in ascending order of `way`.
    points: Vec<(f64, f64)>,
}

impl Track {
    fn new(
        recording: &Recording,
        velocity: &[f64],
        strokes: &[Stroke],
        index: usize,
    ) -> Option<Self> {
        let stroke = strokes[index];
        let way = |i: usize| stroke.direction.sign() * recording.position[i];
        let inside = stroke.start..=stroke.end;
        let mut points: Vec<(f64, f64)> = inside
            .clone()
            .filter(|i| !recording.is_clipped(*i))
            .map(|i| (way(i), recording.force[i]))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut speeds: Vec<f64> = inside.map(|i| velocity[i].abs()).collect();
        speeds.sort_by(f64::total_cmp);
        let ends_at_reversal = strokes.get(index + 1).is_some_and(|next| next.start == stroke.end);
        let (start, end, speed) = (way(stroke.start), way(stroke.end), speeds[speeds.len() / 2]);
        (points.len() > 1).then_some(Self {
            order: index as f64,
            stroke,
            ends_at_reversal,
            speed,
            start,
            end,
            points,
        })
    }

    fn repeats(&self, other: &Self) -> bool {
        let shared = self.end.min(other.end) - self.start.max(other.start);
        let longer = (self.end - self.start).max(other.end - other.start);
        let faster = self.speed.max(other.speed);
        shared >= LIKE_RANGE * longer && faster <= (1.0 + LIKE_SPEED) * self.speed.min(other.speed)
    }

    /// Reading at `way`, interpolated; `None` outside the range.
    fn reading(&self, way: f64) -> Option<f64> {
        let after = self.points.partition_point(|p| p.0 < way);
        let &(right, high) = self.points.get(after)?;
        if right == way {
            return Some(high);
        }
        let &(left, low) = self.points.get(after.checked_sub(1)?)?;
        Some(low + (high - low) * (way - left) / (right - left))
    }
}

struct Group {
    direction: Direction,
    tracks: Vec<Track>,
}

/// Assigns each stroke to the first group whose first stroke it repeats.
fn groups(recording: &Recording, strokes: &[Stroke]) -> Vec<Group> {
    let velocity = local_velocity(recording, VELOCITY_WINDOW);
    let mut groups: Vec<Group> = Vec::new();
    for track in (0..strokes.len()).filter_map(|k| Track::new(recording, &velocity, strokes, k)) {
        let direction = track.stroke.direction;
        match groups.iter_mut().find(|g| g.direction == direction && g.tracks[0].repeats(&track)) {
            Some(group) => group.tracks.push(track),
            None => groups.push(Group { direction, tracks: vec![track] }),
        }
    }
    groups
}

/// One reading compared with the repeats.
struct Reading {
    sample: usize,
    /// e²/(1 + 1/m), N², at the applicable place.
    square: f64,
    /// The same about a line over the repeats.
    steady_square: f64,
}

impl Reading {
    fn square(&self) -> f64 {
        self.square
    }
}

/// Comparison of a group's readings.
struct Compared {
    readings: Vec<Reading>,
    repeats: usize,
    /// Lengths after and before reversals, m.
    lengths: [f64; 2],
}

/// Definition of 'the same place'.
#[derive(Clone, Copy)]
enum PlaceDefinition {
    Position,
    SinceReversal,
    ToReversal,
}

/// A sample with its distances from the start and to the end of its stroke, m, and the comparison
/// at each kind of place: about the mean and about a line.
struct Candidate {
    sample: usize,
    distances: [f64; 2],
    by_place: [Option<[f64; 2]>; 3],
}

impl Group {
    fn compare(&self, recording: &Recording) -> Compared {
        let mut ranges: Vec<f64> = self.tracks.iter().map(|t| t.end - t.start).collect();
        ranges.sort_by(f64::total_cmp);
        let range = ranges[ranges.len() / 2];
        let candidates = self.candidates(recording, [0.0; 2]);
        let lengths = [0, 1].map(|side| length(&candidates, side, range));
        let readings =
            self.candidates(recording, lengths).iter().filter_map(|c| c.reading(lengths)).collect();
        Compared { readings, repeats: self.tracks.len(), lengths }
    }

    /// All samples at each kind of place; by position only against samples farther than `lengths`
    /// from either end.
    fn candidates(&self, recording: &Recording, lengths: [f64; 2]) -> Vec<Candidate> {
        let tracks = self.tracks.par_iter().enumerate();
        let candidates = tracks.flat_map_iter(|(own, track)| {
            let longest = LENGTHS[LENGTHS.len() - 1] * (track.end - track.start);
            let samples =
                (track.stroke.start..track.stroke.end).filter(|i| !recording.is_clipped(*i));
            samples.map(move |sample| {
                let way = self.direction.sign() * recording.position[sample];
                let distances = [way - track.start, track.end - way];
                let at =
                    |place| self.against_others(own, way, recording.force[sample], place, lengths);
                let since = track.stroke.starts_at_reversal && distances[0] <= longest;
                let to = track.ends_at_reversal && distances[1] <= longest;
                let by_place = [
                    at(PlaceDefinition::Position),
                    since.then(|| at(PlaceDefinition::SinceReversal)).flatten(),
                    to.then(|| at(PlaceDefinition::ToReversal)).flatten(),
                ];
                Candidate { sample, distances, by_place }
            })
        });
        candidates.collect()
    }

    /// e²/(1 + leverage) about the mean of the others, and about a line over their order (NaN below
    /// three others).
    fn against_others(
        &self,
        own: usize,
        way: f64,
        force: f64,
        place: PlaceDefinition,
        [behind, before]: [f64; 2],
    ) -> Option<[f64; 2]> {
        let track = &self.tracks[own];
        let every = (self.tracks.len() - 1).div_ceil(MOST_OTHERS);
        let others = self
            .tracks
            .iter()
            .enumerate()
            .filter(|(k, _)| *k != own)
            .map(|(_, t)| t)
            .step_by(every);
        let mut sums = OverOrder::default();
        for other in others {
            let there = match place {
                PlaceDefinition::Position
                    if way - other.start < behind || other.end - way < before =>
                {
                    continue;
                }
                PlaceDefinition::Position => way,
                PlaceDefinition::SinceReversal if other.stroke.starts_at_reversal => {
                    other.start + (way - track.start)
                }
                PlaceDefinition::ToReversal if other.ends_at_reversal => {
                    other.end - (track.end - way)
                }
                _ => continue,
            };
            if let Some(reading) = other.reading(there) {
                sums.add(other.order, reading);
            }
        }
        sums.against(track.order, force)
    }
}

impl Candidate {
    /// The reading at the applicable place; `None` near a start or end of a stroke that is no
    /// reversal.
    fn reading(&self, lengths: [f64; 2]) -> Option<Reading> {
        let kind = if self.distances[0] < lengths[0] {
            1
        } else if self.distances[1] < lengths[1] {
            2
        } else {
            0
        };
        let [square, steady_square] = self.by_place[kind]?;
        Some(Reading { sample: self.sample, square, steady_square })
    }
}

/// Mean and line of readings over the order of their strokes.
#[derive(Default)]
struct OverOrder {
    count: f64,
    order: f64,
    mean: f64,
    spread: f64,
    joint: f64,
}

impl OverOrder {
    fn add(&mut self, order: f64, reading: f64) {
        self.count += 1.0;
        let (by_order, by_reading) = (order - self.order, reading - self.mean);
        self.order += by_order / self.count;
        self.mean += by_reading / self.count;
        self.spread += by_order * (order - self.order);
        self.joint += by_order * (reading - self.mean);
    }

    /// Squared deviations of `reading` from the mean and from the line, divided by 1 + leverage.
    fn against(&self, order: f64, reading: f64) -> Option<[f64; 2]> {
        if self.count == 0.0 {
            return None;
        }
        let away = order - self.order;
        let line =
            if self.count < 3.0 { f64::NAN } else { self.mean + self.joint / self.spread * away };
        let leverage = 1.0 / self.count + away * away / self.spread;
        let about_mean = (reading - self.mean).powi(2) / (1.0 + 1.0 / self.count);
        Some([about_mean, (reading - line).powi(2) / (1.0 + leverage)])
    }
}

/// Distance from the reversal, m, within which it defines the better place; 0 when the position is
/// as good.
fn length(candidates: &[Candidate], side: usize, range: f64) -> f64 {
    let gains = LENGTHS.iter().map(|part| {
        let near = candidates.iter().filter(|c| c.distances[side] < part * range);
        let gains = near.filter_map(|c| Some(c.by_place[0]?[0] - c.by_place[1 + side]?[0]));
        (part * range, gains.sum::<f64>())
    });
    gains.fold((0.0, 0.0), |best, next| if next.1 > best.1 { next } else { best }).0
}
