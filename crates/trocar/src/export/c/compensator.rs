//! The constants of the observer of the tissue force.

use trocar_model::Seal;

use super::template::{Filling, number};
use super::{constant, table};
use crate::compensate::CompensatorConstants;

/// Constants of the observer; enters its requirements in `filling`.
pub(super) fn constants(known: &CompensatorConstants, filling: &mut Filling) -> String {
    filling.need(&["compensator"]);
    // As a value, since names that begin so get the prefix.
    filling.value("TROCAR_FORCE", "trocar_force_n");
    filling.set("adapts", known.adaptation);
    filling.set("mass", known.moving_mass > 0.0);
    filling.set("clock", known.adaptation || known.moving_mass > 0.0);
    filling.set("stiff", known.stiff.is_some());
    filling.set("flips", known.flips);
    let mut text = String::from(
        "/* What the observer knows: sensor, error of the model by phase (deforming, the same after a partial reversal,\n \
         * sliding, held, the same after a partial reversal), and variances of friction and viscosity at the start. */\n",
    );
    constant(&mut text, "trocar_sensor_offset_n", known.offset);
    constant(&mut text, "trocar_sensor_limit_n", known.sensor_limit);
    constant(&mut text, "trocar_least_change_n", known.least_change);
    constant(&mut text, "trocar_sign_travel_m", known.sign_travel);
    table(&mut text, "trocar_phase_error_n", &known.phase_error);
    table(&mut text, "trocar_prior", &known.prior);
    if known.adaptation {
        let [_, _, sliding, _, _] = known.phase_error;
        constant(&mut text, "trocar_sigma_n", sliding);
    }
    if known.moving_mass > 0.0 {
        constant(&mut text, "trocar_moving_mass_kg", known.moving_mass);
        constant(&mut text, "trocar_gravity_m_s2", known.gravity);
    }
    of_seal(&mut text, known, filling);
    text.push('\n');
    text
}

/// What only the observer needs of the seal.
fn of_seal(text: &mut String, known: &CompensatorConstants, filling: &Filling) {
    let seal = known.trocar.seal();
    if filling.has("adapts") || seal.stages().is_some() {
        constant(text, "trocar_half_width_m", seal.half_width());
    }
    match seal {
        Seal::Ems(stages) => {
            let params = stages.elements().iter().map(|element| element.params());
            let limits: Vec<f64> = params
                .clone()
                .map(|p| p.insertion.static_force + p.withdrawal.static_force)
                .collect();
            table(text, "trocar_static_force_n", &limits);
            constant(text, "trocar_all_static_n", limits.iter().sum());
            let rows: Vec<String> = params
                .map(|p| {
                    [&p.withdrawal, &p.insertion].map(|s| number(s.viscous_damping)).join(", ")
                })
                .map(|row| format!("    {{ {row} }},\n"))
                .collect();
            let count = rows.len();
            text.push_str(&format!(
                "static const double trocar_slip_damping_n_s_m[{count}][2] = {{\n{}}};\n",
                rows.concat()
            ));
        }
        Seal::Classical(model) => {
            constant(text, "trocar_slip_damping_n_s_m", model.viscous_damping());
        }
    }
}
