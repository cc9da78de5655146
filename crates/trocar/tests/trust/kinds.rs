//! The benches: one line per kind, and the true values that follow from its parameters.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use trocar::bench::config::{ForceSensor, Lubrication, SpeedCycles, SpeedOrder, TissueKind};
use trocar::bench::{self, BenchConfig, Protocol, random_plausible_seal, run};
use trocar::identify::Term;
use trocar::recording::loads::Load;
use trocar::recording::{Recording, RecordingError};
use trocar_model::{
    Branch, DeformationForce, Element, ElementParams, Piece, Relaxation, SealDamping,
    SlidingFriction,
};

use super::random::random;

pub(crate) type AnyError = Box<dyn std::error::Error + Send + Sync>;

/// Lowest and highest value that count as true; they differ if the parameter changes during the
/// run.
pub(crate) type Range = [f64; 2];

/// A modification of a recording after the run of the bench.
type Edit = fn(Recording) -> Result<Recording, RecordingError>;

/// A kind of bench. `make` takes the seed, which most kinds use only for the noise.
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    pub(crate) make: Box<dyn Fn(u64) -> Result<Bench, AnyError>>,
}

/// One bench: seal, rig, motion.
#[derive(Clone)]
pub(crate) struct Bench {
    seal: Vec<ElementParams>,
    config: BenchConfig,
    protocols: Vec<Protocol>,
    /// The inertia of the rod is subtracted, as with `--moving-mass-kg`.
    pub(crate) mass_declared: bool,
    edit: Edit,
    /// True values that do not follow from `seal` and `config`.
    others: Vec<(&'static str, Range)>,
}

/// Protocols of the paper's two steps.
pub(super) const TWO_STEPS: [Protocol; 2] = [Protocol::Steady, Protocol::Dynamic];
/// Strokes with rests between them beside those without.
pub(super) const RESTS: [Protocol; 3] = [Protocol::Steady, Protocol::Dynamic, Protocol::Rest];
/// Strokes that turn beside those that do not.
pub(super) const TURNING: [Protocol; 3] = [Protocol::Steady, Protocol::Roll, Protocol::HoldAndTurn];
const STEADY: [Protocol; 1] = [Protocol::Steady];
const VALIDATION: [Protocol; 1] = [Protocol::Validation];
pub(super) const HAND: [Protocol; 1] = [Protocol::Surgeon];
/// Length of hand-like motion, s: half of the bench's default, which also halves the time of the
/// identification.
const HAND_S: f64 = 30.0;

/// Default friction: F_c in N, β in N s/m.
const DEFAULT: SlidingFriction = SlidingFriction::coulomb(3.0, 5.0);

/// Unstable at every speed of the protocols.
const SOFT: SlidingFriction = stribeck(4.5, 0.04, 2.0, 1.0);

const fn stribeck(
    static_force: f64,
    velocity: f64,
    exponent: f64,
    viscous_damping: f64,
) -> SlidingFriction {
    SlidingFriction {
        static_force,
        stribeck_velocity: velocity,
        stribeck_exponent: exponent,
        ..SlidingFriction::coulomb(DEFAULT.coulomb_force, viscous_damping)
    }
}

/// The shape of the default seal, scaled to `half_width` (m) and to the forces at which the seal
/// slides.
fn seal(
    half_width: f64,
    insertion: SlidingFriction,
    withdrawal: SlidingFriction,
) -> Result<ElementParams, AnyError> {
    scaled(&ElementParams::plausible_10_5_mm()?, half_width, insertion, withdrawal)
}

/// The shape of `model`, scaled alike.
pub(super) fn scaled(
    model: &ElementParams,
    half_width: f64,
    insertion: SlidingFriction,
    withdrawal: SlidingFriction,
) -> Result<ElementParams, AnyError> {
    let width = half_width / model.deformation.half_width();
    let force =
        0.5 * (insertion.static_force + withdrawal.static_force) / model.insertion.static_force;
    let shift = 0.5 * (insertion.static_force - withdrawal.static_force);
    let piece = |p: &Piece| {
        let mut legendre: Vec<f64> = p.legendre().iter().map(|a| force * a).collect();
        legendre[0] += shift;
        Piece::new(width * p.from(), width * p.to(), &legendre)
    };
    let branch = |b: &Branch| Branch::new(piece(b.left())?, piece(b.right())?);
    let old = &model.deformation;
    let deformation =
        DeformationForce::new(branch(old.insertion())?, branch(old.withdrawal())?, None)?;
    Ok(ElementParams { deformation, insertion, withdrawal, ..*model })
}

fn symmetric(half_width: f64, friction: SlidingFriction) -> Result<Bench, AnyError> {
    Ok(Bench::of(vec![seal(half_width, friction, friction)?]))
}

fn plain() -> Result<Bench, AnyError> {
    symmetric(8e-3, DEFAULT)
}

/// Default seal under hand-like motion.
fn hand() -> Result<Bench, AnyError> {
    Ok(plain()?.under(&HAND))
}

/// Default seal with one parameter of the element changed, under hand-like motion.
fn hand_with(change: impl Fn(&mut ElementParams)) -> Result<Bench, AnyError> {
    let mut bench = hand()?;
    bench.seal.iter_mut().for_each(change);
    Ok(bench)
}

fn drifting(fraction: f64, order: SpeedOrder) -> Result<Bench, AnyError> {
    plain()?.with(|config| {
        config.fluctuation.drift_fraction = fraction;
        config.fluctuation.drift_time_s =
            if order == SpeedOrder::UpAndDown { 200.0 } else { 100.0 };
        config.protocol.steady.order = order;
    })
}

/// The friction falls by 30 % within `spread` after `onset`, s.
fn wetted(onset: f64, spread: f64) -> Result<Bench, AnyError> {
    plain()?.with(|c| {
        c.lubrication =
            Lubrication { level: 0.7, onset_s: onset, spread_s: spread, ..c.lubrication }
    })
}

/// A rod of `mass` (kg) that is or is not declared.
pub(super) fn rod(bench: Bench, mass: f64, declared: bool) -> Result<Bench, AnyError> {
    let bench = bench.with(|config| config.rod.mass_kg = mass)?;
    Ok(Bench { mass_declared: declared, ..bench })
}

/// Repeated strokes at speeds between `from` and `to`, m/s.
fn strokes(cycles: &mut SpeedCycles, from: f64, to: f64, increment: f64, repeats: u32) {
    (cycles.slowest_m_s, cycles.fastest_m_s, cycles.increment_m_s) = (from, to, increment);
    cycles.cycles_per_speed = repeats;
}

/// Only strokes of `stroke_m` at the paper's speeds.
fn short(stroke_m: f64) -> Result<Bench, AnyError> {
    plain()?.under(&VALIDATION).with(|config| config.protocol.validation.stroke_m = stroke_m)
}

/// Two seals in parallel: c and F_c of each; β as their force.
fn two_stages() -> Result<Bench, AnyError> {
    let stage = |half_width: f64, share: f64| {
        let friction = SlidingFriction::coulomb(
            share * DEFAULT.coulomb_force,
            share * DEFAULT.viscous_damping,
        );
        seal(half_width, friction, friction)
    };
    let mut bench = Bench::of(vec![stage(8e-3, 0.65)?, stage(3e-3, 0.35)?]);
    bench.others =
        vec![("element_2_coulomb_force_n", [1.05; 2]), ("element_2_half_width_m", [3e-3; 2])];
    Ok(bench)
}

fn keep(recording: Recording, chosen: impl Fn(usize) -> bool) -> Result<Recording, RecordingError> {
    let kept: Vec<usize> = (0..recording.len()).filter(|i| chosen(*i)).collect();
    let column = |values: &[f64]| kept.iter().map(|i| values[*i]).collect::<Vec<f64>>();
    let columns =
        [&recording.time, &recording.position, &recording.force].map(|values| column(values));
    let [time, position, force] = columns;
    Recording::from_columns(recording.name, time, position, force)
}

/// Modifies the force sample by sample, given its value, time (s) and position (m).
fn with_force(
    r: Recording,
    force: impl Fn(f64, f64, f64) -> f64,
) -> Result<Recording, RecordingError> {
    let changed = (0..r.len()).map(|i| force(r.force[i], r.time[i], r.position[i])).collect();
    Recording::from_columns(r.name, r.time, r.position, changed)
}

/// Position readings delayed by 20 samples.
fn delayed(r: Recording) -> Result<Recording, RecordingError> {
    let late = (0..r.len()).map(|i| r.position[i.saturating_sub(20)]).collect();
    Recording::from_columns(r.name, r.time, late, r.force)
}

/// The first three strokes of 120 mm at 30 mm/s and 60 mm/s: two reversals.
fn three_strokes(r: Recording) -> Result<Recording, RecordingError> {
    let three = r.time.partition_point(|t| *t < 10.0);
    keep(r, |i| i < three)
}

/// The offset of the readings due to the rod: tare, weight and gas.
fn offset(config: &BenchConfig) -> f64 {
    let gas = 0.25 * PI * config.rod.diameter_m.powi(2) * config.rod.gas_pressure_pa;
    config.force_sensor.tare_n + gas - config.rod.mass_kg * config.rod.gravity_m_s2
}

impl Bench {
    pub(super) fn of(seal: Vec<ElementParams>) -> Self {
        let mut config = BenchConfig::default();
        config.protocol.surgeon.duration_s = HAND_S;
        Self {
            seal,
            config,
            protocols: TWO_STEPS.to_vec(),
            mass_declared: false,
            edit: Ok,
            others: Vec::new(),
        }
    }

    pub(super) fn with(mut self, change: impl FnOnce(&mut BenchConfig)) -> Result<Self, AnyError> {
        change(&mut self.config);
        Ok(self)
    }

    pub(super) fn under(mut self, protocols: &[Protocol]) -> Self {
        self.protocols = protocols.to_vec();
        self
    }

    /// With k_t and F_t/F_c over those of a seal alike in both directions.
    pub(super) fn turning(mut self, stiffness: f64, ratio: f64) -> Result<Self, AnyError> {
        let elements: Vec<Element> =
            self.seal.iter().map(|p| Element::new(*p)).collect::<Result<_, _>>()?;
        self.config = bench::turning(&self.config, &elements);
        if let Some(rotation) = &mut self.config.rotation {
            rotation.circumferential_stiffness *= stiffness;
            rotation.circumferential_ratio *= ratio;
        }
        Ok(self)
    }

    /// With friction after rest, as a part of the Coulomb force.
    pub(super) fn sticking_after_rest(mut self, part: f64) -> Self {
        for seal in &mut self.seal {
            seal.dwell_force = part * seal.insertion.coulomb_force;
        }
        self
    }

    /// Of the shaft, if it turns.
    pub(crate) fn shaft_radius(&self) -> Option<f64> {
        self.config.rotation.map(|rotation| rotation.shaft_radius)
    }

    pub(super) fn edited(mut self, edit: Edit) -> Self {
        self.edit = edit;
        self
    }

    fn knowing(mut self, others: &[(&'static str, Range)]) -> Self {
        self.others.extend_from_slice(others);
        self
    }

    /// The recordings passed to `identify`.
    pub(crate) fn recordings(&self, seed: u64) -> Result<Vec<Recording>, AnyError> {
        let elements: Vec<Element> =
            self.seal.iter().map(|p| Element::new(*p)).collect::<Result<_, _>>()?;
        let record = |protocol: &Protocol| {
            let recording =
                run(&self.config, *protocol, &elements, seed)?.to_recording(protocol.name())?;
            let recording = (self.edit)(recording)?;
            // The weight stays in the offset.
            let taken_out = if self.mass_declared { self.config.rod.mass_kg } else { 0.0 };
            Ok(if taken_out > 0.0 {
                recording.without_moving_mass(taken_out, 0.0)?
            } else {
                recording
            })
        };
        self.protocols.iter().map(record).collect()
    }

    /// Optional model terms that describe the readings.
    pub(crate) fn terms(&self) -> Vec<Term> {
        let any = |of: fn(&ElementParams) -> bool| self.seal.iter().any(of);
        let [side_friction, tilted_weight, pressure_gain] = self.loads();
        let terms = [
            (Term::Stribeck, any(|p| p.insertion.static_force > p.insertion.coulomb_force)),
            (Term::SealDamping, any(|p| p.damping.coefficients[0] > 0.0)),
            (Term::Creep, any(|p| p.creep_velocity > 0.0)),
            (Term::Dwell, any(|p| p.dwell_force > 0.0)),
            (Term::Relaxation, any(|p| p.relaxation.arms[0].stiffness > 0.0)),
            (Term::Load(Load::Mass), !self.mass_declared && self.config.rod.mass_kg > 0.0),
            (Term::Load(Load::Side), side_friction > 0.0),
            (Term::Load(Load::Weight), tilted_weight > 0.0),
            (Term::Load(Load::Pressure), pressure_gain > 0.0),
            (Term::Asymmetry, any(|p| p.insertion.viscous_damping != p.withdrawal.viscous_damping)),
            (Term::SecondStage, self.seal.len() > 1),
        ];
        terms.into_iter().filter(|t| t.1).map(|t| t.0).collect()
    }

    /// Friction of the cannula, weight that the tilt turns, N, and gain with the pressure, 1/Pa; 0 where
    /// nothing of it was recorded.
    fn loads(&self) -> [f64; 3] {
        let BenchConfig { loads, rod, .. } = &self.config;
        let of = |largest: f64, own: f64| if largest > 0.0 { own } else { 0.0 };
        [
            of(loads.side_force_n, loads.side_friction),
            of(loads.tilt_rad, rod.mass_kg * rod.gravity_m_s2),
            of(loads.pressure_pa, loads.pressure_gain_per_pa),
        ]
    }

    /// True parameters by name. A parameter of an absent model term is 0 if 0 represents its
    /// absence.
    pub(crate) fn truths(&self) -> BTreeMap<&'static str, Range> {
        let sum = |of: fn(&ElementParams) -> f64| self.seal.iter().map(of).sum::<f64>();
        let first = &self.seal[0];
        let branches = [first.deformation.insertion(), first.deformation.withdrawal()];
        let drift = 1.0 + self.config.fluctuation.drift_fraction;
        let wet = &self.config.lubrication;
        let range = |end: f64, value: f64| [value.min(end * value), value.max(end * value)];
        let force = |value: f64| range(drift * wet.level, value);
        // A wet seal slips at a lower force and thus at a smaller deflection.
        let width = |value: f64| range(wet.level, value);
        let damping = |value: f64| range(drift * wet.viscosity, value);
        let [side_friction, tilted_weight, pressure_gain] = self.loads();
        let offset = offset(&self.config) + tilted_weight;
        let (insertion, withdrawal) =
            (sum(|p| p.insertion.coulomb_force), sum(|p| p.withdrawal.coulomb_force));
        let shifted = |[low, high]: Range, by: f64| [low + by, high + by];
        let mut all = BTreeMap::from([
            ("offset_n", [offset; 2]),
            ("coulomb_force_n", force(0.5 * (insertion + withdrawal))),
            ("viscous_damping_n_s_m", {
                damping(0.5 * sum(|p| p.insertion.viscous_damping + p.withdrawal.viscous_damping))
            }),
            (
                "static_force_n",
                force(0.5 * sum(|p| p.insertion.static_force + p.withdrawal.static_force)),
            ),
            (
                "half_width_m",
                width(self.seal.iter().map(|p| p.deformation.half_width()).fold(0.0, f64::max)),
            ),
            ("seal_damping_n_s_m", damping(sum(|p| p.damping.coefficients[0]))),
            (
                "unmodelled_mass_kg",
                [if self.mass_declared { 0.0 } else { self.config.rod.mass_kg }; 2],
            ),
            ("side_friction", [side_friction; 2]),
            ("tilted_weight_n", [tilted_weight; 2]),
            ("pressure_gain_per_pa", [pressure_gain; 2]),
            ("creep_velocity_m_s", [first.creep_velocity; 2]),
            ("friction_lag_s", [first.friction_lag; 2]),
            ("dwell_force_n", force(sum(|p| p.dwell_force))),
            ("relaxation_stiffness_n_m", force(first.relaxation.arms[0].stiffness)),
            ("second_relaxation_stiffness_n_m", [0.0; 2]),
            ("element_2_coulomb_force_n", [0.0; 2]),
        ]);
        if first.relaxation.arms[0].stiffness > 0.0 {
            all.insert("relaxation_time_s", [first.relaxation.arms[0].time; 2]);
        }
        if first.insertion.is_constant() {
            // The lines of each direction are straight.
            all.insert("insertion_coulomb_force_with_offset_n", shifted(force(insertion), offset));
            all.insert(
                "withdrawal_coulomb_force_with_offset_n",
                shifted(force(withdrawal), -offset),
            );
            all.insert(
                "insertion_viscous_damping_n_s_m",
                damping(sum(|p| p.insertion.viscous_damping)),
            );
            all.insert(
                "withdrawal_viscous_damping_n_s_m",
                damping(sum(|p| p.withdrawal.viscous_damping)),
            );
        } else {
            all.insert("stribeck_velocity_m_s", [first.insertion.stribeck_velocity; 2]);
        }
        if self.seal.len() == 1 {
            let [insertion, withdrawal] = branches;
            all.insert("insertion_join_m", width(insertion.join()));
            all.insert("withdrawal_join_m", width(withdrawal.join()));
            all.insert("insertion_join_force_n", force(insertion.force(insertion.join())));
            all.insert("withdrawal_join_force_n", force(withdrawal.force(withdrawal.join())));
            all.insert("yield_stiffness_n_m", range(drift, first.deformation.yield_stiffness()));
        }
        if let Some(rotation) = self.config.rotation {
            let stiffness = rotation.circumferential_stiffness;
            all.insert("circumferential_stiffness_n_m", range(drift, stiffness));
            all.insert("circumferential_ratio", [rotation.circumferential_ratio; 2]);
        }
        all.extend(self.others.iter().copied());
        all
    }
}

/// Variants of the seal: friction, deformation and further effects.
fn seals() -> Vec<Kind> {
    vec![
        kind("plain", |_| plain()),
        kind("random_seal", |seed| Ok(Bench::of(vec![random_plausible_seal(seed)]))),
        kind("small_c_2_mm", |_| symmetric(2e-3, DEFAULT)),
        kind("large_c_12_mm", |_| symmetric(12e-3, DEFAULT)),
        kind("weak_0.3_n_noise_0.05", |_| {
            symmetric(8e-3, SlidingFriction::coulomb(0.3, 0.5))?
                .with(|c| c.force_sensor.noise_n = 0.05)
        }),
        kind("strong_8_n", |_| symmetric(8e-3, SlidingFriction::coulomb(8.0, 5.0))),
        kind("no_viscosity", |_| symmetric(8e-3, SlidingFriction::coulomb(3.0, 0.0))),
        kind("seal_damping_5", |_| {
            let mut bench = plain()?;
            bench.seal[0].damping = SealDamping { coefficients: [5.0, 0.0, 0.0] };
            Ok(bench)
        }),
        kind("stribeck_10_mm_s", |_| symmetric(8e-3, stribeck(3.9, 0.01, 2.0, 5.0))),
        kind("stribeck_10_mm_s_exponent_1", |_| symmetric(8e-3, stribeck(3.9, 0.01, 1.0, 5.0))),
        kind("stribeck_30_mm_s", |_| symmetric(8e-3, stribeck(3.9, 0.03, 2.0, 5.0))),
        kind("stribeck_30_mm_s_exponent_1", |_| symmetric(8e-3, stribeck(3.9, 0.03, 1.0, 5.0))),
        kind("stribeck_below_slowest", |_| symmetric(8e-3, stribeck(3.9, 0.003, 2.0, 5.0))),
        kind("stribeck_below_slowest_hand", |_| {
            Ok(symmetric(8e-3, stribeck(3.9, 0.003, 2.0, 5.0))?.under(&HAND))
        }),
        kind("stick_slip", |_| symmetric(8e-3, SOFT)),
        kind("stick_slip_hand", |_| Ok(symmetric(8e-3, SOFT)?.under(&HAND))),
        kind("slopes_differ", |_| {
            let withdrawal = SlidingFriction::coulomb(3.0, 10.0);
            Ok(Bench::of(vec![seal(8e-3, DEFAULT, withdrawal)?]))
        }),
        kind("coulomb_differs", |_| {
            let withdrawal = SlidingFriction::coulomb(2.4, 5.0);
            Ok(Bench::of(vec![seal(8e-3, DEFAULT, withdrawal)?]))
        }),
        kind("coulomb_differs_hand", |_| {
            let withdrawal = SlidingFriction::coulomb(2.4, 5.0);
            Ok(Bench::of(vec![seal(8e-3, DEFAULT, withdrawal)?]).under(&HAND))
        }),
        kind("two_stages", |_| two_stages()),
        kind("two_stages_hand", |_| Ok(two_stages()?.under(&HAND))),
        kind("creep_0.3_mm_s", |_| {
            let mut bench = plain()?;
            bench.seal[0].creep_velocity = 3e-4;
            Ok(bench)
        }),
        kind("creep_3_mm_s", |_| {
            let mut bench = plain()?.under(&STEADY);
            bench.seal[0].creep_velocity = 3e-3;
            Ok(bench)
        }),
        kind("creep_0.3_mm_s_hand", |_| hand_with(|p| p.creep_velocity = 3e-4)),
        kind("relaxation", |_| {
            let mut bench = plain()?;
            bench.seal[0].relaxation = Relaxation::single(100.0, 0.3);
            Ok(bench)
        }),
        kind("relaxation_hand", |_| hand_with(|p| p.relaxation = Relaxation::single(100.0, 0.3))),
        kind("relaxation_slow_hand", |_| {
            hand_with(|p| p.relaxation = Relaxation::single(100.0, 3.0))
        }),
    ]
}

/// Changes during the run: drift, wetting, scatter, position.
fn changes() -> Vec<Kind> {
    vec![
        kind("drift_3_ascending", |_| drifting(0.03, SpeedOrder::Ascending)),
        kind("drift_3_shuffled", |_| drifting(0.03, SpeedOrder::Shuffled)),
        kind("drift_10_ascending", |_| drifting(0.1, SpeedOrder::Ascending)),
        kind("drift_10_shuffled", |_| drifting(0.1, SpeedOrder::Shuffled)),
        kind("drift_10_up_and_down", |_| drifting(0.1, SpeedOrder::UpAndDown)),
        kind("drift_minus_10_ascending", |_| drifting(-0.1, SpeedOrder::Ascending)),
        kind("wetted_abruptly", |_| wetted(50.0, 0.0)),
        kind("wetted_gradually", |_| wetted(20.0, 60.0)),
        kind("wetted_hand", |_| Ok(wetted(0.5 * HAND_S, 0.0)?.under(&HAND))),
        kind("scatter_1", |_| plain()?.with(|c| c.fluctuation.stroke_fraction = 0.01)),
        kind("scatter_5", |_| plain()?.with(|c| c.fluctuation.stroke_fraction = 0.05)),
        kind("scatter_5_hand", |_| hand()?.with(|c| c.fluctuation.stroke_fraction = 0.05)),
        kind("offset_drifts", |_| {
            let bench = plain()?.edited(|r| with_force(r, |force, time, _| force + 0.003 * time));
            Ok(bench.knowing(&offset_ranges(0.0, 0.33)))
        }),
        kind("force_depends_on_position", |_| {
            // The friction only; tare and weight are -0.3424 N.
            let bench = plain()?.edited(|r| {
                with_force(r, |f, _, x| {
                    (f + 0.3424) * (1.0 + 0.1 * (TAU * x / 0.05).sin()) - 0.3424
                })
            });
            let around = |value: f64| [0.9 * value, 1.1 * value];
            Ok(bench.knowing(&[
                ("coulomb_force_n", around(3.0)),
                ("viscous_damping_n_s_m", around(5.0)),
                ("insertion_coulomb_force_with_offset_n", [2.7 - 0.3424, 3.3 - 0.3424]),
                ("withdrawal_coulomb_force_with_offset_n", [2.7 + 0.3424, 3.3 + 0.3424]),
                ("insertion_viscous_damping_n_s_m", around(5.0)),
                ("withdrawal_viscous_damping_n_s_m", around(5.0)),
                ("half_width_m", [7e-3, 9e-3]),
            ]))
        }),
        kind("tissue_at_80_mm", |_| {
            plain()?.with(|c| {
                (c.tissue.kind, c.tissue.force_at_10_mm_n) = (TissueKind::HuntCrossley, 0.3)
            })
        }),
        kind("load_half_way", |_| {
            let bench = plain()?.with(|c| (c.tissue.load_n, c.tissue.load_from_s) = (0.5, 50.0))?;
            Ok(bench.knowing(&offset_ranges(0.0, 0.5)))
        }),
    ]
}

/// True values of the parameters affected by the offset, which is between `low` and `high` (N)
/// above its value for the rig.
fn offset_ranges(low: f64, high: f64) -> [(&'static str, Range); 3] {
    let offset = offset(&BenchConfig::default());
    let force = DEFAULT.coulomb_force;
    [
        ("offset_n", [offset + low, offset + high]),
        ("insertion_coulomb_force_with_offset_n", [force + offset + low, force + offset + high]),
        ("withdrawal_coulomb_force_with_offset_n", [force - offset - high, force - offset - low]),
    ]
}

/// Rig and sensors.
fn rigs() -> Vec<Kind> {
    vec![
        kind("mass_0_unmodelled", |_| rod(plain()?, 0.0, false)),
        kind("mass_0.1_unmodelled", |_| rod(plain()?, 0.1, false)),
        kind("mass_0.2_unmodelled", |_| rod(plain()?, 0.2, false)),
        kind("mass_0.3_unmodelled", |_| rod(plain()?, 0.3, false)),
        kind("mass_0.04_declared", |_| rod(plain()?, 0.04, true)),
        kind("mass_0.3_declared", |_| rod(plain()?, 0.3, true)),
        kind("mass_0.3_unmodelled_hand", |_| rod(hand()?, 0.3, false)),
        kind("mass_0.3_declared_hand", |_| rod(hand()?, 0.3, true)),
        kind("gas_pressure", |_| plain()?.with(|c| c.rod.gas_pressure_pa = 2000.0)),
        kind("coarse_sampling_100_hz", |_| {
            plain()?.with(|c| (c.rig.sample_rate_hz, c.rig.substeps) = (100.0, 100))
        }),
        kind("coarse_encoder_0.1_mm", |_| plain()?.with(|c| c.encoder.resolution_m = 1e-4)),
        kind("coarse_encoder_0.1_mm_random_seal", |seed| {
            Bench::of(vec![random_plausible_seal(seed)]).with(|c| c.encoder.resolution_m = 1e-4)
        }),
        kind("coarse_sampling_200_hz_random_seal", |seed| {
            Bench::of(vec![random_plausible_seal(seed)])
                .with(|c| (c.rig.sample_rate_hz, c.rig.substeps) = (200.0, 50))
        }),
        kind("coarse_sampling_100_hz_random_seal", |seed| {
            Bench::of(vec![random_plausible_seal(seed)])
                .with(|c| (c.rig.sample_rate_hz, c.rig.substeps) = (100.0, 100))
        }),
        kind("coarse_force_0.1_n", |_| plain()?.with(|c| c.force_sensor.resolution_n = 0.1)),
        kind("coarse_force_0.5_n", |_| plain()?.with(|c| c.force_sensor.resolution_n = 0.5)),
        kind("noise_0.1_n", |_| plain()?.with(|c| c.force_sensor.noise_n = 0.1)),
        kind("noise_0.1_n_hand", |_| hand()?.with(|c| c.force_sensor.noise_n = 0.1)),
        kind("noise_of_10_hz", |_| {
            plain()?.with(|c| {
                c.force_sensor =
                    ForceSensor { noise_n: 0.05, noise_bandwidth_hz: 10.0, ..c.force_sensor }
            })
        }),
        kind("saturated_3.2_n", |_| plain()?.with(|c| c.force_sensor.range_n = 3.2)),
        kind("positions_20_ms_late", |_| Ok(plain()?.edited(delayed))),
        kind("positions_20_ms_late_hand", |_| Ok(hand()?.edited(delayed))),
        kind("samples_lost", |_| Ok(plain()?.edited(|r| keep(r, |i| i % 997 > 40)))),
    ]
}

/// Motions beyond the standard protocols.
fn motions() -> Vec<Kind> {
    vec![
        kind("hand", |_| hand()),
        kind("hand_steady_dynamic", |_| {
            Ok(plain()?.under(&[Protocol::Surgeon, Protocol::Steady, Protocol::Dynamic]))
        }),
        kind("hand_60_s", |_| hand()?.with(|c| c.protocol.surgeon.duration_s = 60.0)),
        kind("hand_small_5_mm", |_| {
            // Never as far as the deformation of the seal.
            hand()?.with(|c| {
                let hand = &mut c.protocol.surgeon;
                (hand.range_m, hand.longest_m, hand.reversal_longest_m) = (5e-3, 2.5e-3, 2.5e-3);
            })
        }),
        kind("steady_only", |_| Ok(plain()?.under(&STEADY))),
        kind("dynamic_only", |_| Ok(plain()?.under(&[Protocol::Dynamic]))),
        kind("short_strokes_12_mm", |_| short(0.012)),
        kind("short_strokes_14_mm", |_| short(0.014)),
        kind("short_strokes_17_mm", |_| short(0.017)),
        kind("short_strokes_20_mm", |_| short(0.020)),
        kind("turning_scatter", |_| {
            let bench = plain()?.under(&VALIDATION);
            bench.with(|c| c.protocol.validation.turning_scatter_m = 0.01)
        }),
        kind("one_speed", |_| {
            plain()?.under(&STEADY).with(|c| strokes(&mut c.protocol.steady, 0.05, 0.05, 0.01, 5))
        }),
        kind("two_speeds", |_| {
            plain()?.under(&STEADY).with(|c| strokes(&mut c.protocol.steady, 0.03, 0.06, 0.03, 3))
        }),
        kind("narrow_speeds", |_| {
            plain()?
                .under(&STEADY)
                .with(|c| strokes(&mut c.protocol.steady, 0.048, 0.052, 0.001, 2))
        }),
        kind("ten_equal_strokes", |_| {
            plain()?
                .under(&VALIDATION)
                .with(|c| strokes(&mut c.protocol.validation, 0.02, 0.02, 0.01, 10))
        }),
        kind("two_reversals", |_| {
            let bench = plain()?.under(&STEADY).edited(three_strokes);
            bench.with(|c| strokes(&mut c.protocol.steady, 0.03, 0.06, 0.03, 1))
        }),
        kind("one_velocity_step", |_| Ok(plain()?.under(&[Protocol::Step]))),
        kind("rests_at_reversals", |_| {
            let bench = plain()?.under(&VALIDATION);
            bench.with(|c| c.protocol.validation.dwell_s = 0.5)
        }),
    ]
}

pub(super) fn kind(
    name: &'static str,
    make: impl Fn(u64) -> Result<Bench, AnyError> + 'static,
) -> Kind {
    Kind { name, make: Box::new(make) }
}

/// All kinds.
pub(crate) fn kinds() -> Vec<Kind> {
    [seals(), changes(), rigs(), motions(), random()].into_iter().flatten().collect()
}
