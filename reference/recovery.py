"""Recovery of known seals: a folder of recordings whose truth is kept apart, for authors of other programs.

    python reference/recovery.py FOLDER [SEALS [SEED]]     needs the Python package trocar

FOLDER/task holds the recordings and what is asked (its README.md), FOLDER/truth the parameters and forces. FOLDER/score.py compares any
program's answers with the truth; it needs Python alone.
"""

import json
import pathlib
import random
import shutil
import sys

import trocar

# Ranges of the parameters, SI, the same in both directions: a sensor's offset cannot be distinguished from a difference.
RANGES = {"coulomb_force_n": (1.0, 6.0), "viscous_damping_n_s_m": (2.0, 15.0), "half_width_m": (3e-3, 10e-3)}
README = """# Recovery of known seals

Each folder holds recordings of one simulated seal in a trocar: an instrument moves to and fro in it, and a sensor reads the force.
Columns are in SI units; position and force are positive on insertion. The seal sticks to the instrument and deforms over its half
width, about a centimetre with both directions, before it slides with Coulomb and viscous friction. 0.04 kg move between sensor and
seal, the sensor has an offset and noise, and the friction varies by about 1 % from stroke to stroke.

- `steady.csv`, `dynamic.csv`: to identify from.
- `motion.csv`: a hand's motion, without force.

For each folder SEAL answer with ANSWERS/SEAL/summary.json, ANSWERS/SEAL/force.csv, or both:

- `summary.json`: {"parameters": {NAME: {"value": …, "ci95": [low, high]}}} with the names NAMES; `ci95` may be
  left out.
- `force.csv`: a column `force_n` with the force on the seal, without offset and inertia, one row per row of `motion.csv`. The first two
  seconds are not scored.

`python score.py ANSWERS truth` prints the errors.
"""


def write(path, columns):
    rows = zip(*columns.values())
    lines = [",".join(columns), *(",".join(repr(float(cell)) for cell in row) for row in rows)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, ""]))


def main(folder, seals=10, seed=1):
    task, truth = pathlib.Path(folder) / "task", pathlib.Path(folder) / "truth"
    random_numbers = random.Random(int(seed))
    for number in range(1, int(seals) + 1):
        name = f"seal_{number:02}"
        values = {key: random_numbers.uniform(*span) for key, span in RANGES.items()}
        model = trocar.Model.plausible().tuned(**values)
        for protocol in ("steady", "dynamic"):
            made = trocar.bench(protocol, seal=model, seed=1000 * int(seed) + number)
            write(task / name / f"{protocol}.csv", {"time_s": made.time_s, "position_m": made.position_m, "force_n": made.force_n})
        hand = trocar.bench("surgeon", seal=model, seed=2000 * int(seed) + number)
        motion = {"time_s": hand.time_s, "position_m": hand.position_m}
        write(task / name / "motion.csv", motion)
        write(truth / name / "force.csv", {**motion, "force_n": trocar.simulate(model, hand.time_s, hand.position_m)})
        (truth / name / "parameters.json").write_text(json.dumps(values, indent=1) + "\n")
    (task / "README.md").write_text(README.replace("NAMES", ", ".join(f"`{name}`" for name in RANGES)))
    shutil.copy(pathlib.Path(__file__).with_name("recovery_score.py"), pathlib.Path(folder) / "score.py")
    print(f"{seals} seals: {task}, {truth}")


if __name__ == "__main__":
    main(*sys.argv[1:])
