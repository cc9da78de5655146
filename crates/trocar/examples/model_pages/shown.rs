//! The models and their made-up parameters.

use std::error::Error;

use trocar::report::Role;
use trocar_model::{
    BoucWen, BoucWenParams, Classical, Dahl, DahlParams, DeformationForce, Element, ElementParams,
    Gms, GmsElement, Leuven, LeuvenParams, LuGre, LuGreParams, MaxwellSlip, ParameterId, Quantity,
    Relaxation, RelaxationArm, Seal, SealDamping, SlidingFriction, SlipElement, SlipRate, Stages,
    StaticFriction, StribeckCurve, Trocar,
};

use super::paper_literal::PaperLiteral;

/// Stiffness of the bristles of Dahl and LuGre, N/m: at it the force changes within the deformation of the seal.
const STIFFNESS: f64 = 700.0;
/// Travel from one sliding force to the other in the banks of springs, m: that of the seal.
const TRAVEL: f64 = 0.016;

/// What a page shows.
pub(crate) struct Shown {
    /// Its file, without extension.
    pub(crate) id: &'static str,
    pub(crate) title: &'static str,
    pub(crate) caption: &'static str,
    /// The seal of the other pages stands behind the lines.
    pub(crate) beside_seal: bool,
    /// What stands left of loop and reversal.
    pub(crate) first: First,
    pub(crate) lines: Vec<Line>,
}

/// A panel of its own.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum First {
    None,
    /// Sliding force over speed.
    Curve,
    /// Force over the deflection of the seal.
    Branches,
}

pub(crate) struct Line {
    pub(crate) name: &'static str,
    pub(crate) role: Role,
    pub(crate) law: Law,
}

/// What makes the force.
pub(crate) enum Law {
    Trocar(Box<Trocar>),
    Literal(Box<PaperLiteral>),
}

impl Line {
    fn new(name: &'static str, role: Role, seal: impl Into<Seal>) -> Self {
        Self { name, role, law: Law::Trocar(Box::new(Trocar::of_seal(seal))) }
    }
}

impl Shown {
    /// The model of its last line, which a reader can move.
    pub(crate) fn live(&self) -> Option<&Trocar> {
        match &self.lines.last()?.law {
            Law::Trocar(trocar) => Some(trocar),
            Law::Literal(_) => None,
        }
    }
}

type Outcome<T> = Result<T, Box<dyn Error>>;

/// The seal that all pages compare with.
pub(crate) fn seal() -> Outcome<Element> {
    Ok(Element::new(ElementParams::plausible_10_5_mm()?)?)
}

/// F_c = 3 N and β = 5 N s/m, as the seal has; with or without a rise towards rest.
fn sliding(static_force: f64, viscous_damping: f64) -> SlidingFriction {
    let shape = SlidingFriction::coulomb(3.0, viscous_damping);
    SlidingFriction { static_force, stribeck_velocity: 0.02, stribeck_exponent: 2.0, ..shape }
}

pub(crate) fn all() -> Outcome<Vec<Shown>> {
    let mut all = of_seal()?;
    all.extend(classical()?);
    all.push(literal()?);
    Ok(all)
}

const EMS: Role = Role::Friction("ems", 0);

fn of_seal() -> Outcome<Vec<Shown>> {
    let params = ElementParams::plausible_10_5_mm()?;
    let statics = |variant, name, friction| -> Outcome<Line> {
        let model = Classical::Static(StaticFriction::new(friction)?);
        Ok(Line::new(name, Role::Friction("static", variant), model))
    };
    let damped =
        ElementParams { damping: SealDamping { coefficients: [15.0, 0.0, 0.0] }, ..params };
    let arms =
        [RelaxationArm { stiffness: 60.0, time: 0.2 }, RelaxationArm { stiffness: 0.0, time: 1.0 }];
    let slow = ElementParams { creep_velocity: 5e-4, relaxation: Relaxation { arms }, ..params };
    let [first, second] = [[0.010, 2.0], [0.003, 1.0]].map(|[half_width, force]| {
        tuned(params, &[(Quantity::HalfWidth, half_width), (Quantity::CoulombForce, force)])
    });
    let stages = Stages::new(&[first?, second?]).ok_or("two elements")?;
    Ok(vec![
        Shown {
            id: "ems",
            title: "The Extended Maxwell-Slip element",
            caption: "The seal deforms for 16 mm after a full reversal, with a plateau where it snaps through, and slides then. \
                      After a partial reversal the force follows a minor loop and returns to the branch.",
            beside_seal: false,
            first: First::None,
            lines: vec![Line::new("EMS element", EMS, seal()?)],
        },
        Shown {
            id: "sliding-force",
            title: "The sliding force as a model of its own",
            caption: "Coulomb, Coulomb and viscous, and Stribeck friction. The force jumps as the velocity changes sign.",
            beside_seal: true,
            first: First::Curve,
            lines: vec![
                statics(0, "Coulomb", sliding(3.0, 0.0))?,
                statics(1, "Coulomb and viscous", sliding(3.0, 5.0))?,
                statics(2, "Stribeck", sliding(3.8, 5.0))?,
            ],
        },
        Shown {
            id: "deformation-force",
            title: "The deformation force with partial reversals",
            caption: "Both branches, and the minor loops between them: the stiffer they are, the sooner the force reaches the other branch.",
            beside_seal: false,
            first: First::Branches,
            lines: vec![
                Line::new("three times κ", Role::Friction("ems", 1), stiffer(params)?),
                Line::new("κ of the seal", EMS, seal()?),
            ],
        },
        Shown {
            id: "seal-damping",
            title: "Seal damping, creep and relaxation",
            caption: "Seal damping raises the force while the seal deforms. Creep and a relaxing spring let the force fall while the \
                      instrument rests.",
            beside_seal: true,
            first: First::None,
            lines: vec![
                Line::new("σ = 15 N s/m", Role::Friction("ems", 1), Element::new(damped)?),
                Line::new("creep and relaxation", EMS, Element::new(slow)?),
            ],
        },
        Shown {
            id: "stages",
            title: "Several stages in parallel",
            caption: "Two elements, of 2 N with a half width of 10 mm and of 1 N with 3 mm: the narrow one slides while the wide one \
                      still deforms.",
            beside_seal: true,
            first: First::None,
            lines: vec![Line::new("two elements", EMS, stages)],
        },
    ])
}

/// The element with other values of some of its parameters.
fn tuned(params: ElementParams, values: &[(Quantity, f64)]) -> Outcome<Element> {
    let seal = Seal::from(Element::new(params)?);
    let of = |id: ParameterId| values.iter().find(|(quantity, _)| *quantity == id.quantity);
    let new: Vec<f64> =
        seal.tunables().map(|one| of(one.id).map_or(one.value, |(_, value)| *value)).collect();
    match seal.tuned(&new)? {
        Seal::Ems(stages) => Ok(*stages.first()),
        Seal::Classical(_) => Err("an element stays one".into()),
    }
}

/// The element with minor loops that are three times as stiff.
fn stiffer(params: ElementParams) -> Outcome<Element> {
    let own = &params.deformation;
    let stiffness = 3.0 * own.yield_stiffness();
    let deformation = DeformationForce::new(*own.insertion(), *own.withdrawal(), Some(stiffness))?;
    Ok(Element::new(ElementParams { deformation, ..params })?)
}

/// Springs that slide one after the other, evenly over the travel of the seal.
fn bank(count: u32) -> Vec<SlipElement> {
    let limit_force = 3.0 / f64::from(count);
    let stiffness = |k: u32| 2.0 * limit_force * f64::from(count) / (TRAVEL * f64::from(k));
    (1..=count).map(|k| SlipElement { stiffness: stiffness(k), limit_force }).collect()
}

fn classical() -> Outcome<Vec<Shown>> {
    let dahl = |exponent| {
        let viscous_damping = 5.0;
        Dahl::new(DahlParams {
            stiffness: STIFFNESS,
            coulomb_force: 3.0,
            exponent,
            viscous_damping,
        })
    };
    let bouc_wen = |exponent, unloading_shape| {
        BoucWen::new(BoucWenParams {
            stiffness: STIFFNESS,
            coulomb_force: 3.0,
            exponent,
            unloading_shape,
            viscous_damping: 5.0,
        })
    };
    let lugre = |static_force| {
        LuGre::new(LuGreParams {
            stiffness: STIFFNESS,
            micro_damping: 5.0,
            damping_velocity: f64::INFINITY,
            sliding: sliding(static_force, 5.0),
            curve: StribeckCurve::Exponential,
        })
    };
    let leuven = LeuvenParams { sliding: sliding(3.0, 5.0), exponent: 1.0, micro_damping: 5.0 };
    let gms = |static_force, elements: &[SlipElement]| {
        let element = |one: &SlipElement| GmsElement {
            stiffness: one.stiffness,
            share: one.limit_force / 3.0,
            attraction: 0.05,
            damping: 0.0,
        };
        let elements: Vec<GmsElement> = elements.iter().map(element).collect();
        Gms::new(&elements, sliding(static_force, 5.0), SlipRate::Limited)
    };
    let line = |name, family, variant, model: Classical| {
        Line::new(name, Role::Friction(family, variant), model)
    };
    let page = |id, title, caption, lines| Shown {
        id,
        title,
        caption,
        beside_seal: true,
        first: First::None,
        lines,
    };
    Ok(vec![
        page(
            "dahl",
            "Dahl",
            "The force approaches the Coulomb force along one curve, which bends the same way throughout: no plateau, no second rise.",
            vec![
                line("i = 2", "dahl", 1, Classical::Dahl(dahl(2.0)?)),
                line("i = 1", "dahl", 0, Classical::Dahl(dahl(1.0)?)),
            ],
        ),
        page(
            "bouc-wen",
            "Bouc–Wen",
            "Loading bends into the Coulomb force as sharply as the exponent says; unloading has a slope of its own, but no plateau.",
            vec![
                line("n = 1, σ = 1", "bouc-wen", 1, Classical::BoucWen(bouc_wen(1.0, 1.0)?)),
                line("n = 2, σ = 0.5", "bouc-wen", 0, Classical::BoucWen(bouc_wen(2.0, 0.5)?)),
            ],
        ),
        page(
            "lugre",
            "LuGre",
            "With a static force the force overshoots before it slides; the curve up to there bends one way.",
            vec![
                line("F_s = 3.8 N", "lugre", 1, Classical::LuGre(lugre(3.8)?)),
                line("F_s = F_c", "lugre", 0, Classical::LuGre(lugre(3.0)?)),
            ],
        ),
        page(
            "leuven",
            "The modified Leuven model",
            "A hysteresis function with memory instead of a straight spring: minor loops close, but no branch falls.",
            vec![
                line("one spring", "leuven", 1, Classical::Leuven(Leuven::new(&bank(1), leuven)?)),
                line(
                    "four springs",
                    "leuven",
                    0,
                    Classical::Leuven(Leuven::new(&bank(4), leuven)?),
                ),
            ],
        ),
        page(
            "maxwell-slip",
            "Maxwell-Slip",
            "Springs with dry sliders: the force is a polygon whose slope only falls after a reversal.",
            vec![
                line(
                    "1 element",
                    "maxwell-slip",
                    1,
                    Classical::MaxwellSlip(MaxwellSlip::new(&bank(1), 5.0)?),
                ),
                line(
                    "4 elements",
                    "maxwell-slip",
                    0,
                    Classical::MaxwellSlip(MaxwellSlip::new(&bank(4), 5.0)?),
                ),
            ],
        ),
        page(
            "gms",
            "Generalized Maxwell-Slip",
            "The polygon of Maxwell-Slip, with a sliding force that depends on the velocity and lags behind it.",
            vec![
                line("F_s = 3.8 N", "gms", 1, Classical::Gms(gms(3.8, &bank(4))?)),
                line("F_s = F_c", "gms", 0, Classical::Gms(gms(3.0, &bank(4))?)),
            ],
        ),
    ])
}

fn literal() -> Outcome<Shown> {
    let model = PaperLiteral::new(ElementParams::plausible_10_5_mm()?);
    let law = Law::Literal(Box::new(model));
    Ok(Shown {
        id: "paper-literal",
        title: "The paper taken literally",
        caption: "On full strokes it equals the EMS element. On a partial reversal the force jumps from one branch to the other.",
        beside_seal: true,
        first: First::None,
        lines: vec![Line { name: "taken literally", role: Role::Model, law }],
    })
}
