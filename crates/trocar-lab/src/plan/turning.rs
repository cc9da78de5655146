//! What is recorded while the instrument turns, behind the strokes along which it does not:
//! `identify` finds the friction around the shaft from the first, its stiffness from the second.
//!
//! ```text
//! cycles at three ratios of the speeds around and along the shaft      F_t/F_c
//! strokes, each with a hold and a turn to and fro                      k_t
//! ```

use trocar_recording::{Recording, RecordingError};
use trocar_simulate::bench::Course;

use super::blocks::{LENGTHS, SHORTEST};
use super::config::Rig;
use super::course::{places, times};
use super::moves::Move;

/// Ratios of the speeds.
const RATIOS: [f64; 3] = [2.0, 0.7, 0.25];
/// Strokes with a hold and a turn to and fro, and the time of the hold, s.
const HOLDS: usize = 4;
const HOLD: f64 = 0.5;
/// Way around the shaft of such a turn, in half widths of the seal: it slides before the end.
const TURN: f64 = 3.0;

/// Moves along the shaft and around it, at its surface, that begin and end together.
struct Turning<'a> {
    rig: &'a Rig,
    along: Vec<Move>,
    around: Vec<Move>,
}

/// The motion from the position `from`, m, with a seal of `half_width`, m; `None` for a rig that does
/// not turn.
pub(super) fn course(rig: &Rig, from: f64, half_width: f64) -> Option<Course> {
    let (radius, fastest) = (0.5 * rig.shaft_diameter_m, rig.turning_m_s());
    if fastest <= 0.0 {
        return None;
    }
    let [along, around] = [from, 0.0]
        .map(|place| vec![Move { from_m: place, to_m: place, speed_m_s: fastest, rest_s: 0.0 }]);
    let mut turning = Turning { rig, along, around };
    let speed = (fastest / RATIOS[0]).clamp(rig.slowest_m_s, rig.fastest_m_s);
    let low = rig.begin_m();
    let ends = [low + (SHORTEST * half_width).min(LENGTHS[0] * rig.travel_m()), low];
    turning.stroke(low, 0.5 * rig.fastest_m_s, 0.0);
    for (ratio, direction) in RATIOS.into_iter().zip([1.0, -1.0].into_iter().cycle()) {
        ends.iter().for_each(|end| turning.stroke(*end, speed, direction * ratio * speed));
    }
    for end in ends.into_iter().cycle().take(HOLDS) {
        turning.stroke(end, 0.5 * rig.fastest_m_s, 0.0);
        turning.hold();
        [1.0, -1.0].iter().for_each(|sign| turning.turn(sign * TURN * half_width, 0.5 * fastest));
    }
    let times = times(rig, &turning.along);
    let position = places(rig, &turning.along, &times);
    let surface = places(rig, &turning.around, &times);
    let angle = surface.into_iter().map(|place| place / radius).collect();
    Some(Course { time: times, position, angle: Some(angle) })
}

/// `course` as a recording that nobody has made.
pub(super) fn recording(course: &Course) -> Result<Recording, RecordingError> {
    let Course { time, position, angle } = course.clone();
    let force = vec![0.0; time.len()];
    let recording = Recording::from_columns("plan", time, position, force)?;
    Ok(Recording { angle, ..recording })
}

impl Turning<'_> {
    fn ends(&self) -> [f64; 2] {
        [&self.along, &self.around].map(|moves| moves.last().map_or(0.0, |last| last.to_m))
    }

    /// To `to` along the shaft at `speed`, while it turns with `around`, m/s.
    fn stroke(&mut self, to: f64, speed: f64, around: f64) {
        let [from, place] = self.ends();
        let along = Move { from_m: from, to_m: to, speed_m_s: speed, rest_s: 0.0 };
        let duration = along.duration(self.rig);
        let ramp = 2.0 * around.abs() / self.rig.acceleration_m_s2;
        let to_m = place + around * (duration - ramp).max(0.0);
        self.push(along, Move { from_m: place, to_m, speed_m_s: around.abs(), rest_s: 0.0 });
    }

    fn hold(&mut self) {
        let [along, around] =
            self.ends().map(|at| Move { from_m: at, to_m: at, speed_m_s: 0.0, rest_s: HOLD });
        self.push(along, around);
    }

    fn turn(&mut self, by: f64, speed: f64) {
        let [from, place] = self.ends();
        let along = Move { from_m: from, to_m: from, speed_m_s: 0.0, rest_s: 0.0 };
        self.push(along, Move { from_m: place, to_m: place + by, speed_m_s: speed, rest_s: 0.0 });
    }

    /// The shorter of the two rests until the other ends.
    fn push(&mut self, mut along: Move, mut around: Move) {
        let [first, second] = [along, around].map(|step| step.duration(self.rig));
        along.rest_s += (second - first).max(0.0);
        around.rest_s += (first - second).max(0.0);
        self.along.push(along);
        self.around.push(around);
    }
}

/// `still`, at an angle of 0, and `turning` behind it.
pub(super) fn appended(still: &Course, turning: Course) -> Course {
    let end = still.time.last().copied().unwrap_or(0.0);
    let Course { time, position, angle } = turning;
    let mut all = still.clone();
    all.time.extend(time[1..].iter().map(|time| end + time));
    all.position.extend(&position[1..]);
    let zeros = std::iter::repeat_n(0.0, still.time.len());
    all.angle = angle.map(|angle| zeros.chain(angle[1..].iter().copied()).collect());
    all
}
