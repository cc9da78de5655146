"""Bouc-Wen as Wen writes it, with A = 1, integrated by solve_ivp one interval after the other.

    dz/dt = v - beta |v| |z|^(n-1) z - gamma v |z|^n,   F = k z

Confirmed by the travel between two values of z as a hypergeometric function, solved for the end:
with w = z (beta + gamma)^(1/n)
    loading     w 2F1(1, 1/n; 1 + 1/n; w^n)                               while |w| rises
    unloading   w 2F1(1, 1/n; 1 + 1/n; (gamma - beta)/(beta + gamma) w^n) while |w| falls
"""

import math

import scipy.integrate
import scipy.optimize
import scipy.special

import motion
import vectors


class BoucWen:
    def __init__(self, stiffness, coulomb_force, exponent, unloading_shape):
        self.stiffness, self.coulomb_force = stiffness, coulomb_force
        self.exponent, self.unloading_shape = exponent, unloading_shape
        # Of z in metres.
        self.size = coulomb_force / stiffness
        both = self.size**-exponent
        self.beta, self.gamma = unloading_shape * both, (1.0 - unloading_shape) * both

    def rate(self, z, velocity):
        power = abs(z) ** self.exponent
        return velocity - self.beta * abs(velocity) * math.copysign(power, z) - self.gamma * velocity * power

    def integrate(self, z, velocity, duration):
        def rate(_, y):
            return [self.rate(y[0], velocity)]

        def zero(_, y):
            return y[0]

        zero.terminal, zero.direction = True, math.copysign(1.0, velocity)
        tolerance = {"rtol": 1e-13, "atol": 1e-14 * self.size, "events": zero}
        left = duration
        if z * velocity < 0.0:
            # The law changes at z = 0, which ends the first part.
            solution = scipy.integrate.solve_ivp(rate, (0.0, duration), [z], "DOP853", **tolerance)
            if solution.status != 1:
                return float(solution.y[0, -1])
            left, z = duration - float(solution.t_events[0][0]), 0.0
        del tolerance["events"]
        return float(scipy.integrate.solve_ivp(rate, (0.0, left), [z], "DOP853", **tolerance).y[0, -1])

    def travel(self, w, factor):
        """Travel over size from 0 to w >= 0, along dw/dtravel = 1 - factor w^n."""
        n = self.exponent
        return w * scipy.special.hyp2f1(1.0, 1.0 / n, 1.0 + 1.0 / n, factor * w**n)

    def closed_form(self, z, velocity, duration):
        sign, left = math.copysign(1.0, velocity), abs(velocity) * duration / self.size
        u = sign * z / self.size
        if u < 0.0:
            factor = 1.0 - 2.0 * self.unloading_shape
            away = self.travel(-u, factor)
            if left < away:
                return -sign * self.size * inverse(lambda w: self.travel(w, factor) - (away - left), -u)
            u, left = 0.0, left - away
        end = self.travel(u, 1.0) + left
        # What is left to 1 falls as exp(-n travel) or faster beyond some travel.
        last = 1.0 - 1e-13
        if self.travel(last, 1.0) < end:
            return sign * self.size
        return sign * self.size * inverse(lambda w: self.travel(w, 1.0) - end, last)

    def described(self):
        return {
            "stiffness_n_m": self.stiffness,
            "coulomb_force_n": self.coulomb_force,
            "exponent": self.exponent,
            "unloading_shape": self.unloading_shape,
        }


def inverse(function, largest):
    return scipy.optimize.brentq(function, 0.0, largest, xtol=1e-16, rtol=4e-15)


def simulate(model, steps, advance):
    """Deflection and force at the start of each interval; the last row at rest."""
    z, states, forces = 0.0, [], []
    for _, duration, velocity in steps + [(0.0, 1.0, 0.0)]:
        states.append(z)
        forces.append(model.stiffness * z)
        if velocity != 0.0:
            z = advance(z, velocity, duration)
    return states, forces


SETS = {
    "bouc_wen_1_seal": (BoucWen(540.0, 1.8, 1.0, 0.7), motion.nested(5e-3, 0.04)),
    "bouc_wen_1_stiff": (BoucWen(3e5, 2.6, 1.0, 2.5), motion.coarse(1e-4, 1e-3)),
    "bouc_wen_2_seal": (BoucWen(540.0, 1.8, 2.0, 0.5), motion.nested(5e-3, 0.04)),
    "bouc_wen_2_coarse": (BoucWen(810.0, 1.7, 2.0, 0.9), motion.coarse(5e-3, 0.015)),
    "bouc_wen_3_tiny": (BoucWen(700.0, 2.0, 3.4, 0.8), motion.creep(5e-3, 0.04, 1e-3)),
}


def main():
    for name, (model, legs) in SETS.items():
        times, positions = motion.sampled(legs)
        steps = motion.intervals(times, positions)
        states, forces = simulate(model, steps, model.integrate)
        _, confirmation = simulate(model, steps, model.closed_form)
        columns = {
            "time_s": times,
            "position_m": positions,
            "velocity_m_s": [velocity for _, _, velocity in steps] + [0.0],
            "deflection_m": states,
            "force_n": forces,
        }
        vectors.write(name, "bouc_wen", vectors.versions("scipy", "numpy"), model.described(), columns, confirmation)


if __name__ == "__main__":
    main()
