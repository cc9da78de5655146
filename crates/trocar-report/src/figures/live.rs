//! The interactive identified model: its parameters with their ranges, and a part of a recording
//! for the simulation.

use std::ops::Range;

use trocar_model::{Direction, ParameterId, Quantity, Seal, Trocar, Tunable, Unit};

use super::tables::name_of;
use super::{Scored, excerpt_starts, limits};
use crate::document::{Excerpt, Knob, LiveModel, LiveTurning};
use crate::number::significant;
use trocar_identify::Identification;
use trocar_recording::Recording;
use trocar_simulate::replay::forgotten_after;
use trocar_simulate::segment::{reversal_threshold, strokes};

/// Lengths of the shown part of a recording, s: the first length in which the model forgets its
/// initial state in some part.
const LENGTHS: [f64; 3] = [8.0, 30.0, 120.0];
/// Step of the search for the most informative part, as a fraction of its length.
const STEP: f64 = 1.0 / 16.0;
/// Latest position, as a fraction of the part, at which the initial state must be forgotten.
const LATEST: f64 = 0.4;
/// Most samples of a part.
const MOST_SAMPLES: f64 = 2_000.0;
/// Travel of a stroke beyond this many half widths gives no further information.
const TELLING: f64 = 4.0;
/// Most numbers of a row in the module.
const LONGEST_ROW: usize = 24_576;
/// Range of motion if no recording determines it, m.
const WAY: [f64; 2] = [0.0, 0.06];
/// Relative difference below which an estimate and the model's parameter count as the same number.
const SAME: f64 = 1e-9;

/// The model of `found` with a part of a held-out recording, if there is one.
pub(crate) fn live_model(found: &Identification, scored: &Scored) -> Result<LiveModel, String> {
    let trocar = found.trocar();
    let row = row_of(&trocar)?;
    let excerpt = excerpt(found, scored);
    let way = excerpt.as_ref().map_or(WAY, |excerpt| {
        let (low, high) = limits(&excerpt.position);
        let margin = 0.5 * found.model.half_width;
        [low - margin, high + margin]
    });
    let knobs = knobs(trocar.seal(), |tunable| interval(tunable, found));
    Ok(LiveModel { row, way, knobs, excerpt, turning: turning(&trocar) })
}

/// How `trocar` turns.
fn turning<K: AsRef<[f64]>>(trocar: &Trocar<K>) -> Option<LiveTurning> {
    let rotation = trocar.rotation()?;
    let coulomb = Direction::BOTH.map(|direction| {
        let wanted = Quantity::CoulombForce.of(direction);
        let is_wanted = |id: ParameterId| ParameterId { element: None, ..id } == wanted;
        let all = trocar.seal().tunables().enumerate();
        all.filter(|(_, tunable)| is_wanted(tunable.id)).map(|(at, _)| at).collect()
    });
    Some(LiveTurning {
        radius: rotation.shaft_radius,
        ratio: rotation.circumferential_ratio,
        coulomb,
    })
}

impl LiveModel {
    /// `trocar` to be moved by hand over `way`, m; without a recording and without intervals.
    ///
    /// # Errors
    /// The reason, in a sentence, for which the model cannot run in a page.
    pub fn of<K: AsRef<[f64]>>(trocar: &Trocar<K>, way: [f64; 2]) -> Result<Self, String> {
        let knobs = knobs(trocar.seal(), |_| None);
        let turning = turning(trocar);
        Ok(Self { row: row_of(trocar)?, way, knobs, excerpt: None, turning })
    }
}

pub(crate) fn row_of<K: AsRef<[f64]>>(trocar: &Trocar<K>) -> Result<Vec<f64>, String> {
    let mut row = vec![0.0; trocar.count_numbers()];
    trocar.write_numbers(&mut row).map_err(|error| error.to_string())?;
    if row.len() > LONGEST_ROW {
        return Err("The model has too many knots over the position to run in a page.".to_owned());
    }
    Ok(row)
}

fn knobs(seal: &Seal, interval: impl Fn(&Tunable) -> Option<[f64; 2]>) -> Vec<Knob> {
    let tunables: Vec<Tunable> = seal.tunables().collect();
    tunables
        .iter()
        .map(|tunable| {
            let Tunable { id, value } = *tunable;
            let Unit { shown, scale, .. } = id.unit();
            Knob {
                name: name_of(id),
                symbol: id.symbol().to_string(),
                unit: shown.to_owned(),
                scale,
                value,
                range: range(tunable, &tunables),
                interval: interval(tunable),
                follows: other_direction(tunable, &tunables),
                is_main: id.element.is_none_or(|element| element == 1) && is_main(id.quantity),
            }
        })
        .collect()
}

/// For withdrawal: index of the same parameter on insertion, if it has the same value.
fn other_direction(tunable: &Tunable, all: &[Tunable]) -> Option<usize> {
    let Tunable { id, value } = *tunable;
    let insertion = ParameterId { direction: Some(Direction::Insertion), ..id };
    let of_withdrawal = id.direction == Some(Direction::Withdrawal);
    all.iter().position(|one| of_withdrawal && one.id == insertion && one.value == value)
}

fn is_main(quantity: Quantity) -> bool {
    use Quantity::{CoulombForce, HalfWidth, SealDamping, StaticRatio, ViscousDamping};
    [HalfWidth, CoulombForce, StaticRatio, ViscousDamping, SealDamping].contains(&quantity)
}

/// Ends of a slider, SI. A present parameter ranges from a quarter to twice its value, an absent
/// one up to a value with a noticeable effect.
fn range(tunable: &Tunable, all: &[Tunable]) -> Option<[f64; 2]> {
    let Tunable { id, value } = *tunable;
    if !value.is_finite() {
        return None;
    }
    let of = |other: ParameterId| {
        let same_element = ParameterId { element: id.element, ..other };
        all.iter().find(|one| one.id == same_element).map(|one| one.value)
    };
    let is_there = |quantity: Quantity| of(quantity.id()).is_some_and(|value| value > 0.0);
    // The friction lag applies only to a creeping contact.
    if id.quantity == Quantity::FrictionLag && !is_there(Quantity::CreepVelocity) {
        return None;
    }
    let half_width = of(Quantity::HalfWidth.id()).unwrap_or(0.01);
    let coulomb = of(Quantity::CoulombForce.of(Direction::Insertion)).unwrap_or(1.0);
    let (least, range) = (id.declaration().range.least(), id.declaration().range);
    let felt = match id.quantity {
        Quantity::StaticRatio => least + (2.0 * (value - least)).max(1.0),
        Quantity::ViscousDamping | Quantity::SealDamping => (2.0 * value).max(10.0 * coulomb),
        Quantity::CreepVelocity => (4.0 * value).max(1e-3),
        Quantity::DwellForce => (2.0 * value).max(0.1 * coulomb),
        Quantity::FrictionLag => (4.0 * value).max(0.1),
        Quantity::RelaxationStiffness => (2.0 * value).max(coulomb / half_width),
        Quantity::StribeckVelocity | Quantity::RelaxationTime => 4.0 * value,
        _ => 2.0 * value,
    };
    let is_needed = id.quantity == Quantity::CreepVelocity && is_there(Quantity::FrictionLag);
    let low = if range.excludes_least() || is_needed { 0.25 * value } else { least };
    Some([low, felt])
}

/// The interval of the estimate of a parameter, of its direction or of both; `None` if the model's
/// number differs from the estimate.
fn interval(tunable: &Tunable, found: &Identification) -> Option<[f64; 2]> {
    let Tunable { id, value } = *tunable;
    let ids = [id.quantity.id(), id];
    let estimate = ids
        .into_iter()
        .filter_map(|id| found.estimate(id))
        .find(|e| (e.value - value).abs() <= SAME * value.abs() && e.determined)?;
    estimate.ci95.iter().all(|end| end.is_finite()).then_some(estimate.ci95)
}

/// A contiguous part of a recording that may become the excerpt of the live model.
struct ExcerptCandidate<'a> {
    recording: &'a Recording,
    from: f64,
    to: f64,
    samples: Range<usize>,
    /// Travel in it, m, limited for each stroke to the informative travel.
    worth: f64,
}

/// The most informative part: with many strokes, and such that the model soon forgets its initial
/// state.
fn excerpt(found: &Identification, scored: &Scored) -> Option<Excerpt> {
    LENGTHS.into_iter().find_map(|length| {
        let mut all: Vec<ExcerptCandidate> = scored
            .recordings
            .iter()
            .flat_map(|recording| candidates(recording, length, found.model.half_width))
            .collect();
        all.sort_by(|a, b| b.worth.total_cmp(&a.worth));
        all.into_iter().find_map(|candidate| candidate.excerpt(found, scored.held_out))
    })
}

fn candidates(recording: &Recording, length: f64, half_width: f64) -> Vec<ExcerptCandidate<'_>> {
    let (x, t) = (&recording.position, &recording.time);
    let strokes = strokes(recording, reversal_threshold(recording));
    let mut all = Vec::new();
    for range in recording.unbroken().filter(|range| range.len() > 1) {
        let (begin, end) = (t[range.start], t[range.end - 1]);
        for from in excerpt_starts([begin, end], length, STEP * length) {
            let to = (from + length).min(end);
            let [first, last] = [from, to]
                .map(|time| t.partition_point(|t| *t < time).clamp(range.start, range.end - 1));
            let samples = first..last + 1;
            let within = strokes.iter().filter(|stroke| samples.contains(&stroke.start));
            let travel =
                within.map(|stroke| (x[stroke.end.min(samples.end - 1)] - x[stroke.start]).abs());
            let worth = travel.map(|travel| travel.min(TELLING * half_width)).sum();
            all.push(ExcerptCandidate { recording, from, to, samples, worth });
        }
    }
    all
}

impl ExcerptCandidate<'_> {
    /// The part resampled at equal time intervals; `None` if the initial state matters too long.
    fn excerpt(&self, found: &Identification, held_out: bool) -> Option<Excerpt> {
        let Recording { name, quality, .. } = self.recording;
        let interval = quality.median_interval.max((self.to - self.from) / MOST_SAMPLES);
        let count = ((self.to - self.from) / interval) as usize + 1;
        let times: Vec<f64> = (0..count).map(|k| self.from + interval * k as f64).collect();
        let position = self.at(&times, &self.recording.position);
        let steps = position.windows(2).map(|pair| (pair[1] - pair[0], interval));
        let known_from = forgotten_after(&found.stages.into(), steps)? + 1;
        let readings = self.at(&times, &self.recording.force);
        let force = readings.into_iter().map(|reading| reading - found.model.offset).collect();
        let angles = self.recording.angle.as_ref().map(|angle| self.at(&times, angle));
        let angle = angles.unwrap_or_default();
        let angle = angle.iter().map(|own| own - angle[0]).collect();
        let seen = if held_out {
            "which the identification has not seen"
        } else {
            "which the model was identified from"
        };
        let name = format!(
            "{name}, {}\u{a0}s from {}\u{a0}s on, {seen}; every {}\u{a0}ms.",
            significant(self.to - self.from, 2),
            significant(self.from, 3),
            significant(1e3 * interval, 3)
        );
        (known_from as f64 <= LATEST * count as f64).then_some(Excerpt {
            name,
            interval,
            position,
            force,
            angle,
            known_from,
        })
    }

    /// Values at `times`, linearly interpolated between the samples.
    fn at(&self, times: &[f64], values: &[f64]) -> Vec<f64> {
        let t = &self.recording.time;
        let values = times.iter().map(|time| {
            let above =
                t.partition_point(|t| t < time).clamp(self.samples.start, self.samples.end - 1);
            let below = above.saturating_sub(1).max(self.samples.start);
            let span = t[above] - t[below];
            let part = if span > 0.0 { ((time - t[below]) / span).clamp(0.0, 1.0) } else { 1.0 };
            values[below] + part * (values[above] - values[below])
        });
        values.collect()
    }
}
