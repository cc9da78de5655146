//! Force in steady sliding against velocity, with the fitted line and its confidence limits (EMS
//! figure 6, (23), (11)).

use trocar_model::ElementParams;

use super::{Drawn, MM, in_words, p_in_words, spaced};
use crate::document::{Axis, Figure, Kind, Panel, Role, Series};
use crate::number::fixed;
use trocar_identify::{DirectionLine, Estimate, Identification, SteadyFit, StrokeMean};

/// Most means drawn with bars; more would overlap.
const MOST_BARS: usize = 250;
/// Most means drawn.
const MOST_MEANS: usize = 1_500;

/// Half of a 95 % interval in standard errors.
const NORMAL_95: f64 = 1.96;

/// The static friction figure.
pub(crate) fn static_friction(found: &Identification) -> Drawn {
    let steady = &found.steady;
    if steady.means.is_empty() {
        return Err("There is no figure of the static friction (figure 6 of the paper): no steady sliding was found.".to_owned());
    }
    let curves = Curves { steady, offset: found.model.offset };
    let mut all = vec![curves.means()];
    all.extend(curves.confidence().into_iter().chain(curves.fitted()));
    if let Some(name) = super::model_name(found) {
        all.push(curves.model(found, name));
    }
    let [whole, close] = ["force", "force less fit"].map(|force| {
        let velocity = Axis::new("sliding velocity", "mm/s").with_zero();
        Panel::new(velocity, Axis::new(force, "N").with_zero())
    });
    let less_fit = all.iter().cloned().map(|series| curves.less_fit(series));
    Ok(Figure::new("static-friction", 0, "Static friction")
        .panel(all.iter().cloned().fold(whole, Panel::series))
        .panel(less_fit.fold(close.aspect(0.35), Panel::series))
        .linked_x()
        .caption(caption(found)))
}

struct Curves<'a> {
    steady: &'a SteadyFit,
    /// Offset subtracted from all curves, N.
    offset: f64,
}

impl Curves<'_> {
    fn means(&self) -> Series {
        let means = &self.steady.means;
        let every = means.len().div_ceil(MOST_MEANS);
        let shown: Vec<&StrokeMean> = means.iter().step_by(every).collect();
        let x: Vec<f64> = shown.iter().map(|m| MM * m.velocity_m_s).collect();
        let y: Vec<f64> = shown.iter().map(|m| m.force_n - self.offset).collect();
        if shown.len() > MOST_BARS {
            return Series::points("mean", Role::Measured, x, y);
        }
        let scatter = self.steady.stroke_mean_scatter_n;
        let bars = shown.iter().map(|m| NORMAL_95 * m.standard_error_n.hypot(scatter));
        let (low, high) = y.iter().zip(bars).map(|(y, bar)| (y - bar, y + bar)).unzip();
        Series::error_bars("mean, ± 95 %", Role::Measured, x, y, low, high)
    }

    /// A curve over the speeds measured in both directions, interrupted at zero velocity.
    fn curve(&self, name: &str, role: Role, force: impl Fn(f64) -> f64) -> Series {
        let [slowest, fastest] = self.steady.speed_range_m_s;
        let mut x = Vec::new();
        if self.steady.means.iter().any(|m| m.velocity_m_s < 0.0) {
            x.extend(spaced(-fastest, -slowest, 60));
            x.push(f64::NAN);
        }
        if self.steady.means.iter().any(|m| m.velocity_m_s > 0.0) {
            x.extend(spaced(slowest, fastest, 60));
        }
        let y = x.iter().map(|v| force(*v)).collect();
        Series::line(name, role, x.iter().map(|v| MM * v).collect(), y)
    }

    fn reading(&self, v: f64) -> f64 {
        self.steady.line(v) - self.offset
    }

    fn fitted(&self) -> Vec<Series> {
        if !self.steady.is_asymmetric() {
            let name = if self.steady.stribeck.is_some() { "fit (11)" } else { "fit (23)" };
            return vec![self.curve(name, Role::Fit, |v| self.reading(v))];
        }
        let common =
            self.curve("one line for both directions", Role::Alternative, |v| self.reading(v));
        let own =
            self.curve("fit (23) of each direction", Role::Fit, |v| self.direction(v, |e| e.value));
        vec![common, own]
    }

    /// The same series with the fit subtracted, on a scale that shows the intervals.
    fn less_fit(&self, series: Series) -> Series {
        let fit: Vec<f64> = series.x.iter().map(|v| self.fit(v / MM)).collect();
        let less = |values: Vec<f64>| values.iter().zip(&fit).map(|(force, f)| force - f).collect();
        let kind = match series.kind {
            Kind::ErrorBars { low, high } => Kind::ErrorBars { low: less(low), high: less(high) },
            other => other,
        };
        Series { y: less(series.y), kind, ..series }
    }

    fn fit(&self, v: f64) -> f64 {
        if self.steady.is_asymmetric() {
            self.direction(v, |estimate| estimate.value)
        } else {
            self.reading(v)
        }
    }

    /// The line of one direction without offset; `of` selects the values of its parameters.
    fn direction(&self, v: f64, of: impl Fn(&Estimate) -> f64) -> f64 {
        let line: Option<&DirectionLine> =
            if v > 0.0 { self.steady.insertion.as_ref() } else { self.steady.withdrawal.as_ref() };
        line.map_or(f64::NAN, |l| {
            v.signum() * (of(&l.coulomb_force_n) + of(&l.viscous_damping_n_s_m) * v.abs())
                - self.offset
        })
    }

    /// Curves of the lowest and the highest parameters, as in EMS figure 6; empty if the data do
    /// not determine them.
    fn confidence(&self) -> Vec<Series> {
        let s = self.steady;
        let ends = [("lowest parameters", Role::Lower, 0), ("highest parameters", Role::Upper, 1)];
        let determined = s.coulomb_force_n.determined && s.viscous_damping_n_s_m.determined;
        if !(s.is_asymmetric() || determined) {
            return Vec::new();
        }
        ends.map(|(name, role, end)| {
            let [coulomb, viscous] = [&s.coulomb_force_n, &s.viscous_damping_n_s_m]
                .map(|estimate| estimate.ci95[end] - estimate.value);
            self.curve(name, role, |v| {
                if s.is_asymmetric() {
                    self.direction(v, |estimate| estimate.ci95[end])
                } else {
                    self.reading(v) + v.signum() * coulomb + viscous * v
                }
            })
        })
        .into()
    }

    /// All stages in steady sliding, including the creep of the contact.
    fn model(&self, found: &Identification, name: &str) -> Series {
        let elements = found.stages.elements();
        self.curve(name, Role::Model, |v| {
            elements.iter().map(|e| steady_force(e.params(), v)).sum()
        })
    }
}

/// Force of an element in steady sliding, with its creep.
fn steady_force(p: &ElementParams, v: f64) -> f64 {
    let sliding = if v > 0.0 { &p.insertion } else { &p.withdrawal };
    let viscous = sliding.viscous_damping * v.abs();
    let part = if v == 0.0 { 0.0 } else { v.abs() / v.hypot(p.creep_velocity) };
    v.signum() * ((sliding.force(v.abs()) - viscous) * part + viscous)
}

fn caption(found: &Identification) -> String {
    let steady = &found.steady;
    let [slowest, fastest] = steady.speed_range_m_s.map(|v| MM * v);
    let mut text = format!(
        "(a) Force in steady sliding against velocity, as in figure 6 of the paper, the sensor offset of {} N removed: {} means, one \
         per stroke and constant speed, or one per 0.1 s of motion where the deformation is negligible and inertia was subtracted. (b) The \
         same less the fit. ",
        fixed(found.model.offset, 3),
        steady.means.len()
    );
    if steady.means.len() <= MOST_BARS {
        text.push_str("Bars hold 95 % of what such a mean scatters, by the scatter within it and between strokes. ");
    }
    if steady.coulomb_force_n.determined && steady.viscous_damping_n_s_m.determined {
        text.push_str(&format!(
            "The line is equation (23) of the paper, F = F_c·sgn(v) + β·v, by weighted least squares over the means: F_c = {}; β = {}. Broken lines \
             take both parameters at the lower and at the upper end of their intervals; the two estimates are correlated, so \
             the band is wider than that of the line. ",
            in_words(&steady.coulomb_force_n),
            in_words(&steady.viscous_damping_n_s_m)
        ));
    } else {
        let why = [&steady.viscous_damping_n_s_m, &steady.coulomb_force_n]
            .into_iter()
            .find_map(|e| e.note.as_deref());
        text.push_str(&format!(
            "No confidence lines are drawn, because the parameters are not determined: {}. ",
            why.unwrap_or("too few data")
        ));
    }
    text.push_str(&symmetry(steady));
    if let Some(test) = &steady.lack_of_fit {
        text.push_str(&format!(
            "Test of the straight line against a Stribeck curve, equation (11): {}, {} N above the line at the slowest speed; {}. ",
            p_in_words(test.p_value),
            fixed(test.excess_at_slowest_n, 3),
            test.verdict
        ));
    }
    text.push_str(&format!(
        "Nothing was measured slower than {slowest:.1} or faster than {fastest:.0} mm/s, and no line is drawn there."
    ));
    text
}

fn symmetry(steady: &SteadyFit) -> String {
    match steady.symmetry_p_value {
        Some(p) if p < 0.01 => format!(
            "The directions differ in slope ({}), so each has its own line; their Coulomb forces cannot be distinguished from the offset. ",
            p_in_words(p)
        ),
        Some(p) => format!("The directions do not differ in slope ({}). ", p_in_words(p)),
        None => "Whether the directions differ could not be tested. ".to_owned(),
    }
}
