"""The scene of insert.py at its deepest, as a picture: python figure.py PICTURE.png (TROCAR_PLUGIN names the plugin)"""

import os
import pathlib
import sys

# Without a display.
os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
from insert import run
from PIL import Image


def main(picture):
    picture = pathlib.Path(picture).resolve()
    for m, d, _, _ in run(os.path.abspath(os.environ["TROCAR_PLUGIN"])):
        if d.time >= 1.0:
            break
    options = mujoco.MjvOption()
    options.flags[mujoco.mjtVisFlag.mjVIS_FLEXEDGE] = True
    options.flags[mujoco.mjtVisFlag.mjVIS_FLEXFACE] = True
    options.flags[mujoco.mjtVisFlag.mjVIS_FLEXSKIN] = False
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance, camera.azimuth, camera.elevation = [0.0, 0.0, 0.085], 0.28, 145.0, -22.0
    # Twice as large as it is shown: smooth edges.
    with mujoco.Renderer(m, 960, 1280) as renderer:
        renderer.update_scene(d, camera, options)
        image = Image.fromarray(renderer.render()).resize((640, 480), Image.Resampling.LANCZOS)
    image.quantize(128).save(picture, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1])
