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
//! hull over D(a) ≤ 1 or a ∈ A of g(θ_a) ± w_g|a·√(1 − D(a))₊        w_g|a² = w_g² − (dg/da·w)²: half width at a given join
//! ```
//! A is the range that holds the central 95 % of the density exp(−½·(1.96)²·D). Where C_b is a
//! parabola it adds nothing; minima a little above D = 1 that are broad, or several, belong to it.
//!
//! C_b is computed on a grid. From one join to the next the polynomials start from those that come
//! nearest, and all other numbers take undamped steps. A better minimum is followed, so that the
//! fit does not depend on the join that it started from.

use rayon::prelude::*;
use trocar_model::Direction;

use super::candidate::EmsTrial;
use super::estimate::{MANY_DEGREES, t_quantile};
use super::likelihood::{self, Column, Fitted, Stop, Trial};
use super::prior::Kind;
use super::shape::BranchShape;
use super::spread::{Reported, SHAPE, Spread};
use super::training::Training;

/// Distance of the joins of the grid.
const STEP: f64 = 0.1;
/// Most undamped steps at one join, and the part of the reach that the next one may still promise.
const STEPS: usize = 2;
const PROMISE: f64 = 0.05;
/// Excess above which a join is not of interest. With the other numbers as they are it is too high.
const FAR: f64 = 5.0;
/// Distance of joins between which all other numbers change little.
const CLOSE: f64 = 0.03;
/// Excess below which the cells of the grid are halved.
const NEAR: f64 = 50.0;
/// How often cells are halved at the ends of the reach, and the part of w that needs no halving.
const HALVINGS: usize = 2;
const NARROW: f64 = 0.25;
/// Joins that count as the same.
const SAME: f64 = 1e-3;
/// Excess below 0 that a start for another fit promises.
const PROMISING: f64 = 0.1;
/// Excess below 0 at which another minimum is better.
const BETTER: f64 = 0.01;
/// Most better minima that are followed.
const SEARCHES: usize = 4;

const NONE: Stop = Stop { iterations: 0, fall: 0.0, promise: 0.0 };
const SHORT: Stop = Stop { iterations: 2, fall: 1e-4, promise: f64::INFINITY };
const NEXT: Stop = Stop { iterations: 6, fall: 1e-4, promise: f64::INFINITY };

/// The least cost at one join.
#[derive(Debug, Clone)]
struct Point {
    join: f64,
    /// D(a).
    excess: f64,
    /// D that a fit with a free join promises from here.
    bottom: f64,
    /// θ_a.
    trial: EmsTrial,
}

/// Unit of D.
#[derive(Debug, Clone, Copy)]
struct Unit {
    least: f64,
    reach: f64,
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

/// The search along one branch about a fit.
struct Search<'a> {
    training: &'a Training,
    fitted: &'a Fitted<EmsTrial>,
    direction: Direction,
    number: usize,
    unit: Unit,
}

impl Unit {
    fn excess(self, cost: f64) -> f64 {
        (cost - self.least) / self.reach
    }
}

impl Search<'_> {
    /// The least cost at `join`, from a trial with another one; where that is far, with the numbers
    /// of other branches as they are. `None` where no model runs.
    fn at(&self, from: &EmsTrial, join: f64) -> Option<Point> {
        let moved = from.with_join(self.direction, join)?;
        let is_near = (join - self.join(from)).abs() < CLOSE;
        let held = if is_near { Vec::new() } else { self.others(&moved) };
        let (mut point, mut missed) = self.stepped(&EmsTrial { held, ..moved })?;
        point.trial.held.clear();
        let mut is_whole = is_near;
        for _ in 0..STEPS {
            if point.excess > FAR || is_whole && missed < PROMISE {
                break;
            }
            let (next, by) = self.stepped(&point.trial)?;
            let is_better = next.excess < point.excess;
            (missed, is_whole) = (if is_better { by } else { 0.0 }, true);
            if is_better {
                point = next;
            }
        }
        Some(Point { join, ..point })
    }

    /// The free numbers of the simulation that are not of this branch.
    fn others(&self, trial: &EmsTrial) -> Vec<usize> {
        let own: usize = trial.candidate.branch(self.direction).degrees().iter().sum();
        let own = self.number..self.number + own;
        let free = trial.free();
        let is_other = |j: &usize| free[*j].column == Column::Simulated && !own.contains(j);
        (0..free.len()).filter(is_other).collect()
    }

    /// One undamped step at the join of `trial`, and by how much D it misses what it promised.
    fn stepped(&self, trial: &EmsTrial) -> Option<(Point, f64)> {
        let Self { training, unit, number, .. } = *self;
        let mut here = likelihood::fit(training, trial, NONE)?;
        let free = trial.free();
        let before = unit.excess(here.cost());
        let bottom = unit.excess(here.cost() * (1.0 - here.promised_to(&free)));
        here.held[number] = true;
        let moved: Vec<f64> =
            free.iter().zip(here.remaining().iter()).map(|(f, d)| f.value + d).collect();
        let stepped = trial.with(&moved);
        let after = unit.excess(likelihood::cost(training, &stepped));
        let (trial, excess) =
            if after < before { (stepped, after) } else { (trial.clone(), before) };
        let promised = here.promised_fall() * here.cost() / unit.reach;
        let missed = (promised - (before - after)).abs();
        let join = self.join(&trial);
        Some((Point { join, excess, bottom: bottom.min(excess), trial }, missed))
    }

    /// The points at `joins`, each from the one before.
    fn walk(&self, joins: &[f64]) -> Vec<Point> {
        let mut points: Vec<Point> = Vec::with_capacity(joins.len());
        for join in joins {
            let before = points.last().map_or(&self.fitted.best, |point| &point.trial);
            points.extend(self.at(before, *join));
        }
        points
    }

    /// C_b, and the lowest trial that is better than the fit, with its D.
    fn along(&self, half_width: f64) -> (Along, Option<(f64, EmsTrial)>) {
        let points = self.grid(half_width);
        let mut along = Along { direction: self.direction, points, central: [0.0; 2] };
        // A narrow minimum may lie between two joins of the grid.
        self.add_between(&mut along.points, |low, _, width| {
            low.excess < NEAR && width > 0.6 * STEP
        });
        self.add_minima(&mut along.points);
        for _ in 0..HALVINGS {
            self.add_between(&mut along.points, |low, high, width| {
                let share = share_within(low, high).unwrap_or(0.0);
                let is_wide = width > 1.1 * half_width && share * width > NARROW * half_width;
                high.excess > 1.0 && is_wide
            });
        }
        let least = along.points.iter().min_by(|a, b| a.excess.total_cmp(&b.excess));
        let better = least.filter(|point| point.excess < -BETTER);
        let better = better.map(|point| (point.excess, point.trial.clone()));
        along.points.iter_mut().for_each(|point| point.excess = point.excess.max(0.0));
        along.central = along.quantiles([0.025, 0.975]);
        (along, better)
    }

    /// C_b on the grid and at the ends of the interval to first order.
    fn grid(&self, half_width: f64) -> Vec<Point> {
        let best = &self.fitted.best;
        let own = self.join(best);
        let cells = (2.0 * BranchShape::JOIN_RANGE / STEP).round() as i32;
        let mut joins: Vec<f64> = (0..=cells)
            .map(|k| f64::from(k) * STEP - BranchShape::JOIN_RANGE)
            .chain([own - half_width, own + half_width])
            .filter(|a| a.abs() < BranchShape::JOIN_RANGE + SAME && (a - own).abs() > SAME)
            .collect();
        joins.sort_by(f64::total_cmp);
        let (mut left, right): (Vec<f64>, Vec<f64>) = joins.into_iter().partition(|a| *a < own);
        left.reverse();
        let (mut points, right) = rayon::join(|| self.walk(&left), || self.walk(&right));
        points.reverse();
        points.push(Point { join: own, excess: 0.0, bottom: 0.0, trial: best.clone() });
        points.extend(right);
        points
    }

    /// Adds other minima that are within reach: from joins with a lower cost than those beside
    /// them, or from which a free join promises the most and more than the fit has.
    fn add_minima(&self, points: &mut Vec<Point>) {
        let is_least = |k: usize, of: fn(&Point) -> f64| {
            let beside = [k.checked_sub(1), Some(k + 1)].into_iter().flatten();
            let mut beside = beside.filter_map(|j| points.get(j));
            beside.all(|other| of(&points[k]) <= of(other))
        };
        let lowest = |k: &usize| {
            let Point { excess, bottom, .. } = points[*k];
            let is_minimum = bottom < FAR && is_least(*k, |point| point.excess);
            let is_promising = bottom < -PROMISING && is_least(*k, |point| point.bottom);
            excess != 0.0 && (is_minimum || is_promising)
        };
        let minimum = |k: usize| {
            let excess = |fitted: &Fitted<EmsTrial>| self.unit.excess(fitted.cost());
            let mut fitted = likelihood::fit(self.training, &points[k].trial, SHORT)?;
            if excess(&fitted) < FAR {
                fitted = likelihood::fit(self.training, &fitted.best, NEXT)?;
            }
            let excess = excess(&fitted);
            Some(Point {
                join: self.join(&fitted.best),
                excess,
                bottom: excess,
                trial: fitted.best,
            })
        };
        let starts: Vec<usize> = (0..points.len()).filter(lowest).collect();
        let found: Vec<Point> = starts.into_par_iter().filter_map(minimum).collect();
        points.extend(found);
        points.sort_by(|a, b| a.join.total_cmp(&b.join));
    }

    /// Adds a point in the middle of the cells, given by their lower and higher end and their width,
    /// that are `open`.
    fn add_between(
        &self,
        points: &mut Vec<Point>,
        open: impl Fn(&Point, &Point, f64) -> bool + Sync,
    ) {
        let between = |pair: &[Point]| {
            let (low, high) = by_excess(&pair[0], &pair[1]);
            let is_open = open(low, high, (high.join - low.join).abs());
            is_open.then(|| self.at(&low.trial, 0.5 * (low.join + high.join))).flatten()
        };
        let found: Vec<Point> = points.par_windows(2).filter_map(between).collect();
        points.extend(found);
        points.sort_by(|a, b| a.join.total_cmp(&b.join));
    }

    fn join(&self, trial: &EmsTrial) -> f64 {
        trial.candidate.branch(self.direction).join
    }
}

/// The lower point first.
fn by_excess<'a>(a: &'a Point, b: &'a Point) -> (&'a Point, &'a Point) {
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
        for last in (0..SEARCHES).rev() {
            let (joins, better) = Self::about(training, &fitted);
            let again = better.and_then(|from| likelihood::fit(training, &from, stop));
            match again.filter(|again| last > 0 && again.cost() < fitted.cost()) {
                Some(again) => fitted = again,
                None => return (fitted, joins),
            }
        }
        unreachable!("the last search ends")
    }

    /// C_b about a fit, and the lowest trial that is better.
    fn about(training: &Training, fitted: &Fitted<EmsTrial>) -> (Self, Option<EmsTrial>) {
        let spread = Spread::new(fitted);
        let free = fitted.best.free();
        let numbers = (0..free.len()).filter(|j| free[*j].kind == Some(Kind::Join));
        let search = |(direction, number): (Direction, usize)| {
            let (half_width, reach) = to_first_order(&spread, direction, number);
            let unit = Unit { least: fitted.cost(), reach };
            let search = Search { training, fitted, direction, number, unit };
            search.along(half_width)
        };
        let branches: Vec<(Direction, usize)> = Direction::BOTH.into_iter().zip(numbers).collect();
        let (all, better): (Vec<Along>, Vec<_>) = branches.into_par_iter().map(search).unzip();
        let better = better.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0));
        (Self(all), better.map(|(_, trial)| trial))
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

/// Points between two joins at which an interval is taken, and a density.
const BETWEEN: usize = 8;
const OF_DENSITY: usize = 24;

impl Along {
    /// Pairs of neighbouring points, the lower one first.
    fn cells(&self) -> impl Iterator<Item = (&Point, &Point)> {
        self.points.windows(2).map(|pair| by_excess(&pair[0], &pair[1]))
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
        let within = || self.points.iter().filter(|point| point.excess <= 1.0);
        let at_end = |point: &Point| point.join.abs() > 0.99 * BranchShape::JOIN_RANGE;
        let [low, high] = self.hull(0.0, &|t| t.candidate.branch(self.direction).join);
        let is_known = !within().any(at_end) && high - low < BranchShape::JOIN_RANGE;
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
                    if is_open(low.join + x * (high.join - low.join)) {
                        let excess = low.excess + (high.excess - low.excess) * x * x;
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
