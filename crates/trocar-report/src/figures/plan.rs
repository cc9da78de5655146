//! Figures of a planned motion.

use super::{MM, over_time, thinned};
use crate::document::{Axis, Figure, Panel, Role, Series};
use trocar_lab::plan::{Interruption, Plan, Segment};

/// Kinds of cycles: name and role.
const KINDS: [(&str, Role); 3] = [
    ("full strokes", Role::Category(0)),
    ("partial reversals", Role::Category(1)),
    ("rests", Role::Category(2)),
];

fn kind(segment: &Segment) -> usize {
    match segment.block.interruption {
        Interruption::None => 0,
        Interruption::PartialReversal(_) => 1,
        Interruption::Rest(_) => 2,
    }
}

/// Position, speed and information over time.
pub(crate) fn motion(plan: &Plan) -> Figure {
    let courses = KINDS.iter().enumerate().filter_map(|(k, (name, role))| {
        position_of(plan, k).map(|(x, y)| Series::line(*name, *role, x, y))
    });
    let position = over_time(Axis::new("position", "mm")).aspect(0.3);
    let position = courses.fold(position, Panel::series);
    let speed = over_time(Axis::new("speed", "mm/s").with_zero()).aspect(0.18).series(steps(
        plan,
        "speed of the strokes",
        Role::Neutral,
        |s| MM * s.block.speed_m_s,
    ));
    let information = over_time(Axis::new("information", "%/s").with_zero()).aspect(0.22).series(
        steps(plan, "information of a cycle", Role::Model, |segment| {
            let share = plan.shares.iter().find(|share| share.block == segment.block);
            let part = share.map_or(0.0, |share| share.information_of_one.max(0.0));
            1e2 * part / (segment.to_s - segment.from_s)
        }),
    );
    let (angle, while_turning) = turning(plan);
    let position = while_turning.into_iter().fold(position, Panel::series);
    let figure = Figure::new("motion", 1, "The motion and what it tells")
        .caption(
            "Position of the instrument, speed of the strokes, and information: the part of the precision about the goal that would be \
             lost without a cycle, per second of it.",
        )
        .panel(position)
        .panel(speed)
        .panel(information);
    angle.into_iter().fold(figure, Figure::panel).linked_x()
}

/// Angle of the instrument and position while it turns; none on a rig that does not turn it.
fn turning(plan: &Plan) -> (Option<Panel>, Option<Series>) {
    let (Some(from), Some(angle)) = (plan.turning_from_s, &plan.course.angle) else {
        return (None, None);
    };
    let time = &plan.course.time;
    let first = time.partition_point(|t| *t < from);
    let line = |name: &str, values: &[f64], scale: f64| {
        let values: Vec<f64> = values.iter().map(|value| scale * value).collect();
        let (x, y) = thinned(&time[first..], &values);
        Series::line(name, Role::Category(3), x, y)
    };
    let panel = over_time(Axis::new("angle", "°")).aspect(0.18);
    let degrees = line("angle", &angle[first..], 180.0 / std::f64::consts::PI);
    let position = line("turning", &plan.course.position[first..], MM);
    (Some(panel.series(degrees)), Some(position))
}

/// The course in the cycles of a kind, with gaps between them; `None` where there is none.
fn position_of(plan: &Plan, of_kind: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    let (time, position) = (&plan.course.time, &plan.course.position);
    let (mut x, mut y) = (Vec::new(), Vec::new());
    for run in plan.segments.chunk_by(|a, b| kind(a) == kind(b)) {
        if kind(&run[0]) != of_kind {
            continue;
        }
        let from = time.partition_point(|t| *t < run[0].from_s);
        let to = time.partition_point(|t| *t <= run[run.len() - 1].to_s);
        let millimetres: Vec<f64> = position[from..to].iter().map(|x| MM * x).collect();
        let (own_x, own_y) = thinned(&time[from..to], &millimetres);
        x.extend(own_x.into_iter().chain([f64::NAN]));
        y.extend(own_y.into_iter().chain([f64::NAN]));
    }
    (!x.is_empty()).then_some((x, y))
}

/// A value of each segment over its time.
fn steps(plan: &Plan, name: &str, role: Role, of: impl Fn(&Segment) -> f64) -> Series {
    let x = plan.segments.iter().flat_map(|segment| [segment.from_s, segment.to_s]).collect();
    let y = plan.segments.iter().flat_map(|segment| [of(segment); 2]).collect();
    Series::line(name, role, x, y)
}
