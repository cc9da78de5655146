"""Generalised Maxwell-Slip, EMS (5) to (7), integrated by solve_ivp with events at every change of mode.

    sticking  dz_i/dt = v                                         until sgn(v) z_i reaches nu_i |s(v)|
    sliding   dz_i/dt = sgn(v) C_i (1 - z_i / (nu_i s(v)))        until sgn(v) changes, also to 0
    F = sum(k_i z_i + sigma_i dz_i/dt) + beta v,   s(v) = (F_c + (F_s - F_c) exp(-(v/v_s)^2)) sgn(v)

Left open by the paper and settled here: at v = 0 every z_i is held and every element sticks; an element that finds
itself at or beyond nu_i |s(v)| when an interval begins slides at once; a sliding one stays so when |s| rises.
`limited`: sliding with |dz_i/dt| <= |v|. Confirmed by the closed form of each mode.
"""

import math

import scipy.integrate

import motion
import vectors

STICKING, SLIDING, CAPPED = range(3)


class Element:
    """k_i in N/m, alpha_i = k_i nu_i, C_i in m/s, sigma_i in N s/m."""

    def __init__(self, stiffness, share, attraction, damping):
        self.stiffness, self.share, self.attraction, self.damping = stiffness, share, attraction, damping

    def limit(self, level):
        """nu_i |s(v)|, m."""
        return self.share * level / self.stiffness

    def described(self):
        return {
            "stiffness_n_m": self.stiffness,
            "share": self.share,
            "attraction_m_s": self.attraction,
            "damping_n_s_m": self.damping,
        }


class Bank:
    """Elements, sliding curve (F_c, F_s, v_s, beta) and whether sliding deflections may outrun the instrument."""

    def __init__(self, elements, curve, limited=False):
        self.elements, self.curve, self.limited = elements, curve, limited

    def level(self, velocity):
        coulomb, static, stribeck, _ = self.curve
        return coulomb + (static - coulomb) * math.exp(-((velocity / stribeck) ** 2))

    def pull(self, i, deflection, velocity):
        """EMS (5), sliding, without any limit."""
        element, sign = self.elements[i], math.copysign(1.0, velocity)
        return sign * element.attraction * (1.0 - sign * deflection / element.limit(self.level(velocity)))

    def entered(self, i, deflection, velocity, mode):
        """Mode of an element as an interval begins."""
        sign = math.copysign(1.0, velocity)
        if mode == STICKING and sign * deflection < self.elements[i].limit(self.level(velocity)):
            return STICKING
        capped = self.limited and abs(self.pull(i, deflection, velocity)) > abs(velocity)
        return CAPPED if capped else SLIDING

    def rate(self, i, deflection, velocity, mode):
        if mode == STICKING:
            return velocity
        pull = self.pull(i, deflection, velocity)
        return math.copysign(velocity, pull) if mode == CAPPED else pull

    def distance(self, i, deflection, velocity, mode):
        """Positive until the mode ends within the interval."""
        if mode == STICKING:
            return self.elements[i].limit(self.level(velocity)) - math.copysign(1.0, velocity) * deflection
        return abs(self.pull(i, deflection, velocity)) - abs(velocity)

    def output(self, deflections, modes, velocity):
        """EMS (7)."""
        force = self.curve[3] * velocity
        for i, element in enumerate(self.elements):
            force += element.stiffness * deflections[i]
            if velocity != 0.0:
                force += element.damping * self.rate(i, deflections[i], velocity, modes[i])
        return force


def integrate(bank, deflections, modes, velocity, duration):
    """Advances all elements with solve_ivp, from event to event."""
    time, count = 0.0, len(deflections)
    while time < duration:
        pending = [i for i in range(count) if modes[i] != SLIDING]
        events = []
        for i in pending:

            def event(_, z, i=i, mode=modes[i]):
                return bank.distance(i, z[i], velocity, mode)

            event.terminal = True
            event.direction = -1
            events.append(event)

        def rates(_, z, modes=tuple(modes)):
            return [bank.rate(i, z[i], velocity, modes[i]) for i in range(count)]

        scale = min(element.limit(bank.level(velocity)) for element in bank.elements)
        tolerance = {"rtol": 1e-12, "atol": 1e-13 * scale}
        solution = scipy.integrate.solve_ivp(
            rates, (time, duration), deflections, "DOP853", events=events or None, **tolerance
        )
        time, deflections = float(solution.t[-1]), [float(z) for z in solution.y[:, -1]]
        if solution.status == 0:
            break
        for i, found in zip(pending, solution.t_events):
            if len(found):
                modes[i] = SLIDING
    return deflections


def closed_form(bank, deflections, modes, velocity, duration):
    """Advances each element by a straight line and an exponential."""
    after = []
    for i, z in enumerate(deflections):
        left = duration
        if modes[i] != SLIDING:
            rate = bank.rate(i, z, velocity, modes[i])
            if modes[i] == STICKING:
                target = math.copysign(bank.elements[i].limit(bank.level(velocity)), velocity)
            else:
                # The pull falls to |v| where 1 - z/(nu s) = +-|v|/C.
                gap = math.copysign(abs(velocity) / bank.elements[i].attraction, rate * velocity)
                target = math.copysign(bank.elements[i].limit(bank.level(velocity)), velocity) * (1.0 - gap)
            straight = min(left, max(0.0, (target - z) / rate))
            z, left = z + rate * straight, left - straight
            if left > 0.0:
                z, modes[i] = target, SLIDING
        if modes[i] == SLIDING:
            limit = bank.elements[i].limit(bank.level(velocity))
            settled = math.copysign(limit, velocity)
            z = settled + (z - settled) * math.exp(-bank.elements[i].attraction * left / limit)
        after.append(z)
    return after


def simulate(bank, steps, advance):
    """Force and number of sliding elements at the start of each interval; the last row at rest."""
    count = len(bank.elements)
    deflections, modes, last_sign = [0.0] * count, [STICKING] * count, 0
    forces, sliding = [], []
    for _, duration, velocity in steps + [(0.0, 1.0, 0.0)]:
        sign = (velocity > 0.0) - (velocity < 0.0)
        if sign != last_sign or sign == 0:
            modes = [STICKING] * count
        last_sign = sign
        if sign != 0:
            modes = [bank.entered(i, deflections[i], velocity, modes[i]) for i in range(count)]
        forces.append(bank.output(deflections, modes, velocity))
        sliding.append(sum(mode != STICKING for mode in modes))
        if sign != 0:
            deflections = advance(bank, deflections, modes, velocity, duration)
    return forces, sliding


FOUR = [(2600.0, 0.34, 0.06), (900.0, 0.28, 0.04), (420.0, 0.22, 0.03), (150.0, 0.16, 0.05)]
CURVE = (1.9, 2.7, 0.02, 3.1)  # F_c N, F_s N, v_s m/s, beta N s/m


def bank(rows, curve, damping=(0.0,) * 4, limited=False):
    return Bank([Element(*row, sigma) for row, sigma in zip(rows, damping)], curve, limited)


FLAT = (2.2, 2.2, 0.01, 0.0)
STIFF = [(3e7, 0.4, 1e-4), (8e6, 0.3, 3e-5), (2e6, 0.2, 2e-4), (5e5, 0.1, 1e-3)]

SETS = {
    "gms_seal": (bank(FOUR, CURVE), motion.nested(5e-3, 0.03)),
    "gms_damped": (bank(FOUR, CURVE, damping=(1.7, 0.9, 0.4, 2.2)), motion.nested(5e-3, 0.011)),
    "gms_coarse": (bank(FOUR, CURVE), motion.coarse(8e-3, 0.02)),
    "gms_flat": (bank(FOUR, FLAT), motion.nested(5e-3, 0.03)),
    "gms_limited": (bank(FOUR, CURVE, limited=True), motion.nested(5e-3, 0.03)),
    "gms_stiff": (bank(STIFF, (1.1, 1.6, 2e-4, 0.0)), motion.nested(6e-7, 1e-4)),
}


def main():
    for name, (elements, legs) in SETS.items():
        times, positions = motion.sampled(legs)
        steps = motion.intervals(times, positions)
        forces, sliding = simulate(elements, steps, integrate)
        confirmation, _ = simulate(elements, steps, closed_form)
        columns = {
            "time_s": times,
            "position_m": positions,
            "velocity_m_s": [velocity for _, _, velocity in steps] + [0.0],
            "sliding_elements": sliding,
            "force_n": forces,
        }
        parameters = {
            "elements": [element.described() for element in elements.elements],
            "sliding": vectors.sliding(*elements.curve),
            "slip_rate": "limited" if elements.limited else "free",
        }
        vectors.write(name, "gms", vectors.versions("scipy", "numpy"), parameters, columns, confirmation)


if __name__ == "__main__":
    main()
