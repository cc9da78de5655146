//! The result of an identification.

use serde::Serialize;
use trocar_model::{Element, ParameterId, Rotation, Stages, Trocar};

use super::adequacy::Phase;
use super::candidate::Candidate;
use super::deformation::DeformationFit;
use super::estimate::Estimate;
use super::findings::{Covariance, Parameter, Warning};
use super::posterior::{Density, Posterior};
use super::scale::FrictionScale;
use super::seal_prior::PriorUse;
use super::steady::SteadyFit;
use super::terms::TermTrial;
use super::unexplained::PositionDelay;
use trocar_recording::{Recording, RecordingError};
use trocar_simulate::motion_found::FreeMotion;
use trocar_simulate::profile::ProfileFit;
use trocar_simulate::stick_slip::StickSlip;

/// Outcome of the likelihood fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitSummary {
    /// Trials of the optional terms.
    pub terms: Vec<TermTrial>,
    /// Root mean square error, N, of the paper's element fitted to all motion, with the friction
    /// scale of each stroke removed.
    pub paper_rms_n: f64,
    /// The same for the model.
    pub rms_n: f64,
    /// Iterations of the last fit.
    pub iterations: usize,
    /// Whether it converged.
    pub converged: bool,
}

/// Result of an identification.
#[derive(Debug, Clone)]
pub struct Identification {
    /// The model's parameters.
    pub model: Candidate,
    /// The model, ready to run.
    pub stages: Stages,
    /// The two-step result.
    pub two_step: Candidate,
    /// All parameters with intervals.
    pub parameters: Vec<Parameter>,
    /// The same parameters by the paper's two steps alone.
    pub two_step_parameters: Vec<Parameter>,
    /// Steady-state step.
    pub steady: SteadyFit,
    /// Dynamic step, or why there is none.
    pub deformation: Result<DeformationFit, String>,
    /// The likelihood fit, which then defines the model; `None` when it was not requested or not
    /// possible.
    pub fit: Option<FitSummary>,
    /// Covariance of the parameters of the fit; `None` without a fit.
    pub covariance: Option<Covariance>,
    /// Models beside that of the fit whose deviations make up its covariance, each with how much of
    /// the deviation it has: less than 1, or negative, where the whole is no model.
    pub deviations: Vec<(Stages, f64)>,
    /// What the recordings added to the model that was given as prior; `None` without one.
    pub prior: Option<PriorUse>,
    /// Draws of the parameters, if they were asked for and there is a fit.
    pub posterior: Option<Posterior>,
    /// The density of their most probable structure.
    pub density: Option<Density>,
    /// Change of friction from stroke to stroke.
    pub friction_scale: FrictionScale,
    /// Content of the recordings beyond full strokes.
    pub free_motion: FreeMotion,
    /// Error of the model by phase of the motion.
    pub phases: Vec<Phase>,
    /// Self-excited oscillation of the force; `None` without any.
    pub stick_slip: Option<StickSlip>,
    /// The position delay that was found and compensated; `None` if none is detectable.
    pub position_delay: Option<PositionDelay>,
    /// Position dependence of the force in addition to the element; `None` where it does not
    /// improve the prediction of held-out cycles.
    pub position_profile: Option<ProfileFit>,
    /// Why repeated strokes gave no position profile.
    pub no_position_profile: Option<String>,
    /// Resistance to rotation; `None` where it was not asked for or not recorded.
    pub rotation: Option<Rotation>,
    /// Number of model parameters estimated from the recordings, without the sensor offset and an
    /// unmodelled mass.
    pub free_parameters: usize,
    /// Root mean square error, N, of the model over the recordings it was identified from.
    pub residual_rms: f64,
    /// Warnings about the result.
    pub warnings: Vec<Warning>,
}

impl Identification {
    /// The element, or the first of several stages.
    pub fn element(&self) -> &Element {
        self.stages.first()
    }

    /// The estimate of a parameter.
    pub fn estimate(&self, id: impl Into<ParameterId>) -> Option<&Estimate> {
        let id = id.into();
        self.parameters.iter().find(|p| p.id == id).map(|p| &p.estimate)
    }

    /// The estimate of the parameter of this name, such as `half_width_m`.
    pub fn parameter(&self, name: &str) -> Option<&Estimate> {
        self.estimate(ParameterId::named(name)?)
    }

    /// The model, with its position profile.
    pub fn trocar(&self) -> Trocar<&[f64]> {
        let profile =
            self.position_profile.as_ref().map(|fit| fit.profile.stored_as(|knots| knots));
        let axial = Trocar::new(self.stages, profile);
        axial.with_rotation(self.rotation).unwrap_or(axial)
    }

    /// The recordings for comparison with the model: with the position delay compensated along
    /// the expected positions, since counts that are interpolated are none.
    ///
    /// # Errors
    /// As for [`Recording::with_position_delay`].
    pub fn without_delay(
        &self,
        recordings: Vec<Recording>,
    ) -> Result<Vec<Recording>, RecordingError> {
        let Some(PositionDelay { delay_s, .. }) = self.position_delay else {
            return Ok(recordings);
        };
        recordings.iter().map(|own| own.smoothed().with_position_delay(delay_s)).collect()
    }

    /// A remark for the model file if the deformation was not identified.
    pub fn deformation_note(&self) -> Option<String> {
        let fitted = self.fit.is_some();
        let assumed = self.deformation.as_ref().err().filter(|_| !fitted);
        assumed.map(|why| format!("deformation assumed, not identified: {why}"))
    }

    /// Whether data were lost or parameters are not determined (exit code 3).
    pub fn is_doubtful(&self) -> bool {
        self.warnings.iter().any(|w| w.doubtful)
    }
}
