//! Prints deflection and force of the plausible seal over one slow stroke and back.

use trocar_model::{Element, ElementParams, ParamError};

fn main() -> Result<(), ParamError> {
    let element = Element::new(ElementParams::plausible_10_5_mm()?)?;
    let mut state = element.rest_state(0.0);
    println!("time_s,deflection_m,force_n");
    for k in 0..1600 {
        let velocity = if (k / 800) % 2 == 0 { 0.05 } else { -0.05 };
        let force = element.step_velocity(&mut state, velocity, 1e-3);
        if k % 40 == 39 {
            println!("{:.3},{:.6},{force:.4}", f64::from(k + 1) * 1e-3, state.deflection());
        }
    }
    Ok(())
}
