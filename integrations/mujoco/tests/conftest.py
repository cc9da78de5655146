import json
import os
import pathlib
import subprocess

import mujoco
import pytest

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
TURNING = sorted((REPOSITORY / "conformance" / "turning" / "models").glob("*.json"))
MODELS = sorted((REPOSITORY / "conformance" / "models").glob("*.json"))


def pytest_configure():
    mujoco.mj_loadPluginLibrary(os.environ["TROCAR_PLUGIN"])


def pytest_terminal_summary(terminalreporter):
    """Appends the reason of each skip to the file that TROCAR_SKIPPED names: ./test lists them at its end."""
    if "TROCAR_SKIPPED" in os.environ:
        with open(os.environ["TROCAR_SKIPPED"], "a") as skipped:
            for report in terminalreporter.getreports("skipped"):
                print(f"skipped: {report.nodeid}: {report.longrepr[2]}", file=skipped)


def by_name(path):
    return path.stem


@pytest.fixture(params=MODELS, ids=by_name)
def model(request):
    """Each model file of the conformance check."""
    return request.param


@pytest.fixture(params=[path for path in MODELS if path.stem != "static"], ids=by_name)
def smooth_model(request):
    """Those whose force at rest is one number: with static friction it is any between two limits."""
    return request.param


@pytest.fixture(params=TURNING, ids=by_name)
def turning_model(request):
    """Each model file of the conformance check that turns."""
    return request.param


@pytest.fixture
def ems():
    return REPOSITORY / "conformance" / "models" / "ems_stribeck.json"


@pytest.fixture
def simulate(tmp_path):
    """Forces (N) of `trocar simulate` along a motion, with angles also the torques (N m), row by row: what all other programs
    are compared with."""

    def forces(model, times, positions, angles=None):
        motion = tmp_path / "motion.csv"
        columns = [times, positions] if angles is None else [times, positions, angles]
        rows = [",".join(repr(float(value)) for value in row) for row in zip(*columns)]
        header = "time_s,position_m" if angles is None else "time_s,position_m,angle_rad"
        motion.write_text("\n".join([header, *rows, ""]))
        program = [os.environ["TROCAR_PROGRAM"], "--quiet", "simulate", str(model), str(motion), "--out", "-"]
        lines = subprocess.run(program, check=True, capture_output=True, text=True).stdout.splitlines()
        names = ["force_n"] if angles is None else ["force_n", "torque_n_m"]
        found = [lines[0].split(",").index(name) for name in names]
        return [float(line.split(",")[column]) for line in lines[1:] for column in found]

    return forces


@pytest.fixture
def warnings():
    """Warnings of the engine, collected instead of written to its log file."""
    messages = []
    mujoco.set_mju_user_warning(messages.append)
    yield messages
    mujoco.set_mju_user_warning(None)


@pytest.fixture
def stiff_model(tmp_path):
    """A file with the LuGre model of the conformance check and another stiffness (N/m)."""

    def write(stiffness_n_m):
        content = json.loads((REPOSITORY / "conformance" / "models" / "lugre.json").read_text())
        content["friction"]["stiffness_n_m"] = stiffness_n_m
        path = tmp_path / "stiff.json"
        path.write_text(json.dumps(content))
        return path

    return write
