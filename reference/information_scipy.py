"""Fisher information about an Extended Maxwell-Slip element from a planned motion, for `trocar plan`.

    dz/dt = v - max(0, F_e - F_c)/beta + max(0, -F_e - F_c)/beta       F = F_e(z), no seal damping
    F_e: two straight pieces a branch, joined at a; F_u while z rises, F_d while it falls, one line outside [-c, c]

On full strokes at constant velocity between samples this has a closed form, confirmed by solve_ivp. The readings are
y = o + (1 + e_g)*F + noise, with a friction scale e_g of standard deviation tau for each stroke. The information is taken from the
whole covariance C of the readings, dense, sample by sample: A' C^-1 A, A by central differences of the closed form.
"""

import numpy
import scipy.integrate

import ems
import vectors

NAMES = [
    "offset_n",
    "coulomb_force_n",
    "viscous_damping_n_s_m",
    "half_width_m",
    "insertion_join_fraction",
    "insertion_join_force_n",
    "withdrawal_join_fraction",
    "withdrawal_join_force_n",
]
VALUES = [0.0, 3.0, 8.0, 0.006, -0.2, 0.9, 0.25, -1.1]
NOISE, SCATTER = 0.025, 0.01  # N, relative
RATE = 200.0  # Hz
STROKE = 0.06  # m
SPEEDS = [0.08, 0.08, 0.02, 0.05]  # m/s, one a cycle; the first cycle makes the state known
RAMP = 0.04  # s


def motion():
    """Times, positions and the sample at which the first cycle ends: strokes with ramps of speed, whole in samples."""
    speed, first = [0.0], 0
    for cycle, top in enumerate(SPEEDS):
        ramp, samples = round(RAMP * RATE), round(STROKE / top * RATE)
        up = top * (numpy.arange(ramp) + 0.5) / ramp
        stroke = numpy.concatenate([up, numpy.full(samples - ramp, top), up[::-1]])
        speed += [*stroke, *-stroke]
        first = len(speed) - 1 if cycle == 0 else first
    position = 0.05 + numpy.cumsum(speed) / RATE
    return numpy.arange(len(position)) / RATE, position, first


def deformation(values, z, rises):
    """F_e at deflection z; and its slope outside [-c, c]."""
    _, coulomb, _, width, up, up_force, down, down_force = values
    high, low = (coulomb - up_force) / (width * (1.0 - up)), (down_force + coulomb) / (width * (1.0 + down))
    join, force = (up * width, up_force) if rises else (down * width, down_force)
    inside = numpy.interp(z, [-width, join, width], [-coulomb, force, coulomb])
    return inside + high * max(0.0, z - width) + low * min(0.0, z + width), high, low


def forces(values, time, position):
    """The force at each sample, in closed form."""
    beta, width = values[2], values[3]
    z, force = 0.0, [0.0]
    for step, duration in zip(numpy.diff(position), numpy.diff(time)):
        velocity = step / duration
        _, high, low = deformation(values, z, velocity > 0.0)
        z = ems.deflected(z, velocity, duration, beta, width, low, high)
        force.append(float(deformation(values, z, velocity > 0.0)[0]))
    return numpy.array(force)


def integrated(values, time, position):
    """The same by solve_ivp, interval by interval."""
    coulomb, beta = values[1], values[2]
    z, force = 0.0, [0.0]
    for step, duration in zip(numpy.diff(position), numpy.diff(time)):
        velocity = step / duration

        def rate(_, state):
            elastic = deformation(values, state[0], velocity > 0.0)[0]
            slip = max(0.0, elastic - coulomb) - max(0.0, -elastic - coulomb)
            return [velocity - slip / beta]

        solved = scipy.integrate.solve_ivp(rate, (0.0, duration), [z], method="DOP853", rtol=1e-12, atol=1e-15, max_step=duration / 50)
        z = solved.y[0, -1]
        force.append(float(deformation(values, z, velocity > 0.0)[0]))
    return numpy.array(force)


def derivatives(time, position):
    """dF/d(parameter) at each sample, central differences."""
    columns = [numpy.ones(len(time))]
    for k in range(1, len(VALUES)):
        step = 1e-6 * abs(VALUES[k])
        ends = [[v + sign * step * (j == k) for j, v in enumerate(VALUES)] for sign in (1.0, -1.0)]
        high, low = (forces(values, time, position) for values in ends)
        columns.append((high - low) / (2.0 * step))
    return numpy.array(columns).T


def information(time, position, first):
    """A' C^-1 A of the samples after the first cycle."""
    used = slice(first + 1, None)
    a, force = derivatives(time, position)[used], forces(VALUES, time, position)[used]
    stroke = numpy.cumsum(numpy.diff(numpy.sign(numpy.diff(position)), prepend=0.0) != 0.0)[first:]
    same = stroke[:, None] == stroke[None, :]
    covariance = NOISE**2 * numpy.eye(len(force)) + SCATTER**2 * numpy.outer(force, force) * same
    return a.T @ numpy.linalg.solve(covariance, a)


def main():
    time, position, first = motion()
    force = forces(VALUES, time, position)
    columns = {"time_s": time.tolist(), "position_m": position.tolist(), "force_n": force.tolist()}
    parameters = {
        "parameters": dict(zip(NAMES, VALUES)),
        "noise_n": NOISE,
        "scatter": SCATTER,
        "from_s": float(time[first]),
        # Nine digits: the last ones of a solution depend on the library of linear algebra.
        "information": [[float(f"{v:.9e}") for v in row] for row in information(time, position, first)],
        "order": NAMES,
    }
    made_with = vectors.versions("numpy", "scipy")
    vectors.write("ems_information", "ems", made_with, parameters, columns, integrated(VALUES, time, position).tolist())


if __name__ == "__main__":
    main()
