//! Figures of a teleoperation loop.

use nalgebra::{Complex, ComplexField};
use trocar_model::Trocar;

use super::{Drawn, MM, line, over_time};
use crate::document::{Axis, Cell, Figure, Mark, Panel, Role, Series, Table};
use crate::number::significant;
use trocar_lab::teleop::Sample;
use trocar_lab::teleop::advise::{Advice, Map, Tried};
use trocar_lab::teleop::config::{Architecture, Config};
use trocar_lab::teleop::hybrid::{self, Hybrid, seal_impedance, tissue_impedance};
use trocar_lab::teleop::merit::Merit;
use trocar_lab::teleop::stability::ZWidth;

/// Roles of the three forces, the same in every figure and in the live loop.
const FELT: Role = Role::Model;
const TISSUE: Role = Role::Fit;
const TROCAR: Role = Role::Deflection;

/// Points of a loop of force over depth.
const LOOP_POINTS: usize = 2_000;
/// Amplitudes of the describing function, m.
const AMPLITUDES: [f64; 2] = [1e-3, 10e-3];
/// Lower ends of the classes of a map beyond the first, which is 0, N/m.
const CLASSES: [f64; 6] = [0.0, 100.0, 200.0, 500.0, 1000.0, 5000.0];

/// A number of the configuration as it was given.
pub(crate) fn plain(value: f64) -> String {
    format!("{}", (1e6 * value).round() / 1e6)
}

/// An architecture in words.
pub(crate) fn in_words(architecture: Architecture) -> &'static str {
    match architecture {
        Architecture::PositionPosition => "Position-position",
        Architecture::PositionForce => "Position-force",
        Architecture::FourChannel => "Four channels",
        Architecture::Wave => "Wave variables",
    }
}

fn course_of(samples: &[Sample], name: &str, role: Role, of: impl Fn(&Sample) -> f64) -> Series {
    let time: Vec<f64> = samples.iter().map(|sample| sample.time).collect();
    line(name, role, &time, samples.iter().map(of))
}

/// Positions and forces over time.
pub(crate) fn course(config: &Config, samples: &[Sample]) -> Figure {
    let mm = |name, role, of: fn(&Sample) -> f64| course_of(samples, name, role, |s| MM * of(s));
    let positions = over_time(Axis::new("position", "mm"))
        .series(mm("intended by the hand", Role::Neutral, |s| s.hand_position))
        .series(mm("leader", Role::Model, |s| s.leader_position))
        .series(mm("follower", Role::Alternative, |s| s.follower_position))
        .mark(Mark::y(MM * config.tissue.surface_m, "tissue"))
        .aspect(0.3);
    let forces = over_time(Axis::new("force", "N").with_zero())
        .series(course_of(samples, "of the trocar", TROCAR, |s| s.trocar_force))
        .series(course_of(samples, "felt at the leader", FELT, |s| config.felt(s)))
        .series(course_of(samples, "on the tissue", TISSUE, |s| s.tissue_force))
        .aspect(0.36);
    Figure::new("course", 0, "Course of the loop")
        .caption(
            "The motion that the hand intends, and of both devices; the force that the operator feels beside the \
             forces of the instrument on tissue and trocar. Positive is towards the tissue.",
        )
        .panel(positions)
        .panel(forces)
        .linked_x()
}

/// Force felt and force on the tissue over the depth of the tip.
pub(crate) fn depth(config: &Config, samples: &[Sample], figures: Option<&Merit>) -> Drawn {
    let touches: Vec<&Sample> = samples.iter().filter(|sample| sample.tissue_force > 0.0).collect();
    if touches.is_empty() {
        return Err("The tip does not touch the tissue: there is no force over depth.".to_owned());
    }
    let every = touches.len().div_ceil(LOOP_POINTS);
    let shown = touches.iter().copied().step_by(every);
    // A gap is between two contacts: `None` there.
    let mut points: Vec<Option<&Sample>> = Vec::new();
    let mut before = f64::NEG_INFINITY;
    for sample in shown {
        if sample.time - before > 1.5 * every as f64 * config.sample_time_s {
            points.push(None);
        }
        points.push(Some(sample));
        before = sample.time;
    }
    let column = |of: &dyn Fn(&Sample) -> f64| {
        points.iter().map(|point| point.map_or(f64::NAN, of)).collect::<Vec<f64>>()
    };
    let depth = column(&|s| MM * (s.follower_position - config.tissue.surface(s.time).0));
    let over_depth = |name, role, of: &dyn Fn(&Sample) -> f64| {
        Series::line(name, role, depth.clone(), column(of))
    };
    let panel = Panel::new(
        Axis::new("depth of the tip in the tissue", "mm").with_zero(),
        Axis::new("force", "N").with_zero(),
    )
    .series(over_depth("of the trocar", TROCAR, &|s| s.trocar_force))
    .series(over_depth("felt at the leader", FELT, &|s| config.felt(s)))
    .series(over_depth("on the tissue", TISSUE, &|s| s.tissue_force));
    let slopes = figures.and_then(|merit| {
        let [felt, own] = [merit.displayed_stiffness_n_m?, merit.true_stiffness_n_m?];
        Some(format!(
            " While the tip goes deeper, the slope of the force felt is {} N/m (the stiffness displayed) and that of the force on the tissue \
             {} N/m.",
            significant(felt, 4),
            significant(own, 4)
        ))
    });
    Ok(Figure::new("depth", 0, "Force over depth")
        .caption(format!(
            "What a finger on the tissue would feel, and what the operator feels at the same depth of the tip.{}",
            slopes.unwrap_or_default()
        ))
        .panel(panel))
}

/// Errors and stiffness over the fractions that were tried.
pub(crate) fn errors(config: &Config, advice: &Advice) -> Figure {
    let newtons = with_curves(
        advice,
        Axis::new("error of the force", "N"),
        &[
            ("rms", Role::Model, |m| Some(m.force_error_rms_n)),
            ("peak", Role::Fit, |m| Some(m.force_error_peak_n)),
        ],
    );
    let steps = with_curves(
        advice,
        Axis::new("rms error", "JND"),
        &[("in just noticeable differences", Role::Model, |m| Some(m.force_error_rms_jnd))],
    );
    let steps = steps.mark(Mark::y_range(0.0, 1.0, "not noticed"));
    let stiffness = with_curves(
        advice,
        Axis::new("stiffness", "N/m"),
        &[
            ("displayed", FELT, |m| m.displayed_stiffness_n_m),
            ("of the tissue", TISSUE, |m| m.true_stiffness_n_m),
        ],
    );
    Figure::new("fractions", 0, "Error and stiffness over the fraction compensated")
        .caption(
            "Of the trocar and compensator with the largest error among all that were tried; only where the loop is stable with all of them \
             (shaded). A just noticeable difference (JND) is 7 % of the force, and below 2.5 N as large \
             as there.",
        )
        .panel(marked(config, advice, newtons.aspect(0.28), ["stable", "advised", "this loop"]))
        .panel(marked(config, advice, steps.aspect(0.22), [""; 3]))
        .panel(marked(config, advice, stiffness.aspect(0.28), [""; 3]))
        .linked_x()
}

/// With the stable fractions, the advised one and that of `config` marked.
fn marked(config: &Config, advice: &Advice, mut panel: Panel, words: [&str; 3]) -> Panel {
    let [stable, advised, own] = words;
    for [low, high] in &advice.stable {
        panel = panel.mark(Mark::x_range(100.0 * low, 100.0 * high, stable));
    }
    if let Some(fraction) = advice.fraction {
        panel = panel.mark(Mark::x(100.0 * fraction, advised));
    }
    panel.mark(Mark::x(100.0 * config.compensation.fraction, own))
}

/// A figure of merit by name, role, and where it is.
type MeritCurve = (&'static str, Role, fn(&Merit) -> Option<f64>);

/// Figures of merit over the fractions that were tried.
fn with_curves(advice: &Advice, y: Axis, curves: &[MeritCurve]) -> Panel {
    let panel = Panel::new(Axis::new("fraction compensated γ", "%").with_zero(), y.with_zero());
    let x: Vec<f64> = advice.tried.iter().map(|tried| 100.0 * tried.fraction).collect();
    curves.iter().fold(panel, |panel, (name, role, of)| {
        let merits = advice.tried.iter().map(|tried| tried.merit.as_ref().and_then(of));
        let y: Vec<f64> = merits.map(|value| value.unwrap_or(f64::NAN)).collect();
        panel.curve(name, *role, &x, &y)
    })
}

/// All fractions that were tried.
pub(crate) fn tried(advice: &Advice) -> Table {
    let table = Table::of(
        "All fractions that were tried",
        &advice.tried,
        &[
            ("Fraction (%)", &|tried| Cell::number(100.0 * tried.fraction, 4)),
            ("Loop", &|tried| if tried.stable { "stable" } else { "unstable" }.into()),
            ("Error, rms (N)", &|tried| of_merit(tried, |m| Some(m.force_error_rms_n))),
            ("Error, peak (N)", &|tried| of_merit(tried, |m| Some(m.force_error_peak_n))),
            ("Rms (JND)", &|tried| of_merit(tried, |m| Some(m.force_error_rms_jnd))),
            ("Stiffness displayed (N/m)", &|tried| of_merit(tried, |m| m.displayed_stiffness_n_m)),
            ("of the tissue (N/m)", &|tried| of_merit(tried, |m| m.true_stiffness_n_m)),
        ],
    );
    table.collapsed()
}

/// A figure of merit of a fraction, if the loop was stable with it.
fn of_merit(tried: &Tried, of: fn(&Merit) -> Option<f64>) -> Cell {
    let value = tried.merit.as_ref().and_then(of);
    value.map_or("–".into(), |value| Cell::number(value, 4))
}

/// Distance of equally spaced values; 1 for a single one.
fn apart(values: &[f64]) -> f64 {
    if values.len() > 1 { values[1] - values[0] } else { 1.0 }
}

/// Stiffest tissue over delay and fraction; the cell of `config` is framed.
pub(crate) fn map(config: &Config, map: &Map) -> Figure {
    let size = [100.0 * apart(&map.fractions), MM * apart(&map.delays_s)];
    let mut panel = Panel::new(
        Axis::new("fraction compensated γ", "%"),
        Axis::new("delay of one direction", "ms"),
    )
    .aspect(0.75);
    for level in 0..=CLASSES.len() {
        let inside: Vec<_> = map.cells().filter(|(.., width)| class(width) == level).collect();
        let x = inside.iter().map(|(_, fraction, _)| 100.0 * fraction).collect();
        let y = inside.iter().map(|(delay, ..)| MM * delay).collect();
        let labels = inside.iter().map(|(.., width)| cell_label(width)).collect();
        let role = Role::Level(level as u8);
        panel = panel.series(Series::cells(class_name(level), role, size, [x, y], labels));
    }
    let (fraction, delay) = (100.0 * config.compensation.fraction, MM * config.channel.delay_s);
    let axes = [(&map.fractions, 100.0, fraction), (&map.delays_s, MM, delay)];
    let covers = axes.iter().all(|(values, scale, at)| {
        let ends = [values.first(), values.last()].map(|end| scale * end.copied().unwrap_or(*at));
        (ends[0]..=ends[1]).contains(at)
    });
    if covers {
        let (x, y) =
            frame([fraction, delay], size, [100.0 * map.fractions[0], MM * map.delays_s[0]]);
        panel = panel.series(Series::line("this loop", Role::Fit, x, y));
    }
    Figure::new("stability", 0, "Stiffest tissue with which the loop is stable")
        .caption(
            "Up to the number in a cell (N/m; k: thousand) the loop comes to rest after a push into the tissue and back; tissue from 0 to 20 000 N/m \
             was tried. 0: with none that was tried. A star: stable not from 0 on, or in several ranges; the table has all of them.",
        )
        .panel(panel)
}

/// Edges of the cell that holds `at`, of cells of `size` the first of which has its centre at `first`.
fn frame(at: [f64; 2], size: [f64; 2], first: [f64; 2]) -> (Vec<f64>, Vec<f64>) {
    let centre = [0, 1].map(|k| first[k] + size[k] * ((at[k] - first[k]) / size[k]).round());
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]];
    corners.map(|[a, b]| (centre[0] + a * size[0], centre[1] + b * size[1])).into_iter().unzip()
}

/// Class of the stiffest tissue; 0 for none, and where softer tissue is not held, for then the stiffest says little.
fn class(width: &ZWidth) -> usize {
    let Some([0.0, greatest]) = width.first() else { return 0 };
    CLASSES.iter().filter(|low| greatest > 0.0 && greatest >= **low).count()
}

fn class_name(level: usize) -> String {
    match level {
        0 => "none, or no soft tissue".to_owned(),
        1 => format!("below {} N/m", CLASSES[1]),
        k if k == CLASSES.len() => format!("{} N/m and more", CLASSES[k - 1]),
        k => format!("{} to {} N/m", CLASSES[k - 1], CLASSES[k]),
    }
}

/// The stiffest tissue in at most four characters, with a star where it does not say all.
fn cell_label(width: &ZWidth) -> String {
    let is_simple = matches!(width.ranges_n_m[..], [] | [[0.0, _]]);
    let star = if is_simple { "" } else { "*" };
    match width.first().map_or(0.0, |[_, greatest]| greatest) {
        s if s < 999.5 => format!("{s:.0}{star}"),
        s if s < 9950.0 => format!("{:.1}k{star}", s / 1e3),
        s => format!("{:.0}k{star}", s / 1e3),
    }
}

/// The numbers of the map.
pub(crate) fn map_table(map: &Map) -> Table {
    let heads = map.fractions.iter().map(|fraction| plain(100.0 * fraction));
    let caption = "The numbers of the map: tissue with which the loop is stable (N/m; one number: from 0 up to it), delay of one direction \
                   down, fraction compensated (%) across";
    let empty = Table::new(caption, std::iter::once("Delay (ms)".to_owned()).chain(heads));
    let rows = map.delays_s.iter().zip(&map.z_width_n_m);
    let table = rows.fold(empty, |table, (delay, widths)| {
        let first = Cell::number(MM * delay, 4);
        table.row(std::iter::once(first).chain(widths.iter().map(stable_with)))
    });
    table.collapsed()
}

/// The stiffnesses of the tissue with which the loop is stable.
fn stable_with(width: &ZWidth) -> Cell {
    match width.ranges_n_m.as_slice() {
        [] => Cell::number(0.0, 1),
        [[0.0, greatest]] => Cell::number(greatest.round(), 1),
        all => {
            let words = all
                .iter()
                .map(|[low, high]| format!("{} to {}", plain(low.round()), plain(high.round())));
            Cell::Text(words.collect::<Vec<String>>().join(", "))
        }
    }
}

/// The hybrid matrix, and what follows from it, over frequency.
pub(crate) fn hybrid(config: &Config, [model, trocar]: [&Trocar<Vec<f64>>; 2]) -> [Figure; 2] {
    let frequencies = hybrid::frequencies();
    let none = vec![[Complex::new(0.0, 0.0); 2]; frequencies.len()];
    let mut seals = vec![("without a trocar".to_owned(), Role::Neutral, none)];
    for (amplitude, role) in AMPLITUDES.into_iter().zip([Role::Category(0), Role::Category(1)]) {
        let name = format!("with the trocar at {} mm", significant(MM * amplitude, 2));
        let both = frequencies
            .iter()
            .map(|f| [model, trocar].map(|seal| seal_impedance(seal, config, amplitude, *f)));
        seals.push((name, role, both.collect()));
    }
    let panel = |y: Axis, of: &dyn Fn(&Hybrid, f64) -> f64| {
        let axes = Panel::new(Axis::new("frequency", "Hz").logarithmic(), y);
        seals.iter().fold(axes.aspect(0.62), |panel, (name, role, seal)| {
            let y = frequencies
                .iter()
                .zip(seal)
                .map(|(f, z)| of(&Hybrid::with_compensator(config, *z, *f), *f));
            panel.series(Series::line(name.as_str(), *role, frequencies.clone(), y.collect()))
        })
    };
    let mobility = Axis::new("|h₂₂|, mobility of the follower", "m/(N s)").logarithmic();
    let matrix = Figure::new("hybrid", 0, "Hybrid matrix")
        .caption(
            "Magnitudes of [F_h; −v_s] = H [v_m; F_e], F_h of the operator on the leader and F_e on the tissue. Ideal is h_11 = h_22 = 0 and \
             |h_12| = |h_21| = 1: no impedance of its own, the tissue's force felt as it is, the motion followed as it is.",
        )
        .panel(panel(impedance("|h₁₁|, felt in free space"), &|h, _| h.h11.modulus()))
        .panel(panel(ratio("|h₁₂|, force felt"), &|h, _| h.h12.modulus()).mark(Mark::y(1.0, "")))
        .panel(panel(ratio("|h₂₁|, motion"), &|h, _| h.h21.modulus()).mark(Mark::y(1.0, "")))
        .panel(panel(mobility, &|h, _| h.h22.modulus()))
        .columns(2);
    let felt = panel(impedance("impedance felt"), &|h, f| {
        h.transmitted(tissue_impedance(config, f)).modulus()
    });
    let own: Vec<f64> =
        frequencies.iter().map(|f| tissue_impedance(config, *f).modulus()).collect();
    let felt = felt.series(Series::line("of the tissue", TISSUE, frequencies.clone(), own));
    let margin = panel(ratio("Llewellyn's margin"), &|h, _| h.llewellyn()).mark(Mark::y(0.0, ""));
    let transmitted = Figure::new("transmitted", 0, "Impedance felt, and margin of stability")
        .caption(
            "(a) Magnitude of what the operator feels in contact with the tissue. (b) 2 Re h_11 Re h_22 − Re(h_12 h_21) − |h_12 h_21|: not \
             below 0 at any frequency means stable with every passive operator and tissue, if Re h_11 and Re h_22 are not below \
             0 either. With the operator and tissue at hand a loop can \
             be stable although the margin is below 0.",
        )
        .panel(felt.aspect(0.7))
        .panel(margin.aspect(0.7))
        .columns(2);
    [matrix, transmitted]
}

fn impedance(label: &str) -> Axis {
    Axis::new(label, "N s/m").logarithmic()
}

fn ratio(label: &str) -> Axis {
    Axis::new(label, "").with_zero()
}

/// Energy that went into the network of controllers and channel at either port.
pub(crate) fn energy(samples: &[Sample]) -> Figure {
    let panel = over_time(Axis::new("energy received", "J").with_zero())
        .series(course_of(samples, "at the leader", Role::Model, |s| s.network_energies()[0]))
        .series(course_of(samples, "at the follower", Role::Alternative, |s| {
            s.network_energies()[1]
        }))
        .series(course_of(samples, "together", Role::Measured, |s| {
            s.network_energies().iter().sum()
        }))
        .aspect(0.36);
    Figure::new("energy", 0, "Energy at both ports")
        .caption(
            "Energy that controllers and channel have received at the ports of leader and follower less what they have given there. Where the \
             sum falls below zero, they were active: they gave more than they had received.",
        )
        .panel(panel)
}

/// Every key of a configuration with its value, as in its file.
pub(crate) fn keys(caption: &str, config: &impl serde::Serialize) -> Table {
    let text = toml::to_string(config).unwrap_or_default();
    let mut section = String::new();
    let mut table = Table::new(caption, ["Key", "Value"]);
    for line in text.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            section = format!("{name}.");
        } else if let Some((key, value)) = line.split_once(" = ") {
            let key = Cell::Code(format!("{section}{key}"));
            table = table.row([key, value.trim_matches('"').into()]);
        }
    }
    table.collapsed()
}
