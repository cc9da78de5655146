"""Runs a model along a motion: one force a line, in N, with the digits that read back as the same number.

    python drive.py MODEL MOTION

MOTION is CSV with the columns time_s and position_m. The first row is the start; a repeated row changes nothing. With a
third column angle_rad, which begins at 0, the instrument turns, and a torque in N m follows each force.
"""

from __future__ import annotations

import sys

import numpy as np

import trocar


def turn(model: trocar.Model, rows: list[list[float]]) -> None:
    stepper = trocar.Stepper(model, rows[0][1])
    print(f"{stepper.force_n!r}\n{stepper.torque_n_m!r}")
    for (before, *_), (time, position, angle) in zip(rows, rows[1:]):
        if time > before:
            stepper.turn_to(position, angle, time - before)
        print(f"{stepper.force_n!r}\n{stepper.torque_n_m!r}")


def main(model: str, motion: str) -> None:
    rows = np.loadtxt(motion, delimiter=",", skiprows=1)
    if rows.shape[1] == 3:
        turn(trocar.Model.load(model), rows.tolist())
        return
    forces = trocar.simulate(trocar.Model.load(model), *rows.T)
    sys.stdout.writelines(f"{force!r}\n" for force in forces.tolist())


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
