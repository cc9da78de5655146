//! The model compared with measurements over time (EMS figure 9), and the residual.

use std::ops::Range;

use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, Normal};

use super::{Drawn, MM, has_stages, line, over_time, p_in_words, thinned};
use crate::document::{Axis, Figure, Mark, Panel, Role, Series};
use crate::number::{fixed, significant};
use trocar_identify::Identification;
use trocar_lab::validate::{Validated, Validation, Whiteness};
use trocar_recording::Recording;
use trocar_simulate::replay::Replay;
use trocar_simulate::segment::{
    SegmentOptions, reversal_threshold, steady_segments, strokes, travel,
};

/// Most recordings for which the residual is drawn.
const MOST_RECORDINGS: usize = 4;
/// Points of the quantile plot.
const QUANTILES: usize = 150;
/// Points of the autocorrelation.
const LAGS: usize = 120;
/// Speeds within this ratio count as one speed of cycles.
const ONE_SPEED: f64 = 1.5;
/// Both strokes of a cycle have the speed that its label names within this ratio.
const ONE_LABEL: f64 = 1.1;

/// Recordings, the simulations of the model over them, and the scores.
pub(crate) struct Scored<'a> {
    pub(crate) recordings: &'a [Recording],
    pub(crate) validation: &'a Validation,
    /// Whether the recordings were held out of the identification.
    pub(crate) held_out: bool,
    pub(super) runs: &'a [Replay],
    /// Whether the model has elements in parallel.
    stages: bool,
    /// Sensor offset, N.
    offset: f64,
}

/// The model beside the validation recordings, or beside those used for identification.
pub(crate) fn scored<'a>(
    found: &Identification,
    own: &'a Validated,
    held_out: Option<&'a Validated>,
) -> Scored<'a> {
    let Validated { recordings, runs, validation } = held_out.unwrap_or(own);
    let (held_out, stages, offset) = (held_out.is_some(), has_stages(found), found.model.offset);
    Scored { recordings, validation, held_out, runs, stages, offset }
}

impl Scored<'_> {
    /// Description of the recordings for captions.
    pub(crate) fn kind(&self) -> &'static str {
        if self.held_out {
            "recordings that the identification has not seen"
        } else {
            "the recordings that the model was identified from, for there are no others"
        }
    }

    /// Scored samples: those with known state, or all if it is never known.
    fn known(&self, index: usize) -> Vec<Range<usize>> {
        let known = &self.runs[index].known;
        if known.is_empty() {
            std::iter::once(0..self.recordings[index].len()).collect()
        } else {
            known.clone()
        }
    }

    fn error(&self, index: usize, i: usize) -> f64 {
        self.recordings[index].force[i] - self.offset - self.runs[index].force[i]
    }

    /// Measured minus model, N, over the scored samples.
    fn errors(&self, index: usize) -> Vec<f64> {
        self.known(index).into_iter().flatten().map(|i| self.error(index, i)).collect()
    }

    fn longest(&self) -> usize {
        (0..self.recordings.len()).max_by_key(|i| self.recordings[*i].len()).unwrap_or(0)
    }
}

/// An insertion and the following withdrawal, or the reverse.
#[derive(Clone)]
pub(super) struct Cycle {
    pub(super) recording: usize,
    pub(super) samples: Range<usize>,
    /// The sample at the reversal between the strokes.
    pub(super) turn: usize,
    /// Speed of the first stroke, m/s.
    pub(super) speed: f64,
    /// Whether both strokes have that speed, constant.
    steady: bool,
}

fn within(ratio: f64, a: f64, b: f64) -> bool {
    a.max(b) < ratio * a.min(b)
}

/// Full cycles within the samples whose state is known; only those of one constant speed, if there
/// are any.
pub(super) fn cycles(
    recordings: &[Recording],
    known: impl Fn(usize) -> Vec<Range<usize>>,
) -> Vec<Cycle> {
    let mut found = Vec::new();
    for (index, recording) in recordings.iter().enumerate() {
        let strokes = strokes(recording, reversal_threshold(recording));
        let steady_segments = steady_segments(recording, &strokes, &SegmentOptions::default());
        let longest = strokes.iter().map(|p| travel(recording, p, p.end)).fold(0.0, f64::max);
        let known = known(index);
        for (number, pair) in strokes.windows(2).enumerate() {
            let [first, second] = pair else { continue };
            let inside = known.iter().any(|k| k.start <= first.start && second.end < k.end);
            let full = pair.iter().all(|p| travel(recording, p, p.end) > 0.5 * longest);
            if inside && full && first.end == second.start {
                let [own, next] = [number, number + 1].map(|number| {
                    let own = steady_segments.iter().filter(|s| s.stroke == number);
                    own.max_by_key(|s| s.end - s.start).map(|s| s.velocity.abs())
                });
                let duration = recording.time[first.end] - recording.time[first.start];
                let mean = travel(recording, first, first.end) / duration;
                let speed = own.unwrap_or(mean);
                let steady = own.zip(next).is_some_and(|(a, b)| within(ONE_LABEL, a, b));
                let samples = first.start..second.end + 1;
                found.push(Cycle { recording: index, samples, turn: first.end, speed, steady });
            }
        }
    }
    let steady: Vec<Cycle> = found.iter().filter(|cycle| cycle.steady).cloned().collect();
    if steady.is_empty() { found } else { steady }
}

/// The cycles that can be drawn, by speed.
fn sorted_cycles(scored: &Scored) -> Vec<Cycle> {
    let mut cycles = cycles(scored.recordings, |index| scored.known(index));
    cycles.sort_by(|a, b| a.speed.total_cmp(&b.speed));
    cycles
}

/// Speeds, m/s, of the cycles that can be drawn, ascending.
pub(crate) fn cycle_speeds(scored: &Scored) -> Vec<f64> {
    sorted_cycles(scored).iter().map(|cycle| cycle.speed).collect()
}

/// Force and deflection over a cycle at the lowest and at the highest speed, or at each of the
/// speeds `chosen`, m/s.
pub(crate) fn cross_validation(scored: &Scored, chosen: &[f64]) -> Drawn {
    let cycles = sorted_cycles(scored);
    let (Some(slowest), Some(fastest)) = (cycles.first(), cycles.last()) else {
        return Err("There is no figure of the model against measurement at two speeds (figure 9 of the paper): the recordings hold no full \
                    cycle of two strokes whose initial deflection is known."
            .to_owned());
    };
    let (shown, speeds) = if !chosen.is_empty() {
        let shown: Vec<&Cycle> = chosen.iter().filter_map(|v| nearest(&cycles, *v)).collect();
        let all: Vec<String> = shown.iter().map(|c| format!("{:.0}", MM * c.speed)).collect();
        (shown, format!("The cycles chosen are at {} mm/s.", all.join(", ")))
    } else if within(ONE_SPEED, slowest.speed, fastest.speed) {
        let middle = &cycles[cycles.len() / 2];
        let words = format!(
            "All cycles have about one speed, so one of them is shown, at {:.0} mm/s.",
            MM * middle.speed
        );
        (vec![middle], words)
    } else {
        let words = format!(
            "A cycle at the lowest speed, {:.0} mm/s, and one at the highest, {:.0} mm/s.",
            MM * slowest.speed,
            MM * fastest.speed
        );
        (vec![slowest, fastest], words)
    };
    let mut figure =
        Figure::new("cross-validation", 0, "Model against measurement").columns(shown.len().min(2));
    for pair in shown.chunks(2) {
        figure = pair.iter().map(|cycle| forces(scored, cycle)).fold(figure, Figure::panel);
        figure = pair.iter().map(|cycle| deflections(scored, cycle)).fold(figure, Figure::panel);
    }
    let rows = if shown.len() > 2 { " of each two" } else { "" };
    let stages = if scored.stages { " (of the first of the model's elements)" } else { "" };
    Ok(figure.caption(format!(
        "Measured force, computed force (upper row) and computed deflection{stages} (lower row{rows}), as in figure 9 of the paper, on {}. {speeds} The \
         sensor offset of {} N is subtracted from the measured force; the model's force is the seal's alone, from measured positions \
         only. Over all samples whose state is known the root mean square error is {:.3} N.",
        scored.kind(),
        fixed(scored.offset, 3),
        scored.validation.rms_n
    )))
}

/// The cycle whose speed is nearest to `speed`, m/s.
fn nearest(cycles: &[Cycle], speed: f64) -> Option<&Cycle> {
    cycles.iter().min_by(|a, b| (a.speed - speed).abs().total_cmp(&(b.speed - speed).abs()))
}

fn forces(scored: &Scored, cycle: &Cycle) -> Panel {
    let recording = &scored.recordings[cycle.recording];
    let time = time_of(recording, &cycle.samples);
    let measured = recording.force[cycle.samples.clone()].iter().map(|f| f - scored.offset);
    let model = &scored.runs[cycle.recording].force[cycle.samples.clone()];
    let speed = match cycle.steady {
        true => format!("{:.0} mm/s", MM * cycle.speed),
        false => format!("first stroke {:.0} mm/s", MM * cycle.speed),
    };
    over_time(Axis::new("force", "N").with_zero())
        .title(speed)
        .series(line(super::measured(recording), Role::Measured, &time, measured))
        .series(line("model", Role::Model, &time, model.iter().copied()))
        .aspect(0.7)
}

fn deflections(scored: &Scored, cycle: &Cycle) -> Panel {
    let time = time_of(&scored.recordings[cycle.recording], &cycle.samples);
    let deflection = &scored.runs[cycle.recording].deflection[cycle.samples.clone()];
    let millimetres = deflection.iter().map(|z| MM * z);
    over_time(Axis::new("deflection z", "mm").with_zero())
        .series(line("deflection", Role::Deflection, &time, millimetres))
        .aspect(0.6)
}

fn time_of(recording: &Recording, samples: &Range<usize>) -> Vec<f64> {
    let origin = recording.time[samples.start];
    recording.time[samples.clone()].iter().map(|t| t - origin).collect()
}

/// Measured minus model over time.
pub(crate) fn residuals(scored: &Scored) -> Figure {
    let shown = scored.recordings.len().min(MOST_RECORDINGS);
    let panels = (0..shown).map(|index| residual_panel(scored, index));
    let figure = panels.fold(Figure::new("residuals", 0, "Residual over time"), Figure::panel);
    let more = match scored.recordings.len() - shown {
        0 => String::new(),
        left => format!(
            " The first {shown} recordings are shown; {left} more are in the table of speeds."
        ),
    };
    figure.caption(format!(
        "Measured minus computed force on {}. The start of a recording is left out until the deflection of the seal no longer depends \
         on its unknown initial value.{more}",
        scored.kind()
    ))
}

fn residual_panel(scored: &Scored, index: usize) -> Panel {
    let recording = &scored.recordings[index];
    let (mut x, mut y) = (Vec::new(), Vec::new());
    for range in scored.known(index) {
        let time = &recording.time[range.clone()];
        let error: Vec<f64> = range.map(|i| scored.error(index, i)).collect();
        let (some_x, some_y) = thinned(time, &error);
        x.extend(some_x);
        y.extend(some_y);
        // A gap in time interrupts the line.
        x.push(f64::NAN);
        y.push(f64::NAN);
    }
    let scores = scored.validation.recordings.get(index);
    let rms = scores.map_or(f64::NAN, |v| v.rms_n);
    let floor = scores.and_then(|v| v.strokes).map_or_else(String::new, |strokes| {
        format!(", {:.2} times the repeatability", strokes.rms_over_scatter)
    });
    over_time(Axis::new("residual", "N").with_zero())
        .title(format!("{}: {} N rms{floor}", recording.name, significant(rms, 3)))
        .series(Series::line("measured minus model", Role::Residual, x, y))
        .aspect(0.3)
}

/// Distribution and autocorrelation of the residual of the longest recording.
pub(crate) fn residual_statistics(scored: &Scored) -> Drawn {
    let index = scored.longest();
    let mut errors = scored.errors(index);
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n;
    if errors.len() < 2 * QUANTILES || variance <= 0.0 {
        return Err(format!(
            "The residual has too few samples ({}) for a distribution and an autocorrelation.",
            errors.len()
        ));
    }
    let whiteness = scored.validation.recordings.get(index).and_then(|v| v.whiteness);
    let recording = &scored.recordings[index];
    let shortest = 20.0 * recording.quality.median_interval;
    let span = whiteness.map_or(shortest, |w| (8.0 * w.correlation_time_s).max(shortest));
    let mut correlation =
        autocorrelation(&errors, mean, variance, span, recording.quality.median_interval);
    let words = match whiteness {
        None => "The recording is too short for a test of whiteness.".to_owned(),
        Some(Whiteness { correlation_time_s, ljung_box_p_value }) => {
            let milliseconds = 1e3 * correlation_time_s;
            correlation = correlation.mark(Mark::x(milliseconds, "correlation time"));
            format!(
                "Taken {milliseconds:.0} ms apart, where the autocorrelation has fallen to 1/e, the residuals pass for white noise with {} \
                 (Ljung-Box): a small value means that the model leaves structure.",
                p_in_words(ljung_box_p_value)
            )
        }
    };
    errors.sort_by(f64::total_cmp);
    Ok(Figure::new("residual-statistics", 0, "Distribution and autocorrelation of the residual")
        .columns(2)
        .panel(quantiles(&errors, mean, variance.sqrt()))
        .panel(correlation)
        .caption(format!(
            "Residual on {}. (a) Its quantiles against those of a normal distribution of the same mean and standard deviation ({:.3} N): \
             on the straight line it is normal. (b) Its autocorrelation. {words}",
            recording.name,
            variance.sqrt()
        )))
}

fn quantiles(sorted: &[f64], mean: f64, deviation: f64) -> Panel {
    let normal = Normal::standard();
    let probabilities = (0..QUANTILES).map(|k| (k as f64 + 0.5) / QUANTILES as f64);
    let x: Vec<f64> =
        probabilities.clone().map(|p| mean + deviation * normal.inverse_cdf(p)).collect();
    let y = probabilities.map(|p| sorted[(p * sorted.len() as f64) as usize]).collect();
    let ends = vec![x[0], x[QUANTILES - 1]];
    Panel::new(Axis::new("normal quantile", "N"), Axis::new("residual quantile", "N"))
        .series(Series::line("normal", Role::Reference, ends.clone(), ends))
        .series(Series::points("residual", Role::Residual, x, y))
        .aspect(0.75)
}

fn autocorrelation(errors: &[f64], mean: f64, variance: f64, span: f64, interval: f64) -> Panel {
    let longest = ((span / interval) as usize).min(errors.len() / 5).max(1);
    let every = longest.div_ceil(LAGS);
    let lags: Vec<usize> = (0..=longest).step_by(every).collect();
    let y = lags.par_iter().map(|lag| {
        let products = errors.iter().zip(&errors[*lag..]).map(|(a, b)| (a - mean) * (b - mean));
        products.sum::<f64>() / (errors.len() as f64 * variance)
    });
    let x = lags.iter().map(|lag| 1e3 * interval * *lag as f64).collect();
    let y = y.collect();
    Panel::new(Axis::new("lag", "ms").with_zero(), Axis::new("autocorrelation", "").with_zero())
        .series(Series::line("autocorrelation", Role::Residual, x, y))
        .aspect(0.75)
}
