"""Posterior draws of an Extended Maxwell-Slip element by emcee, on the density that `identify --posterior` samples.

    reference/posterior_emcee           # writes posterior/emcee.json; some minutes
    reference/posterior_emcee --speed   # effective draws a second beside those of the example posterior_density

The density is that of crates/trocar-identify/src/posterior/density.rs, computed anew: the element in closed form along each step
(ems.py), the friction scales of the strokes by dense matrices, cluster by cluster. Data, variances, priors and
coordinates come from posterior/density.json, which `cargo run -p trocar --example posterior_density` writes:

    C = sum w*(y - o - (1 + d)*F)^2 - m'(Z'Z + lambda)^-1 m + sum of priors     ln pi = -C/(2 sigma^2)     theta_w = maximum + L_w z

The joins stay at their maximum. `adjusted` has the draws with the covariance of the jackknife: theta = maximum + L_a z, with normal z
for the joins.
"""

import json
import pathlib
import subprocess
import sys
import time

import emcee
import numba
import numpy

import ems
import vectors

FOLDER = pathlib.Path(__file__).parent / "posterior"
PARTS = [0.025, 0.25, 0.5, 0.75, 0.975]
NAMES = ["offset_n", "coulomb_force_n", "viscous_damping_n_s_m", "half_width_m"]
KINDS = ["offset", "sliding_force", "damping", "half_width"]
BRANCH = ["join", "join_force", "bend", "bend"]
WALKERS, STEPS, WARM_UP, SEED = 48, 12000, 2000, 1
END_SLOPE = 0.05  # least slope beyond the ends, of the mean slope of the branch
POINTS = 24

deflected = numba.njit(ems.deflected)


@numba.njit(cache=False)
def branch(u, join, low, middle, high, left, right):
    """Force at u = z/c of two joined parabolas, and its slope over u."""
    if u < join:
        t, first, last, bend, half = (2.0 * u - (join - 1.0)) / (join + 1.0), low, middle, left, 0.5 * (join + 1.0)
    else:
        t, first, last, bend, half = (2.0 * u - (1.0 + join)) / (1.0 - join), middle, high, right, 0.5 * (1.0 - join)
    # The chord, and a Legendre polynomial of order 2 less its value at both ends.
    force = 0.5 * (first + last) + 0.5 * (last - first) * t + bend * 1.5 * (t * t - 1.0)
    return force, (0.5 * (last - first) + bend * 3.0 * t) / half


@numba.njit(cache=False)
def forces(values, displacement, duration, centre):
    """Force of the element at the reading of each step, from rest without deflection, in closed form."""
    coulomb, beta, width = values[1], values[2], values[3]
    up, down = values[4:8], values[8:12]
    high = max(branch(1.0, up[0], -coulomb, up[1], coulomb, up[2], up[3])[1], END_SLOPE * coulomb) / width
    low = max(branch(-1.0, down[0], -coulomb, down[1], coulomb, down[2], down[3])[1], END_SLOPE * coulomb) / width
    z, before = 0.0, 0.0
    found = numpy.empty(len(displacement))
    for i in range(len(displacement)):
        velocity = displacement[i] / duration[i]
        rises = velocity > 0.0
        z = deflected(z, velocity, duration[i], beta, width, low, high)
        if z > width:
            after = coulomb + high * (z - width)
        elif z < -width:
            after = -coulomb + low * (z + width)
        else:
            own = up if rises else down
            after = branch(z / width, own[0], -coulomb, own[1], coulomb, own[2], own[3])[0]
        found[i] = before + centre[i] * (after - before)
        before = after
    return found


@numba.njit(cache=False)
def data_cost(values, drift, first_of, displacement, duration, centre, reading, weight, stroke, blend, ridge):
    """C without the priors; first_of: number of the first stroke of the cluster of each stroke."""
    force = forces(values, displacement, duration, centre)
    strokes = len(first_of)
    cost = 0.0
    begin, i = 0, 0
    while begin < strokes:
        end = begin
        while end < strokes and first_of[end] == begin:
            end += 1
        count = end - begin + 1
        precision, moment = numpy.eye(count) * ridge, numpy.zeros(count)
        while i < len(force) and stroke[i] < end:
            g, w = stroke[i], blend[i]
            slow = w * drift[g] + ((1.0 - w) * drift[g - 1] if w < 1.0 else 0.0)
            residual = reading[i] - values[0] - (1.0 + slow) * force[i]
            cost += weight[i] * residual * residual
            own, last = g - begin + 1, g - begin
            of_own, of_last = w * force[i], (1.0 - w) * force[i]
            precision[own, own] += weight[i] * of_own * of_own
            precision[last, last] += weight[i] * of_last * of_last
            precision[own, last] += weight[i] * of_own * of_last
            precision[last, own] += weight[i] * of_own * of_last
            moment[own] += weight[i] * of_own * residual
            moment[last] += weight[i] * of_last * residual
            i += 1
        cost -= moment @ numpy.linalg.solve(precision, moment)
        begin = end
    return cost


class Density:
    """ln pi_w over the coordinates z, less its value at 0."""

    def __init__(self, path):
        data = json.loads(path.read_text())
        parameters = data["parameters"]
        kinds = [p["kind"] for p in parameters]
        self.drifts = kinds.count(None)
        expected = KINDS + BRANCH + BRANCH + [None] * self.drifts
        if kinds != expected or len(data["runs"]) != 1:
            raise SystemExit(f"{path}: expected one run with the parameters {expected}, got {kinds}")
        column = lambda name: numpy.array([[numpy.nan if p[name] is None else p[name] for p in parameters]])[0].astype(float)
        self.maximum, self.mean, self.deviation = column("maximum"), column("prior_mean"), column("prior_standard_deviation")
        self.low, self.high = column("low"), column("high")
        self.low[numpy.isnan(self.low)], self.high[numpy.isnan(self.high)] = -numpy.inf, numpy.inf
        self.variance, self.ridge, self.joins = data["variance_n2"], data["lambda_n2"], data["joins"]
        self.working, self.adjusted = numpy.array(data["working"]), numpy.array(data["adjusted"])
        self.basis = numpy.array(data["drift"])
        clusters = data["clusters"]
        self.first_of = numpy.array([clusters.index(cluster) for cluster in clusters])
        run = data["runs"][0]
        self.steps = [numpy.array(run[name]) for name in ("displacement_m", "duration_s", "centre", "force_n", "weight", "stroke", "blend")]
        self.dimension = len(self.maximum)
        self.least = self.cost(self.maximum)

    def cost(self, values):
        drift = values[len(values) - self.drifts :] @ self.basis if self.drifts else numpy.zeros(len(self.first_of))
        data = data_cost(values, drift, self.first_of, *self.steps, self.ridge)
        return data + numpy.sum(self.variance * ((values - self.mean) / self.deviation) ** 2)

    def values(self, z):
        """theta_w with the joins at their maximum."""
        return self.maximum + self.working[:, self.joins :] @ z[self.joins :]

    def log(self, z):
        values = self.values(z)
        if numpy.any(values < self.low) or numpy.any(values > self.high):
            return -numpy.inf
        cost = self.cost(values)
        of_joins = z[: self.joins] @ z[: self.joins]
        return -0.5 * ((cost - self.least) / self.variance + of_joins) if numpy.isfinite(cost) else -numpy.inf


def sampled(density, steps):
    """Draws of the coordinates that the likelihood depends on, and seconds."""
    free = density.dimension - density.joins
    random = numpy.random.default_rng(SEED)
    start = 0.5 * random.standard_normal((WALKERS, free))
    log = lambda own: density.log(numpy.concatenate([numpy.zeros(density.joins), own]))
    log(start[0])
    sampler = emcee.EnsembleSampler(WALKERS, free, log)
    sampler.random_state = numpy.random.RandomState(SEED).get_state()
    begin = time.perf_counter()
    sampler.run_mcmc(start, steps)
    return sampler.get_chain(discard=steps // 6), time.perf_counter() - begin


def described(draws):
    """Mean, standard deviation, quantiles and effective number of each compared parameter; draws: steps by walkers by parameters."""
    times = emcee.autocorr.integrated_time(draws, quiet=True)
    flat = draws.reshape(-1, draws.shape[2])
    return {
        name: {
            "mean": float(flat[:, k].mean()),
            "standard_deviation": float(flat[:, k].std()),
            "quantiles": [float(v) for v in numpy.quantile(flat[:, k], PARTS)],
            "effective": float(len(flat) / times[k]),
        }
        for k, name in enumerate(NAMES)
    }


def compared(density, chain, factor, joins):
    """The compared parameters of the draws under the map `factor`."""
    z = numpy.concatenate([joins, chain], axis=2)
    return density.maximum[: len(NAMES)] + z @ factor[: len(NAMES)].T


def main():
    density = Density(FOLDER / "density.json")
    if "--speed" in sys.argv:
        return speed(density, sys.argv[sys.argv.index("--speed") + 1])
    random = numpy.random.default_rng(SEED)
    points = 1.5 * random.standard_normal((POINTS, density.dimension))
    chain, seconds = sampled(density, STEPS)
    shape = (*chain.shape[:2], density.joins)
    adjusted = compared(density, chain, density.adjusted, random.standard_normal(shape))
    within = (adjusted >= density.low[: len(NAMES)]) & (adjusted <= density.high[: len(NAMES)])
    if not within.all():
        raise SystemExit(f"{(~within).sum()} adjusted draws leave the range of a parameter: the map is no longer the whole density")
    result = {
        "made_with": vectors.versions("emcee", "numba", "numpy"),
        "parts": PARTS,
        "points": [{"z": [float(v) for v in z], "log_density": float(density.log(z))} for z in points],
        "working": described(compared(density, chain, density.working, numpy.zeros(shape))),
        "adjusted": described(adjusted),
    }
    (FOLDER / "emcee.json").write_text(json.dumps(result, indent=1) + "\n")
    least = min(row["effective"] for row in result["working"].values())
    print(f"emcee: {chain.shape[0] * WALKERS} draws in {seconds:.0f} s, {least:.0f} effective")


def speed(density, example):
    """Effective draws a second of both, in turns."""
    ratios = []
    for _ in range(3):
        ours = json.loads(subprocess.run([example, "time"], check=True, capture_output=True, text=True).stdout)["effective_per_s"]
        chain, seconds = sampled(density, 3000)
        found = described(compared(density, chain, density.working, numpy.zeros((*chain.shape[:2], density.joins))))
        theirs = min(row["effective"] for row in found.values()) / seconds
        ratios.append(ours / theirs)
        print(f"effective draws a second, the least of {len(NAMES)} parameters: trocar {ours:.0f}, emcee {theirs:.0f}, ratio {ours / theirs:.1f}")
    print(f"ratio, median of {len(ratios)}: {sorted(ratios)[len(ratios) // 2]:.1f}")


if __name__ == "__main__":
    main()
