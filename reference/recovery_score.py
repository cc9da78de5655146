"""Scores answers to the recovery of known seals: python score.py ANSWERS TRUTH

ANSWERS/SEAL/summary.json holds parameters, ANSWERS/SEAL/force.csv forces, as the README.md of the task has them; TRUTH/SEAL the truth.
Prints for each parameter the median and the largest error in percent and how many of the 95 % intervals hold the truth, and the root
mean square error of the force. A seal without an answer counts as missing, and is named.
"""

import csv
import json
import math
import pathlib
import statistics
import sys

SKIPPED_S = 2.0  # The state of the seal is unknown at the start.


def forces(path):
    with open(path, newline="") as file:
        return [(float(row.get("time_s") or "nan"), float(row["force_n"])) for row in csv.DictReader(file)]


def parameters(answers, truth, seals):
    names = json.loads((truth / seals[0] / "parameters.json").read_text())
    for name in names:
        errors, held, intervals, missing = [], 0, 0, []
        for seal in seals:
            true = json.loads((truth / seal / "parameters.json").read_text())[name]
            path = answers / seal / "summary.json"
            found = json.loads(path.read_text())["parameters"].get(name) if path.exists() else None
            if found is None:
                missing.append(seal)
                continue
            errors.append(100.0 * abs(found["value"] / true - 1.0))
            low, high = found.get("ci95") or (None, None)
            if found.get("ci95"):
                intervals += 1
                held += (low is None or low <= true) and (high is None or true <= high)
        if errors:
            print(f"{name:<24} median {statistics.median(errors):.3g} %, largest {max(errors):.3g} %; "
                  f"{held} of {intervals} intervals hold the truth{told(missing)}")
        else:
            print(f"{name:<24} no answer")


def told(missing):
    return f"; no answer for {', '.join(missing)}" if missing else ""


def force(answers, truth, seals):
    errors, missing = {}, []
    for seal in seals:
        path = answers / seal / "force.csv"
        if not path.exists():
            missing.append(seal)
            continue
        true, found = forces(truth / seal / "force.csv"), forces(path)
        if len(true) != len(found):
            sys.exit(f"{path}: {len(found)} rows, expected {len(true)}, one per row of motion.csv")
        scored = [(b - a) ** 2 for (time, a), (_, b) in zip(true, found) if time >= true[0][0] + SKIPPED_S]
        errors[seal] = math.sqrt(sum(scored) / len(scored))
    if errors:
        print(f"{'force':<24} median {statistics.median(errors.values()):.3g} N rms, largest {max(errors.values()):.3g} N rms{told(missing)}")
    else:
        print(f"{'force':<24} no answer")


def main(answers, truth):
    answers, truth = pathlib.Path(answers), pathlib.Path(truth)
    seals = sorted(path.parent.name for path in truth.glob("*/parameters.json"))
    if not seals:
        sys.exit(f"{truth}: no truth, expected folders with parameters.json")
    parameters(answers, truth, seals)
    force(answers, truth, seals)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
