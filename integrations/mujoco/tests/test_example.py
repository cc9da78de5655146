"""The example prints what docs/reference/mujoco.md shows, and its forces are in balance."""

import os
import subprocess
import sys

import numpy as np
from conftest import REPOSITORY

HEADER = "time_s position_mm drive_n trocar_n tissue_n"


def table(text):
    """Rows of numbers below the header."""
    lines = text[text.index(HEADER):].splitlines()[1:]
    rows = []
    for line in lines:
        if not line or line.startswith("`"):
            break
        rows.append([float(number) for number in line.split()])
    return np.array(rows)


def test_the_example_prints_what_its_page_shows():
    script = REPOSITORY / "integrations" / "mujoco" / "example" / "insert.py"
    program = [sys.executable, str(script), os.environ["TROCAR_PLUGIN"]]
    printed = table(subprocess.run(program, check=True, capture_output=True, text=True).stdout)
    shown = table((REPOSITORY / "docs" / "reference" / "mujoco.md").read_text(encoding="utf-8"))
    assert printed.shape == (8, 5) and np.abs(printed - shown).max() < 0.05
    drive, trocar, tissue = printed[:, 2:].T
    # 0.42 kg at up to 0.17 m/s2, and a force that changes from step to step.
    assert np.abs(drive - trocar - tissue).max() < 0.5
    assert tissue.max() > 1.0 and trocar.max() > 3.0 and trocar.min() < -3.0
