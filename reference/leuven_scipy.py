"""Modified Leuven model, integrated by solve_ivp with events at yields of its hysteresis bank and where r changes sign.

    dz/dt = v (1 - sgn(r) |r|^n),  r = F_h / s(v),  s(v) = (F_c + (F_s - F_c) exp(-(v/v_s)^2)) sgn(v)
    F = F_h + sigma1 dz/dt + sigma2 v

F_h is the force of springs k_i that yield at F_i, all driven by z. At v = 0 nothing moves and F = F_h. Between yields
F_h is linear in z, so r follows an exponential (n = 1) or a tangent, then a hyperbolic tangent or cotangent (n = 2):
the confirmation.
"""

import math

import scipy.integrate

import motion
import vectors


class Leuven:
    """Bank of (k_i N/m, F_i N), curve (F_c, F_s, v_s, sigma2), exponent n, sigma1 N s/m."""

    def __init__(self, bank, curve, exponent, micro_damping):
        self.bank, self.curve, self.exponent, self.micro_damping = bank, curve, exponent, micro_damping

    def level(self, velocity):
        coulomb, static, stribeck, _ = self.curve
        return coulomb + (static - coulomb) * math.exp(-((velocity / stribeck) ** 2))

    def ratio(self, force, velocity):
        """r; positive while the bank pushes against the motion."""
        return force / math.copysign(self.level(velocity), velocity)

    def rate(self, force, velocity):
        r = self.ratio(force, velocity)
        return velocity * (1.0 - math.copysign(abs(r) ** self.exponent, r))

    def output(self, force, velocity):
        if velocity == 0.0:
            return force
        return force + self.micro_damping * self.rate(force, velocity) + self.curve[3] * velocity

    def free(self, springs, direction):
        """The springs that still bend when z moves in `direction`."""
        return [i for i, (_, limit) in enumerate(self.bank) if direction * springs[i] < limit]


def integrate(model, z, springs, velocity, duration):
    """Advances z and the springs with solve_ivp, from yield to yield."""
    time = 0.0
    while time < duration:
        direction = math.copysign(1.0, model.rate(sum(springs), velocity))
        free = model.free(springs, direction)
        held = sum(springs)
        stiffness = sum(model.bank[i][0] for i in free)
        # The events look at the bending since the last yield: near zero it is known more exactly than z itself.
        reach = min((model.bank[i][1] - direction * springs[i]) / model.bank[i][0] for i in free)
        if direction * held < -1e-9 * model.curve[0]:
            # |r|^n is not smooth at r = 0 either: stop there too.
            reach = min(reach, -direction * held / stiffness)

        def yields(_, y, reach=reach, direction=direction):
            return reach - direction * y[0]

        yields.terminal = True
        yields.direction = -1

        def rate(_, y, held=held, stiffness=stiffness):
            return [model.rate(held + stiffness * y[0], velocity)]

        tolerance = {"rtol": 1e-12, "atol": 1e-14 * model.curve[0] / stiffness}
        solution = scipy.integrate.solve_ivp(rate, (time, duration), [0.0], "DOP853", events=yields, **tolerance)
        time, bent = float(solution.t[-1]), float(solution.y[0, -1])
        yielded = solution.status == 1
        z, springs = bend(model, z, springs, direction * reach if yielded else bent, free)
    return z, springs


def bend(model, z, springs, bent, free):
    """Moves z by `bent`; a spring that reaches its limit to rounding is set on it."""
    springs = list(springs)
    for i in free:
        stiffness, limit = model.bank[i]
        force = springs[i] + stiffness * bent
        springs[i] = math.copysign(limit, force) if abs(force) >= limit * (1.0 - 1e-15) else force
    return z + bent, springs


def clock(exponent, r):
    """Integral of dr / (1 - sgn(r) |r|^n), up to a constant; infinite at r = 1."""
    if r == 1.0:
        return math.inf
    if exponent == 1:
        return -math.log(abs(1.0 - r))
    return math.atan(r) if r < 0.0 else 0.5 * math.log(abs((1.0 + r) / (1.0 - r)))


def ratio_after(exponent, r, travel):
    """r after `travel` = stiffness |v| time / |s(v)| from r."""
    if exponent == 1:
        return 1.0 + (r - 1.0) * math.exp(-travel)
    if r < 0.0:
        angle = math.atan(r) + travel
        return math.tan(angle) if angle < 0.0 else math.tanh(angle)
    if r > 1.0:
        return 1.0 / math.tanh(travel + math.atanh(1.0 / r))
    return 1.0 if r == 1.0 else math.tanh(travel + math.atanh(r))


def closed_form(model, z, springs, velocity, duration):
    """Advances from yield to yield by the closed form of r."""
    n, level = model.exponent, model.level(velocity)
    left = duration
    while left > 0.0:
        force = sum(springs)
        r = model.ratio(force, velocity)
        direction = math.copysign(1.0, model.rate(force, velocity))
        free = model.free(springs, direction)
        stiffness = sum(model.bank[i][0] for i in free)
        reach = min((model.bank[i][1] - direction * springs[i]) / model.bank[i][0] for i in free)
        r_yield = model.ratio(force + direction * stiffness * reach, velocity)
        speed = stiffness * abs(velocity) / level
        crossed = (r - 1.0) * (r_yield - 1.0) <= 0.0
        wait = math.inf if crossed else (clock(n, r_yield) - clock(n, r)) / speed
        if wait >= left:
            r_end = ratio_after(n, r, speed * left)
            bent = math.copysign(level, velocity) * (r_end - r) / stiffness
            return bend(model, z, springs, bent, free)
        z, springs = bend(model, z, springs, direction * reach, free)
        left -= wait
    return z, springs


def simulate(model, steps, advance):
    """z and force at the start of each interval; the last row at rest."""
    z, springs = 0.0, [0.0] * len(model.bank)
    deflections, forces = [], []
    for _, duration, velocity in steps + [(0.0, 1.0, 0.0)]:
        deflections.append(z)
        forces.append(model.output(sum(springs), velocity))
        if velocity != 0.0:
            z, springs = advance(model, z, springs, velocity, duration)
    return deflections, forces


BANK = [(1100.0, 0.9), (430.0, 0.8), (210.0, 0.85), (90.0, 0.6)]  # sum of F_i: 3.15 N
CURVE = (2.0, 2.8, 0.018, 3.6)
STIFF = [(4e7, 0.5), (9e6, 0.7), (1e6, 0.6)]

SETS = {
    "leuven_1_seal": (Leuven(BANK, CURVE, 1, 1.4), motion.nested(4e-3, 0.03)),
    "leuven_1_coarse": (Leuven(BANK, CURVE, 1, 0.0), motion.coarse(6e-3, 0.02)),
    "leuven_1_stiff": (Leuven(STIFF, (1.2, 1.5, 3e-4, 0.0), 1, 30.0), motion.nested(2e-7, 1e-4)),
    "leuven_2_seal": (Leuven(BANK, CURVE, 2, 1.4), motion.nested(4e-3, 0.03)),
    "leuven_2_coarse": (Leuven(BANK, CURVE, 2, 0.0), motion.coarse(6e-3, 0.02)),
    "leuven_2_tiny": (Leuven(BANK, CURVE, 2, 1.4), motion.creep(8e-3, 0.02, 1e-5)),
}


def main():
    for name, (model, legs) in SETS.items():
        times, positions = motion.sampled(legs)
        steps = motion.intervals(times, positions)
        deflections, forces = simulate(model, steps, integrate)
        _, confirmation = simulate(model, steps, closed_form)
        columns = {
            "time_s": times,
            "position_m": positions,
            "velocity_m_s": [velocity for _, _, velocity in steps] + [0.0],
            "deflection_m": deflections,
            "force_n": forces,
        }
        parameters = {
            "elements": [{"stiffness_n_m": k, "limit_force_n": limit} for k, limit in model.bank],
            "sliding": vectors.sliding(*model.curve),
            "exponent": float(model.exponent),
            "micro_damping_n_s_m": model.micro_damping,
        }
        vectors.write(name, "leuven", vectors.versions("scipy", "numpy"), parameters, columns, confirmation)


if __name__ == "__main__":
    main()
