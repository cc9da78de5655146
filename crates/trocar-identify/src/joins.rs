//! The likelihood along the join of each branch.
//!
//! ```text
//! C_b(a) = min C with the join a of branch b held        D(a) = (C_b(a) − C(θ̂))/(κ·w²)
//! κ = 1/(H⁻¹)_aa: curvature of C_b at the best join      w: half width of the 95 % interval of the join to first order
//! ```
//! Joined polynomials imitate each other: C_b may have several minima, or be flat. All joins with
//! D(a) ≤ 1 are within reach. Where C_b is a parabola, these are the interval to first order, which
//! comes from the jackknife over strokes; the ratio of its variance to that of independent samples
//! is thus the unit of the likelihood ratio everywhere. The interval of another quantity g of the
//! branch is
//!
//! ```text
//! hull over D(a) ≤ 1, or a ∈ A with D(a) < 4, of g(θ_a) ± w_g|a·√(1 − D(a))₊        w_g|a² = w_g² − (dg/da·w)²: half width at a given join
//! ```
//! A is the range that holds the central 95 % of the density exp(−½·(1.96)²·D). Where C_b is a
//! parabola it adds nothing; minima a little above D = 1 that are broad, or several, belong to it.
//!
//! # All joins from one simulation
//! The deformation force is local: the force depends on few ordinates u of the branches at a time,
//! and polynomials with any join a are a linear map of their numbers θ to ordinates, B(a)·θ + f(a).
//! With the normal equations in the ordinates and all other numbers, these eliminated,
//!
//! ```text
//! C(a⁺, a⁻) = min over θ of C_0 − 2·s'd + d'·S·d + Σ p·(θ − μ)²        d = B(a)·θ + f(a) − u
//! ```
//! costs a small system of equations for a pair of joins: no simulation. It is exact to first order
//! in the change of the branches. Fits follow where another pair is better, and from other minima
//! within reach.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use trocar_model::Direction;

use super::candidate::{self, Candidate, EmsTrial, ORDINATES};
use super::estimate::{MANY_DEGREES, t_quantile};
use super::likelihood::{self, Extra, Fitted, Normal, Stop, Trial};
use super::prior::Kind;
use super::shape::BranchShape;
use super::spread::{Reported, SHAPE, Spread};
use super::training::Training;

/// Cells between the joins that are compared, over their whole range.
const CELLS: i32 = 56;
/// Joins beside the best one, in units of its half width.
const BESIDE: [f64; 10] = [-2.0, -1.5, -1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 1.5, 2.0];
/// Distance of joins within which there is one minimum, and the excess up to which others are fitted:
/// beyond it the first order misses one within reach only if it is wrong by several times the reach.
const APART: f64 = 0.1;
const STARTS_BELOW: f64 = 4.0;
/// Excess above which a fit is not continued, and is no part of an interval.
const FAR: f64 = 5.0;
/// Added to the information of a number, as a part of it: of the branches, for rounding alone; of the
/// others, since along flat directions, such as from one stage to another, the first order would
/// lead where it does not hold.
const ROUNDING: f64 = 1e-9;
const DAMPING: f64 = 1e-5;
/// Joins that count as the same.
const SAME: f64 = 1e-3;
/// Excess below 0 that a start for another fit promises.
const PROMISING: f64 = 0.1;
/// Excess below 0 at which another minimum is better.
const BETTER: f64 = 0.01;
/// Most better minima that are followed.
const SEARCHES: usize = 4;

/// Stopping criteria of the fits that follow a better pair of joins, and of those from a minimum.
const NEAR: Stop = Stop { iterations: 15, fall: 1e-3, promise: 10.0 * 1e-3 };
const SHORT: Stop = Stop { iterations: 2, fall: 1e-4, promise: f64::INFINITY };
const NEXT: Stop = Stop { iterations: 6, fall: 1e-4, promise: f64::INFINITY };

/// The least cost at one join.
#[derive(Debug, Clone)]
struct Point {
    join: f64,
    /// D(a).
    excess: f64,
    /// θ_a.
    trial: EmsTrial,
}

/// C_b of one branch.
#[derive(Debug, Clone)]
pub(super) struct Along {
    pub(super) direction: Direction,
    /// In the order of their joins.
    points: Vec<Point>,
    /// A.
    central: [f64; 2],
}

/// A branch among the free numbers.
struct Side {
    direction: Direction,
    /// Place of its join; its other numbers follow.
    number: usize,
    degrees: [usize; 2],
    own_join: f64,
    /// Half width of the interval of the join to first order, and κ·w².
    half_width: f64,
    reach: f64,
    /// Mean and precision of the priors of the join and of the numbers after it.
    priors: Vec<[f64; 2]>,
}

/// A branch with polynomials of one join, beside that of the fit.
struct Joined {
    join: f64,
    /// B(a), and f(a) - u.
    map: DMatrix<f64>,
    off: DVector<f64>,
    /// S·B and S·(f - u).
    information_map: DMatrix<f64>,
    information_off: DVector<f64>,
}

impl Side {
    /// Both branches; `None` where they are not free.
    fn both(fitted: &Fitted<EmsTrial>) -> Option<[Self; 2]> {
        let spread = Spread::new(fitted);
        let free = fitted.best.free();
        let mut numbers = (0..free.len()).filter(|j| free[*j].kind == Some(Kind::Join));
        let mut of = |direction: Direction| {
            let (number, shape) = (numbers.next()?, fitted.best.candidate.branch(direction));
            let (half_width, reach) = to_first_order(&spread, direction, number);
            let last = number + shape.numbers().len();
            let priors = (number..=last).map(|j| fitted.prior(j, free[j].value)).collect();
            let (degrees, own_join) = (shape.degrees(), shape.join);
            Some(Self { direction, number, degrees, own_join, half_width, reach, priors })
        };
        let [up, down] = Direction::BOTH.map(&mut of);
        Some([up?, down?])
    }

    /// Places of all its numbers, and of its ordinates.
    fn numbers(&self) -> Range<usize> {
        self.number..self.number + self.priors.len()
    }

    fn ordinates(&self) -> Range<usize> {
        let count = candidate::nodes().count() + 1;
        let first = if self.direction == Direction::BOTH[0] { 0 } else { count };
        first..first + count
    }

    /// The joins that are compared, in their order.
    fn joins(&self) -> Vec<f64> {
        let cell = 2.0 * BranchShape::JOIN_RANGE / f64::from(CELLS);
        let grid = (0..=CELLS).map(|k| f64::from(k) * cell - BranchShape::JOIN_RANGE);
        let beside = BESIDE.map(|part| self.own_join + part * self.half_width);
        let mut all: Vec<f64> = grid
            .chain(beside)
            .filter(|a| a.abs() < BranchShape::JOIN_RANGE + SAME)
            .filter(|a| (a - self.own_join).abs() > SAME)
            .chain([self.own_join])
            .collect();
        all.sort_by(f64::total_cmp);
        all
    }

    /// B(a) and f(a): the ordinates of polynomials with the join `a`.
    fn map(&self, candidate: &Candidate, join: f64) -> (DMatrix<f64>, DVector<f64>) {
        let (end_forces, end) = (candidate.end_forces(), self.direction.sign());
        let (mut map, mut fixed) =
            BranchShape::ordinates(join, self.degrees, end_forces, candidate::nodes(), end);
        // The slope by z; at its least value it does not follow the branch.
        let is_at_floor = candidate.end_is_at_floor(self.direction);
        let by_slope = if is_at_floor { 0.0 } else { 1.0 / candidate.half_width };
        let last = fixed.len() - 1;
        map.row_mut(last).scale_mut(by_slope);
        fixed[last] *= by_slope;
        (map, fixed)
    }
}

/// The cost over the joins of both branches, all other numbers eliminated, to first order.
struct Landscape<'a> {
    fitted: &'a Fitted<EmsTrial>,
    sides: [Side; 2],
    /// Of each side, at each of its joins.
    joined: [Vec<Joined>; 2],
    /// C(a⁺, a⁻) less C_0: by the joins of the first side, and of the second.
    costs: DMatrix<f64>,
    others: Others,
}

/// All numbers but those of the branches, and what they leave of the normal equations.
struct Others {
    /// Places of those that are not held, and how they follow d.
    places: Vec<usize>,
    by_ordinates: DMatrix<f64>,
    /// s, S.
    score: DVector<f64>,
    information: DMatrix<f64>,
}

impl Others {
    /// From normal equations with a column for each ordinate after those of the free numbers.
    fn new(fitted: &Fitted<EmsTrial>, normal: &Normal, sides: &[Side; 2]) -> Option<Self> {
        let (hessian, score) = normal.sums();
        let own = fitted.held.len();
        let ordinates: Vec<usize> = (own..score.len()).collect();
        let places: Vec<usize> = (0..own)
            .filter(|j| sides.iter().all(|side| !side.numbers().contains(j)))
            .filter(|j| !fitted.held[*j] && hessian[(*j, *j)] > 0.0)
            .collect();
        let mixed = hessian.select_rows(&places).select_columns(&ordinates);
        let between = hessian.select_rows(&places).select_columns(&places);
        let by_ordinates =
            likelihood::damped_steps(&between, &mixed, DAMPING, &vec![false; places.len()])?;
        // At the minimum their own score is 0, but for kinks of the cost, which no step would follow.
        let score = score.select_rows(&ordinates);
        let information = hessian.select_rows(&ordinates).select_columns(&ordinates)
            - mixed.tr_mul(&by_ordinates);
        Some(Self { places, by_ordinates, score, information })
    }

    /// The branch of `side` at each of its joins.
    fn joined(&self, side: &Side, candidate: &Candidate) -> Vec<Joined> {
        let (own_map, own_fixed) = side.map(candidate, side.own_join);
        let numbers = DVector::from_vec(candidate.branch(side.direction).numbers());
        let own = own_fixed + own_map * numbers;
        let of_side = side.ordinates();
        let columns = self.information.columns(of_side.start, of_side.len());
        let at = |join: f64| {
            let (map, fixed) = side.map(candidate, join);
            let off = fixed - &own;
            let (information_map, information_off) = (columns * &map, columns * &off);
            Joined { join, map, off, information_map, information_off }
        };
        side.joins().into_iter().map(at).collect()
    }
}

impl<'a> Landscape<'a> {
    /// About a fit; `None` without free branches.
    fn about(training: &Training, fitted: &'a Fitted<EmsTrial>) -> Option<Self> {
        let sides = Side::both(fitted)?;
        let ordinates: Vec<_> = (0..ORDINATES).map(Extra::Followed).collect();
        let normal = fitted.with_columns(training, &ordinates)?;
        let others = Others::new(fitted, &normal, &sides)?;
        let candidate = &fitted.best.candidate;
        let joined = [0, 1].map(|k| others.joined(&sides[k], candidate));
        let costs = DMatrix::zeros(0, 0);
        let mut landscape = Self { fitted, sides, joined, costs, others };
        let [ups, downs] = landscape.joined.each_ref().map(Vec::len);
        let cost = |pair: usize| {
            let found = landscape.pair([pair % ups, pair / ups]);
            found.map_or(f64::INFINITY, |found| found.0)
        };
        let all: Vec<f64> = (0..ups * downs).into_par_iter().map(cost).collect();
        landscape.costs = DMatrix::from_vec(ups, downs, all);
        // Without that of the fit there is nothing to compare the others with.
        landscape.own_cost().is_finite().then_some(landscape)
    }

    /// Place of the join of the fit among those of side `k`.
    fn own_place(&self, k: usize) -> usize {
        let own_join = self.sides[k].own_join;
        self.joined[k].iter().position(|j| j.join == own_join).expect("it is among them")
    }

    /// C less C_0 at the joins of the fit.
    fn own_cost(&self) -> f64 {
        self.costs[(self.own_place(0), self.own_place(1))]
    }

    /// C less C_0 for the joins at these places, and the numbers θ of each branch.
    fn pair(&self, places: [usize; 2]) -> Option<(f64, [DVector<f64>; 2])> {
        let joined: [&Joined; 2] = std::array::from_fn(|k| &self.joined[k][places[k]]);
        let [first, second] = joined.map(|j| j.map.ncols());
        let (starts, counts) = ([0, first], [first, second]);
        let mut matrix = DMatrix::zeros(first + second, first + second);
        let mut moment = DMatrix::zeros(first + second, 1);
        let mut cost = 0.0;
        for k in 0..2 {
            let (start, count, side) = (starts[k], counts[k], &self.sides[k]);
            let rows = side.ordinates();
            let own = |vector: &DVector<f64>| vector.rows(rows.start, rows.len()).into_owned();
            let score = own(&self.others.score);
            let pull = &score - own(&joined[0].information_off) - own(&joined[1].information_off);
            moment.view_mut((start, 0), (count, 1)).copy_from(&joined[k].map.tr_mul(&pull));
            cost -= joined[k].off.dot(&(score + pull));
            for l in 0..2 {
                let of_rows = joined[l].information_map.rows(rows.start, rows.len());
                let block = joined[k].map.tr_mul(&of_rows);
                matrix.view_mut((start, starts[l]), (count, counts[l])).copy_from(&block);
            }
            let ([join_mean, join_precision], of_numbers) = (side.priors[0], &side.priors[1..]);
            cost += join_precision * (joined[k].join - join_mean).powi(2);
            for (i, [mean, precision]) in of_numbers.iter().enumerate() {
                matrix[(start + i, start + i)] += precision;
                moment[start + i] += precision * mean;
                cost += precision * mean * mean;
            }
        }
        let theta =
            likelihood::damped_steps(&matrix, &moment, ROUNDING, &vec![false; first + second])?;
        cost -= theta.dot(&moment);
        let part = |k: usize| theta.column(0).rows(starts[k], counts[k]).into_owned();
        Some((cost, [part(0), part(1)]))
    }

    /// The trial with the joins at these places and all numbers at their least cost.
    fn trial(&self, places: [usize; 2]) -> Option<EmsTrial> {
        let best = &self.fitted.best;
        let joined: [&Joined; 2] = std::array::from_fn(|k| &self.joined[k][places[k]]);
        if joined.iter().zip(&self.sides).all(|(j, side)| j.join == side.own_join) {
            return Some(best.clone());
        }
        let (_, theta) = self.pair(places)?;
        let mut change = DVector::zeros(self.others.score.len());
        let mut values: Vec<f64> = best.free().iter().map(|free| free.value).collect();
        for ((side, joined), theta) in self.sides.iter().zip(joined).zip(&theta) {
            let rows = side.ordinates();
            let of_side = &joined.map * theta + &joined.off;
            change.rows_mut(rows.start, rows.len()).copy_from(&of_side);
            values[side.number] = joined.join;
            values[side.numbers()].iter_mut().skip(1).zip(theta).for_each(|(v, new)| *v = *new);
        }
        let step = -(&self.others.by_ordinates * change);
        self.others.places.iter().zip(step.iter()).for_each(|(j, step)| values[*j] += step);
        Some(best.with(&values))
    }

    /// C_b of side `k`.
    fn points(&self, k: usize) -> Vec<Point> {
        let (own, least) = ([0, 1].map(|k| self.own_place(k)), self.own_cost());
        let of = |(i, joined): (usize, &Joined)| {
            let pair = |j: usize| if k == 0 { [i, j] } else { [j, i] };
            let cost = |j: usize| self.costs[(pair(j)[0], pair(j)[1])];
            let count = self.joined[1 - k].len();
            // The fit itself stays where its own join is, unless another pair is better.
            let at_own = if i == own[k] { vec![own[1 - k]] } else { Vec::new() };
            let others = at_own.into_iter().chain(0..count);
            let best = others.min_by(|a, b| cost(*a).total_cmp(&cost(*b)))?;
            let excess = (cost(best) - least) / self.sides[k].reach;
            Some(Point { join: joined.join, excess, trial: self.trial(pair(best))? })
        };
        self.joined[k].iter().enumerate().filter_map(of).collect()
    }

    /// The other minima along the joins of side `k` that may be within reach, to first order.
    fn starts<'p>(&self, k: usize, points: &'p [Point]) -> impl Iterator<Item = &'p Point> {
        let Side { own_join, half_width, .. } = self.sides[k];
        points.iter().filter(move |point| {
            let beside = points.iter().filter(|p| (p.join - point.join).abs() < APART);
            let is_lowest = beside.min_by(by_excess).is_some_and(|p| p.join == point.join);
            let from_best = (point.join - own_join).abs();
            is_lowest && point.excess < STARTS_BELOW && from_best > half_width
        })
    }

    /// Adds to `known` the fits from the other minima along the joins of both sides. A minimum of
    /// both sides is one, and from beside a known one a fit would lead to it again.
    fn fit_minima(&self, training: &Training, points: &[Vec<Point>; 2], known: &mut Vec<Minimum>) {
        let mut starts: Vec<(&EmsTrial, f64)> = Vec::new();
        for (k, side) in self.sides.iter().enumerate() {
            for Point { trial, .. } in self.starts(k, &points[k]) {
                let seen = known.iter().map(|m| &m.trial).chain(starts.iter().map(|s| s.0));
                if !seen.into_iter().any(|other| is_beside(trial, other)) {
                    starts.push((trial, side.reach));
                }
            }
        }
        let fits = starts.into_par_iter().filter_map(|(start, reach)| {
            let mut fitted = likelihood::fit(training, start, SHORT)?;
            if fitted.cost() - self.fitted.cost() < FAR * reach {
                fitted = likelihood::fit(training, &fitted.best, NEXT)?;
            }
            Some(Minimum { cost: fitted.cost(), trial: fitted.best })
        });
        known.extend(fits.collect::<Vec<_>>());
    }

    /// The minima as points along side `k`, those apart from the fit.
    fn minima(&self, k: usize, known: &[Minimum]) -> Vec<Point> {
        let side = &self.sides[k];
        let point = |found: &Minimum| Point {
            join: found.trial.candidate.branch(side.direction).join,
            excess: (found.cost - self.fitted.cost()) / side.reach,
            trial: found.trial.clone(),
        };
        let is_apart = |point: &Point| (point.join - side.own_join).abs() > side.half_width;
        known.iter().map(point).filter(is_apart).collect()
    }

    /// The trial with the lowest cost of all points of both sides that lie below `excess`.
    fn lowest(&self, points: &[Vec<Point>; 2], excess: f64) -> Option<EmsTrial> {
        let both = self.sides.iter().zip(points).filter_map(|(side, points)| {
            let lowest = points.iter().min_by(by_excess).filter(|point| point.excess < excess)?;
            Some((lowest.excess * side.reach, lowest.trial.clone()))
        });
        both.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, trial)| trial)
    }
}

/// A minimum of C beside that of the fit.
struct Minimum {
    cost: f64,
    trial: EmsTrial,
}

/// Whether both joins are those of the other trial, or nearly so.
fn is_beside(trial: &EmsTrial, other: &EmsTrial) -> bool {
    let [own, its] =
        [trial, other].map(|t| Direction::BOTH.map(|direction| t.candidate.branch(direction).join));
    own.iter().zip(its).all(|(a, b)| (a - b).abs() < APART)
}

fn by_excess(a: &&Point, b: &&Point) -> std::cmp::Ordering {
    a.excess.total_cmp(&b.excess)
}

/// The lower point first.
fn lower_first<'a>(a: &'a Point, b: &'a Point) -> (&'a Point, &'a Point) {
    if a.excess <= b.excess { (a, b) } else { (b, a) }
}

/// The part of the way from the lower to the higher of two points that is within reach if D is a
/// parabola about the lower one; `None` where that is not within reach.
fn share_within(low: &Point, high: &Point) -> Option<f64> {
    let rise = (high.excess - low.excess).max(f64::MIN_POSITIVE);
    (low.excess <= 1.0).then(|| ((1.0 - low.excess) / rise).sqrt().min(1.0))
}

/// C_b of the branches of the first stage.
#[derive(Debug, Clone, Default)]
pub(super) struct Joins(Vec<Along>);

impl Joins {
    /// The fit, continued in better minima along the joins, and C_b about it.
    pub(super) fn searched(
        training: &Training,
        mut fitted: Fitted<EmsTrial>,
        stop: Stop,
    ) -> (Fitted<EmsTrial>, Self) {
        let (mut minima, mut is_rough) = (Vec::new(), false);
        for _ in 0..SEARCHES {
            let better = Self::promising(training, &fitted);
            let again = better.and_then(|from| likelihood::fit(training, &from, NEAR));
            let Some(again) = again else { break };
            if again.cost() >= fitted.cost() {
                minima.push(Minimum { cost: again.cost(), trial: again.best });
                break;
            }
            (fitted, is_rough) = (again, true);
        }
        if is_rough {
            fitted = likelihood::fit(training, &fitted.best, stop).unwrap_or(fitted);
        }
        for last in (0..SEARCHES).rev() {
            let (joins, better) = Self::about(training, &fitted, &mut minima);
            let again = better.and_then(|from| likelihood::fit(training, &from, stop));
            match again.filter(|again| last > 0 && again.cost() < fitted.cost()) {
                Some(again) => fitted = again,
                None => return (fitted, joins),
            }
        }
        unreachable!("the last search ends")
    }

    /// The trial with other joins that is better than the fit to first order.
    fn promising(training: &Training, fitted: &Fitted<EmsTrial>) -> Option<EmsTrial> {
        let landscape = Landscape::about(training, fitted)?;
        landscape.lowest(&[0, 1].map(|k| landscape.points(k)), -PROMISING)
    }

    /// C_b about a fit, and the lowest trial that is better; adds to the `known` minima.
    fn about(
        training: &Training,
        fitted: &Fitted<EmsTrial>,
        known: &mut Vec<Minimum>,
    ) -> (Self, Option<EmsTrial>) {
        let Some(landscape) = Landscape::about(training, fitted) else { return Default::default() };
        let points = [0, 1].map(|k| landscape.points(k));
        landscape.fit_minima(training, &points, known);
        let minima = [0, 1].map(|k| landscape.minima(k, known));
        let better = landscape.lowest(&minima, -BETTER);
        let sides = landscape.sides.iter().zip(points).zip(minima);
        let all = sides.map(|((side, points), minima)| Along::new(side, points, minima)).collect();
        (Self(all), better)
    }

    /// C_b of all branches.
    pub(super) fn all(&self) -> &[Along] {
        &self.0
    }

    /// C_b of the branch in `direction`.
    pub(super) fn along(&self, direction: Direction) -> Option<&Along> {
        self.0.iter().find(|along| along.direction == direction)
    }
}

/// w, and κ·w².
fn to_first_order(spread: &Spread<EmsTrial>, direction: Direction, number: usize) -> (f64, f64) {
    const WHOLE: f64 = 2.0 * BranchShape::JOIN_RANGE;
    let how =
        Reported { unit: "", log: false, scale: 1.0, least: f64::NEG_INFINITY, factor: SHAPE };
    let found = spread.estimate(how, &|t| t.candidate.branch(direction).join);
    let half_width = if found.determined { found.half_width().min(WHOLE) } else { WHOLE };
    let least = spread.variance() * t_quantile(MANY_DEGREES).powi(2);
    (half_width, least.max(spread.curvature(number) * half_width.powi(2)))
}

/// Excess above which a join is no part of an interval, whatever lies around it: its density is below a
/// thousandth of the greatest.
const NEGLIGIBLE: f64 = 4.0;
/// Points between two joins at which an interval is taken, and a density.
const BETWEEN: usize = 8;
const OF_DENSITY: usize = 24;

impl Along {
    /// The points, each with the error that the first order has at the fit nearest to it: that of the
    /// side, or from another minimum.
    fn new(side: &Side, mut points: Vec<Point>, minima: Vec<Point>) -> Self {
        let by_distance = |a: f64, b: f64, join: f64| (a - join).abs().total_cmp(&(b - join).abs());
        let error = |minimum: &Point| {
            let beside = points.iter().min_by(|a, b| by_distance(a.join, b.join, minimum.join));
            (minimum.join, beside.map_or(0.0, |point| minimum.excess - point.excess))
        };
        let errors: Vec<(f64, f64)> =
            minima.iter().map(error).chain([(side.own_join, 0.0)]).collect();
        for point in &mut points {
            let nearest = errors.iter().min_by(|a, b| by_distance(a.0, b.0, point.join));
            point.excess += nearest.map_or(0.0, |error| error.1);
        }
        // A fit that did not come near the least cost says nothing about its join.
        points.extend(minima.into_iter().filter(|minimum| minimum.excess < FAR));
        points.iter_mut().for_each(|point| point.excess = point.excess.max(0.0));
        points.sort_by(|a, b| a.join.total_cmp(&b.join));
        let mut along = Self { direction: side.direction, points, central: [0.0; 2] };
        along.central = along.quantiles([0.025, 0.975]);
        along
    }

    /// Pairs of neighbouring points, the lower one first.
    fn cells(&self) -> impl Iterator<Item = (&Point, &Point)> {
        self.points.windows(2).map(|pair| lower_first(&pair[0], &pair[1]))
    }

    /// Joins in their order, each with the probability of a lower one under the density
    /// exp(−½·(1.96)²·D).
    pub(super) fn distribution(&self) -> Vec<(f64, f64)> {
        let quantile = t_quantile(MANY_DEGREES);
        let density = |excess: f64| (-0.5 * quantile * quantile * excess).exp();
        let mut all: Vec<(f64, f64)> = Vec::new();
        for (low, high) in self.cells() {
            let width = high.join - low.join;
            let at = |i: usize| {
                let x = i as f64 / OF_DENSITY as f64;
                (low.join + x * width, low.excess + (high.excess - low.excess) * x * x)
            };
            let step = width.abs() / OF_DENSITY as f64;
            let of = |i: usize| {
                let ([a, from], [b, to]) = (<[f64; 2]>::from(at(i)), <[f64; 2]>::from(at(i + 1)));
                (a.max(b), 0.5 * step * (density(from) + density(to)))
            };
            let mut cell: Vec<(f64, f64)> = (0..OF_DENSITY).map(of).collect();
            cell.sort_by(|a, b| a.0.total_cmp(&b.0));
            all.extend(cell);
        }
        let total: f64 = all.iter().map(|(_, mass)| mass).sum();
        let mut below = 0.0;
        for (_, mass) in &mut all {
            below += *mass / total;
            *mass = below;
        }
        let first = self.points.first().map(|point| (point.join, 0.0));
        first.into_iter().chain(all).collect()
    }

    /// The joins below which these parts of the density lie.
    fn quantiles(&self, parts: [f64; 2]) -> [f64; 2] {
        let all = self.distribution();
        parts.map(|part| all[all.partition_point(|(_, below)| *below < part).min(all.len() - 1)].0)
    }

    /// The branch at a join, between those of the points beside it.
    pub(super) fn branch_at(&self, join: f64) -> Option<BranchShape> {
        let after = self.points.partition_point(|point| point.join < join);
        let pair = self.points.get(after.saturating_sub(1)..)?.get(..2)?;
        let share = ((join - pair[0].join) / (pair[1].join - pair[0].join).max(SAME * SAME))
            .clamp(0.0, 1.0);
        let [a, b] = [&pair[0], &pair[1]].map(|point| {
            let moved = point.trial.with_join(self.direction, join);
            moved.map(|trial| trial.candidate.branch(self.direction).clone())
        });
        Some(a?.towards(&b?, share))
    }

    /// The joins within reach as fractions of the half width; `None` where they reach an end of the
    /// range or are half of it.
    pub(super) fn within(&self) -> Option<[f64; 2]> {
        let [low, high] = self.hull(0.0, &|t| t.candidate.branch(self.direction).join);
        let is_at_end =
            |p: &Point| p.excess <= 1.0 && p.join.abs() > 0.99 * BranchShape::JOIN_RANGE;
        let is_known = !self.points.iter().any(is_at_end) && high - low < BranchShape::JOIN_RANGE;
        is_known.then_some([low, high])
    }

    /// The interval of a quantity with the half width `given` at a given join.
    pub(super) fn hull(&self, given: f64, of: &dyn Fn(&EmsTrial) -> f64) -> [f64; 2] {
        let mut hull = [f64::INFINITY, f64::NEG_INFINITY];
        let mut add = |value: f64, excess: f64| {
            let half = given * (1.0 - excess).max(0.0).sqrt();
            hull = [hull[0].min(value - half), hull[1].max(value + half)];
        };
        let is_central = |join: f64| self.central[0] <= join && join <= self.central[1];
        for (low, high) in self.cells() {
            let [from, to] = [low, high].map(|point| of(&point.trial));
            let mut up_to = |most: f64, is_open: &dyn Fn(f64) -> bool| {
                for x in (0..=BETWEEN).map(|i| most * i as f64 / BETWEEN as f64) {
                    let excess = low.excess + (high.excess - low.excess) * x * x;
                    if excess < NEGLIGIBLE && is_open(low.join + x * (high.join - low.join)) {
                        add(from + x * (to - from), excess);
                    }
                }
            };
            share_within(low, high).iter().for_each(|most| up_to(*most, &|_| true));
            up_to(1.0, &is_central);
        }
        hull
    }
}
