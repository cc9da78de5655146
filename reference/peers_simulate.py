"""One motion through one model by several programs: what peers.py times."""

import json
import math
import time

import numba
import numpy
import scipy.integrate
import trocar

import lugre_mujoco
import speed
from speed import ENDS, LUGRE, MAXWELL_SLIP, PERIOD, STARTS

# Samples of the 80-bit solution, and of the programs that take a tenth of a millisecond and more per sample.
EXACT_SAMPLES = 50_000
FEW_SAMPLES = 5_000
# Seals side by side, and samples of each.
SEALS = 1024
SEAL_SAMPLES = 4_000
ORIGIN = {"kind": "hand_made", "program": "reference/peers", "note": "made up, for comparing programs"}
LONG = numpy.longdouble

speed.clock = time.process_time_ns


def timed(program, samples):
    """Nanoseconds per sample and what the program gives."""
    start = time.process_time_ns()
    found = program()
    return (time.process_time_ns() - start) / samples, found


def classical(**friction):
    return trocar.Model.from_json(
        json.dumps({"format": "trocar-model", "version": 1, "origin": ORIGIN, "friction": friction})
    )


def lugre_model(parameters):
    """The model of (sigma0, sigma1, F_c, F_s, v_s, sigma2)."""
    stiffness, micro, coulomb, static, stribeck, viscous = parameters
    sliding = {
        "coulomb_force_n": coulomb,
        "static_force_n": static,
        "stribeck_velocity_m_s": stribeck,
        "stribeck_exponent": 2.0,
        "viscous_damping_n_s_m": viscous,
    }
    return classical(
        kind="lugre",
        stiffness_n_m=stiffness,
        micro_damping_n_s_m=micro,
        damping_velocity_m_s=None,
        curve="exponential",
        sliding=sliding,
    )


def by_trocar(model, positions):
    """Forces at the ends of the steps, from the Python package."""
    times = PERIOD * numpy.arange(positions.size)
    out = numpy.full(positions.size, numpy.nan)
    nanoseconds, _ = timed(lambda: trocar.simulate(model, times, positions, out=out), positions.size - 1)
    return nanoseconds, out[1:]


def by_trocar_many(model, widths, positions):
    """The same for seals of these half widths, seal after seal, in one call."""
    times = PERIOD * numpy.arange(positions.size)
    out, draws = numpy.full((widths.size, positions.size), numpy.nan), {"half_width_m": widths}
    options = {"parameters": draws, "threads": 1, "out": out}
    samples = widths.size * (positions.size - 1)
    nanoseconds, _ = timed(lambda: trocar.simulate_many(model, times, positions, **options), samples)
    return nanoseconds, out[:, 1:].ravel()


# The exact solutions in 80-bit numbers.


def exact_maxwell_slip(stiffness, limit, displacements):
    springs, forces = numpy.zeros(len(stiffness), LONG), []
    stiffness, limit = numpy.array(stiffness, LONG), numpy.array(limit, LONG)
    for displacement in displacements.astype(LONG):
        springs = numpy.clip(springs + stiffness * displacement, -limit, limit)
        forces.append(springs.sum())
    return numpy.array(forces)


def exact_lugre(parameters, displacements):
    """Forces at the ends and at the starts of the steps."""
    stiffness, micro, coulomb, static, stribeck, viscous = map(LONG, parameters)
    z, ends, starts = LONG(0), [], []

    def force(z, settled, velocity):
        rate = velocity * (1 - z / settled) if velocity else LONG(0)
        return stiffness * z + micro * rate + viscous * velocity

    for displacement in displacements.astype(LONG):
        velocity = displacement / LONG(PERIOD)
        level = coulomb + (static - coulomb) * numpy.exp(-((velocity / stribeck) ** 2))
        settled = numpy.copysign(level / stiffness, velocity)
        starts.append(force(z, settled, velocity))
        if velocity:
            z = settled + (z - settled) * numpy.exp(-abs(displacement / settled))
        ends.append(force(z, settled, velocity))
    return numpy.array(ends), numpy.array(starts)


# EMS with constant friction: bending on two branches, sliding on straight ends (docs of `ems.rs` and `elastic.rs`).


def ems_numbers(model):
    """(scalars, branches): c, kappa, F_c, beta, straight ends; per branch the join and two polynomials in z/c."""
    element = model.to_dict()["elements"][0]
    deformation, sliding = element["deformation"], element["insertion"]
    c = deformation["half_width_m"]
    branches = []
    for name in ("insertion", "withdrawal"):
        rows = []
        for piece in deformation[name]["pieces"]:
            domain = [piece["from_m"] / c, piece["to_m"] / c]
            series = numpy.polynomial.Legendre(piece["legendre_n"], domain=domain)
            rows.append(series.convert(kind=numpy.polynomial.Polynomial, domain=[-1, 1]).coef)
        branches.append([deformation[name]["join_m"] / c, *rows])
    slope = numpy.polynomial.polynomial.polyder
    end = numpy.polynomial.polynomial.polyval(1.0, slope(branches[0][2])) / c
    scalars = (c, deformation["yield_stiffness_n_m"], sliding["coulomb_force_n"], sliding["viscous_damping_n_s_m"], end)
    joins = numpy.array([branch[0] for branch in branches])
    return scalars, joins, numpy.array([branch[1:] for branch in branches])


def horner(coefficients, x):
    value = coefficients[-1]
    for k in range(len(coefficients) - 2, -1, -1):
        value = value * x + coefficients[k]
    return value


def ems_step(horner, exp, log1p):
    """The exact step at constant velocity, with the given functions: (z, q) and displacement -> (z, q, force)."""

    def step(z, q, displacement, period, c, kappa, coulomb, beta, end, joins, branches):
        left = period
        velocity = displacement / period
        lag = beta / end
        while True:
            side = 1.0 if z > 0.0 else -1.0
            if z * side >= c and (z * side > c or velocity * side > 0.0):
                excess, settled = z * side - c, lag * side * velocity
                final = settled + (excess - settled) * exp(-left / lag)
                if final >= 0.0:
                    return side * (c + final), 0.0, side * (coulomb + end * final)
                left -= lag * log1p(-excess / settled)
                z, q = side * c, 0.0
            target = z + velocity * left
            if target > c or target < -c:
                side = 1.0 if target > c else -1.0
                left = (target * side - c) / (velocity * side)
                z, q = side * c, 0.0
                continue
            x = target / c
            insertion = horner(branches[0, 0] if x < joins[0] else branches[0, 1], x)
            withdrawal = horner(branches[1, 0] if x < joins[1] else branches[1, 1], x)
            gap = max(0.5 * (insertion - withdrawal), 0.0)
            q = min(max(q + kappa * (target - z), -gap), gap)
            return target, q, 0.5 * (insertion + withdrawal) + q

    return step



horner_compiled = numba.njit(horner)
ems_compiled = numba.njit(ems_step(horner_compiled, math.exp, math.log1p))


@numba.njit
def ems_loop(scalars, joins, branches, displacements, forces):
    z, q = 0.0, 0.0
    c, kappa, coulomb, beta, end = scalars
    for k in range(displacements.size):
        z, q, forces[k] = ems_compiled(
            z, q, displacements[k], PERIOD, c, kappa, coulomb, beta, end, joins, branches
        )


@numba.njit
def ems_seals_loop(scalars, joins, branches, displacements, forces):
    for seal in range(scalars.shape[0]):
        c, kappa, coulomb, beta, end = scalars[seal, 0], scalars[seal, 1], scalars[seal, 2], scalars[seal, 3], scalars[seal, 4]
        ems_loop((c, kappa, coulomb, beta, end), joins[seal], branches[seal], displacements, forces[seal])


def ems_by_numba_many(numbers, displacements):
    forces = numpy.full((numbers[0].shape[0], displacements.size), numpy.nan)  # Memory already touched.
    nanoseconds, _ = timed(lambda: ems_seals_loop(*numbers, displacements, forces), forces.size)
    return nanoseconds, forces.ravel()


def exact_ems(numbers, displacements):
    scalars, joins, branches = numbers
    scalars, joins, branches = [LONG(x) for x in scalars], joins.astype(LONG), branches.astype(LONG)
    step, z, q, forces = ems_step(horner, numpy.exp, numpy.log1p), LONG(0), LONG(0), []
    for displacement in displacements.astype(LONG):
        z, q, force = step(z, q, displacement, LONG(PERIOD), *scalars, joins, branches)
        forces.append(force)
    return numpy.array(forces)


# The other programs: those of speed.py on processor time, and SciPy.


@numba.njit
def lugre_rate(stiffness, coulomb, static, stribeck, velocity, z):
    level = coulomb + (static - coulomb) * math.exp(-((velocity / stribeck) ** 2))
    return velocity - stiffness * abs(velocity) * z / level


def by_solve_ivp(parameters, velocities, method, tolerance):
    """Forces at the starts of the steps; one call for the whole motion, its steps not beyond one sample."""
    stiffness, micro, coulomb, static, stribeck, viscous = parameters
    count = velocities.size
    held = velocities.tolist()

    def rate(t, z):
        return lugre_rate(stiffness, coulomb, static, stribeck, held[min(int(t / PERIOD), count - 1)], z[0])

    grid = PERIOD * numpy.arange(count)
    options = {"method": method, "t_eval": grid, "max_step": PERIOD, "rtol": tolerance, "atol": 1e-3 * tolerance}
    span = (0.0, PERIOD * count)
    nanoseconds, found = timed(lambda: scipy.integrate.solve_ivp(rate, span, [0.0], **options), count)
    deflections = found.y[0]
    rates = [lugre_rate(stiffness, coulomb, static, stribeck, v, z) for v, z in zip(held, deflections)]
    return nanoseconds, stiffness * deflections + micro * numpy.array(rates) + viscous * velocities


def cases(samples):
    """Title, name -> (program, whether its forces are those at the ENDS or the STARTS), exact forces."""
    positions = speed.strokes(samples)
    displacements = numpy.diff(positions)
    velocities = displacements / PERIOD
    first = displacements[:EXACT_SAMPLES]
    few = velocities[:FEW_SAMPLES]
    sets = json.loads(speed.PARAMETERS.read_text())
    elements = [(each["stiffness_n_m"], each["limit_force_n"]) for each in sets[MAXWELL_SLIP]["elements"]]
    bank = [numpy.array(column) for column in zip(*elements)]
    lugre, _ = lugre_mujoco.LUGRE[LUGRE]
    plausible = trocar.Model.plausible()
    ems = ems_numbers(plausible)
    slips = [{"stiffness_n_m": k, "limit_force_n": limit} for k, limit in elements]
    maxwell_slip = classical(kind="maxwell-slip", elements=slips, viscous_damping_n_s_m=0.0)
    for loop, numbers in ((speed.maxwell_slip_loop, bank), (speed.lugre_loop, (*lugre, PERIOD)), (ems_loop, ems)):
        speed.by_numba(loop, displacements[:9], *numbers)  # Compiles.
    by_solve_ivp(lugre, few[:9], "RK45", 1e-6)
    widths = numpy.linspace(5.6e-3, 10.4e-3, SEALS)
    seals = [ems_numbers(plausible.tuned(half_width_m=width)) for width in widths.tolist()]
    seals = [numpy.array(numbers) for numbers in zip(*seals)]
    short = positions[: SEAL_SAMPLES + 1]
    ems_by_numba_many(seals, displacements[:9])  # Compiles.
    yield (
        f"Maxwell-Slip, {len(elements)} elements",
        {
            "trocar": (lambda: by_trocar(maxwell_slip, positions), ENDS),
            "Numba": (lambda: speed.by_numba(speed.maxwell_slip_loop, displacements, *bank), ENDS),
            "OpenSeesPy": (lambda: speed.by_opensees(elements, positions), ENDS),
        },
        (exact_maxwell_slip(*bank, first),),
    )
    yield (
        "LuGre",
        {
            "trocar": (lambda: by_trocar(lugre_model(lugre), positions), ENDS),
            "Numba": (lambda: speed.by_numba(speed.lugre_loop, displacements, *lugre, PERIOD), ENDS),
            "MuJoCo, `mujoco.rollout`": (lambda: speed.by_mujoco_rollout(lugre, velocities), STARTS),
            "MuJoCo, stepped from Python": (lambda: speed.by_mujoco(lugre, velocities), STARTS),
            "SciPy `solve_ivp`, RK45": (lambda: by_solve_ivp(lugre, few, "RK45", 1e-6), STARTS),
            "SciPy `solve_ivp`, LSODA": (lambda: by_solve_ivp(lugre, few, "LSODA", 1e-6), STARTS),
        },
        exact_lugre(lugre, first),
    )
    yield (
        "EMS, constant friction",
        {
            "trocar": (lambda: by_trocar(plausible, positions), ENDS),
            "Numba": (lambda: speed.by_numba(ems_loop, displacements, *ems), ENDS),
        },
        (exact_ems(ems, first),),
    )
    yield (
        f"EMS, constant friction, {SEALS} seals along one motion of {SEAL_SAMPLES} samples, per seal and sample",
        {
            "trocar, `simulate_many`": (lambda: by_trocar_many(plausible, widths, short), ENDS),
            "Numba": (lambda: ems_by_numba_many(seals, numpy.diff(short)), ENDS),
        },
        (exact_ems([number[0] for number in seals], numpy.diff(short)),),
    )
