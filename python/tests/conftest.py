"""Fixtures: recordings of the virtual bench and their identification, computed once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import trocar

ROOT = Path(__file__).resolve().parents[2]
CONFORMANCE = ROOT / "conformance"

#: Mass of the bench's rod, as in its configuration.
ROD_KG = 0.04


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Appends the reason of each skip to the file that TROCAR_SKIPPED names: ./test lists them at its end."""
    if "TROCAR_SKIPPED" in os.environ:
        with open(os.environ["TROCAR_SKIPPED"], "a") as skipped:
            for report in terminalreporter.getreports("skipped"):
                print(f"skipped: {report.nodeid}: {report.longrepr[2]}", file=skipped)


@pytest.fixture(scope="session")
def model() -> trocar.Model:
    return trocar.Model.plausible()


@pytest.fixture(scope="session")
def training() -> list[trocar.Recording]:
    return [trocar.bench("steady"), trocar.bench("dynamic")]


@pytest.fixture(scope="session")
def held_out() -> list[trocar.Recording]:
    return [trocar.bench("validation"), trocar.bench("surgeon")]


@pytest.fixture(scope="session")
def found(training: list[trocar.Recording], held_out: list[trocar.Recording]) -> trocar.Identification:
    return trocar.identify(training, validate=held_out, moving_mass_kg=ROD_KG)
