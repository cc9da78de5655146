"""Teleoperation through a trocar; the package re-exports what is public."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _core, _plot, _report, _show
from ._arrays import column, count
from ._core import Model, ParameterError, TeleopError, TrocarError
from ._keys import as_json, document, merged
from ._progress import Progress, watched
from .results import Posterior, _Repeatable

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_Path = Union[str, "os.PathLike[str]"]
_Array = npt.NDArray[np.float64]
#: Smallest and greatest value of each range.
_Ranges = tuple[tuple[float, float], ...]


def teleop(
    model: Model,
    config: Union[_Path, Mapping[str, Any], None] = None,
    *,
    compensator: Optional[Model] = None,
    advise: bool = False,
    draws: int = 0,
    posterior: Union[Posterior, _Path, None] = None,
    compensator_draws: int = 0,
    least_friction: float = 1.0,
    map: bool = False,
    delays_s: Optional[ArrayLike] = None,
    fractions: Optional[ArrayLike] = None,
    hybrid: bool = False,
    frequencies_hz: Optional[ArrayLike] = None,
    threads: int = 0,
    progress: Union[Progress, bool, None] = None,
    **changes: Any,
) -> Teleoperation:
    """Runs a teleoperation loop through a trocar: what the operator feels, and whether it is stable (``trocar teleop``).

    Operator, leader, channel, follower, trocar, tissue and force sensor move along the axis of the instrument. Part of the
    trocar's force is subtracted from the reading of the sensor before the leader reflects it: ``compensation.fraction``.
    The same loop and model give the same numbers as the command line.

        found = trocar.teleop(model, "dvrk", tissue={"stiffness_n_m": 400.0}, compensation={"fraction": 0.9})
        found.figures.displayed_stiffness_n_m
        trocar.teleop(model, channel={"delay_s": 0.01}, advise=True).advice.fraction

    :param model: the trocar
    :param config: the loop, in SI units: name of a device ("dvrk", "phantom"), path of a TOML file, TOML text (of several
        lines), or a dictionary with the same keys and sections. Keys left out keep their defaults. ``teleop_config()``
        gives a text that describes every key
    :param compensator: model in the compensator; by default the same
    :param advise: find the fraction of the trocar's force to compensate (``.advice``)
    :param draws: with ``advise``, try this many trocars drawn from the model's 95 % intervals (seed of the loop), up to
        1000, besides the model and both ends of the intervals
    :param posterior: with ``advise``, draws of the model's parameters, or their file: ``draws`` of them (20 where that is 0)
        are tried in place of the ends of the intervals and of draws from them
    :param compensator_draws: with ``advise``, also try both ends of the intervals of the compensator's model and this many
        models drawn from them, up to 1000, with the trocar as its model describes it
    :param least_friction: with ``advise``, include trocars whose friction is down to this multiple of the model's, 0.01
        to 1, as that of a wetted seal, which loses 15 to 45 %
    :param map: find the ranges of the tissue's stiffness with which the loop is stable, over delay and fraction (``.map``)
    :param delays_s: delays of the map, of one direction, s; by default 0 to 19 samples
    :param fractions: fractions of the map; by default 0 to 1.425
    :param hybrid: compute the hybrid matrix over frequency, with the trocar as its describing function at the amplitude of
        the motion (``.hybrid``)
    :param frequencies_hz: frequencies of the hybrid matrix, Hz; by default 0.1 to 100
    :param threads: number of threads; 0 takes one per processor. At most four per processor, or 64 if that is more, are used
    :param progress: called on the calling thread with the stage and the fraction done, 0 to 1. By
        default a bar is shown in a terminal, and in a notebook with tqdm and ipywidgets; False
        shows none
    :param changes: keys and sections of the loop that replace those of ``config``; a section changes only the keys it has
    :raises TeleopError: if the loop cannot run: an unknown key, a value out of its range. A loop that is unstable is a
        result

    >>> loop = trocar.teleop(model, "dvrk", channel={"delay_s": 0.0})
    >>> loop.is_stable
    True
    """
    options = {
        "advise": advise,
        "draws": count("draws", draws) or None,
        "compensator_draws": count("compensator_draws", compensator_draws) or None,
        "least_friction": None if least_friction == 1.0 else least_friction,
        "map": map,
        "delays_s": _numbers("delays_s", delays_s),
        "fractions": _numbers("fractions", fractions),
        "hybrid": hybrid,
        "frequencies_hz": _numbers("frequencies_hz", frequencies_hz),
    }
    text, file, keys = document(config, dict(_core.teleop_presets()))
    work = partial(
        _core.teleop,
        model,
        compensator=compensator,
        text=text,
        name=file,
        changes=as_json(merged(keys, changes), TeleopError),
        posterior=posterior,
        threads=count("threads", threads),
        progress=None,
        **options,
    )
    with watched(progress) as watching:
        done = work(progress=watching)
    return Teleoperation._of(done, work)


def teleop_config(device: Optional[str] = None) -> str:
    """A loop with every key as a documented TOML text: all defaults, or those of a device ("dvrk", "phantom").

    >>> "[follower]" in trocar.teleop_config("dvrk")
    True
    """
    if device is None:
        return _core.teleop_example()
    presets = dict(_core.teleop_presets())
    if device not in presets:
        raise ParameterError(f"device must be one of {', '.join(presets)}, got {device!r}")
    return presets[device]


def _numbers(name: str, values: Optional[ArrayLike]) -> Optional[list[float]]:
    return None if values is None else [float(number) for number in column(name, values)]


@dataclass(frozen=True)
class Merit:
    """Figures of merit of a loop: how well the operator feels the tissue.

    The force felt is that of the leader's motor; with ``four_channel``, which compensates the leader's mass, that of the
    operator.

    >>> loop = trocar.teleop(model)
    >>> loop.figures.force_error_rms_n > 1.0  # N: the seal masks soft tissue
    True
    """

    #: Force felt less force on the tissue, N: root mean square, and largest magnitude.
    force_error_rms_n: float
    force_error_peak_n: float
    #: Root mean square of the same in just noticeable differences of the force on the tissue.
    force_error_rms_jnd: float
    #: Slope of the force felt over the depth of the tip while it goes deeper, N/m; None without contact. Compare it with
    #: that of the force on the tissue, which includes damping.
    displayed_stiffness_n_m: Optional[float]
    true_stiffness_n_m: Optional[float]
    #: The same in one push to the greatest depth of the motion that begins at rest at the surface, with the seal undeformed,
    #: and in one that comes from so far that the seal slides when the tip touches; None without contact.
    displayed_from_rest_n_m: Optional[float]
    true_from_rest_n_m: Optional[float]
    displayed_sliding_n_m: Optional[float]
    true_sliding_n_m: Optional[float]
    #: Root mean square of the difference of the devices' positions, m.
    position_error_rms_m: float
    #: Energy received at both ports less energy given, J, below 0 where the loop was active; at each port alone.
    energy_j: float
    leader_energy_j: float
    follower_energy_j: float
    #: Energy that the passivity control was given back for what the trocar dissipated, J; None without a credit.
    credit_j: Optional[float]

    @classmethod
    def _of(cls, found: Optional[Mapping[str, Any]]) -> Optional[Merit]:
        return None if found is None else cls(**{own.name: found[own.name] for own in fields(cls)})

    _repr_html_ = _show.fields


def _row(found: Optional[Mapping[str, Any]], name: str) -> float:
    value = None if found is None else found[name]
    return math.nan if value is None else float(value)


@dataclass(frozen=True)
class NoticeableStep:
    """The smallest step of the tissue's stiffness that a person notices, among steps up to ten times the stiffness.

    >>> trocar.NoticeableStep("noticed", 90.0).is_noticed
    True
    """

    #: "noticed"; "not_noticed": no step up to the largest is noticed; "unstable": the loop becomes unstable with stiffer
    #: tissue before a step is noticed.
    finding: str
    #: The step that is noticed, the largest that was tried, or the one from which on the loop is unstable, N/m.
    step_n_m: float

    @classmethod
    def _of(cls, found: Optional[Mapping[str, Any]]) -> Optional[NoticeableStep]:
        return None if found is None else cls(found["finding"], found["step_n_m"])

    @property
    def is_noticed(self) -> bool:
        """Whether there is a step that is noticed."""
        return self.finding == "noticed"

    _repr_html_ = _show.fields


@dataclass(frozen=True, eq=False)
class Advice:
    """Which fraction of the trocar's force to compensate in a loop, from fractions between 0 and 1.5.

    A fraction counts as stable if the loop is stable with every pair of a compensator's model and a trocar that was tried.

    >>> loop = trocar.teleop(model, advise=True)
    >>> 0.0 <= loop.advice.fraction <= 1.5
    True
    """

    #: Fraction with the smallest force error among those that are stable and with which the tip reaches the tissue; None if
    #: there is none (``refusal``).
    fraction: Optional[float]
    #: Intervals of stable fractions, lowest and highest.
    stable: tuple[tuple[float, float], ...]
    #: Figures with that fraction and without compensation, of the pair with the largest force error; None if unstable.
    figures_with: Optional[Merit]
    figures_without: Optional[Merit]
    #: Number of pairs: the trocar as its model describes it, at both ends of the model's 95 % intervals, drawn from them and
    #: with less friction, each with the compensator's model; and draws of the compensator's model.
    pairs: int
    #: Lowest and highest of the fractions that are best for each pair by itself; None if no pair has one.
    best: Optional[tuple[float, float]]
    #: Smallest step of the tissue's stiffness that a person notices with that fraction and without compensation; None if
    #: the loop is unstable or the tip does not touch the tissue.
    noticeable_with: Optional[NoticeableStep]
    noticeable_without: Optional[NoticeableStep]
    _tried: dict[str, npt.NDArray[Any]] = field(repr=False)

    @classmethod
    def _of(cls, found: Mapping[str, Any]) -> Advice:
        tried = found["tried"]
        columns: dict[str, npt.NDArray[Any]] = {
            name: np.array([row[name] for row in tried]) for name in ("fraction", "stable", "stable_share")
        }
        for own in fields(Merit):
            columns[own.name] = np.array([_row(row["merit"], own.name) for row in tried])
        best = found["best"]
        return cls(
            fraction=found["fraction"],
            stable=tuple((low, high) for low, high in found["stable"]),
            figures_with=Merit._of(found["with"]),
            figures_without=Merit._of(found["without"]),
            pairs=found["pairs"],
            best=None if best is None else (best[0], best[1]),
            noticeable_with=NoticeableStep._of(found["noticeable_with"]),
            noticeable_without=NoticeableStep._of(found["noticeable_without"]),
            _tried=columns,
        )

    @property
    def refusal(self) -> str:
        """Why there is no fraction."""
        if not self.stable:
            return "no fraction from 0 to 150 % makes the loop stable"
        return "no advice: the tip does not reach the tissue with any fraction that makes the loop stable"

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """Each fraction that was tried: whether it is stable, the share of pairs with which it is, and its figures.

        The figures are those of the pair with the largest force error, and nan where the fraction is not stable.
        """
        return dict(self._tried)

    def to_frame(self) -> Any:
        """``columns`` as a data frame, by fraction: pandas', or polars'.

        :raises ImportError: if neither pandas nor polars is installed
        """
        return _report.frame(self.columns(), "fraction")

    def plot(self, ax: Any = None) -> Any:
        """Force error, N rms, over the fraction, with the fractions that are not stable shaded.

        :param ax: axes of matplotlib to draw into; by default those of a new figure
        :returns: the axes
        :raises ImportError: if matplotlib is not installed
        """
        return _plot.advice(self, ax)

    def __repr__(self) -> str:
        ranges = ", ".join(f"{low:.4g} to {high:.4g}" for low, high in self.stable)
        if self.fraction is None:
            return f"<trocar.Advice: {self.refusal}, {self.pairs} pairs>"
        return f"<trocar.Advice: fraction {self.fraction:.4g}, stable {ranges}, {self.pairs} pairs>"

    def _repr_html_(self) -> str:
        return f"<div>{_show.advice(self)}</div>"


def _ranges(found: Sequence[Sequence[float]]) -> _Ranges:
    return tuple((least, greatest) for least, greatest in found)


@dataclass(frozen=True, eq=False)
class StabilityMap:
    """Stiffnesses of the tissue with which a loop is stable, over delay and fraction; 0 to 20,000 N/m are tried.

    >>> grid = trocar.teleop(model, map=True).map
    >>> grid.stiffness_n_m.shape == (len(grid.delays_s), len(grid.fractions))
    True
    """

    #: Delays of one direction, s, and fractions.
    delays_s: _Array
    fractions: _Array
    #: Greatest stiffness of the softest stable range, N/m, a row for each delay; 0 where there is none, 20,000 where the
    #: loop is stable up to there.
    stiffness_n_m: _Array
    #: Smallest stiffness of that range, N/m; nan where there is none.
    least_stiffness_n_m: _Array
    #: All stable ranges, smallest and greatest stiffness, N/m, a row for each delay.
    z_width_n_m: tuple[tuple[_Ranges, ...], ...]

    @classmethod
    def _of(cls, found: Mapping[str, Any]) -> StabilityMap:
        widths = tuple(tuple(_ranges(cell) for cell in row) for row in found["z_width_n_m"])
        greatest = [[cell[0][1] if cell else 0.0 for cell in row] for row in widths]
        least = [[cell[0][0] if cell else math.nan for cell in row] for row in widths]
        delays_s, fractions = (np.array(found[name], dtype=np.float64) for name in ("delays_s", "fractions"))
        return cls(delays_s, fractions, np.array(greatest), np.array(least), widths)

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """A row for each delay and fraction, in a form that ``pandas.DataFrame`` and ``polars.DataFrame`` accept.

        ``ranges`` is the number of stable ranges; the stiffnesses are those of the softest one.
        """
        delays, fractions = np.meshgrid(self.delays_s, self.fractions, indexing="ij")
        return {
            "delay_s": delays.ravel(),
            "fraction": fractions.ravel(),
            "stiffness_n_m": self.stiffness_n_m.ravel(),
            "least_stiffness_n_m": self.least_stiffness_n_m.ravel(),
            "ranges": np.array([len(cell) for row in self.z_width_n_m for cell in row]),
        }

    def to_frame(self) -> Any:
        """``columns`` as a data frame, by delay: pandas', or polars'.

        :raises ImportError: if neither pandas nor polars is installed
        """
        return _report.frame(self.columns(), "delay_s")

    def plot(self, ax: Any = None) -> Any:
        """Greatest stable stiffness over fraction and delay as a heat map.

        :param ax: axes of matplotlib to draw into; by default those of a new figure
        :returns: the axes
        :raises ImportError: if matplotlib is not installed
        """
        return _plot.stability_map(self, ax)

    def __repr__(self) -> str:
        delays, fractions = self.stiffness_n_m.shape
        held = float((self.stiffness_n_m > 0).mean())
        return f"<trocar.StabilityMap: {delays} delays, {fractions} fractions, stable in {100 * held:.0f} %>"

    def _repr_html_(self) -> str:
        return f"<div>{_show.stability_map(self)}</div>"


@dataclass(frozen=True, eq=False)
class HybridMatrix:
    """Hybrid matrix of a loop over frequency, [F_h; −v_s] = H·[v_m; F_e]; ideal is [[0, 1], [−1, 0]].

    Sampling is left out, and the trocar is its describing function at the amplitude of the motion.

    >>> matrix = trocar.teleop(model, hybrid=True).hybrid
    >>> matrix.h12.shape == matrix.frequency_hz.shape
    True
    """

    frequency_hz: _Array
    #: Elements: h11 in N s/m, h12 and h21 as numbers, h22 in m/(N s).
    h11: npt.NDArray[np.complex128]
    h12: npt.NDArray[np.complex128]
    h21: npt.NDArray[np.complex128]
    h22: npt.NDArray[np.complex128]
    #: Margin of Llewellyn's criterion: stable with any passive operator and tissue if it, Re h11 and Re h22 are not below 0.
    llewellyn_margin: _Array
    #: Impedance of the tissue in contact, and what the operator feels of it, N s/m.
    tissue_n_s_m: npt.NDArray[np.complex128]
    transmitted_n_s_m: npt.NDArray[np.complex128]
    _columns: dict[str, _Array] = field(repr=False)

    @classmethod
    def _of(cls, columns: dict[str, _Array]) -> HybridMatrix:
        def complex_(name: str, unit: str) -> npt.NDArray[np.complex128]:
            return columns[f"{name}_real{unit}"] + 1j * columns[f"{name}_imaginary{unit}"]

        return cls(
            columns["frequency_hz"],
            complex_("h11", "_n_s_m"),
            complex_("h12", ""),
            complex_("h21", ""),
            complex_("h22", "_m_n_s"),
            columns["llewellyn_margin"],
            complex_("tissue", "_n_s_m"),
            complex_("transmitted", "_n_s_m"),
            columns,
        )

    def columns(self) -> dict[str, _Array]:
        """All columns, real and imaginary parts by themselves, as the table of the command line has them."""
        return dict(self._columns)

    def to_frame(self) -> Any:
        """``columns`` as a data frame, by frequency: pandas', or polars'.

        :raises ImportError: if neither pandas nor polars is installed
        """
        return _report.frame(self.columns(), "frequency_hz")

    def plot(self, ax: Any = None) -> Any:
        """Impedances of the tissue and of what is felt, N s/m, and Llewellyn's margin, over frequency.

        :param ax: two axes of matplotlib to draw into, or one for the impedances alone; by default
            those of a new figure
        :returns: the axes
        :raises ImportError: if matplotlib is not installed
        """
        return _plot.hybrid(self, ax)

    def __len__(self) -> int:
        return len(self.frequency_hz)

    def __repr__(self) -> str:
        ends = f"{self.frequency_hz.min():.4g} to {self.frequency_hz.max():.4g} Hz"
        return f"<trocar.HybridMatrix: {ends}, least margin {self.llewellyn_margin.min():.4g}>"

    _repr_html_ = _show.fields


@dataclass(frozen=True, eq=False)
class Teleoperation(_Repeatable[_core.Studied]):
    """A teleoperation loop through a trocar: whether it is stable, what is felt, and its course.

    >>> loop = trocar.teleop(model)
    >>> loop.felt_force_n.shape == loop.depth_m.shape
    True
    """

    #: Whether the loop comes to rest after pushes and pulls.
    settles: bool
    #: What it does not come to rest after: "push_into_tissue", "pull_off_tissue", "push_without_tissue" or
    #: "pull_without_tissue"; None if it does.
    unsettled_by: Optional[str]
    #: Figures of merit along the motion; None if the loop is unstable.
    figures: Optional[Merit]
    #: Ranges of the tissue's stiffness with which the loop is stable, smallest and greatest, N/m; None without tissue.
    z_width_n_m: Optional[_Ranges]
    #: When a device left 10 m or 100 m/s, s; None if the loop did not diverge.
    unstable_after_s: Optional[float]
    #: Results of ``advise``, ``map`` and ``hybrid``; None where not requested.
    advice: Optional[Advice]
    map: Optional[StabilityMap]
    hybrid: Optional[HybridMatrix]
    #: The loop with all its keys.
    config: Mapping[str, Any] = field(repr=False)
    #: The contents of summary.json.
    summary: Mapping[str, Any] = field(repr=False)
    _work: partial[_core.Studied] = field(repr=False)
    _course: Optional[dict[str, _Array]] = field(repr=False)
    _warnings: tuple[str, ...] = field(repr=False)

    @classmethod
    def _of(cls, done: _core.Studied, work: partial[_core.Studied]) -> Teleoperation:
        summary = json.loads(done.summary_json())
        course, hybrid = done.course(), done.hybrid()
        width, advice, found = summary["z_width_n_m"], summary["advice"], summary["map"]
        result = cls(
            settles=summary["settles"],
            unsettled_by=summary["unsettled_by"],
            figures=Merit._of(summary["figures"]),
            z_width_n_m=None if width is None else _ranges(width),
            unstable_after_s=summary["unstable_after_s"],
            advice=None if advice is None else Advice._of(advice),
            map=None if found is None else StabilityMap._of(found),
            hybrid=None if hybrid is None else HybridMatrix._of(dict(hybrid)),
            config=summary["config"],
            summary=summary,
            _work=work,
            _course=None if course is None else dict(course),
            _warnings=tuple(done.warnings()),
        )
        return result._with(done)  # type: ignore[no-any-return]

    @property
    def is_stable(self) -> bool:
        """Whether the loop comes to rest after pushes and pulls, and did not diverge along the motion."""
        return self.figures is not None

    @property
    def is_doubtful(self) -> bool:
        """Whether there are warnings: the loop is unstable, does not touch its tissue, or nothing can be advised."""
        return bool(self.warnings)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes the result doubtful, as sentences."""
        refusals = [self.advice.refusal] if self.advice is not None and self.advice.fraction is None else []
        return (*self._warnings, *refusals)

    def columns(self) -> dict[str, _Array]:
        """The course of the loop, a row for each sample, as the table of the command line has it.

        :raises TrocarError: if the loop diverged
        """
        if self._course is None:
            time = f"{self.unstable_after_s:.4g}"
            hint = "hint: advise=True finds the fractions of the trocar's force with which it is stable"
            raise TrocarError(f"there is no course: the loop diverged after {time} s\n\n{hint}")
        return dict(self._course)

    def __getitem__(self, name: str) -> _Array:
        columns = self.columns()
        if name not in columns:
            raise KeyError(f"no column {name!r}; there are {', '.join(columns)}")
        return columns[name]

    def to_frame(self) -> Any:
        """``columns`` as a data frame, by time: pandas', or polars'.

        :raises ImportError: if neither pandas nor polars is installed
        """
        return _report.frame(self.columns(), "time_s")

    def save(self, folder: _Path) -> None:
        """Writes summary.json, course.parquet, report.html and figures into a folder, and hybrid.parquet with ``hybrid``.

        Either all of them are written or none. A loop that diverged has no course.
        """
        self._repeated().save(folder)

    def report(self, path: _Path) -> None:
        """Writes the report as one self-contained HTML file."""
        self._repeated().report(path)

    @property
    def felt_force_n(self) -> _Array:
        """Force that the operator feels along the course, N (see ``Merit``)."""
        is_four_channel = self.config["control"]["architecture"] == "four_channel"
        return self["operator_force_n" if is_four_channel else "leader_force_n"]

    @property
    def depth_m(self) -> _Array:
        """Position of the tip beyond the surface of the tissue at rest, m, along the course."""
        depth: _Array = self["follower_position_m"] - self.config["tissue"]["surface_m"]
        return depth

    def plot(self, ax: Any = None) -> Any:
        """Force felt and force on the tissue, N, over time, s, and over the depth of the tip, mm.

        :param ax: two axes of matplotlib to draw into, or one for the forces over time alone; by
            default those of a new figure
        :returns: the axes
        :raises ImportError: if matplotlib is not installed
        :raises TrocarError: if the loop diverged
        """
        return _plot.course(self, ax)

    def __repr__(self) -> str:
        taken_out = f"{100 * self.config['compensation']['fraction']:.4g} % of the trocar's force compensated"
        if self.unstable_after_s is not None:
            return f"<trocar.Teleoperation: {taken_out}, unstable, diverged after {self.unstable_after_s:.4g} s>"
        if self.figures is None:
            return f"<trocar.Teleoperation: {taken_out}, unstable>"
        error = f"force error {self.figures.force_error_rms_n:.4g} N rms"
        displayed, true = self.figures.displayed_stiffness_n_m, self.figures.true_stiffness_n_m
        if displayed is None or true is None:
            return f"<trocar.Teleoperation: {taken_out}, no contact, {error}>"
        return f"<trocar.Teleoperation: {taken_out}, {displayed:.4g} N/m displayed for {true:.4g} N/m, {error}>"

    def _repr_html_(self) -> str:
        return _show.teleoperation(self)
