"""Whole arrays and single steps give the same numbers through every interface; invalid input is rejected."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import trocar

from .conftest import CONFORMANCE

MODELS = sorted(CONFORMANCE.glob("models/*.json"))


def motion() -> tuple[np.ndarray, np.ndarray]:
    time, position = np.loadtxt(CONFORMANCE / "motion.csv", delimiter=",", skiprows=1, unpack=True)
    return np.ascontiguousarray(time), np.ascontiguousarray(position)


def strokes(count: int) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(count) * 1e-3
    return time, 0.02 * (1 - np.cos(3 * time))


def test_a_path_in_place_of_a_model_is_told_how_it_is_read() -> None:
    with pytest.raises(TypeError, match=r"expected a trocar.Model, got str; read it with trocar.Model.load\('seal'\)"):
        trocar.simulate("seal", [0], [0])  # type: ignore[arg-type]


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_arrays_and_steps_give_the_same_bits(path: Path) -> None:
    model = trocar.Model.load(path)
    time, position = motion()
    forces = trocar.simulate(model, time, position)
    stepper = trocar.Stepper(model, position[0])
    stepped = [stepper.force_n]
    for i in range(1, len(time)):
        if time[i] > time[i - 1]:
            stepper.step_to(position[i], time[i] - time[i - 1])
        stepped.append(stepper.force_n)
    assert np.array_equal(forces, stepped)
    full = trocar.simulate_full(model, time, position)
    assert np.array_equal(full.force_n, forces)
    assert (full.deflection_m is None) == (model.kind != "ems") == (full.mode is None)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_the_driver_gives_the_bits_of_the_command_line(path: Path) -> None:
    command = os.environ.get("TROCAR_PROGRAM")
    if command is None:
        pytest.skip("TROCAR_PROGRAM does not name the command line; crates/trocar-py/check builds and names it")
    run = [command, "simulate", path, CONFORMANCE / "motion.csv", "--out", "-", "--quiet"]
    rows = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()[1:]
    drive = [sys.executable, Path(__file__).with_name("drive.py"), path, CONFORMANCE / "motion.csv"]
    forces = subprocess.run(drive, capture_output=True, text=True, check=True).stdout.split()
    assert [float(row.split(",")[2]) for row in rows] == [float(force) for force in forces]


def test_the_result_goes_where_it_is_wanted(model: trocar.Model) -> None:
    time, position = strokes(5000)
    expected = trocar.simulate(model, time, position)
    out = np.full(5000, np.nan)
    assert trocar.simulate(model, time, position, out=out) is out
    assert np.array_equal(out, expected)


@pytest.mark.parametrize(
    "change",
    [
        list,
        lambda x: np.repeat(x, 2)[::2],
        lambda x: x[::-1].copy()[::-1],
        lambda x: x.astype(">f8"),
        lambda x: np.frombuffer(b"\0" + x.tobytes(), np.uint8)[1:].view("f8"),
        lambda x: np.ma.masked_array(x),
    ],
    ids=["list", "strided", "backwards", "big endian", "unaligned", "masked"],
)
def test_arrays_of_any_layout_are_understood(model: trocar.Model, change: object) -> None:
    time, position = strokes(500)
    expected = trocar.simulate(model, time, position)
    assert np.array_equal(trocar.simulate(model, change(time), change(position)), expected)


def test_what_is_masked_does_not_count(model: trocar.Model) -> None:
    time, position = strokes(500)
    masked = np.ma.masked_array(position)
    masked[7] = np.ma.masked
    with pytest.raises(trocar.MotionError, match="sample 7"):
        trocar.simulate(model, time, masked)


def test_out_may_not_lie_where_is_read(model: trocar.Model) -> None:
    time, position = strokes(500)
    buffer = bytearray(position.tobytes())
    with pytest.raises(trocar.ArrayError, match="out is in use"):
        trocar.simulate(model, time, np.frombuffer(buffer), out=np.frombuffer(buffer))
    assert bytes(buffer) == position.tobytes()


def test_read_only_arrays_and_single_precision_are_understood(model: trocar.Model) -> None:
    time, position = strokes(500)
    expected = trocar.simulate(model, time, position)
    time.setflags(write=False)
    assert np.array_equal(trocar.simulate(model, time, position), expected)
    single = position.astype(np.float32)
    assert np.array_equal(trocar.simulate(model, time, single), trocar.simulate(model, time, single.astype(float)))
    assert len(trocar.simulate(model, [], [])) == 0


@pytest.mark.parametrize(
    ("time", "position", "words"),
    [
        ([0, 1, 2], [0, 0], "position_m has 2 samples, expected 3 as time_s has"),
        ([0, 1], [0, 1j], "position_m must hold numbers, got complex numbers"),
        ([0, 1], ["0", "1"], "position_m must hold numbers, got text"),
        ([0, 1], [0, None], "position_m must hold numbers, got objects"),
        ([0, 1], [True, False], "position_m must hold numbers, got truth values"),
        ([0, 1], [[0, 0], [0, 0]], "position_m must have one dimension, got shape (2, 2)"),
        ([0, 1], np.array([0, 1], "m8[s]"), "position_m must hold numbers, got time differences"),
        ([0, 1, 2], [0, np.nan, 0], "sample 1: position_m is NaN m, expected a finite number"),
        ([0, np.inf, 2], [0, 0, 0], "sample 1: time_s is inf s, expected a finite number"),
        ([0, 2, 1], [0, 0, 0], "sample 2: time_s goes back from 2 s to 1 s"),
        ([0, 1, 1], [0, 0, 0.001], "sample 2: position_m goes from 0 m to 0.001 m while time_s goes from 1 s to 1 s"),
        ([0, 1e-320], [0, 1], "expected a finite velocity"),
        ([0, 1], [0, 40], "position_m covers 40 m, expected at most 2 m"),
    ],
)
def test_what_cannot_be_followed_is_named(model: trocar.Model, time: object, position: object, words: str) -> None:
    out = np.full(3, 7.0)
    with pytest.raises(trocar.TrocarError) as raised:
        trocar.simulate(model, time, position, out=out)
    assert words in str(raised.value)
    assert isinstance(raised.value, ValueError)
    assert (out == 7).all(), "nothing is written when the motion is refused"


@pytest.mark.parametrize(
    ("out", "words"),
    [
        (np.empty(4), "of 5 float64, got 4"),
        (np.empty(5, np.float32), "got an array of float32 of shape (5,)"),
        (np.empty((5, 1)), "got an array of float64 of shape (5, 1)"),
        (np.empty(5, ">f8"), "in foreign byte order"),
        (np.empty(10)[::2], "one with gaps between its numbers"),
        (np.frombuffer(bytes(40)), "a read-only one"),
        ([0.0] * 5, "got list"),
    ],
)
def test_an_out_that_cannot_take_the_result_is_refused(model: trocar.Model, out: object, words: str) -> None:
    time, position = strokes(5)
    with pytest.raises(trocar.ArrayError) as raised:
        trocar.simulate(model, time, position, out=out)
    assert words in str(raised.value)


def test_an_out_that_is_read_from_is_refused(model: trocar.Model) -> None:
    time, position = strokes(5)
    with pytest.raises(trocar.ArrayError, match="out is in use"):
        trocar.simulate(model, time, position, out=position)
    assert np.array_equal(position, strokes(5)[1])


def test_the_start_can_be_chosen(model: trocar.Model) -> None:
    assert trocar.simulate(model, [0], [0.1], initial_force_n=1.5)[0] == pytest.approx(1.5, abs=1e-9)  # N
    full = trocar.simulate_full(model, [0], [0.1], initial_deflection_m=2e-3)
    assert full.deflection_m is not None and full.deflection_m[0] == pytest.approx(2e-3, abs=1e-12)  # m
    with pytest.raises(TypeError, match="not both"):
        trocar.simulate(model, [0], [0], initial_force_n=1, initial_deflection_m=0)
    with pytest.raises(trocar.ParameterError, match="initial_force_n must be finite, got NaN N"):
        trocar.simulate(model, [0], [0], initial_force_n=np.nan)
    dahl = trocar.Model.load(CONFORMANCE / "models" / "dahl.json")
    with pytest.raises(trocar.ParameterError, match="a classical model has no deflection"):
        trocar.simulate(dahl, [0], [0], initial_deflection_m=1e-3)


def test_many_threads_get_the_same_as_one(model: trocar.Model) -> None:
    time, position = strokes(200_000)
    expected = trocar.simulate(model, time, position)
    results: list[np.ndarray] = []
    threads = [threading.Thread(target=lambda: results.append(trocar.simulate(model, time, position))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 8 and all(np.array_equal(result, expected) for result in results)


def test_other_threads_run_while_an_array_is_simulated(model: trocar.Model) -> None:
    time, position = strokes(3_000_000)
    done = threading.Event()

    def simulate() -> None:
        trocar.simulate(model, time, position)
        done.set()

    thread = threading.Thread(target=simulate)
    thread.start()
    turns = 0
    while not done.wait(1e-4):
        turns += 1
    thread.join()
    # Some 100 ms of work; with the GIL held there would be only one or two turns.
    assert turns > 10


def test_a_refused_step_leaves_the_state(model: trocar.Model) -> None:
    stepper = trocar.Stepper(model, 0.1)
    stepper.step(1e-3, 1e-2)
    before = stepper.state
    for displacement, duration in [(1e-3, 0), (1e-3, -1), (np.nan, 1e-3), (np.inf, 1e-3), (1e-3, np.nan), (1, 1e-320)]:
        with pytest.raises(trocar.MotionError):
            stepper.step(displacement, duration)
        with pytest.raises(trocar.MotionError):
            stepper.step_to(stepper.position_m + displacement, duration)
    with pytest.raises(TypeError):
        stepper.step("far", 1e-3)  # type: ignore[arg-type]
    assert np.array_equal(stepper.state, before)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_a_stepper_can_be_copied_pickled_and_set_back(path: Path) -> None:
    stepper = trocar.Stepper(trocar.Model.load(path), 0.05)
    for _ in range(20):
        stepper.step(2e-4, 1e-3)
    state = stepper.state
    copies = [copy.copy(stepper), copy.deepcopy(stepper), pickle.loads(pickle.dumps(stepper))]
    ahead = [stepper.step(-1e-4, 1e-3) for _ in range(50)]
    for one in copies:
        assert [one.step(-1e-4, 1e-3) for _ in range(50)] == ahead
    stepper.state = state
    assert [stepper.step(-1e-4, 1e-3) for _ in range(50)] == ahead


def test_a_foreign_state_is_refused(model: trocar.Model) -> None:
    stepper = trocar.Stepper(model)
    before = stepper.state
    dahl = trocar.Stepper(trocar.Model.load(CONFORMANCE / "models" / "dahl.json"))
    for state in ([1.0, 2.0], dahl.state, before * np.nan, np.full(len(before), 1e300)):
        with pytest.raises(trocar.ArrayError):
            stepper.state = state
    assert np.array_equal(stepper.state, before)


def test_models_survive_pickling(tmp_path: Path) -> None:
    for path in MODELS:
        model = trocar.Model.load(path)
        assert pickle.loads(pickle.dumps(model)) == model
        assert hash(trocar.Model.from_json(model.to_json())) == hash(model)
        model.save(tmp_path / "model.json")
        assert trocar.Model.load(str(tmp_path / "model.json")) == model
        assert model.to_dict()["format"] == "trocar-model"
    assert trocar.Model.plausible() != model and model != 3


def test_a_tuned_model_is_another_one(model: trocar.Model) -> None:
    before = model.to_json()
    assert model.tuned().tunables[0].value == model.tunables[0].value
    wider = model.tuned(half_width_m=5e-3, insertion_coulomb_force_n=4)
    assert {t.name: t.value for t in wider.tunables}["half_width_m"] == 5e-3
    assert model.to_json() == before and wider.to_dict()["origin"]["kind"] == "hand_made"
    sliding = trocar.simulate(wider, np.arange(2000) * 1e-3, np.arange(2000) * 1e-5)
    # N: static force 4 N plus viscous friction at 10 mm/s.
    assert sliding[-1] == pytest.approx(4 + 0.01 * {t.name: t.value for t in wider.tunables}["insertion_viscous_damping_n_s_m"], abs=1e-6)
    stages = trocar.Model.load(CONFORMANCE / "models" / "ems_stages.json")
    assert stages.tuned(element_2_half_width_m=4e-3) != stages
    with pytest.raises(trocar.ParameterError, match="no parameter \"width\" to tune; there are half_width_m"):
        model.tuned(width=1)
    with pytest.raises(trocar.ParameterError, match="half_width_m must be finite and above 0 m"):
        model.tuned(half_width_m=-1)
    with pytest.raises(TypeError, match="half_width_m must be a number, got str"):
        model.tuned(half_width_m="wide")  # type: ignore[arg-type]
    for truth in (True, np.True_):
        with pytest.raises(TypeError, match="half_width_m must be a number, got bool"):
            model.tuned(half_width_m=truth)  # type: ignore[arg-type]


def test_messages_write_long_numbers_as_powers_of_ten(model: trocar.Model) -> None:
    with pytest.raises(trocar.MotionError, match="1e308 m within 0.001 s is no finite velocity"):
        trocar.Stepper(model).step(1e308, 1e-3)
    with pytest.raises(trocar.MotionError, match="duration_s must be positive and finite, got -1e-300 s"):
        trocar.Stepper(model).step(0.0, -1e-300)
    with pytest.raises(trocar.MotionError, match="to 1e308 m while time_s goes from 0 s to 0.001 s"):
        trocar.simulate(model, [0, 1e-3], [0, 1e308])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not JSON"),
        ("{}", 'the key "format" must be "trocar-model", got nothing'),
        ('{"format": "trocar-model", "version": 99}', "written by another version of trocar: model version 99"),
        ('{"format": "trocar-model", "version": 0}', "written by another version of trocar: model version 0"),
        ('{"format": "trocar-model", "version": 1}', "missing field"),
    ],
)
def test_what_is_no_model_is_refused(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "broken.json").write_text(text)
    for read in (lambda: trocar.Model.from_json(text), lambda: trocar.Model.load(tmp_path / "broken.json")):
        with pytest.raises(trocar.ModelFileError) as raised:
            read()
        assert words in str(raised.value)


def test_missing_files_are_missing_files(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no.json"):
        trocar.Model.load(tmp_path / "no.json")
    with pytest.raises(FileNotFoundError, match="no.csv: cannot open"):
        trocar.read(tmp_path / "no.csv")
    with pytest.raises(IsADirectoryError):
        trocar.read(tmp_path)
    with pytest.raises(OSError, match="cannot create"):
        trocar.Model.plausible().save(tmp_path / "no" / os.sep / "folder" / "model.json")
