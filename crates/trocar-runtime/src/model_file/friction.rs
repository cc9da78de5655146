//! The key `friction` of a model file: one classical model, beginning with its kind.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use trocar_model::{
    Classical, Dahl, DahlParams, Gms, GmsElement, Leuven, LeuvenParams, LuGre, LuGreParams,
    MaxwellSlip, ParamError, SlidingFriction, SlipElement, SlipRate, StaticFriction, StribeckCurve,
};

use super::object::{Object, found, members};

/// A classical model in the form used in files.
pub(super) trait FrictionText: Serialize + DeserializeOwned {
    /// The model.
    fn model(self) -> Result<Classical, ParamError>;
}

members!(StaticMembers { kind: String, sliding: Object<SlidingFriction> });
members!(DahlMembers { kind: String });
members!(LuGreMembers { kind: String, curve: Curve, sliding: Object<SlidingFriction> });
members!(LeuvenMembers { kind: String, sliding: Object<SlidingFriction>, elements: Vec<Object<SlipElement>> });
members!(MaxwellSlipMembers { kind: String, viscous_damping_n_s_m: f64, elements: Vec<Object<SlipElement>> });
members!(GmsMembers {
    kind: String,
    slip_rate: Rate,
    sliding: Object<SlidingFriction>,
    elements: Vec<Object<GmsElement>>,
});

pub(super) type StaticText = Object<(), StaticMembers>;
pub(super) type DahlText = Object<DahlParams, DahlMembers>;
pub(super) type LuGreText = Object<LuGreParams, LuGreMembers>;
pub(super) type LeuvenText = Object<LeuvenParams, LeuvenMembers>;
pub(super) type MaxwellSlipText = Object<(), MaxwellSlipMembers>;
pub(super) type GmsText = Object<(), GmsMembers>;

#[derive(Serialize, Deserialize)]
pub(super) struct Curve(#[serde(with = "CurveText")] StribeckCurve);

#[derive(Serialize, Deserialize)]
#[serde(remote = "StribeckCurve", rename_all = "lowercase")]
enum CurveText {
    Exponential,
    Rational,
}

#[derive(Serialize, Deserialize)]
pub(super) struct Rate(#[serde(with = "RateText")] SlipRate);

#[derive(Serialize, Deserialize)]
#[serde(remote = "SlipRate", rename_all = "lowercase")]
enum RateText {
    Free,
    Limited,
}

fn kind(kind: &str) -> Option<String> {
    Some(kind.to_owned())
}

fn sliding(sliding: &SlidingFriction) -> Option<Object<SlidingFriction>> {
    Some(Object::from(sliding))
}

impl From<&StaticFriction> for StaticText {
    fn from(model: &StaticFriction) -> Self {
        Self::new(
            &(),
            StaticMembers { kind: kind(Classical::STATIC), sliding: sliding(model.params()) },
        )
    }
}

impl FrictionText for StaticText {
    fn model(self) -> Result<Classical, ParamError> {
        StaticFriction::new(found(self.members.sliding).params()).map(Classical::Static)
    }
}

impl From<&Dahl> for DahlText {
    fn from(model: &Dahl) -> Self {
        Self::new(model.params(), DahlMembers { kind: kind(Classical::DAHL) })
    }
}

impl FrictionText for DahlText {
    fn model(self) -> Result<Classical, ParamError> {
        Dahl::new(self.params()).map(Classical::Dahl)
    }
}

impl From<&LuGre> for LuGreText {
    fn from(model: &LuGre) -> Self {
        let params = model.params();
        let (kind, sliding) = (kind(Classical::LUGRE), sliding(&params.sliding));
        Self::new(params, LuGreMembers { kind, curve: Some(Curve(params.curve)), sliding })
    }
}

impl FrictionText for LuGreText {
    fn model(self) -> Result<Classical, ParamError> {
        let numbers = self.params();
        let (sliding, curve) = (found(self.members.sliding).params(), found(self.members.curve).0);
        LuGre::new(LuGreParams { sliding, curve, ..numbers }).map(Classical::LuGre)
    }
}

impl From<&Leuven> for LeuvenText {
    fn from(model: &Leuven) -> Self {
        let elements = Some(model.elements().iter().map(Object::from).collect());
        let (kind, sliding) = (kind(Classical::LEUVEN), sliding(&model.params().sliding));
        Self::new(model.params(), LeuvenMembers { kind, sliding, elements })
    }
}

impl FrictionText for LeuvenText {
    fn model(self) -> Result<Classical, ParamError> {
        let numbers = self.params();
        let bank: Vec<SlipElement> =
            found(self.members.elements).iter().map(Object::params).collect();
        let params = LeuvenParams { sliding: found(self.members.sliding).params(), ..numbers };
        Leuven::new(&bank, params).map(Classical::Leuven)
    }
}

impl From<&MaxwellSlip> for MaxwellSlipText {
    fn from(model: &MaxwellSlip) -> Self {
        let elements = Some(model.elements().iter().map(Object::from).collect());
        let (kind, viscous_damping_n_s_m) =
            (kind(Classical::MAXWELL_SLIP), Some(model.viscous_damping()));
        Self::new(&(), MaxwellSlipMembers { kind, viscous_damping_n_s_m, elements })
    }
}

impl FrictionText for MaxwellSlipText {
    fn model(self) -> Result<Classical, ParamError> {
        let bank: Vec<SlipElement> =
            found(self.members.elements).iter().map(Object::params).collect();
        MaxwellSlip::new(&bank, found(self.members.viscous_damping_n_s_m))
            .map(Classical::MaxwellSlip)
    }
}

impl From<&Gms> for GmsText {
    fn from(model: &Gms) -> Self {
        let elements = Some(model.elements().iter().map(Object::from).collect());
        let (kind, sliding) = (kind(Classical::GMS), sliding(model.sliding()));
        Self::new(
            &(),
            GmsMembers { kind, slip_rate: Some(Rate(model.slip_rate())), sliding, elements },
        )
    }
}

impl FrictionText for GmsText {
    fn model(self) -> Result<Classical, ParamError> {
        let bank: Vec<GmsElement> =
            found(self.members.elements).iter().map(Object::params).collect();
        let (sliding, rate) =
            (found(self.members.sliding).params(), found(self.members.slip_rate).0);
        Gms::new(&bank, sliding, rate).map(Classical::Gms)
    }
}
