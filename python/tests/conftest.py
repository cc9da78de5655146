"""Fixtures: recordings of the virtual bench and their identification, computed once."""

from __future__ import annotations

from pathlib import Path

import pytest

import trocar

ROOT = Path(__file__).resolve().parents[2]
CONFORMANCE = ROOT / "conformance"

#: Mass of the bench's rod, as in its configuration.
ROD_KG = 0.04


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
