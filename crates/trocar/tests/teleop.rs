//! Loops beside closed forms and published boundaries.

use std::convert::Infallible;
use std::f64::consts::TAU;

use nalgebra::Complex;
use trocar::teleop::advise::{advise, map};
use trocar::teleop::config::{
    Architecture, Channel, Config, Control, Device, Operator, Sensor, Tissue,
};
use trocar::teleop::hybrid::{Hybrid, tissue_impedance};
use trocar::teleop::merit::Merit;
use trocar::teleop::stability::{Trial, boundary};
use trocar::teleop::{Loop, Sample};
use trocar_model::{Classical, Seal, SlidingFriction, StaticFriction, Trocar};

/// Coulomb friction of `force`, N.
fn coulomb(force: f64) -> Trocar {
    let friction = StaticFriction::new(SlidingFriction::coulomb(force, 0.0)).unwrap();
    Trocar::of_seal(Seal::Classical(Classical::Static(friction)))
}

/// So little friction that it is none.
fn none() -> Trocar {
    coulomb(1e-12)
}

fn run(
    config: &Config,
    trocar: &Trocar,
    seconds: f64,
    hand: impl Fn(f64) -> (f64, f64),
) -> Vec<Sample> {
    let count = (seconds / config.sample_time_s).round() as usize;
    let mut tried = Loop::new(config, *trocar, *trocar, hand(0.0).0).unwrap();
    (0..count).map(|_| tried.step(&hand).expect("stable")).collect()
}

/// A master that nobody and nothing moves.
fn clamped() -> (Operator, Device) {
    let operator = Operator { stiffness_n_m: 0.0, damping_n_s_m: 0.0, mass_kg: 0.0 };
    (operator, Device { mass_kg: 1e12, damping_n_s_m: 0.0, encoder_step_m: 0.0 })
}

/// A device on a virtual spring of `stiffness` towards where the clamped master stands.
fn virtual_wall(stiffness: f64, slave: Device) -> Config {
    let (operator, master) = clamped();
    Config {
        operator,
        master,
        slave,
        control: Control {
            architecture: Architecture::PositionPosition,
            stiffness_n_m: stiffness,
            damping_n_s_m: 0.0,
            ..Control::default()
        },
        tissue: Tissue { surface_m: 1.0, ..Tissue::default() },
        ..Config::default()
    }
}

/// COLGATE: a sampled spring on a mass with damping b is passive up to K = 2·b/T, which for a heavy mass is where it
/// becomes unstable.
#[test]
fn a_sampled_spring_is_stable_up_to_twice_the_damping_over_the_sample_time() {
    for damping in [1.0, 2.0, 5.0] {
        let slave = Device { mass_kg: 5.0, damping_n_s_m: damping, encoder_step_m: 0.0 };
        let decays = |stiffness: f64| {
            let config = virtual_wall(stiffness, slave);
            let pushed = Loop::new(&config, none(), none(), 0.1).unwrap().with_slave_velocity(0.01);
            let mut pushed = pushed;
            let mut largest = |count: usize| {
                let step = |_| {
                    pushed
                        .step(|_| (0.1, 0.0))
                        .map_or(f64::INFINITY, |s| (s.slave_position - 0.1).abs())
                };
                (0..count).map(step).fold(0.0, f64::max)
            };
            let first = largest(1000);
            largest(20_000);
            Ok::<bool, Infallible>(largest(1000) < first)
        };
        let expected = 2.0 * damping / 1e-3;
        let found = boundary([0.1 * expected, 10.0 * expected], 1e-3 * expected, decays).unwrap();
        assert!((found.unwrap() / expected - 1.0).abs() < 0.03, "{found:?} {expected}");
    }
}

/// ABBOTT: with Coulomb friction f_c and an encoder of step Δ a virtual spring rests up to K = 2·f_c/Δ.
#[test]
fn coulomb_friction_holds_a_virtual_wall_up_to_twice_itself_over_the_encoder_step() {
    for (friction, step) in [(0.5, 1e-4), (0.2, 5e-5), (1.0, 4e-4)] {
        let slave = Device { mass_kg: 0.1, damping_n_s_m: 0.5, encoder_step_m: step };
        let trocar = coulomb(friction);
        let rests = |stiffness: f64| {
            let config = virtual_wall(stiffness, slave);
            // Between two steps of the encoder: the spring pulls at least with half a step.
            let position = 0.1 + 0.5 * step;
            let mut tried = Loop::new(&config, trocar, trocar, position).unwrap();
            let samples: Vec<Sample> =
                (0..4000).map_while(|_| tried.step(|_| (position, 0.0)).ok()).collect();
            let has_run = samples.len() == 4000;
            let rests = |sample: &Sample| sample.slave_velocity.abs() < 1e-9;
            Ok::<bool, Infallible>(has_run && samples[3000..].iter().all(rests))
        };
        let expected = 2.0 * friction / step;
        let found = boundary([0.1 * expected, 10.0 * expected], 1e-3 * expected, rests).unwrap();
        assert!((found.unwrap() / expected - 1.0).abs() < 0.03, "{found:?} {expected}");
    }
}

/// HIRCHE: over waves with the round trip T a wall is felt as the stiffness 2·b/T, in series with the slave's own spring.
#[test]
fn a_wall_behind_waves_is_felt_as_soft_as_the_delay_makes_it() {
    for (b, delay_s) in [(20.0, 0.01), (20.0, 0.05), (50.0, 0.02)] {
        let spring = 2000.0;
        let config = Config {
            sample_time_s: 1e-4,
            operator: Operator { stiffness_n_m: 1e5, damping_n_s_m: 100.0, mass_kg: 0.0 },
            slave: Device { mass_kg: 1e9, damping_n_s_m: 0.0, encoder_step_m: 0.0 },
            channel: Channel { delay_s, ..Channel::default() },
            control: Control {
                architecture: Architecture::Wave,
                stiffness_n_m: spring,
                damping_n_s_m: b,
                wave_impedance_n_s_m: b,
                ..Control::default()
            },
            ..Config::default()
        };
        // A push of 1 mm/s after a soft start, and the force it has built up.
        let hand = |t: f64| {
            (0.1 + 1e-3 * (t - 0.1 * (1.0 - (-t / 0.1).exp())), 1e-3 * (1.0 - (-t / 0.1).exp()))
        };
        let samples = run(&config, &none(), 8.0, hand);
        let [one, two] = [40_000, 79_000].map(|k: usize| &samples[k]);
        let felt =
            (two.master_force - one.master_force) / (two.master_position - one.master_position);
        let expected = 1.0 / (1.0 / spring + 2.0 * delay_s / (2.0 * b));
        assert!((felt / expected - 1.0).abs() < 0.01, "{felt} {expected}");
    }
}

/// First harmonic of `of` over the last period at `frequency` (Hz).
fn harmonic(samples: &[Sample], frequency: f64, of: impl Fn(&Sample) -> f64) -> Complex<f64> {
    let sum: Complex<f64> = samples
        .iter()
        .map(|sample| {
            let (sin, cos) = (TAU * frequency * sample.time).sin_cos();
            Complex::new(cos, -sin) * of(sample)
        })
        .sum();
    sum * 2.0 / samples.len() as f64
}

fn linear(architecture: Architecture, delay_s: f64) -> Config {
    Config {
        // A grip that holds what the architecture alone would not.
        operator: Operator { stiffness_n_m: 500.0, damping_n_s_m: 50.0, mass_kg: 0.2 },
        master: Device { mass_kg: 0.4, damping_n_s_m: 3.0, encoder_step_m: 0.0 },
        slave: Device { mass_kg: 0.6, damping_n_s_m: 2.0, encoder_step_m: 0.0 },
        channel: Channel { delay_s, ..Channel::default() },
        control: Control {
            architecture,
            stiffness_n_m: 800.0,
            damping_n_s_m: 30.0,
            force_gain: 0.7,
            wave_impedance_n_s_m: 15.0,
            ..Control::default()
        },
        sensor: Sensor { moving_mass_kg: 0.05, ..Sensor::default() },
        tissue: Tissue {
            surface_m: 0.0,
            stiffness_n_m: 150.0,
            damping_n_s_m: 4.0,
            ..Tissue::default()
        },
        ..Config::default()
    }
}

/// Impedance that the operator feels of a loop without friction, by running it.
fn felt(config: &Config, frequency: f64) -> Complex<f64> {
    let hand = |t: f64| {
        let (sin, cos) = (TAU * frequency * t).sin_cos();
        (0.1 + 0.005 * sin, 0.005 * TAU * frequency * cos)
    };
    let periods = (4.0 * frequency).ceil();
    let samples = run(config, &none(), (periods + 1.0) / frequency, hand);
    let last = &samples[(periods / frequency / config.sample_time_s).round() as usize..];
    let force = harmonic(last, frequency, |s| s.operator_force);
    force / harmonic(last, frequency, |s| s.master_velocity)
}

/// The sampled loop tends to what the hybrid matrix says, in proportion to the sample time.
#[test]
fn linear_loops_feel_as_their_hybrid_matrix_says() {
    for architecture in [
        Architecture::PositionPosition,
        Architecture::PositionForce,
        Architecture::FourChannel,
        Architecture::Wave,
    ] {
        for (delay_s, frequency) in [(0.0, 2.0), (0.005, 1.0), (0.005, 5.0)] {
            let mut config = linear(architecture, delay_s);
            let hybrid = Hybrid::of(&config, Complex::new(0.0, 0.0), frequency);
            let expected = hybrid.transmitted(tissue_impedance(&config, frequency));
            let errors = [1e-3, 5e-4, 2.5e-4, 1.25e-4].map(|sample_time_s| {
                config.sample_time_s = sample_time_s;
                felt(&config, frequency) - expected
            });
            let relative = errors.map(|error| error.norm() / expected.norm());
            // Two steps of Richardson for an error of first order.
            let twice = |k: usize| errors[k + 1] * 2.0 - errors[k];
            let left = ((twice(2) * 4.0 - twice(1)) / 3.0).norm() / expected.norm();
            let case =
                format!("{architecture:?} {delay_s} s {frequency} Hz: {relative:.5?} {left:.1e}");
            let ratios = relative.windows(2).map(|pair| pair[0] / pair[1]);
            assert!(ratios.into_iter().all(|ratio| (1.9..2.1).contains(&ratio)), "{case}");
            assert!(left < 1e-6, "{case}");
        }
    }
}

#[test]
fn four_channels_without_delay_are_transparent_to_rounding() {
    let mut config = linear(Architecture::FourChannel, 0.0);
    config.sensor.moving_mass_kg = 0.0;
    for frequency in [0.1, 1.0, 10.0, 100.0] {
        let Hybrid { h11, h12, h21, h22 } = Hybrid::of(&config, Complex::new(0.0, 0.0), frequency);
        assert!(h11.norm() < 1e-9 && h22.norm() < 1e-12, "{h11} {h22}");
        assert!((h12 - 1.0).norm() < 1e-12 && (h21 + 1.0).norm() < 1e-12, "{h12} {h21}");
    }
}

/// LLEWELLYN with waves: any delay leaves the loop passive.
#[test]
fn waves_are_passive_whatever_the_delay_and_position_force_is_not() {
    let margin = |architecture, delay_s: f64| {
        let config = linear(architecture, delay_s);
        (1..400)
            .map(|k| Hybrid::of(&config, Complex::new(0.0, 0.0), 0.1 * f64::from(k)).llewellyn())
            .fold(f64::INFINITY, f64::min)
    };
    for delay_s in [0.0, 0.003, 0.05, 0.3] {
        let waves = margin(Architecture::Wave, delay_s);
        assert!(waves > -1e-9, "{delay_s} s: {waves}");
    }
    assert!(margin(Architecture::PositionForce, 0.05) < -1e-3);
}

/// HANNAFORD: the network gives at no port more than it got, but for what one sample may hold.
#[test]
fn passivity_control_lets_no_port_give_more_than_it_got() {
    let trocar = plausible();
    for architecture in [Architecture::PositionPosition, Architecture::PositionForce] {
        for delay_s in [0.0, 0.01, 0.1] {
            let mut config = linear(architecture, delay_s);
            config.operator = Operator::default();
            config.control.passivity = true;
            config.tissue.surface_m = 0.11;
            config.tissue.stiffness_n_m = 1000.0;
            let hand = |t: f64| {
                let (sin, cos) = (TAU * 0.7 * t).sin_cos();
                (0.1 + 0.015 * sin, 0.015 * TAU * 0.7 * cos)
            };
            let samples = run(&config, &trocar, 10.0, hand);
            let delay = (delay_s * 1e3) as usize;
            let least = samples[delay..]
                .iter()
                .zip(&samples)
                .map(|(now, before)| {
                    let to_slave = before.master_energies[0] - now.slave_energies[1];
                    to_slave.min(before.slave_energies[0] - now.master_energies[1])
                })
                .fold(0.0, f64::min);
            // What one sample holds at the largest force and velocity.
            let largest =
                |of: fn(&Sample) -> f64| samples.iter().map(|s| of(s).abs()).fold(0.0, f64::max);
            let at_slave = largest(|s| s.slave_force) * largest(|s| s.slave_velocity);
            let at_master = largest(|s| s.master_force) * largest(|s| s.master_velocity);
            let of_a_sample = at_slave.max(at_master) * config.sample_time_s;
            assert!(
                least > -of_a_sample,
                "{architecture:?} {delay_s} s: {least} J, {of_a_sample} J a sample"
            );
        }
    }
}

fn plausible() -> Trocar {
    let element = trocar_model::ElementParams::plausible_10_5_mm().unwrap();
    Trocar::of_seal(trocar_model::Element::new(element).unwrap())
}

/// A push into soft tissue and back, slowly.
fn press(time: f64) -> (f64, f64) {
    let (sin, cos) = (0.5 * TAU * time).sin_cos();
    (0.11 - 0.02 * cos, 0.02 * 0.5 * TAU * sin)
}

fn pressed(config: &Config) -> Merit {
    Merit::of(config, &run(config, &plausible(), 2.0, press))
}

/// Halving the step of the plant changes no figure by more than 1 %.
#[test]
fn figures_do_not_depend_on_the_step_of_the_plant() {
    for (delay_s, fraction) in [(0.0, 0.0), (0.0, 0.8), (0.005, 0.9)] {
        let mut config = Config { substeps: 1, ..Config::default() };
        config.tissue.surface_m = 0.1;
        config.channel.delay_s = delay_s;
        config.compensation.fraction = fraction;
        let figures = [1, 2, 4, 8].map(|substeps| {
            let merit = pressed(&Config { substeps, ..config.clone() });
            [
                merit.force_error_rms_n,
                merit.force_error_peak_n,
                merit.displayed_stiffness_n_m.unwrap(),
            ]
        });
        for pair in figures[1..].windows(2) {
            for (coarse, fine) in pair[0].iter().zip(pair[1]) {
                assert!((coarse / fine - 1.0).abs() < 0.01, "{figures:?}");
            }
        }
    }
}

/// How much to take out has two sides and depends on the loop.
#[test]
fn the_best_fraction_has_two_sides_and_depends_on_the_loop() {
    let trocar = plausible();
    let mut config = Config::default();
    config.tissue.stiffness_n_m = 50.0;
    let near = advise(&config, &trocar, &[trocar]).unwrap();
    let displayed = |merit: Option<Merit>| {
        let merit = merit.unwrap();
        merit.displayed_stiffness_n_m.unwrap() / merit.true_stiffness_n_m.unwrap()
    };
    let [with, without] = [near.with, near.without].map(displayed);
    assert!((with - 1.0).abs() < 0.1, "felt as it is: {with}");
    assert!(without > 2.0, "the seal hides soft tissue: {without}");
    // 10 ms each way: not without compensation.
    config.channel.delay_s = 0.01;
    config.tissue.stiffness_n_m = 400.0;
    let far = advise(&config, &trocar, &[trocar]).unwrap();
    assert!(far.without.is_none());
    let [low, high] = far.stable[0];
    assert!((0.5..0.9).contains(&low) && high > 1.0, "{:?}", far.stable);
    // A model 25 % too strong in the compensator: less of it.
    let strong = scaled(&trocar, 1.25);
    let over = advise(&config, &strong, &[trocar]).unwrap();
    let [right, wrong] = [far.fraction, over.fraction].map(Option::unwrap);
    assert!((right / wrong / 1.25 - 1.0).abs() < 0.1, "{right} {wrong}");
}

/// The same seal with all forces times `factor`.
fn scaled(trocar: &Trocar, factor: f64) -> Trocar {
    let seal = trocar.seal();
    let values: Vec<f64> = seal
        .tunables()
        .map(|tunable| {
            if tunable.id.unit().si == "N" || tunable.id.unit().si == "N s/m" {
                factor * tunable.value
            } else {
                tunable.value
            }
        })
        .collect();
    trocar.with_seal(seal.tuned(&values).unwrap())
}

/// The longer the delay, the softer the stiffest tissue held.
#[test]
fn delay_takes_stability_away() {
    let trocar = plausible();
    let delays = [0.0, 0.005, 0.01, 0.02];
    let found =
        map(&Config::default(), [&trocar, &trocar], &delays, &[0.0, 0.8, 1.0], || ()).unwrap();
    for fraction in 0..3 {
        let by_delay: Vec<f64> = found.stiffness_n_m.iter().map(|row| row[fraction]).collect();
        assert!(by_delay.windows(2).all(|pair| pair[1] <= pair[0]), "{by_delay:?}");
        assert!(by_delay[3] < by_delay[0], "{by_delay:?}");
    }
}

#[test]
fn the_shipped_example_is_the_default() {
    assert_eq!(Config::from_toml(trocar::teleop::config::EXAMPLE_TOML), Ok(Config::default()));
    assert_eq!(Config::from_toml(""), Ok(Config::default()));
}

/// Every key of a table, with those of the tables within.
fn keys(table: &toml::Table) -> Vec<String> {
    let within = |(key, value): (&String, &toml::Value)| match value {
        toml::Value::Table(inner) => {
            keys(inner).into_iter().map(|inner| format!("{key}.{inner}")).collect()
        }
        _ => vec![key.clone()],
    };
    table.iter().flat_map(within).collect()
}

#[test]
fn presets_have_every_key() {
    let all = keys(&trocar::teleop::config::EXAMPLE_TOML.parse().unwrap());
    for (name, text) in trocar::teleop::config::PRESETS {
        assert_eq!(keys(&text.parse().unwrap()), all, "{name}");
        assert_eq!(Config::from_toml(text).map(|_| ()), Ok(()), "{name}");
    }
}

#[test]
fn what_is_no_loop_is_refused_with_its_key() {
    for (text, words) in [
        ("[master]\nmass_kg = -0.5", ["master.mass_kg", "from 1e-6"]),
        ("[master]\nmass_kg = nan", ["master.mass_kg", "got NaN"]),
        ("[channel]\ndelay_s = 0.0015", ["multiple of the sample time", "take 0.002 s"]),
        ("[channel]\ndelay_s = -1.0", ["channel.delay_s", "got -1"]),
        ("[channel]\nloss = 1.0", ["channel.loss", "below 1"]),
        ("substeps = 0", ["substeps", "from 1"]),
        ("[slave]\nmas_kg = 1.0", ["mas_kg", "--print-config"]),
        ("sample_time_s = 0.0", ["sample_time_s", "from 1e-6"]),
        ("[motion]\nduration_s = 1e9", ["motion.duration_s", "samples"]),
    ] {
        let error = Config::from_toml(text).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{text}: {error}");
    }
}

#[test]
fn a_loop_that_diverges_says_when_and_gives_no_number() {
    let mut config = Config::default();
    config.channel.delay_s = 0.05;
    config.control.force_gain = 20.0;
    let trocar = plausible();
    let mut tried = Loop::new(&config, trocar, trocar, config.motion.start_m()).unwrap();
    let diverged = tried.run(100_000, |time| config.motion.at(time)).unwrap_err();
    assert!(diverged.time_s > 0.0 && diverged.time_s < 100.0, "{diverged}");
    assert_eq!(tried.step(|_| (config.motion.start_m(), 0.0)), Err(diverged), "it stays unstable");
}

/// What keeps a stable loop in motion is no instability.
#[test]
fn breathing_and_noise_do_not_count_as_unstable() {
    let mut config = Config::default();
    (config.tissue.breathing_m, config.tissue.breathing_hz) = (0.005, 0.25);
    config.sensor.noise_n = 0.3;
    let (trocar, surface) = (plausible(), config.tissue.surface_m);
    assert_eq!(Trial::default().is_stable(&config, &trocar, &trocar, surface), Ok(true));
}

#[test]
fn the_same_seed_gives_the_same_course() {
    let mut config = Config::default();
    (config.sensor.noise_n, config.channel.jitter_s, config.channel.loss) = (0.05, 2e-3, 0.1);
    config.motion.duration_s = 0.5;
    let course = |seed| {
        let config = Config { seed, ..config.clone() };
        run(&config, &plausible(), 0.5, |time| config.motion.at(time))
    };
    assert_eq!(course(7), course(7));
    assert_ne!(course(7), course(8));
}
