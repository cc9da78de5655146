"""Every public function and class has an example in its docstring, and it gives what it says; all results have a display."""

from __future__ import annotations

import doctest
import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trocar
from trocar import fleet

from .conftest import ROD_KG


def public() -> dict[str, Any]:
    found = {name: getattr(trocar, name) for name in trocar.__all__} | {name: getattr(fleet, name) for name in fleet.__all__}
    return {name: own for name, own in found.items() if callable(own) and not (inspect.isclass(own) and issubclass(own, Exception))}


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    recording, checks = trocar.bench("steady"), trocar.bench("validation")
    found = trocar.identify(recording, validate=checks, moving_mass_kg=ROD_KG)
    own = {"trocar": trocar, "fleet": fleet, "np": np, "model": trocar.Model.plausible()}
    return {**own, "recording": recording, "checks": checks, "found": found}


@pytest.mark.parametrize("name", sorted(public()))
def test_an_example_gives_what_it_says(name: str, names: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recording = names["recording"]
    (tmp_path / "recordings").mkdir()
    for file in ("strokes.csv", "recordings/one.csv"):
        rows = np.column_stack([recording.time_s, recording.position_m, recording.force_n])
        np.savetxt(file, rows, delimiter=",", header="time_s,position_m,force_n", comments="")
    test = doctest.DocTestParser().get_doctest(inspect.getdoc(public()[name]) or "", dict(names), name, None, 0)
    assert test.examples, f"{name} has no example"
    said: list[str] = []
    assert doctest.DocTestRunner().run(test, out=said.append).failed == 0, "".join(said)


def test_every_result_has_a_display(names: dict[str, Any]) -> None:
    engines = {"Stepper", "Compensator"}
    results = [own for name, own in public().items() if inspect.isclass(own) and name not in engines]
    assert len(results) > 25
    assert not [own.__name__ for own in results if not hasattr(own, "_repr_html_")]
    found = names["found"]
    assert "_theta" not in found.validation.recordings[0]._repr_html_()
    for shown in (found.params["F_c"], found.covariance, found.warnings[0], trocar.compensate(found.model, names["checks"]).drift):
        page = shown._repr_html_()
        assert page.count("<table>") == 1 and "object at" not in page


def test_symbols_are_names_and_a_slip_is_hinted_at(names: dict[str, Any]) -> None:
    params = names["found"].params
    assert params["F_c"] is params["coulomb_force_n"] and params["beta"] is params["β"] and params["c"].unit == "m"
    with pytest.raises(KeyError, match="did you mean 'coulomb_force_n'"):
        params["coulomb_force"]
    model = names["model"]
    both = {"insertion_viscous_damping_n_s_m": 7.0, "withdrawal_viscous_damping_n_s_m": 7.0}
    assert model.tuned(beta=7.0) == model.tuned(viscous_damping_n_s_m=7.0) == model.tuned(**both)
    with pytest.raises(trocar.ParameterError, match="did you mean insertion_coulomb_force_n"):
        model.tuned(coulomb_force=3.0)
    coefficients = [own.is_coefficient for own in params.values()]
    assert coefficients == sorted(coefficients), "the main ones first"
