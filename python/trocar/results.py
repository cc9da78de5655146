"""Results of identify, validate, compare, simulate_full and compensate: plain objects.

A pickled result keeps its numbers, its recordings and the call that made it; figures and files
repeat that call when they are asked for first. The same recordings and options give the same
numbers.
"""

from __future__ import annotations

import difflib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, Optional, TypeVar, Union

import numpy as np
import numpy.typing as npt

from . import _core, _plot, _report, _show
from ._core import Model, Recording, TrocarError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_Native = TypeVar("_Native")

__all__ = [
    "ComparedModel",
    "Comparison",
    "Compensation",
    "Covariance",
    "Drift",
    "Figure",
    "Forces",
    "Identification",
    "Parameter",
    "Parameters",
    "Posterior",
    "RecordingValidation",
    "ResultWarning",
    "Simulation",
    "Validation",
]


class Figure(str):
    """A figure as SVG text, with its name, heading and caption; a notebook displays the image.

    >>> found.figures["cross-validation"].save("figure.svg")
    """

    name: str
    heading: str
    caption: str

    def __new__(cls, svg: str, name: str = "figure", heading: str = "", caption: str = "") -> Figure:
        self = super().__new__(cls, svg)
        self.name, self.heading, self.caption = name, heading, caption
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return Figure, (str(self), self.name, self.heading, self.caption)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the SVG file."""
        with open(path, "w", encoding="utf-8") as file:
            file.write(self)

    def __repr__(self) -> str:
        return f"<trocar.Figure {self.name!r}: {self.heading}>"

    def _repr_html_(self) -> str:
        return _show.figure(self)


def _figures(drawn: list[tuple[str, str, str, str]]) -> Mapping[str, Figure]:
    return {name: Figure(svg, name, heading, caption) for name, heading, caption, svg in drawn}


@dataclass(frozen=True)
class Parameter:
    """An estimated parameter with its 95 % interval, all in ``unit``.

    >>> friction = found.parameters["coulomb_force_n"]
    >>> friction.ci95_low < friction.value < friction.ci95_high
    True
    """

    name: str
    value: float
    unit: str
    #: Bounds of the interval; infinite if the data do not determine them.
    ci95_low: float
    ci95_high: float
    #: Whether the data determine it; if not, ``note`` says why.
    determined: bool
    note: Optional[str] = None
    #: Standard error, to first order; None where the interval does not come from one.
    stderr: Optional[float] = None

    @property
    def interval(self) -> tuple[float, float]:
        """The bounds of the 95 % interval, ``(ci95_low, ci95_high)``."""
        return self.ci95_low, self.ci95_high

    @property
    def min(self) -> float:
        """Lower end of the range that a model allows, in ``unit``; minus infinity without one.

        A force or length that must be above 0 has 0.
        """
        return _core.parameter_least(self.name)

    @property
    def max(self) -> float:
        """Upper end of that range: infinity, as no parameter has one by itself."""
        return np.inf

    @property
    def symbol(self) -> str:
        """Its symbol: F_c, β, c."""
        return _core.parameter_symbol(self.name)

    @property
    def is_coefficient(self) -> bool:
        """Whether it is a coefficient of the deformation force: determined with the others only."""
        return "_theta" in self.name

    @classmethod
    def _of(cls, name: str, found: Mapping[str, Any]) -> Parameter:
        low, high = found["ci95"]
        bounds = (-np.inf if low is None else low, np.inf if high is None else high)
        value = np.nan if found["value"] is None else found["value"]
        stderr = found.get("standard_error")
        is_determined, note = found["determined"], found.get("note")
        return cls(name, value, found["unit"], *bounds, is_determined, note, stderr)

    def _repr_html_(self) -> str:
        return _show.parameters({self.name: self})


#: Greek letters of symbols as one types them.
_LATIN = str.maketrans({"β": "beta", "σ": "sigma", "κ": "kappa", "θ": "theta", "⁺": "+", "⁻": "-"})


class Parameters(Mapping[str, Parameter]):
    """Estimated parameters by name, the main ones first; a symbol (``F_c``, ``beta``, ``c``) is a name too.

    >>> list(found.params)[:3]
    ['coulomb_force_n', 'viscous_damping_n_s_m', 'half_width_m']
    >>> found.params["beta"] is found.params["viscous_damping_n_s_m"]
    True
    """

    def __init__(self, found: Sequence[Parameter]) -> None:
        self._found = {parameter.name: parameter for parameter in found}

    def __getitem__(self, name: str) -> Parameter:
        if name not in self._found:
            name = self._called(name)
        return self._found[name]

    def _called(self, name: str) -> str:
        """The name of the parameter with this symbol."""
        symbols = {found.symbol: own for own, found in self._found.items()}
        symbols.update({symbol.translate(_LATIN): own for symbol, own in symbols.items()})
        if name in symbols:
            return symbols[name]
        near = difflib.get_close_matches(name, [*self._found, *symbols], n=1)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        main = ", ".join(own for own, found in self._found.items() if not found.is_coefficient)
        raise KeyError(f"no parameter {name!r}{hint}; there are {main}")

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def to_frame(self) -> Any:
        """The parameters as a data frame, one row each, in SI units.

        Its columns are value, stderr (nan if there is none), ci95_low, ci95_high, unit, determined
        and note. It is pandas' with the names as its index, or polars' with a column ``name``.

        :raises ImportError: if neither pandas nor polars is installed
        """
        return _report.frame(_report.parameters(self.values()), "name")

    def __repr__(self) -> str:
        shown = [f"{p.name}={p.value:.4g}" for p in self.values() if not p.is_coefficient]
        return f"<trocar.Parameters {', '.join(shown)}, {len(self)} in all>"

    def _repr_html_(self) -> str:
        return _show.parameters(self)


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance of the parameters of a fit that have a standard error.

    Its diagonal holds the squares of the standard errors. It comes from the jackknife over cycles,
    so with fewer cycles than parameters it is singular. Parameters that the data do not determine
    are not in it.

    >>> found.covariance.correlation.shape == found.covariance.matrix.shape
    True
    """

    #: Names of the parameters, in the order of rows and columns.
    names: tuple[str, ...]
    #: The matrix; the unit of an entry is the product of the units of its parameters.
    matrix: npt.NDArray[np.float64]

    @property
    def correlation(self) -> npt.NDArray[np.float64]:
        """The matrix of correlations, -1 to 1; nan for a parameter whose standard error is 0."""
        errors = np.sqrt(np.diag(self.matrix))
        with np.errstate(invalid="ignore", divide="ignore"):
            found: npt.NDArray[np.float64] = self.matrix / np.outer(errors, errors)
        return found

    def to_frame(self) -> Any:
        """The matrix as a data frame with the names as columns, and as the index of pandas'.

        :raises ImportError: if neither pandas nor polars is installed
        """
        columns = dict(zip(self.names, self.matrix.T))
        return _report.frame({"name": list(self.names), **columns}, "name")

    _repr_html_ = _show.covariance


@dataclass(frozen=True)
class ResultWarning:
    """A warning or remark about a result: its subject, its message, and whether it makes the result doubtful.

    >>> [str(warning) for warning in found.warnings if warning.doubtful]
    []
    """

    subject: str
    message: str
    doubtful: bool

    def __str__(self) -> str:
        return f"{self.subject}: {self.message}"

    _repr_html_ = _show.fields


class Forces(NamedTuple):
    """Measured and computed force along one recording.

    The sensor's offset and the inertia of a moving mass are subtracted.

    >>> forces = trocar.validate(found.model, checks).forces()
    >>> bool(np.nanstd(forces.residual_n) < 0.05)
    True
    """

    time_s: npt.NDArray[np.float64]
    measured_n: npt.NDArray[np.float64]
    model_n: npt.NDArray[np.float64]
    #: Whether the model's force is independent of the unknown state of the seal at the start.
    known: npt.NDArray[np.bool_]

    @property
    def residual_n(self) -> npt.NDArray[np.float64]:
        """Measured less computed force, N; nan where the state of the seal is unknown."""
        return np.where(self.known, self.measured_n - self.model_n, np.nan)

    def _repr_html_(self) -> str:
        return _show.fields(self)


@dataclass(frozen=True)
class RecordingValidation:
    """The error of a model on one recording.

    >>> found.validation.recordings[0].fit_percent > 98.0
    True
    """

    name: str
    rms_n: float
    fit_percent: float
    bias_n: float
    worst_n: float
    #: Number of samples scored, and of those left out because the seal had not slid yet.
    samples: int
    samples_before_known: int
    warnings: tuple[str, ...]
    #: All results, as in the JSON of the command line: errors by speed and phase, whiteness, scatter of strokes.
    details: Mapping[str, Any] = field(repr=False)

    @classmethod
    def _of(cls, found: Mapping[str, Any]) -> RecordingValidation:
        same = ("rms_n", "fit_percent", "bias_n", "worst_n", "samples", "samples_before_known")
        values = {key: found[key] for key in same}
        return cls(name=found["path"], warnings=tuple(found["warnings"]), details=found, **values)

    _repr_html_ = _show.fields


class _Repeatable(Generic[_Native]):
    """A result that repeats the call that made it for what it does not hold itself."""

    summary: Mapping[str, Any]
    _work: partial[_Native]

    @cached_property
    def _done(self) -> _Native:
        return self._work()

    def _with(self, done: Any) -> Any:
        """The same with the result of the call, which is then not repeated."""
        self.__dict__["_done"] = done
        return self

    def _repeated(self) -> Any:
        """The result of the call, if it still gives the same numbers."""
        done: Any = self._done
        if json.loads(done.summary_json()) != self.summary:
            text = "the repeated work gave other numbers: was this pickled by another version"
            hint = "hint: save() and report() before pickling"
            raise TrocarError(f"{text}, or with measured times?\n\n{hint}")
        return done

    def __getstate__(self) -> dict[str, Any]:
        return {own.name: getattr(self, own.name) for own in fields(self)}  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Validation(_Repeatable[_core.Validated]):
    """The error of a model on recordings: root mean square, N, and fit 100·(1 − rms/sd of the readings), %.

    >>> scores = trocar.validate(found.model, checks)
    >>> scores.is_doubtful, len(scores.recordings)
    (False, 1)
    """

    rms_n: float
    fit_percent: float
    recordings: tuple[RecordingValidation, ...]
    #: Subtracted from the readings: offset of the sensor, and inertia of the mass between sensor and seal.
    offset_n: float
    moving_mass_kg: float
    summary: Mapping[str, Any] = field(repr=False)
    _work: partial[_core.Validated] = field(repr=False)

    @classmethod
    def _of(
        cls,
        summary: Mapping[str, Any],
        taken_out: tuple[float, float],
        work: partial[_core.Validated],
    ) -> Validation:
        recordings = tuple(RecordingValidation._of(found) for found in summary["recordings"])
        return cls(summary["rms_n"], summary["fit_percent"], recordings, *taken_out, summary, work)

    @property
    def is_doubtful(self) -> bool:
        """Whether any recording has a warning.

        Its seal never forgot the unknown initial state, its motion left the range of the position profile, or it contradicts
        the identification.
        """
        return any(recording.warnings for recording in self.recordings)

    def forces(self, recording: int | str = 0) -> Forces:
        """Measured and computed force along a recording, selected by index or name."""
        names = [found.name for found in self.recordings]
        return Forces(*self._done.forces(_place(names, recording)))

    def plot(self, ax: Any = None, *, recording: int | str = 0) -> Any:
        """Forces and their residual along a recording, as ``Identification.plot``."""
        return _plotted(self._done, [found.name for found in self.recordings], recording, ax)

    @cached_property
    def figures(self) -> Mapping[str, Figure]:
        """Measured and computed force over time, for the first four recordings."""
        return _figures(self._done.figures())

    def _repr_html_(self) -> str:
        return _show.validation(self)


def _place(names: Sequence[str], recording: int | str) -> int:
    """Index of a recording among ``names``, by index or name."""
    if isinstance(recording, str):
        if recording not in names:
            raise KeyError(f"no recording {recording!r}; there are {', '.join(names)}")
        recording = names.index(recording)
    return range(len(names))[recording]


def _plotted(done: _core.Validated, names: Sequence[str], recording: int | str, ax: Any) -> Any:
    place = _place(names, recording)
    if ax is not None or _plot.has_matplotlib():
        return _plot.forces(Forces(*done.forces(place)), names[place], ax)
    drawn = list(_figures(done.figures()).values())
    if place >= len(drawn):
        text = f"without matplotlib only the first {len(drawn)} recordings have a figure"
        raise TrocarError(f"{text}\n\nhint: pip install matplotlib")
    return drawn[place]


def _validating(model: Model, recordings: Sequence[Recording]) -> partial[_core.Validated]:
    """The call that runs a model along recordings, with the offset and mass of its own sensor."""
    return partial(_core.validate, model, recordings, moving_mass_kg=None, offset_n=None, threads=0)


class Posterior(Mapping[str, npt.NDArray[Any]]):
    """Draws of the parameters of a model from their posterior, column by column, in SI units.

    ``chain``, ``draw`` and ``structure`` say where a draw comes from. A parameter that the structure
    of a draw does not have is nan.

    >>> drawn = trocar.identify(recording, moving_mass_kg=0.04, posterior=400).posterior
    >>> drawn["coulomb_force_n"].shape
    (400,)
    """

    def __init__(
        self,
        table: _core.PosteriorTable,
        summary: Optional[Mapping[str, Any]] = None,
        found: Optional[_core.Identified] = None,
    ) -> None:
        self._table, self._found = table, found
        self._columns = {name: np.asarray(cells) for name, cells in table.columns()}
        #: Structures, R-hat and effective sample sizes as in summary.json; None for draws from a file.
        self.summary = summary

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Posterior:
        """Reads the file ``posterior.parquet`` of a result.

        :raises ParameterError: if the file holds no draws
        """
        return cls(_core.read_posterior(os.fspath(path)))

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        if name not in self._columns:
            raise KeyError(f"no column {name!r}; there are {', '.join(self._columns)}")
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        names = ", ".join(dict.fromkeys(self._columns["structure"]))
        return f"<trocar.Posterior: {len(self._columns['draw'])} draws of {len(self.parameters)} parameters, structures {names}>"

    def _repr_html_(self) -> str:
        return _show.posterior(self)

    def __reduce__(self) -> tuple[Any, ...]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "posterior.parquet"
            self.write(path)
            return _posterior, (path.read_bytes(), self.summary)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(name for name in self._columns if name not in ("chain", "draw", "structure"))

    @cached_property
    def models(self) -> tuple[Model, ...]:
        """The model of each draw, without a position profile: for ``simulate_many``, for example."""
        return tuple(self._table.models())

    @property
    def dimension(self) -> int:
        """Number of coordinates of ``log_density``."""
        return int(self._identified().dimension() or 0)

    def log_density(
        self, z: ArrayLike, parameters: Sequence[str] = ()
    ) -> tuple[npt.NDArray[np.float64], dict[str, npt.NDArray[np.float64]]]:
        """Logarithm of the density of the most probable structure at each row of ``z``, for other samplers.

        The coordinates ``z`` are nearly standard normal. The second result holds the named parameters
        there.

        :raises ParameterError: if ``z`` does not have ``dimension`` columns
        """
        rows = np.ascontiguousarray(np.atleast_2d(z), dtype=np.float64)
        done = self._identified().log_density(rows, list(parameters))
        if done is None:
            raise TrocarError("there are no draws")
        logarithms, values = done
        return logarithms, dict(zip(parameters, values))

    def _identified(self) -> _core.Identified:
        if self._found is None:
            raise TrocarError("draws from a file have no density: identify again with posterior=N")
        return self._found

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the draws: Parquet, Arrow or CSV by the extension of ``path``."""
        self._table.write(os.fspath(path))

    def to_arviz(self) -> Any:
        """The draws as ArviZ takes them: its parameters by chain and draw. Needs the package arviz."""
        import arviz

        chains = int(self._columns["chain"].max()) + 1
        values = {name: self._columns[name].reshape(chains, -1) for name in self.parameters}
        # From version 1 on groups are the keys of one dictionary.
        if int(arviz.__version__.split(".")[0]) >= 1:
            return arviz.from_dict({"posterior": values})
        return arviz.from_dict(posterior=values)


def _posterior(contents: bytes, summary: Optional[Mapping[str, Any]]) -> Posterior:
    """A pickled posterior, without its density."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "posterior.parquet"
        path.write_bytes(contents)
        return Posterior(_core.read_posterior(os.fspath(path)), summary)


@dataclass(frozen=True, eq=False)
class Identification(_Repeatable[_core.Identified]):
    """An identified model with its parameters, intervals, warnings and validation.

    >>> found.is_doubtful
    False
    >>> found.save("seal")  # model.json, summary.json, table.tex, report.html, figures
    """

    model: Model
    #: Parameters by name (with unit), the main ones first.
    parameters: Parameters
    warnings: tuple[ResultWarning, ...] = field(repr=False)
    #: Root mean square error over the recordings used for identification, N.
    residual_rms_n: float
    #: Validation on the held-out recordings; None if there are none.
    validation: Optional[Validation]
    #: The contents of summary.json.
    summary: Mapping[str, Any] = field(repr=False)
    _work: partial[_core.Identified] = field(repr=False)

    @classmethod
    def _of(cls, done: _core.Identified, work: partial[_core.Identified]) -> Identification:
        summary = json.loads(done.summary_json())
        model, found = done.model(), summary["parameters"]
        validation = None
        if summary["validation"] is not None:
            taken_out = model.sensor_offset_n, model.moving_mass_kg
            checking = _validating(model, work.args[1])
            validation = Validation._of(summary["validation"], taken_out, checking)
        result = cls(
            model=model,
            parameters=Parameters([Parameter._of(name, found[name]) for name in done.names()]),
            warnings=tuple(ResultWarning(**warning) for warning in summary["warnings"]),
            residual_rms_n=summary["residual_rms_n"],
            validation=validation,
            summary=summary,
            _work=work,
        )
        return result._with(done)  # type: ignore[no-any-return]

    @property
    def params(self) -> Parameters:
        """``parameters`` by the name that lmfit gives them."""
        return self.parameters

    @property
    def covariance(self) -> Optional[Covariance]:
        """Covariance of the parameters of the fit; None for the paper's two steps."""
        found = self.summary["covariance"]
        if found is None:
            return None
        return Covariance(tuple(found["parameters"]), np.array(found["rows"]))

    @cached_property
    def posterior(self) -> Optional[Posterior]:
        """The draws that ``identify(posterior=N)`` took; None without."""
        found = self._done.posterior()
        return None if found is None else Posterior(found, self.summary["posterior"], self._done)

    @property
    def ndata(self) -> int:
        """Number N of scored samples: within strokes, once the state of the seal is known."""
        return sum(phase["samples"] for phase in self.summary["phases"])

    @property
    def nvarys(self) -> int:
        """Number p of estimated parameters, without the sensor's offset and an unmodelled mass."""
        return int(self.summary["free_parameters"])

    @property
    def chisqr(self) -> float:
        """Sum of squared residuals, N²: N·``residual_rms_n``², with all samples weighted equally.

        Neighbouring samples are not independent, so it follows no chi-square distribution.
        """
        return self.ndata * self.residual_rms_n**2

    @property
    def redchi(self) -> float:
        """``chisqr``/(N − p), N²: the variance of the residual.

        As in lmfit without weights it is no test of the fit. Standard errors come from the jackknife
        over cycles, not from it.
        """
        return self.chisqr / (self.ndata - self.nvarys)

    @property
    def success(self) -> bool:
        """Whether the fit converged; the paper's two steps are linear and need not converge.

        A converged fit may still be doubtful (``is_doubtful``).
        """
        fit = self.summary["fit"]
        return fit is None or bool(fit["converged"])

    @property
    def message(self) -> str:
        """How the fit ended, as in ``fit_report``."""
        return _report.ending(self)

    def fit_report(self, min_correl: float = 0.1, *, coefficients: bool = False) -> str:
        """The identification as text, in the layout of lmfit's reports.

        :param min_correl: least absolute value of the correlations that are listed, 0 to 1
        :param coefficients: list the coefficients of the deformation force, too
        :returns: statistics of the fit, parameters with standard errors and 95 % intervals in SI
            units, correlations, and further warnings that make the result doubtful. A parameter
            that the data do not determine is listed with the reason
        """
        return _report.fit_report(self, min_correl, coefficients)

    def to_frame(self) -> Any:
        """The parameters as a data frame (``Parameters.to_frame``)."""
        return self.parameters.to_frame()

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """The recordings it was identified from, as they were given."""
        return tuple(self._work.args[0])

    @cached_property
    def _replayed(self) -> _core.Validated:
        return _validating(self.model, self.recordings)()

    def forces(self, recording: int | str = 0) -> Forces:
        """Measured and computed force along one of ``recordings``, selected by index or name."""
        names = [own.name for own in self.recordings]
        return Forces(*self._replayed.forces(_place(names, recording)))

    @property
    def residuals(self) -> tuple[npt.NDArray[np.float64], ...]:
        """Measured less computed force, N, an array for each of ``recordings``.

        They are nan where the state of the seal is unknown. Offset and inertia are subtracted from
        the readings. The friction scale of each stroke is left at 1, as in a simulation. Where a
        position delay was compensated, an array is some samples shorter than its recording;
        ``forces`` has the times.
        """
        return tuple(self.forces(place).residual_n for place in range(len(self.recordings)))

    def predict(
        self, motion: Union[Recording, ArrayLike], position_m: Optional[ArrayLike] = None
    ) -> npt.NDArray[np.float64]:
        """Force of the instrument on the seal along a motion, N, as ``simulate``.

        :param motion: times, s; or a recording, of which the positions are used, and the first
            reading for the state of the seal at the start
        :param position_m: positions, m, if ``motion`` are times
        :returns: the force at each sample, without the sensor's offset (``model.sensor_offset_n``)
            and the inertia of a moving mass
        """
        if isinstance(motion, Recording):
            if position_m is not None:
                raise TypeError("predict(recording) takes no position_m: the recording has its own")
            return _validating(self.model, [motion])().forces(0)[2]
        if position_m is None:
            what = "predict takes a recording, or times and positions"
            raise TypeError(f"{what}: predict(time_s, position_m)")
        return _core.simulate(self.model, motion, position_m)

    def plot(self, ax: Any = None, *, recording: int | str = 0) -> Any:
        """Measured and computed force and residual, N, over time, s, along one of ``recordings``.

        :param ax: two axes of matplotlib to draw into, or one for the forces alone; by default
            those of a new figure
        :param recording: index or name of the recording
        :returns: the axes; a ``Figure`` (SVG) where matplotlib is not installed
        """
        return _plotted(self._replayed, [own.name for own in self.recordings], recording, ax)

    @property
    def is_doubtful(self) -> bool:
        """Whether data were lost, parameters are not determined, or the validation contradicts the identification."""
        return bool(self.summary["doubtful"])

    @cached_property
    def figures(self) -> Mapping[str, Figure]:
        """The figures of the report, by name."""
        return _figures(self._repeated().figures())

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes model.json, summary.json, report.html and figures into a folder: either all of them or none."""
        self._repeated().save(folder)

    def report(self, path: str | os.PathLike[str]) -> None:
        """Writes the report as one self-contained HTML file."""
        self._repeated().report(path)

    def __repr__(self) -> str:
        main = ("coulomb_force_n", "viscous_damping_n_s_m", "half_width_m")
        numbers = ", ".join(f"{name}={self.parameters[name].value:.4g}" for name in main if name in self.parameters)
        doubt = ", doubtful" if self.is_doubtful else ""
        return f"<trocar.Identification {numbers}, residual {self.residual_rms_n:.3g} N rms{doubt}>"

    def _repr_html_(self) -> str:
        return _show.identification(self)


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """One model of a comparison with its fit and scores. Errors are in N rms.

    >>> both = trocar.compare(recording, validate=checks, models="ems,coulomb", moving_mass_kg=0.04)
    >>> both["ems"].validate_rms_n < both["coulomb"].validate_rms_n
    True
    """

    #: Family, with the number of elements if it is variable: "lugre", "gms-4".
    label: str
    name: str
    elements: int
    #: Number of parameters estimated, without the sensor's offset.
    parameters: int
    train_rms_n: float
    validate_rms_n: float
    fit_percent: float
    aic: float
    bic: float
    #: Error after all reversals of the validation, and after the worst one; nan without a reversal.
    reversal_rms_n: float
    worst_reversal_n: float
    offset_n: float
    #: Time of one step, ns, and of the fit, s; None without timing.
    ns_per_sample: Optional[float]
    fit_s: Optional[float]
    estimates: Parameters = field(repr=False)
    warnings: tuple[str, ...] = field(repr=False)
    model: Model

    _repr_html_ = _show.fields

    @classmethod
    def _of(cls, found: Mapping[str, Any], model: Model) -> ComparedModel:
        bank = found["name"] in ("leuven", "maxwell-slip", "gms")
        same = ("name", "elements", "parameters", "train_rms_n", "validate_rms_n", "fit_percent", "aic", "bic")
        values = {key: found[key] for key in (*same, "offset_n", "ns_per_sample", "fit_s")}
        for key in ("reversal_rms_n", "worst_reversal_n"):
            values[key] = np.nan if found[key] is None else found[key]
        estimates = [Parameter._of(name, estimate) for name, estimate in found["estimates"].items()]
        return cls(
            label=f"{found['name']}-{found['elements']}" if bank else found["name"],
            estimates=Parameters(estimates),
            warnings=tuple(found["warnings"]),
            model=model,
            **values,
        )


@dataclass(frozen=True, eq=False)
class Comparison(_Repeatable[_core.Compared]):
    """Friction models fitted to the same recordings and scored on the same validation data, smallest validation error first.

    >>> both = trocar.compare(recording, validate=checks, models="ems,coulomb", moving_mass_kg=0.04)
    >>> [own.label for own in both]
    ['ems', 'coulomb']
    """

    models: tuple[ComparedModel, ...]
    #: Results of testing the claims of section II-C of the paper, as sentences.
    claims: tuple[str, ...]
    #: Whether the models were scored on the last third of each recording, because no other recordings were given.
    held_out: bool
    warnings: tuple[str, ...]
    #: The contents of compare.json.
    summary: Mapping[str, Any] = field(repr=False)
    _work: partial[_core.Compared] = field(repr=False)

    @classmethod
    def _of(cls, done: _core.Compared, work: partial[_core.Compared]) -> Comparison:
        summary = json.loads(done.summary_json())
        models = tuple(ComparedModel._of(*pair) for pair in zip(summary["models"], done.models()))
        claims = tuple(claim["sentence"] for claim in summary["reversal_claim"])
        unknown = tuple(done.unknown_states())
        result = cls(models, claims, summary["held_out"], unknown, summary, work)
        return result._with(done)  # type: ignore[no-any-return]

    @property
    def best(self) -> ComparedModel:
        """The model with the smallest validation error."""
        return self.models[0]

    @property
    def verdict(self) -> str:
        """Which model has the smallest error, and by how many standard errors over the strokes; empty for one family."""
        return str(self.summary["verdict"])

    def __getitem__(self, label: str) -> ComparedModel:
        for model in self.models:
            if model.label == label:
                return model
        raise KeyError(f"no model {label!r}; there are {', '.join(model.label for model in self.models)}")

    def __iter__(self) -> Iterator[ComparedModel]:
        return iter(self.models)

    def __len__(self) -> int:
        return len(self.models)

    @cached_property
    def figures(self) -> Mapping[str, Figure]:
        """The figures of the report, by name."""
        return _figures(self._repeated().figures())

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes compare.json, models, report.html and figures into a folder: either all of them or none."""
        self._repeated().save(folder)

    def report(self, path: str | os.PathLike[str]) -> None:
        """Writes the report as one self-contained HTML file."""
        self._repeated().report(path)

    def __repr__(self) -> str:
        return f"<trocar.Comparison of {len(self)} models, best {self.best.label}: {self.best.validate_rms_n:.3g} N rms>"

    def _repr_html_(self) -> str:
        return _show.comparison(self)


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulation of a model along a motion, sample by sample.

    >>> run = trocar.simulate_full(model, [0.0, 0.4], [0.0, 0.02])
    >>> list(run.columns())
    ['time_s', 'position_m', 'force_n', 'deflection_m', 'mode']
    """

    time_s: npt.NDArray[np.float64]
    position_m: npt.NDArray[np.float64]
    #: Force of the instrument on the seal, N.
    force_n: npt.NDArray[np.float64]
    #: Deflection of the seal, m, and whether it slides; None for a classical model, which does not provide them.
    deflection_m: Optional[npt.NDArray[np.float64]]
    sliding: Optional[npt.NDArray[np.bool_]]

    @property
    def mode(self) -> Optional[npt.NDArray[np.str_]]:
        """ "deforming" or "sliding" at each sample; None for a classical model."""
        return None if self.sliding is None else np.where(self.sliding, "sliding", "deforming")

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """All columns that are not None, in a form that ``pandas.DataFrame`` and ``polars.DataFrame`` accept."""
        all_ = {
            "time_s": self.time_s,
            "position_m": self.position_m,
            "force_n": self.force_n,
            "deflection_m": self.deflection_m,
            "mode": self.mode,
        }
        return {name: column for name, column in all_.items() if column is not None}

    def __len__(self) -> int:
        return len(self.force_n)

    def __repr__(self) -> str:
        if not len(self):
            return "<trocar.Simulation: no samples>"
        low, high = float(self.force_n.min()), float(self.force_n.max())
        return f"<trocar.Simulation: {len(self)} samples, force {low:.3g} to {high:.3g} N>"

    _repr_html_ = _show.fields


class Drift(NamedTuple):
    """Friction scale and viscosity scale relative to the model, with standard deviations; 1 means unchanged.

    >>> trocar.compensate(found.model, checks).drift.level_std > 0.0
    True
    """

    level: float
    level_std: float
    viscosity: float
    viscosity_std: float

    def _repr_html_(self) -> str:
        return _show.fields(self)


@dataclass(frozen=True, eq=False)
class Compensation:
    """The force on the tissue along a recording: the sensor reading minus offset, inertia and trocar force.

    >>> along = trocar.compensate(found.model, checks)
    >>> along.faults, along.is_doubtful
    ({}, False)
    """

    time_s: npt.NDArray[np.float64]
    position_m: npt.NDArray[np.float64]
    #: Sensor reading.
    force_n: npt.NDArray[np.float64]
    #: Force of the instrument on seal and trocar, and on the tissue; nan if the reading does not determine it.
    trocar_force_n: npt.NDArray[np.float64]
    tissue_force_n: npt.NDArray[np.float64]
    #: Standard deviation of both forces.
    tissue_force_std_n: npt.NDArray[np.float64]
    #: Whether the observer tracks friction and viscosity.
    adapting: npt.NDArray[np.bool_]
    #: Index of each sample's fault in ``FAULTS``; -1 for none.
    fault: npt.NDArray[np.int8]
    #: Torque on the seal; None for a model without rotation.
    torque_n_m: Optional[npt.NDArray[np.float64]]
    #: Friction and viscosity after the last sample.
    drift: Drift

    #: Names and meanings of the faults.
    FAULTS: ClassVar[tuple[tuple[str, str], ...]] = tuple(_core.faults())

    @classmethod
    def _of(cls, columns: Sequence[Any], estimate: Sequence[Any], drift: Sequence[float]) -> Compensation:
        values: list[Any] = [*columns, *estimate, Drift(*drift)]
        return cls(*values)

    @property
    def faults(self) -> dict[str, int]:
        """Number of samples with each fault, for the faults that occur."""
        counts = {name: int((self.fault == place).sum()) for place, (name, _) in enumerate(self.FAULTS)}
        return {name: count for name, count in counts.items() if count}

    @property
    def is_doubtful(self) -> bool:
        """Whether some readings did not determine the force, or samples were missing."""
        return bool({"no_reading", "no_position", "saturated", "frozen", "gap", "opposite_sign"} & self.faults.keys())

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """The columns, in a form that ``pandas.DataFrame`` and ``polars.DataFrame`` accept."""
        names = ("time_s", "position_m", "force_n", "trocar_force_n", "tissue_force_n", "tissue_force_std_n", "adapting")
        found = {name: getattr(self, name) for name in names}
        return found if self.torque_n_m is None else {**found, "torque_n_m": self.torque_n_m}

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        faults = "".join(f", {count} {name}" for name, count in self.faults.items())
        followed = float(self.adapting.mean()) if len(self) else 0.0
        return (
            f"<trocar.Compensation: {len(self)} samples, friction {self.drift.level:.3f} of the model's, "
            f"followed in {100 * followed:.0f} %{faults}>"
        )

    def _repr_html_(self) -> str:
        return _show.compensation(self)
