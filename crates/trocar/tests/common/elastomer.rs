//! Half of the strokes for the profile, the other half for its error, on recordings of real seals (ZILLEN).

use trocar::compare::{Choice, CompareOptions, Compared, compare};
use trocar::identify::IdentifyOptions;
use trocar::recording::Recording;
use trocar::scatter::StrokeScatter;
use trocar::segment::{passes, reversal_threshold, travel};
use trocar::travel::{NoProfile, TravelProfile, TravelSample, fit, storage_length, strokes};
use trocar_model::Element;

/// The recordings.
pub(crate) const NAMES: [&str; 7] =
    ["kdn_1bar", "napn_1bar", "o_ring257_1bar", "o_ring257_1bar_rerun", "o_ring_1bar", "pk_1bar", "x_ring257_1bar"];

/// Travel behind a reversal from which the seal slides for certain, m.
const FAR: f64 = 3e-3;
/// Highest speed of the recordings, m/s.
const TOP_SPEED: f64 = 0.02;
/// Distance from the median of seven neighbours from which a position is a glitch, m: ten times the noise.
const GLITCH: f64 = 1.5e-4;

/// Errors, N: over all, from 3 mm behind reversals on, and before.
#[derive(Clone, Copy)]
pub(crate) struct Errors {
    pub(crate) all: f64,
    pub(crate) far: f64,
    pub(crate) near: f64,
}

/// What one recording gives.
pub(crate) struct Row {
    pub(crate) floor: Errors,
    pub(crate) without_drift: Option<f64>,
    pub(crate) element: Errors,
    /// `None` when a half gave no profile.
    pub(crate) profile: Option<Errors>,
    /// The same with the element fitted once more, to the readings less the profile.
    pub(crate) refitted: Option<Errors>,
    pub(crate) knots: Vec<usize>,
    pub(crate) reversal_lengths: [f64; 2],
}

/// The positions without what a single reading jumps and comes back from; and how many they were.
pub(crate) fn without_glitches(recording: &Recording) -> (Recording, usize) {
    let (x, t) = (&recording.position, &recording.time);
    let mut clean = x.clone();
    let mut count = 0;
    for range in recording.unbroken().filter(|r| r.len() > 6) {
        let is_glitch = |i: usize| {
            let from = i.saturating_sub(3).max(range.start).min(range.end - 7);
            let mut window = x[from..from + 7].to_vec();
            window.sort_by(f64::total_cmp);
            (x[i] - window[3]).abs() > GLITCH
        };
        let inside = range.start + 3..range.end - 3;
        let good: Vec<usize> = range.clone().filter(|i| !inside.contains(i) || !is_glitch(*i)).collect();
        count += range.len() - good.len();
        for pair in good.windows(2) {
            for i in pair[0] + 1..pair[1] {
                let part = (t[i] - t[pair[0]]) / (t[pair[1]] - t[pair[0]]);
                clean[i] = x[pair[0]] + part * (x[pair[1]] - x[pair[0]]);
            }
        }
    }
    (rebuilt(recording, clean), count)
}

/// The recording with each force beside the position read `delay` seconds later.
pub(crate) fn with_delay(recording: &Recording, delay: f64) -> Recording {
    let t = &recording.time;
    let at = |time: &f64| {
        let k = t.partition_point(|u| *u <= time + delay).clamp(1, t.len() - 1);
        let part = ((time + delay - t[k - 1]) / (t[k] - t[k - 1])).clamp(0.0, 1.0);
        recording.position[k - 1] + part * (recording.position[k] - recording.position[k - 1])
    };
    rebuilt(recording, t.iter().map(at).collect())
}

fn rebuilt(recording: &Recording, position: Vec<f64>) -> Recording {
    Recording::from_columns(recording.name.clone(), recording.time.clone(), position, recording.force.clone())
        .expect("columns of a recording")
}

/// An element fitted by its output error to the whole recording, with its offset, N.
type Fitted = (Element, f64);

/// `None` when no start of the fit gives a model that runs.
fn element(recording: &Recording) -> Option<Fitted> {
    let options = CompareOptions {
        models: vec![Choice::EmsOutputError],
        identify: IdentifyOptions { bootstrap: 0, ..IdentifyOptions::default() },
        timing: false,
    };
    let whole = std::slice::from_ref(recording);
    let entry = compare(whole, whole, &options, &|_, _| {}).ok()?.entries.pop()?;
    match entry.model {
        Compared::Ems(element) => Some((element, entry.offset)),
        Compared::Classical(_) => None,
    }
}

/// The readings as they would be with the mean level and offset throughout.
fn levelled(recording: &Recording, profile: &TravelProfile) -> Recording {
    let mean = profile.mean_offset();
    let places = recording.position.iter().zip(&recording.force);
    let force = places.map(|(x, f)| mean + (f - profile.offset(*x)) / profile.level(*x)).collect();
    Recording::from_columns(recording.name.clone(), recording.time.clone(), recording.position.clone(), force)
        .expect("columns of a recording")
}

/// A profile from the strokes that `trained` lets through, and what it says of all samples; with `again`, after the
/// element was fitted once more to the levelled readings.
fn half(
    recording: &Recording,
    (element, offset): Fitted,
    stroke: &[usize],
    trained: &dyn Fn(usize) -> bool,
    again: bool,
) -> Result<(TravelProfile, Vec<f64>), NoProfile> {
    let forces = Compared::Ems(element).forces(recording, offset);
    let sample = |i: usize| TravelSample {
        position: recording.position[i],
        seal_force: forces[i],
        reading: recording.force[i],
        stroke: stroke[i],
    };
    let training: Vec<TravelSample> = (0..recording.len()).filter(|i| trained(stroke[*i])).map(sample).collect();
    let profile = fit(&training, storage_length(&element, TOP_SPEED))?.profile;
    let refitted = if again { self::element(&levelled(recording, &profile)) } else { None };
    if let Some(fitted) = refitted
        && let Ok(better) = half(recording, fitted, stroke, trained, false)
    {
        return Ok(better);
    }
    let says = (0..recording.len()).map(|i| profile.apply(recording.position[i], forces[i])).collect();
    Ok((profile, says))
}

/// Root mean square over the samples with `errors` that the floor covers.
fn errors(of: impl Fn(&dyn Fn(usize) -> bool) -> f64, far: &[bool]) -> Errors {
    Errors { all: of(&|_| true), far: of(&|i| far[i]), near: of(&|i| !far[i]) }
}

fn rms(squares: &[f64], chosen: &dyn Fn(usize) -> bool) -> f64 {
    let part = (0..squares.len()).filter(|i| squares[*i].is_finite() && chosen(*i));
    let (sum, count) = part.fold((0.0, 0usize), |(sum, n), i| (sum + squares[i], n + 1));
    (sum / count as f64).sqrt()
}

/// Trains on every other stroke and scores on the others, both ways.
pub(crate) fn row(recording: &Recording) -> Row {
    let found = passes(recording, reversal_threshold(recording));
    let scatter = StrokeScatter::of_passes(recording, &found).expect("ten like strokes");
    let mut far = vec![false; recording.len()];
    for pass in &found {
        (pass.start..pass.end).for_each(|i| far[i] = travel(recording, pass, i) > FAR);
    }
    let stroke = strokes(recording, &found);
    let fitted = element(recording).expect("ten strokes at constant speed");
    let (element, offset) = fitted;
    let forces = Compared::Ems(element).forces(recording, offset);
    let square = |i: usize, says: f64| if scatter.covers(i) { (recording.force[i] - says).powi(2) } else { f64::NAN };
    let alone: Vec<f64> = (0..recording.len()).map(|i| square(i, offset + forces[i])).collect();
    let (mut with, mut knots) = ([vec![f64::NAN; recording.len()], vec![f64::NAN; recording.len()]], Vec::new());
    for (again, squares) in with.iter_mut().enumerate() {
        for part in 0..2 {
            match half(recording, fitted, &stroke, &|number| number % 2 == part, again == 1) {
                Ok((profile, says)) => {
                    knots.push(profile.levels().len());
                    let held_back = (0..recording.len()).filter(|i| stroke[*i] % 2 != part);
                    held_back.for_each(|i| squares[i] = square(i, says[i]));
                }
                Err(why) => println!("{}: {why}", recording.name),
            }
        }
    }
    let of = |squares: &Vec<f64>| (knots.len() == 4).then(|| errors(|chosen| rms(squares, chosen), &far));
    Row {
        floor: errors(|chosen| scatter.over(chosen).expect("repeats everywhere"), &far),
        without_drift: scatter.without_drift_n,
        element: errors(|chosen| rms(&alone, chosen), &far),
        profile: of(&with[0]),
        refitted: of(&with[1]),
        knots,
        reversal_lengths: [scatter.behind_reversals_m, scatter.before_reversals_m],
    }
}

/// Prints the table of all recordings as prepared by `prepare`.
pub(crate) fn table(recordings: &[Recording], title: &str, prepare: impl Fn(&Recording) -> Recording) -> Vec<Row> {
    println!("\n{title}; N, over all / from 3 mm behind reversals on / before");
    let print = |recording: &Recording| {
        let row = row(&prepare(recording));
        let three = |e: Errors| format!("{:.3}/{:.3}/{:.3}", e.all, e.far, e.near);
        let drift = row.without_drift.map_or("-".to_owned(), |s| format!("{s:.3}"));
        let with = |e: Option<Errors>| {
            let floor = row.floor;
            let ratio =
                |e: Errors| Errors { all: e.all / floor.all, far: e.far / floor.far, near: e.near / floor.near };
            e.map_or("none".to_owned(), |e| format!("{} ratio {}", three(e), three(ratio(e))))
        };
        let [behind, before] = row.reversal_lengths.map(|m| 1e3 * m);
        println!(
            "{:26} floor {} (drift out {drift}; reversals {behind:.1} {before:.1} mm)\n    element {}\n    profile {} knots {:?}\n    refitted {}",
            recording.name,
            three(row.floor),
            three(row.element),
            with(row.profile),
            row.knots,
            with(row.refitted)
        );
        row
    };
    recordings.iter().map(print).collect()
}
