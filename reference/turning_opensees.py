"""An element that turns, straight and isotropic, from OpenSeesPy: section Bidirectional under zeroLengthSection.

The section returns radially to its yield circle, of first order in the step, so every interval is cut into PARTS and
2 PARTS and both results are extrapolated. Confirmed by the exact solution on a straight path: with the angle psi between force
and motion tan(psi/2) decays as exp(-k s/F_c) over the arc s (Krieg and Krieg 1977).
"""

import math

import motion
import opensees
import vectors

PARTS = 400
# N: largest difference to the exact solution; what the extrapolation leaves at a yield point.
CONFIRMED = 2e-5

SETS = {
    "turning_one": [(425.0, 3.0)],
    "turning_four": [(950.0, 0.62), (380.0, 0.81), (160.0, 0.57), (75.0, 0.44)],
}


def path():
    """Times, positions along the axis and arcs around it: reversals and changes of direction at every sample."""
    times, along = motion.sampled(motion.coarse(9e-3, 0.02, 120))
    _, around = motion.sampled(motion.coarse(7e-3, 0.02, 140))
    return times, along, [arc - around[7] for arc in around[7 : 7 + len(along)]]


def by_opensees(elements, along, around, parts):
    """Forces at the samples, N: pairs of the two directions P and V_y of the sections."""
    solver = opensees.load()
    solver.wipe()
    solver.model("basic", "-ndm", 3, "-ndf", 6)
    solver.node(1, 0.0, 0.0, 0.0)
    solver.node(2, 0.0, 0.0, 0.0)
    solver.fix(1, 1, 1, 1, 1, 1, 1)
    solver.fix(2, 0, 0, 1, 1, 1, 1)
    tags = list(range(1, len(elements) + 1))
    for tag, (stiffness, limit) in zip(tags, elements):
        solver.section("Bidirectional", tag, stiffness, limit, 0.0, 0.0)
        solver.element("zeroLengthSection", tag, 1, 2, tag)
    for tag, values in ((1, along), (2, around)):
        # A series is 0 after its end: one value more.
        solver.timeSeries("Path", tag, "-dt", 1.0, "-values", *values, values[-1])
        solver.pattern("Plain", tag, tag)
        solver.sp(2, tag, 1.0)
    solver.constraints("Lagrange")
    solver.numberer("Plain")
    solver.system("FullGeneral")
    solver.test("NormUnbalance", 1e-13, 50)
    solver.algorithm("Newton")
    solver.integrator("LoadControl", 1.0 / parts)
    solver.analysis("Static")
    forces = [(0.0, 0.0)]
    for _ in along[1:]:
        if solver.analyze(parts) != 0:
            raise SystemExit("OpenSees did not converge")
        own = [solver.eleResponse(tag, "section", "force") for tag in tags]
        forces.append(tuple(sum(force[i] for force in own) for i in (1, 0)))
    return forces


def exact(stiffness, limit, force, move):
    """The force of one element after a straight move: elastic up to the circle, then along it."""
    trial = [force[i] + stiffness * move[i] for i in (0, 1)]
    if math.hypot(*trial) <= limit:
        return trial
    # |force + w*stiffness*move| = limit
    step = [stiffness * move[i] for i in (0, 1)]
    a, b = sum(s * s for s in step), sum(f * s for f, s in zip(force, step))
    c = sum(f * f for f in force) - limit * limit
    w = (-b + math.sqrt(b * b - a * c)) / a if c < 0.0 or b < 0.0 else 0.0
    onset = [force[i] + w * step[i] for i in (0, 1)]
    heading = math.atan2(move[1], move[0])
    psi = math.remainder(math.atan2(onset[1], onset[0]) - heading, 2.0 * math.pi)
    psi = 2.0 * math.atan(math.tan(psi / 2.0) * math.exp(-(1.0 - w) * math.hypot(*step) / limit))
    return [limit * math.cos(heading + psi), limit * math.sin(heading + psi)]


def closed_form(elements, along, around):
    own, forces = [[0.0, 0.0] for _ in elements], [(0.0, 0.0)]
    for k in range(len(along) - 1):
        move = [along[k + 1] - along[k], around[k + 1] - around[k]]
        own = [exact(*element, force, move) for element, force in zip(elements, own)]
        forces.append(tuple(sum(force[i] for force in own) for i in (0, 1)))
    return forces


def main():
    times, along, around = path()
    for name, elements in SETS.items():
        coarse, fine = (by_opensees(elements, along, around, parts) for parts in (PARTS, 2 * PARTS))
        solved = [tuple(2.0 * f - c for f, c in zip(*both)) for both in zip(fine, coarse)]
        confirmation = closed_form(elements, along, around)
        columns = {
            "time_s": times,
            "position_m": along,
            "arc_m": around,
            "force_n": [force[0] for force in solved],
            "circumferential_force_n": [force[1] for force in solved],
        }
        parameters = {"elements": [{"stiffness_n_m": k, "limit_force_n": limit} for k, limit in elements]}
        made_with = vectors.versions("openseespy")
        vectors.write(name, "turning", made_with, parameters, columns, [f[0] for f in confirmation], CONFIRMED)
        worst = max(abs(a[1] - b[1]) for a, b in zip(solved, confirmation))
        if not worst <= CONFIRMED:
            raise SystemExit(f"{name}: around the shaft {worst} N is more than {CONFIRMED} N")


if __name__ == "__main__":
    main()
