"""A million samples from Python against the same loop in Rust, turn by turn.

    python python/benchmarks/simulate.py target/release/examples/simulate_arrays

``crates/trocar-py/check --bench`` builds both and calls this. Printed are medians and the median of the ratios of
neighbouring runs; the aim is at most 1.2.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import trocar

SAMPLES = 1_000_000
TURNS = 31
AIM = 1.2


def main(program: str) -> int:
    time_s = np.arange(SAMPLES) * 1e-3
    position_m = np.round(0.02 * (1 - np.cos(3 * time_s)) / 4e-6) * 4e-6
    model = trocar.Model.plausible()
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("model.json", "time", "position")]
        model.save(paths[0])
        time_s.tofile(paths[1])
        position_m.tofile(paths[2])
        rust = subprocess.Popen([program, *paths], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        assert rust.stdin is not None and rust.stdout is not None
        turns = []
        for _ in range(TURNS):
            rust.stdin.write("\n")
            rust_s, rust_force_n = map(float, rust.stdout.readline().split())
            start = time.perf_counter()
            force_n = trocar.simulate(model, time_s, position_m)
            python_s = time.perf_counter() - start
            assert force_n[-1] == rust_force_n, "both sides must do the same work"
            turns.append((python_s, rust_s))
        rust.stdin.close()
        rust.wait()
    python_ms, rust_ms = (1e3 * statistics.median(column) for column in zip(*turns))
    ratio = statistics.median(python_s / rust_s for python_s, rust_s in turns)
    print(f"{SAMPLES} samples, {TURNS} turns: Python {python_ms:.1f} ms, Rust {rust_ms:.1f} ms, ratio {ratio:.3f} (aim {AIM})")
    return int(ratio > AIM)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
