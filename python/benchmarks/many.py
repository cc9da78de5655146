"""Many seals along one motion: a call for all beside a loop over ``trocar.simulate``, turn by turn.

    python python/benchmarks/many.py

``crates/trocar-py/check --bench`` builds the package and calls this. Printed are medians, ns per seal and sample, and the medians of
the ratios of neighbouring works to the loop: of models that are there already, and with ``tuned`` for each.
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
        options = {"parameters": draws, "threads": threads}
        return lambda: trocar.squared_error_many(model, time_s, position_m, readings, **options)

    def listed() -> object:
        return trocar.simulate_many(models, time_s, position_m, out=forces, threads=1)

    works: dict[str, Callable[[], object]] = {
        "loop over simulate": loop,
        "loop over tuned and simulate": tuned_loop,
        "simulate_many of a list, 1 thread": listed,
        "simulate_many, 1 thread": many(1),
        f"simulate_many, {os.cpu_count()} threads": many(0),
        "squared_error_many, 1 thread": squares(1),
        f"squared_error_many, {os.cpu_count()} threads": squares(0),
    }
    turns: list[dict[str, float]] = []
    for _ in range(TURNS):
        turn = {}
        for name, work in works.items():
            start = time.perf_counter()
            work()
            turn[name] = (time.perf_counter() - start) * 1e9 / (SEALS * SAMPLES)
        turns.append(turn)
    assert np.array_equal(forces, loops), "both sides must do the same work"
    print(f"\n{SEALS} seals, {SAMPLES} samples, viscous damping {viscous:g} N s/m, medians of {TURNS} turns")
    for name in works:
        cost = statistics.median(turn[name] for turn in turns)
        to = [statistics.median(turn[first] / turn[name] for turn in turns) for first in list(works)[:2]]
        print(f"{name:34} {cost:6.2f} ns per seal and sample; the loops take {to[0]:5.2f} and {to[1]:5.2f} times as long")


if __name__ == "__main__":
    for viscous in (0.0, 5.0):
        measure(viscous)
