"""Plans are those of the command line; what cannot be planned is named."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

import trocar

RIG = "duration_s = 60.0\ndraws = 2\n[rig]\nsample_rate_hz = 200.0\n"
KEYS = {"duration_s": 60, "draws": 2, "rig": {"sample_rate_hz": 200.0}}


def test_a_plan_is_that_of_the_command_line(tmp_path: Path) -> None:
    program = os.environ.get("TROCAR_PROGRAM")
    if program is None:
        pytest.skip("TROCAR_PROGRAM names no command line")
    (tmp_path / "rig.toml").write_text(RIG)
    run = [program, "--quiet", "plan", "rig.toml", "--for", "half_width_m:1%", "--json", "--out", "motion.csv"]
    done = subprocess.run(run, check=False, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode in (0, 3), done.stderr
    ours, theirs = trocar.plan(RIG, goal="half_width_m:1%"), json.loads(done.stdout)
    assert {name: ours.summary[name] for name in theirs} == theirs
    motion = np.loadtxt(tmp_path / "motion.csv", delimiter=",", skiprows=1)
    assert np.array_equal(motion[:, 0], ours.time_s) and np.array_equal(motion[:, 1], ours.position_m)


def test_a_rig_is_a_path_a_text_or_keys(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG)
    plans = [trocar.plan(RIG), trocar.plan(tmp_path / "rig.toml"), trocar.plan(KEYS), trocar.plan({"draws": 1}, **KEYS)]
    for planned in plans:
        assert planned.summary == plans[0].summary
        assert np.array_equal(planned.position_m, plans[0].position_m)
    assert plans[0].duration_s <= 60.0
    assert plans[0].expected["half_width_m"].half_width > plans[0].expected["half_width_m"].standard_deviation
    assert plans[0].paper is not None and plans[0].needed_s is None
    assert "all parameters" in repr(plans[0])
    like = trocar.plan(KEYS, prior={"like": "dobbelsteen-2007"})
    assert 0.25 <= like.expected["coulomb_force_n"].value <= 3.0
    assert trocar.plan_config().startswith("# A rig")


def test_a_rig_that_turns_has_an_angle() -> None:
    planned = trocar.plan(KEYS, duration_s=120.0, rig={"turning_rad_s": 6.0})
    assert planned.angle_rad is not None and np.ptp(planned.angle_rad) > 1.0
    assert list(planned.columns()) == ["time_s", "position_m", "angle_rad"]
    still = planned.time_s < planned.summary["turning_from_s"]
    assert still.any() and not planned.angle_rad[still].any()
    assert trocar.plan(KEYS).angle_rad is None


def test_recordings_that_are_there_count(model: trocar.Model) -> None:
    first = trocar.plan(KEYS, goal="viscous_damping_n_s_m", model=model)
    recording = trocar.Recording(first.time_s, first.position_m, trocar.simulate(model, first.time_s, first.position_m))
    both = trocar.plan(KEYS, goal="viscous_damping_n_s_m", model=model, after=recording)
    alone, after = (p.expected["viscous_damping_n_s_m"].half_width for p in (first, both))
    assert after < 0.9 * alone
    with pytest.raises(trocar.PlanError, match="model=trocar.identify"):
        trocar.plan(KEYS, after=[recording])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"duration_s": 2.0}, "too short"),
        ({"rig": {"speed_m_s": 1.0}}, "speed_m_s"),
        ({"noise": {"force_n": float("nan")}}, "noise.force_n must be finite"),
        ({"prior": {"like": "none"}}, "dobbelsteen-2007"),
        ({"goal": "speed"}, "viscous_damping_n_s_m"),
    ],
)
def test_what_cannot_be_planned_is_named(keys: dict[str, object], message: str) -> None:
    with pytest.raises(trocar.PlanError, match=message):
        trocar.plan(KEYS, **keys)  # type: ignore[arg-type]
