//! Figures of merit of a loop that ran.

use serde::Serialize;

use super::config::{Architecture, Config};
use super::simulation::Sample;

/// Just noticeable difference of a force, as a fraction of it, PANG.
const NOTICEABLE: f64 = 0.07;
/// Force below which the difference stays that of this force, N.
const WEAKEST_N: f64 = 2.5;
/// Speed up to which the tip counts as at rest, m/s: a step of 1 µm in a millisecond, less than which encoders do not resolve; in
/// slow motions a hundredth of their largest speed, but above rounding. A tip that sticks rings and creeps by less, and its
/// force changes without depth.
const AT_REST_M_S: [f64; 2] = [1e-6, 1e-3];
const AT_REST: f64 = 0.01;

/// Just noticeable difference of a stiffness, as a fraction of it, JONES.
pub(crate) const STIFFNESS_NOTICEABLE: f64 = 0.23;

/// How well the operator feels the tissue.
///
/// The force felt is that of the leader's motor, F_mc. In four channels F_mc includes the force that accelerates the leader's
/// mass; the force felt is then that of the operator, F_h.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Merit {
    /// Rms of the force felt less the force on the tissue, N.
    pub force_error_rms_n: f64,
    /// Largest magnitude of that, N.
    pub force_error_peak_n: f64,
    /// Rms of that in just noticeable differences of the force on the tissue, 1.
    pub force_error_rms_jnd: f64,
    /// Slope of the force felt over the depth of the tip in the tissue while it goes deeper, N/m; none
    /// without contact, without stiffness, and where the motion begins in the tissue. It includes damping: compare it with that
    /// of the force on the tissue.
    pub displayed_stiffness_n_m: Option<f64>,
    /// The same of the force on the tissue, N/m.
    pub true_stiffness_n_m: Option<f64>,
    /// Slope of the force felt in one push in which hand and tip begin at rest at the surface and the seal is undeformed, N/m.
    pub displayed_from_rest_n_m: Option<f64>,
    /// The same of the force on the tissue, N/m.
    pub true_from_rest_n_m: Option<f64>,
    /// Slope of the force felt in one push in which the tip comes from so far, at least 20 mm, that the seal slides when it
    /// touches, N/m; none for a trocar that does not slide within 160 mm.
    pub displayed_sliding_n_m: Option<f64>,
    /// The same of the force on the tissue, N/m.
    pub true_sliding_n_m: Option<f64>,
    /// Rms of the difference of the devices' positions, m.
    pub position_error_rms_m: f64,
    /// Energy that the network has received at both ports less what it has given, J; below 0 where it was active.
    pub energy_j: f64,
    /// The same at the leader's port alone, J.
    pub leader_energy_j: f64,
    /// The same at the follower's port alone, J.
    pub follower_energy_j: f64,
    /// Energy that the passivity control was given back for what the trocar dissipated, J; none without a credit
    /// ([`super::config::PassivityCredit`]).
    pub credit_j: Option<f64>,
}

/// The least difference from `force` that a person notices, N: 7 % of it (2.5 to 10 N, PANG); below 2.5 N it stays 7 % of
/// 2.5 N.
pub(crate) fn just_noticeable_difference(force: f64) -> f64 {
    NOTICEABLE * force.abs().max(WEAKEST_N)
}

impl Config {
    /// What the operator feels, N: the force of the leader's motor, and in four channels, where the motor
    /// also moves the leader, that of the operator.
    pub fn felt(&self, sample: &Sample) -> f64 {
        match self.control.architecture {
            Architecture::FourChannel => sample.operator_force,
            _ => sample.leader_force,
        }
    }
}

impl Merit {
    /// Figures of `samples`, all of them; without those of the two pushes.
    pub fn of(config: &Config, samples: &[Sample]) -> Self {
        let rms = |of: &dyn Fn(&Sample) -> f64| {
            let squares: f64 = samples.iter().map(|sample| of(sample).powi(2)).sum();
            (squares / samples.len().max(1) as f64).sqrt()
        };
        let error = |sample: &Sample| config.felt(sample) - sample.tissue_force;
        let [leader_energy_j, follower_energy_j] =
            samples.last().map_or([0.0; 2], Sample::network_energies);
        let [displayed_stiffness_n_m, true_stiffness_n_m] = displayed(config, samples);
        Self {
            force_error_rms_n: rms(&error),
            force_error_peak_n: samples.iter().map(|s| error(s).abs()).fold(0.0, f64::max),
            force_error_rms_jnd: rms(&|sample| {
                error(sample) / just_noticeable_difference(sample.tissue_force)
            }),
            displayed_stiffness_n_m,
            true_stiffness_n_m,
            displayed_from_rest_n_m: None,
            true_from_rest_n_m: None,
            displayed_sliding_n_m: None,
            true_sliding_n_m: None,
            position_error_rms_m: rms(&|sample| sample.leader_position - sample.follower_position),
            energy_j: leader_energy_j + follower_energy_j,
            leader_energy_j,
            follower_energy_j,
            credit_j: samples.last().filter(|_| config.has_credit()).map(|sample| sample.credit),
        }
    }

    /// Whether the tip has gone deeper into the tissue of `config`, or began there: without it the figures are those of free motion.
    pub fn reaches(&self, config: &Config) -> bool {
        config.begins_in_the_tissue() || self.true_stiffness_n_m.is_some()
    }

    /// The figures for display: name, value (`None` without contact) and unit.
    pub fn rows(&self) -> Vec<(&'static str, Option<f64>, &'static str)> {
        let rows = [
            ("stiffness displayed", self.displayed_stiffness_n_m, "N/m"),
            ("stiffness of the tissue", self.true_stiffness_n_m, "N/m"),
            ("contact from rest: displayed", self.displayed_from_rest_n_m, "N/m"),
            ("contact from rest: tissue", self.true_from_rest_n_m, "N/m"),
            ("contact while sliding: displayed", self.displayed_sliding_n_m, "N/m"),
            ("contact while sliding: tissue", self.true_sliding_n_m, "N/m"),
            ("error of the force felt, rms", Some(self.force_error_rms_n), "N"),
            ("error of the force felt, peak", Some(self.force_error_peak_n), "N"),
            ("in just noticeable differences, rms", Some(self.force_error_rms_jnd), "1"),
            ("error of position, rms", Some(1e3 * self.position_error_rms_m), "mm"),
            ("energy from the leader", Some(1e3 * self.leader_energy_j), "mJ"),
            ("energy to the follower", Some(-1e3 * self.follower_energy_j), "mJ"),
        ];
        let credit =
            self.credit_j.map(|j| ("energy credited from the trocar", Some(1e3 * j), "mJ"));
        rows.into_iter().chain(credit).collect()
    }
}

/// Slopes of the force felt and of the force on the tissue over the depth of the tip while it goes deeper, N/m.
pub(super) fn displayed(config: &Config, samples: &[Sample]) -> [Option<f64>; 2] {
    // A motion that begins in the tissue begins with an undeformed seal, unlike every later contact.
    if config.begins_in_the_tissue() || !config.has_tissue() {
        return [None; 2];
    }
    let [least, most] = AT_REST_M_S;
    let at_rest = (AT_REST * config.motion.peak_m_s()).clamp(least, most);
    let loading: Vec<&Sample> = samples
        .iter()
        .filter(|sample| sample.tissue_force > 0.0 && sample.follower_velocity > at_rest)
        .collect();
    let forces: [fn(&Config, &Sample) -> f64; 2] = [Config::felt, |_, sample| sample.tissue_force];
    forces.map(|force| {
        let points = loading.iter().map(|sample| {
            let depth = sample.follower_position - config.tissue.surface(sample.time).0;
            [depth, force(config, sample)]
        });
        slope(&points.collect::<Vec<_>>())
    })
}

/// Slope of `y` over `x` by least squares; `None` for fewer than ten samples or all at one place.
fn slope(points: &[[f64; 2]]) -> Option<f64> {
    let count = points.len() as f64;
    let [x0, y0] = [0, 1].map(|of| points.iter().map(|point| point[of]).sum::<f64>() / count);
    let (mut xx, mut xy) = (0.0, 0.0);
    for [x, y] in points {
        let (dx, dy) = (x - x0, y - y0);
        (xx, xy) = (xx + dx * dx, xy + dx * dy);
    }
    (points.len() >= 10 && xx > 0.0).then(|| xy / xx)
}
