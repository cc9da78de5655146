//! The key `friction` of a model file: one classical model, beginning with its kind.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};
use trocar_model::{
    Classical, Dahl, DahlParams, Gms, GmsElement, Leuven, LeuvenParams, LuGre, LuGreParams, MaxwellSlip, ParamError,
    SlipElement, SlipRate, StaticFriction, StribeckCurve,
};

use super::SlidingText;

/// A classical model in the form used in files.
pub(super) trait FrictionText: Serialize + DeserializeOwned {
    /// The model.
    fn model(&self) -> Result<Classical, ParamError>;
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StaticText {
    kind: String,
    sliding: SlidingText,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DahlText {
    kind: String,
    stiffness_n_m: f64,
    coulomb_force_n: f64,
    exponent: f64,
    viscous_damping_n_s_m: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LuGreText {
    kind: String,
    stiffness_n_m: f64,
    micro_damping_n_s_m: f64,
    /// `null` for constant damping, since JSON has no infinity.
    #[serde(deserialize_with = "number_or_null")]
    damping_velocity_m_s: Option<f64>,
    #[serde(with = "CurveText")]
    curve: StribeckCurve,
    sliding: SlidingText,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LeuvenText {
    kind: String,
    micro_damping_n_s_m: f64,
    exponent: f64,
    sliding: SlidingText,
    elements: Vec<SlipElementText>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaxwellSlipText {
    kind: String,
    viscous_damping_n_s_m: f64,
    elements: Vec<SlipElementText>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GmsText {
    kind: String,
    #[serde(with = "SlipRateText")]
    slip_rate: SlipRate,
    sliding: SlidingText,
    elements: Vec<GmsElementText>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "StribeckCurve", rename_all = "lowercase")]
enum CurveText {
    Exponential,
    Rational,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "SlipRate", rename_all = "lowercase")]
enum SlipRateText {
    Free,
    Limited,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SlipElementText {
    stiffness_n_m: f64,
    limit_force_n: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GmsElementText {
    stiffness_n_m: f64,
    share: f64,
    attraction_m_s: f64,
    damping_n_s_m: f64,
}

/// An optional value whose key is required.
fn number_or_null<'de, D: Deserializer<'de>>(value: D) -> Result<Option<f64>, D::Error> {
    Option::deserialize(value)
}

impl From<&StaticFriction> for StaticText {
    fn from(model: &StaticFriction) -> Self {
        Self { kind: Classical::STATIC.to_owned(), sliding: SlidingText::from(model.params()) }
    }
}

impl FrictionText for StaticText {
    fn model(&self) -> Result<Classical, ParamError> {
        StaticFriction::new(self.sliding.friction()).map(Classical::Static)
    }
}

impl From<&Dahl> for DahlText {
    fn from(model: &Dahl) -> Self {
        let params = model.params();
        Self {
            kind: Classical::DAHL.to_owned(),
            stiffness_n_m: params.stiffness,
            coulomb_force_n: params.coulomb_force,
            exponent: params.exponent,
            viscous_damping_n_s_m: params.viscous_damping,
        }
    }
}

impl FrictionText for DahlText {
    fn model(&self) -> Result<Classical, ParamError> {
        let params = DahlParams {
            stiffness: self.stiffness_n_m,
            coulomb_force: self.coulomb_force_n,
            exponent: self.exponent,
            viscous_damping: self.viscous_damping_n_s_m,
        };
        Dahl::new(params).map(Classical::Dahl)
    }
}

impl From<&LuGre> for LuGreText {
    fn from(model: &LuGre) -> Self {
        let params = model.params();
        Self {
            kind: Classical::LUGRE.to_owned(),
            stiffness_n_m: params.stiffness,
            micro_damping_n_s_m: params.micro_damping,
            damping_velocity_m_s: Some(params.damping_velocity).filter(|velocity| velocity.is_finite()),
            curve: params.curve,
            sliding: SlidingText::from(&params.sliding),
        }
    }
}

impl FrictionText for LuGreText {
    fn model(&self) -> Result<Classical, ParamError> {
        let params = LuGreParams {
            stiffness: self.stiffness_n_m,
            micro_damping: self.micro_damping_n_s_m,
            damping_velocity: self.damping_velocity_m_s.unwrap_or(f64::INFINITY),
            sliding: self.sliding.friction(),
            curve: self.curve,
        };
        LuGre::new(params).map(Classical::LuGre)
    }
}

impl From<&Leuven> for LeuvenText {
    fn from(model: &Leuven) -> Self {
        let params = model.params();
        Self {
            kind: Classical::LEUVEN.to_owned(),
            micro_damping_n_s_m: params.micro_damping,
            exponent: params.exponent,
            sliding: SlidingText::from(&params.sliding),
            elements: model.elements().iter().map(SlipElementText::from).collect(),
        }
    }
}

impl FrictionText for LeuvenText {
    fn model(&self) -> Result<Classical, ParamError> {
        let params = LeuvenParams {
            sliding: self.sliding.friction(),
            exponent: self.exponent,
            micro_damping: self.micro_damping_n_s_m,
        };
        Leuven::new(&bank(&self.elements), params).map(Classical::Leuven)
    }
}

impl From<&MaxwellSlip> for MaxwellSlipText {
    fn from(model: &MaxwellSlip) -> Self {
        Self {
            kind: Classical::MAXWELL_SLIP.to_owned(),
            viscous_damping_n_s_m: model.viscous_damping(),
            elements: model.elements().iter().map(SlipElementText::from).collect(),
        }
    }
}

impl FrictionText for MaxwellSlipText {
    fn model(&self) -> Result<Classical, ParamError> {
        MaxwellSlip::new(&bank(&self.elements), self.viscous_damping_n_s_m).map(Classical::MaxwellSlip)
    }
}

impl From<&SlipElement> for SlipElementText {
    fn from(element: &SlipElement) -> Self {
        Self { stiffness_n_m: element.stiffness, limit_force_n: element.limit_force }
    }
}

fn bank(elements: &[SlipElementText]) -> Vec<SlipElement> {
    let element =
        |text: &SlipElementText| SlipElement { stiffness: text.stiffness_n_m, limit_force: text.limit_force_n };
    elements.iter().map(element).collect()
}

impl From<&Gms> for GmsText {
    fn from(model: &Gms) -> Self {
        let element = |element: &GmsElement| GmsElementText {
            stiffness_n_m: element.stiffness,
            share: element.share,
            attraction_m_s: element.attraction,
            damping_n_s_m: element.damping,
        };
        Self {
            kind: Classical::GMS.to_owned(),
            slip_rate: model.slip_rate(),
            sliding: SlidingText::from(model.sliding()),
            elements: model.elements().iter().map(element).collect(),
        }
    }
}

impl FrictionText for GmsText {
    fn model(&self) -> Result<Classical, ParamError> {
        let element = |text: &GmsElementText| GmsElement {
            stiffness: text.stiffness_n_m,
            share: text.share,
            attraction: text.attraction_m_s,
            damping: text.damping_n_s_m,
        };
        let elements: Vec<GmsElement> = self.elements.iter().map(element).collect();
        Gms::new(&elements, self.sliding.friction(), self.slip_rate).map(Classical::Gms)
    }
}
