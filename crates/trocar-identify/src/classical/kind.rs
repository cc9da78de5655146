//! Classical friction models: which there are, what is free in each, how it is built from that, and
//! where its fit starts.

use std::fmt;

use trocar_model::{
    BoucWen, BoucWenParams, Classical, Dahl, DahlParams, LuGre, LuGreParams, ParamError,
    Quantity as Q, SlidingFriction, StaticFriction, StribeckCurve,
};

use super::banks::{GMS, LEUVEN, MAXWELL_SLIP};
use super::coordinate::{Bank, Coordinate, Scales};
use super::data::ClassicalData;
use super::family::{Family, Related, stribeck};

macro_rules! kinds {
    (
        fixed { $($(#[$doc:meta])* $fixed:ident = $of_fixed:ident;)* }
        banks { $($(#[$bank_doc:meta])* $bank:ident = $of_bank:ident;)* }
    ) => {
        /// A classical friction model, with its number of elements where that is variable.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Kind {
            $($(#[$doc])* $fixed,)*
            $($(#[$bank_doc])* $bank(usize),)*
        }

        impl Kind {
            /// One of each family, in the order of tables, with the number of elements that is
            /// compared unless another is asked for; where that is a range, its end.
            pub const FAMILIES: &[Self] =
                &[$(Self::$fixed,)* $(Self::$bank($of_bank.elements[1]),)*];

            /// Whether the number of elements can be chosen.
            pub fn is_bank(self) -> bool {
                matches!(self, $(Self::$bank(_))|*)
            }

            /// Number of elements; 1 for models with a fixed structure.
            pub fn elements(self) -> usize {
                match self {
                    $(Self::$bank(count))|* => count,
                    _ => 1,
                }
            }

            /// The same family with `count` elements; unchanged for models with a fixed structure.
            pub fn with_elements(self, count: usize) -> Self {
                match self {
                    $(Self::$bank(_) => Self::$bank(count),)*
                    fixed => fixed,
                }
            }

            const fn declared(self) -> &'static Family {
                match self {
                    $(Self::$fixed => &$of_fixed,)*
                    $(Self::$bank(_) => &$of_bank,)*
                }
            }
        }
    };
}

kinds! {
    fixed {
        /// F_c·sgn v.
        Coulomb = COULOMB;
        /// Coulomb and viscous, EMS (23).
        CoulombViscous = COULOMB_VISCOUS;
        /// Stribeck with shape exponent, EMS (11).
        Stribeck = STRIBECK;
        /// Dahl with exponent, and a viscous part.
        Dahl = DAHL;
        /// Bouc–Wen, and a viscous part.
        BoucWen = BOUC_WEN;
        /// LuGre with the exponential Stribeck curve of EMS (6).
        LuGre = LUGRE;
        /// LuGre with the rational Stribeck curve.
        LuGreRational = LUGRE_RATIONAL;
    }
    banks {
        /// Modified Leuven with this many hysteresis elements.
        Leuven = LEUVEN;
        /// Maxwell-Slip with this many elements, EMS (1)-(4).
        MaxwellSlip = MAXWELL_SLIP;
        /// Generalized Maxwell-Slip with this many elements, EMS (5)-(7).
        Gms = GMS;
    }
}

impl Kind {
    /// All that are compared unless others are asked for.
    pub fn compared() -> impl Iterator<Item = Self> {
        Self::FAMILIES.iter().flat_map(|family| {
            let [least, most] = family.declared().elements;
            (least..=most).map(|count| family.with_elements(count))
        })
    }

    /// Title of the panel in which a figure shows the family.
    pub fn panel(self) -> &'static str {
        self.declared().panel
    }

    /// Name of the family, without the number of elements.
    pub fn family(self) -> &'static str {
        self.declared().name
    }

    /// Name of the family in texts.
    pub fn title(self) -> &'static str {
        self.declared().title
    }

    /// The same family with one element less.
    pub fn smaller(self) -> Option<Self> {
        (self.elements() > 1).then(|| self.with_elements(self.elements() - 1))
    }

    /// The model of another family that results with other numbers of elements or some parameters zero.
    pub fn special(self) -> Option<Self> {
        match self {
            Self::Gms(n) => Some(Self::MaxwellSlip(n)),
            Self::Leuven(_) => Some(Self::LuGre),
            _ => None,
        }
    }

    /// Number of free parameters, without the sensor offset.
    pub fn parameters(self) -> usize {
        self.free(&Scales::NONE).len()
    }

    /// The free parameters, without the sensor offset.
    fn free(self, scales: &Scales) -> Vec<Coordinate> {
        (self.declared().free)(scales, self.elements())
    }

    /// The model with the parameters `p`, which start after the sensor offset.
    pub(super) fn build(self, p: &[f64]) -> Result<Classical, ParamError> {
        (self.declared().build)(self.elements(), p)
    }

    pub(super) fn bank(self) -> Option<Bank> {
        self.declared().bank
    }

    /// The free parameters, the sensor offset first.
    pub(super) fn coordinates(self, scales: &Scales) -> Vec<Coordinate> {
        std::iter::once(scales.offset()).chain(self.free(scales)).collect()
    }

    /// Several starts derived from the data, each with the sensor offset first.
    pub(super) fn starts(self, data: &ClassicalData, kin: Related) -> Vec<Vec<f64>> {
        let after_offset = (self.declared().starts)(self.elements(), data, kin);
        after_offset.into_iter().map(|p| [vec![data.scales.offset], p].concat()).collect()
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.family())?;
        if self.is_bank() { write!(f, ":{}", self.elements()) } else { Ok(()) }
    }
}

const COULOMB: Family = Family {
    name: "coulomb",
    title: "Coulomb",
    panel: "Static",
    elements: [1, 1],
    free: |scales, _| vec![scales.coulomb()],
    build: |_, p| Ok(Classical::Static(StaticFriction::new(SlidingFriction::coulomb(p[0], 0.0))?)),
    starts: |_, data, _| vec![vec![data.scales.force]],
    bank: None,
};

const COULOMB_VISCOUS: Family = Family {
    name: "coulomb-viscous",
    title: "Coulomb and viscous",
    free: |scales, _| vec![scales.coulomb(), scales.damping(Q::ViscousDamping)],
    build: |_, p| Ok(Classical::Static(StaticFriction::new(SlidingFriction::coulomb(p[0], p[1]))?)),
    starts: |_, data, _| vec![vec![data.scales.force, data.scales.viscous]],
    ..COULOMB
};

const STRIBECK: Family = Family {
    name: "stribeck",
    title: "Stribeck",
    free: |scales, _| {
        vec![
            scales.coulomb(),
            scales.rise(),
            scales.stribeck_velocity(),
            Coordinate::log(Q::StribeckExponent, [0.2, 8.0]),
            scales.damping(Q::ViscousDamping),
        ]
    },
    build: |_, p| {
        let sliding = stribeck([p[0], p[1], p[2], p[3], p[4]]);
        Ok(Classical::Static(StaticFriction::new(sliding)?))
    },
    starts: |_, data, _| {
        let Scales { force, viscous, speeds: [slowest, fastest], .. } = data.scales;
        [0.3 * slowest, slowest, data.scales.middle_speed(), 0.7 * fastest]
            .map(|velocity| vec![force, 0.2 * force, velocity, 2.0, viscous])
            .to_vec()
    },
    ..COULOMB
};

const DAHL: Family = Family {
    name: "dahl",
    title: "Dahl",
    panel: "Dahl and LuGre",
    elements: [1, 1],
    free: |scales, _| {
        vec![
            scales.stiffness(Q::Stiffness),
            scales.coulomb(),
            Coordinate::log(Q::Exponent, [0.05, 8.0]),
            scales.damping(Q::ViscousDamping),
        ]
    },
    build: |_, p| {
        Ok(Classical::Dahl(Dahl::new(DahlParams {
            stiffness: p[0],
            coulomb_force: p[1],
            exponent: p[2],
            viscous_damping: p[3],
        })?))
    },
    starts: |_, data, _| {
        let Scales { force, viscous, .. } = data.scales;
        data.scales.stiffnesses().map(|k| vec![k, force, 1.0, viscous]).to_vec()
    },
    bank: None,
};

const BOUC_WEN: Family = Family {
    name: "bouc-wen",
    title: "Bouc–Wen",
    free: |scales, _| {
        vec![
            scales.stiffness(Q::Stiffness),
            scales.coulomb(),
            Coordinate::log(Q::Exponent, [0.2, 20.0]),
            Coordinate::linear(Q::UnloadingShape, [0.5, 10.0], 1e-3),
            scales.damping(Q::ViscousDamping),
        ]
    },
    build: |_, p| {
        Ok(Classical::BoucWen(BoucWen::new(BoucWenParams {
            stiffness: p[0],
            coulomb_force: p[1],
            exponent: p[2],
            unloading_shape: p[3],
            viscous_damping: p[4],
        })?))
    },
    starts: |_, data, _| {
        let Scales { force, viscous, .. } = data.scales;
        let shapes = [[1.0, 1.0], [2.0, 0.7]];
        data.scales
            .stiffnesses()
            .into_iter()
            .flat_map(|k| shapes.map(|[n, shape]| vec![k, force, n, shape, viscous]))
            .collect()
    },
    ..DAHL
};

const LUGRE: Family = Family {
    name: "lugre",
    title: "LuGre",
    free: |scales, _| {
        vec![
            scales.stiffness(Q::Stiffness),
            scales.damping(Q::MicroDamping),
            scales.coulomb(),
            scales.rise(),
            scales.stribeck_velocity(),
            scales.damping(Q::ViscousDamping),
        ]
    },
    build: |_, p| lugre(p, StribeckCurve::Exponential),
    starts: |_, data, _| {
        let Scales { force, viscous, speeds: [slowest, _], .. } = data.scales;
        let middle = data.scales.middle_speed();
        let mut all = Vec::new();
        for stiffness in data.scales.stiffnesses() {
            for rise in [0.05 * force, 0.3 * force] {
                for velocity in [slowest, middle] {
                    let coulomb = force - 0.5 * rise;
                    all.push(vec![stiffness, 0.1 * viscous, coulomb, rise, velocity, viscous]);
                }
            }
        }
        all
    },
    ..DAHL
};

const LUGRE_RATIONAL: Family = Family {
    name: "lugre-rational",
    title: "LuGre, rational",
    build: |_, p| lugre(p, StribeckCurve::Rational),
    ..LUGRE
};

fn lugre(p: &[f64], curve: StribeckCurve) -> Result<Classical, ParamError> {
    Ok(Classical::LuGre(LuGre::new(LuGreParams {
        stiffness: p[0],
        micro_damping: p[1],
        damping_velocity: f64::INFINITY,
        sliding: stribeck([p[2], p[3], p[4], 2.0, p[5]]),
        curve,
    })?))
}
