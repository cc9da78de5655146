"""The benchmark EMPS in open loop: the position of the axis from its drive force alone, by four parameters.

    python3 reference/emps_open_loop.py [TRAIN.csv [TEST.csv]]

M·dv/dt = F - F_v·v - F_c·sgn(v) - offset, from rest at the first position. The files hold time_s, position_m and force_N; without
names those beside the checkout are taken (see README.md), and without TEST the fit is scored on TRAIN. Prints the root mean square
error of the position for the published parameters, and for those that this simulation fits to TRAIN. No packages are needed.
"""

import csv
import math
import pathlib
import sys

RECORDING = pathlib.Path(__file__).resolve().parents[2] / "shared/recordings/emps/identification.csv"
PUBLISHED = (95.1089, 203.5034, 20.3935, -3.1648)  # kg, N s/m, N, N: JANOT
STEPS = (0.1, 1.0, 0.1, 0.05)  # of the derivatives: where friction stops the axis the error has kinks


def read(path):
    with open(path, newline="") as file:
        rows = [[float(cell) for cell in row.values()] for row in csv.DictReader(file)]
    return [list(column) for column in zip(*rows)]


def simulate(parameters, times, force, start):
    mass, viscous, coulomb, offset = parameters
    x, v, positions = start, 0.0, [start]
    for i in range(1, len(times)):
        h, drive = times[i] - times[i - 1], 0.5 * (force[i - 1] + force[i]) - offset
        sign = math.copysign(1.0, v if v else drive)
        if v == 0.0 and abs(drive) <= coulomb:
            positions.append(x)
            continue
        # Exact for a constant force, up to where the axis stops; the next step decides whether it starts again.
        end = (drive - coulomb * sign) / viscous
        decay = math.exp(-viscous * h / mass)
        after = end + (v - end) * decay
        if after * sign < 0.0:
            stop = mass / viscous * math.log((v - end) / -end)
            x += end * stop + (v - end) * (1.0 - math.exp(-viscous * stop / mass)) * mass / viscous
            after = 0.0
        else:
            x += end * h + (v - end) * (1.0 - decay) * mass / viscous
        v = after
        positions.append(x)
    return positions


def errors(parameters, recording):
    times, position, force = recording
    return [a - b for a, b in zip(simulate(parameters, times, force, position[0]), position)]


def rms(values):
    return math.sqrt(sum(value * value for value in values) / len(values))


def solve(rows):
    """The solution of a small linear system, given with its right side, by Gauss's elimination."""
    n = len(rows)
    for i in range(n):
        pivot = max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for k in range(n):
            if k != i:
                factor = rows[k][i] / rows[i][i]
                rows[k] = [a - factor * b for a, b in zip(rows[k], rows[i])]
    return [rows[i][n] / rows[i][i] for i in range(n)]


def fit(recording, start):
    """Levenberg and Marquardt's method; the columns are scaled by their own size."""
    best, own, damping = list(start), errors(start, recording), 1e-3
    while damping < 1e6:
        columns = []
        for i, step in enumerate(STEPS):
            sides = [errors([p + s * (k == i) for k, p in enumerate(best)], recording) for s in (step, -step)]
            columns.append([(a - b) / (2.0 * step) for a, b in zip(*sides)])
        products = [[sum(a * b for a, b in zip(x, y)) for y in (*columns, own)] for x in columns]
        before = rms(own)
        while damping < 1e6:
            rows = [[*row[:i], row[i] * (1.0 + damping), *row[i + 1 :]] for i, row in enumerate(products)]
            trial = [p - d for p, d in zip(best, solve(rows))]
            found = errors(trial, recording) if trial[1] > 0.0 else own
            if rms(found) < before:
                best, own, damping = trial, found, damping / 10.0
                break
            damping *= 10.0
        if before - rms(own) < 1e-6 * before:
            break
    return best


def main(train, test=None):
    if not pathlib.Path(train).exists():
        sys.exit(f"skipped: no recording {train} (EMPS is published at nonlinearbenchmark.org; this takes CSV with "
                 "time_s,position_m,force_N)")
    training = read(train)
    scored = read(test) if test else training
    for name, parameters in (("published", PUBLISHED), ("fitted", fit(training, PUBLISHED))):
        numbers = "M {:.2f} kg, F_v {:.1f} N s/m, F_c {:.2f} N, offset {:.2f} N".format(*parameters)
        print(f"{name:<9} {numbers}: {rms(errors(parameters, scored)):.4f} m rms")


if __name__ == "__main__":
    main(*(sys.argv[1:3] or [RECORDING]))
