"""Identifies a data set on a local cluster of several worker processes, and prints what became of it.

    python python/examples/cluster.py [FOLDER [WORKERS]]

Without a FOLDER of recordings it makes one on the virtual bench: twelve short recordings of two seals, with the number of
insertions in the folders' names. Needs ``pip install trocar[dask]``.
"""

import csv
import pathlib
import sys
import tempfile

import trocar
from distributed import Client, LocalCluster
from trocar import fleet

#: A recording of some thousand samples: three speeds.
SHORT = "[protocol.steady]\nincrement_m_s = 0.04\nstroke_m = 0.06\n"


def make(folder: pathlib.Path) -> None:
    """Recordings of one seal, its friction falling with use as after wetting, in folders that say how often it was used."""
    for use in range(12):
        inner = folder / f"insertion_count={10 * use}"
        inner.mkdir(parents=True)
        level = 1.0 - 0.02 * use
        recording = trocar.bench("steady", seed=use + 1, config=f"{SHORT}[lubrication]\nlevel = {level}\nonset_s = 0.0\nspread_s = 0.0\n")
        recording.save(inner / "recording.csv")


def main() -> None:
    workers = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else pathlib.Path(scratch) / "recordings"
        if len(sys.argv) < 2:
            make(folder)
        out = pathlib.Path(scratch) / "table.csv"
        # Any other cluster will do: Client("scheduler:8786").
        with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
            with Client(cluster) as client:
                done = fleet.identify_dataset(folder, out, client=client)
        print(f"{done.recordings} recordings, {workers} workers: {done.ok} ok, {done.doubtful} doubtful, {len(done.failed)} failed")
        with out.open(newline="") as file:
            for row in csv.DictReader(file):
                low, value, high = (row["coulomb_force_n" + end] for end in ("_lower", "", "_upper"))
                print(f"{row['path']}: {row['status']}, F_c {value} N, 95 % interval {low} to {high} N")


if __name__ == "__main__":  # workers import this file
    main()
