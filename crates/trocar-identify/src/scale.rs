//! The friction scale of each stroke as a result: changes of friction during the recordings, and
//! its jumps.

use serde::Serialize;

use super::candidate::EmsTrial;
use super::estimate::t_quantile;
use super::likelihood::Fitted;
use super::training::Training;
use trocar_recording::Recording;

/// Friction of one stroke relative to that of the model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StrokeFriction {
    /// Index of the recording.
    pub recording: usize,
    /// Start of the stroke, s.
    pub time_s: f64,
    /// u = 1 + v: its force relative to that of the model.
    pub scale: f64,
    /// Standard error of the scale.
    pub standard_error: f64,
    /// Whether its speed was imposed, so that its size entered the fit.
    pub counted: bool,
}

/// A persistent change of the friction from one stroke to the next.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Jump {
    /// Index of the recording.
    pub recording: usize,
    /// Time of the jump, s.
    pub time_s: f64,
    /// Friction after over friction before.
    pub ratio: f64,
    #[serde(skip)]
    stroke: usize,
}

/// Change of the friction over the strokes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FrictionScale {
    /// Scale of each stroke.
    pub strokes: Vec<StrokeFriction>,
    /// Standard deviation between neighbouring strokes, relative to the force.
    pub scatter: f64,
    /// Largest less smallest scale of the slow drift, including jumps.
    pub drift: f64,
    /// Jumps.
    pub jumps: Vec<Jump>,
}

/// Drift relative to the force above which it is reported, and above which a single value for the
/// whole time is doubtful.
const WORTH_A_LINE: f64 = 0.02;
pub(super) const TOO_FAR: f64 = 0.15;

impl FrictionScale {
    pub(super) fn new(
        training: &Training,
        fitted: &Fitted<EmsTrial>,
        recordings: &[Recording],
        scatter: f64,
    ) -> Self {
        let sigma2 = fitted.rms[1].powi(2);
        let used = || fitted.normal.scales.iter().zip(&training.strokes).enumerate();
        let stroke = |(g, (scale, stroke)): (
            usize,
            (&super::likelihood::StrokeScale, &super::training::ScaledStroke),
        )| {
            let origin = recordings[stroke.recording].time[0];
            StrokeFriction {
                recording: stroke.recording,
                time_s: stroke.time - origin,
                scale: 1.0 + scale.own,
                standard_error: (sigma2 / scale.information.max(f64::MIN_POSITIVE)).sqrt(),
                counted: !training.scale.is_unconstrained(g),
            }
        };
        let strokes =
            used().filter(|(_, (scale, _))| scale.information > 0.0).map(stroke).collect();
        let basis = &training.scale.basis;
        let slow = |g: usize| -> f64 {
            fitted.best.drift.iter().zip(basis).map(|(d, phi)| d * phi[g]).sum()
        };
        let counted = (0..training.strokes.len()).filter(|g| !training.scale.is_unconstrained(*g));
        let (low, high) =
            counted.map(slow).fold((0.0f64, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        let jumps = Jump::find(training, fitted);
        Self { strokes, scatter, drift: high - low, jumps }
    }

    /// u at `time_s` of a recording: that of the current stroke.
    pub(super) fn at(&self, recording: usize, time_s: f64) -> f64 {
        let own = self
            .strokes
            .iter()
            .rev()
            .find(|s| s.recording == recording && s.time_s <= time_s && s.counted);
        own.map_or(1.0, |s| s.scale)
    }

    /// One line if the friction changed noticeably.
    pub fn in_words(&self, names: &[&str]) -> Option<String> {
        if let Some(jump) = self.jumps.first() {
            return Some(format!(
                "friction changed by {:+.0} % at {:.0} s of {}: one model cannot hold before and after; identify the two parts separately \
                 (‹from_s›, ‹to_s›)",
                1e2 * (jump.ratio - 1.0),
                jump.time_s,
                names.get(jump.recording).unwrap_or(&"the recording")
            ));
        }
        (self.drift > WORTH_A_LINE).then(|| {
            format!(
                "friction drifted by {:.1} % over the recordings; the numbers are those of the mean stroke",
                1e2 * self.drift
            )
        })
    }
}

impl Jump {
    /// Prior standard deviation of a jump's amplitude.
    pub(super) const WIDTH: f64 = 0.5;
    /// Fewest strokes on each side.
    const FEWEST: usize = 4;
    /// Least change.
    const LEAST: f64 = 0.08;

    /// φ of the jump: 1 from its stroke to the end of its recording, less its mean.
    pub(super) fn basis(&self, training: &Training) -> Vec<f64> {
        let strokes = &training.strokes;
        training.centred(|g| f64::from(g >= self.stroke && strokes[g].recording == self.recording))
    }

    /// The clearest jump of each recording: a change of the mean that leaves much less scatter on
    /// both sides.
    pub(super) fn find(training: &Training, fitted: &Fitted<EmsTrial>) -> Vec<Self> {
        let strokes = &training.strokes;
        let recordings = strokes.iter().map(|s| s.recording).max().map_or(0, |last| last + 1);
        let of = |recording: usize| {
            let own: Vec<usize> = (0..strokes.len())
                .filter(|g| {
                    strokes[*g].recording == recording
                        && !training.scale.is_unconstrained(*g)
                        && fitted.normal.scales[*g].information > 0.0
                })
                .collect();
            let value = |g: usize| fitted.normal.scales[g].own;
            let mean =
                |part: &[usize]| part.iter().map(|g| value(*g)).sum::<f64>() / part.len() as f64;
            let squares = |part: &[usize]| {
                let mean = mean(part);
                part.iter().map(|g| (value(*g) - mean).powi(2)).sum::<f64>()
            };
            let n = own.len();
            let splits = Self::FEWEST..n.saturating_sub(Self::FEWEST) + 1;
            let left = |k: &usize| squares(&own[..*k]) + squares(&own[*k..]);
            let best = splits.min_by(|a, b| left(a).total_cmp(&left(b)))?;
            let (before, after) = (mean(&own[..best]), mean(&own[best..]));
            let change = (1.0 + after) / (1.0 + before);
            let error =
                (left(&best) / (n as f64 - 2.0) * n as f64 / (best * (n - best)) as f64).sqrt();
            let clear = (after - before).abs() > 2.0 * t_quantile(n as f64 - 2.0) * error;
            // A drift leaves a trend on both sides; a jump does not.
            let sudden = left(&best) < 0.15 * squares(&own);
            let jump = Self {
                recording,
                time_s: strokes[own[best]].time - strokes[own[0]].time,
                ratio: change,
                stroke: own[best],
            };
            ((change - 1.0).abs() > Self::LEAST && clear && sudden).then_some(jump)
        };
        (0..recordings).filter_map(of).collect()
    }
}
