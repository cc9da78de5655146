"""Runs a model along a motion in MuJoCo and prints one force (N) a row: python drive.py PLUGIN MODEL.json MOTION.csv

Before each step the velocity of the joint is set to what brings it to the next row, and a mass that no force moves keeps it. The
first force is what the sensor reads at rest; all others are those that the engine applied, -qfrc_passive.
"""

import csv
import pathlib
import sys

import mujoco
from scene import scene

# A force of newtons changes the velocity by less than its last bit, kg.
IMMOVABLE = 1e20


def read_motion(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return [float(row["time_s"]) for row in rows], [float(row["position_m"]) for row in rows]


def drive(model, times, positions, **options):
    """Force on the seal at each row, N."""
    m = mujoco.MjModel.from_xml_string(scene(model, mass_kg=IMMOVABLE, **options))
    d = mujoco.MjData(m)
    d.qpos[0] = positions[0]
    mujoco.mj_forward(m, d)
    forces = [d.sensordata[0]]
    for before, now, start, end in zip(times, times[1:], positions, positions[1:]):
        m.opt.timestep = now - before
        if m.opt.timestep == 0.0 and start == end:
            forces.append(forces[-1])
            continue
        d.qvel[0] = (end - start) / m.opt.timestep
        mujoco.mj_step(m, d)
        if d.qpos[0] != end:
            sys.exit(f"time {now} s: the joint is at {d.qpos[0]!r} m, expected {end!r} m")
        forces.append(0.0 - d.qfrc_passive[0])  # 0.0 for 0.0, not -0.0
    return forces


def main(plugin, model, motion):
    mujoco.mj_loadPluginLibrary(plugin)
    for force in drive(str(pathlib.Path(model).resolve()), *read_motion(motion)):
        print(repr(float(force)))


if __name__ == "__main__":
    main(*sys.argv[1:])
