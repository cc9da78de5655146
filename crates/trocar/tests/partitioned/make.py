"""Writes the partitioned data sets that tests/fleet_partitioned.rs reads, with pyarrow.dataset and polars: their layouts, names and encodings.

Three recordings, 16 to 18, of an instrument going to and fro by 30 mm at 20, 50 and 100 mm/s, every 10 ms, against a friction of
(2 + 0.5 n) N (n = 0, 1, 2), stiff over the first 2 mm, and 4 N s/m. The same rows in each data set:

    one/part-0.parquet            polars: all rows in one file
    blocks/part-N.parquet         pyarrow.dataset: a new file every 700 rows, wherever that cuts
    hive/recording=16/part-N.parquet  pyarrow.dataset: folders by recording, a new file every 400 rows
    polars/recording=16/...       polars: the same with its own names
    moments/part-N.parquet        pyarrow.dataset: as blocks, times as timestamps, columns in another order, and a list column

Run from this folder with requirements.txt; the files are committed, so that tests need no Python.
"""

import pathlib
import shutil

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.dataset as ds

HERE = pathlib.Path(__file__).parent
INTERVAL_US = 10_000
STROKE_M = 0.03
WIDTH_M = 2e-3
VISCOUS_N_S_M = 4.0
ACCELERATION_M_S2 = 1.0


def motion():
    """Positions in m: strokes with ramps, two cycles at each speed."""
    all_positions = [np.zeros(1)]
    for speed in [0.02, 0.05, 0.1]:
        ramp, cruise = speed / ACCELERATION_M_S2, (STROKE_M - speed**2 / ACCELERATION_M_S2) / speed
        t = np.arange(0, 2 * ramp + cruise, INTERVAL_US * 1e-6)
        insertion = np.where(t < ramp, t**2 / 2 * ACCELERATION_M_S2, speed * (t - ramp / 2))
        left = np.maximum(2 * ramp + cruise - t, 0)
        insertion = np.where(t > ramp + cruise, STROKE_M - left**2 / 2 * ACCELERATION_M_S2, insertion)
        all_positions += 2 * [insertion, STROKE_M - insertion]
    return np.concatenate(all_positions)


def recording(number):
    position = np.round(motion(), 6)
    level = 2 + 0.5 * number
    friction, stuck = np.zeros(len(position)), 0.0
    for k in range(1, len(position)):
        stuck = np.clip(stuck + level / WIDTH_M * (position[k] - position[k - 1]), -level, level)
        friction[k] = stuck
    velocity = np.gradient(position, INTERVAL_US * 1e-6)
    noise = 0.02 * np.random.default_rng(number).standard_normal(len(position))
    return pa.table({
        "recording": pa.array([16 + number] * len(position), pa.int64()),
        "lubricant": [["dry", "gel"][number % 2]] * len(position),
        "time_s": np.arange(len(position)) * INTERVAL_US / 1e6,
        "position_m": position,
        "force_n": np.round(friction + VISCOUS_N_S_M * velocity + noise, 3),
    })


def write(table, name, rows, **options):
    """By pyarrow, a new file every `rows` rows."""
    options = {"format": "parquet", "max_rows_per_file": rows, "max_rows_per_group": rows // 2, "min_rows_per_group": 1} | options
    ds.write_dataset(table, HERE / name, basename_template="part-{i}.parquet", use_threads=False, **options)


for folder in ["one", "blocks", "hive", "polars", "moments"]:
    shutil.rmtree(HERE / folder, ignore_errors=True)
table = pa.concat_tables([recording(number) for number in range(3)])
frame = pl.from_arrow(table)
(HERE / "one").mkdir()
frame.write_parquet(HERE / "one/part-0.parquet")
write(table, "blocks", 700)
write(table, "hive", 400, partitioning=ds.partitioning(pa.schema([("recording", pa.int64())]), flavor="hive"))
by_recording = pl.PartitionBy(HERE / "polars", key="recording", include_key=False, max_rows_per_file=400)
frame.lazy().sink_parquet(by_recording, mkdir=True, maintain_order=True)
stamps = (table["time_s"].to_numpy() * 1e6).round().astype(np.int64) + 1_700_000_000_123_456
moments = pa.table({
    "force_n": table["force_n"],
    "position_m": table["position_m"],
    "time": pa.array(stamps, pa.timestamp("us", tz="UTC")),
    "tags": pa.array([["a", "b"]] * len(table), pa.list_(pa.string())),
    "recording": table["recording"],
    "lubricant": table["lubricant"].combine_chunks().dictionary_encode(),
})
write(moments, "moments", 700)
print(len(table), "rows", sum(path.stat().st_size for path in HERE.rglob("*.parquet")), "bytes")
