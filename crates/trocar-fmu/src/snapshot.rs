//! The complete variable state of an instance, and its serialized form.
//!
//! The bytes, little-endian: `TROCFMU` with the version, the identity of the model (16), the
//! numbers (8 each), FNV-1a of all preceding bytes (8).

use trocar_model::flat::STATE_NUMBERS;
use trocar_model::{ParamError, Trocar, TrocarState};

use crate::error::{FmuError, Phase};
use crate::hash::fnv_64;

/// First bytes of every serialized state; the last of them is the version.
const MAGIC: [u8; 8] = *b"TROCFMU\x02";
const HEAD: usize = 8 + 16;
const TAIL: usize = 8;
/// Numbers in addition to the parameters and the state of the model.
const OWN: usize = 9;

/// The complete variable state of an instance.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Snapshot {
    pub(crate) identity: u128,
    pub(crate) phase: Phase,
    /// s.
    pub(crate) time: f64,
    /// s.
    pub(crate) stop: Option<f64>,
    /// m or m/s.
    pub(crate) input: f64,
    /// N.
    pub(crate) initial_force: f64,
    /// m.
    pub(crate) initial_deflection: f64,
    /// m.
    pub(crate) initial_position: f64,
    /// rad or rad/s.
    pub(crate) turn: f64,
    /// In the order of the model's parameters.
    pub(crate) tunables: Vec<f64>,
    pub(crate) state: TrocarState,
}

const PHASES: [Phase; 4] =
    [Phase::Instantiated, Phase::Initialization, Phase::Step, Phase::Terminated];

impl Snapshot {
    pub(crate) fn new(identity: u128, tunables: Vec<f64>, state: TrocarState) -> Self {
        Self {
            identity,
            phase: Phase::Instantiated,
            time: 0.0,
            stop: None,
            input: 0.0,
            initial_force: 0.0,
            initial_deflection: 0.0,
            initial_position: 0.0,
            turn: 0.0,
            tunables,
            state,
        }
    }

    /// Size in bytes for a model with `tunables` parameters.
    pub(crate) fn length(tunables: usize) -> usize {
        HEAD + 8 * (OWN + tunables + STATE_NUMBERS) + TAIL
    }

    /// The serialized bytes.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let phase = PHASES.iter().position(|phase| *phase == self.phase).unwrap_or(0);
        let own: [f64; OWN] = [
            phase as f64,
            self.time,
            f64::from(u8::from(self.stop.is_some())),
            self.stop.unwrap_or(0.0),
            self.input,
            self.initial_force,
            self.initial_deflection,
            self.initial_position,
            self.turn,
        ];
        let state = self.state.to_numbers();
        let numbers =
            own.iter().chain(&self.tunables).chain(&state).flat_map(|number| number.to_le_bytes());
        let mut bytes: Vec<u8> =
            MAGIC.into_iter().chain(self.identity.to_le_bytes()).chain(numbers).collect();
        bytes.extend(fnv_64(&bytes).to_le_bytes());
        bytes
    }

    /// Reads the bytes for the model of `identity` with `tunables` parameters; `tuned` returns the
    /// model for their values.
    pub(crate) fn from_bytes(
        bytes: &[u8],
        identity: u128,
        tunables: usize,
        tuned: impl FnOnce(&[f64]) -> Result<Trocar<Vec<f64>>, ParamError>,
    ) -> Result<Self, FmuError> {
        let head: Vec<u8> = MAGIC.into_iter().chain(identity.to_le_bytes()).collect();
        if bytes.len() >= HEAD && !bytes.starts_with(&head) {
            return Err(FmuError::state_foreign());
        }
        let expected = Self::length(tunables);
        if bytes.len() != expected {
            return Err(FmuError::state_length(bytes.len(), expected));
        }
        let damaged = || FmuError::refused("the serialised state is damaged");
        let (body, tail) = bytes.split_at(expected - TAIL);
        if tail != fnv_64(body).to_le_bytes() {
            return Err(damaged());
        }
        let (numbers, _) = body[HEAD..].as_chunks::<8>();
        let numbers: Vec<f64> = numbers.iter().map(|number| f64::from_le_bytes(*number)).collect();
        Self::from_numbers(identity, &numbers, tunables, tuned).ok_or_else(damaged)
    }

    fn from_numbers(
        identity: u128,
        numbers: &[f64],
        tunables: usize,
        tuned: impl FnOnce(&[f64]) -> Result<Trocar<Vec<f64>>, ParamError>,
    ) -> Option<Self> {
        let (own, rest) = numbers.split_first_chunk::<OWN>()?;
        let (values, state) = rest.split_at_checked(tunables)?;
        let [
            phase,
            time,
            stops,
            stop,
            input,
            initial_force,
            initial_deflection,
            initial_position,
            turn,
        ] = *own;
        let finite = own.iter().all(|number| number.is_finite());
        let trocar = tuned(values).ok().filter(|_| finite)?;
        Some(Self {
            identity,
            phase: *PHASES.iter().enumerate().find(|(place, _)| *place as f64 == phase)?.1,
            time,
            stop: (stops != 0.0).then_some(stop),
            input,
            initial_force,
            initial_deflection,
            initial_position,
            turn,
            tunables: values.to_vec(),
            state: trocar.state_from_numbers(state).ok()?,
        })
    }
}
