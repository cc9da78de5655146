"""Reads the same columns of the same files with polars and with trocar, by turns, on two cores.

reading.py PROGRAM [ROWS]: PROGRAM is the example read_columns of the crate trocar, which stays alive between files, as this
process does. Times are medians of the wall clock and of the processors, over RUNS turns behind one that is not counted.
"""

import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import polars as pl
import pyarrow.parquet as pq

RUNS = 9
COLUMNS = ["time_s", "position_m", "force_n"]
TICKS = os.sysconf("SC_CLK_TCK")


def recording(rows):
    """1 kHz, an encoder of 4 um, a force with noise, and a column that nobody asks for."""
    k = np.arange(rows)
    random = np.random.default_rng(1)
    position = np.round(0.06 * (1 - np.cos(k / 2000)) / 4e-6) * 4e-6
    force = np.round(1.5 * np.sign(np.sin(k / 2000)) + random.normal(0, 0.025, rows), 6)
    columns = {"time_s": k / 1000, "position_m": np.round(position, 6), "current_a": random.normal(0, 1, rows), "force_n": force}
    return pl.DataFrame(columns)


def write(frame, folder):
    frame.write_csv(folder / "plain.csv")
    frame.write_parquet(folder / "polars.parquet")
    frame.write_parquet(folder / "polars_plain.parquet", compression="uncompressed")
    pq.write_table(frame.to_arrow(), folder / "pyarrow.parquet")
    return sorted(folder.iterdir())


def cpu():
    """Seconds that this process has spent on processors."""
    times = os.times()
    return times.user + times.system


def with_polars(path):
    before, start = cpu(), time.perf_counter()
    read = pl.read_csv(path, columns=COLUMNS) if path.suffix == ".csv" else pl.read_parquet(path, columns=COLUMNS)
    seconds = time.perf_counter() - start
    spent = cpu() - before
    return seconds, spent, read.height, sum(read[name].sum() for name in COLUMNS)


def with_trocar(program, path):
    print(path, file=program.stdin, flush=True)
    seconds, ticks, rows, total = program.stdout.readline().split()
    return float(seconds), int(ticks) / TICKS, int(rows), float(total)


def main():
    rows = int(sys.argv[2]) if len(sys.argv) > 2 else 5_000_000
    program = subprocess.Popen([sys.argv[1], *COLUMNS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    print(f"{rows} rows, {len(COLUMNS)} of 4 columns, two cores, medians of {RUNS}: wall time / processor time in s")
    with tempfile.TemporaryDirectory() as folder:
        for path in write(recording(rows), pathlib.Path(folder)):
            turns = [(with_polars(path), with_trocar(program, path)) for _ in range(RUNS + 1)][1:]
            for theirs, ours in turns:
                assert ours[2] == theirs[2] == rows and abs(ours[3] - theirs[3]) <= 1e-9 * rows * 5e3, (path, ours, theirs)
            wall, spent = ([statistics.median(turn[who][k] for turn in turns) for who in (0, 1)] for k in (0, 1))
            megabytes = path.stat().st_size / 1e6
            print(
                f"{path.name:24} {megabytes:7.1f} MB  polars {wall[0]:.3f} / {spent[0]:.2f}  trocar {wall[1]:.3f} / {spent[1]:.2f}"
                f"  ratio {wall[1] / wall[0]:.2f} / {spent[1] / spent[0]:.2f}",
                flush=True,
            )
    program.stdin.close()


main()
