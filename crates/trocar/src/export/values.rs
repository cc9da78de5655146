//! The numbers of a model in the names, units and conventions of other programs, as text to paste,
//! and what these programs cannot express of it.

use std::f64::consts::FRAC_1_SQRT_2;

use serde_json::{Value, json};
use thiserror::Error;
use trocar_lab::validate::validate;
use trocar_lab::workflow::Correction;
use trocar_model::{
    Classical, Direction, Element, LuGre, LuGreParams, ParamError, Quantity, Seal, SlidingFriction,
    StaticFriction, StribeckCurve, Trocar,
};
use trocar_recording::{Recording, RecordingError};
use trocar_runtime::model_file::ModelFile;

use Quantity::{
    CoulombForce, CreepVelocity, HalfWidth, LimitForce, MicroDamping, RelaxationStiffness,
    SealDamping, StaticForce, StaticRatio, Stiffness, StribeckVelocity, ViscousDamping,
};

/// Why there are no numbers for another program.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ValuesError {
    /// Not one of [`TARGETS`].
    #[error("no program {found:?}: expected one of {}", TARGETS.join(", "))]
    Target {
        /// What was found.
        found: String,
    },
    /// The numbers make no law of friction.
    #[error(transparent)]
    Parameters(#[from] ParamError),
    /// A recording cannot be corrected for mass or delay.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// The programs by name; `json` holds the numbers for all of them.
pub const TARGETS: [&str; 7] = ["mujoco", "isaac", "urdf", "sdf", "ur", "simulink", "json"];

/// What another program can express.
#[derive(Clone, Copy, PartialEq)]
enum Law {
    /// Coulomb and viscous friction.
    Coulomb,
    /// With a static force above.
    Stribeck,
    /// With bristles that deflect before they slide.
    LuGre,
}

/// A place for the numbers in another program. Friction opposes the motion in all of them, and the
/// numbers are magnitudes in SI units of a joint that slides.
struct Place {
    target: &'static str,
    /// Where it is, and what is to be known there.
    remark: &'static str,
    law: Law,
    /// Begin and end of a comment.
    comment: [&'static str; 2],
    /// The names there; what of the model they are; and the factor from it.
    names: &'static [(&'static str, Quantity, f64)],
    /// Text with `{}` for each of the names.
    snippet: &'static str,
}

const XML: [&str; 2] = ["<!-- ", " -->"];

const URDF: Place = Place {
    target: "urdf",
    remark: "In a prismatic joint (in SDFormat in its axis). 'friction' is called static there; simulators apply it in motion, too.",
    law: Law::Coulomb,
    comment: XML,
    names: &[("damping", ViscousDamping, 1.0), ("friction", CoulombForce, 1.0)],
    snippet: r#"<dynamics damping="{}" friction="{}"/>"#,
};

const PLACES: [Place; 7] = [
    Place {
        target: "mujoco",
        remark: "MJCF, in a body:",
        law: Law::Coulomb,
        comment: XML,
        names: &[("frictionloss", CoulombForce, 1.0), ("damping", ViscousDamping, 1.0)],
        snippet: r#"<joint name="insertion" type="slide" axis="0 0 1" frictionloss="{}" damping="{}"/>"#,
    },
    Place {
        target: "mujoco",
        remark: "In place of frictionloss and damping (MuJoCo 4), under actuator: a motor without input whose friction is LuGre's.",
        law: Law::LuGre,
        comment: XML,
        names: &[
            ("lugre 1, stiffness", Stiffness, 1.0),
            ("lugre 2, damping of the bristles", MicroDamping, 1.0),
            ("lugre 3, Coulomb", CoulombForce, 1.0),
            ("lugre 4, static", StaticForce, 1.0),
            ("lugre 5, Stribeck velocity", StribeckVelocity, 1.0),
            ("damping", ViscousDamping, 1.0),
        ],
        snippet: r#"<dcmotor joint="insertion" input="none" resistance="1" lugre="{} {} {} {} {}" damping="{}"/>"#,
    },
    Place {
        target: "isaac",
        remark: "Isaac Lab with Isaac Sim 5 or later (before, friction was a coefficient), among the actuators of an ArticulationCfg: efforts in N, no drive. \
                 The static effort acts at rest, the dynamic one in motion.",
        law: Law::Stribeck,
        comment: ["# ", ""],
        names: &[
            ("friction", StaticForce, 1.0),
            ("dynamic_friction", CoulombForce, 1.0),
            ("viscous_friction", ViscousDamping, 1.0),
        ],
        snippet: "trocar = ImplicitActuatorCfg(\n    joint_names_expr=[\"insertion\"], stiffness=0.0, damping=0.0,\n    \
                  friction={}, dynamic_friction={}, viscous_friction={},\n)",
    },
    URDF,
    Place {
        target: "sdf",
        snippet: "<dynamics><damping>{}</damping><friction>{}</friction></dynamics>",
        ..URDF
    },
    Place {
        target: "ur",
        remark: "URScript. UR's viscous_scale and coulomb_scale are fractions, 0 to 1, of the friction of the arm's own joints and cannot describe a trocar. \
                 Add the force of the trocar, along the shaft, through the transposed Jacobian, to the torques of direct_torque.",
        law: Law::Coulomb,
        comment: ["# ", ""],
        names: &[("coulomb_n", CoulombForce, 1.0), ("viscous_n_s_m", ViscousDamping, 1.0)],
        snippet: "def trocar_force_n(velocity_m_s):\n  coulomb_n = {}\n  viscous_n_s_m = {}\n  if velocity_m_s > 0:\n    \
                  return viscous_n_s_m * velocity_m_s + coulomb_n\n  elif velocity_m_s < 0:\n    \
                  return viscous_n_s_m * velocity_m_s - coulomb_n\n  end\n  return 0\nend",
    },
    Place {
        target: "simulink",
        // Its Stribeck part is √(2e)·(v/v_St)·exp(-(v/v_St)²), with v_St = √2·brkwy_vel in the place of v_s.
        remark: "Simscape, block Translational Friction. It gives no force at rest, and F_c from brkwy_vel on.",
        law: Law::Stribeck,
        comment: ["% ", ""],
        names: &[
            ("brkwy_frc", StaticForce, 1.0),
            ("brkwy_vel", StribeckVelocity, FRAC_1_SQRT_2),
            ("Col_frc", CoulombForce, 1.0),
            ("visc_coef", ViscousDamping, 1.0),
        ],
        snippet: "set_param(gcb, 'brkwy_frc', '{}', 'brkwy_vel', '{}', 'Col_frc', '{}', 'visc_coef', '{}')",
    },
];

/// The numbers of `model` for `target`, and what is lost, with the error it makes on `recordings`
/// as read.
///
/// # Errors
/// [`ValuesError`].
pub fn text(
    model: &ModelFile,
    target: &str,
    recordings: Vec<Recording>,
) -> Result<String, ValuesError> {
    if !TARGETS.contains(&target) {
        return Err(ValuesError::Target { found: target.to_owned() });
    }
    let source = Source::new(model, recordings)?;
    let chosen = PLACES.iter().filter(|place| [place.target, "json"].contains(&target));
    // A model without presliding has no stiffness: its other place says all of it.
    let chosen = chosen.filter(|place| place.law != Law::LuGre || source.number(Stiffness) > 0.0);
    if target == "json" {
        let places = chosen.map(|place| source.json(place)).collect::<Result<Vec<_>, _>>()?;
        let all = json!({"model_rms_n": source.own_rms, "places": places});
        return Ok(format!("{all:#}\n"));
    }
    chosen.map(|place| source.paste(place)).collect()
}

/// A model, and the recordings on which losses are measured.
struct Source<'a> {
    model: &'a ModelFile,
    recordings: Vec<Recording>,
    offset: f64,
    /// Root mean square error of the model itself over the recordings, N.
    own_rms: Option<f64>,
}

impl<'a> Source<'a> {
    fn new(model: &'a ModelFile, recordings: Vec<Recording>) -> Result<Self, RecordingError> {
        let correction = Correction::of(model, None, None)?;
        let prepared = recordings.into_iter().map(|recording| correction.taken_out_of(recording));
        let mut source = Self {
            model,
            recordings: prepared.collect::<Result<_, _>>()?,
            offset: correction.offset_n,
            own_rms: None,
        };
        source.own_rms = source.error(&model.trocar);
        Ok(source)
    }

    fn seal(&self) -> &Seal {
        self.model.trocar.seal()
    }

    /// The sum over the elements of the model, the mean of both directions; 0 for what it has not.
    fn number(&self, quantity: Quantity) -> f64 {
        let number = match self.seal().stages() {
            Some(stages) => {
                let of = |e: &Element, q| e.params().value(None, q).unwrap_or(0.0);
                let elements = stages.elements().iter();
                match quantity {
                    // The secant of the deformation, from rest to where the instrument slides.
                    Stiffness => elements.map(|e| of(e, StaticForce) / of(e, HalfWidth)).sum(),
                    MicroDamping => elements.map(|e| of(e, SealDamping)).sum(),
                    StribeckVelocity => of(stages.first(), StribeckVelocity),
                    _ => elements.map(|e| of(e, quantity)).sum(),
                }
            }
            None => self.classical(quantity),
        };
        number + 0.0 // The sum of nothing is -0.
    }

    fn classical(&self, quantity: Quantity) -> f64 {
        let all = self.seal().tunables().filter(|one| one.id.quantity == quantity);
        let sum: f64 = all.map(|one| one.value).sum();
        match quantity {
            CoulombForce => sum + self.classical(LimitForce),
            // The ratio is at hand: the product without the rounding of both.
            StaticForce => {
                rounded(self.classical(CoulombForce) * self.classical(StaticRatio).max(1.0), 12)
            }
            StribeckVelocity if sum == 0.0 => SlidingFriction::coulomb(1.0, 0.0).stribeck_velocity,
            _ => sum,
        }
    }

    /// The model as `law` has it.
    fn reduced(&self, law: Law) -> Result<Classical, ParamError> {
        let plain =
            SlidingFriction::coulomb(self.number(CoulombForce), self.number(ViscousDamping));
        let stribeck = SlidingFriction {
            static_force: self.number(StaticForce),
            stribeck_velocity: self.number(StribeckVelocity),
            ..plain
        };
        Ok(match law {
            Law::Coulomb => Classical::Static(StaticFriction::new(plain)?),
            Law::Stribeck => Classical::Static(StaticFriction::new(stribeck)?),
            Law::LuGre => Classical::LuGre(LuGre::new(LuGreParams {
                stiffness: self.number(Stiffness),
                micro_damping: self.number(MicroDamping),
                damping_velocity: f64::INFINITY,
                sliding: stribeck,
                curve: StribeckCurve::Exponential,
            })?),
        })
    }

    fn paste(&self, place: &Place) -> Result<String, ValuesError> {
        let mut parts = place.snippet.split("{}");
        let mut text = parts.next().unwrap_or_default().to_owned();
        for ((_, quantity, factor), part) in place.names.iter().zip(parts) {
            text += &format!("{}{part}", rounded(factor * self.number(*quantity), 6));
        }
        let ([begin, end], remark) = (place.comment, place.remark);
        Ok(format!("{begin}{remark}{end}\n{begin}{}{end}\n{text}\n", self.lost_in_words(place)?))
    }

    fn json(&self, place: &Place) -> Result<Value, ValuesError> {
        let names = place.names.iter().map(|(name, quantity, factor)| {
            let (id, value) = (quantity.id(), factor * self.number(*quantity));
            json!({"name": name, "value": value, "unit": id.unit().si, "from": id.to_string()})
        });
        Ok(json!({
            "program": place.target,
            "remark": place.remark,
            "values": names.collect::<Vec<_>>(),
            "lost": self.lost(place.law),
            "rms_n": self.error(&Trocar::of_seal(self.reduced(place.law)?)),
        }))
    }

    /// Root mean square error over the recordings, N.
    fn error<K: AsRef<[f64]> + Sync>(&self, trocar: &Trocar<K>) -> Option<f64> {
        let known = !self.recordings.is_empty();
        known.then(|| validate(trocar, &self.recordings, self.offset).rms_n)
    }

    /// What the model has and `law` has not.
    fn lost(&self, law: Law) -> Vec<String> {
        let (is_ems, stiffness) = (self.seal().stages().is_some(), self.number(Stiffness));
        let directions = Direction::BOTH.map(|direction| {
            let elements = self.seal().stages().into_iter().flat_map(|stages| stages.elements());
            elements.map(|e| e.params().sliding(direction).coulomb_force).sum::<f64>()
        });
        let [insertion, withdrawal] = directions.map(|force| rounded(force, 3));
        let reduced = self.reduced(law).map(Seal::from);
        let is_bent = law != Law::Coulomb
            && reduced.is_ok_and(|seal| seal.kind() == self.seal().kind() && seal != *self.seal());
        let width = rounded(1e3 * self.seal().half_width(), 3);
        let all = [
            (is_ems && law == Law::LuGre, "the snap-through of the seal".to_owned()),
            (
                is_ems && law != Law::LuGre,
                format!("the deformation over ±{width} mm with its snap-through"),
            ),
            (!is_ems && law != Law::LuGre && stiffness > 0.0, "presliding".to_owned()),
            (
                !is_ems && law == Law::LuGre && self.seal().kind() != "lugre",
                "the shape of presliding".to_owned(),
            ),
            (
                directions[0] != directions[1],
                format!(
                    "the direction (F_c is {insertion} N on insertion, {withdrawal} N on withdrawal)"
                ),
            ),
            (
                law == Law::Coulomb && self.number(StaticForce) > self.number(CoulombForce),
                "static friction".to_owned(),
            ),
            (is_bent, "the shape of its curves".to_owned()),
            (
                self.number(CreepVelocity) + self.number(RelaxationStiffness) > 0.0,
                "creep and relaxation".to_owned(),
            ),
            (self.number(Quantity::DwellForce) > 0.0, "friction after rest".to_owned()),
            (self.model.trocar.profile().is_some(), "the dependence on position".to_owned()),
            (self.model.trocar.rotation().is_some(), "the resistance to rotation".to_owned()),
        ];
        all.into_iter().filter(|(is_lost, _)| *is_lost).map(|(_, words)| words).collect()
    }

    fn lost_in_words(&self, place: &Place) -> Result<String, ValuesError> {
        let lost = self.lost(place.law);
        if lost.is_empty() {
            return Ok("Nothing is lost.".to_owned());
        }
        let reduced = self.error(&Trocar::of_seal(self.reduced(place.law)?));
        let size = match reduced.zip(self.own_rms) {
            Some((reduced, own)) => {
                let names: Vec<&str> = self.recordings.iter().map(|r| r.name.as_str()).collect();
                let [reduced, own] = [reduced, own].map(|rms| rounded(rms, 3));
                format!("{reduced} N rms on {}, against {own} N of the model", names.join(", "))
            }
            None => "how much is unknown without a recording to validate on".to_owned(),
        };
        Ok(format!("Lost: {}; {size}.", lost.join(", ")))
    }
}

/// With so many significant digits.
fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}
