//! Seals, rigs and motions drawn at random over wide ranges: nothing in them is extreme, and nobody
//! has chosen them.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use trocar::bench::config::SpeedOrder;
use trocar::bench::{PlausibleSeals, Protocol, random_seal};
use trocar::recording::Recording;
use trocar_model::{Relaxation, SlidingFriction};

use super::kinds::{AnyError, Bench, HAND, Kind, RESTS, TURNING, TWO_STEPS, kind, rod, scaled};

/// F_c, N, and c, m.
const COULOMB_FORCE: [f64; 2] = [0.3, 8.0];
const HALF_WIDTH: [f64; 2] = [1.5e-3, 12e-3];
/// β/F_c, s/m, and its ratio by direction.
const VISCOUS: [f64; 2] = [0.3, 4.0];
const SLOPE_RATIO: [f64; 2] = [0.5, 2.0];
/// F_s/F_c and v_s, m/s.
const STATIC_RATIO: [f64; 2] = [1.05, 1.4];
const STRIBECK_VELOCITY: [f64; 2] = [5e-3, 60e-3];
/// v_c, m/s.
const CREEP_VELOCITY: [f64; 2] = [1e-4, 1e-3];
/// E·c/F_c, and τ, s.
const RELAXATION: [f64; 2] = [0.1, 0.5];
const RELAXATION_TIME: [f64; 2] = [0.05, 2.0];
/// ΔF/F_c.
const DWELL: [f64; 2] = [0.02, 0.15];
/// Samples per second, and of one sample in the simulation.
const SAMPLE_RATE: [f64; 2] = [250.0, 2000.0];
const INNER_RATE: f64 = 10e3;
/// Step of the encoder, m; rms of the force readings, N; unmodelled or declared mass, kg.
const ENCODER: [f64; 2] = [4e-6, 50e-6];
const NOISE: [f64; 2] = [5e-3, 50e-3];
const MASS: [f64; 2] = [0.02, 0.4];
/// Scatter from stroke to stroke, and drift.
const SCATTER: f64 = 0.03;
const DRIFT: f64 = 0.05;

/// Shafts, m; k_t over F_s/c, and F_t/F_c; rms of the torque readings, N·m.
const DIAMETERS: [f64; 5] = [3e-3, 5e-3, 8e-3, 10e-3, 12e-3];
const STIFFNESS_RATIO: [f64; 2] = [0.3, 3.0];
const FRICTION_RATIO: [f64; 2] = [0.6, 1.7];
const TORQUE_NOISE: [f64; 2] = [2e-5, 5e-4];

/// Largest side force, N, with the friction of the cannula, tilt, rad, and pressure, Pa, with its gain, 1/Pa; and
/// period, s.
const SIDE_FORCE: [f64; 2] = [1.0, 8.0];
const SIDE_FRICTION: [f64; 2] = [0.05, 0.3];
const TILT: [f64; 2] = [0.3, 1.5];
const PRESSURE: [f64; 2] = [500.0, 3000.0];
const PRESSURE_GAIN: [f64; 2] = [2e-5, 3e-4];
const PERIOD: [f64; 2] = [4.0, 20.0];

/// How often a seal has what the default one lacks.
const HAS_STRIBECK: f64 = 0.4;
const HAS_CREEP: f64 = 0.25;
const HAS_RELAXATION: f64 = 0.25;
const HAS_OWN_SLOPES: f64 = 0.15;
const HAS_DWELL: f64 = 0.5;
const HAS_LOAD: f64 = 0.5;
const IS_DECLARED: f64 = 0.5;

/// Draws of one bench.
struct Drawn {
    random: ChaCha8Rng,
    /// Whether the seal has nothing that the default one lacks.
    is_plain: bool,
}

impl Drawn {
    fn by(seed: u64, is_plain: bool) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), is_plain }
    }

    fn has(&mut self, probability: f64) -> bool {
        self.happens(probability) && !self.is_plain
    }

    fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.random.random::<f64>()
    }

    fn on_a_logarithm(&mut self, range: [f64; 2]) -> f64 {
        self.between(range.map(f64::ln)).exp()
    }

    fn happens(&mut self, probability: f64) -> bool {
        self.random.random::<f64>() < probability
    }

    fn friction(&mut self) -> SlidingFriction {
        let coulomb_force = self.on_a_logarithm(COULOMB_FORCE);
        let viscous_damping = coulomb_force * self.on_a_logarithm(VISCOUS);
        let mut friction = SlidingFriction::coulomb(coulomb_force, viscous_damping);
        if self.has(HAS_STRIBECK) {
            friction.static_force = coulomb_force * self.between(STATIC_RATIO);
            friction.stribeck_velocity = self.on_a_logarithm(STRIBECK_VELOCITY);
        }
        friction
    }

    /// A bench under `protocols`.
    fn bench(&mut self, seed: u64, protocols: &[Protocol]) -> Result<Bench, AnyError> {
        let insertion = self.friction();
        let mut withdrawal = insertion;
        if self.has(HAS_OWN_SLOPES) {
            withdrawal.viscous_damping *= self.on_a_logarithm(SLOPE_RATIO);
        }
        let half_width = self.on_a_logarithm(HALF_WIDTH);
        // Its friction is replaced.
        let shapes = PlausibleSeals { friction_asymmetry: 0.0, ..PlausibleSeals::default() };
        let mut seal = scaled(&random_seal(&shapes, seed), half_width, insertion, withdrawal)?;
        if self.has(HAS_CREEP) {
            seal.creep_velocity = self.on_a_logarithm(CREEP_VELOCITY);
        }
        if self.has(HAS_RELAXATION) {
            let stiffness = self.between(RELAXATION) * insertion.coulomb_force / half_width;
            seal.relaxation = Relaxation::single(stiffness, self.on_a_logarithm(RELAXATION_TIME));
        }
        let rate = self.on_a_logarithm(SAMPLE_RATE).round();
        let (encoder, noise) = (self.on_a_logarithm(ENCODER), self.on_a_logarithm(NOISE));
        let (scatter, drift) = (self.between([0.0, SCATTER]), self.between([-DRIFT, DRIFT]));
        // A drift would leave open what is true.
        let drift = if self.is_plain { 0.0 } else { drift };
        let bench = Bench::of(vec![seal]).under(protocols).with(|config| {
            config.rig.sample_rate_hz = rate;
            config.rig.substeps = (INNER_RATE / rate).ceil() as u32;
            config.encoder.resolution_m = encoder;
            config.force_sensor.noise_n = noise;
            config.fluctuation.stroke_fraction = scatter;
            config.fluctuation.drift_fraction = drift;
            // As the book recommends: in ascending order a drift looks like viscous friction.
            config.protocol.steady.order = SpeedOrder::Shuffled;
        })?;
        let (mass, is_declared) = (self.on_a_logarithm(MASS), self.happens(IS_DECLARED));
        rod(bench, mass, is_declared)
    }
}

impl Drawn {
    /// A bench whose rod turns in two of its recordings.
    fn turning(&mut self, seed: u64) -> Result<Bench, AnyError> {
        let bench = self.bench(seed, &TURNING)?;
        let diameter = DIAMETERS[self.between([0.0, 5.0]) as usize % 5];
        let (stiffness, ratio) =
            (self.on_a_logarithm(STIFFNESS_RATIO), self.on_a_logarithm(FRICTION_RATIO));
        let noise = self.on_a_logarithm(TORQUE_NOISE);
        let bench = bench.with(|config| {
            config.rod.diameter_m = diameter;
            config.torque_sensor.noise_n_m = noise;
        })?;
        bench.turning(stiffness, ratio)
    }

    /// A bench with rests of up to a minute.
    fn resting(&mut self, seed: u64) -> Result<Bench, AnyError> {
        let bench = self.bench(seed, &RESTS)?;
        let part = self.between(DWELL);
        Ok(if self.happens(HAS_DWELL) { bench.sticking_after_rest(part) } else { bench })
    }

    /// A bench on which side force, tilt and pressure are recorded, whether each of them acts or not.
    fn loaded(&mut self, seed: u64) -> Result<Bench, AnyError> {
        let bench = self.bench(seed, &TWO_STEPS)?;
        let largest = [SIDE_FORCE, TILT, PRESSURE, PERIOD].map(|range| self.on_a_logarithm(range));
        let size = [SIDE_FRICTION, PRESSURE_GAIN].map(|range| self.on_a_logarithm(range));
        let acts = [(); 3].map(|()| self.happens(HAS_LOAD));
        bench.with(|config| {
            let loads = &mut config.loads;
            [loads.side_force_n, loads.tilt_rad, loads.pressure_pa, loads.period_s] = largest;
            loads.side_friction = if acts[0] { size[0] } else { 0.0 };
            loads.pressure_gain_per_pa = if acts[2] { size[1] } else { 0.0 };
            config.rod.gravity_m_s2 = if acts[1] { 9.81 } else { 0.0 };
        })
    }
}

/// Benches drawn by their seed.
pub(super) fn random() -> Vec<Kind> {
    let of = |name: &'static str, protocols: Vec<Protocol>| {
        kind(name, move |seed| Drawn::by(seed, false).bench(seed, &protocols))
    };
    vec![
        of("drawn_strokes", TWO_STEPS.to_vec()),
        of("drawn_strokes_and_hand", [&TWO_STEPS[..], &HAND[..]].concat()),
        of("drawn_hand", HAND.to_vec()),
        kind("drawn_rests", |seed| Drawn::by(seed, false).resting(seed)),
        kind("drawn_loads", |seed| Drawn::by(seed, false).loaded(seed)),
        kind("drawn_turning", |seed| Drawn::by(seed, true).turning(seed)),
        kind("drawn_turning_without_torque", |seed| {
            let without = |recording| Ok(Recording { torque: None, ..recording });
            Ok(Drawn::by(seed, true).turning(seed)?.edited(without))
        }),
    ]
}
