"""Many recordings to one table: rows for whatever happens, the same table from every engine, also when workers are killed."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import trocar
from trocar import fleet

#: A recording of some thousand samples: three speeds.
SHORT = "[protocol.steady]\nincrement_m_s = 0.04\nstroke_m = 0.06\n"
RECORDINGS = 8


@pytest.fixture(scope="module")
def strokes() -> list[trocar.Recording]:
    return [trocar.bench("steady", seed=seed, config=SHORT) for seed in range(1, RECORDINGS + 1)]


def frame(recording: trocar.Recording) -> dict[str, Any]:
    return {"time_s": recording.time_s, "position_m": recording.position_m, "force_n": recording.force_n}


@pytest.fixture(scope="module")
def folder(strokes: list[trocar.Recording], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files in folders named after what they hold, one of them no recording."""
    root = tmp_path_factory.mktemp("dataset")
    for number, recording in enumerate(strokes):
        inner = root / f"lubricant={'dry' if number % 2 else 'wet'}"
        inner.mkdir(exist_ok=True)
        recording.save(inner / f"{number}.csv")
    (root / "lubricant=dry" / "notes.csv").write_text("time_s,position_m,force_n\n0,zero,0\n")
    return root


def table(path: Path) -> list[dict[str, Any]]:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (requirements-dask.txt)")
    rows: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
    return rows


# One recording.


def test_a_row_is_the_identification(strokes: list[trocar.Recording]) -> None:
    found = trocar.identify(strokes[0], bootstrap=0, free_motion=False, seed=1).parameters["coulomb_force_n"]
    row = fleet.identify_one(frame(strokes[0]), name="first")
    assert (row["path"], row["status"]) == ("first", "ok")
    assert [row["coulomb_force_n" + end] for end in ("", "_lower", "_upper")] == [
        found.value,
        found.ci95_low,
        found.ci95_high,
    ]
    assert row["samples"] == len(strokes[0])
    assert list(row) == list(fleet.columns())


def test_a_file_and_its_columns_give_the_same_numbers(folder: Path) -> None:
    path = folder / "lubricant=wet" / "0.csv"
    of_file, of_columns = fleet.identify_one(path), fleet.identify_one(frame(trocar.read(path)))
    differ = {name for name in of_file if of_file[name] != of_columns[name]}
    assert differ <= {"path", "recording", "sha256"}


@pytest.mark.parametrize(
    ("recording", "kind", "words"),
    [
        ("nowhere.csv", "cannot_open", "nowhere.csv"),
        ({"time_s": [0.0, 1.0], "force_n": [0.0, 1.0]}, "cannot_read", "position"),
        ({"time_s": [0.0], "position_m": ["a"], "force_n": [0.0]}, "cannot_read", "text"),
        ({"time_s": [0.0, 1.0], "position_m": [0.0], "force_n": [0.0, 1.0]}, "cannot_read", ""),
        (7, "cannot_read", "data frame"),
    ],
    ids=["no file", "no position", "text", "lengths", "no recording"],
)
def test_whatever_is_wrong_is_a_row(recording: Any, kind: str, words: str) -> None:
    row = fleet.identify_one(recording, name="given")
    assert (row["status"], row["reason_kind"]) == ("failed", kind)
    assert words in row["reason"]
    assert row["coulomb_force_n"] is None
    assert row["config"] == fleet.Config().hash_text()


def test_a_wrong_configuration_is_an_exception() -> None:
    with pytest.raises(trocar.ParameterError, match="quick, full"):
        fleet.Config(depth="deep")
    with pytest.raises(trocar.ParameterError, match="moving_mass_kg"):
        fleet.Config(moving_mass_kg=-1.0)


def test_function_and_configuration_can_be_sent(strokes: list[trocar.Recording]) -> None:
    call, config = pickle.loads(pickle.dumps((fleet.identify_one, fleet.Config(seed=3))))
    assert call(frame(strokes[0]), config) == fleet.identify_one(frame(strokes[0]), fleet.Config(seed=3))


def test_the_engine_is_not_imported_before_it_is_used() -> None:
    code = "import sys, trocar.fleet; print([m for m in ('dask', 'distributed', 'pyarrow') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout == "[]\n"


# A data set.


def test_the_table_holds_the_rows(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "table.parquet"
    outcome = fleet.identify_dataset(folder, out, engine="serial")
    rows = table(out)
    assert (outcome.recordings, len(rows), [name for name, _ in outcome.failed]) == (
        RECORDINGS + 1,
        RECORDINGS + 1,
        ["lubricant=dry/notes.csv"],
    )
    assert {row["lubricant"] for row in rows} == {"dry", "wet"}
    for row in rows:
        alone = fleet.identify_one(row["path"])
        assert {name: row[name] for name in alone} == alone
    assert os.listdir(tmp_path) == ["table.parquet"]


def test_a_manifest_and_groups_of_rows_give_the_same_numbers(
    folder: Path, strokes: list[trocar.Recording], tmp_path: Path
) -> None:
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed (requirements-dask.txt)")
    parquet = pytest.importorskip("pyarrow.parquet")
    parts = [arrow.table({"trial": [n] * len(r), **frame(r)}) for n, r in enumerate(strokes[:3])]
    inner = tmp_path / "groups" / "site=a"
    inner.mkdir(parents=True)
    # The second recording lies across two files.
    half = len(strokes[1]) // 2
    parquet.write_table(arrow.concat_tables([parts[0], parts[1][:half]]), inner / "part-0.parquet")
    parquet.write_table(arrow.concat_tables([parts[1][half:], parts[2]]), inner / "part-1.parquet")
    fleet.identify_dataset(tmp_path / "groups", tmp_path / "of_groups.parquet", group="trial", engine="serial")
    of_groups = table(tmp_path / "of_groups.parquet")
    manifest = tmp_path / "manifest.csv"
    lines = [f"{folder / f'lubricant={lubricant}' / f'{n}.csv'},{n}\n" for n, lubricant in enumerate(["wet", "dry", "wet"])]
    manifest.write_text("path,insertions\n" + "".join(lines))
    fleet.identify_dataset(manifest, tmp_path / "of_manifest.parquet", engine="serial")
    of_manifest = sorted(table(tmp_path / "of_manifest.parquet"), key=lambda row: str(row["insertions"]))
    assert [row["path"] for row in of_groups] == ["site=a/0", "site=a/1", "site=a/2"]
    for a, b in zip(of_groups, of_manifest):
        differ = {name for name in fleet.columns() if a[name] != b[name]}
        assert differ <= {"path", "recording", "sha256"}


def test_an_interrupted_run_goes_on(folder: Path, tmp_path: Path) -> None:
    def interrupt(done: int, of: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    whole, out = tmp_path / "whole.parquet", tmp_path / "table.parquet"
    fleet.identify_dataset(folder, whole, engine="serial")
    with pytest.raises(KeyboardInterrupt):
        fleet.identify_dataset(folder, out, engine="serial", progress=interrupt)
    assert not out.exists()
    partial = tmp_path / "table.parquet.partial"
    with open(partial, "a") as file:
        file.write(json.dumps(["torn"])[:-2])
    other = fleet.Config(seed=2)
    with pytest.raises(KeyboardInterrupt):
        fleet.identify_dataset(folder, out, engine="serial", config=other, progress=interrupt)
    assert fleet.identify_dataset(folder, out, engine="serial").taken_over == 3
    assert out.read_bytes() == whole.read_bytes()
    assert not partial.exists()


def test_wrong_data_sets_are_refused(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "table.parquet"
    with pytest.raises(trocar.ParameterError, match="dask or serial"):
        fleet.identify_dataset(folder, out, engine="spark")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        fleet.identify_dataset(tmp_path / "nowhere", out, engine="serial")
    with pytest.raises(trocar.ParameterError, match="no recording"):
        fleet.identify_dataset(tmp_path, out, engine="serial")
    one = folder / "lubricant=wet" / "0.csv"
    with pytest.raises(trocar.ParameterError, match="more than once"):
        fleet.identify_dataset([one, one], out, engine="serial")
    (tmp_path / "manifest.csv").write_text(f"path,status\n{one},good\n")
    with pytest.raises(trocar.ParameterError, match="column status"):
        fleet.identify_dataset(tmp_path / "manifest.csv", out, engine="serial")
    assert not out.exists()


# On Dask.


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="distributed is not installed (requirements-dask.txt)")
    dask = pytest.importorskip("dask")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    # A recording may kill two workers in company and two by itself; by default it is four and four.
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}), distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        yield client


def test_a_killed_worker_changes_nothing(folder: Path, tmp_path: Path, client: Any) -> None:
    undisturbed, out = tmp_path / "undisturbed.parquet", tmp_path / "table.parquet"
    fleet.identify_dataset(folder, undisturbed, client=client)
    killed: list[int] = []

    def kill(done: int, of: int) -> None:
        if done == 2:
            # Both are at work: more is in flight than they can do.
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    seen = fleet.identify_dataset(folder, out, client=client, progress=kill)
    assert killed and seen.recordings == RECORDINGS + 1
    assert killed[0] not in client.run(os.getpid).values()
    assert out.read_bytes() == undisturbed.read_bytes()
    alone = tmp_path / "serial.parquet"
    fleet.identify_dataset(folder, alone, engine="serial")
    assert out.read_bytes() == alone.read_bytes()


def test_a_recording_that_kills_its_workers_is_a_row(folder: Path, client: Any) -> None:
    # Within this function it travels by value: workers need not find the tests.
    def fatal_on_notes(unit: Any, config: Any) -> Any:
        if unit.name.endswith("notes.csv"):
            os.kill(os.getpid(), signal.SIGKILL)
        return fleet._work(unit, config)

    units = sorted(fleet._units(folder, None), key=lambda unit: unit.name)
    config = fleet.Config()
    rows = dict(fleet._dask(units, range(len(units)), config, client, None, fatal_on_notes))
    assert sorted(rows) == list(range(len(units)))
    for index, unit in enumerate(units):
        if unit.name.endswith("notes.csv"):
            assert (rows[index]["status"], rows[index]["reason_kind"]) == ("failed", "worker_died")
        else:
            assert rows[index] == fleet._work(unit, config)
