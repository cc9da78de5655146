"""Variants of LuGre and Dahl that MuJoCo does not have, integrated by solve_ivp one interval after the other.

LuGre, rational curve, other exponents, damping that fades with speed:
    dz/dt = v - sigma0 |v| z / g(v),                    F = sigma0 z + sigma1 exp(-(v/v_d)^2) dz/dt + sigma2 v
    g = F_c + (F_s - F_c) exp(-(|v|/v_s)^delta)         or F_c + (F_s - F_c) / (1 + (|v|/v_s)^delta)
Dahl of exponent i:
    dF/dt = sigma v |r|^i sgn(r),  r = 1 - F sgn(v)/F_c

Confirmed by the closed forms: an exponential, and for Dahl a power law in the travel.
"""

import math

import scipy.integrate

import motion
import vectors


class LuGre:
    kind = "lugre"

    def __init__(self, stiffness, micro_damping, damping_velocity, curve, shape, exponent):
        self.stiffness, self.micro_damping, self.damping_velocity = stiffness, micro_damping, damping_velocity
        self.curve, self.shape, self.exponent = curve, shape, exponent

    def level(self, velocity):
        coulomb, static, stribeck, _ = self.curve
        power = (abs(velocity) / stribeck) ** self.exponent
        return coulomb + (static - coulomb) * (math.exp(-power) if self.shape == "exponential" else 1.0 / (1.0 + power))

    def scale(self):
        return self.curve[0] / self.stiffness

    def rate(self, deflection, velocity):
        return velocity - self.stiffness * abs(velocity) * deflection / self.level(velocity)

    def output(self, deflection, velocity):
        fading = 1.0 if self.damping_velocity is None else math.exp(-((velocity / self.damping_velocity) ** 2))
        micro = self.micro_damping * fading * self.rate(deflection, velocity)
        return self.stiffness * deflection + micro + self.curve[3] * velocity

    def closed_form(self, deflection, velocity, duration):
        settled = math.copysign(self.level(velocity) / self.stiffness, velocity)
        return settled + (deflection - settled) * math.exp(-duration * abs(velocity / settled))

    def described(self):
        return {
            "stiffness_n_m": self.stiffness,
            "micro_damping_n_s_m": self.micro_damping,
            "damping_velocity_m_s": self.damping_velocity,
            "curve": self.shape,
            "sliding": vectors.sliding(*self.curve, exponent=self.exponent),
        }


class Dahl:
    """Its state is the force."""

    kind = "dahl"

    def __init__(self, stiffness, coulomb_force, exponent):
        self.stiffness, self.coulomb_force, self.exponent = stiffness, coulomb_force, exponent

    def scale(self):
        return self.coulomb_force

    def rate(self, force, velocity):
        r = 1.0 - math.copysign(force, force * velocity) / self.coulomb_force
        return self.stiffness * velocity * math.copysign(abs(r) ** self.exponent, r)

    def output(self, force, _):
        return force

    def closed_form(self, force, velocity, duration):
        i, sign = self.exponent, math.copysign(1.0, velocity)
        travel = self.stiffness * abs(velocity) * duration / self.coulomb_force
        r = max(0.0, 1.0 - sign * force / self.coulomb_force)
        if i < 1.0:
            r = max(0.0, r ** (1.0 - i) - (1.0 - i) * travel) ** (1.0 / (1.0 - i))
        elif r > 0.0:
            r *= (1.0 + (i - 1.0) * travel * r ** (i - 1.0)) ** (-1.0 / (i - 1.0))
        return sign * self.coulomb_force * (1.0 - r)

    def described(self):
        return {"stiffness_n_m": self.stiffness, "coulomb_force_n": self.coulomb_force, "exponent": self.exponent}


def integrate(model, state, velocity, duration):
    tolerance = {"rtol": 1e-13, "atol": 1e-14 * model.scale()}

    def rate(_, y):
        return [model.rate(y[0], velocity)]

    solution = scipy.integrate.solve_ivp(rate, (0.0, duration), [state], "DOP853", **tolerance)
    return float(solution.y[0, -1])


def simulate(model, steps, advance):
    """State and force at the start of each interval; the last row at rest."""
    state, states, forces = 0.0, [], []
    for _, duration, velocity in steps + [(0.0, 1.0, 0.0)]:
        states.append(state)
        forces.append(model.output(state, velocity))
        if velocity != 0.0:
            state = advance(model, state, velocity, duration)
    return states, forces


CURVE = (1.7, 2.5, 0.012, 3.3)

SETS = {
    "lugre_rational": (LuGre(810.0, 1.1, None, CURVE, "rational", 1.6), motion.nested(4e-3, 0.03)),
    "lugre_linear": (LuGre(810.0, 1.1, None, CURVE, "exponential", 1.0), motion.nested(4e-3, 0.03)),
    "lugre_fading": (LuGre(810.0, 22.0, 0.03, CURVE, "exponential", 2.0), motion.coarse(5e-3, 0.015)),
    "dahl_half": (Dahl(540.0, 1.8, 0.5), motion.nested(5e-3, 0.04)),
    "dahl_double": (Dahl(540.0, 1.8, 2.0), motion.nested(5e-3, 0.04)),
    "dahl_steep": (Dahl(3e5, 2.6, 1.5), motion.coarse(1e-4, 1e-3)),
}


def main():
    for name, (model, legs) in SETS.items():
        times, positions = motion.sampled(legs)
        steps = motion.intervals(times, positions)
        states, forces = simulate(model, steps, integrate)
        _, confirmation = simulate(model, steps, lambda model, *interval: model.closed_form(*interval))
        columns = {
            "time_s": times,
            "position_m": positions,
            "velocity_m_s": [velocity for _, _, velocity in steps] + [0.0],
            "deflection_m": [state if model.kind == "lugre" else state / model.stiffness for state in states],
            "force_n": forces,
        }
        vectors.write(name, model.kind, vectors.versions("scipy", "numpy"), model.described(), columns, confirmation)


if __name__ == "__main__":
    main()
