"""An instrument that turns: Stepper.turn_to, and the angle of a recording."""

import json
import math

import numpy as np
import pytest

import trocar


@pytest.fixture
def turning() -> trocar.Model:
    document = json.loads(trocar.Model.plausible().to_json())
    document["rotation"] = {
        "shaft_radius_m": 5e-3,
        "circumferential_stiffness_n_m": 425.0,
        "circumferential_ratio": 1.0,
    }
    return trocar.Model.from_json(json.dumps(document))


def test_turning_takes_axial_friction_away(turning: trocar.Model) -> None:
    seal = trocar.Stepper(turning)
    for k in range(1, 4001):
        force_n = seal.turn_to(2e-5 * k, 1e-3 * k * math.tau, 1e-3)
    around = 5e-3 * math.tau
    assert force_n == pytest.approx(3.0 * 0.02 / math.hypot(0.02, around) + 0.1, abs=1e-3)
    assert seal.torque_n_m == pytest.approx(5e-3 * (3.0 * around / math.hypot(0.02, around) + 5.0 * around), rel=1e-3)


def test_what_cannot_turn_is_refused(turning: trocar.Model) -> None:
    with pytest.raises(trocar.MotionError, match="knows the axis only"):
        trocar.Stepper(trocar.Model.plausible()).turn_to(0.0, 1.0, 1e-3)
    with pytest.raises(trocar.MotionError, match="angle_rad must be finite, got NaN rad"):
        trocar.Stepper(turning).turn_to(0.0, math.nan, 1e-3)


def test_a_recording_may_have_an_angle() -> None:
    time_s = np.arange(0.0, 1.0, 1e-3)
    with pytest.raises(trocar.RecordingError):
        trocar.Recording(time_s, 0.01 * time_s, time_s, angle_rad=time_s[:-1])
    assert trocar.Recording(time_s, 0.01 * time_s, time_s, angle_rad=time_s) is not None
