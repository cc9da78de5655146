"""Many seals along one motion: a call for all beside a loop over ``trocar.simulate``, turn by turn.

    python python/benchmarks/many.py

``crates/trocar-py/check --bench`` builds the package and calls this. Printed are medians, ns per seal and sample, and the medians of
the ratios to two loops of the same turn: over models that are there already, and with ``tuned`` for each. Time is that of the
processor, which a busy machine disturbs little; for several threads it is that on the wall, which wants idle cores.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable

import numpy as np

import trocar

SEALS = 1024
SAMPLES = 4000
TURNS = 15


def motion() -> tuple[np.ndarray, np.ndarray]:
    """40 mm strokes at 1 kHz, with a tremor of 9 Hz."""
    time_s = np.arange(SAMPLES) * 1e-3
    return time_s, 0.02 * (1 - np.cos(3 * time_s)) + 2e-4 * np.sin(56.5 * time_s)


def measure(viscous: float) -> None:
    time_s, position_m = motion()
    dampings = {f"{way}_viscous_damping_n_s_m": viscous for way in ("insertion", "withdrawal")}
    model = trocar.Model.plausible().tuned(**dampings)
    draws = {"half_width_m": np.linspace(5.6e-3, 10.4e-3, SEALS)}
    models = [model.tuned(half_width_m=width) for width in draws["half_width_m"].tolist()]
    readings = trocar.simulate(model, time_s, position_m)
    forces, loops = np.zeros((SEALS, SAMPLES)), np.zeros((SEALS, SAMPLES))

    def loop() -> None:
        for own, row in zip(models, loops):
            trocar.simulate(own, time_s, position_m, out=row)

    def tuned_loop() -> None:
        for width, row in zip(draws["half_width_m"].tolist(), loops):
            trocar.simulate(model.tuned(half_width_m=width), time_s, position_m, out=row)

    def many(threads: int) -> Callable[[], object]:
        return lambda: trocar.simulate_many(model, time_s, position_m, parameters=draws, out=forces, threads=threads)

    def squares(threads: int) -> Callable[[], object]:
        return lambda: trocar.squared_error_many(model, time_s, position_m, readings, parameters=draws, threads=threads)

    def listed() -> object:
        return trocar.simulate_many(models, time_s, position_m, out=forces, threads=1)

    def time_of(work: Callable[[], object], clock: Callable[[], float]) -> float:
        start = clock()
        work()
        return (clock() - start) * 1e9 / (SEALS * SAMPLES)

    alone: dict[str, Callable[[], object]] = {
        "loop over simulate": loop,
        "loop over tuned and simulate": tuned_loop,
        "simulate_many of a list": listed,
        "simulate_many of columns": many(1),
        "squared_error_many of columns": squares(1),
    }
    threaded: dict[str, tuple[Callable[[], object], Callable[[], object]]] = {
        "simulate_many of columns": (many(1), many(0)),
        "squared_error_many of columns": (squares(1), squares(0)),
    }
    turns = [{name: time_of(work, time.process_time) for name, work in alone.items()} for _ in range(TURNS)]
    assert np.array_equal(forces, loops), "both sides must do the same work"
    print(f"\n{SEALS} seals, {SAMPLES} samples, viscous damping {viscous:g} N s/m, medians of {TURNS} turns, one thread")
    for name in alone:
        cost = statistics.median(turn[name] for turn in turns)
        to = [statistics.median(turn[first] / turn[name] for turn in turns) for first in list(alone)[:2]]
        print(f"{name:30} {cost:6.2f} ns per seal and sample; the loops take {to[0]:5.2f} and {to[1]:5.2f} times as long")
    for name, (one, all_) in threaded.items():
        ratio = statistics.median(time_of(one, time.perf_counter) / time_of(all_, time.perf_counter) for _ in range(TURNS))
        print(f"{name:30} on {os.cpu_count()} threads {ratio:.2f} times as fast as on one, on the wall")


if __name__ == "__main__":
    for viscous in (0.0, 5.0):
        measure(viscous)
