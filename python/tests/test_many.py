"""Many models along one motion: bit for bit as one after the other, for every kind, input form and number of threads."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import polars
import pytest

import trocar

from .conftest import CONFORMANCE, ROOT

MODELS = sorted(CONFORMANCE.glob("models/*.json"))


def motion() -> tuple[np.ndarray, np.ndarray]:
    time, position = np.loadtxt(CONFORMANCE / "motion.csv", delimiter=",", skiprows=1, unpack=True)
    return np.ascontiguousarray(time), np.ascontiguousarray(position)


def draws(model: trocar.Model, count: int) -> dict[str, np.ndarray]:
    """Forces and widths of 90 to 110 % of those of the model, each drawn independently."""
    turned = [t for t in model.tunables if t.name.endswith(("half_width_m", "coulomb_force_n", "stiffness_n_m"))]
    factors = 0.9 + 0.2 * np.random.default_rng(1).random((len(turned), count))
    return {t.name: t.value * factor for t, factor in zip(turned, factors)}


def alone(model: trocar.Model, parameters: dict[str, np.ndarray], index: int) -> trocar.Model:
    return model.tuned(**{name: values[index] for name, values in parameters.items()})


def bits(forces: np.ndarray) -> np.ndarray:
    return forces.view(np.int64)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_row_has_the_bits_of_simulate(path: Path) -> None:
    model = trocar.Model.load(path)
    time, position = motion()
    # Several full SIMD vectors and a partial one.
    parameters = draws(model, 37)
    forces = trocar.simulate_many(model, time, position, parameters=parameters)
    models = [alone(model, parameters, index) for index in range(37)]
    expected = np.array([trocar.simulate(own, time, position) for own in models])
    assert np.array_equal(bits(forces), bits(expected))
    assert np.array_equal(bits(trocar.simulate_many(models, time, position)), bits(expected))
    readings = expected[3] + 0.1 * np.sin(time)
    readings[::7] = np.nan
    errors = np.where(np.isnan(readings), 0.0, (readings - expected) ** 2)
    # Summed from first to last like cumsum; sum uses another order.
    squares = np.cumsum(errors, axis=1)[:, -1].copy()
    for given in (dict(models=model, parameters=parameters), dict(models=models)):
        found = trocar.squared_error_many(time_s=time, position_m=position, force_n=readings, **given)
        assert np.array_equal(bits(found), bits(squares))


def test_models_of_all_kinds_go_together() -> None:
    models = [trocar.Model.load(path) for path in MODELS * 5]
    time, position = motion()
    expected = np.array([trocar.simulate(model, time, position) for model in models])
    assert np.array_equal(bits(trocar.simulate_many(models, time, position)), bits(expected))


@pytest.mark.parametrize("start", [{"initial_force_n": -1.0}, {"initial_deflection_m": 2e-3}], ids=lambda start: next(iter(start)))
@pytest.mark.parametrize("name", ["ems", "ems_stages", "ems_profile"])
def test_the_start_is_that_of_simulate(name: str, start: dict[str, float]) -> None:
    model = trocar.Model.load(CONFORMANCE / "models" / f"{name}.json")
    time, position = motion()
    parameters = draws(model, 20)
    forces = trocar.simulate_many(model, time, position, parameters=parameters, **start)
    expected = [trocar.simulate(alone(model, parameters, index), time, position, **start) for index in range(20)]
    assert np.array_equal(bits(forces), bits(np.array(expected)))


@pytest.mark.parametrize("count", [1, 7, 100, 1000])
@pytest.mark.parametrize("name", ["ems", "ems_stages", "leuven"])
def test_threads_change_nothing(name: str, count: int) -> None:
    model = trocar.Model.load(CONFORMANCE / "models" / f"{name}.json")
    time, position = (column[:500] for column in motion())
    parameters = draws(model, count)
    one, two, five = (
        trocar.simulate_many(model, time, position, parameters=parameters, threads=threads) for threads in (1, 2, 5)
    )
    assert np.array_equal(bits(one), bits(two)) and np.array_equal(bits(one), bits(five))
    sums = [
        trocar.squared_error_many(model, time, position, one[0], parameters=parameters, threads=threads)
        for threads in (1, 5)
    ]
    assert np.array_equal(bits(sums[0]), bits(sums[1])) and sums[0][0] == 0


@pytest.mark.parametrize("samples", [0, 1, 2, 33, 2048, 2049, 2050, 4096, 4097, 5000])
def test_motions_of_any_length(model: trocar.Model, samples: int) -> None:
    time = np.arange(samples) * 1e-3
    position = 0.02 * (1 - np.cos(3 * time))
    widths = np.linspace(5e-3, 9e-3, 40)
    forces = trocar.simulate_many(model, time, position, parameters={"half_width_m": widths})
    assert forces.shape == (40, samples)
    for index in (0, 17, 39):
        expected = trocar.simulate(model.tuned(half_width_m=widths[index]), time, position)
        assert np.array_equal(bits(forces[index]), bits(expected))
    squares = trocar.squared_error_many(model, time, position, np.zeros(samples), parameters={"half_width_m": widths})
    assert np.array_equal(squares, np.cumsum(forces**2, axis=1)[:, -1] if samples else np.zeros(40))


def test_parameters_come_in_any_table(model: trocar.Model) -> None:
    time, position = (column[:200] for column in motion())
    widths, forces = np.linspace(5e-3, 9e-3, 20), np.linspace(2.0, 4.0, 20)
    columns = {"half_width_m": widths, "insertion_coulomb_force_n": forces}
    expected = trocar.simulate_many(model, time, position, parameters=columns)
    record = np.array(list(zip(widths, forces)), dtype=[(name, float) for name in columns])
    for parameters in (pandas.DataFrame(columns), polars.DataFrame(columns), record, {n: list(v) for n, v in columns.items()}):
        assert np.array_equal(trocar.simulate_many(model, time, position, parameters=parameters), expected)
    # One number for all rows, and one model.
    same = trocar.simulate_many(model, time, position, parameters={**columns, "half_width_m": 7e-3})
    full = trocar.simulate_many(model, time, position, parameters={**columns, "half_width_m": np.full(20, 7e-3)})
    assert np.array_equal(same, full)
    one = trocar.simulate_many(model, time, position, parameters={"half_width_m": 7e-3})
    assert np.array_equal(one, trocar.simulate_many(model.tuned(half_width_m=7e-3), time, position))
    assert one.shape == (1, 200)
    assert trocar.simulate_many([], time, position).shape == (0, 200)
    assert trocar.simulate_many(model, time, position, parameters={"half_width_m": []}).shape == (0, 200)


def test_results_go_where_they_are_wanted(model: trocar.Model) -> None:
    time, position = (column[:200] for column in motion())
    parameters = {"half_width_m": np.linspace(5e-3, 9e-3, 20)}
    out, sums = np.full((20, 200), np.nan), np.full(20, np.nan)
    assert trocar.simulate_many(model, time, position, parameters=parameters, out=out) is out
    assert np.array_equal(out, trocar.simulate_many(model, time, position, parameters=parameters))
    assert trocar.squared_error_many(model, time, position, out[0], parameters=parameters, out=sums) is sums
    assert sums[0] == 0 and (sums[1:] > 0).all()


@pytest.mark.parametrize(
    ("out", "found"),
    [
        (np.empty((3, 4)), "an array of float64 of shape (3, 4)"),
        (np.empty(6), "an array of float64 of shape (6,)"),
        (np.empty((2, 3), np.float32), "an array of float32 of shape (2, 3)"),
        (np.empty((3, 2)).T, "one with gaps between its numbers"),
        (np.empty((2, 6))[:, ::2], "one with gaps between its numbers"),
        (np.frombuffer(bytes(48)).reshape(2, 3), "a read-only one"),
        ([[0.0] * 3] * 2, "list"),
    ],
)
def test_an_out_that_cannot_take_the_result_is_refused(model: trocar.Model, out: Any, found: str) -> None:
    with pytest.raises(trocar.ArrayError) as raised:
        trocar.simulate_many([model, model], [0, 1, 2], [0, 0, 0], out=out)
    expected = "out must be a contiguous, writable NumPy array of float64 of shape (2, 3), got "
    assert str(raised.value) == expected + found


def test_an_out_that_is_read_from_is_refused(model: trocar.Model) -> None:
    widths = np.linspace(5e-3, 9e-3, 3)
    with pytest.raises(trocar.ArrayError, match="out is in use"):
        trocar.squared_error_many(model, [0, 1], [0, 0], [0, 0], parameters={"half_width_m": widths}, out=widths)
    assert np.array_equal(widths, np.linspace(5e-3, 9e-3, 3))


WIDTHS = np.array([5.5e-3, 6e-3, 7.5e-3, 8e-3, 9e-3])


def with_one(value: float) -> np.ndarray:
    return np.array([5e-3, 6e-3, 7e-3, value, value])


@pytest.mark.parametrize(
    ("parameters", "kind", "words"),
    [
        ({"width": WIDTHS}, trocar.ParameterError, 'no parameter "width" to tune; there are half_width_m, insertion_'),
        ({}, trocar.ParameterError, "parameters has no column; there are half_width_m, "),
        ({"half_width_m": with_one(-1e-3)}, trocar.ParameterError, "half_width_m of model 3 must be finite and above 0 m, got -0.001 m"),
        ({"half_width_m": with_one(0)}, trocar.ParameterError, "half_width_m of model 3 must be finite and above 0 m, got 0 m"),
        ({"half_width_m": with_one(np.nan)}, trocar.ParameterError, "half_width_m of model 3 must be finite and above 0 m, got NaN m"),
        (
            {"insertion_static_ratio": [1, 1.5, 0.9]},
            trocar.ParameterError,
            "insertion_static_ratio of model 2 must be finite and at least 1, got 0.9",
        ),
        (
            {"half_width_m": WIDTHS, "friction_lag_s": [0, 0, 0.5, 0, 0]},
            trocar.ParameterError,
            "model 2 with half_width_m = 0.0075 m, friction_lag_s = 0.5 s: friction_lag_s = 0.5 s needs a creep_velocity_m_s above 0",
        ),
        (
            {"half_width_m": WIDTHS, "seal_damping_n_s_m": [0.0, 1.0]},
            trocar.ArrayError,
            "seal_damping_n_s_m has 2 values, expected 5 as half_width_m has",
        ),
        ({"half_width_m": ["wide"]}, trocar.ArrayError, "half_width_m must hold numbers, got text"),
        ({"half_width_m": True}, trocar.ArrayError, "half_width_m must hold numbers, got truth values"),
        ({"half_width_m": [WIDTHS]}, trocar.ArrayError, "half_width_m must have one dimension, got shape (1, 5)"),
        ([1.0, 2.0], TypeError, "expected a data frame or a dictionary of columns, got list"),
    ],
)
def test_parameters_that_make_no_model_are_named(model: trocar.Model, parameters: Any, kind: type, words: str) -> None:
    out = np.full((5, 3), 7.0)
    with pytest.raises(kind) as raised:
        trocar.simulate_many(model, [0, 1, 2], [0, 0, 0], parameters=parameters, out=out)
    assert words in str(raised.value)
    # Only errors that a single number does not show are found when the models are constructed.
    assert (out == 7).all() or "needs a creep_velocity" in words


def test_what_cannot_be_run_is_named(model: trocar.Model) -> None:
    dahl = trocar.Model.load(CONFORMANCE / "models" / "dahl.json")
    widths = {"half_width_m": WIDTHS}
    with pytest.raises(TypeError, match="parameters belong to one model, got 2 models"):
        trocar.simulate_many([model, model], [0], [0], parameters=widths)
    with pytest.raises(TypeError, match="models: expected trocar.Model, got str"):
        trocar.simulate_many(["model.json"], [0], [0])  # type: ignore[list-item]
    with pytest.raises(trocar.MotionError, match="position_m has 1 samples, expected 2 as time_s has"):
        trocar.simulate_many(model, [0, 1], [0])
    with pytest.raises(trocar.MotionError, match="sample 1: position_m is NaN m, expected a finite number"):
        trocar.simulate_many(model, [0, 1], [0, np.nan])
    with pytest.raises(trocar.MotionError, match="force_n has 3 samples, expected 2 as time_s has"):
        trocar.squared_error_many(model, [0, 1], [0, 0], [0, 0, 0])
    with pytest.raises(trocar.RecordingError, match="sample 1: force_n is inf N, expected a finite number, or nan where"):
        trocar.squared_error_many(model, [0, 1], [0, 0], [0, np.inf])
    with pytest.raises(trocar.ParameterError, match="model 1 is a classical one and has no deflection"):
        trocar.simulate_many([model, dahl], [0], [0], initial_deflection_m=1e-3)
    with pytest.raises(TypeError, match="not both"):
        trocar.simulate_many(model, [0], [0], initial_deflection_m=1e-3, initial_force_n=1.0)
    with pytest.raises(trocar.ParameterError, match="threads must be a whole number from 0 on, got -1"):
        trocar.simulate_many(model, [0], [0], threads=-1)


def test_other_threads_run_meanwhile(model: trocar.Model) -> None:
    time = np.arange(200_000) * 1e-3
    position = 0.02 * (1 - np.cos(3 * time))
    done = threading.Event()

    def work() -> None:
        trocar.squared_error_many(model, time, position, time, parameters={"half_width_m": np.linspace(5e-3, 9e-3, 200)})
        done.set()

    thread = threading.Thread(target=work)
    thread.start()
    turns = 0
    while not done.wait(1e-4):
        turns += 1
    thread.join()
    # Some 100 ms of work; with the GIL held there would be only one or two turns.
    assert turns > 10


def test_the_example_of_the_documentation_runs() -> None:
    text = (ROOT / "docs" / "reference" / "python.md").read_text().split("## Many models", 1)[1]
    names: dict[str, Any] = {}
    exec(text.split("```python\n", 1)[1].split("```", 1)[0], names)
    assert abs(names["width_m"] - 8e-3) < 2 * names["width_std_m"] < 1e-3
    # N rms: slightly above the added noise.
    assert 0.049 < names["rms_n"].min() < 0.055
    assert names["band_n"].shape == (2, 4000)


def test_masked_readings_do_not_count(model: trocar.Model) -> None:
    time, position = (column[:200] for column in motion())
    readings = np.ma.masked_array(trocar.simulate(model, time, position))
    readings[3] = 500.0
    readings[3] = np.ma.masked
    assert trocar.squared_error_many(model, time, position, readings)[0] == 0.0


def test_readings_that_are_all_missing_choose_no_model(model: trocar.Model) -> None:
    time, position = (column[:200] for column in motion())
    with pytest.raises(trocar.RecordingError, match="no reading"):
        trocar.squared_error_many(model, time, position, np.full(200, np.nan))


def test_two_views_of_one_buffer_are_no_place_for_results(model: trocar.Model) -> None:
    time, position = (column[:200] for column in motion())
    buffer = bytearray(8 * 200)
    with pytest.raises(trocar.ArrayError, match="out is in use"):
        trocar.squared_error_many([model] * 200, time, position, np.frombuffer(buffer), out=np.frombuffer(buffer))


def test_a_classical_model_among_others_is_refused_before_anything_is_written(model: trocar.Model) -> None:
    models = [model] * 100 + [trocar.Model.load(CONFORMANCE / "models" / "dahl.json")]
    time, position = (column[:200] for column in motion())
    out = np.full((101, 200), 7.0)
    with pytest.raises(trocar.ParameterError, match="model 100"):
        trocar.simulate_many(models, time, position, initial_deflection_m=1e-3, out=out)
    assert np.all(out == 7.0)


def test_a_ragged_column_is_named(model: trocar.Model) -> None:
    with pytest.raises(trocar.ArrayError, match="half_width_m must be a row of numbers"):
        trocar.simulate_many(model, *motion(), parameters={"half_width_m": [[1, 2], [3]]})
