//! What the steps know beforehand, for whoever writes a model out in another language.
//!
//! A step in plain arithmetic that starts from these numbers and works in the same order gives the
//! same bits. They follow from the parameters and hold for this version of the crate: not a form to
//! store a model in, which is [`crate::flat`].

use crate::elastic::{COUNT, Span};
use crate::ems::{Contact, Element, VelocityWeakening};

/// M and h over one span between neighbouring joins, as power series of t = (z -
/// `mid`)·`inverse_half` in [-1, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpanConstants {
    /// Middle of the span, m.
    pub mid: f64,
    /// Inverse of half its width, 1/m; 0 for an empty span.
    pub inverse_half: f64,
    /// [M, h], N, lowest degree first.
    pub force: [[f64; 2]; COUNT],
    /// [dM/dz, dh/dz], N/m.
    pub slope: [[f64; 2]; COUNT],
}

/// What is known of sliding to one side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactConstants {
    /// The sliding force falls with speed somewhere ([`VelocityWeakening`]), so one force may
    /// belong to several slip speeds.
    pub velocity_weakening: bool,
    /// β + min dD/dż, N·s/m.
    pub damping: f64,
    /// max|g'|, N·s/m; may be infinite.
    pub steepest_fall: f64,
    /// Neither β nor σ.
    pub free: bool,
    /// |F_e| at the end of the deformation range, N.
    pub end_force: f64,
    /// Slope of F_e beyond, N/m.
    pub end_stiffness: f64,
    /// K/β on that end, 1/s; infinite without β.
    pub rate: f64,
    /// β/K, s; 0 where `rate` is infinite.
    pub lag: f64,
}

/// What the step of an [`Element`] knows beside its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementConstants {
    /// Sliding happens on the straight ends only: the exact step is taken.
    pub confined: bool,
    /// Smallest dF_e/dz, N/m.
    pub least_stiffness: f64,
    /// The two inner joins, m, ascending.
    pub joins: [f64; 2],
    /// Below, between and above the joins.
    pub spans: [SpanConstants; 3],
    /// M at -c and +c, N.
    pub end_force: [f64; 2],
    /// dM/dz beyond -c and +c, N/m.
    pub end_stiffness: [f64; 2],
    /// Sliding for v_sl < 0 and for v_sl > 0.
    pub contacts: [ContactConstants; 2],
}

impl From<&Span> for SpanConstants {
    fn from(span: &Span) -> Self {
        let Span { mid, inverse_half, force, slope } = *span;
        Self { mid, inverse_half, force, slope }
    }
}

impl From<&Contact> for ContactConstants {
    fn from(contact: &Contact) -> Self {
        Self {
            velocity_weakening: contact.weakening != VelocityWeakening::None,
            damping: contact.damping,
            steepest_fall: contact.steepest_fall,
            free: contact.free,
            end_force: contact.end_force,
            end_stiffness: contact.end_stiffness,
            rate: contact.rate,
            lag: contact.lag,
        }
    }
}

impl Element {
    /// What the step knows beside the parameters.
    pub fn constants(&self) -> ElementConstants {
        let deformation = &self.params.deformation;
        let [below, between, above] = &deformation.spans;
        ElementConstants {
            confined: self.confined,
            least_stiffness: self.least_stiffness,
            joins: deformation.joins,
            spans: [below.into(), between.into(), above.into()],
            end_force: deformation.end_force,
            end_stiffness: deformation.end_stiffness,
            contacts: [(&self.withdrawal).into(), (&self.insertion).into()],
        }
    }
}
