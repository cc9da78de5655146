//! The virtual bench behaves like a rig: physics, sensors, reproducibility, configuration.

use trocar::bench::config::{Fluctuation, ForceSensor, Motor, PushCycles, SpeedOrder};
use trocar::bench::{
    BenchConfig, BenchError, BenchRun, ConfigError, PlausibleSeals, Protocol, length,
    random_plausible_seal, random_seal, run,
};
use trocar_model::{
    DeformationForce, Element, ElementParams, Relaxation, SealDamping, SlidingFriction,
};

const ENCODER_COUNT: f64 = 4e-6;

fn plausible() -> Element {
    Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap()
}

/// A seal of `coulomb_force` N that deforms linearly over 2 mm.
fn linear_seal(coulomb_force: f64, viscous_damping: f64) -> Element {
    let friction = SlidingFriction::coulomb(coulomb_force, viscous_damping);
    Element::new(ElementParams {
        deformation: DeformationForce::linear(coulomb_force / 2e-3, 2e-3).unwrap(),
        damping: SealDamping::ZERO,
        insertion: friction,
        withdrawal: friction,
        creep_velocity: 0.0,
        friction_lag: 0.0,
        dwell_force: 0.0,
        relaxation: Relaxation::NONE,
    })
    .unwrap()
}

/// Without noise, rounding, fluctuation and rod weight: the reading follows from the physics alone.
fn ideal() -> BenchConfig {
    let mut config = BenchConfig::default();
    config.force_sensor =
        ForceSensor { noise_n: 0.0, resolution_n: 0.0, tare_n: 0.0, ..config.force_sensor };
    config.fluctuation =
        Fluctuation { stroke_fraction: 0.0, ripple_fraction: 0.0, ..config.fluctuation };
    config.rod.gravity_m_s2 = 0.0;
    config
}

fn go(config: &BenchConfig, protocol: Protocol, seal: &[Element], seed: u64) -> BenchRun {
    run(config, protocol, seal, seed).unwrap()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn rms_about_mean(values: &[f64]) -> f64 {
    let centre = mean(values);
    (values.iter().map(|v| (v - centre).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

/// Ranges of samples in which the sign of `reference` does not change.
fn strokes(reference: &[f64]) -> Vec<std::ops::Range<usize>> {
    let mut strokes = Vec::new();
    let mut begin = 0;
    for i in 1..=reference.len() {
        let ends = i == reference.len()
            || (reference[i] != 0.0 && reference[i].signum() != reference[begin].signum());
        if ends {
            strokes.push(begin..i);
            begin = i;
        }
    }
    strokes
}

#[test]
fn speed_settles_over_most_of_every_stroke() {
    let config = BenchConfig::default();
    let record = go(&config, Protocol::Steady, &[plausible()], 1);
    let truth = &record.truth;
    let strokes = strokes(&truth.reference_velocity);
    assert_eq!(strokes.len(), 36);
    for stroke in strokes {
        let asked = truth.reference_velocity[stroke.clone()]
            .iter()
            .fold(0.0, |most: f64, v| if v.abs() > most.abs() { *v } else { most });
        let travelled = |keep: &dyn Fn(usize) -> bool| {
            let inside = stroke.clone().skip(1).filter(|&i| keep(i));
            let steps = inside.map(|i| (truth.position[i] - truth.position[i - 1]).abs());
            steps.sum::<f64>()
        };
        let settled = travelled(&|i| (truth.velocity[i] / asked - 1.0).abs() < 0.02);
        let part = settled / travelled(&|_| true);
        assert!(part > 0.6, "{asked} m/s: settled over {part} of the stroke");
    }
}

#[test]
fn speeds_are_those_of_the_paper() {
    let speeds = BenchConfig::default().protocol.steady.speeds();
    assert_eq!(speeds.len(), 18);
    assert!((speeds[0] - 0.015).abs() < 1e-12 && (speeds[17] - 0.1).abs() < 1e-12);
}

/// Reference speed of each stroke, negative on withdrawal.
fn speeds_asked_for(reference: &[f64]) -> Vec<f64> {
    let strongest = |most: f64, v: &f64| if v.abs() > most.abs() { *v } else { most };
    strokes(reference)
        .into_iter()
        .map(|stroke| reference[stroke].iter().fold(0.0, strongest))
        .collect()
}

#[test]
fn orders_of_speed_hold_the_same_cycles() {
    let insertions = |order: SpeedOrder, seed: u64| {
        let mut config = ideal();
        let cycles = &mut config.protocol.validation;
        (cycles.slowest_m_s, cycles.increment_m_s, cycles.order) = (0.03, 0.01, order);
        let truth = go(&config, Protocol::Validation, &[plausible()], seed).truth;
        let asked = speeds_asked_for(&truth.reference_velocity);
        assert!(asked.chunks(2).all(|cycle| cycle[0] == -cycle[1]), "{asked:?}");
        asked.into_iter().step_by(2).collect::<Vec<f64>>()
    };
    let ascending = insertions(SpeedOrder::Ascending, 1);
    assert_eq!(ascending.len(), 8);
    assert!(ascending.is_sorted());
    let shuffled = insertions(SpeedOrder::Shuffled, 1);
    assert!(shuffled != ascending && shuffled != insertions(SpeedOrder::Shuffled, 2));
    assert_eq!(shuffled, insertions(SpeedOrder::Shuffled, 1));
    let mut sorted = shuffled;
    sorted.sort_by(f64::total_cmp);
    assert_eq!(sorted, ascending);
    let down: Vec<f64> = ascending.iter().rev().copied().collect();
    assert_eq!(insertions(SpeedOrder::UpAndDown, 1), [ascending, down].concat());
}

#[test]
fn drift_looks_like_viscous_friction_only_in_ascending_order() {
    // Slope of the sliding force over the speed, N s/m: the viscous damping of a linear fit.
    let slope = |order: SpeedOrder, drift_fraction: f64| {
        let mut config = ideal();
        config.protocol.steady.order = order;
        config.fluctuation.drift_fraction = drift_fraction;
        config.fluctuation.drift_time_s =
            if order == SpeedOrder::UpAndDown { 200.0 } else { 100.0 };
        let truth = go(&config, Protocol::Steady, &[plausible()], 4).truth;
        let sliding =
            |i: &usize| truth.deflections[0][*i].abs() > 7.9e-3 && truth.velocity[*i].abs() > 0.01;
        let points: Vec<(f64, f64)> = strokes(&truth.reference_velocity)
            .into_iter()
            .map(|stroke| {
                let settled: Vec<usize> = stroke.filter(sliding).collect();
                let mean_of = |column: &[f64]| {
                    mean(&settled.iter().map(|i| column[*i].abs()).collect::<Vec<f64>>())
                };
                (mean_of(&truth.velocity), mean_of(&truth.seal_force))
            })
            .collect();
        let centre =
            |of: fn(&(f64, f64)) -> f64| mean(&points.iter().map(of).collect::<Vec<f64>>());
        let (v, f) = (centre(|p| p.0), centre(|p| p.1));
        let product: f64 = points.iter().map(|p| (p.0 - v) * (p.1 - f)).sum();
        product / points.iter().map(|p| (p.0 - v).powi(2)).sum::<f64>()
    };
    for order in [SpeedOrder::Ascending, SpeedOrder::Shuffled, SpeedOrder::UpAndDown] {
        assert!((slope(order, 0.0) - 5.0).abs() < 0.1, "{order:?}: {}", slope(order, 0.0));
    }
    // 10 % of about 3.2 N while the speed rises by 85 mm/s: 3.8 N s/m on average.
    let excess = |order: SpeedOrder| slope(order, 0.1) - 5.0;
    assert!(
        (2.0..6.0).contains(&excess(SpeedOrder::Ascending)),
        "{}",
        excess(SpeedOrder::Ascending)
    );
    assert!(excess(SpeedOrder::Shuffled).abs() < 1.5, "{}", excess(SpeedOrder::Shuffled));
    assert!(excess(SpeedOrder::UpAndDown).abs() < 0.5, "{}", excess(SpeedOrder::UpAndDown));
}

#[test]
fn force_drifts_by_the_declared_fraction_and_then_stays() {
    let mut config = ideal();
    let cycles = &mut config.protocol.validation;
    (cycles.slowest_m_s, cycles.fastest_m_s, cycles.cycles_per_speed) = (0.05, 0.05, 20);
    let steady = go(&config, Protocol::Validation, &[plausible()], 1).truth;
    config.fluctuation =
        Fluctuation { drift_fraction: -0.2, drift_time_s: 20.0, ..config.fluctuation };
    let drifting = go(&config, Protocol::Validation, &[plausible()], 1).truth;
    for stroke in strokes(&steady.reference_velocity) {
        // Near the end of the stroke, before the carriage slows down.
        let late = stroke.end - 250..stroke.end - 80;
        let ratio =
            mean(&drifting.seal_force[late.clone()]) / mean(&steady.seal_force[late.clone()]);
        let seconds = 1e-3 * 0.5 * (late.start + late.end) as f64;
        let expected = 1.0 - 0.2 * (seconds / 20.0).min(1.0);
        assert!((ratio - expected).abs() < 1e-3, "{seconds} s: {ratio} instead of {expected}");
    }
    let last = steady.reference_velocity.len() as f64 * 1e-3;
    assert!(last > 30.0, "{last} s show no force that stays");
}

#[test]
fn reversals_scatter_as_declared() {
    let turning_points = |scatter: f64, seed: u64| {
        let mut config = ideal();
        let cycles = &mut config.protocol.validation;
        (cycles.slowest_m_s, cycles.fastest_m_s, cycles.cycles_per_speed) = (0.1, 0.1, 40);
        cycles.turning_scatter_m = scatter;
        let record = go(&config, Protocol::Validation, &[plausible()], seed);
        assert_eq!(record.events.stop_hits, 0);
        let position = &record.truth.position;
        let ends = strokes(&record.truth.reference_velocity)
            .into_iter()
            .map(|stroke| position[stroke.end - 1]);
        ends.collect::<Vec<f64>>()
    };
    // The rig follows its reference within about a tenth of a millimetre.
    let nominal = turning_points(0.0, 1);
    let scattered = turning_points(0.005, 1);
    assert_eq!((nominal.len(), scattered.len()), (80, 80));
    for side in 0..2 {
        let moved: Vec<f64> = (side..80).step_by(2).map(|i| scattered[i] - nominal[i]).collect();
        assert!(moved.iter().all(|m| m.abs() < 0.0055), "{moved:?}");
        // A uniform distribution over ±5 mm has 2.9 mm rms; 40 reversals determine it within 20 %.
        assert!((rms_about_mean(&moved) / 0.0029 - 1.0).abs() < 0.25, "{}", rms_about_mean(&moved));
    }
    assert_ne!(scattered, turning_points(0.005, 2));
}

#[test]
fn work_of_the_motor_is_accounted_for() {
    let mut config = ideal();
    // Sampled at every step, so that the sums over samples equal the integrals.
    config.rig.sample_rate_hz = 10_000.0;
    config.rig.substeps = 1;
    config.rod.gravity_m_s2 = 9.81;
    config.motor = Motor { balanced_fraction: 0.5, guide_friction_n: 0.0, ..config.motor };
    config.rod.gas_pressure_pa = 2000.0;
    for protocol in [Protocol::Step, Protocol::Dynamic] {
        let record = go(&config, protocol, &[plausible()], 3);
        let truth = &record.truth;
        let work = |force: &[f64]| {
            let mean_force = |i: usize| 0.5 * (force[i] + force[i - 1]);
            let moved = |i: usize| truth.position[i] - truth.position[i - 1];
            (1..force.len()).map(|i| mean_force(i) * moved(i)).sum::<f64>()
        };
        let drag: Vec<f64> = truth.velocity.iter().map(|v| 40.0 * v).collect();
        let last = truth.velocity.len() - 1;
        let mass = 0.54;
        let kinetic = 0.5 * mass * (truth.velocity[last].powi(2) - truth.velocity[0].powi(2));
        let fallen = truth.position[last] - truth.position[0];
        let gained = 0.5 * mass * 9.81 * fallen - 2000.0 * 7.853_98e-5 * fallen;
        let pitch = std::f64::consts::TAU / 0.020;
        let cogging = |x: f64| -0.2 / pitch * (pitch * x).cos();
        let stored = cogging(truth.position[last]) - cogging(truth.position[0]);
        let supplied = work(&truth.motor_force) + gained;
        let spent = work(&truth.seal_force) + work(&drag) + kinetic + stored;
        assert!(spent > 0.1, "{protocol}: only {spent} J");
        // Error of the first-order integration at 10 kHz.
        assert!((supplied / spent - 1.0).abs() < 0.005, "{protocol}: {supplied} J, {spent} J");
    }
}

#[test]
fn a_closed_cycle_costs_work() {
    let record = go(&ideal(), Protocol::Steady, &[plausible()], 1);
    let truth = &record.truth;
    let steps = 1..truth.position.len();
    let work: f64 =
        steps.map(|i| truth.seal_force[i] * (truth.position[i] - truth.position[i - 1])).sum();
    // 18 cycles of twice 120 mm against 3 N and 5 N s/m at 57.5 mm/s on average, minus the savings
    // due to deformation.
    let sliding = 18.0 * 0.24 * (3.0 + 5.0 * 0.0575);
    assert!(work > 0.8 * sliding && work < sliding, "{work} J of {sliding} J");
}

#[test]
fn reading_is_seal_and_inertia_and_weight() {
    let mut config = ideal();
    config.rod.gravity_m_s2 = 9.81;
    config.rod.mass_kg = 0.2;
    config.force_sensor.tare_n = 0.7;
    let record = go(&config, Protocol::Dynamic, &[plausible()], 1);
    let truth = &record.truth;
    // Newton's law for the motor side gives the same load as for the rod side that the bench
    // reports.
    for i in 0..record.force.len() {
        let motor_side = record.force[i] - 0.7 + 0.2 * 9.81 - 0.2 * truth.acceleration[i];
        assert!((motor_side - truth.seal_force[i]).abs() < 1e-9);
    }
    let heaviest = truth.acceleration.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
    assert!(heaviest > 2.0, "no inertia to speak of: {heaviest} m/s²");
}

#[test]
fn a_record_with_its_rod_taken_out_is_the_seal() {
    let mut config = BenchConfig::default();
    config.rod.mass_kg = 0.1;
    config.force_sensor.tare_n = 0.0;
    let record = go(&config, Protocol::Dynamic, &[plausible()], 1);
    let error = |force: &[f64]| {
        let seal = &record.truth.seal_force;
        let errors: Vec<f64> = force.iter().zip(seal).map(|(a, b)| a - b).collect();
        (mean(&errors).abs(), rms_about_mean(&errors))
    };
    let raw = record.to_recording("dynamic").unwrap();
    assert_eq!(raw.len(), record.time.len());
    // Gravity acts in the direction of insertion, against the force that pushes the rod.
    let seal_alone = raw.clone().without_moving_mass(0.1, -9.81).unwrap();
    let (bias, spread) = error(&seal_alone.force);
    let (raw_bias, raw_spread) = error(&raw.force);
    assert!(raw_bias > 0.9 && raw_spread > 0.1, "{raw_bias} N, {raw_spread} N");
    // 25 mN of sensor noise, and the acceleration from positions with 4 µm counts.
    assert!(bias < 0.01 && spread < 0.06, "{bias} N, {spread} N");
}

#[test]
fn encoder_gives_whole_counts() {
    let record = go(&BenchConfig::default(), Protocol::Surgeon, &[plausible()], 5);
    for (seen, truth) in record.position.iter().zip(&record.truth.position) {
        let counts = seen / ENCODER_COUNT;
        assert!((counts - counts.round()).abs() < 1e-6, "{seen} m");
        assert!((seen - truth).abs() <= 0.5 * ENCODER_COUNT + 1e-12);
    }
    let down = BenchConfig::from_toml("[encoder]\nrounding = \"down\"").unwrap();
    let record = go(&down, Protocol::Step, &[plausible()], 5);
    for (seen, truth) in record.position.iter().zip(&record.truth.position) {
        let below = truth - seen;
        assert!((-1e-12..ENCODER_COUNT + 1e-12).contains(&below), "{below} m");
    }
}

#[test]
fn force_noise_is_as_declared() {
    for bandwidth in [500.0, 50.0] {
        let mut noisy = BenchConfig::default();
        noisy.force_sensor.noise_bandwidth_hz = bandwidth;
        let mut quiet = noisy.clone();
        quiet.force_sensor.noise_n = 0.0;
        let seal = [plausible()];
        let noisy = go(&noisy, Protocol::Surgeon, &seal, 9);
        let quiet = go(&quiet, Protocol::Surgeon, &seal, 9);
        let noise: Vec<f64> = noisy.force.iter().zip(&quiet.force).map(|(a, b)| a - b).collect();
        // 60 000 samples, 10 000 of them independent at 50 Hz: 2 % is three standard errors.
        assert!((rms_about_mean(&noise) / 0.025 - 1.0).abs() < 0.02);
        assert!(mean(&noise).abs() < 0.001);
        let neighbours: f64 = noise.windows(2).map(|w| w[0] * w[1]).sum();
        let correlation = neighbours / noise.iter().map(|n| n * n).sum::<f64>();
        if bandwidth > 400.0 {
            assert!(correlation < 0.1, "{correlation}");
        } else {
            assert!(correlation > 0.6, "{correlation}");
        }
    }
}

#[test]
fn sensor_saturates_at_its_range() {
    let record = go(&BenchConfig::default(), Protocol::Step, &[linear_seal(30.0, 5.0)], 2);
    let highest = record.force.iter().fold(f64::MIN, |a, &b| a.max(b));
    let lowest = record.force.iter().fold(f64::MAX, |a, &b| a.min(b));
    assert_eq!((lowest, highest), (-22.0, 22.0));
    let clipped = record.force.iter().filter(|f| f.abs() == 22.0).count();
    assert!(clipped > 500 && record.events.saturated_samples > 500);
    let weak = go(&BenchConfig::default(), Protocol::Step, &[plausible()], 2);
    assert_eq!(weak.events.saturated_samples, 0);
}

#[test]
fn standstill_reads_tare_and_weight() {
    let mut config = BenchConfig::default();
    config.rig.homing_m = 0.0;
    config.force_sensor.tare_n = 0.3;
    let surgeon = &mut config.protocol.surgeon;
    (surgeon.hold_probability, surgeon.reversal_probability) = (0.9, 0.1);
    (surgeon.hold_shortest_s, surgeon.hold_longest_s) = (20.0, 20.0);
    (surgeon.tremor_rms_m, surgeon.duration_s) = (0.0, 10.0);
    // The first action is a hold for nine seeds of ten, including this one.
    let record = go(&config, Protocol::Surgeon, &[plausible()], 1);
    assert!(record.truth.velocity.iter().all(|v| v.abs() < 1e-6));
    let expected = 0.3 - 0.04 * 9.81;
    assert!((mean(&record.force) - expected).abs() < 0.002, "{}", mean(&record.force));
}

#[test]
fn same_seed_same_run_other_seed_other_run() {
    let config = BenchConfig::default();
    for protocol in [Protocol::Step, Protocol::Dynamic, Protocol::Surgeon] {
        let seal = [plausible()];
        let first = go(&config, protocol, &seal, 11);
        assert_eq!(first, go(&config, protocol, &seal, 11));
        assert_ne!(first.force, go(&config, protocol, &seal, 12).force);
    }
}

#[test]
fn noise_sources_do_not_disturb_each_other() {
    let seal = [plausible()];
    let mut quiet = BenchConfig::default();
    quiet.force_sensor.noise_n = 0.0;
    quiet.encoder.noise_m = 1e-5;
    let loud = go(&BenchConfig::default(), Protocol::Surgeon, &seal, 4);
    assert_eq!(loud.truth, go(&quiet, Protocol::Surgeon, &seal, 4).truth);
}

#[test]
fn repeated_strokes_differ_by_the_fluctuation_declared() {
    let mut config = ideal();
    config.protocol.steady.fastest_m_s = 0.05;
    config.protocol.steady.slowest_m_s = 0.05;
    config.protocol.steady.cycles_per_speed = 100;
    let level = |config: &BenchConfig| {
        let truth = go(config, Protocol::Steady, &[plausible()], 8).truth;
        let levels: Vec<f64> = strokes(&truth.reference_velocity)
            .into_iter()
            .map(|stroke| mean(&truth.seal_force[stroke.start + 1200..stroke.end - 200]).abs())
            .collect();
        assert_eq!(levels.len(), 200);
        rms_about_mean(&levels) / mean(&levels)
    };
    assert!(level(&config) < 1e-4);
    config.fluctuation.stroke_fraction = 0.02;
    // 200 levels: 15 % is three standard errors.
    assert!((level(&config) / 0.02 - 1.0).abs() < 0.15, "{}", level(&config));
    config.fluctuation.stroke_fraction = 0.0;
    config.fluctuation.ripple_fraction = 0.02;
    assert!((0.002..0.02).contains(&level(&config)), "{}", level(&config));
}

#[test]
fn force_does_not_jump_at_a_reversal() {
    let mut config = ideal();
    config.fluctuation.stroke_fraction = 0.05;
    let truth = go(&config, Protocol::Validation, &[plausible()], 8).truth;
    // 1.65 N/mm at 0.1 m/s and 1 kHz is 0.17 N per sample.
    let largest = truth.seal_force.windows(2).fold(0.0, |a: f64, w| a.max((w[1] - w[0]).abs()));
    assert!(largest < 0.2, "{largest} N");
}

#[test]
fn homing_leaves_the_seal_bent_backwards() {
    let record = go(&ideal(), Protocol::Step, &[plausible()], 1);
    assert!((record.truth.seal_force[0] + 3.0).abs() < 0.1, "{}", record.truth.seal_force[0]);
    assert!(record.truth.deflections[0][0] < -7.5e-3);
}

#[test]
fn constant_push_gives_cycles_at_about_the_speed_asked_for() {
    let config = BenchConfig::default();
    let record = go(&config, Protocol::Dynamic, &[plausible()], 1);
    let truth = &record.truth;
    assert!(truth.position.iter().all(|x| (0.0..=0.16).contains(x)));
    let reversals = truth.velocity.windows(2).filter(|w| w[0] * w[1] < 0.0).count();
    assert!((9..=10).contains(&reversals), "{reversals}");
    let (insertion, withdrawal) = record.events.push;
    assert!(insertion > 5.0 && (insertion + withdrawal).abs() < 1e-9);
    let sliding: Vec<f64> = (0..truth.velocity.len())
        .filter(|&i| truth.velocity[i] > 0.0 && (0.055..0.075).contains(&truth.position[i]))
        .map(|i| truth.velocity[i])
        .collect();
    assert!((mean(&sliding) / 0.05 - 1.0).abs() < 0.15, "{} m/s", mean(&sliding));
}

#[test]
fn push_too_weak_for_the_guide_is_a_stall() {
    let mut config = BenchConfig::default();
    config.motor.cogging_n = 5.0;
    config.protocol.dynamic.stroke_timeout_s = 2.0;
    let error = run(&config, Protocol::Dynamic, &[plausible()], 1).unwrap_err();
    assert!(matches!(error, BenchError::Stalled { stroke: 1, .. }), "{error}");
}

#[test]
fn surgeon_has_tremor_holds_and_partial_reversals() {
    let config = BenchConfig::default();
    let record = go(&config, Protocol::Surgeon, &[plausible()], 21);
    let truth = &record.truth;
    assert_eq!(record.time.len(), 60_001);
    let in_band = tremor_rms(&truth.position, 8.0, 12.0);
    let above = tremor_rms(&truth.position, 14.0, 18.0);
    assert!((4e-5..1.2e-4).contains(&in_band), "{in_band} m");
    assert!(above < 0.2 * in_band, "{above} m against {in_band} m");
    let smooth = smoothed(&truth.position, 250);
    let still = smooth.windows(300).filter(|w| (w[299] - w[0]).abs() < 1e-4).count();
    assert!(still > 2_000, "{still} samples of rest");
    let partial = partial_reversals(&truth.deflections[0], 8e-3);
    assert!(partial >= 5, "{partial} partial reversals");
}

/// Rms of the part of `position` (1 kHz) between two frequencies: Hann window and Fourier lines of
/// blocks of 1.024 s.
fn tremor_rms(position: &[f64], low: f64, high: f64) -> f64 {
    let size = 1024;
    let blocks = position.chunks_exact(size);
    let count = blocks.len();
    let mut power = 0.0;
    for block in blocks {
        // Differences flatten the steep spectrum of the large movements, which would otherwise leak
        // into the band.
        let window = |i: usize| 0.5 - 0.5 * (std::f64::consts::TAU * i as f64 / size as f64).cos();
        for line in 0..size / 2 {
            let frequency = line as f64 * 1000.0 / size as f64;
            if frequency < low || frequency > high {
                continue;
            }
            let (mut re, mut im) = (0.0, 0.0);
            for (i, pair) in block.windows(2).enumerate() {
                let phase = std::f64::consts::TAU * (line * i) as f64 / size as f64;
                let value = window(i) * (pair[1] - pair[0]) * 1000.0;
                re += value * phase.cos();
                im += value * phase.sin();
            }
            let speed = 2.0 * (re * re + im * im) / (size as f64).powi(2) / 0.375;
            power += speed / (std::f64::consts::TAU * frequency).powi(2);
        }
    }
    (power / count as f64).sqrt()
}

fn smoothed(values: &[f64], width: usize) -> Vec<f64> {
    values.windows(width).map(mean).collect()
}

/// Turning points of the deflection well inside (-c, c), at least 0.3 mm apart.
fn partial_reversals(deflection: &[f64], c: f64) -> usize {
    let (mut count, mut turning, mut direction) = (0, deflection[0], 1.0);
    for &z in deflection {
        if (z - turning) * direction > 0.0 {
            turning = z;
        } else if (turning - z) * direction > 3e-4 {
            count += usize::from(turning.abs() < 0.9 * c);
            direction = -direction;
            turning = z;
        }
    }
    count
}

#[test]
fn every_protocol_is_finite_and_within_the_stops() {
    let config = BenchConfig::default();
    for seed in 0..6 {
        let seal = [Element::new(random_plausible_seal(seed)).unwrap()];
        for protocol in Protocol::ALL {
            let record = go(&config, protocol, &seal, seed);
            let truth = &record.truth;
            let columns = [
                &record.time,
                &record.position,
                &record.velocity,
                &record.force,
                &truth.seal_force,
                &truth.acceleration,
                &truth.deflections[0],
            ];
            assert!(columns.iter().all(|column| column.len() == record.time.len()));
            assert!(columns.iter().all(|column| column.iter().all(|v| v.is_finite())));
            assert!(truth.position.iter().all(|x| (0.0..=0.16).contains(x)));
            assert_eq!(record.events.stop_hits, 0, "{protocol}, seed {seed}");
        }
    }
}

#[test]
fn stops_hold_a_rig_without_control() {
    let mut config = BenchConfig::default();
    // The carriage cannot stop in time.
    config.protocol.dynamic =
        PushCycles { stroke_m: 0.140, sliding_speed_m_s: 0.9, ..config.protocol.dynamic };
    config.motor.drag_n_s_m = 5.0;
    let record = go(&config, Protocol::Dynamic, &[], 1);
    assert!(record.truth.position.iter().all(|x| (0.0..=0.16).contains(x)));
    assert!(record.events.stop_hits > 0);
}

#[test]
fn several_elements_add_up() {
    let config = ideal();
    let two = go(&config, Protocol::Step, &[linear_seal(1.0, 2.0), linear_seal(2.0, 3.0)], 1);
    let one = go(&config, Protocol::Step, &[linear_seal(3.0, 5.0)], 1);
    assert_eq!(two.truth.deflections.len(), 2);
    // Equal half widths and proportional stiffness, but not viscous damping: equal once all
    // elements slide.
    let settled = 900;
    let difference = two.truth.seal_force[settled] - one.truth.seal_force[settled];
    assert!(difference.abs() < 1e-3, "{difference} N");
}

#[test]
fn weak_motor_is_reported() {
    let mut config = BenchConfig::default();
    config.motor.peak_force_n = 4.0;
    let record = go(&config, Protocol::Step, &[plausible()], 1);
    assert!(record.events.motor_limited_steps > 0);
    assert_eq!(
        go(&BenchConfig::default(), Protocol::Step, &[plausible()], 1).events.motor_limited_steps,
        0
    );
}

#[test]
fn shipped_document_is_the_default_and_survives_writing() {
    let shipped = BenchConfig::from_toml(trocar::bench::config::DEFAULT_TOML).unwrap();
    assert_eq!(shipped, BenchConfig::default());
    assert_eq!(BenchConfig::from_toml("").unwrap(), shipped);
    assert_eq!(BenchConfig::from_toml(&shipped.to_toml()).unwrap(), shipped);
    // Values of the paper's section IV.
    assert_eq!(shipped.rig.stroke_m, 0.26);
    assert_eq!(shipped.rig.stroke_limit_m, 0.16);
    assert_eq!(shipped.encoder.resolution_m, ENCODER_COUNT);
    assert_eq!(shipped.force_sensor.range_n, 22.0);
}

#[test]
fn every_key_of_the_shipped_document_is_explained() {
    for line in trocar::bench::config::DEFAULT_TOML.lines() {
        if line.contains(" = ") && !line.starts_with('#') {
            let comment = line.split_once('#').map_or("", |(_, text)| text.trim());
            let alone = line.trim_start().starts_with('#');
            assert!(alone || comment.len() > 10, "{line}");
        }
    }
}

#[test]
fn a_document_changes_only_what_it_names() {
    let text = "[protocol.steady]\nstroke_m = 0.1\ncycles_per_speed = 2\n[rod]\ngravity_m_s2 = 0\n";
    let mut expected = BenchConfig::default();
    expected.protocol.steady.stroke_m = 0.1;
    expected.protocol.steady.cycles_per_speed = 2;
    expected.rod.gravity_m_s2 = 0.0;
    assert_eq!(BenchConfig::from_toml(text).unwrap(), expected);
}

#[test]
fn wrong_documents_are_explained() {
    let cases = [
        ("[rig]\nstroke_limit_mm = 160", "line 2: unknown key rig.stroke_limit_mm"),
        ("\n[protocl]\n", "line 2: unknown key protocl"),
        ("[rig]\nstart_m = \"2 cm\"", "line 2: rig.start_m must be a number, got a text"),
        ("[rig]\nsubsteps = 1.5", "line 2: rig.substeps must be a whole number, got a number"),
        ("rig = 3", "line 1: rig must be a section, got a whole number"),
        ("[rig]\nstart_m = ", "not a TOML document"),
        (
            "# rig\n[motor]\nslider_mass_kg = -1",
            "line 3: motor.slider_mass_kg must be positive, got -1",
        ),
        ("[encoder]\nnoise_m = nan", "line 2: encoder.noise_m must be zero or positive, got NaN"),
        ("[encoder]\nrounding = \"up\"", "line 2: encoder.rounding: unknown variant `up`"),
        ("[encoder]\nrounding = \"none\"", "line 2: encoder.rounding: unknown variant `none`"),
        (
            "[protocol.validation]\norder = \"nearest\"",
            "line 2: protocol.validation.order: unknown variant `nearest`",
        ),
        (
            "[protocol.steady]\norder = \"down\"",
            "expected one of `ascending`, `shuffled`, `up_and_down`",
        ),
        (
            "[protocol.steady]\norder = 1",
            "line 2: protocol.steady.order must be a text, got a whole number",
        ),
        (
            "[protocol.steady]\nturning_scatter_m = 0.03",
            "line 2: protocol.steady.turning_scatter_m must be between 0 and 0.02",
        ),
        (
            "[protocol.steady]\nturning_scatter_m = -0.001",
            "line 2: protocol.steady.turning_scatter_m must be between 0",
        ),
        // The shortest stroke must reach the highest speed.
        (
            "[protocol.validation]\nturning_scatter_m = 0.016",
            "line 2: protocol.validation.turning_scatter_m must be between 0 and 0.015",
        ),
        (
            "[fluctuation]\ndrift_fraction = 3",
            "line 2: fluctuation.drift_fraction must be between -0.5 and 0.5, got 3",
        ),
        (
            "[fluctuation]\ndrift_time_s = 0",
            "line 2: fluctuation.drift_time_s must be positive, got 0",
        ),
        ("[rig]\nsubsteps = -3", "line 2: rig.substeps must be between 0"),
        ("[protocol.steady]\nstroke_m = 0.2", "line 2: protocol.steady.stroke_m must be between"),
        ("[protocol.step]\nstroke_m = 0.001", "protocol.step.stroke_m must be between 0.00125"),
        // Metres expected, but given in millimetres.
        ("[protocol.dynamic]\nstroke_m = 60", "line 2: protocol.dynamic.stroke_m must be between"),
    ];
    for (text, message) in cases {
        let error = BenchConfig::from_toml(text).unwrap_err().to_string();
        assert!(error.contains(message), "{text:?} gave {error:?}");
    }
    let mut config = BenchConfig::default();
    config.controller.proportional_n_s_m = 0.0;
    let error = run(&config, Protocol::Step, &[], 0).unwrap_err();
    assert!(matches!(error, BenchError::Config(ConfigError::OutOfRange { line: None, .. })));
}

#[test]
fn protocols_have_names() {
    for protocol in Protocol::ALL {
        assert_eq!(protocol.name().parse(), Ok(protocol));
    }
    let error = "stedy".parse::<Protocol>().unwrap_err();
    assert!(error.to_string().contains("validation"), "{error}");
}

#[test]
fn random_seals_are_plausible_and_differ() {
    let ranges = PlausibleSeals::default();
    let mut snapping_through = 0;
    for seed in 0..300 {
        let params = random_plausible_seal(seed);
        assert_eq!(params, random_plausible_seal(seed));
        let element = Element::new(params).unwrap();
        let force = &element.params().deformation;
        let c = force.half_width();
        assert!((2e-3..=9e-3).contains(&c));
        let mean_force = 0.5 * (params.insertion.coulomb_force + params.withdrawal.coulomb_force);
        assert!((0.5..=6.0).contains(&mean_force));
        snapping_through += u32::from(force.softening_interval().is_some());
        for i in 1..1000 {
            let z = c * (f64::from(i) / 500.0 - 1.0);
            assert!(force.half_gap(z) >= 0.0);
            assert!(force.insertion().force(z) < params.insertion.static_force);
            assert!(force.withdrawal().force(z) > -params.withdrawal.static_force);
        }
    }
    assert!((75..=225).contains(&snapping_through), "{snapping_through} of 300 snap through");
    assert_ne!(random_plausible_seal(1), random_plausible_seal(2));
    let symmetric = PlausibleSeals { friction_asymmetry: 0.0, ..ranges };
    let params = random_seal(&symmetric, 7);
    assert_eq!(params.insertion, params.withdrawal);
}

#[test]
fn protocols_run_much_faster_than_real_time() {
    let config = BenchConfig::default();
    for protocol in Protocol::ALL {
        let begin = std::time::Instant::now();
        let record = go(&config, protocol, &[plausible()], 1);
        let wall = begin.elapsed().as_secs_f64();
        let recorded = record.time[record.time.len() - 1];
        println!("{protocol:>10}: {recorded:6.1} s recorded in {:5.1} ms", 1e3 * wall);
        assert!(recorded > 20.0 * wall, "{protocol}: {recorded} s took {wall} s");
    }
}

/// Every number of the rig and of a protocol, as small and as large as the document takes it: the
/// length is known before the run, right, and bounded.
#[test]
fn no_number_makes_a_recording_without_end() {
    const MOST: usize = 5_000_000;
    // Long enough to see that a run ends, short enough for a test.
    const SHORT: usize = 20_000;
    let (mut refused, mut ran) = (0, 0);
    let document: toml::Table = trocar::bench::config::DEFAULT_TOML.parse().unwrap();
    for protocol in Protocol::ALL {
        for section in ["rig".to_owned(), format!("protocol.{protocol}")] {
            let names = section.split('.');
            let table = names.fold(&document, |table, name| table[name].as_table().unwrap());
            for (key, default) in table {
                let whole = [1, 1000, 1_000_000].map(|count: u32| count.to_string());
                let numbers =
                    [1e-320, 1e-7, 1e-3, 10.0, 1e7, 1e300].map(|number| format!("{number:e}"));
                let values = if default.is_integer() { whole.to_vec() } else { numbers.to_vec() };
                for value in values {
                    let text = format!("[{section}]\n{key} = {value}\n");
                    let Ok(config) = BenchConfig::from_toml(&text) else { continue };
                    let said = length(&config, protocol);
                    match said {
                        Ok(samples) if samples < SHORT => {
                            let made = run(&config, protocol, &[plausible()], 1);
                            let made = made.map_or(0, |run| run.time.len());
                            assert!(made <= samples + 1, "{text}: {made} samples, said {samples}");
                            ran += 1;
                        }
                        Ok(samples) => assert!(samples <= MOST, "{text}: {samples}"),
                        Err(error) => {
                            let text = error.to_string();
                            assert!(
                                text.contains("samples at") && text.contains("hint: "),
                                "{text}"
                            );
                            assert!(run(&config, protocol, &[plausible()], 1) == Err(error));
                            refused += 1;
                        }
                    }
                }
            }
        }
    }
    assert!(refused > 15 && ran > 15, "{refused} refused, {ran} run");
}
