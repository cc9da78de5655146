"""Runs a model along a motion: one force a line, in N, with the digits that read back as the same number.

    python drive.py MODEL MOTION

MOTION is CSV with the columns time_s and position_m. The first row is the start; a repeated row changes nothing.
"""

from __future__ import annotations

import sys

import numpy as np

import trocar


def main(model: str, motion: str) -> None:
    time_s, position_m = np.loadtxt(motion, delimiter=",", skiprows=1, usecols=(0, 1), unpack=True)
    forces = trocar.simulate(trocar.Model.load(model), time_s, position_m)
    sys.stdout.writelines(f"{force!r}\n" for force in forces.tolist())


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
