"""Every public class pickles and copies, and what goes on goes on with the same numbers."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Callable

import joblib
import numpy as np
import pytest

import trocar
from trocar import fleet

from .conftest import ROD_KG

Columns = tuple[np.ndarray, np.ndarray, np.ndarray]

def pickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


def public() -> dict[str, type]:
    """All classes that a user can name."""
    named = [(module, name) for module in (trocar, fleet) for name in module.__all__]
    found = {name: getattr(module, name) for module, name in named}
    return {name: value for name, value in found.items() if isinstance(value, type)}


@pytest.fixture(scope="module")
def instances(
    found: trocar.Identification, training: list[trocar.Recording], held_out: list[trocar.Recording]
) -> dict[type, Any]:
    recording = held_out[0]
    live, stepper = trocar.Compensator(found.model), trocar.Stepper(found.model)
    comparison = trocar.compare(training, models=["coulomb"], moving_mass_kg=ROD_KG)
    compensation = live.run(recording.time_s, recording.position_m, recording.force_n)
    stepper.step(1e-3, 0.01)
    assert found.validation is not None and found.covariance is not None
    parameter = found.params["half_width_m"]
    drawn = trocar.identify(training, moving_mass_kg=ROD_KG, posterior=400)
    loop = trocar.teleop(found.model, advise=True, map=True, delays_s=[0.0], fractions=[0.0, 1.0], hybrid=True)
    planned = trocar.plan(duration_s=60, draws=2, rig={"sample_rate_hz": 200.0})
    made = [
        recording,
        found,
        found.model,
        found.model.tunables[0],
        stepper,
        live,
        live.step(0.1, np.nan, 1e-3),
        found.params,
        drawn.posterior,
        parameter,
        found.covariance,
        trocar.ResultWarning("half_width_m", "a remark", False),
        found.validation,
        found.validation.recordings[0],
        found.forces(),
        next(iter(found.figures.values())),
        comparison,
        comparison.models[0],
        trocar.simulate_full(found.model, [0.0, 0.1], [0.0, 0.01]),
        compensation,
        compensation.drift,
        loop,
        loop.figures,
        loop.advice,
        trocar.NoticeableStep("noticed", 80.0),
        loop.map,
        loop.hybrid,
        planned,
        planned.expected["half_width_m"],
        fleet.Config(columns={"position_mm": "pos"}),
        fleet.Outcome(Path("table.csv"), 2, 1, 0, (("b.csv", "empty"),), 0, ()),
    ]
    return {type(value): value for value in made}


def contents(value: Any) -> Any:
    """What ``value`` holds, in a form in which nan equals nan."""
    if isinstance(value, trocar.Figure):
        return str(value), value.name, value.heading, value.caption
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if isinstance(value, BaseException):
        return type(value), value.args
    if isinstance(value, Mapping):
        return {key: contents(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return type(value), [contents(item) for item in value]
    if dataclasses.is_dataclass(value):
        # The call that repeats a result holds its recordings, which are compared by themselves.
        names = [own.name for own in dataclasses.fields(value) if own.name != "_work"]
        return {name: contents(getattr(value, name)) for name in names}
    if type(value).__module__.startswith("trocar") and not isinstance(value, trocar.Model):
        public_names = [name for name in dir(value) if not name.startswith("_")]
        own = {name: getattr(value, name) for name in public_names}
        shown = {name: contents(item) for name, item in own.items() if not callable(item)}
        return shown, contents(value.__reduce__()[1])
    return value


@pytest.mark.parametrize("make", [pickled, copy.copy, copy.deepcopy], ids=["pickle", "copy", "deepcopy"])
@pytest.mark.parametrize("name", sorted(public()))
def test_every_public_class_can_be_sent(
    name: str, make: Callable[[Any], Any], instances: dict[type, Any]
) -> None:
    kind = public()[name]
    if issubclass(kind, BaseException):
        value: Any = kind("what is wrong")
    else:
        assert kind in instances, f"{name} is new: add one of it to the fixture"
        value = instances[kind]
    restored = make(value)
    assert type(restored) is kind
    assert contents(restored) and contents(restored) == contents(value)


def test_the_contents_tell_objects_apart(instances: dict[type, Any]) -> None:
    live = copy.copy(instances[trocar.Compensator])
    assert contents(live) != contents(trocar.Compensator(live.model))
    assert len({repr(contents(p)) for p in live.model.tunables}) == len(live.model.tunables)


def run(live: trocar.Compensator, columns: Columns) -> tuple[list[np.ndarray], tuple[float, ...], bool]:
    estimate = live.run(*columns)
    arrays = [estimate.tissue_force_n, estimate.trocar_force_n, estimate.tissue_force_std_n]
    return [*arrays, estimate.adapting, estimate.fault], live.drift, live.is_in_contact


def same(a: Any, b: Any) -> bool:
    return all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a[0], b[0])) and a[1:] == b[1:]


@pytest.mark.parametrize("cut", [0, 1, 500, 20_000])
def test_a_compensator_goes_on_from_its_copy(
    cut: int, found: trocar.Identification, held_out: list[trocar.Recording]
) -> None:
    surgeon = held_out[1]
    columns = surgeon.time_s, surgeon.position_m, surgeon.force_n
    live = trocar.Compensator(found.model, sensor_limit_n=20, moving_mass_kg=ROD_KG)
    if cut:
        run(live, tuple(column[:cut] for column in columns))  # type: ignore[arg-type]
    copies = [copy.copy(live), copy.deepcopy(live), pickled(live), pickled(pickled(live))]
    rest: Any = tuple(column[cut:] for column in columns)
    ahead = run(live, rest)
    assert all(same(run(one, rest), ahead) for one in copies)
    # The options came with it: a reading at the limit is saturated.
    assert pickled(live).step(surgeon.position_m[-1], 21.0, 1e-3).fault == "saturated"
    # And the clock: time does not go back.
    with pytest.raises(trocar.MotionError, match="goes back"):
        pickled(live).run([columns[0][-1] - 1], [0.0], [0.0])


def test_a_compensator_is_sent_to_another_process(
    found: trocar.Identification, held_out: list[trocar.Recording]
) -> None:
    columns = held_out[0].time_s, held_out[0].position_m, held_out[0].force_n
    halves = [tuple(part) for part in zip(*(np.split(c, [len(c) // 2]) for c in columns))]
    live = trocar.Compensator(found.model)
    run(live, halves[0])  # type: ignore[arg-type]
    there = joblib.Parallel(n_jobs=2)(joblib.delayed(live.run)(*halves[1]) for _ in range(2))
    here = live.run(*halves[1])
    assert all(contents(one) == contents(here) for one in there)


def test_damaged_pickles_are_refused(instances: dict[type, Any]) -> None:
    restore, (model, options, state, *rest) = instances[trocar.Compensator].__reduce__()
    for damaged in (state[:-1], np.append(state, 0.0), state * np.nan, np.roll(state, 1)):
        with pytest.raises(trocar.ArrayError, match="not the state of a compensator"):
            restore(model, options, damaged, *rest)
    restore, fields = instances[trocar.TissueForce].__reduce__()
    with pytest.raises(trocar.ArrayError, match='"tired" is no fault of a sample'):
        restore(*fields[:-2], "tired", fields[-1])
    restore, (_, value) = instances[trocar.Tunable].__reduce__()
    with pytest.raises(trocar.ParameterError, match='no parameter is named "colour"'):
        restore("colour", value)
