"""Sweeps from a file, a text or a dictionary give the rows and bytes of the command line; invalid input is rejected."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import polars
import pytest

import trocar

from .conftest import ROOT

DOCUMENT = """\
runs = 40
seed = 5
[motion]
protocol = "step"
[seal]
half_width_m = { uniform = [0.8, 1.2], relative = true }
insertion_coulomb_force_n = { grid = [2.5, 3.5] }
withdrawal_viscous_damping_n_s_m = 4
"""

#: The same document as a dictionary.
KEYS: dict[str, Any] = {
    "runs": np.int64(40),
    "seed": 5,
    "motion": {"protocol": "step"},
    "seal": {
        "half_width_m": {"uniform": (0.8, 1.2), "relative": True},
        "insertion_coulomb_force_n": {"grid": np.array([2.5, 3.5])},
        "withdrawal_viscous_damping_n_s_m": 4,
    },
}

#: A document in which some draws do not give a valid model.
DOUBTFUL = 'runs = 20\n[motion]\nprotocol = "step"\n[seal]\nhalf_width_m = { uniform = [-0.005, 0.005] }\n'

RIG = 'runs = 3\n[motion]\nprotocol = "step"\n[rig]\n"rod.mass_kg" = { grid = [0.02, 0.2] }\n'


def command(folder: Path, document: str, out: str, code: int = 0) -> bytes:
    """The table that the command line writes for a document."""
    program = os.environ.get("TROCAR_PROGRAM")
    if program is None:
        pytest.skip("TROCAR_PROGRAM names no command line")
    (folder / "theirs.toml").write_text(document)
    run = [program, "--quiet", "sweep", "theirs.toml", "--out", f"theirs.{out}"]
    done = subprocess.run(run, check=False, capture_output=True, text=True, cwd=folder)
    assert done.returncode == code, done.stderr
    return (folder / f"theirs.{out}").read_bytes()


@pytest.mark.parametrize("extension", ["parquet", "csv", "arrow", "csv.zst"])
@pytest.mark.parametrize(("document", "code"), [(DOCUMENT, 0), (DOUBTFUL, 3), (RIG, 0)], ids=["seals", "failures", "rigs"])
def test_the_table_is_that_of_the_command_line(document: str, code: int, extension: str, tmp_path: Path) -> None:
    done = trocar.sweep(document, out=tmp_path / f"ours.{extension}", threads=3)
    assert (tmp_path / f"ours.{extension}").read_bytes() == command(tmp_path, document, extension, code)
    assert done.is_doubtful == (code == 3) and done.path == tmp_path / f"ours.{extension}"


def test_a_seed_takes_the_place_of_that_of_the_document(tmp_path: Path) -> None:
    trocar.sweep(DOCUMENT, out=tmp_path / "ours.parquet", seed=9)
    theirs = command(tmp_path, DOCUMENT.replace("seed = 5", "seed = 9"), "parquet")
    assert (tmp_path / "ours.parquet").read_bytes() == theirs


def test_memory_and_file_hold_the_same(tmp_path: Path) -> None:
    table = trocar.sweep(DOUBTFUL)
    trocar.sweep(DOUBTFUL, out=tmp_path / "table.parquet")
    written = polars.read_parquet(tmp_path / "table.parquet")
    columns = table.columns()
    assert list(columns) == written.columns and len(table) == len(written) == 20
    failures = columns.pop("failure").tolist()
    assert failures == written["failure"].to_list()
    for name, cells in columns.items():
        # Missing numbers are nan in the table and null in the file.
        assert np.array_equal(cells, written[name].fill_null(np.nan).to_numpy(), equal_nan=True), name
    assert table.failed == sum(why is not None for why in failures) > 0
    assert table.first_failure is not None and "half_width_m must be finite and above 0 m" in table.first_failure
    assert columns["seed"].dtype == columns["run"].dtype == np.int64
    assert pandas.DataFrame(table.columns()).shape == polars.DataFrame(table.columns()).shape == written.shape
    assert "20 runs, " in repr(table) and "peak_force_n" in table._repr_html_()


def test_a_file_a_text_and_a_dictionary_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "sweep.toml").write_text(DOCUMENT)
    tables = [trocar.sweep(config) for config in (DOCUMENT, KEYS, tmp_path / "sweep.toml", str(tmp_path / "sweep.toml"))]
    for table in tables:
        assert len(table) == 80 and table.failed == 0
        for name, cells in tables[0].columns().items():
            assert np.array_equal(cells, table[name], equal_nan=name != "failure")


def test_threads_change_nothing() -> None:
    one, three = (trocar.sweep(DOCUMENT, threads=threads).columns() for threads in (1, 3))
    assert all(np.array_equal(one[name], three[name], equal_nan=name != "failure") for name in one)


def test_files_are_sought_beside_the_document(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = trocar.Model.plausible().tuned(half_width_m=5e-3)
    model.save(tmp_path / "model.json")
    (tmp_path / "sweep.toml").write_text('model = "model.json"\n' + DOCUMENT)
    beside = trocar.sweep(tmp_path / "sweep.toml")
    monkeypatch.chdir(tmp_path)
    for config in ({**KEYS, "model": Path("model.json")}, {**KEYS, "model": model}, 'model = "model.json"\n' + DOCUMENT):
        assert np.array_equal(trocar.sweep(config)["peak_force_n"], beside["peak_force_n"])
    assert np.median(beside["half_width_m"]) == pytest.approx(5e-3, rel=0.1)


def test_a_row_is_what_simulate_gives(tmp_path: Path) -> None:
    model, strokes = trocar.Model.plausible(), trocar.bench("step")
    strokes.save(tmp_path / "strokes.csv")
    seal = {"half_width_m": {"list": [7e-3, 8e-3]}}
    keys = {"runs": 10, "motion": {"file": tmp_path / "strokes.csv"}, "seal": seal}
    table = trocar.sweep(keys, traces=tmp_path / "traces")
    for run in range(10):
        trace = polars.read_parquet(tmp_path / "traces" / f"run_{run:09}.parquet")
        own = model.tuned(half_width_m=table["half_width_m"][run])
        time, position = trace["time_s"].to_numpy(), trace["position_m"].to_numpy()
        force = trocar.simulate(own, time, position, initial_force_n=0.0)
        assert np.array_equal(force, trace["force_n"].to_numpy())
        assert table["peak_force_n"][run] == np.abs(force).max()


def test_progress_is_reported() -> None:
    reported: list[tuple[str, float]] = []
    # Progress is reported every 50 ms and after each 256 rows of a thread; the whole sweep takes some hundreds of milliseconds.
    document = DOCUMENT.replace("runs = 40", "runs = 2000").replace("step", "validation")
    trocar.sweep(document, threads=1, progress=lambda *news: reported.append(news))
    parts = [part for _, part in reported]
    assert parts == sorted(parts) and all(0 < part <= 1 for part in parts)
    assert {stage for stage, _ in reported} == {"sweep"}, "a sweep reports its progress"


def test_the_printed_example_is_a_document() -> None:
    text = trocar.sweep_config()
    assert len(trocar.sweep(text.replace("runs = 1000", "runs = 3"))) == 3
    if "TROCAR_PROGRAM" in os.environ:
        command = [os.environ["TROCAR_PROGRAM"], "sweep", "--print-config"]
        assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == text


@pytest.mark.parametrize(
    ("config", "kind", "words"),
    [
        ("runs = \n", trocar.SweepError, "TOML parse error at line 1"),
        ("runs = \n", trocar.SweepError, "hint: trocar.sweep_config() gives an example with every key"),
        ("runs = 3\n", trocar.SweepError, "missing field `motion`"),
        (DOCUMENT.replace("half_width_m", "width"), trocar.SweepError, 'line 6: [seal] has no "width" for this model\n\nhint: it has half_width_m,'),
        (DOCUMENT.replace("[0.8, 1.2]", "[1.2, 0.8]"), trocar.SweepError, "line 6: half_width_m: expected the lower number first"),
        (RIG.replace("rod.mass_kg", "rod.mass"), trocar.SweepError, "line 5: [rig] has no number \"rod.mass\"\n\nhint: trocar.bench_config() gives"),
        (DOCUMENT.replace("step", "dance"), trocar.SweepError, "[motion]: "),
        ({**KEYS, "runs": 0}, trocar.SweepError, "runs must be 1 or more"),
        ({**KEYS, "seal": {"width": 3}}, trocar.SweepError, '[seal] has no "width" for this model'),
        ({**KEYS, "seal": {"half_width_m": {"uniform": [2, 1]}}}, trocar.SweepError, "half_width_m: expected the lower number first"),
        ({**KEYS, "seal": {"half_width_m": "wide"}}, trocar.SweepError, "expected a number or a form such as"),
        ({**KEYS, "seal": {"half_width_m": {"normal": [1, np.nan]}}}, trocar.SweepError, "config: numbers must be finite"),
        ({**KEYS, "sael": {}}, trocar.SweepError, "unknown field `sael`"),
        ({}, trocar.SweepError, "missing field `motion`"),
        ({**KEYS, "motion": {"file": "nowhere.csv"}}, FileNotFoundError, "nowhere.csv"),
        ({**KEYS, "model": "nowhere.json"}, FileNotFoundError, "nowhere.json"),
        ({**KEYS, "motion": {"protocol": "step", "rig": "nowhere.toml"}}, FileNotFoundError, "nowhere.toml"),
        ({**KEYS, "seal": {"half_width_m": {1, 2}}}, TypeError, "a number, text, list or dictionary is expected, got set"),
        ("nowhere.toml", FileNotFoundError, "nowhere.toml"),
        (7, TypeError, "config must be a path, a TOML text or a dictionary, got int"),
    ],
)
def test_what_cannot_be_swept_is_named(config: Any, kind: type, words: str, tmp_path: Path) -> None:
    out = tmp_path / "table.parquet"
    with pytest.raises(kind) as raised:
        trocar.sweep(config, out=out)
    assert words in str(raised.value)
    assert "line 0" not in str(raised.value)
    assert not list(tmp_path.iterdir())


def test_messages_name_the_file(tmp_path: Path) -> None:
    (tmp_path / "sweep.toml").write_text(DOCUMENT.replace("half_width_m", "width"))
    with pytest.raises(trocar.SweepError, match=r'sweep.toml: line 6: \[seal\] has no "width"'):
        trocar.sweep(tmp_path / "sweep.toml")


def test_a_table_in_a_file_is_not_in_memory(tmp_path: Path) -> None:
    table = trocar.sweep(DOCUMENT, out=tmp_path / "table.csv")
    assert len(table) == 80 and "table.csv" in repr(table) and "table.csv" in table._repr_html_()
    with pytest.raises(trocar.TrocarError, match="table.csv: read it from there"):
        table["peak_force_n"]
    with pytest.raises(KeyError, match="no column 'peak'; there are run, seed, "):
        trocar.sweep(DOCUMENT)["peak"]
    with pytest.raises(OSError, match="cannot create"):
        trocar.sweep(DOCUMENT, out=tmp_path / "no" / "table.csv")


def test_the_example_of_the_documentation_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "docs" / "reference" / "sweep.md").read_text().split("## From Python", 1)[1]
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(text.split("```python\n", 1)[1].split("```", 1)[0], names)
    assert len(names["table"]) == len(names["frame"]) == 1000
    assert (tmp_path / "table.parquet").exists()
