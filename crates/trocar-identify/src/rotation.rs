//! Recordings in which the instrument turns, which the axial element does not know.

use std::f64::consts::PI;

use super::findings::Warning;
use trocar_recording::Recording;

/// Shaft of the usual 10 mm instrument, m: the radius for the size of the effect.
const SHAFT_RADIUS: f64 = 5e-3;

/// Time over which the motion is followed, s, and least speed along the axis, m/s: below it there
/// is hardly any sliding.
const STRIDE: f64 = 0.02;
const SLOWEST: f64 = 1e-3;

/// Part of the Coulomb force that may be lost unnoticed.
const TOO_MUCH: f64 = 0.01;

/// What turning takes from the axial force while the instrument slides.
struct Loss {
    /// Part of an isotropic Coulomb force, mean over the travel.
    part: f64,
    /// Fastest turning, rad/s.
    fastest: f64,
}

impl Loss {
    /// `None` without an angle or without sliding.
    fn of(recording: &Recording) -> Option<Self> {
        let (angle, x, t) = (recording.angle.as_ref()?, &recording.position, &recording.time);
        let (mut travel, mut kept, mut fastest) = (0.0, 0.0, 0.0_f64);
        for range in recording.unbroken() {
            let mut from = range.start;
            for to in range {
                let duration = t[to] - t[from];
                if duration < STRIDE {
                    continue;
                }
                let (dx, turned) = ((x[to] - x[from]).abs(), (angle[to] - angle[from]).abs());
                if dx > SLOWEST * duration {
                    travel += dx;
                    kept += dx * dx / dx.hypot(SHAFT_RADIUS * turned); // steady sliding, `trocar_model::rotation`
                    fastest = fastest.max(turned / duration);
                }
                from = to;
            }
        }
        (travel > 0.0).then(|| Self { part: 1.0 - kept / travel, fastest })
    }
}

/// Names the recordings whose friction turning makes too small.
pub(super) fn unmodelled(recordings: &[Recording]) -> impl Iterator<Item = Warning> {
    recordings.iter().filter_map(|recording| {
        let Loss { part, fastest } = Loss::of(recording).filter(|loss| loss.part > TOO_MUCH)?;
        let message = format!(
            "the instrument turns by up to {:.0} deg/s while it slides, which takes {:.0} % of the Coulomb force away on a \
             10 mm shaft with equal friction around and along it; the friction found here is too small by as much\n\nhint: \
             record strokes without turning, or leave out the part that turns with ‹from_s› and ‹to_s›",
            fastest * 180.0 / PI,
            1e2 * part
        );
        Some(Warning::doubt(recording, message))
    })
}
