//! Draws of a model's parameters where they are taken: the standard deviation of the tissue force,
//! plans, and advice on a loop.

use std::sync::LazyLock;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use trocar::compensate::{CompensateError, CompensateOptions, Compensator};
use trocar::draws::{self, models, read_models};
use trocar::many::evenly;
use trocar::model_file::{ErrorSource, ForceError, Interval, ModelFile, Origin, OriginKind};
use trocar::plan::{Goal, PlanConfig, PlanError, State, plan};
use trocar::table::{Column, Table};
use trocar::teleop::advise::advise;
use trocar::teleop::{Candidates, Config, Outcome, candidates};
use trocar_model::{
    Classical, Element, ElementParams, Friction, Mode, ParameterId, Quantity, Seal,
    SlidingFriction, Stages, StaticFriction, Tunable,
};

use super::posterior::calibration::{column, found, recordings, seal};

/// A standard normal deviate.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (radius, angle) = (1.0 - rng.random::<f64>(), std::f64::consts::TAU * rng.random::<f64>());
    (-2.0 * radius.ln()).sqrt() * angle.cos()
}

/// Relative standard deviations of the friction forces, of β and of c in a population of seals.
const SPREAD: [f64; 3] = [0.04, 0.2, 0.12];
/// Noise of the readings, N, and the error of the model beside that of its parameters.
const NOISE: f64 = 0.01;

fn plausible() -> Seal {
    *ModelFile::plausible_10_5_mm().unwrap().trocar.seal()
}

/// The seal with its forces, β and c multiplied.
fn changed(seal: &Seal, [force, damping, width]: [f64; 3]) -> Stages {
    let value = |Tunable { id, value }: Tunable| match id.quantity {
        Quantity::CoulombForce => force * value,
        Quantity::ViscousDamping => damping * value,
        Quantity::HalfWidth => width * value,
        _ => value,
    };
    let values: Vec<f64> = seal.tunables().map(value).collect();
    *seal.tuned(&values).unwrap().stages().unwrap()
}

fn population(count: usize, rng: &mut ChaCha8Rng) -> Vec<Stages> {
    let mut factor = |spread: f64| (spread * normal(rng)).exp();
    (0..count).map(|_| changed(&plausible(), SPREAD.map(&mut factor))).collect()
}

/// The model, whose intervals have the spread of the population, and whose error beside that is `error`, N.
fn model(error: f64) -> ModelFile {
    let mut file =
        ModelFile::new(*plausible().stages().unwrap(), Origin::new(OriginKind::Identified));
    file.force_error =
        Some(ForceError { source: ErrorSource::Identification, ..ForceError::everywhere(error) });
    for Tunable { id, value } in plausible().tunables() {
        let spread = match id.quantity {
            Quantity::CoulombForce => SPREAD[0],
            Quantity::ViscousDamping => SPREAD[1],
            Quantity::HalfWidth => SPREAD[2],
            _ => continue,
        };
        let ci95 = [1.0 - 1.96 * spread, 1.0 + 1.96 * spread].map(|factor| Some(factor * value));
        let id = ParameterId { direction: None, ..id };
        file.intervals.insert(id.to_string(), Interval { value, ci95 });
    }
    file
}

/// Length of a stroke, m: slides of both directions overlap, from which the observer adapts.
const STROKE: f64 = 0.08;

/// Strokes of several speeds: displacement of each sample.
fn strokes(count: usize) -> Vec<f64> {
    let stroke = |k: usize| {
        let (speed, sign) =
            ([0.02, 0.05, 0.1][k / 2 % 3], if k.is_multiple_of(2) { 1.0 } else { -1.0 });
        std::iter::repeat_n(1e-3 * sign * speed, (STROKE / speed * 1e3) as usize)
    };
    (0..count).flat_map(stroke).collect()
}

/// Errors of the tissue force over the standard deviation said, by whether the seal deforms, of the
/// last strokes through `truth` without tissue; and that standard deviation.
fn errors(mut observer: Compensator, truth: &Stages, rng: &mut ChaCha8Rng) -> [Vec<[f64; 2]>; 2] {
    let truth = Seal::Ems(*truth);
    let (mut state, mut x) = (truth.rest_at_force(0.0), 0.0);
    observer.step(x, 0.0, 0.0);
    let all = strokes(12);
    let mut errors = [Vec::new(), Vec::new()];
    for (k, displacement) in all.iter().enumerate() {
        x += displacement;
        let reading = truth.step(&mut state, *displacement, 1e-3) + NOISE * normal(rng);
        let said = observer.step(x, reading, 1e-3);
        if k > all.len() / 2 {
            let deforms = state.deformation().is_some_and(|d| d.mode == Mode::Deforming);
            errors[usize::from(deforms)].push([said.tissue_force / said.std, said.std]);
        }
    }
    errors
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (squares, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Errors over all truths: while sliding, while deforming.
fn scored(adaptation: bool, has_draws: bool, error: f64) -> [[f64; 2]; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let draws = population(100, &mut rng);
    let options = CompensateOptions { adaptation, ..CompensateOptions::default() };
    let mut observer = Compensator::new(&model(error), &options).unwrap();
    if has_draws {
        observer = observer.with_draws(&draws).unwrap();
    }
    let mut all = [Vec::new(), Vec::new()];
    for truth in population(60, &mut rng) {
        let found = errors(observer.clone(), &truth, &mut rng);
        all.iter_mut().zip(found).for_each(|(all, found)| all.extend(found));
    }
    all.map(|errors| [rms(errors.iter().map(|e| e[0])), rms(errors.iter().map(|e| e[1]))])
}

/// Truths and draws from one population: the standard deviation with draws is that of the error of
/// the tissue force, while the seal slides and while it deforms; without them the error of the half
/// width is missing.
#[test]
fn the_standard_deviation_from_draws_is_that_of_the_error_of_the_tissue_force() {
    let ([sliding, deforming], [_, without]) =
        (scored(false, true, NOISE), scored(false, false, NOISE));
    println!(
        "error over std: sliding {sliding:.3?}, deforming {deforming:.3?}, without draws {without:.3?}"
    );
    for [ratio, _] in [sliding, deforming] {
        assert!((0.8..1.2).contains(&ratio), "{sliding:?} {deforming:?}");
    }
    assert!(without[0] > 1.3, "{without:?}");
}

/// With adaptation draws add what λ and ν cannot follow: nothing of the level while the seal slides,
/// where it is in var λ already, and the error of the shape while it deforms.
#[test]
fn with_adaptation_draws_add_what_it_cannot_follow() {
    // The observer takes what exceeds three times this for a load.
    let error = 5.0 * NOISE;
    let ([sliding, deforming], [plain_sliding, plain_deforming]) =
        (scored(true, true, error), scored(true, false, error));
    println!(
        "sliding {sliding:.3?} {plain_sliding:.3?}, deforming {deforming:.3?} {plain_deforming:.3?}"
    );
    assert!(sliding[1] < 1.2 * plain_sliding[1], "{sliding:?} {plain_sliding:?}");
    assert!(deforming[1] > 1.1 * plain_deforming[1], "{deforming:?} {plain_deforming:?}");
    assert!(sliding[0] < 1.2 && deforming[0] < 1.2, "{sliding:?} {deforming:?}");
}

#[test]
fn an_observer_with_draws_goes_on_from_its_saved_state() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let draws = population(5, &mut rng);
    let new = || {
        Compensator::new(&model(NOISE), &CompensateOptions::default())
            .unwrap()
            .with_draws(&draws)
            .unwrap()
    };
    let (mut one, mut other) = (new(), new());
    let mut x = 0.0;
    for (k, displacement) in strokes(3).into_iter().enumerate() {
        x += displacement;
        // Readings that never stay the same.
        let reading = 1.0 + 1e-3 * (k as f64).sin();
        let own = one.step(x, reading, 1e-3);
        if k == 1500 {
            other.set_state(&one.state()).unwrap();
        } else if k > 1500 {
            assert_eq!(other.step(x, reading, 1e-3), own);
        }
    }
    let plain = Compensator::new(&model(NOISE), &CompensateOptions::default()).unwrap();
    assert!(other.set_state(&plain.state()).is_err());
    one.reset();
    assert_eq!(one.step(0.0, 0.5, 0.0), new().step(0.0, 0.5, 0.0));
}

#[test]
fn draws_for_a_classical_model_are_refused() {
    let coulomb = StaticFriction::new(SlidingFriction::coulomb(3.0, 5.0)).unwrap();
    let coulomb = Seal::from(Classical::Static(coulomb));
    let observer = Compensator::with_seal(&model(NOISE), coulomb, &CompensateOptions::default());
    let refused = observer.unwrap().with_draws(&population(2, &mut ChaCha8Rng::seed_from_u64(3)));
    assert!(matches!(refused, Err(CompensateError::NoElements { .. })));
}

/// A result with draws: its model, their file, and their table.
struct Drawn {
    folder: tempfile::TempDir,
    table: Table,
    draws: Vec<Stages>,
    truth: ElementParams,
}

static DRAWN: LazyLock<Drawn> = LazyLock::new(|| {
    let truth = seal(2);
    let found = found(&recordings(truth, 2), 400, 2);
    let folder = tempfile::tempdir().unwrap();
    let posterior = found.posterior.as_ref().unwrap();
    draws::write(&draws::table(posterior), &folder.path().join("posterior.parquet")).unwrap();
    let mut file = ModelFile::new(found.stages, Origin::new(OriginKind::Identified));
    for parameter in &found.parameters {
        let ci95 = parameter.estimate.ci95.map(|end| end.is_finite().then_some(end));
        let interval = Interval { value: parameter.estimate.value, ci95 };
        file.intervals.insert(parameter.id.to_string(), interval);
    }
    std::fs::write(folder.path().join("model.json"), file.to_json()).unwrap();
    let draws = read_models(&folder.path().join("posterior.parquet")).unwrap();
    assert_eq!(column(posterior, "half_width_m").len(), draws.len());
    Drawn { folder, table: trocar::draws::table(posterior), draws, truth }
});

fn file() -> ModelFile {
    ModelFile::read(&DRAWN.folder.path().join("model.json")).unwrap()
}

#[test]
fn fewer_draws_are_from_all_chains() {
    let draws = models(&DRAWN.table).unwrap();
    let few = evenly(&draws, 8);
    let places: Vec<usize> =
        few.iter().map(|own| draws.iter().position(|draw| draw == own).unwrap()).collect();
    assert_eq!(places, [0, 50, 100, 150, 200, 250, 300, 350]);
    assert_eq!(evenly(&draws, 1000), draws);
}

fn numbers<'t>(table: &'t Table, name: &str) -> &'t [f64] {
    match table.column(name) {
        Some(Column::Number(cells)) => cells,
        other => panic!("{name}: {other:?}"),
    }
}

/// The fraction that is advised with draws as trocars holds for the true seal: the loop is stable with
/// it, and what is felt is off by no more than said.
#[test]
fn advice_with_draws_holds_for_the_true_seal() {
    let (file, mut config) = (file(), Config::default());
    config.channel.delay_s = 0.01;
    let pairs = |least_friction_scale: f64| {
        let posterior = Some(DRAWN.draws.clone());
        let wanted =
            Candidates { draws: 12, posterior, least_friction_scale, ..Candidates::default() };
        candidates([&file; 2], &wanted).unwrap()
    };
    assert_eq!((pairs(1.0).len(), pairs(0.55).len()), (13, 15));
    let advice = advise(&config, &pairs(1.0), || ()).unwrap();
    config.compensation.fraction = advice.fraction.expect("there is one");
    let truth = file.trocar.with_seal(Element::new(DRAWN.truth).unwrap().into());
    let felt = Outcome::of(&config, [&file.trocar, &truth]).unwrap().figures.expect("it is stable");
    let said = advice.with.expect("it is stable").force_error_rms_n;
    println!("{:?}: error felt {:.3} N, said {said:.3} N", advice.fraction, felt.force_error_rms_n);
    assert!(felt.force_error_rms_n < 1.1 * said, "{} {said}", felt.force_error_rms_n);
}

/// A plan for draws expects their parameters, and intervals no wider than those of the pilot's own
/// motion in the same time would be.
#[test]
fn a_plan_takes_the_draws_as_its_seals() {
    let config = PlanConfig { duration_s: 40.0, ..PlanConfig::default() };
    let draws = evenly(&DRAWN.draws, 5);
    let seals: Vec<ElementParams> = draws.iter().map(|draw| *draw.first().params()).collect();
    let planned = plan(&config, &Goal::All, &seals, &[], &|_, _| {}).unwrap();
    for (name, quantity, truth) in [
        ("coulomb_force_n", Quantity::CoulombForce, DRAWN.truth.insertion.coulomb_force),
        ("half_width_m", Quantity::HalfWidth, DRAWN.truth.deformation.half_width()),
    ] {
        let expected = planned.expected.iter().find(|p| p.id == quantity.id()).unwrap();
        let drawn = numbers(&DRAWN.table, name);
        let (low, high) =
            drawn.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!(low <= expected.value && expected.value <= high, "{name}: {expected:?}");
        assert!((expected.value / truth - 1.0).abs() < 0.2, "{name}: {expected:?} {truth}");
        assert!(expected.largest_half_width >= expected.half_width);
    }
}

/// The same seals, at 0.55 to 0.85 of their friction: narrower, too, since the rubber stays.
#[test]
fn a_plan_for_wet_seals_expects_less_friction() {
    let goal: Goal = "coulomb_force_n".parse().unwrap();
    let expected = |state: State| {
        let mut config = PlanConfig { duration_s: 40.0, draws: 3, ..PlanConfig::default() };
        config.prior.state = state;
        plan(&config, &goal, &[], &[], &|_, _| {}).unwrap().expected
    };
    let [dry, wet] = [State::Dry, State::Wet].map(expected);
    for quantity in [Quantity::CoulombForce, Quantity::HalfWidth] {
        let value = |all: &[trocar::plan::Prediction]| {
            all.iter().find(|p| p.id == quantity.id()).unwrap().value
        };
        let ratio = value(&wet) / value(&dry);
        assert!((0.5..0.9).contains(&ratio), "{quantity:?} {ratio}");
    }
    let mut config = PlanConfig::default();
    config.prior.state = State::Wet;
    let refused = plan(&config, &goal, &[DRAWN.truth], &[], &|_, _| {});
    assert!(matches!(refused, Err(PlanError::Config(_))));
}
