"""Exports give the files of the command line."""

from __future__ import annotations

import os
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

import trocar

from .conftest import CONFORMANCE

MODELS = [CONFORMANCE / "models" / name for name in ("gms.json", "lugre.json")]


def program(*arguments: object) -> str:
    command = os.environ.get("TROCAR_PROGRAM")
    if command is None:
        pytest.skip(
            "TROCAR_PROGRAM does not name the command line; crates/trocar-py/check builds and names it"
        )
    line = [command, "export", *map(str, arguments), "--quiet"]
    return subprocess.run(line, check=True, capture_output=True, text=True).stdout


def parts(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_c_is_that_of_the_command_line(path: Path, tmp_path: Path) -> None:
    model = trocar.Model.load(path)
    model.save(tmp_path / "model.json")
    for precision, number in (("double", "double"), ("single", "float")):
        for folder in ("python", "command"):
            (tmp_path / folder).mkdir(exist_ok=True)
        model.export_c(tmp_path / "python" / "seal.c", prefix="seal", precision=precision)
        out = tmp_path / "command" / "seal.c"
        options = ("--name", "seal", "--precision", precision)
        program("c", tmp_path / "model.json", "--out", out, *options)
        for name in ("seal.c", "seal.h"):
            text = (tmp_path / "python" / name).read_text()
            assert text == (tmp_path / "command" / name).read_text()
            assert f"{number} seal_step(" in text
    with pytest.raises(trocar.ParameterError, match="the prefix of C names must be .* got '1'"):
        model.export_c(tmp_path / "none.c", prefix="1")
    with pytest.raises(trocar.ParameterError, match="must be named NAME.c"):
        model.export_c(tmp_path / "none.txt")
    with pytest.raises(trocar.ParameterError, match='precision "half": expected double or single'):
        model.export_c(tmp_path / "none.c", precision="half")  # type: ignore[arg-type]
    assert not (tmp_path / "none.c").exists() and not (tmp_path / "none.h").exists()


def test_values_are_those_of_the_command_line(tmp_path: Path) -> None:
    model = trocar.Model.load(MODELS[1])
    time_s = np.linspace(0.0, 4.0, 4001)
    position_m = 0.03 * np.sin(3.0 * time_s)
    force_n = trocar.simulate(model, time_s, position_m)
    recording = trocar.Recording(time_s, position_m, force_n, name="s.csv")
    columns = np.column_stack([time_s, position_m, force_n])
    names = "time_s,position_m,force_n"
    np.savetxt(tmp_path / "s.csv", columns, "%.17g", ",", header=names, comments="")
    for target in ("mujoco", "isaac", "urdf", "sdf", "ur", "simulink", "json"):
        own = model.export_values(target, validate=[recording])  # type: ignore[arg-type]
        options = ("--for", target, "--validate", tmp_path / "s.csv")
        assert own == program("values", MODELS[1], *options)
    assert "N rms on s.csv" in model.export_values("urdf", validate=[recording])
    with pytest.raises(trocar.ParameterError, match="no program .*: expected one of mujoco"):
        model.export_values("bullet")  # type: ignore[arg-type]


def test_an_fmu_is_that_of_the_command_line(model: trocar.Model, tmp_path: Path) -> None:
    model.save(tmp_path / "model.json")
    for fmi, input_ in ((2, "position"), (3, "velocity")):
        model.export_fmu(tmp_path / "python.fmu", fmi=fmi, input=input_)
        program(
            "fmu",
            tmp_path / "model.json",
            "--out",
            tmp_path / "command.fmu",
            "--fmi",
            fmi,
            "--input",
            input_,
        )
        own, other = parts(tmp_path / "python.fmu"), parts(tmp_path / "command.fmu")
        assert own.keys() == other.keys()
        assert all(own[name] == other[name] for name in own if not name.startswith("binaries/"))
        assert all(
            len(own[name]) > 100_000 for name in own if name.startswith("binaries/") and "." in name
        )
        model.export_fmu(tmp_path / "source.fmu", fmi=fmi, source=True)
        source = parts(tmp_path / "source.fmu")
        assert f"sources/fmi{fmi}.c" in source and b"seal_step(" in source["sources/seal.c"]
        assert not any(name.startswith("binaries/") for name in source)
    with pytest.raises(trocar.ParameterError, match="fmi must be 2 or 3, got 1"):
        model.export_fmu(tmp_path / "none.fmu", fmi=1)  # type: ignore[arg-type]
    with pytest.raises(trocar.ParameterError, match='input "force": expected position or velocity'):
        model.export_fmu(tmp_path / "none.fmu", input="force")  # type: ignore[arg-type]
    with pytest.raises(trocar.ParameterError, match='no platform "beos"'):
        model.export_fmu(tmp_path / "none.fmu", platforms=["beos"])
    with pytest.raises(trocar.TrocarError, match="contains no FMU library for x86-windows, only for"):
        model.export_fmu(tmp_path / "none.fmu", platforms=["x86-windows"])
    assert not (tmp_path / "none.fmu").exists()
    with pytest.raises(FileNotFoundError):
        model.export_fmu(tmp_path / "no such folder" / "model.fmu")


def test_models_come_back_from_dictionaries() -> None:
    for path in sorted(CONFORMANCE.glob("models/*.json")):
        model = trocar.Model.load(path)
        assert trocar.Model.from_dict(model.to_dict()) == model
    plausible = trocar.Model.plausible()
    values = plausible.to_dict()
    (element,) = values["elements"]
    for direction, damping in (("insertion", np.float64(7)), ("withdrawal", np.int64(7))):
        element[direction]["viscous_damping_n_s_m"] = damping
    changed = trocar.Model.from_dict(values)
    assert {t.value for t in changed.tunables if "viscous_damping" in t.name} == {7.0}
    with pytest.raises(trocar.ModelFileError):
        trocar.Model.from_dict({"version": 1})
    with pytest.raises(trocar.ParameterError, match="numbers must be finite"):
        trocar.Model.from_dict({**values, "version": np.nan})
    with pytest.raises(TypeError, match="expected a dictionary, got str"):
        trocar.Model.from_dict("model.json")  # type: ignore[arg-type]
