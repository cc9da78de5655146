"""An instrument that turns: Stepper.turn_to, angle and torque of a recording, and what they determine."""

import json
import math
import pathlib
import pickle

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


def test_a_recording_may_have_an_angle_and_a_torque(tmp_path: pathlib.Path) -> None:
    time_s = np.arange(0.0, 1.0, 1e-3)
    with pytest.raises(trocar.RecordingError):
        trocar.Recording(time_s, 0.01 * time_s, time_s, angle_rad=time_s[:-1])
    columns = {"angle_rad": 3.0 * time_s, "torque_n_m": 0.1 * time_s}
    own = trocar.Recording(time_s, 0.01 * time_s, time_s, **columns)
    frame = {"time_s": time_s, "position_m": 0.01 * time_s, "force_n": time_s, **columns}
    own.save(tmp_path / "own.csv")
    others = [trocar.Recording.from_frame(frame), trocar.read(tmp_path / "own.csv"), pickle.loads(pickle.dumps(own))]
    for other in [own, *others]:
        for name, column in columns.items():
            np.testing.assert_array_equal(getattr(other, name), column)
    with pytest.raises(trocar.RecordingError, match="torque"):
        trocar.Recording(time_s, 0.01 * time_s, time_s, torque_n_m=time_s[:-1])


def test_rotation_is_identified(turning: trocar.Model) -> None:
    recordings = [trocar.bench(name, seal=turning) for name in ("validation", "roll", "hold-and-turn")]
    assert recordings[0].torque_n_m is None and recordings[1].torque_n_m is not None
    options = {"moving_mass_kg": 0.04, "free_motion": False}
    found = trocar.identify(recordings, shaft_diameter_m=0.01, **options)
    for name, true in [("circumferential_stiffness_n_m", 425.0), ("circumferential_ratio", 1.0)]:
        parameter = found.parameters[name]
        assert parameter.ci95_low < true < parameter.ci95_high
        assert parameter.value == pytest.approx(true, rel=0.1)
    assert json.loads(found.model.to_json())["rotation"]["shaft_radius_m"] == 5e-3
    with pytest.raises(trocar.ParameterError, match="shaft_diameter_m must be finite and above 0, got -1 m"):
        trocar.identify(recordings, shaft_diameter_m=-1.0)


def test_the_observer_takes_the_angle(turning: trocar.Model) -> None:
    time_s = np.arange(0.0, 3.0, 1e-3)
    position_m, angle_rad = 0.05 + 0.01 * np.sin(2.0 * time_s), np.sin(3.0 * time_s)
    seal = trocar.Stepper(turning, position_m[0])
    force_n, torque_n_m = [seal.force_n], [seal.torque_n_m]
    for x, angle in zip(position_m[1:], angle_rad[1:]):
        force_n.append(seal.turn_to(x, angle, 1e-3))
        torque_n_m.append(seal.torque_n_m)
    reading_n = np.array(force_n) + 0.5

    options = {"force_error_n": 0.05, "adaptation": False, "offset_n": 0.5}
    turned = trocar.Recording(time_s, position_m, reading_n, angle_rad=angle_rad)
    found = trocar.compensate(turning, turned, **options)
    assert np.abs(found.tissue_force_n).max() < 1e-6
    assert found.torque_n_m == pytest.approx(np.array(torque_n_m), abs=1e-9)
    assert found.columns()["torque_n_m"] is found.torque_n_m

    with pytest.warns(UserWarning, match="no angle, and the model has 'rotation'"):
        blind = trocar.compensate(turning, trocar.Recording(time_s, position_m, reading_n), **options)
    assert np.abs(blind.tissue_force_n).max() > 0.5 and not blind.torque_n_m.any()
    plain = trocar.compensate(trocar.Model.plausible(), turned, **options)
    assert plain.torque_n_m is None and "torque_n_m" not in plain.columns()

    live = trocar.Compensator(turning, **options)
    samples = [live.step(x, f, 1e-3, angle) for x, f, angle in zip(position_m, reading_n, angle_rad)]
    torques_n_m = [sample.torque_n_m for sample in samples]
    assert torques_n_m == pytest.approx(found.torque_n_m.tolist(), abs=1e-12)  # durations differ by rounding
    again = trocar.Compensator(turning, **options).run(time_s, position_m, reading_n, angle_rad)
    assert again.torque_n_m == pytest.approx(found.torque_n_m, abs=1e-12)
