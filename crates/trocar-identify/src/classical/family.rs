//! What is to be known of a family of classical models.

use trocar_model::{Classical, ParamError, SlidingFriction};

use super::coordinate::{Bank, Coordinate, Scales};
use super::data::ClassicalData;

/// A family of models: names, free parameters, and where its fit starts.
pub(super) struct Family {
    /// In files and options.
    pub(super) name: &'static str,
    /// In texts.
    pub(super) title: &'static str,
    /// Title of the panel in which a figure shows it.
    pub(super) panel: &'static str,
    /// Least and largest number of elements that are compared unless others are asked for.
    pub(super) elements: [usize; 2],
    /// The free parameters of a model with this many elements, without the sensor offset.
    pub(super) free: fn(&Scales, usize) -> Vec<Coordinate>,
    /// The model with these values of them.
    pub(super) build: fn(usize, &[f64]) -> Result<Classical, ParamError>,
    /// Their values where fits start.
    pub(super) starts: fn(usize, &ClassicalData, Related) -> Vec<Vec<f64>>,
    /// Where the elements lie among them, if the Coulomb force is the sum of theirs.
    pub(super) bank: Option<Bank>,
}

/// Free parameters of fitted models, the sensor offset first, from which a fit may start.
#[derive(Clone, Copy, Default)]
pub(super) struct Related<'a> {
    /// Same family with one element less.
    pub(super) smaller: Option<&'a [f64]>,
    /// The model of another family that is a special case.
    pub(super) special: Option<&'a [f64]>,
}

/// g and β.
pub(super) fn stribeck(
    [coulomb_force, rise, stribeck_velocity, stribeck_exponent, viscous_damping]: [f64; 5],
) -> SlidingFriction {
    let static_force = coulomb_force + rise;
    SlidingFriction {
        coulomb_force,
        static_force,
        stribeck_velocity,
        stribeck_exponent,
        viscous_damping,
    }
}
