//! The constants of EMS elements.

use std::fmt::Write as _;

use trocar_model::constants::{ContactConstants, ElementConstants, SpanConstants};
use trocar_model::{Around, Element, ElementParams, Rotation, SlidingFriction};

use super::template::{Filling, number};
use super::{Parts, constant, pairs, stribeck_shapes};

/// Types, constants and code of `elements` in parallel, and of `stiff` ones of which a second table
/// is needed; enters their requirements in `filling`. With a `rotation` each is one of `around`, too.
pub(super) fn parts(
    elements: &[Element],
    stiff: &[Element],
    (rotation, around): (Option<&Rotation>, &[Around]),
    filling: &mut Filling,
    prefix: &str,
) -> Parts {
    let all = [elements, stiff].concat();
    let constants: Vec<ElementConstants> = all.iter().map(Element::constants).collect();
    filling.set("turning", rotation.is_some());
    find_features(&all, &constants, filling);
    let exponents = around.iter().filter(|own| !own.sliding.is_constant());
    stribeck_shapes(exponents.map(|own| own.sliding.stribeck_exponent), filling);
    let terms = terms(&constants);
    fill_values(filling, prefix, elements.len(), terms);
    let count = elements.len();
    let mut text = format!("enum {{ trocar_elements = {count} }};\n\n");
    if let Some(rotation) = rotation {
        constant(&mut text, "trocar_shaft_radius_m", rotation.shaft_radius);
        text.push('\n');
    }
    for (name, part) in [("element", 0..count), ("stiff", count..all.len())] {
        if part.is_empty() {
            continue;
        }
        let _ = writeln!(text, "static const trocar_element trocar_{name}_constants[{count}] = {{");
        for (k, (element, constants)) in all[part.clone()].iter().zip(&constants[part]).enumerate()
        {
            write_element(&mut text, element.params(), constants, around.get(k), terms, filling);
        }
        text.push_str("};\n\n");
    }
    let mut code = [include_str!("ems_elastic.c"), include_str!("ems_stick.c")].concat();
    if filling.has("general") {
        code.push_str(include_str!("ems_general.c"));
    }
    if filling.has("turning") {
        code.push_str(include_str!("ems_turn.c"));
    }
    code.push_str(include_str!("ems.c"));
    Parts { state: "", types: include_str!("ems_types.c"), constants: text, code }
}

fn find_features(elements: &[Element], constants: &[ElementConstants], filling: &mut Filling) {
    let confined = constants.iter().any(|constants| constants.confined);
    let general: Vec<&ElementParams> = elements
        .iter()
        .zip(constants)
        .filter(|(_, c)| !c.confined || filling.has("turning"))
        .map(|(element, _)| element.params())
        .collect();
    filling.need(&["ems", "decay", "bits"]);
    filling.set("confined", confined);
    filling.set("mixed", confined && !general.is_empty());
    if general.is_empty() {
        return;
    }
    filling.need(&["general", "least", "most"]);
    filling.set("damping", general.iter().any(|params| !params.damping.is_zero()));
    filling.set("creep", general.iter().any(|params| params.creep_velocity > 0.0));
    filling.set("lag", general.iter().any(|params| params.friction_lag > 0.0));
    filling.set("arms", general.iter().any(|params| !params.relaxation.is_none()));
    if general.iter().any(|params| params.dwell_force > 0.0) {
        filling.need(&["dwell", "logarithm", "one_plus"]);
    }
    filling.set("means", ["lag", "arms", "dwell"].iter().any(|feature| filling.has(feature)));
    let slidings = general.iter().flat_map(|params| [&params.withdrawal, &params.insertion]);
    let withdrawal = slidings.filter(|sliding| !sliding.is_constant());
    stribeck_shapes(withdrawal.map(|sliding| sliding.stribeck_exponent), filling);
}

/// Number of terms of the longest power series, at least 3.
fn terms(constants: &[ElementConstants]) -> usize {
    let series = constants.iter().flat_map(|constants| &constants.spans).map(|span| &span.force);
    let longest = series
        .map(|force| force.iter().rposition(|pair| *pair != [0.0; 2]).map_or(0, |last| last + 1));
    longest.max().unwrap_or(0).max(3)
}

fn fill_values(filling: &mut Filling, prefix: &str, elements: usize, terms: usize) {
    filling.value("ELEMENTS", elements.to_string());
    filling.value("TERMS", terms.to_string());
    filling.set("beyond_cubic", terms > 4);
    filling.value("LOW", half_of_series(0, terms));
    filling.value("HIGH", half_of_series(4, terms));
    let arms = filling.has("arms");
    filling.value(
        "ARMS_PARAMETER",
        if arms { format!("const {prefix}_step_arms *arms, ") } else { String::new() },
    );
    filling.value("ARMS_ARGUMENT", if arms { "&arms, " } else { "" });
    filling.value("REACHED", if filling.has("stribeck") { "reached" } else { "1.0" });
    let creep = filling.has("creep");
    filling.value("CREEP_VELOCITY", if creep { "e->creep_velocity_m_s" } else { "0.0" });
    filling.value("OR_CREEPING", if creep { "e->creep_velocity_m_s > 0.0 || " } else { "" });
    filling.value("UNLESS_CREEPING", if creep { " && !(e->creep_velocity_m_s > 0.0)" } else { "" });
}

/// Four terms of a series by Estrin's scheme, beginning with `first`, without missing ones.
fn half_of_series(first: usize, terms: usize) -> String {
    let pairs = [first, first + 2].map(|k| match terms.saturating_sub(k) {
        0 => None,
        1 => Some(format!("a[{k}][i]")),
        _ => Some(format!("(a[{k}][i] + a[{}][i] * t)", k + 1)),
    });
    match pairs {
        [Some(low), Some(high)] => format!("{low} + {high} * t2"),
        [low, _] => low.unwrap_or_default(),
    }
}

fn write_element(
    text: &mut String,
    params: &ElementParams,
    known: &ElementConstants,
    around: Option<&Around>,
    terms: usize,
    filling: &Filling,
) {
    let deformation = &params.deformation;
    text.push_str("    {\n");
    member(text, 8, "half_width_m", &number(deformation.half_width()));
    member(text, 8, "yield_stiffness_n_m", &number(deformation.yield_stiffness()));
    member(text, 8, "joins_m", &row(&known.joins));
    text.push_str("        .span = {\n");
    known.spans.iter().for_each(|span| write_span(text, span, terms, filling));
    text.push_str("        },\n");
    member(text, 8, "end_force_n", &row(&known.end_force));
    member(text, 8, "end_stiffness_n_m", &row(&known.end_stiffness));
    text.push_str("        .contact = {\n");
    for (sliding, contact) in
        [&params.withdrawal, &params.insertion].into_iter().zip(&known.contacts)
    {
        text.push_str("            {\n");
        write_contact(text, 16, (sliding, Some(contact)), filling);
        text.push_str("            },\n");
    }
    text.push_str("        },\n");
    if let Some(around) = around {
        member(text, 8, "around_stiffness_n_m", &number(around.stiffness));
        text.push_str("        .around = {\n");
        write_contact(text, 12, (&around.sliding, None), filling);
        text.push_str("        },\n");
    }
    let arms = &params.relaxation.arms;
    let members = [
        ("general", "least_stiffness_n_m", number(known.least_stiffness)),
        ("damping", "seal_damping", row(&params.damping.coefficients)),
        ("creep", "creep_velocity_m_s", number(params.creep_velocity)),
        ("lag", "friction_lag_s", number(params.friction_lag)),
        ("dwell", "dwell_force_n", number(params.dwell_force)),
        ("arms", "arm_stiffness_n_m", row(&arms.map(|arm| arm.stiffness))),
        ("arms", "arm_time_s", row(&arms.map(|arm| arm.time))),
        ("mixed", "confined", u8::from(known.confined).to_string()),
    ];
    write_members(text, 8, filling, &members);
    text.push_str("    },\n");
}

fn write_span(text: &mut String, span: &SpanConstants, terms: usize, filling: &Filling) {
    text.push_str("            {\n");
    member(text, 16, "middle_m", &number(span.mid));
    member(text, 16, "inverse_half_1_m", &number(span.inverse_half));
    let general = filling.has("general").then_some(("slope_n_m", &span.slope));
    for (name, series) in [("force_n", &span.force)].into_iter().chain(general) {
        let _ = writeln!(text, "                .{name} = {{");
        pairs(text, "                    ", &series[..terms]);
        text.push_str("                },\n");
    }
    text.push_str("            },\n");
}

/// Friction, and along the axis what is known of the contact.
fn write_contact(
    text: &mut String,
    indent: usize,
    (sliding, known): (&SlidingFriction, Option<&ContactConstants>),
    filling: &Filling,
) {
    let known = |value: fn(&ContactConstants) -> String| known.map(value);
    let own = |value: f64| Some(number(value));
    let plain = if filling.has("turning") { "turning" } else { "stribeck" };
    let members = [
        ("confined", "end_force_n", known(|known| number(known.end_force))),
        ("confined", "end_stiffness_n_m", known(|known| number(known.end_stiffness))),
        ("confined", "rate_1_s", known(|known| number(known.rate))),
        ("confined", "lag_s", known(|known| number(known.lag))),
        ("general", "coulomb_force_n", own(sliding.coulomb_force)),
        ("general", "static_force_n", own(sliding.static_force)),
        ("general", "viscous_damping_n_s_m", own(sliding.viscous_damping)),
        ("general", "least_damping_n_s_m", known(|known| number(known.damping))),
        ("general", "force_is_free", known(|known| u8::from(known.free).to_string())),
        ("stribeck", "surplus_force_n", own(sliding.static_force - sliding.coulomb_force)),
        (plain, "stribeck_velocity_m_s", own(sliding.stribeck_velocity)),
        ("stribeck", "inverse_stribeck_velocity_s_m", own(1.0 / sliding.stribeck_velocity)),
        ("stribeck", "stribeck_exponent", own(sliding.stribeck_exponent)),
        ("stribeck", "steepest_fall_n_s_m", known(|known| number(known.steepest_fall))),
        (
            "stribeck",
            "velocity_weakening",
            known(|known| u8::from(known.velocity_weakening).to_string()),
        ),
    ];
    let members = members.map(|(feature, name, value)| Some((feature, name, value?)));
    let members: Vec<_> = members.into_iter().flatten().collect();
    write_members(text, indent, filling, &members);
}

/// The members of a struct that the model needs.
fn write_members(
    text: &mut String,
    indent: usize,
    filling: &Filling,
    members: &[(&str, &str, String)],
) {
    for (_, name, value) in members.iter().filter(|(feature, _, _)| filling.has(feature)) {
        member(text, indent, name, value);
    }
}

fn member(text: &mut String, indent: usize, name: &str, value: &str) {
    let _ = writeln!(text, "{:indent$}.{name} = {value},", "");
}

fn row(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|value| number(*value)).collect();
    format!("{{ {} }}", values.join(", "))
}
