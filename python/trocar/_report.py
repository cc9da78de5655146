"""An identification as text, laid out as in lmfit, and its parameters as a data frame."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .results import Covariance, Identification, Parameter


def fit_report(found: Identification, min_correl: float, coefficients: bool) -> str:
    """The text of ``Identification.fit_report``."""
    shown = [p for p in found.params.values() if coefficients or not p.is_coefficient]
    undetermined = {p.name for p in shown if not p.determined}
    sections = [
        ("Model", [repr(found.model)[len("<trocar.Model ") : -1]]),
        ("Fit Statistics", _aligned(_statistics(found), " = ")),
        ("Variables", _aligned(((f"{p.name}:", _value(p)) for p in shown), " ")),
        (
            f"Correlations]] (unreported correlations are < {min_correl:.3f})",
            _correlations(found.covariance, {p.name for p in shown}, min_correl),
        ),
        (
            "Warnings",
            [str(w) for w in found.warnings if w.doubtful and w.subject not in undetermined],
        ),
    ]
    lines = []
    for heading, body in sections:
        if body:
            lines += [
                f"[[{heading}" + ("" if "]]" in heading else "]]"),
                *(f"    {line}" for line in body),
            ]
    return "\n".join(lines)


def _aligned(pairs: Iterable[tuple[str, str]], between: str) -> list[str]:
    all_ = list(pairs)
    width = max((len(name) for name, _ in all_), default=0)
    return [f"{name.ljust(width)}{between}{text}" for name, text in all_]


def _statistics(found: Identification) -> Iterator[tuple[str, str]]:
    fit = found.summary["fit"]
    yield (
        "# fitting method",
        "the paper's two steps"
        if fit is None
        else "likelihood with a friction scale for each stroke",
    )
    if fit is not None:
        yield "# iterations", f"{fit['iterations']}, {_converged(fit)}"
    yield "# data points", f"{found.ndata}"
    yield "# variables", f"{found.nvarys}"
    yield "chi-square", f"{found.chisqr:.6g} N²"
    yield "reduced chi-square", f"{found.redchi:.6g} N²"
    yield "residual rms", f"{found.residual_rms_n:.6g} N"
    if fit is not None:
        yield "rms with scales", f"{fit['rms_n']:.6g} N"
    if found.validation is not None:
        yield (
            "validation rms",
            f"{found.validation.rms_n:.6g} N, fit {found.validation.fit_percent:.2f} %",
        )


def _converged(fit: Mapping[str, Any]) -> str:
    return "converged" if fit["converged"] else "not converged"


def ending(found: Identification) -> str:
    """The text of ``Identification.message``."""
    fit = found.summary["fit"]
    if fit is None:
        return "the paper's two steps, without a fit of the whole motion"
    return f"{_converged(fit)} after {fit['iterations']} iterations"


def _value(p: Parameter) -> str:
    if not p.determined:
        return f"{p.value:.6g} {p.unit}, not determined: {p.note or 'by these data'}"
    error = "" if p.stderr is None else f" +/- {p.stderr:.2g}"
    if p.stderr is not None and p.value != 0:
        error += f" ({100 * p.stderr / abs(p.value):.2f}%)"
    note = f"; {p.note}" if p.note else ""
    return f"{p.value:.6g}{error} {p.unit}, 95 % [{p.ci95_low:.6g}, {p.ci95_high:.6g}]{note}"


def _correlations(found: Covariance | None, shown: set[str], least: float) -> list[str]:
    if found is None:
        return []
    names, matrix = found.names, found.correlation
    pairs = [
        (matrix[i, j], names[i], names[j])
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(matrix[i, j]) >= least and {names[i], names[j]} <= shown
    ]
    pairs.sort(key=lambda pair: -abs(pair[0]))
    return _aligned(((f"C({a}, {b})", f"{value:+.4f}") for value, a, b in pairs), " = ")


def frame(columns: dict[str, Any], index: str) -> Any:
    """A data frame of pandas, with ``index`` as its index, or else of polars."""
    if importlib.util.find_spec("pandas") is not None:
        return importlib.import_module("pandas").DataFrame(columns).set_index(index)
    if importlib.util.find_spec("polars") is not None:
        return importlib.import_module("polars").DataFrame(columns)
    raise ImportError(
        "to_frame() needs pandas or polars, and neither is installed: pip install pandas"
    )


def parameters(found: Iterable[Parameter]) -> dict[str, Any]:
    """Columns of a table of parameters."""
    own = list(found)
    columns: dict[str, Any] = {name: [getattr(p, name) for p in own] for name in ("name", "value")}
    columns["stderr"] = [np.nan if p.stderr is None else p.stderr for p in own]
    for name in ("ci95_low", "ci95_high", "unit", "determined", "note"):
        columns[name] = [getattr(p, name) for p in own]
    return columns
