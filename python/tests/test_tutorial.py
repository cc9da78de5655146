"""The tutorial runs from the first to the last cell."""

from __future__ import annotations

import nbformat
from nbclient import NotebookClient

from .conftest import ROOT

TUTORIAL = ROOT / "docs" / "tutorial.ipynb"


def test_the_tutorial_runs() -> None:
    notebook = nbformat.read(TUTORIAL, as_version=4)
    nbformat.validate(notebook)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in cells), "strip the outputs before committing"
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    shown = [output for cell in cells for output in cell.outputs]
    html = "".join(output.data.get("text/html", "") for output in shown if output.output_type != "stream")
    # The page contains the figures of identification, validation and comparison.
    assert html.count("data:image/svg+xml;base64,") == 5
    assert not [output for output in shown if output.get("name") == "stderr"]
