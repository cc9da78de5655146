"""Ctrl-C raises an exception, and cancelled work stops."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

import trocar

from .conftest import CONFORMANCE, ROD_KG

#: Time, s, within which an interruption must raise its exception on a busy machine.
ARRIVES = 1.0
#: Maximum processor time, s, that cancelled work may still use.
ENDS = 1.0


@pytest.fixture(autouse=True)
def interruptible() -> Iterator[None]:
    """Restores the Ctrl-C handler: a shell starts background jobs with SIGINT ignored, and Python inherits this."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupted(work: Callable[[], object], after: float) -> float:
    """Time, s, from the signal to the exception."""
    sent = []

    def send() -> None:
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, send)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        work()
    return time.perf_counter() - sent[0]


@pytest.mark.parametrize("after", [0.1, 0.5, 1.5])
def test_identify_and_compare_are_interrupted(training: list[trocar.Recording], after: float) -> None:
    surgeon = [trocar.bench("surgeon", seed=seed) for seed in (1, 2)]
    works = [
        lambda: trocar.identify(training, posterior=4_000_000, moving_mass_kg=ROD_KG),
        lambda: trocar.identify([*training, *surgeon], posterior=4_000_000),
        lambda: trocar.compare(training, models="all", moving_mass_kg=ROD_KG),
    ]
    for work in works:
        assert interrupted(work, after) < ARRIVES
        before = time.process_time()
        time.sleep(2 * ENDS)
        assert time.process_time() - before < ENDS, "the work goes on although nobody waits for it"


def test_compensate_is_interrupted(found: trocar.Identification) -> None:
    # Each sample takes about a microsecond, so this is seconds of work.
    positions = np.tile(0.02 * (1 - np.cos(np.arange(10_000) * 2e-3 * np.pi)), 500)
    times = np.arange(len(positions)) * 1e-3
    # The readings never repeat, so that no frozen sensor is detected.
    readings = np.tile(trocar.simulate(found.model, times[:10_000], positions[:10_000]), 500) + 1e-3 * np.sin(times)
    recording = trocar.Recording(times, positions, readings)
    works = [
        lambda: trocar.compensate(found.model, recording),
        lambda: trocar.Compensator(found.model).run(times, positions, readings),
    ]
    for work in works:
        assert interrupted(work, 0.3) < ARRIVES
    assert len(trocar.Compensator(found.model).run(times[:10], positions[:10], readings[:10]).tissue_force_n) == 10


def test_simulate_is_interrupted() -> None:
    positions = np.tile(0.02 * (1 - np.cos(np.arange(10_000) * 2e-3 * np.pi)), 3000)
    times = np.arange(len(positions)) * 1e-3
    model = trocar.Model.plausible()
    # Reading the arrays alone takes some tenths of a second here.
    assert interrupted(lambda: trocar.simulate(model, times, positions), 0.3) < ARRIVES
    assert len(trocar.simulate(model, times[:10], positions[:10])) == 10


@pytest.mark.parametrize("name", ["ems", "leuven"])
def test_many_models_are_interrupted(name: str) -> None:
    positions = np.tile(0.02 * (1 - np.cos(np.arange(10_000) * 2e-3 * np.pi)), 20)
    times = np.arange(len(positions)) * 1e-3
    models = [trocar.Model.load(CONFORMANCE / "models" / f"{name}.json")] * 10_000
    out = np.zeros((20, len(times)))
    many = {models[0].tunables[0].name: np.full(20_000_000, models[0].tunables[0].value)}
    works = [
        lambda: trocar.squared_error_many(models, times, positions, times),
        lambda: [trocar.simulate_many(models[:20], times, positions, out=out) for _ in range(1000)],
        # Constructing the models takes longer than running them.
        lambda: trocar.squared_error_many(models[0], [0], [0], [0], parameters=many),
    ]
    for work in works:
        assert interrupted(work, 0.3) < ARRIVES
        # No thread continues to write to an array that its owner may have released.
        written = out.copy()
        before = time.process_time()
        time.sleep(ENDS)
        assert time.process_time() - before < 0.1 * ENDS
        assert np.array_equal(out, written)
    assert trocar.simulate_many(models[:3], times[:10], positions[:10]).shape == (3, 10)


def test_teleoperation_is_interrupted(found: trocar.Identification) -> None:
    works: list[Callable[[], object]] = [
        lambda: trocar.teleop(found.model, advise=True, draws=1000),
        lambda: trocar.teleop(found.model, map=True, delays_s=1e-3 * np.arange(100), fractions=1e-2 * np.arange(100)),
        # One run of the loop, the longest there is.
        lambda: trocar.teleop(found.model, substeps=10, motion={"duration_s": 1000.0}),
    ]
    for work in works:
        assert interrupted(work, 0.3) < ARRIVES
        before = time.process_time()
        time.sleep(2 * ENDS)
        assert time.process_time() - before < ENDS


def test_nobody_waits_for_a_million_threads() -> None:
    model = trocar.Model.plausible()
    before = time.perf_counter()
    trocar.simulate_many([model], [0.0, 1.0], [0.0, 1e-3], threads=1_000_000)
    assert time.perf_counter() - before < ARRIVES
