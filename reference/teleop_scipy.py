"""Step responses of linear teleoperation loops in continuous time: no trocar, controllers without sampling, delays exact.

    m_m dv_m/dt = F_h - b_m v_m - F_mc         F_h = k_h (x_h - x_m) - b_h v_m - m_h dv_m/dt
    m_s dv_s/dt = F_sc - b_s v_s - F_e         F_e = k_e x_s + b_e v_s

position_position, position_force, four_channel (without delay) and wave as in docs/explanation/teleoperation.md. All is at rest at 0.1 m when
the hand jumps to 0.105 m and the tissue, until then without force, begins to push.

With the delay T of one direction the trajectory is taken in pieces X_k(s) = x(kT + s), 0 <= s <= T. Each depends on itself and on
earlier pieces at the same s, so that all pieces together obey one linear system, solved by a matrix exponential. Confirmed by
solve_ivp, one piece after the other with the dense output of the earlier ones.
"""

import numpy
import scipy.integrate
import scipy.linalg

import vectors

START, HAND = 0.1, 0.105  # m
OPERATOR = {"stiffness_n_m": 500.0, "damping_n_s_m": 50.0, "mass_kg": 0.2}
LEADER = {"mass_kg": 0.4, "damping_n_s_m": 3.0}
FOLLOWER = {"mass_kg": 0.6, "damping_n_s_m": 2.0}
CONTROL = {"stiffness_n_m": 800.0, "damping_n_s_m": 30.0, "force_gain": 0.7, "wave_impedance_n_s_m": 15.0}
TISSUE = {"stiffness_n_m": 150.0, "damping_n_s_m": 4.0}
DURATION, STEP = 0.4, 0.004  # s

SETS = {
    "teleop_position_position": ("position_position", 0.0),
    "teleop_position_position_delayed": ("position_position", 0.02),
    "teleop_position_force": ("position_force", 0.0),
    "teleop_position_force_delayed": ("position_force", 0.02),
    "teleop_four_channel": ("four_channel", 0.0),
    "teleop_wave": ("wave", 0.0),
    "teleop_wave_delayed": ("wave", 0.02),
}

# State: x_m, v_m, x_s, v_s, position to which the waves lead the follower.
X_M, V_M, X_S, V_S, X_D = range(5)
STATES = 5


class Loop:
    """The equations, for numbers and for linear forms alike: a signal is whatever the states are."""

    def __init__(self, architecture):
        self.architecture = architecture

    def rates(self, x, before, one):
        """dx/dt, F_mc and what is sent, from the state, from what arrives (what was sent a delay before) and from the number 1."""
        tissue = TISSUE["stiffness_n_m"] * x[X_S] + TISSUE["damping_n_s_m"] * x[V_S]
        hand = OPERATOR["stiffness_n_m"] * (HAND * one - x[X_M]) - OPERATOR["damping_n_s_m"] * x[V_M]
        both = LEADER["mass_kg"] + OPERATOR["mass_kg"]
        friction_m, friction_s = LEADER["damping_n_s_m"] * x[V_M], FOLLOWER["damping_n_s_m"] * x[V_S]
        k, b = CONTROL["stiffness_n_m"], CONTROL["damping_n_s_m"]
        wave_rate, sent = 0.0 * one, {"x_m": x[X_M], "v_m": x[V_M], "x_s": x[X_S], "v_s": x[V_S], "force": tissue}
        if self.architecture == "four_channel":
            # a_m and a_s stand in each other's equations; without delay they are solved for.
            follow = k * (x[X_M] - x[X_S]) + b * (x[V_M] - x[V_S])
            others = LEADER["damping_n_s_m"] * x[V_S], FOLLOWER["damping_n_s_m"] * x[V_M]
            # both a_m - m_m a_s = hand - friction - (tissue + follow - b_m v_s)
            first = hand - friction_m - tissue - follow + others[0]
            # m_s a_s - (m_s - m_h) a_m = follow + hand + b_s v_m - friction - tissue
            second = follow + hand + others[1] - friction_s - tissue
            m_s, m_m, m_h = FOLLOWER["mass_kg"], LEADER["mass_kg"], OPERATOR["mass_kg"]
            determinant = both * m_s - m_m * (m_s - m_h)
            a_m = (m_s * first + m_m * second) / determinant
            a_s = (both * second + (m_s - m_h) * first) / determinant
            return [x[V_M], a_m, x[V_S], a_s, wave_rate], hand - friction_m - both * a_m, sent
        if self.architecture == "wave":
            z = CONTROL["wave_impedance_n_s_m"]
            scale = (2.0 * z) ** 0.5
            arriving = scale * before["u"]
            spring = k * (x[X_D] - x[X_S])
            follower = (spring + b * (arriving / z - x[V_S])) / (1.0 + b / z)
            wave_rate = (arriving - follower) / z
            leader = z * x[V_M] - scale * before["w"]
            sent = {"u": scale * x[V_M] - before["w"], "w": before["u"] - 2.0 / scale * follower}
        else:
            follower = k * (before["x_m"] - x[X_S]) + b * (before["v_m"] - x[V_S])
            if self.architecture == "position_position":
                leader = k * (x[X_M] - before["x_s"]) + b * (x[V_M] - before["v_s"])
            else:
                leader = CONTROL["force_gain"] * before["force"]
        a_m = (hand - friction_m - leader) / both
        a_s = (follower - friction_s - tissue) / FOLLOWER["mass_kg"]
        return [x[V_M], a_m, x[V_S], a_s, wave_rate], leader, sent

    def at_rest(self, one):
        """What arrives before anything was sent."""
        if self.architecture == "wave":
            return {"u": 0.0 * one, "w": 0.0 * one}
        nothing = 0.0 * one
        return {"x_m": START * one, "v_m": nothing, "x_s": START * one, "v_s": nothing, "force": nothing}


def undelayed_waves():
    """Without delay u and w are those of the same instant: 2 b v_m = b v_d + F_sc - ... leaves the follower's controller alone."""
    # u = scale v_m - w and w = u - 2 F/scale give scale u = z v_m + F, F_mc = F and v_d = v_m.
    k, b = CONTROL["stiffness_n_m"], CONTROL["damping_n_s_m"]

    class Undelayed(Loop):
        def rates(self, x, before, one):
            tissue = TISSUE["stiffness_n_m"] * x[X_S] + TISSUE["damping_n_s_m"] * x[V_S]
            hand = OPERATOR["stiffness_n_m"] * (HAND * one - x[X_M]) - OPERATOR["damping_n_s_m"] * x[V_M]
            force = k * (x[X_D] - x[X_S]) + b * (x[V_M] - x[V_S])
            a_m = (hand - LEADER["damping_n_s_m"] * x[V_M] - force) / (LEADER["mass_kg"] + OPERATOR["mass_kg"])
            a_s = (force - FOLLOWER["damping_n_s_m"] * x[V_S] - tissue) / FOLLOWER["mass_kg"]
            return [x[V_M], a_m, x[V_S], a_s, x[V_M]], force, {}

    return Undelayed("wave")


INITIAL = numpy.array([START, 0.0, START, 0.0, START])
TIMES = numpy.arange(round(DURATION / STEP) + 1) * STEP


def forms(loop, pieces):
    """Rates of all pieces and F_mc of the last one, as rows over the states of all pieces and the number 1."""
    size = STATES * pieces + 1
    unit = numpy.eye(size)
    before, rows, force = loop.at_rest(unit[-1]), [], None
    for k in range(pieces):
        rates, force, before = loop.rates(unit[STATES * k : STATES * (k + 1)], before, unit[-1])
        rows.extend(rates)
    return numpy.array([*rows, numpy.zeros(size)]), force


def undelayed(loop):
    unit = numpy.eye(STATES + 1)
    state = unit[:STATES]
    now = {"x_m": state[X_M], "v_m": state[V_M], "x_s": state[X_S], "v_s": state[V_S]}
    now["force"] = TISSUE["stiffness_n_m"] * state[X_S] + TISSUE["damping_n_s_m"] * state[V_S]
    rates, force, _ = loop.rates(state, now, unit[-1])
    return numpy.array([*rates, numpy.zeros(STATES + 1)]), force


def by_exponential(loop, delay):
    """State and F_mc at TIMES."""
    if delay == 0.0:
        system, force = undelayed(loop)
        start = numpy.append(INITIAL, 1.0)
        found = [scipy.linalg.expm(system * t) @ start for t in TIMES]
        return [x[:STATES] for x in found], [float(force @ x) for x in found]
    states, forces, starts = [], [], [INITIAL]
    per_piece = round(delay / STEP)
    for piece in range(1, (len(TIMES) - 2) // per_piece + 2):
        system, force = forms(loop, piece)
        start = numpy.append(numpy.concatenate(starts), 1.0)
        for k in range(per_piece + 1):
            x = scipy.linalg.expm(system * (k * STEP)) @ start
            if k < per_piece or len(states) == len(TIMES) - 1:
                states.append(x[-1 - STATES : -1])
                forces.append(float(force @ x))
        starts.append(x[-1 - STATES : -1])
    return states[: len(TIMES)], forces[: len(TIMES)]


def by_solve_ivp(loop, delay):
    """F_mc at TIMES."""
    tolerance = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15, "dense_output": True}
    if delay == 0.0:
        system, force = undelayed(loop)
        solution = scipy.integrate.solve_ivp(
            lambda _, x: (system @ numpy.append(x, 1.0))[:STATES], (0.0, DURATION), INITIAL, max_step=STEP / 4, **tolerance
        )
        return [float(force @ numpy.append(solution.sol(t), 1.0)) for t in TIMES]
    pieces = []

    def sent(piece, s):
        if piece < 0:
            return loop.at_rest(1.0)
        return loop.rates(pieces[piece](s), sent(piece - 1, s), 1.0)[2]

    forces, start, per_piece = [], INITIAL, round(delay / STEP)
    count = (len(TIMES) - 2) // per_piece + 1
    for piece in range(count):
        solution = scipy.integrate.solve_ivp(
            lambda s, x: loop.rates(x, sent(piece - 1, s), 1.0)[0], (0.0, delay), start, max_step=delay / 10, **tolerance
        )
        pieces.append(solution.sol)
        last = 1 if piece == count - 1 else 0
        for k in range(per_piece + last):
            x = solution.sol(k * STEP)
            forces.append(float(loop.rates(x, sent(piece - 1, k * STEP), 1.0)[1]))
        start = solution.y[:, -1]
    return forces[: len(TIMES)]


def main():
    for name, (architecture, delay) in SETS.items():
        loop = undelayed_waves() if architecture == "wave" and delay == 0.0 else Loop(architecture)
        states, forces = by_exponential(loop, delay)
        columns = {
            "time_s": [float(round(t, 9)) for t in TIMES],
            "leader_position_m": [float(x[X_M]) for x in states],
            "follower_position_m": [float(x[X_S]) for x in states],
            "force_n": forces,
        }
        described = {
            "delay_s": delay,
            "start_m": START,
            "hand_m": HAND,
            "operator": OPERATOR,
            "leader": LEADER,
            "follower": FOLLOWER,
            "control": {"architecture": architecture, **CONTROL},
            "tissue": {"surface_m": 0.0, **TISSUE},
        }
        versions = vectors.versions("scipy", "numpy")
        vectors.write(name, "teleop", versions, described, columns, by_solve_ivp(loop, delay))


if __name__ == "__main__":
    main()
