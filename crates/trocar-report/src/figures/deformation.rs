//! The deformation force against deformation velocity (EMS figure 7) and deflection (EMS figure 8).

use trocar_model::{Branch, Element, Friction, Stages};

use super::{Drawn, MM, in_words, p_in_words, spaced};
use crate::document::{Axis, Figure, Mark, Panel, Role, Series};
use crate::number::significant;
use trocar_identify::{
    BINS, BranchFit, BranchShape, DampingTest, DeformationFit, EndForces, FullReversal,
    Identification, bin_centres, legendre,
};
use trocar_simulate::segment::Direction;

/// Default deflections for the force against velocity, as z/c.
const LEVELS: [f64; 3] = [-0.5, 0.0, 0.5];
/// Points of a drawn branch.
const BRANCH_POINTS: usize = 300;

/// Force at several deflections against deformation velocity: at those of `chosen`, m, or by
/// default at [`LEVELS`].
pub(crate) fn deformation_velocity(found: &Identification, chosen: &[f64]) -> Drawn {
    let what = "the deformation force against deformation velocity (figure 7 of the paper)";
    let deformation = super::deformation(found, what)?;
    let test = deformation.damping.as_ref().ok_or(
        "There is no figure of the deformation force against deformation velocity (figure 7 of the paper): all snap-throughs of the seal have one \
         speed, so its influence cannot be seen. Record several speeds.",
    )?;
    let c = deformation.half_width.value;
    let mut panel = Panel::new(
        Axis::new("deformation velocity", "mm/s").with_zero(),
        Axis::new("deformation force", "N"),
    );
    let levels: Vec<f64> =
        if chosen.is_empty() { LEVELS.to_vec() } else { chosen.iter().map(|z| z / c).collect() };
    let digits = if chosen.is_empty() { 2 } else { 4 };
    for (category, &level) in levels.iter().enumerate() {
        let role = Role::Category(category as u8);
        let name = format!("z = {} mm", significant(MM * level * c, digits));
        for direction in [Direction::Insertion, Direction::Withdrawal] {
            let at = Level::new(deformation, direction, level);
            panel = panel
                .series(at.points(&name, role, test.deflection_error_m))
                .series(at.line(role, test));
        }
    }
    Ok(Figure::new("deformation-velocity", 0, "Influence of the deformation velocity")
        .panel(panel)
        .caption(velocity_caption(found, test, levels.len())))
}

/// The force of the strokes in one direction at one deflection.
struct Level {
    /// Deformation velocity, m/s, and force, N, of each stroke.
    points: Vec<(f64, f64)>,
    /// dF/dz of the mean curve, N/m.
    stiffness: f64,
}

impl Level {
    fn new(deformation: &DeformationFit, direction: Direction, level: f64) -> Self {
        let bin = ((0.5 * (level + 1.0) * BINS as f64) as usize).min(BINS - 1);
        let own =
            deformation.full_reversals.iter().filter(|t: &&FullReversal| t.direction == direction);
        let mean = &deformation.branch(direction).mean_curve;
        let (low, high) = (bin.saturating_sub(4), (bin + 4).min(BINS - 1));
        let travel = 2.0 * deformation.half_width.value * (high - low) as f64 / BINS as f64;
        Self {
            points: own.map(|t| (t.velocity[bin], t.curve[bin])).collect(),
            stiffness: (mean[high] - mean[low]) / travel,
        }
    }

    fn points(&self, name: &str, role: Role, deflection_error: f64) -> Series {
        let bar = self.stiffness.abs() * deflection_error;
        let x = self.points.iter().map(|(velocity, _)| MM * velocity).collect();
        let [low, y, high] =
            [-bar, 0.0, bar].map(|off| self.points.iter().map(|(_, force)| force + off).collect());
        Series::error_bars(name, role, x, y, low, high)
    }

    /// A line through the mean of the points with the slope of the joint test.
    fn line(&self, role: Role, test: &DampingTest) -> Series {
        let n = self.points.len().max(1) as f64;
        let mean = self.points.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
        let (slowest, fastest) = super::limits(self.points.iter().map(|(velocity, _)| velocity));
        let ends = [slowest, fastest];
        let force = ends.map(|v| mean.1 + test.seal_damping_n_s_m.value * (v - mean.0));
        Series::line("", role, ends.map(|v| MM * v).to_vec(), force.to_vec())
    }
}

fn velocity_caption(found: &Identification, test: &DampingTest, levels: usize) -> String {
    const COUNTS: [&str; 6] = [
        "one deflection",
        "two deflections",
        "three deflections",
        "four deflections",
        "five deflections",
        "six deflections",
    ];
    let deflections =
        COUNTS.get(levels.saturating_sub(1)).copied().unwrap_or("the chosen deflections");
    let verdict = if found.fit.is_some() {
        "which is where the fit to all motion starts from; its own σ is in the table of parameters, if it keeps one"
    } else if test.kept {
        "so σ is kept in the model"
    } else if test.equivalent_to_zero {
        "so σ is set to zero, and an influence of more than 0.1 N is excluded at 95 %"
    } else {
        "so σ is set to zero, although these data do not exclude a larger influence"
    };
    format!(
        "Force at {deflections} against the velocity of the deformation (insertion at the right, withdrawal at the left), as in \
         figure 7 of the paper. Bars are the change of the force within ± {:.3} mm, one standard deviation of the rebuilt deflection \
         (equation (24)). Lines have the one slope σ that all snap-throughs give together at ∓c/2 and 0, with that error as a common \
         disturbance of the levels of one snap-through: σ = {}, {} against σ = 0. At the fastest deformation it amounts to {:.3} N, and \
         to {:.3} N at most within its interval, {verdict}.",
        MM * test.deflection_error_m,
        in_words(&test.seal_damping_n_s_m),
        p_in_words(test.p_value),
        test.largest_force_n,
        test.largest_force_not_excluded_n
    )
}

/// Both branches: measured curves, joined polynomials, single polynomial; residuals of both fits.
pub(crate) fn deformation_force(found: &Identification, truth: Option<&[Element]>) -> Drawn {
    let deformation = super::deformation(found, "the deformation force (figure 8 of the paper)")?;
    let force = Axis::new("deformation force", "N").with_zero();
    let axes = Panel::new(Axis::new("deflection z", "mm"), force).aspect(0.6);
    let mut branches =
        branch_series(found, deformation, truth).into_iter().fold(axes, Panel::series);
    for direction in Direction::BOTH {
        let join = found.element().params().deformation.branch(direction).join();
        branches = branches.mark(Mark::x(MM * join, format!("join, {}", direction.name())));
    }
    let residuals = Direction::BOTH.map(|direction| residual_panel(found, deformation, direction));
    let figure = Figure::new("deformation-force", 0, "Deformation force").panel(branches);
    Ok(residuals.into_iter().fold(figure, Figure::panel).linked_x().caption(force_caption(
        found,
        deformation,
        truth,
    )))
}

/// What the fits of one branch leave of the mean of the snap-throughs.
fn residual_panel(
    found: &Identification,
    deformation: &DeformationFit,
    direction: Direction,
) -> Panel {
    let fit = deformation.branch(direction);
    let c = deformation.half_width.value;
    let x: Vec<f64> = bin_centres().map(|u| MM * u * c).collect();
    let less = |force: &dyn Fn(f64) -> f64| {
        bin_centres().zip(&fit.mean_curve).map(|(u, mean)| mean - force(u)).collect()
    };
    let mut panel =
        Panel::new(Axis::new("deflection z", "mm"), Axis::new("residual", "N").with_zero());
    if let Some(joined) = fitted(found, deformation, &fit.shape) {
        let left = less(&|u| joined.force(u * c));
        panel = panel.series(Series::line(JOINED, Role::Fit, x.clone(), left));
    }
    panel.title(direction.name()).aspect(0.28).series(Series::line(
        SINGLE,
        Role::Alternative,
        x,
        less(&|u| single(fit, u)),
    ))
}

const JOINED: &str = "joined polynomials (25)";
const SINGLE: &str = "single polynomial, degree 7";

/// The two-step fit of a branch.
fn fitted(
    found: &Identification,
    deformation: &DeformationFit,
    shape: &BranchShape,
) -> Option<Branch> {
    let end_forces: EndForces = found.two_step.end_forces();
    shape.branch(deformation.half_width.value, end_forces).ok()
}

fn single(fit: &BranchFit, u: f64) -> f64 {
    fit.single_polynomial.iter().enumerate().map(|(order, a)| a * legendre(order, u)).sum()
}

fn branch_series(
    found: &Identification,
    deformation: &DeformationFit,
    truth: Option<&[Element]>,
) -> Vec<Series> {
    let c = deformation.half_width.value;
    let mut all = Vec::new();
    for fit in [&deformation.insertion_branch, &deformation.withdrawal_branch] {
        let x: Vec<f64> = bin_centres().map(|u| MM * u * c).collect();
        let [low, high] = [-1.0, 1.0].map(|sign| {
            fit.mean_curve.iter().zip(&fit.scatter).map(|(f, s)| f + sign * s).collect()
        });
        let measured = "measured, mean ± 1 sd";
        let alone = bin_centres().map(|u| single(fit, u)).collect();
        all.push(Series::band(measured, Role::Measured, x.clone(), low, high));
        all.push(Series::line(measured, Role::Measured, x.clone(), fit.mean_curve.clone()));
        all.push(Series::line(SINGLE, Role::Alternative, x, alone));
        if let Some(branch) = fitted(found, deformation, &fit.shape) {
            all.push(drawn(JOINED, Role::Fit, &branch));
        }
    }
    if let Some(name) = super::model_name(found) {
        all.extend([1.0, -1.0].map(|sign| full_stroke(name, found, deformation, sign)));
    }
    if let Some([element]) = truth {
        let force = &element.params().deformation;
        let branches = [force.insertion(), force.withdrawal()];
        all.extend(branches.map(|branch| drawn("truth of the bench", Role::Reference, branch)));
    }
    all
}

/// Mean speed of the snap-throughs, m/s.
fn mean_speed(deformation: &DeformationFit) -> f64 {
    deformation.full_reversals.iter().map(|t| t.speed).sum::<f64>()
        / deformation.full_reversals.len().max(1) as f64
}

/// The whole model snapped through at the mean speed of the snap-throughs, with all stages, damping
/// and relaxation. Insertion for a positive `sign`.
fn full_stroke(
    name: &str,
    found: &Identification,
    deformation: &DeformationFit,
    sign: f64,
) -> Series {
    let c = deformation.half_width.value;
    let step = 2.0 * c / (BRANCH_POINTS - 1) as f64;
    let duration = step / mean_speed(deformation);
    let mut state = found.stages.rest_at_force(0.0);
    // Far enough to slide and to forget the initial state.
    for _ in 0..3 * BRANCH_POINTS {
        found.stages.step(&mut state, -sign * step, duration);
    }
    // As in the measured snap-throughs, z is measured from where the force leaves the sliding
    // limit.
    let end_forces = found.two_step.end_forces();
    let limit = sign * if sign > 0.0 { end_forces.low } else { end_forces.high };
    for _ in 0..BRANCH_POINTS {
        if sign * found.stages.step(&mut state, sign * step, duration) >= limit {
            break;
        }
    }
    let z: Vec<f64> = spaced(-sign * c, sign * c, BRANCH_POINTS).collect();
    let mut force = vec![Stages::force(&state)];
    force.extend((1..BRANCH_POINTS).map(|_| found.stages.step(&mut state, sign * step, duration)));
    Series::line(name, Role::Model, z.iter().map(|z| MM * z).collect(), force)
}

fn drawn(name: &str, role: Role, branch: &Branch) -> Series {
    let c = branch.half_width();
    let z = spaced(-c, c, BRANCH_POINTS);
    let force = z.clone().map(|z| branch.force(z)).collect();
    Series::line(name, role, z.map(|z| MM * z).collect(), force)
}

fn force_caption(
    found: &Identification,
    deformation: &DeformationFit,
    truth: Option<&[Element]>,
) -> String {
    let [insertions, withdrawals] = [Direction::Insertion, Direction::Withdrawal]
        .map(|d| deformation.full_reversals.iter().filter(|t| t.direction == d).count());
    let [left, right] = deformation.insertion_branch.shape.degrees();
    let stages = if super::has_stages(found) { "the first of its elements" } else { "its element" };
    let refined = if found.fit.is_some() {
        format!(
            " The model is drawn as a whole, snapped through at {:.0} mm/s, the mean speed of the snap-throughs: all of its elements, damping \
             and relaxation, which the measured mean holds too. Joins marked are those of {stages}.",
            MM * mean_speed(deformation)
        )
    } else {
        " Joins are marked.".to_owned()
    };
    let true_branches = match truth {
        Some([_]) => " The truth is that of the virtual bench.",
        Some(_) => {
            " The virtual bench ran several elements in parallel; their branches have no counterpart here."
        }
        None => "",
    };
    format!(
        "(a) Force against deflection in deformation, as in figure 8 of the paper: {insertions} insertions (upper branch) and {withdrawals} withdrawals (lower \
         branch), sensor offset removed, deflection by equation (24). The joined polynomials of degrees {left} and {right}, equation (25), are \
         fitted to the mean of the snap-throughs by equation (26), through the sliding limits at ±c.{refined} (b), (c) What both fits leave \
         of the mean: root mean square {:.4} N and {:.4} N with the joined polynomials, {:.4} N and {:.4} N with a single polynomial \
         of degree 7, in insertion and withdrawal.{true_branches}",
        deformation.insertion_branch.rms,
        deformation.withdrawal_branch.rms,
        deformation.insertion_branch.single_polynomial_rms,
        deformation.withdrawal_branch.single_polynomial_rms,
    )
}
