"""An instrument goes through a trocar into tissue and back: python insert.py PLUGIN

Prints what the drive has to push, and what of it the trocar and the tissue take (N, positive on insertion).
"""

import os
import pathlib
import sys

import mujoco
import numpy as np


def run(plugin):
    """The scene stroke by stroke, after every step: model, data, forces on trocar and tissue."""
    os.chdir(pathlib.Path(__file__).parent)  # the path of the model is relative to the process
    mujoco.mj_loadPluginLibrary(plugin)
    m = mujoco.MjModel.from_xml_path("scene.xml")
    d = mujoco.MjData(m)
    while d.time < 2.0:
        d.ctrl[0] = 0.0175 * (1.0 - np.cos(np.pi * d.time))  # 35 mm in 1 s, and back
        mujoco.mj_step(m, d)
        yield m, d, d.sensor("trocar_force_n").data[0], -d.qfrc_constraint[m.joint("insertion").dofadr[0]]


if __name__ == "__main__":
    print("time_s position_mm drive_n trocar_n tissue_n")
    for step, (m, d, trocar_n, tissue_n) in enumerate(run(os.path.abspath(sys.argv[1]))):
        if step % 125 == 124:
            position_mm, drive_n = 1e3 * d.sensor("position_m").data[0], d.sensor("drive_n").data[0]
            print(f"{d.time:.2f} {position_mm:.1f} {drive_n:.2f} {trocar_n:.2f} {tissue_n:.2f}")
