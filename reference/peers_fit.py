"""One model fitted to one recording by several programs: what peers.py times.

The recording: LuGre along random strokes at 1 kHz, white noise on the force. All programs fit the same seven numbers to all
samples; the others start at the truth with every number wrong by 10 to 40 %, ours reads its starts off the data.
"""

import contextlib
import functools
import io
import time

import lmfit
import mujoco
import mujoco.sysid
import numba
import numpy
import scipy.optimize
import trocar

import lugre_mujoco
import peers_simulate
import speed
from speed import LUGRE, PERIOD

SAMPLES = 40_000
CHECK_SAMPLES = 5_000  # what `trocar.compare` scores its models on
NOISE_N = 0.025
SEED = 7
NAMES = ("stiffness", "micro_damping", "coulomb", "rise", "stribeck_velocity", "viscous_damping", "offset")
OFFSET_N = 0.05
WRONG = numpy.array([1.3, 0.7, 0.85, 1.4, 0.75, 1.25, 0.0])
LEAST = numpy.array([1.0, 0.0, 0.1, 0.0, 1e-4, 0.0, -numpy.inf])


def truth():
    (stiffness, micro, coulomb, static, stribeck, viscous), _ = lugre_mujoco.LUGRE[LUGRE]
    return numpy.array([stiffness, micro, coulomb, static - coulomb, stribeck, viscous, OFFSET_N])


def lugre_of(numbers):
    """(sigma0, sigma1, F_c, F_s, v_s, sigma2) of the seven numbers."""
    stiffness, micro, coulomb, rise, stribeck, viscous, _ = numbers
    return stiffness, micro, coulomb, coulomb + rise, stribeck, viscous


def forces_by(loop, numbers, displacements):
    forces = numpy.empty(displacements.size)
    loop(*lugre_of(numbers), PERIOD, displacements, forces)
    return forces + numbers[-1]


class Problem:
    def __init__(self):
        self.positions = speed.strokes(SAMPLES + CHECK_SAMPLES)
        random = numpy.random.Generator(numpy.random.PCG64(SEED))
        self.noise = NOISE_N * random.standard_normal(SAMPLES + CHECK_SAMPLES)
        displacements = numpy.diff(self.positions)
        self.readings = (forces_by(speed.lugre_loop, truth(), displacements) + self.noise)[:SAMPLES]
        self.displacements = displacements[:SAMPLES]
        self.start = numpy.where(WRONG > 0.0, WRONG * truth(), 0.0)
        self.recording = self.recorded(0, SAMPLES, displacements)
        self.check = self.recorded(SAMPLES, SAMPLES + CHECK_SAMPLES, displacements)

    def recorded(self, first, last, displacements):
        readings = forces_by(speed.lugre_loop, truth(), displacements) + self.noise
        # The force of step k is that at its end.
        times = PERIOD * numpy.arange(first, last)
        return trocar.Recording(times, self.positions[first + 1 : last + 1], readings[first:last], name=f"from {first}")

    def judge(self, numbers):
        """Root mean square of what the numbers leave, N, and the worst of them in parts of the truth, the offset in N."""
        left = forces_by(speed.lugre_loop, numbers, self.displacements) - self.readings
        scale = numpy.append(truth()[:-1], 1.0)
        return numpy.sqrt(numpy.mean(left**2)), numpy.max(numpy.abs(numbers - truth()) / scale)


def timed(program):
    start = time.process_time()
    found = program()
    return time.process_time() - start, found


def by_trocar(problem):
    """The fit of one model within `trocar.compare`, with the search for starts and the intervals; wall time, its own."""
    compared = compared_once(problem)[1]
    return compared.models[0].fit_s, numbers_of(compared.models[0].model)


def by_trocar_as_a_whole(problem):
    """All of `trocar.compare`: the EMS identification that every comparison begins with, the fit, the scores."""
    seconds, compared = compared_once(problem)
    return seconds, numbers_of(compared.models[0].model)


@functools.cache
def compared_once(problem):
    options = {"validate": problem.check, "models": ["lugre"], "threads": 1, "timing": True}
    return timed(lambda: trocar.compare(problem.recording, **options))


def numbers_of(model):
    document = model.to_dict()
    friction, offset = document["friction"], model.sensor_offset_n
    sliding = friction["sliding"]
    rise = sliding["static_force_n"] - sliding["coulomb_force_n"]
    head = (friction["stiffness_n_m"], friction["micro_damping_n_s_m"], sliding["coulomb_force_n"], rise)
    return numpy.array([*head, sliding["stribeck_velocity_m_s"], sliding["viscous_damping_n_s_m"], offset])


def by_least_squares(problem, loop):
    def residual(numbers):
        return forces_by(loop, numbers, problem.displacements) - problem.readings

    options = {"bounds": (LEAST, numpy.inf), "x_scale": "jac"}
    seconds, found = timed(lambda: scipy.optimize.least_squares(residual, problem.start, **options))
    return seconds, found.x


def by_lmfit(problem, loop):
    parameters = lmfit.Parameters()
    for name, value, least in zip(NAMES, problem.start, LEAST):
        parameters.add(name, value=value, min=least)

    def residual(parameters):
        numbers = [parameters[name].value for name in NAMES]
        return forces_by(loop, numbers, problem.displacements) - problem.readings

    seconds, found = timed(lambda: lmfit.minimize(residual, parameters))
    return seconds, numpy.array([found.params[name].value for name in NAMES])


class Sysid:
    """`mujoco.sysid` with its own optimiser; the body is pushed from velocity to velocity as in speed.py."""

    def __init__(self, problem):
        self.problem = problem
        self.velocities = problem.displacements / PERIOD
        self.spec = self.made(problem.start)
        model = self.spec.compile()
        times = PERIOD * numpy.arange(SAMPLES + 1)
        controls = numpy.append(numpy.diff(self.velocities), [0.0, 0.0])[:, None]  # the friction takes none
        control_map = mujoco.sysid.TimeSeries.compute_all_control_mapping(model)
        sensor_map = mujoco.sysid.TimeSeries.compute_all_sensor_mapping(model)
        self.measured = mujoco.sysid.TimeSeries(times[1:], problem.readings[:, None], sensor_map)
        initial = mujoco.sysid.create_initial_state(model, numpy.zeros(1), self.velocities[:1], numpy.zeros(1))
        control = mujoco.sysid.TimeSeries(times, controls, control_map)
        sequences = mujoco.sysid.ModelSequences("slide", self.spec, "strokes", initial, control, self.measured)
        self.residual = mujoco.sysid.build_residual_fn(
            models_sequences=[sequences],
            build_model=lambda parameters, _: self.made(parameters.as_vector()).compile(),
            modify_residual=self.difference,
            n_threads=1,
            resample_true=False,
        )

    def made(self, numbers):
        *lugre, damping = lugre_of(numbers)
        xml = lugre_mujoco.XML.format(lugre=" ".join(map(repr, map(float, lugre))), damping=float(damping), mass=speed.HEAVY)
        push = f'<motor name="push" joint="slide" gear="{speed.HEAVY / PERIOD!r}"/></actuator>'
        sensor = '<sensor><jointactuatorfrc name="force" joint="slide"/></sensor></mujoco>'
        spec = mujoco.MjSpec.from_string(xml.replace("</actuator>", push).replace("</mujoco>", sensor))
        spec.option.timestep = PERIOD
        return spec

    def difference(self, parameters, predicted, measured, model, return_all, state, sensor_weights=None):
        """Forces at the ends of the steps, from the deflections that MuJoCo gives, less the readings."""
        numbers, velocities = parameters.as_vector(), self.velocities
        stiffness, micro, coulomb, static, stribeck, viscous = lugre_of(numbers)
        deflections = state[:, 3]
        level = coulomb + (static - coulomb) * numpy.exp(-((velocities / stribeck) ** 2))
        rates = velocities - stiffness * numpy.abs(velocities) * deflections / level
        forces = stiffness * deflections + micro * rates + viscous * velocities + numbers[-1]
        return forces - self.problem.readings, self.measured, self.measured

    def fit(self):
        parameters = mujoco.sysid.ParameterDict()
        for name, value, least in zip(NAMES, self.problem.start, LEAST):
            least = max(least, -10.0)
            parameters.add(mujoco.sysid.Parameter(name, value, least, 10.0 * abs(value) + 1.0))
        options = {"optimizer": "mujoco", "verbose": False, "x_scale": "jac"}
        with contextlib.redirect_stdout(io.StringIO()):
            seconds, (found, _) = timed(lambda: mujoco.sysid.optimize(parameters, self.residual, **options))
        return seconds, found.as_vector()


def cases():
    """Title, name -> program, judge of the numbers that a program finds."""
    problem = Problem()
    plain = speed.lugre_loop.py_func
    sysid = Sysid(problem)
    yield (
        "LuGre, seven numbers",
        {
            "trocar": lambda: by_trocar(problem),
            "trocar, the whole comparison": lambda: by_trocar_as_a_whole(problem),
            "SciPy `least_squares`, Numba": lambda: by_least_squares(problem, speed.lugre_loop),
            "lmfit, Numba": lambda: by_lmfit(problem, speed.lugre_loop),
            "SciPy `least_squares`, plain Python": lambda: by_least_squares(problem, plain),
            "lmfit, plain Python": lambda: by_lmfit(problem, plain),
            "`mujoco.sysid`": sysid.fit,
        },
        problem.judge,
    )
