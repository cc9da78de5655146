"""An element that turns on a seal that snaps through, integrated by solve_ivp.

    dz/dt = V - v,  v = F/|F| (|F| - F_c)/beta where |F| > F_c, else 0,  F = (f(z_x), k_t z_t)
    f(z) = A (z^5/5 - 65/12 z^3 + 49 z), z in mm, falling from 2 to 3.5 mm; straight beyond +-c, where f(c) = F_c

The rates are continuous with kinks at yield and at +-c, which the control of the step finds. Confirmed by another method of
integration.
"""

import math

import scipy.integrate
import scipy.optimize

import motion
import vectors

A, COULOMB, BETA, AROUND = 0.0131, 1.5, 2.0, 260.0  # N, N, N s/m, N/m
TOLERANCE = {"rtol": 1e-11, "atol": 1e-14}
# N: what two methods with that tolerance differ by after thousands of steps.
CONFIRMED = 1e-8


def curve(z):
    z = z * 1e3
    return A * (z**5 / 5.0 - 65.0 / 12.0 * z**3 + 49.0 * z)


def slope(z):
    z = z * 1e3
    return 1e3 * A * (z**4 - 65.0 / 4.0 * z**2 + 49.0)


WIDTH = scipy.optimize.brentq(lambda z: curve(z) - COULOMB, 3.5e-3, 8e-3, xtol=1e-18, rtol=1e-15)


def along(z):
    beyond = max(abs(z) - WIDTH, 0.0)
    return curve(z) if beyond == 0.0 else math.copysign(COULOMB + slope(WIDTH) * beyond, z)


def rates(_, z, velocity):
    force = (along(z[0]), AROUND * z[1])
    size = math.hypot(*force)
    slip = (size - COULOMB) / BETA / size if size > COULOMB else 0.0
    return [velocity[i] - slip * force[i] for i in (0, 1)]


def simulate(times, positions, arcs, method):
    z, forces = [0.0, 0.0], [(0.0, 0.0)]
    for k in range(len(times) - 1):
        duration = times[k + 1] - times[k]
        velocity = [(positions[k + 1] - positions[k]) / duration, (arcs[k + 1] - arcs[k]) / duration]
        found = scipy.integrate.solve_ivp(rates, (0.0, duration), z, method, args=(velocity,), **TOLERANCE)
        z = [float(part) for part in found.y[:, -1]]
        forces.append((along(z[0]), AROUND * z[1]))
    return forces


def main():
    # Strokes, then turning to and fro during strokes and holds: the seal snaps back as it turns.
    legs = [
        (0.012, 0.0), (0.0, 0.004), (0.0, 0.02), (-0.003, -0.01), (-0.015, 0.002), (0.0, 0.012), (0.006, -0.02),
        (0.001, -0.01), (0.012, 0.03), (0.0, -0.006), (-0.004, 0.0), (0.004, 0.0), (-0.012, 0.012), (-0.012, -0.012),
    ]  # fmt: skip
    seconds, samples = 0.4, 40
    times, positions = motion.sampled([(leg[0], seconds, samples) for leg in legs])
    _, arcs = motion.sampled([(leg[1], seconds, samples) for leg in legs])
    forces = simulate(times, positions, arcs, "DOP853")
    confirmation = simulate(times, positions, arcs, "Radau")
    columns = {
        "time_s": times,
        "position_m": positions,
        "arc_m": arcs,
        "force_n": [force[0] for force in forces],
        "circumferential_force_n": [force[1] for force in forces],
    }
    parameters = {
        "coulomb_force_n": COULOMB,
        "viscous_damping_n_s_m": BETA,
        "circumferential_stiffness_n_m": AROUND,
        "half_width_m": WIDTH,
        "monomial": [0.0, A * 49.0 * 1e3, 0.0, -A * 65.0 / 12.0 * 1e9, 0.0, A / 5.0 * 1e15],
    }
    made_with = vectors.versions("scipy", "numpy")
    confirmed = [force[0] for force in confirmation]
    vectors.write("turning_snap", "turning_snap", made_with, parameters, columns, confirmed, CONFIRMED)


if __name__ == "__main__":
    main()
