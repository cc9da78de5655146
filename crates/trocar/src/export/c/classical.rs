//! The constants of the classical models.

use std::fmt::Write as _;

use trocar_model::{
    BoucWen, Classical, Dahl, Gms, Leuven, LuGre, MaxwellSlip, SlidingFriction, SlipElement,
    SlipRate, StribeckCurve,
};

use super::template::{Filling, number};
use super::{Parts, constant, stribeck_shapes, table};

/// Parts of the files of `model`; enters its requirements in `filling`.
pub(super) fn parts(model: &Classical, filling: &mut Filling) -> Parts {
    filling.need(&["holds"]);
    let mut text = String::new();
    let template = match model {
        Classical::Static(model) => {
            filling.need(&["direction", "least"]);
            sliding(&mut text, model.params(), filling);
            include_str!("static.c")
        }
        Classical::Dahl(model) => dahl(&mut text, model, filling),
        Classical::LuGre(model) => lugre(&mut text, model, filling),
        Classical::Leuven(model) => leuven(&mut text, model, filling),
        Classical::MaxwellSlip(model) => maxwell_slip(&mut text, model, filling),
        Classical::Gms(model) => gms(&mut text, model, filling),
        Classical::BoucWen(model) => bouc_wen(&mut text, model, filling),
    };
    text.push('\n');
    let types = if filling.has("level") { include_str!("sliding_types.c") } else { "" };
    let (state, code) = template.split_once("//@code\n").unwrap_or(("", template));
    let state = state.trim_start_matches("//@state\n");
    Parts { state, types, constants: text, code: code.to_owned() }
}

/// g and β, EMS (11).
fn sliding(text: &mut String, sliding: &SlidingFriction, filling: &mut Filling) {
    filling.need(&["level", "static_force"]);
    stribeck_shapes(
        Some(sliding.stribeck_exponent).filter(|_| !sliding.is_constant()).into_iter(),
        filling,
    );
    let members = [
        ("level", "coulomb_force_n", sliding.coulomb_force),
        ("static_force", "static_force_n", sliding.static_force),
        ("level", "viscous_damping_n_s_m", sliding.viscous_damping),
        ("stribeck", "surplus_force_n", sliding.static_force - sliding.coulomb_force),
        ("stribeck", "inverse_stribeck_velocity_s_m", 1.0 / sliding.stribeck_velocity),
        ("stribeck", "stribeck_exponent", sliding.stribeck_exponent),
    ];
    text.push_str("static const trocar_contact trocar_sliding = {\n");
    for (_, name, value) in members.into_iter().filter(|(feature, _, _)| filling.has(feature)) {
        let _ = writeln!(text, "    .{name} = {},", number(value));
    }
    text.push_str("};\n");
}

fn dahl(text: &mut String, model: &Dahl, filling: &mut Filling) -> &'static str {
    let params = model.params();
    filling.need(&["direction", "decay", "bits"]);
    constant(text, "trocar_stiffness_n_m", params.stiffness);
    constant(text, "trocar_coulomb_force_n", params.coulomb_force);
    constant(text, "trocar_viscous_damping_n_s_m", params.viscous_damping);
    if params.exponent != 1.0 {
        filling.need(&["inverse_power", "power", "logarithm", "one_plus"]);
        constant(text, "trocar_exponent_less_one", params.exponent - 1.0);
    }
    include_str!("dahl.c")
}

fn lugre(text: &mut String, model: &LuGre, filling: &mut Filling) -> &'static str {
    let params = model.params();
    filling.need(&["direction", "within", "decay", "bits"]);
    filling.set("rational", params.curve == StribeckCurve::Rational);
    filling.set("fading", model.inverse_damping_velocity() != 0.0);
    sliding(text, &params.sliding, filling);
    constant(text, "trocar_stiffness_n_m", params.stiffness);
    constant(text, "trocar_micro_damping_n_s_m", params.micro_damping);
    constant(text, "trocar_greatest_deflection_m", model.greatest_deflection());
    if filling.has("fading") {
        constant(text, "trocar_inverse_damping_velocity_s_m", model.inverse_damping_velocity());
    }
    include_str!("lugre.c")
}

fn leuven(text: &mut String, model: &Leuven, filling: &mut Filling) -> &'static str {
    let params = model.params();
    filling.need(&["direction", "least", "chord", "decay", "bits", "logarithm", "one_plus"]);
    filling.set("micro_damping", params.micro_damping > 0.0);
    filling.set("n_is_one", params.exponent == 1.0);
    filling.set("n_is_two", params.exponent == 2.0);
    sliding(text, &params.sliding, filling);
    if !filling.has("n_is_one") {
        filling.need(&["most"]);
        filling.set("power", !filling.has("n_is_two") || filling.has("power"));
        constant(text, "trocar_exponent", params.exponent);
    }
    bank(text, model.elements(), filling);
    constant(text, "trocar_limit_n", model.limit_force());
    constant(text, "trocar_damping_n_s_m", model.damping());
    if filling.has("micro_damping") {
        constant(text, "trocar_micro_damping_n_s_m", params.micro_damping);
    }
    include_str!("leuven.c")
}

fn maxwell_slip(text: &mut String, model: &MaxwellSlip, filling: &mut Filling) -> &'static str {
    filling.need(&["within"]);
    constant(text, "trocar_viscous_damping_n_s_m", model.viscous_damping());
    bank(text, model.elements(), filling);
    constant(text, "trocar_limit_n", model.limit_force());
    include_str!("maxwell_slip.c")
}

fn bank(text: &mut String, elements: &[SlipElement], filling: &mut Filling) {
    count(text, elements.len(), filling);
    let values = |of: fn(&SlipElement) -> f64| elements.iter().map(of).collect::<Vec<f64>>();
    table(text, "trocar_stiffness_n_m", &values(|element| element.stiffness));
    table(text, "trocar_limit_force_n", &values(|element| element.limit_force));
}

fn count(text: &mut String, elements: usize, filling: &mut Filling) {
    filling.value("ELEMENTS", elements.to_string());
    let _ = writeln!(text, "enum {{ trocar_elements = {elements} }};");
}

fn gms(text: &mut String, model: &Gms, filling: &mut Filling) -> &'static str {
    let elements = model.elements();
    filling.need(&["direction", "decay", "bits"]);
    filling.set("limited", model.slip_rate() == SlipRate::Limited);
    sliding(text, model.sliding(), filling);
    count(text, elements.len(), filling);
    table(
        text,
        "trocar_stiffness_n_m",
        &elements.iter().map(|element| element.stiffness).collect::<Vec<f64>>(),
    );
    table(
        text,
        "trocar_element_damping_n_s_m",
        &elements.iter().map(|element| element.damping).collect::<Vec<f64>>(),
    );
    table(text, "trocar_scale_m_n", model.scales());
    table(text, "trocar_rate_n_s", model.rates());
    constant(text, "trocar_damping_n_s_m", model.damping());
    constant(text, "trocar_slip_bound_n", model.slip_bound());
    include_str!("gms.c")
}

fn bouc_wen(text: &mut String, model: &BoucWen, filling: &mut Filling) -> &'static str {
    let params = model.params();
    filling.need(&[
        "direction",
        "least",
        "within",
        "chord",
        "decay",
        "bits",
        "logarithm",
        "one_plus",
    ]);
    filling.set("n_is_one", params.exponent == 1.0);
    filling.set("n_is_two", params.exponent == 2.0);
    constant(text, "trocar_stiffness_n_m", params.stiffness);
    constant(text, "trocar_coulomb_force_n", params.coulomb_force);
    constant(text, "trocar_unloading", model.unloading());
    constant(text, "trocar_viscous_damping_n_s_m", params.viscous_damping);
    if !filling.has("n_is_one") {
        filling.need(&["most"]);
        filling.set("power", !filling.has("n_is_two"));
        constant(text, "trocar_exponent", params.exponent);
    }
    include_str!("bouc_wen.c")
}
