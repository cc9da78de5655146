//! Half width c of each snap-through against its speed: EMS uses one value for all (section IV-B).

use super::{Drawn, MM, in_words, p_in_words};
use crate::document::{Axis, Figure, Panel, Role, Series};
use trocar_identify::{FullReversal, Identification};
use trocar_simulate::segment::Direction;

/// The half width of each full stroke, its mean and the model's value.
pub(crate) fn half_width(found: &Identification) -> Drawn {
    let deformation = super::deformation(found, "the half width c")?;
    let reversals = &deformation.full_reversals;
    let (slowest, fastest) = super::limits(reversals.iter().map(|t| &t.speed));
    let ends = vec![MM * slowest, MM * fastest];
    let estimate = &deformation.half_width;
    let model = if super::has_stages(found) { "model, first element" } else { "model" };
    let level = |value: f64| vec![MM * value; 2];
    let mut panel = Panel::new(
        Axis::new("mean speed of the snap-through", "mm/s"),
        Axis::new("half width c", "mm"),
    );
    if estimate.determined {
        let [low, high] = estimate.ci95.map(level);
        panel =
            panel.series(Series::band("mean, 95 % interval", Role::Fit, ends.clone(), low, high));
    }
    panel = panel
        .series(Series::line("mean, 95 % interval", Role::Fit, ends.clone(), level(estimate.value)))
        .series(Series::line(model, Role::Model, ends, level(found.model.half_width)))
        .series(points("insertion", Role::Category(0), reversals, Direction::Insertion))
        .series(points("withdrawal", Role::Category(1), reversals, Direction::Withdrawal));
    let trend = deformation.speed_dependence_p_value.map_or_else(
        || "Too few speeds were measured to test whether c depends on speed.".to_owned(),
        |p| format!("Test of no dependence on speed: {}.", p_in_words(p)),
    );
    Ok(Figure::new("half-width", 0, "Half width of the deformation").panel(panel.aspect(0.4)).caption(format!(
        "Half the travel of each snap-through of the seal, from where the force leaves one sliding limit to where it reaches the \
         other, equation (12). Mean of {} snap-throughs: {}; standard deviation {:.3} mm, which is the error of the deflection rebuilt by \
         equation (24). {trend}",
        reversals.len(),
        in_words(estimate),
        MM * deformation.deflection_error
    )))
}

/// The half width of each snap-through in one direction.
fn points(name: &str, role: Role, reversals: &[FullReversal], direction: Direction) -> Series {
    let own = reversals.iter().filter(|t| t.direction == direction);
    let (x, y) = own.map(|t| (MM * t.speed, MM * t.half_travel)).unzip();
    Series::points(name, role, x, y)
}
