"""Time per sample of the same motion through this project's models and through other programs, in one run.

    reference/python reference/speed.py EXAMPLE [SAMPLES [REPETITIONS]]

EXAMPLE is the built example `speed` of trocar-model. The programs take turns, so that a busy machine slows all of them;
printed are medians. README.md says what each time includes.
"""

import json
import math
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import mujoco
import mujoco.rollout
import numba
import numpy

import lugre_mujoco
import opensees

PERIOD = 1e-3  # s
SEED = 20
STROKE = 0.04  # m
MAXWELL_SLIP, LUGRE = "maxwell_slip_seal", "lugre_seal"
PARAMETERS = pathlib.Path(__file__).parent / "vectors" / "parameters.json"

# Mass in kg against which friction is nothing: velocity is what the applied force makes of it. A power of two.
HEAVY = 2.0**50

clock = time.perf_counter_ns  # peers.py takes processor time: its programs all run in one process


def strokes(samples):
    """Positions at 1 kHz: strokes of up to 40 mm and 0.05 to 0.8 s between random points, every eighth a hold."""
    random = numpy.random.Generator(numpy.random.PCG64(SEED))
    positions = [0.0]
    while len(positions) <= samples:
        count = int(random.integers(50, 800))
        origin = positions[-1]
        target = origin if random.integers(8) == 0 else STROKE * random.random()
        positions.extend(origin + (target - origin) * (k / count) for k in range(1, count + 1))
    return numpy.array(positions[: samples + 1])


class Trocar:
    """The built example as a process of its own, which times its steps itself."""

    def __init__(self, example, folder, positions):
        self.example, self.folder = example, folder
        self.positions = folder / "positions"
        positions.astype("<f8").tofile(self.positions)

    def timed(self, name):
        """Nanoseconds per step, sample by sample and as a whole array; forces at the ends and at the starts of the steps."""
        forces = self.folder / "forces"
        command = [self.example, PARAMETERS, name, self.positions, forces]
        printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        ends, starts = numpy.fromfile(forces, "<f8").reshape(2, -1)
        return [float(word) for word in printed.split()], ends, starts


@numba.njit
def maxwell_slip_loop(stiffness, limit, displacements, forces):
    springs = numpy.zeros(stiffness.size)
    for k in range(displacements.size):
        force = 0.0
        for i in range(stiffness.size):
            springs[i] = min(max(springs[i] + stiffness[i] * displacements[k], -limit[i]), limit[i])
            force += springs[i]
        forces[k] = force


@numba.njit
def lugre_loop(stiffness, micro, coulomb, static, stribeck, viscous, period, displacements, forces):
    z = 0.0
    for k in range(displacements.size):
        velocity = displacements[k] / period
        if velocity == 0.0:
            forces[k] = stiffness * z
            continue
        level = coulomb + (static - coulomb) * math.exp(-((velocity / stribeck) ** 2))
        settled = math.copysign(level / stiffness, velocity)
        z = settled + (z - settled) * math.exp(-abs(displacements[k] / settled))
        rate = velocity * (1.0 - z / settled)
        forces[k] = stiffness * z + micro * rate + viscous * velocity


def by_numba(loop, displacements, *parameters):
    """Nanoseconds per sample and forces at the ends of the steps."""
    forces = numpy.full(displacements.size, numpy.nan)  # Memory already touched.
    start = clock()
    loop(*parameters, displacements, forces)
    return (clock() - start) / displacements.size, forces


def by_opensees(elements, positions):
    """Forces at the ends of the steps; two calls from Python per sample."""
    solver = opensees.load()
    opensees.maxwell_slip(solver, elements)
    positions, forces = positions[1:].tolist(), []
    set_strain, get_stress, keep = solver.setStrain, solver.getStress, forces.append
    start = clock()
    for position in positions:
        set_strain(position)
        keep(get_stress())
    return (clock() - start) / len(positions), numpy.array(forces)


def by_mujoco(parameters, velocities):
    """Forces at the starts of the steps; one mj_step from Python per sample, velocity set and force read there."""
    solver = lugre_mujoco.model(parameters)
    solver.opt.timestep = PERIOD
    data = mujoco.MjData(solver)
    velocity, active, passive = data.qvel, data.qfrc_actuator, data.qfrc_passive
    velocities, forces = velocities.tolist(), []
    start = clock()
    for v in velocities:
        velocity[0] = v
        mujoco.mj_step(solver, data)
        forces.append(-active[0] - passive[0])
    return (clock() - start) / len(velocities), numpy.array(forces)


def by_mujoco_rollout(parameters, velocities):
    """Forces at the starts of the steps; MuJoCo's own compiled loop of mj_step.

    The loop takes forces, not velocities: a body of huge mass is pushed from one velocity to the next. Forces are
    computed from the deflections afterwards, outside the time.
    """
    solver = lugre_mujoco.model(parameters, HEAVY)
    solver.opt.timestep = PERIOD
    data = mujoco.MjData(solver)
    push = HEAVY * numpy.diff(velocities, append=velocities[-1]) / PERIOD
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = numpy.zeros(mujoco.mj_stateSize(solver, kind))
    initial[2] = velocities[0]  # time, position, velocity, deflection
    states = numpy.full((1, velocities.size, initial.size), numpy.nan)
    spec = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
    with mujoco.rollout.Rollout(nthread=0) as rollout:
        start = clock()
        rollout.rollout(solver, data, initial, push.reshape(1, -1, 1), control_spec=spec, state=states)
        nanoseconds = (clock() - start) / velocities.size
    deflections = numpy.concatenate(([0.0], states[0, :-1, 3]))
    stiffness, micro, coulomb, static, stribeck, viscous = parameters
    level = coulomb + (static - coulomb) * numpy.exp(-((velocities / stribeck) ** 2))
    rates = velocities - stiffness * numpy.abs(velocities) * deflections / level
    return nanoseconds, stiffness * deflections + micro * rates + viscous * velocities


ENDS, STARTS = 0, 1


def take_turns(title, ours, others, repetitions):
    """Prints a table: median, spread, times ours, largest difference of force to ours.

    others: name -> (program, whether its forces are those at the ENDS or the STARTS of the steps)
    """
    own = ["trocar, step by step", "trocar, whole array"]
    times = {name: [] for name in [*own, *others]}
    differences = dict.fromkeys(others, 0.0)
    for _ in range(repetitions):
        both, *forces = ours()
        for name, nanoseconds in zip(own, both):
            times[name].append(nanoseconds)
        for name, (program, which) in others.items():
            nanoseconds, found = program()
            times[name].append(nanoseconds)
            differences[name] = max(differences[name], float(numpy.max(numpy.abs(found - forces[which]))))
    print(f"\n{title}")
    print(f"  {'':32} {'median':>8} {'fastest':>8} {'slowest':>8} {'x trocar':>9}  largest difference")
    reference = statistics.median(times[own[1]])
    for name, all_times in times.items():
        median = statistics.median(all_times)
        numbers = f"{median:8.1f} {min(all_times):8.1f} {max(all_times):8.1f} {median / reference:9.2f}"
        print(f"  {name:32} {numbers}" + (f"  {differences[name]:.0e} N" if name in differences else ""))


def main():
    example = pathlib.Path(sys.argv[1])
    samples = int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000
    repetitions = int(sys.argv[3]) if len(sys.argv) > 3 else 7
    sets = json.loads(PARAMETERS.read_text())
    positions = strokes(samples)
    displacements = numpy.diff(positions)
    velocities = displacements / PERIOD
    elements = [(each["stiffness_n_m"], each["limit_force_n"]) for each in sets[MAXWELL_SLIP]["elements"]]
    bank = [numpy.array(column) for column in zip(*elements)]
    lugre, _ = lugre_mujoco.LUGRE[LUGRE]
    by_numba(maxwell_slip_loop, displacements[:9], *bank)  # Compiles.
    by_numba(lugre_loop, displacements[:9], *lugre, PERIOD)
    print(f"ns per sample, {samples} samples at 1 kHz, median of {repetitions} turns")
    with tempfile.TemporaryDirectory() as folder:
        trocar = Trocar(example, pathlib.Path(folder), positions)
        others = {
            "Numba": (lambda: by_numba(maxwell_slip_loop, displacements, *bank), ENDS),
            "OpenSeesPy, called from Python": (lambda: by_opensees(elements, positions), ENDS),
        }
        title = f"Maxwell-Slip, {len(elements)} elements"
        take_turns(title, lambda: trocar.timed(MAXWELL_SLIP), others, repetitions)
        others = {
            "Numba": (lambda: by_numba(lugre_loop, displacements, *lugre, PERIOD), ENDS),
            "MuJoCo, its compiled loop": (lambda: by_mujoco_rollout(lugre, velocities), STARTS),
            "MuJoCo, called from Python": (lambda: by_mujoco(lugre, velocities), STARTS),
        }
        take_turns("LuGre", lambda: trocar.timed(LUGRE), others, repetitions)


if __name__ == "__main__":
    main()
