"""The notebooks run from the first to the last cell."""

from __future__ import annotations

import re
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from .conftest import ROOT


def outputs(name: str) -> list[Any]:
    """What the cells of a notebook show."""
    notebook = nbformat.read(ROOT / "docs" / "tutorials" / name, as_version=4)
    nbformat.validate(notebook)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in cells), "strip the outputs before committing"
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    return [output for cell in cells for output in cell.outputs]


def page(shown: list[Any]) -> str:
    return "".join(output.data.get("text/html", "") for output in shown if output.output_type != "stream")


@pytest.fixture(scope="module")
def teleoperation() -> list[Any]:
    return outputs("teleoperation.ipynb")


def test_the_tutorial_runs() -> None:
    shown = outputs("tutorial.ipynb")
    # The page contains the figures of identification, validation and comparison.
    assert page(shown).count("data:image/svg+xml;base64,") == 5
    assert not [output for output in shown if output.get("name") == "stderr"]


def test_the_notebook_of_teleoperation_runs(teleoperation: list[Any]) -> None:
    pictures = [output for output in teleoperation if "image/png" in output.get("data", {})]
    assert len(pictures) == 6
    assert "Compensate" in page(teleoperation)
    assert not [output for output in teleoperation if output.get("name") == "stderr"]


def test_the_notebook_of_teleoperation_concludes_what_it_shows(teleoperation: list[Any]) -> None:
    (printed,) = (output.text for output in teleoperation if output.output_type == "stream" and "at 100 %" in output.text)
    row = r"([\d.]+) N: without compensation ([\w.]+), stable (\d+) to 140 %, at 100 % ([\d.]+)"
    rows = re.findall(row, printed)
    near, far = rows[:6], rows[6:]
    assert [force for force, *_ in near] == [force for force, *_ in far] == ["0.25", "0.5", "1", "2", "4", "8"]
    softer = [float(without) for _, without, *_ in near[:5]]
    assert 0.715 < min(softer) < 0.725 and max(softer) < 0.9
    assert 3.9 < float(near[5][1]) < 4.2
    assert all(abs(float(ratio) - 1) < 0.01 for *_, ratio in near)
    assert all(without == "unstable" for _, without, *_ in far)
    least = [int(percent) for _, _, percent, _ in far]
    assert (min(least), max(least)) == (10, 50)
