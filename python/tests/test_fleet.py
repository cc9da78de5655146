"""Many recordings into one table: a row also after errors, and the same table from every engine, also when workers are killed."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars
import pytest

import trocar
from trocar import _core, fleet

#: A recording of some thousand samples with three speeds.
SHORT = "[protocol.steady]\nincrement_m_s = 0.04\nstroke_m = 0.06\n"
RECORDINGS = 8


@pytest.fixture(scope="module")
def strokes() -> list[trocar.Recording]:
    return [trocar.bench("steady", seed=seed, config=SHORT) for seed in range(1, RECORDINGS + 1)]


def frame(recording: trocar.Recording) -> dict[str, Any]:
    return {"time_s": recording.time_s, "position_m": recording.position_m, "force_n": recording.force_n}


@pytest.fixture(scope="module")
def folder(strokes: list[trocar.Recording], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files in folders named after their contents; one file is not a recording."""
    root = tmp_path_factory.mktemp("dataset")
    for number, recording in enumerate(strokes):
        inner = root / f"lubricant={'dry' if number % 2 else 'wet'}"
        inner.mkdir(exist_ok=True)
        recording.save(inner / f"{number}.csv")
    (root / "lubricant=dry" / "notes.csv").write_text("time_s,position_m,force_n\n0,zero,0\n")
    return root


def table(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = polars.read_parquet(path).to_dicts()
    return rows


# One recording.


def test_a_row_is_the_identification(strokes: list[trocar.Recording]) -> None:
    found = trocar.identify(strokes[0], free_motion=False, seed=1).parameters["coulomb_force_n"]
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
    assert differ <= {"warnings", "path", "recording", "sha256"}


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
    with pytest.raises(trocar.ParameterError, match="quick.*full"):
        fleet.Config(depth="deep")
    with pytest.raises(trocar.ParameterError, match="moving_mass_kg"):
        fleet.Config(moving_mass_kg=-1.0)
    with pytest.raises(trocar.ParameterError, match="without a moving mass"):
        fleet.Config(gravity_m_s2=-9.81)


def test_columns_are_a_text_or_a_dictionary(strokes: list[trocar.Recording], tmp_path: Path) -> None:
    mapped = fleet.Config(columns={"position_mm": "pos", "force_n": "-fz"})
    assert mapped == fleet.Config(columns="position_mm=pos,force_n=-fz") and hash(mapped)
    time, position, force = frame(strokes[0]).values()
    renamed = {"time_s": time, "pos": 1e3 * position, "fz": -force}
    row, plain = fleet.identify_one(renamed, mapped), fleet.identify_one(frame(strokes[0]))
    assert row["status"] == "ok" and row["config"] == mapped.hash_text() != plain["config"]
    assert row["coulomb_force_n"] == pytest.approx(plain["coulomb_force_n"], rel=1e-6)
    polars.DataFrame(renamed).write_csv(tmp_path / "renamed.csv")
    of_file = fleet.identify_one(tmp_path / "renamed.csv", mapped)
    assert of_file["coulomb_force_n"] == pytest.approx(row["coulomb_force_n"], rel=1e-6)
    with pytest.raises(trocar.ParameterError, match="columns maps our names"):
        fleet.Config(columns={"pos": "position_mm"})
    with pytest.raises(TypeError, match="a text or a dictionary of texts"):
        fleet.Config(columns=["pos"])  # type: ignore[arg-type]


def test_function_and_configuration_can_be_sent(strokes: list[trocar.Recording]) -> None:
    call, config = pickle.loads(pickle.dumps((fleet.identify_one, fleet.Config(seed=3))))
    assert call(frame(strokes[0]), config) == fleet.identify_one(frame(strokes[0]), fleet.Config(seed=3))


def test_the_engine_is_not_imported_before_it_is_used() -> None:
    code = "import sys, trocar.fleet; print([m for m in ('dask', 'distributed') if m in sys.modules])"
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
        alone = fleet.identify_one(folder / row["path"])
        differ = {name for name in alone if alone[name] != row[name]}
        # The path is relative to the data set, also in the reason.
        assert differ <= ({"path", "reason"} if row["status"] == "failed" else {"path"})
    assert os.listdir(tmp_path) == ["table.parquet"]


@pytest.mark.skipif("TROCAR_PROGRAM" not in os.environ, reason="TROCAR_PROGRAM names no command line")
def test_the_table_is_that_of_the_command_line(folder: Path, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.parquet", tmp_path / "theirs.parquet"
    fleet.identify_dataset(folder, ours, engine="serial")
    command = [os.environ["TROCAR_PROGRAM"], "--quiet", "fleet", str(folder), "--out", str(theirs)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if "unrecognized subcommand" in done.stderr:
        pytest.skip("the command line has no verb fleet yet")
    # Exit code 3: one recording failed.
    assert done.returncode == 3, done.stderr
    assert ours.read_bytes() == theirs.read_bytes()


def test_a_manifest_gives_the_numbers_of_its_files(folder: Path, tmp_path: Path) -> None:
    manifest = tmp_path / "manifest.csv"
    paths = [folder / f"lubricant={lubricant}" / f"{n}.csv" for n, lubricant in enumerate(["wet", "dry", "wet"])]
    manifest.write_text("path,insertions\n" + "".join(f"{path},{n}\n" for n, path in enumerate(paths)))
    fleet.identify_dataset(manifest, tmp_path / "table.parquet", engine="serial")
    rows = table(tmp_path / "table.parquet")
    assert [row["insertions"] for row in rows] == [0, 1, 2]
    for row, path in zip(rows, paths):
        alone = fleet.identify_one(path)
        assert {name for name in alone if alone[name] != row[name]} <= {"path"}


def test_an_interrupted_run_goes_on(folder: Path, tmp_path: Path) -> None:
    def interrupt(done: int, of: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    whole, out = tmp_path / "whole.parquet", tmp_path / "table.parquet"
    fleet.identify_dataset(folder, whole, engine="serial")
    with pytest.raises(KeyboardInterrupt):
        fleet.identify_dataset(folder, out, engine="serial", progress=interrupt)
    assert not out.exists()
    journal = tmp_path / "table.parquet.journal"
    with open(journal, "a") as file:
        file.write('{"name": "torn')
    assert fleet.identify_dataset(folder, out, engine="serial").reused == 3
    assert out.read_bytes() == whole.read_bytes()
    assert not journal.exists()


def test_wrong_data_sets_are_refused(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "table.parquet"
    with pytest.raises(trocar.ParameterError, match="dask or serial"):
        fleet.identify_dataset(folder, out, engine="spark")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        fleet.identify_dataset(tmp_path / "nowhere", out, engine="serial")
    (tmp_path / "empty").mkdir()
    with pytest.raises(trocar.ParameterError, match="no recordings"):
        fleet.identify_dataset(tmp_path / "empty", out, engine="serial")
    one = folder / "lubricant=wet" / "0.csv"
    (tmp_path / "manifest.csv").write_text(f"path,site\n{one},a\n{one},b\n")
    with pytest.raises(trocar.ParameterError, match="already in row 1"):
        fleet.identify_dataset(tmp_path / "manifest.csv", out, engine="serial")
    assert not out.exists()


# On Dask.


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="distributed is not installed (requirements-dask.txt)")
    dask = pytest.importorskip("dask")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    # A recording may kill two workers together with other files and two alone; the default is four and four.
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}), distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        yield client


def test_the_example_runs(folder: Path) -> None:
    pytest.importorskip("distributed")
    example = Path(__file__).parents[1] / "examples" / "cluster.py"
    done = subprocess.run([sys.executable, str(example), str(folder)], capture_output=True, text=True, timeout=120, check=True)
    lines = done.stdout.splitlines()
    assert lines[0] == f"{RECORDINGS + 1} recordings, 2 workers: {RECORDINGS} ok, 0 doubtful, 1 failed"
    assert len(lines) == RECORDINGS + 2


def test_a_killed_worker_changes_nothing(folder: Path, tmp_path: Path, client: Any) -> None:
    undisturbed, out = tmp_path / "undisturbed.parquet", tmp_path / "table.parquet"
    fleet.identify_dataset(folder, undisturbed, client=client)
    killed: list[int] = []

    def kill(done: int, of: int) -> None:
        if done == 2:
            # Both workers are busy: more files are submitted than they can process.
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    seen = fleet.identify_dataset(folder, out, client=client, progress=kill)
    assert killed and seen.recordings == RECORDINGS + 1
    assert killed[0] not in client.run(os.getpid).values()
    assert out.read_bytes() == undisturbed.read_bytes()
    alone = tmp_path / "serial.parquet"
    fleet.identify_dataset(folder, alone, engine="serial")
    assert out.read_bytes() == alone.read_bytes()


def test_a_file_that_kills_its_workers_is_given_up(folder: Path, tmp_path: Path, client: Any) -> None:
    # A local function is pickled by value, so workers need not import the tests.
    def fatal_on_notes(order: str, config: fleet.Config) -> str:
        if "notes.csv" in order:
            os.kill(os.getpid(), signal.SIGKILL)
        return fleet._work(order, config)

    orders = _core.FleetTable(folder, tmp_path / "table.parquet", fleet._native(fleet.Config())).orders()
    parts = dict(fleet._dask(orders, fleet.Config(), client, None, fatal_on_notes))
    assert sorted(parts) == list(range(len(orders)))
    for source, order in enumerate(orders):
        if "notes.csv" in order:
            assert parts[source] is None
        else:
            assert parts[source] == fleet._work(order, fleet.Config())


def test_a_file_that_was_given_up_is_a_row(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "table.parquet"
    table_ = _core.FleetTable(folder, out, fleet._native(fleet.Config()))
    for source, order in enumerate(table_.orders()):
        if source == 0:
            table_.lose(source, "worker_died", "it died")
        else:
            # Rows added twice count once.
            assert table_.add(source, fleet._work(order, fleet.Config())) == table_.add(source, "null")
    table_.write()
    rows = table(out)
    assert [(row["status"], row["reason_kind"]) for row in rows][0] == ("failed", "worker_died")
    assert len(rows) == RECORDINGS + 1
