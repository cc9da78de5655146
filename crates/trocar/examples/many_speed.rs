//! Cost of many seals under one motion, per seal and sample (`docs/explanation/speed.md`):
//! `cargo run --release -p trocar --example many_speed [REPETITIONS]`.
//!
//! All numbers are medians of repetitions within one run, in which the kinds take turns. Time is
//! that which the process had a processor, where the system tells (Linux): a machine that does
//! other things as well then disturbs little. Two threads are compared by the clock on the wall,
//! which needs two idle cores, and by processor time, which does not.

use std::hint::black_box;
use std::time::Instant;

use trocar::many;
use trocar::many::ensemble::{Ensemble, Motion, Start, squared_errors};
use trocar_model::batch::{Batch, Forces, Lanes, Observe, Squares, blocks};
use trocar_model::{Element, ElementParams, ParamError, Seal, SlidingFriction, Trocar};

const SEALS: [usize; 4] = [1, 8, 64, 1024];

/// Seal-samples of one repetition.
const WORK: usize = 8 << 20;

/// Bytes of each side of a copy that no cache holds.
const BEYOND_CACHES: usize = 256 << 20;

/// Bytes of the state of one element: deflection, yield force, force and slip speed.
const STATE: usize = 32;

const PERIOD: f64 = 1e-3;

const START: Start = Start::Undeformed;

/// Seals of 70 to 130 % of the plausible width, with viscous damping about `viscous`, N·s/m.
fn elements(count: usize, viscous: f64) -> Result<Vec<Element>, ParamError> {
    let plausible = ElementParams::plausible_10_5_mm()?;
    let element = |k: usize| {
        let part = (k as f64 + 0.5) / count as f64;
        let sliding = |old| SlidingFriction { viscous_damping: viscous * (0.5 + part), ..old };
        let (insertion, withdrawal) = (sliding(plausible.insertion), sliding(plausible.withdrawal));
        let seal = Seal::from(Element::new(ElementParams { insertion, withdrawal, ..plausible })?);
        let width = plausible.deformation.half_width() * (0.7 + 0.6 * part);
        match seal.tuned(&[width])? {
            Seal::Ems(stages) => Ok(*stages.first()),
            Seal::Classical(_) => unreachable!("an element stays one"),
        }
    };
    (0..count).map(element).collect()
}

/// The motion of `cargo bench -p trocar-model`: 40 mm strokes with holds, then 10 mm sub-movements
/// with a tremor.
fn motion(samples: usize) -> Vec<(f64, f64)> {
    let position = |k: usize| {
        let t = k as f64 * PERIOD;
        let phase = (t / 4.0).fract();
        let stroke = 0.04 * (phase / 0.4).min(1.0).min((0.9 - phase) / 0.4).max(0.0);
        let moving = 2 * k > samples;
        let sub_movement = if moving { 5e-3 * (1.0 - (5.0 * t).cos()) } else { 0.0 };
        let tremor = if moving { 2e-4 * (56.5 * t).sin() } else { 0.0 };
        stroke + sub_movement + tremor
    };
    (1..=samples).map(|k| (position(k) - position(k - 1), PERIOD)).collect()
}

/// Time that all threads of this process had a processor, ns; to a few milliseconds.
fn processor_time() -> Option<f64> {
    let time = |thread: std::fs::DirEntry| {
        let text = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
        text.split(' ').next()?.parse::<f64>().ok()
    };
    std::fs::read_dir("/proc/self/task").ok()?.map(|thread| time(thread.ok()?)).sum()
}

/// Nanoseconds that `work` takes, each of `count` things: of processors, and on the wall.
fn both_times(count: usize, work: impl FnOnce()) -> [f64; 2] {
    let (start, before) = (Instant::now(), processor_time());
    work();
    let wall = start.elapsed().as_secs_f64() * 1e9;
    let processor = processor_time().zip(before).map_or(wall, |(after, before)| after - before);
    [processor, wall].map(|time| time / count as f64)
}

fn nanoseconds(count: usize, work: impl FnOnce()) -> f64 {
    both_times(count, work)[0]
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Medians of several kinds that take turns.
fn medians<const N: usize>(
    repetitions: usize,
    mut kinds: [&mut dyn FnMut() -> f64; N],
) -> [f64; N] {
    let mut times = [const { Vec::new() }; N];
    for _ in 0..repetitions {
        kinds.iter_mut().zip(&mut times).for_each(|(kind, times)| times.push(kind()));
    }
    times.map(|mut times| median(&mut times))
}

/// One thread, from rest, without the time to set up.
fn along(
    elements: &[Element],
    motion: &[(f64, f64)],
    wide: bool,
    observer: &mut impl Observe,
) -> f64 {
    let mut states: Vec<_> = elements.iter().map(|element| element.rest_state(0.0)).collect();
    let mut places = vec![Lanes::EMPTY; blocks(elements.len())];
    let mut batch = Batch::new(elements, &mut states, &mut places).expect("numbers match");
    repeated(elements, motion, || match wide {
        true => many::run(&mut batch, motion, observer),
        false => batch.run(motion.iter().copied(), observer),
    })
}

/// As often as makes the work of one repetition; ns per seal and sample.
fn repeated(elements: &[Element], motion: &[(f64, f64)], mut once: impl FnMut()) -> f64 {
    let work = elements.len() * motion.len();
    let rounds = WORK.div_ceil(work);
    nanoseconds(rounds * work, || (0..rounds).for_each(|_| once()))
}

fn one_by_one(elements: &[Element], motion: &[(f64, f64)]) -> f64 {
    repeated(elements, motion, || {
        for element in elements {
            let mut state = element.rest_state(0.0);
            for (displacement, duration) in motion {
                black_box(element.step(&mut state, *displacement, *duration));
            }
        }
    })
}

/// Prints one row for each number of seals; returns the time of the last with squares.
fn table(viscous: f64, repetitions: usize) -> Result<f64, ParamError> {
    let mut last = 0.0;
    for count in SEALS {
        let (elements, motion) = (elements(count, viscous)?, motion((WORK / count).min(40_000)));
        let measured = vec![0.5; motion.len()];
        let (mut sums, mut more) = (vec![0.0; count], vec![0.0; count]);
        let mut forces = vec![0.0; count * motion.len()];
        let [alone, narrow, squares, all] = medians(
            repetitions,
            [
                &mut || one_by_one(&elements, &motion),
                &mut || along(&elements, &motion, false, &mut Squares::new(&measured, &mut more)),
                &mut || along(&elements, &motion, true, &mut Squares::new(&measured, &mut sums)),
                &mut || along(&elements, &motion, true, &mut Forces::new(count, &mut forces)),
            ],
        );
        black_box((&sums, &more, &forces));
        println!("{count:6} {alone:12.2} {narrow:12.2} {squares:12.2} {all:12.2}");
        last = squares;
    }
    Ok(last)
}

/// A copy of what the step keeps of each seal, where no cache holds it, and where the second does;
/// ns a seal.
fn copies(repetitions: usize) -> [f64; 2] {
    let numbers = BEYOND_CACHES / 8;
    let (from, mut to) = (vec![1.0_f64; numbers], vec![0.0_f64; numbers]);
    let near = 1024 * STATE / 8;
    let (small, mut other) = (vec![1.0_f64; near], vec![0.0_f64; near]);
    medians(
        repetitions,
        [
            &mut || {
                nanoseconds(BEYOND_CACHES / STATE, || {
                    to.copy_from_slice(black_box(&from));
                    black_box(&to);
                })
            },
            &mut || {
                nanoseconds(1024 << 17, || {
                    for _ in 0..1 << 17 {
                        other.copy_from_slice(black_box(&small));
                        black_box(&other);
                    }
                })
            },
        ],
    )
}

/// Time on one thread over that on two, 4096 seals: of processors (1 if the second costs nothing
/// more), and on the wall.
fn scaling(repetitions: usize) -> Result<[f64; 2], Box<dyn std::error::Error>> {
    let seals = Seals(elements(4096, 0.0)?);
    let (time, position): (Vec<f64>, Vec<f64>) = motion(8192)
        .into_iter()
        .scan((0.0, 0.0), |at, (displacement, duration)| {
            *at = (at.0 + duration, at.1 + displacement);
            Some(*at)
        })
        .unzip();
    let (motion, measured) = (Motion::new(&time, &position), vec![0.5; time.len()]);
    let mut sums = vec![0.0; seals.count()];
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pools = [pool(1)?, pool(2)?];
    let mut times = [const { [const { Vec::new() }; 2] }; 2];
    for _ in 0..repetitions {
        for (pool, times) in pools.iter().zip(&mut times) {
            let work = || {
                pool.install(|| squared_errors(&seals, START, &motion, &measured, &mut sums))
                    .expect("all are elements in range");
            };
            times.iter_mut().zip(both_times(1, work)).for_each(|(times, time)| times.push(time));
        }
    }
    let [[one_cpu, one_wall], [two_cpu, two_wall]] =
        times.map(|times| times.map(|mut times| median(&mut times)));
    Ok([one_cpu / two_cpu, one_wall / two_wall])
}

struct Seals(Vec<Element>);

impl Ensemble for Seals {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn trocar(&self, index: usize) -> Result<Trocar<&[f64]>, ParamError> {
        Ok(Trocar::new(self.0[index], None))
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let repetitions = std::env::args().nth(1).map_or(Ok(9), |text| text.parse())?;
    let head = "seals    one by one  sums, SSE2  sums of squares   all forces";
    println!(
        "constant friction without viscous damping, ns per seal and sample on one core\n{head}"
    );
    let squares = table(0.0, repetitions)?;
    println!("constant friction with viscous damping\n{head}");
    table(5.0, repetitions)?;
    let [far, near] = copies(repetitions);
    println!(
        "copy of the state of a seal (4 numbers), ns: {far:.2} beyond the caches, {near:.2} within"
    );
    println!("sums of squares of 1024 seals over the copy beyond the caches: {:.2}", squares / far);
    let [processor, wall] = scaling(repetitions)?;
    println!(
        "one thread over two, 4096 seals: {wall:.2} on the wall, {processor:.2} of processor time"
    );
    Ok(())
}
