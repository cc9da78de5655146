"""One second of the default teleoperation loop of `trocar teleop` as a plain Python loop, without any package: its time, and its
difference to the Rust example at the end.

    python3 reference/teleop_speed.py EXAMPLE

EXAMPLE is the built example `teleop_speed` of trocar. Position-force at 1 kHz, a Dahl model (exponent 1) as the trocar and in the
compensator, which takes out 80 % of its force; motion of the masses exact for forces linear in time, two substeps a sample.
"""

import math
import subprocess
import sys
import time

TS, SUBSTEPS, SAMPLES = 1e-3, 2, 1000
HAND_K, HAND_B = 300.0, 10.0
MASS, DAMPING = 0.5, 1.0
K, B, FRACTION = 2000.0, 40.0, 0.8
TISSUE_K, TISSUE_B, SURFACE = 200.0, 1.0, 0.12
STIFFNESS, COULOMB = 600.0, 2.0
MIDDLE, AMPLITUDE, RATE = 0.12, 0.02, 2.0 * math.pi * 0.5


def product(a, b):
    return [[sum(x * y for x, y in zip(row, column)) for column in zip(*b)] for row in a]


def mass(damping, stiffness, h):
    """Position and velocity at the end from those at the start and from the forces at both ends."""
    system = [[0, h, 0, 0], [-stiffness / MASS * h, -damping / MASS * h, h / MASS, 0], [0, 0, 0, h], [0, 0, 0, 0]]
    term = [[float(i == j) for j in range(4)] for i in range(4)]
    end = [row[:] for row in term]
    for n in range(1, 20):
        term = [[x / n for x in row] for row in product(term, system)]
        end = [[x + y for x, y in zip(a, b)] for a, b in zip(end, term)]
    return [(row[0], row[1], row[2] - row[3] / h, row[3] / h) for row in end[:2]]


def moved(rows, x, v, first, last):
    return tuple(a * x + b * v + c * first + d * last for a, b, c, d in rows)


def dahl(force, way):
    if way == 0.0:
        return force
    sign = math.copysign(1.0, way)
    return sign * COULOMB * (1.0 - (1.0 - force * sign / COULOMB) * math.exp(-STIFFNESS * abs(way) / COULOMB))


def tissue(x, v):
    depth = x - SURFACE
    return max(0.0, TISSUE_K * depth + TISSUE_B * v) if depth > 0.0 else 0.0


def hand(t):
    return MIDDLE - AMPLITUDE * math.cos(RATE * t), AMPLITUDE * RATE * math.sin(RATE * t)


def loop():
    h = TS / SUBSTEPS
    leader, follower = mass(DAMPING + HAND_B, HAND_K, h), mass(DAMPING, 0.0, h)
    x_m = x_s = MIDDLE - AMPLITUDE
    v_m = v_s = trocar = contact = model = 0.0
    known = x_s
    for n in range(SAMPLES):
        model, known = dahl(model, x_s - known), x_s
        follower_force = K * (x_m - x_s) + B * (v_m - v_s)
        leader_force = contact + trocar - FRACTION * model
        last = x_m, x_s
        for k in range(SUBSTEPS):
            pulls = []
            for t in (n * TS + k * h, n * TS + (k + 1) * h):
                x_h, v_h = hand(t)
                pulls.append(HAND_K * x_h + HAND_B * v_h - leader_force)
            x_m, v_m = moved(leader, x_m, v_m, *pulls)
            first, force = follower_force - trocar - contact, trocar + contact
            for _ in range(5):
                x, v = moved(follower, x_s, v_s, first, follower_force - force)
                new_trocar, new_contact = dahl(trocar, x - x_s), tissue(x, v)
                change, force = new_trocar + new_contact - force, new_trocar + new_contact
                if abs(change) <= 1e-9:
                    break
            else:
                raise SystemExit("a stiff substep, which this loop does not have")
            x_s, v_s, trocar, contact = x, v, new_trocar, new_contact
    return last


def main():
    times = []
    for _ in range(20):
        start = time.perf_counter()
        last = loop()
        times.append(time.perf_counter() - start)
    told = [float(x) for x in subprocess.run([sys.argv[1], "--end"], check=True, capture_output=True, text=True).stdout.split()]
    difference = max(abs(a - b) for a, b in zip(last, told))
    print(f"  plain Python, Dahl {1e3 * min(times):6.3f} ms, positions at the end differ by {difference:.1e} m")
    if not difference < 1e-9:
        raise SystemExit("not the same loop")


if __name__ == "__main__":
    main()
