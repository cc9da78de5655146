//! The parameters of a fit, with intervals.

use std::collections::BTreeMap;

use trocar_model::{Direction, ParameterId, Quantity, Stages, Unit};

use super::candidate::{Candidate, EmsTrial, Layout};
use super::estimate::Estimate;
use super::findings::{Covariance, Parameter};
use super::joins::{Along, Joins};
use super::likelihood::{Fitted, Trial};
use super::load::{load_of, of_load};
use super::spread::{LEVEL, MASS, Reported, SHAPE, SLOPE, Spread, WIDTH};
use super::stage::SecondStage;

/// Joins, forces there, and the paper's θ (25), of both branches.
pub(super) fn branch_ids(candidate: &Candidate) -> Vec<ParameterId> {
    ids_of(|direction| candidate.branch(direction).degrees())
}

/// Those of branches of such degrees.
fn ids_of(degrees: impl Fn(Direction) -> [usize; 2]) -> Vec<ParameterId> {
    let of_branch = |direction: Direction| {
        let own = [Quantity::Join, Quantity::JoinForce].into_iter();
        own.chain(Quantity::coefficients(degrees(direction))).map(move |q| q.of(direction))
    };
    Direction::BOTH.into_iter().flat_map(of_branch).collect()
}

/// Place of a parameter in tables: friction and width of the element first, then the other numbers of
/// the seal; last those of the rig, the joins and the coefficients, without which no model can be
/// fitted, but for whose values nobody asks.
pub(super) fn rank(id: ParameterId) -> usize {
    use Quantity as Q;
    const FIRST: [Quantity; 7] = [
        Q::CoulombForce,
        Q::CoulombForceWithOffset,
        Q::ViscousDamping,
        Q::HalfWidth,
        Q::StaticForce,
        Q::StribeckVelocity,
        Q::StribeckExponent,
    ];
    // All loads have the place of the mass.
    const LAST: [Quantity; 4] = [Q::Offset, Q::UnmodelledMass, Q::Join, Q::JoinForce];
    if matches!(id.quantity, Q::Coefficient { .. }) {
        return FIRST.len() + LAST.len() + 1;
    }
    let quantity = load_of(id.quantity).map_or(id.quantity, |_| Q::UnmodelledMass);
    let place = |list: &[Quantity]| list.iter().position(|own| *own == quantity);
    let (first, last) = (place(&FIRST), place(&LAST));
    first.or(last.map(|at| FIRST.len() + 1 + at)).unwrap_or(FIRST.len())
}

/// c and the parameters of both branches, of every stage.
pub(super) fn shape_ids(candidate: &Candidate) -> Vec<ParameterId> {
    let of_stage = |stage: &SecondStage| ids_of(|direction| stage.branch(direction).degrees());
    let second = candidate.second.as_ref().map_or_else(Vec::new, of_stage);
    let first = std::iter::once(Quantity::HalfWidth.id()).chain(branch_ids(candidate));
    first.chain(second.into_iter().map(|id| id.of_element(1))).collect()
}

/// All parameters that an identification may report, in the order of tables; branches of `degrees`.
pub fn reported(degrees: [usize; 2]) -> Vec<ParameterId> {
    let branches = |all: Vec<Quantity>| {
        Direction::BOTH
            .into_iter()
            .flat_map(move |direction| all.clone().into_iter().map(move |q| q.of(direction)))
    };
    let joins = branches(vec![Quantity::Join, Quantity::JoinForce]);
    let coefficients = branches(Quantity::coefficients(degrees).collect());
    quantities(Layout::every())
        .into_iter()
        .map(|(id, _)| id)
        .chain(joins)
        .chain(coefficients)
        .collect()
}

/// A parameter of a fit, and whether its interval is taken on the logarithm.
pub(super) type OnLogarithm = (ParameterId, bool);

pub(super) fn quantities(layout: Layout) -> Vec<OnLogarithm> {
    use Quantity as Q;
    let by_direction = layout.own_slopes || layout.own_levels;
    let [insertion, withdrawal] = Direction::BOTH;
    let second = |quantity: Quantity| quantity.id().of_element(1);
    let of_loads = layout.free_loads().map(|load| (true, of_load(load).id[0], false));
    let sliding = [
        (true, Q::CoulombForce.id(), true),
        (true, Q::ViscousDamping.id(), false),
        (layout.offset, Q::Offset.id(), false),
        (layout.shape, Q::HalfWidth.id(), true),
        // With the sensor offset, as the lines of the steady state: only the sum is identifiable.
        (by_direction, Q::CoulombForceWithOffset.of(insertion), false),
        (by_direction, Q::CoulombForceWithOffset.of(withdrawal), false),
        (by_direction, Q::ViscousDamping.of(insertion), false),
        (by_direction, Q::ViscousDamping.of(withdrawal), false),
        (layout.stribeck, Q::StaticForce.id(), true),
        (layout.stribeck, Q::StribeckVelocity.id(), true),
        (layout.exponent, Q::StribeckExponent.id(), true),
        (layout.damping, Q::SealDamping.id(), false),
    ];
    let later = [
        (layout.yielding, Q::YieldStiffness.id(), true),
        (layout.creep, Q::CreepVelocity.id(), true),
        (layout.lag, Q::FrictionLag.id(), true),
        (layout.dwell, Q::DwellForce.id(), false),
        (layout.arms > 0, Q::RelaxationStiffness.id(), true),
        (layout.arms > 0, Q::RelaxationTime.id(), true),
        (layout.arms > 1, Q::SecondRelaxationStiffness.id(), true),
        (layout.arms > 1, Q::SecondRelaxationTime.id(), true),
        (layout.second, second(Q::CoulombForce), true),
        (layout.second, second(Q::HalfWidth), true),
    ];
    let all = sliding.into_iter().chain(of_loads).chain(later);
    all.filter(|(is_there, ..)| *is_there).map(|(_, id, log)| (id, log)).collect()
}

/// A lag of one or two samples cannot be identified.
fn shortest_lag(found: &Estimate) -> Estimate {
    const SHORTEST: f64 = 2e-3;
    if found.value > SHORTEST {
        return found.clone();
    }
    let longest = if found.determined { found.ci95[1].max(SHORTEST) } else { SHORTEST };
    Estimate::from_bounds(found.value, 0.0, longest, found.unit)
        .with_note("too short to be distinguished from zero")
}

pub(super) fn factor_of(id: ParameterId) -> f64 {
    match (id.quantity, id.direction, id.element) {
        (Quantity::CoulombForce | Quantity::Offset | Quantity::StaticForce, None, None) => LEVEL,
        (Quantity::Join | Quantity::JoinForce, ..) => SHAPE,
        (Quantity::HalfWidth, None, None) => WIDTH,
        (Quantity::ViscousDamping, None, None) => SLOPE,
        (Quantity::UnmodelledMass, ..) => MASS,
        _ => 1.0,
    }
}

/// Scale with which the interval of a parameter is compared.
fn scale_of(best: &Candidate, id: ParameterId) -> f64 {
    match id.unit() {
        _ if matches!(id.quantity, Quantity::Coefficient { .. }) => f64::INFINITY,
        Unit::NEWTON => best.insertion.coulomb_force,
        Unit::METRE => best.half_width,
        _ => best.insertion.viscous_damping.max(1.0),
    }
}

/// A parameter of the best candidate with its interval; `factor` multiplies its standard error.
pub(super) fn parameter(
    spread: &Spread<EmsTrial>,
    best: &Candidate,
    (id, log): OnLogarithm,
    factor: f64,
) -> Parameter {
    let (scale, least) = (scale_of(best, id), id.declaration().range.least());
    let how = Reported { unit: id.unit().si, log, scale, least, factor };
    Parameter::new(id, spread.estimate(how, &|t| t.candidate.value(id)))
}

/// The same, except for a parameter that the fit holds at a bound.
pub(super) fn parameter_or_held(
    fitted: &Fitted<EmsTrial>,
    spread: &Spread<EmsTrial>,
    (id, log): OnLogarithm,
    factor: f64,
) -> Parameter {
    let best = &fitted.best.candidate;
    if !fitted.has_prior && is_held(fitted, id) {
        let why = "the fit holds it at an end of its range";
        return Parameter::new(id, Estimate::undetermined(best.value(id), id.unit().si, why));
    }
    parameter(spread, best, (id, log), factor)
}

/// Whether a quantity represents a parameter held at a bound: that parameter alone, or together
/// with the width, changes it.
pub(super) fn is_held(fitted: &Fitted<EmsTrial>, id: ParameterId) -> bool {
    let free = fitted.best.free();
    let value = fitted.best.candidate.value(id);
    (0..free.len()).filter(|j| fitted.held[*j] && free[*j].low < free[*j].high).any(|j| {
        let mut values: Vec<f64> = free.iter().map(|f| f.value).collect();
        values[j] += free[j].step;
        fitted.best.with_any(&values).candidate.value(id) != value
    })
}

/// Whether the data determine all of these parameters that the fit has.
pub(super) fn are_determined(fitted: &Fitted<EmsTrial>, ids: &[ParameterId]) -> bool {
    let spread = Spread::new(fitted);
    let mut own = quantities(fitted.best.layout).into_iter().filter(|(id, _)| ids.contains(id));
    own.all(|q| parameter_or_held(fitted, &spread, q, factor_of(q.0)).estimate.determined)
}

/// Covariance of those of `parameters` that have a standard error.
pub(super) fn covariance(fitted: &Fitted<EmsTrial>, parameters: &[Parameter]) -> Covariance {
    let EmsTrial { candidate: best, layout, .. } = &fitted.best;
    let spread = Spread::new(fitted);
    let of_fit =
        quantities(*layout).into_iter().chain(branch_ids(best).into_iter().map(|id| (id, false)));
    let logs: BTreeMap<ParameterId, bool> = of_fit.collect();
    let is_known = |p: &&Parameter| p.estimate.standard_error.is_some() && logs.contains_key(&p.id);
    let ids: Vec<ParameterId> = parameters.iter().filter(is_known).map(|p| p.id).collect();
    let gradient =
        |id: &ParameterId| spread.gradient(logs[id], factor_of(*id), &|t| t.candidate.value(*id));
    let rows = spread.covariance(&ids.iter().map(gradient).collect::<Vec<_>>());
    Covariance { parameters: ids.iter().map(ToString::to_string).collect(), rows }
}

/// The models a standard deviation from the best one along each of the axes of its covariance.
pub(super) fn deviations(fitted: &Fitted<EmsTrial>) -> Vec<(Stages, f64)> {
    models_off(&fitted.best, &Spread::new(fitted).axes())
}

/// The models off `best` by `axes` in its first free numbers, each with the part of its axis.
pub(super) fn models_off(best: &EmsTrial, axes: &[Vec<f64>]) -> Vec<(Stages, f64)> {
    let values: Vec<f64> = best.free().iter().map(|free| free.value).collect();
    let moved = |off: &[f64], part: f64| {
        let mut values = values.clone();
        values.iter_mut().zip(off).for_each(|(own, off)| *own += part * off);
        best.with(&values).model().map(|stages| (stages, part))
    };
    axes.iter().filter_map(|off| PARTS.iter().find_map(|part| moved(off, *part))).collect()
}

/// Parts of a deviation that are tried until one is a model.
const PARTS: [f64; 4] = [1.0, -1.0, 0.1, -0.1];

/// Half width of an interval over that to first order up to which a standard error describes it.
const NEARLY_NORMAL: f64 = 1.5;

/// A parameter with the interval that holds it at all joins within reach: those of its branch, or
/// of both.
fn along_joins(
    spread: &Spread<EmsTrial>,
    joins: &Joins,
    (id, log): OnLogarithm,
    estimate: Estimate,
) -> Estimate {
    let Estimate { value, unit, determined, standard_error, ref note, .. } = estimate;
    let mut own =
        joins.all().iter().filter(|along| id.direction.is_none_or(|d| d == along.direction));
    if !determined {
        return estimate;
    }
    let is_of_branch =
        matches!(id.quantity, Quantity::Join | Quantity::JoinForce | Quantity::Coefficient { .. });
    if is_of_branch && own.clone().any(|along| along.within().is_none()) {
        let why = "polynomials with joins far apart follow the readings equally well";
        return Estimate::undetermined(value, unit, why);
    }
    let [plain, back]: [fn(f64) -> f64; 2] = if log { [f64::ln, f64::exp] } else { [|x| x, |x| x] };
    let of = |t: &EmsTrial| plain(t.candidate.value(id));
    let first = estimate.ci95.map(plain);
    let half = 0.5 * (first[1] - first[0]);
    let hull = |along: &Along| {
        let join = |t: &EmsTrial| t.candidate.branch(along.direction).join;
        let gradients: [_; 2] =
            [&of as &dyn Fn(&EmsTrial) -> f64, &join].map(|of| spread.gradient(false, 1.0, of));
        let given = (1.0 - spread.correlation(&gradients).powi(2)).sqrt() * half;
        along.hull(given, &of)
    };
    let wider = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
    // The joins of a branch replace its first order; other parameters keep theirs at least, and so do
    // all from few strokes, in which the errors of the readings are correlated along a branch.
    let has_prior = spread.has_prior();
    let start = (!is_of_branch || has_prior).then_some(first);
    let Some([low, high]) = start.into_iter().chain(own.by_ref().map(hull)).reduce(wider) else {
        return estimate;
    };
    let is_normal = high - low < NEARLY_NORMAL * 2.0 * half;
    let standard_error = standard_error.filter(|_| is_normal);
    let least = id.declaration().range.least();
    let found = Estimate::from_bounds(value, back(low).max(least), back(high), unit);
    Estimate { standard_error, note: note.clone(), ..found }
}

/// Main parameters of the fit with intervals: jackknife over clusters, to first order ([`Spread`]).
pub(super) fn parameters(fitted: &Fitted<EmsTrial>, joins: &Joins) -> Vec<Parameter> {
    let EmsTrial { candidate: best, layout, .. } = &fitted.best;
    let spread = Spread::new(fitted);
    let of = |q: OnLogarithm| {
        if let Some(given) = layout.kept.value(q.0.quantity).filter(|_| q.0.element.is_none()) {
            return Parameter::new(q.0, Estimate::given(given, q.0.unit().si));
        }
        let found = parameter_or_held(fitted, &spread, q, factor_of(q.0));
        Parameter::new(q.0, along_joins(&spread, joins, q, found.estimate))
    };
    let mut all: Vec<Parameter> = quantities(*layout).into_iter().map(of).collect();
    all.iter_mut()
        .filter(|p| p.id.quantity == Quantity::FrictionLag)
        .for_each(|p| p.estimate = shortest_lag(&p.estimate));
    if layout.shape {
        for id in branch_ids(best) {
            let found = parameter(&spread, best, (id, false), factor_of(id)).estimate;
            all.push(Parameter::new(id, along_joins(&spread, joins, (id, false), found)));
        }
    }
    all
}
