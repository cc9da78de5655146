//! Creates a report from a teleoperation loop that ran.
//!
//! This module runs no loop. It evaluates linear theory over frequency, because the results contain no curves of it.

use super::document::{Cell, Document, Figure, LiveLoop, Section, Table, Tile, origin};
use super::figures::teleop as figures;
use super::figures::teleop::plain;
use super::figures::{MM, row_of};
use super::number::significant;
use super::{ReportError, stage_document};
use trocar_lab::summary::PROGRAM;
use trocar_lab::teleop::advise::{Advice, Map, NoticeableStep};
use trocar_lab::teleop::config::{Config, TissueKind};
use trocar_lab::teleop::merit::Merit;
use trocar_lab::teleop::{Diverged, Sample, Study, write_course, write_response};
use trocar_recording::sha256;
use trocar_tables::output::StagedFolder;

/// An input by its name, without a folder, and the SHA-256 of its bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    name: String,
    sha256: String,
}

impl Source {
    /// The input `name` with its `bytes`.
    pub fn new(name: impl Into<String>, bytes: &[u8]) -> Self {
        Self { name: name.into(), sha256: sha256(bytes) }
    }

    /// Its name.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Its name and hash.
    pub(super) fn words(&self) -> String {
        format!("{}, SHA-256 {}", self.name, self.sha256)
    }
}

/// Where the inputs of a study come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sources {
    /// File of the configuration; `None` for the defaults.
    pub config: Option<Source>,
    /// File of the trocar's model.
    pub trocar: Source,
    /// File of the compensator's model; `None` for the same.
    pub compensator: Option<Source>,
}

fn course(study: &Study) -> Result<&[Sample], Diverged> {
    study.outcome.course.as_deref().map_err(|diverged| *diverged)
}

/// Stages summary.json, course.parquet unless the loop diverged, hybrid.parquet if it was requested, report.html and
/// figures.
///
/// # Errors
/// What cannot be written.
pub fn write(study: &Study, sources: &Sources, staged: &StagedFolder) -> Result<(), ReportError> {
    staged.write("summary.json", study.summary().to_json().as_bytes())?;
    if let Ok(samples) = course(study) {
        write_course(samples, staged.path().join(COURSE))?;
    }
    if let Some(rows) = &study.hybrid {
        write_response(rows, staged.path().join("hybrid.parquet"))?;
    }
    stage_document(staged, &document(study, sources))
}

/// File of the course in the folder of a study.
pub const COURSE: &str = "course.parquet";

/// How far the hand of the live loop reaches before and beyond the surface at least, m.
const REACH: [f64; 2] = [0.03, 0.04];

/// The report: verdict, what is felt, how much to compensate, where the loop is stable, the live loop, linear
/// theory, energy, configuration.
///
/// Equal input gives equal documents. A loop that is not stable has no figures of merit. Where data are missing, a
/// sentence says what is missing.
pub fn document(study: &Study, sources: &Sources) -> Document {
    Document {
        title: "Teleoperation through a trocar".to_owned(),
        subtitle: subtitle(study),
        card: Vec::new(),
        tiles: tiles(study),
        warnings: warning(study).into_iter().collect(),
        notes: Vec::new(),
        sections: vec![
            felt(study),
            live(study),
            advised(study),
            map(study),
            linear(study),
            energy(study),
            configuration(&study.config),
        ],
        provenance: provenance(study, sources),
    }
    .numbered()
}

fn percent(fraction: f64) -> String {
    plain(100.0 * fraction) + " %"
}

fn subtitle(study: &Study) -> String {
    let Config { control, channel, tissue, compensation, motion, .. } = &study.config;
    let turning = match motion.turning_rad_s {
        0.0 => String::new(),
        rate => format!("; the instrument turns at {} rad/s", plain(rate)),
    };
    let tissue = match tissue.kind {
        TissueKind::None => "no tissue".to_owned(),
        _ => format!("tissue of {} N/m", plain(tissue.stiffness_n_m)),
    };
    format!(
        "{}, {} ms each way, {tissue}; {} of the trocar's force compensated{turning}",
        figures::in_words(control.architecture),
        plain(MM * channel.delay_s),
        percent(compensation.fraction)
    )
}

/// Why the loop is not stable; `None` where it is.
fn warning(study: &Study) -> Option<String> {
    match course(study) {
        Err(Diverged { time_s }) => Some(format!(
            "The loop is unstable: it diverged after {} s. A loop that is unstable has no figures of merit.",
            significant(time_s, 4)
        )),
        Ok(_) => study.outcome.unsettled_by.map(|disturbance| {
            format!(
                "The loop is unstable: it does not come to rest after {}. A loop that is unstable has no figures of merit.",
                disturbance.in_words()
            )
        }),
    }
}

fn tiles(study: &Study) -> Vec<Tile> {
    let verdict = match (course(study), study.outcome.unsettled_by) {
        (Err(Diverged { time_s }), _) => {
            ("unstable", format!("diverged after {} s", significant(time_s, 4)))
        }
        (Ok(_), Some(by)) => ("unstable", format!("no rest after {}", by.in_words())),
        (Ok(_), None) => ("stable", "comes to rest after pushes and pulls".to_owned()),
    };
    let mut tiles = vec![Tile::new("The loop", verdict.0, verdict.1)];
    if let Some(width) = &study.z_width {
        let ranges = width.ranges_n_m.iter().map(|[least, greatest]| {
            format!("{} to {}", significant(*least, 4), significant(*greatest, 4))
        });
        let held: Vec<String> = ranges.collect();
        let value = match held.as_slice() {
            [] => "none".to_owned(),
            held => held.join(", ") + " N/m",
        };
        tiles.push(Tile::new("Stable with tissue of", value, "tried from 0 to 20 000 N/m"));
    }
    if let Some(Advice { fraction, stable, .. }) = &study.advice {
        let value = fraction.map_or_else(|| "no fraction".to_owned(), percent);
        let note = if stable.is_empty() { "none is stable".to_owned() } else { ranges(stable) };
        tiles.push(Tile::new("Compensate of the trocar's force", value, note));
    }
    let Some(merit) = &study.outcome.figures else { return tiles };
    if let (Some(shown), Some(own)) = (merit.displayed_stiffness_n_m, merit.true_stiffness_n_m) {
        let shown = format!("{} N/m", significant(shown, 4));
        let note = format!("of the tissue {} N/m", significant(own, 4));
        tiles.push(Tile::new("Stiffness displayed", shown, note));
    }
    tiles.push(Tile::new(
        "Error of the force felt (rms)",
        format!("{} N", significant(merit.force_error_rms_n, 4)),
        format!("{} just noticeable differences", significant(merit.force_error_rms_jnd, 4)),
    ));
    tiles
}

/// "stable from 67.5 to 150 %".
fn ranges(stable: &[[f64; 2]]) -> String {
    let all: Vec<String> = stable
        .iter()
        .map(|[low, high]| match low == high {
            true => percent(*low),
            false => format!("{} to {}", plain(100.0 * low), percent(*high)),
        })
        .collect();
    format!("stable from {}", all.join(", "))
}

fn merit_table(caption: &str, merit: &Merit) -> Table {
    Table::of(
        caption,
        merit.rows(),
        &[
            ("Figure", &|(name, ..)| (*name).into()),
            ("Value", &|(_, value, _)| value.map_or("none".into(), |value| Cell::number(value, 4))),
            ("Unit", &|(.., unit)| (*unit).into()),
        ],
    )
}

fn felt(study: &Study) -> Section {
    let section = Section::new("What is felt");
    let Ok(samples) = course(study) else {
        return section.paragraph("The loop diverged: there is no course to show.");
    };
    let section = match &study.outcome.figures {
        Some(merit) => section.table(merit_table("Figures of merit", merit)),
        None => section.paragraph("The loop is unstable; the figures below show its motion only."),
    };
    let depth = figures::depth(&study.config, samples, study.outcome.figures.as_ref());
    section.figure(figures::course(&study.config, samples)).drawn(depth)
}

fn advised(study: &Study) -> Section {
    let section = Section::new("How much to compensate");
    let Some(advice) = &study.advice else {
        return section.paragraph("Not computed: ‹advise=True› tries fractions from 0 to 150 %.");
    };
    let words = match advice.fraction {
        Some(fraction) => format!(
            "Compensate {} of the trocar's force: the least error of the force felt among the fractions that are stable with {} ({}).",
            percent(fraction),
            match advice.pairs {
                1 => "the model".to_owned(),
                n => format!("all {n} pairs of a compensator's model and a trocar"),
            },
            ranges(&advice.stable)
        ),
        None => {
            let why = advice.refusal();
            format!("{}{}.", why[..1].to_uppercase(), &why[1..])
        }
    };
    let mut section = section.paragraph(words);
    if let Some(step) = advice.noticeable_with {
        section = section.paragraph(noticeable(step));
    }
    if let Some(merit) = &advice.with {
        section = section
            .table(merit_table("With that fraction, the pair with the largest error", merit));
    }
    section.table(figures::tried(advice)).figure(figures::errors(&study.config, advice))
}

/// What step of the tissue's stiffness is noticed with the fraction advised.
fn noticeable(step: NoticeableStep) -> String {
    match step {
        NoticeableStep::Noticed { step_n_m } => format!(
            "With it, the least step of the tissue's stiffness that is noticed is {} N/m.",
            significant(step_n_m, 4)
        ),
        NoticeableStep::NotNoticed { step_n_m } => format!(
            "With it, no step of the tissue's stiffness up to {} N/m is noticed.",
            significant(step_n_m, 4)
        ),
        NoticeableStep::Unstable { step_n_m } => format!(
            "With it, no step of the tissue's stiffness is noticed before the loop becomes unstable, with tissue stiffer \
             by {} N/m.",
            significant(step_n_m, 4)
        ),
    }
}

/// The map alone, as in the report; the cell of `config` is framed.
pub fn stability_map(config: &Config, map: &Map) -> Figure {
    figures::map(config, map)
}

fn map(study: &Study) -> Section {
    let section = Section::new("Where the loop is stable");
    match &study.map {
        Some(map) => {
            section.figure(figures::map(&study.config, map)).table(figures::map_table(map))
        }
        None => section.paragraph(
            "Not computed: ‹map=True› finds the stiffest tissue over delay and fraction.",
        ),
    }
}

fn linear(study: &Study) -> Section {
    let section = Section::new("Linear theory over frequency").paragraph(
        "The same loop without sampling. A seal is not linear: it enters as its describing function, the first harmonic of its force at the \
         stated amplitude around the surface of the tissue, and the figures hold for that amplitude.",
    );
    let [model, trocar] = &study.models;
    let model = match study.config.compensation.model(model) {
        Ok(model) => model,
        Err(why) => return section.paragraph(format!("Not computed: {why}.")),
    };
    let [matrix, transmitted] = figures::hybrid(&study.config, [&model, trocar]);
    section.figure(matrix).figure(transmitted)
}

fn energy(study: &Study) -> Section {
    let section = Section::new("Energy");
    match course(study) {
        Ok(samples) => section.figure(figures::energy(samples)),
        Err(_) => section.paragraph("The loop diverged: there is no course to show."),
    }
}

fn live(study: &Study) -> Section {
    let section = Section::new("The loop, live");
    let [compensator, trocar] = &study.models;
    let [trocar, compensator] = match [trocar, compensator].map(row_of) {
        [Ok(trocar), Ok(compensator)] => [trocar, compensator],
        [Err(why), _] | [_, Err(why)] => return section.paragraph(why),
    };
    let Ok(config) = serde_json::to_value(&study.config) else {
        return section.paragraph("This loop cannot be written as numbers for a page.");
    };
    let Config { motion, tissue, .. } = &study.config;
    let (first, last) = (motion.start_m(), motion.middle_m + motion.amplitude_m);
    let way = [
        first.min(last).min(tissue.surface_m - REACH[0]),
        first.max(last).max(tissue.surface_m + REACH[1]),
    ];
    let live = LiveLoop { config, trocar, compensator, start: first, way };
    Section { live_loop: Some(live), ..section.paragraph(LIVE) }
}

const LIVE: &str = "The loop itself runs here, the same steps as in every other program of this project. Change the fraction, the delay, the \
                    tissue and the architecture, watch the motion of the configuration, or drag the leader's handle: the forces felt, on the \
                    tissue and of the trocar follow at once.";

fn configuration(config: &Config) -> Section {
    Section::new("Configuration").table(figures::keys("All keys of the configuration", config))
}

fn provenance(study: &Study, sources: &Sources) -> Vec<(String, String)> {
    let Sources { config, trocar, compensator } = sources;
    let config = config.as_ref().map_or_else(|| "defaults".to_owned(), Source::words);
    let mut all = vec![
        origin("Program", PROGRAM),
        origin("Configuration", config),
        origin("Model", trocar.words()),
    ];
    all.extend(compensator.iter().map(|other| origin("Compensator", other.words())));
    all.push(origin("Seed", study.config.seed.to_string()));
    all
}
