"""The type stubs match the module: same names and arguments; a user's script passes mypy."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import trocar
from trocar import _core

from .conftest import ROOT

STUB = Path(_core.__file__).with_name("_core.pyi")

#: Attributes that every class has, or that a stub cannot express.
INHERITED = {"__new__", "__doc__", "__module__", "__weakref__", "__dict__", "__repr__", "__ne__", "__lt__", "__le__"} | {
    "__gt__",
    "__ge__",
}


def stub() -> ast.Module:
    return ast.parse(STUB.read_text())


def arguments(function: ast.FunctionDef) -> list[tuple[str, bool, bool]]:
    """Name, whether keyword-only, whether it has a default; without self and cls."""
    a = function.args
    required = len(a.args) - len(a.defaults)
    found = [(arg.arg, False, i >= required) for i, arg in enumerate(a.args)]
    found += [(arg.arg, True, default is not None) for arg, default in zip(a.kwonlyargs, a.kw_defaults)]
    found += [(a.kwarg.arg, True, False)] if a.kwarg else []
    return [argument for argument in found if argument[0] not in ("self", "cls")]


def real_arguments(function: object) -> list[tuple[str, bool, bool]]:
    kinds = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD)
    found = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    named = [(p.name, p.kind in kinds, p.default is not p.empty) for p in found]
    return [argument for argument in named if argument[0] not in ("self", "cls")]


def test_the_stub_names_what_there_is() -> None:
    body = stub().body
    named = {node.name for node in body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    named |= {node.target.id for node in body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)}
    real = {name for name in dir(_core) if not name.startswith("_")} | {"__version__"}
    assert named == real


@pytest.mark.parametrize("node", [n for n in stub().body if isinstance(n, ast.FunctionDef)], ids=lambda n: n.name)
def test_functions_take_what_the_stub_says(node: ast.FunctionDef) -> None:
    assert arguments(node) == real_arguments(getattr(_core, node.name))


@pytest.mark.parametrize("node", [n for n in stub().body if isinstance(n, ast.ClassDef)], ids=lambda n: n.name)
def test_classes_have_what_the_stub_says(node: ast.ClassDef) -> None:
    real = getattr(_core, node.name)
    methods = {child.name: child for child in node.body if isinstance(child, ast.FunctionDef)}
    own = {name for name in vars(real) if name not in INHERITED}
    if issubclass(real, Exception):
        assert [base.id for base in node.bases if isinstance(base, ast.Name)] == [real.__bases__[0].__name__]
        return
    assert {name for name in methods if name != "__new__"} == own
    for name, method in methods.items():
        decorators = {decorator.id for decorator in method.decorator_list if isinstance(decorator, ast.Name)}
        is_dunder = name.startswith("__") and name != "__new__"
        if "property" in decorators or is_dunder or method.decorator_list and not decorators & {"staticmethod", "classmethod"}:
            continue
        callable_ = real if name == "__new__" else getattr(real, name)
        assert arguments(method) == real_arguments(callable_), name


def test_the_interface_is_what_dir_shows() -> None:
    assert dir(trocar) == sorted(trocar.__all__)
    assert all(hasattr(trocar, name) for name in dir(trocar))


def test_everything_public_is_documented() -> None:
    for name in trocar.__all__:
        thing = getattr(trocar, name)
        if name != "__version__":
            assert inspect.getdoc(thing), name
    assert sorted(trocar.__all__) == sorted(set(trocar.__all__))


def test_mypy_is_content(tmp_path: Path) -> None:
    script = tmp_path / "user.py"
    script.write_text(
        "import numpy as np\n"
        "import trocar\n\n"
        "def work(path: str) -> float:\n"
        "    recording = trocar.read(path, columns='time_s,position_mm,force_n')\n"
        "    found = trocar.identify([recording], progress=lambda stage, part: print(stage, part))\n"
        "    width: float = found.parameters['half_width_m'].ci95_high\n"
        "    model: trocar.Model = found.model.tuned(half_width_m=width)\n"
        "    force = trocar.simulate(model, np.arange(3.0), [0.0, 0.1, 0.2], out=np.empty(3))\n"
        "    squares = trocar.squared_error_many(model, [0, 1], [0, 0], [0, 0], parameters={'half_width_m': [1e-3, 2e-3]})\n"
        "    forces = trocar.simulate_many([model, model], np.arange(3.0), [0.0, 0.1, 0.2], threads=2)\n"
        "    forces.sum() + squares.min()\n"
        "    stepper = trocar.Stepper(model)\n"
        "    stepper.state = stepper.state\n"
        "    comparison = trocar.compare(recording, models=['ems', 'gms:4'])\n"
        "    estimate = trocar.compensate(model, recording[:100])\n"
        "    other = trocar.Recording.from_frame({}, columns={'time_s': 't'}).crop(to_s=2.0)\n"
        "    stderr: float | None = found.params['half_width_m'].stderr\n"
        "    report: str = found.fit_report(0.5) + str(found.covariance and found.covariance.names[0])\n"
        "    rest: float = found.predict(other).sum() + found.residuals[0].sum() + found.predict([0.0], [0.0]).sum()\n"
        "    trocar.identify(recording, progress=False).plot()\n"
        "    loop = trocar.teleop(model, 'dvrk', advise=True, map=True, delays_s=[0.0], tissue={'stiffness_n_m': 400.0})\n"
        "    share: float | None = loop.advice.fraction if loop.advice else None\n"
        "    displayed = loop.figures.displayed_stiffness_n_m if loop.figures else share\n"
        "    felt: float = loop.felt_force_n.max() + loop['time_s'].sum() + (displayed or 0.0)\n"
        "    return stepper.step(1e-3, 1e-3) + float(force.sum()) + comparison.best.fit_percent + estimate.drift.level\n"
    )
    config = ["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(tmp_path / "cache")]
    for what in ([str(script)], ["-p", "trocar"]):
        run = subprocess.run([sys.executable, "-m", "mypy", *config, *what], capture_output=True, text=True, cwd=tmp_path)
        assert run.returncode == 0, run.stdout + run.stderr
