//! The model card: on one page what a model was identified from, where it holds, how well, and what it
//! is not for. Its facts are those of `summary.json`.

use trocar_identify::{FreeMotion, Identification};
use trocar_lab::motion::MotionRange;
use trocar_lab::summary::PROGRAM;
use trocar_lab::validate::Validation;
use trocar_recording::Recording;
use trocar_tables::option::{Interface, spelt};

use super::document::{Document, origin};
use super::figures::{self, Scored};
use super::number::{fixed, significant};

/// Root mean square error, N, that EMS section IV-C reports on its own data.
const ERROR_OF_EMS: &str = "the paper reports 0.17 N on its own data";

/// What is shorter is a reversal, no rest, s.
const SHORTEST_REST: f64 = 0.1;

/// What no recording of strokes can show.
const NOT_FOR: &str = "motion and forces outside these ranges; another seal, instrument or lubrication; temperature, wear and tilt; decisions about \
                       a patient";

/// The rows of the card: of what was identified from `training`, which moved in `range`, after `mass`
/// (kg) was subtracted.
pub(super) fn rows(
    found: &Identification,
    (training, range): (&[Recording], &MotionRange),
    mass: f64,
    scored: &Scored,
) -> Vec<(String, String)> {
    let held_out = if scored.held_out { scored.recordings } else { &[] };
    let mut all: Vec<_> = training.iter().map(|r| from("Identified from", r)).collect();
    all.extend(held_out.iter().map(|r| from("Held out", r)));
    let rig = match mass {
        0.0 => "no mass declared; no more is known".to_owned(),
        mass => format!(
            "{} kg between sensor and seal subtracted; no more is known",
            significant(mass, 3)
        ),
    };
    all.push(origin("Rig", rig));
    all.push(origin("Holds for", seen(range, &found.free_motion)));
    all.push(error(scored));
    let parameters = found.parameters.iter().filter(|p| !p.is_coefficient());
    let (known, unknown): (Vec<_>, Vec<_>) = parameters.partition(|p| p.estimate.determined);
    all.extend(known.iter().map(|p| {
        let (value, interval) = figures::value_and_interval(&p.estimate);
        origin(
            format!("{} {}", figures::name_of(p.id), p.id.symbol()),
            format!("{value}, {interval}"),
        )
    }));
    let unknown: Vec<String> = unknown.iter().map(|p| figures::name_of(p.id)).collect();
    let unknown = if unknown.is_empty() { "nothing".to_owned() } else { unknown.join("; ") };
    all.push(origin("Not determined", unknown));
    all.push(origin("Not for", NOT_FOR));
    all.push(origin("Cite", format!("{} (the model), {PROGRAM} (the program)", figures::PAPER)));
    all
}

fn from(label: &str, recording: &Recording) -> (String, String) {
    let Recording { name, sha256, .. } = recording;
    let (seconds, samples) = (significant(recording.duration(), 3), recording.len());
    origin(label, format!("{name}, {seconds} s, {samples} samples, SHA-256 {sha256}"))
}

fn seen(range: &MotionRange, motion: &FreeMotion) -> String {
    let spans = [(range.stroke_m, 1e3), (range.speed_m_s, 1e3), (range.force_n, 1.0)];
    let [strokes, speeds, forces] = spans.map(|(ends, scale)| {
        let [low, high] = ends.map(|end| significant(scale * end, 3));
        if low == high { low } else { format!("{low} to {high}") }
    });
    let rests = match range.longest_rest_s {
        short if short < SHORTEST_REST => "no rest".to_owned(),
        longest => format!("rests up to {} s", significant(longest, 2)),
    };
    let reversals = match motion.partial_reversals {
        0 => "no partial reversal".to_owned(),
        1 => "1 partial reversal".to_owned(),
        count => format!("{count} partial reversals"),
    };
    format!("strokes of {strokes} mm at {speeds} mm/s, {reversals}, {rests}, forces of {forces} N")
}

/// The error with that of each recording, if there are few, its repeatability, and that of EMS.
fn error(scored: &Scored) -> (String, String) {
    let label = if scored.held_out { "Error held out" } else { "Error on its own data" };
    let Validation { rms_n, fit_percent, recordings } = scored.validation;
    let mut words = format!("{} N rms, fit {} %", significant(*rms_n, 3), fixed(*fit_percent, 1));
    if (2..=3).contains(&recordings.len()) {
        for r in recordings {
            words += &format!("; {} N on {}", significant(r.rms_n, 3), r.path);
        }
    }
    for r in recordings {
        let Some(strokes) = r.strokes else { continue };
        let of = if recordings.len() > 1 { format!("{}: ", r.path) } else { String::new() };
        words += &format!("; {of}{}", strokes.words());
    }
    origin(label, format!("{words}; {ERROR_OF_EMS}"))
}

/// `card.md`.
pub(super) fn markdown(document: &Document) -> String {
    let rows = document.card.iter();
    let rows: String = rows
        .map(|(label, value)| format!("| {label} | {} |\n", value.replace('|', "\\|")))
        .collect();
    let warnings = list("Warnings", &document.warnings);
    let text = format!(
        "# Model card\n\n| | |\n|---|---|\n{rows}{warnings}{}",
        list("Notes", &document.notes)
    );
    spelt(&text, Interface::CommandLine)
}

fn list(heading: &str, texts: &[String]) -> String {
    let items: String = texts.iter().map(|text| format!("- {text}\n")).collect();
    if texts.is_empty() { items } else { format!("\n## {heading}\n\n{items}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_ends_are_one_figure_and_the_stop_of_a_reversal_is_no_rest() {
        let motion = FreeMotion { reversals: 9, partial_reversals: 1, held_s: 0.0 };
        let at = |longest_rest_s| {
            let (speed_m_s, stroke_m) = ([0.005, 0.02], [0.119_99, 0.120_01]);
            seen(
                &MotionRange { speed_m_s, stroke_m, force_n: [-3.0, 3.0], longest_rest_s },
                &motion,
            )
        };
        let short = at(0.003);
        assert!(short.starts_with("strokes of 120 mm at 5.00 to 20.0 mm/s, 1 partial"), "{short}");
        assert!(short.contains(", no rest, forces of "), "{short}");
        assert!(at(2.0).contains(", rests up to 2.0 s, "), "{}", at(2.0));
    }
}
