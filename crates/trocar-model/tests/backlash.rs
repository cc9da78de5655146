//! What the backlash filter promises: silence at rest, every true reversal once, and a bounded
//! price in force.

use trocar_model::{BacklashFilter, BacklashState, Direction, Element, ElementParams, ParamError};

/// Resolution of the encoder, m.
const RESOLUTION: f64 = 4e-6;

const PERIOD: f64 = 1e-3;

/// Samples of a hold of 60 s.
const HOLD: usize = 60_000;

/// A small generator of its own: 64-bit linear congruential, the upper bits used.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03);
        (0..8).for_each(|_| {
            random.uniform();
        });
        random
    }

    /// In [0, 1).
    fn uniform(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal, Box-Muller.
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// The reading at `position`, m, with noise of standard deviation `noise`, m, before rounding.
    fn read(&mut self, position: f64, noise: f64) -> f64 {
        ((position + noise * self.normal()) / RESOLUTION).round() * RESOLUTION
    }
}

fn filter() -> BacklashFilter {
    BacklashFilter::for_resolution(RESOLUTION).unwrap()
}

fn seal() -> Element {
    Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap()
}

/// Highest minus lowest force, N, over a hold under `readings` that begins in the middle of a
/// deformation.
fn ripple(filter: &BacklashFilter, readings: &[f64]) -> f64 {
    let seal = seal();
    let (mut state, mut filtered) = (seal.rest_state(-8e-3), BacklashState::default());
    let start = readings[0] - 5e-3;
    for k in 0..=100 {
        let displacement = filter.displacement(&mut filtered, start + 5e-5 * f64::from(k));
        seal.step(&mut state, displacement, PERIOD);
    }
    // What the end of the deformation and the first readings of the hold leave open is settled
    // after a moment.
    let forces = readings
        .iter()
        .map(|x| seal.step(&mut state, filter.displacement(&mut filtered, *x), PERIOD));
    let (low, high) = forces
        .skip(100)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), f| (low.min(f), high.max(f)));
    high - low
}

#[test]
fn flicker_of_a_resting_position_makes_no_force_at_all() {
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let base = (1000.0 * random.uniform()).round();
        let readings: Vec<f64> = (0..HOLD)
            .map(|_| (base + (3.0 * random.uniform()).floor() - 1.0) * RESOLUTION)
            .collect();
        assert_eq!(ripple(&filter(), &readings), 0.0);
        let bare = ripple(&BacklashFilter::new(0.0).unwrap(), &readings);
        assert!(bare > 1e-4, "without a filter ±1 reading shows in the force, got {bare} N");
    }
}

#[test]
fn noise_beyond_the_width_is_damped() {
    let mut random = Random::new(1);
    let readings: Vec<f64> = (0..HOLD).map(|_| random.read(0.0101, 2e-6)).collect();
    let (with, without) =
        (ripple(&filter(), &readings), ripple(&BacklashFilter::new(0.0).unwrap(), &readings));
    println!(
        "hold of 60 s under 2 um of noise: {:.2} mN with, {:.2} mN without",
        1e3 * with,
        1e3 * without
    );
    assert!(with < 0.6 * without, "{with} {without}");
}

/// Reversals reported over the readings.
fn reversals(filter: &BacklashFilter, readings: impl Iterator<Item = f64>) -> usize {
    let mut state = BacklashState::default();
    readings
        .filter(|x| {
            filter.displacement(&mut state, *x);
            state.turning_point().is_some()
        })
        .count()
}

#[test]
fn a_noisy_hold_has_no_reversal() {
    for noise in [1e-6, 2e-6] {
        for seed in 0..120 {
            let mut random = Random::new(seed);
            // Anywhere between two readings; every other hold after a motion.
            let rest = RESOLUTION * (1000.0 + random.uniform());
            let approach = if seed % 2 == 0 { 400 } else { 0 };
            let path = (0..approach)
                .rev()
                .map(|k| rest - 1e-5 * f64::from(k))
                .chain(std::iter::repeat_n(rest, HOLD));
            let readings: Vec<f64> = path.map(|x| random.read(x, noise)).collect();
            assert_eq!(
                reversals(&filter(), readings.into_iter()),
                0,
                "seed {seed}, noise {noise} m"
            );
        }
    }
}

#[test]
fn flicker_of_one_reading_is_no_reversal() {
    let mut random = Random::new(2);
    let readings = (0..20 * HOLD).map(|_| ((3.0 * random.uniform()).floor() - 1.0) * RESOLUTION);
    assert_eq!(reversals(&filter(), readings), 0);
}

/// Reversals of 20 um that are missed, and surplus ones, over `count` reversals whose `shape`
/// gives the position between 0 and 20 um at each of `period` samples.
fn misses(noise: f64, count: usize, period: usize, shape: Shape) -> (usize, usize) {
    const HEIGHT: f64 = 20e-6;
    let (mut missed, mut surplus) = (0, 0);
    let mut random = Random::new(7);
    for _ in 0..count / 20 {
        let mut state = BacklashState::default();
        let rest = RESOLUTION * random.uniform();
        let filter = filter();
        let approach = (0..200).rev().map(|k| rest - 1e-6 * f64::from(k)).chain([rest; 10]);
        approach.for_each(|x| {
            filter.displacement(&mut state, random.read(x, noise));
        });
        let mut found = 0_usize;
        for _ in 0..10 {
            for k in 0..period {
                let x = rest - HEIGHT * shape(k as f64 / period as f64);
                filter.displacement(&mut state, random.read(x, noise));
                found += usize::from(state.turning_point().is_some());
            }
        }
        // The last rise ends the last cycle: it needs a moment to be certain.
        for _ in 0..10 {
            filter.displacement(&mut state, random.read(rest, noise));
            found += usize::from(state.turning_point().is_some());
        }
        missed += 20_usize.saturating_sub(found);
        surplus += found.saturating_sub(20);
    }
    (missed, surplus)
}

/// Way back, from 0 to 1, over the phase of a period from 0 to 1.
type Shape = fn(f64) -> f64;

/// Up and down at once, with rests of half a period.
fn square(phase: f64) -> f64 {
    f64::from(u8::from(phase < 0.5))
}

fn triangle(phase: f64) -> f64 {
    1.0 - (2.0 * phase - 1.0).abs()
}

fn sine(phase: f64) -> f64 {
    0.5 - 0.5 * (std::f64::consts::TAU * phase).cos()
}

/// Specified: turning points that last for 10 readings, noise up to 1 um.
#[test]
fn reversals_of_20_um_are_found_once() {
    const COUNT: usize = 100_000;
    let specified: [(&str, usize, Shape); 3] =
        [("rests of 10", 20, square), ("10 Hz", 100, sine), ("0.2 mm/s", 200, triangle)];
    let beyond: [(&str, usize, Shape); 2] = [("rests of 5", 10, square), ("1 mm/s", 40, triangle)];
    for noise in [0.0, 1e-6] {
        for (name, period, shape) in specified {
            assert_eq!(misses(noise, COUNT, period, shape), (0, 0), "{name}, noise {noise} m");
        }
    }
    for (name, period, shape) in specified.into_iter().chain(beyond) {
        let (missed, surplus) = misses(2e-6, COUNT, period, shape);
        println!("noise 2 um, {name}: {missed} of {COUNT} missed");
        assert_eq!(surplus, 0, "{name}");
    }
}

#[test]
fn a_reversal_reports_direction_and_turning_point() {
    let (filter, mut state) = (filter(), BacklashState::default());
    let mut feed = |x: f64| {
        filter.displacement(&mut state, x);
        state
    };
    assert_eq!(feed(0.0).direction(), None);
    (1..=100).for_each(|k| assert_eq!(feed(1e-5 * f64::from(k)).turning_point(), None));
    assert_eq!(feed(1e-3).direction(), Some(Direction::Insertion));
    feed(1e-3);
    let reported: Vec<f64> =
        (0..50).filter_map(|k| feed(1e-3 - 1e-5 * f64::from(k)).turning_point()).collect();
    assert_eq!(reported.len(), 1);
    assert!((reported[0] - 1e-3).abs() < 1e-12, "{reported:?}");
    assert_eq!(feed(5e-4).direction(), Some(Direction::Withdrawal));
}

/// From rest the model lags by ε, after a reversal by 2ε; in a steady slide the lag makes no force.
#[test]
fn the_price_in_force_is_stiffness_times_width() {
    let (filter, seal) = (filter(), seal());
    let deformation = &seal.params().deformation;
    let steepest = (-8000..8000)
        .map(|k| {
            let z = 1e-6 * f64::from(k);
            (deformation.mid(z + 1e-7) - deformation.mid(z)).abs() / 1e-7
        })
        .fold(0.0, f64::max);
    let stiffness = steepest + deformation.yield_stiffness();
    for speed in [1e-3, 15e-3, 0.1] {
        let (mut filtered, mut with, mut without) =
            (BacklashState::default(), seal.rest_state(0.0), seal.rest_state(0.0));
        let mut x = 0.0;
        filter.displacement(&mut filtered, x);
        for (sense, lag) in [(1.0, 1.0), (-1.0, 2.0)] {
            let mut last = f64::INFINITY;
            for _ in 0..(0.04 / (speed * PERIOD)) as usize {
                x += sense * speed * PERIOD;
                seal.step(&mut without, sense * speed * PERIOD, PERIOD);
                seal.step(&mut with, filter.displacement(&mut filtered, x), PERIOD);
                last = (with.force() - without.force()).abs();
                // The viscous part of a slide that lags is at most β·v for one more sample.
                let slide = seal.params().insertion.viscous_damping * speed;
                assert!(
                    last <= lag * stiffness * filter.width() + slide,
                    "{last} N at {speed} m/s"
                );
            }
            assert!(last < 1e-9, "{last} N in a steady slide");
        }
    }
}

#[test]
fn zero_width_is_the_identity() {
    let filter = BacklashFilter::new(0.0).unwrap();
    let (mut random, mut state, mut last) = (Random::new(3), BacklashState::default(), 0.25);
    filter.displacement(&mut state, last);
    for _ in 0..10_000 {
        let x = 0.1 * random.normal();
        assert_eq!(filter.displacement(&mut state, x), x - last);
        assert_eq!(state.position(), Some(x));
        last = x;
    }
}

#[test]
fn the_way_through_a_monotone_move_may_be_cut_at_will() {
    let filter = filter();
    for seed in 0..100 {
        let mut random = Random::new(seed);
        let (start, end) = (0.1 * random.uniform(), 0.1 * random.uniform());
        let mut cuts: Vec<f64> =
            (0..1 + seed * 7).map(|_| start + (end - start) * random.uniform()).collect();
        cuts.sort_by(f64::total_cmp);
        if end < start {
            cuts.reverse();
        }
        let total = |cuts: &[f64]| {
            let mut state = BacklashState::default();
            filter.displacement(&mut state, start);
            let sum: f64 =
                cuts.iter().chain([&end]).map(|x| filter.displacement(&mut state, *x)).sum();
            (sum, state.position())
        };
        let (whole, cut) = (total(&[]), total(&cuts));
        assert_eq!(whole.1, cut.1);
        assert!((whole.0 - cut.0).abs() < 1e-15, "{} m", whole.0 - cut.0);
    }
}

#[test]
fn a_position_that_is_not_finite_changes_nothing() {
    let (filter, mut state) = (filter(), BacklashState::default());
    assert_eq!(filter.displacement(&mut state, f64::NAN), 0.0);
    assert_eq!(state, BacklashState::default());
    filter.displacement(&mut state, 0.01);
    filter.displacement(&mut state, 0.02);
    let before = state;
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(filter.displacement(&mut state, bad), 0.0);
        assert_eq!(state, before);
    }
    filter.displacement(&mut state, -f64::MAX);
    let far = state;
    assert_eq!(filter.displacement(&mut state, f64::MAX), 0.0, "a displacement beyond all numbers");
    assert_eq!(state, far);
}

#[test]
fn bad_widths_are_named() {
    assert!(matches!(
        BacklashFilter::new(-1e-6),
        Err(ParamError::Negative { name: "backlash_width", .. })
    ));
    assert!(matches!(
        BacklashFilter::new(f64::NAN),
        Err(ParamError::NotFinite { name: "backlash_width", .. })
    ));
    let resolution = BacklashFilter::for_resolution(f64::INFINITY);
    assert!(matches!(resolution, Err(ParamError::NotFinite { name: "resolution", .. })));
}
