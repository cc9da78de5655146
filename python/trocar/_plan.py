"""What motion to record; the package re-exports what is public."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _core, _report, _show
from ._arrays import count
from ._core import Model, PlanError, Recording
from ._keys import as_json, document, merged
from ._progress import Progress, watched
from .results import Posterior

_Path = Union[str, "os.PathLike[str]"]
_Array = npt.NDArray[np.float64]


def plan(
    config: Union[_Path, Mapping[str, Any], None] = None,
    *,
    goal: str = "all",
    model: Optional[Model] = None,
    posterior: Union[Posterior, _Path, None] = None,
    after: Union[Recording, Iterable[Recording]] = (),
    threads: int = 0,
    progress: Union[Progress, bool, None] = None,
    **changes: Any,
) -> Plan:
    """Plans what motion to record, so that the parameters are known best after it (``trocar plan``).

    The motion is chosen by the information that the likelihood of ``identify`` has about the goal, averaged over the seals
    that are expected. The same rig and goal give the same motion as the command line.

        planned = trocar.plan(duration_s=60.0, prior={"like": "dobbelsteen-2007"})
        planned.expected["viscous_damping_n_s_m"].half_width
        planned.time_s, planned.position_m                       # the motion, at the rate of the rig

    :param config: rig, noise and expected seals, in SI units: path of a TOML file, TOML text (of several lines), or a
        dictionary with the same keys and sections. Keys left out keep their defaults. ``plan_config()`` gives a text that
        describes every key. Without it, the limits of the rig are those of the first recording of ``after``
    :param goal: what for: "all" (parameters), "compensation" (the force along a hand's motion), or a parameter, with a
        precision or without ("viscous_damping_n_s_m", "half_width_m:5%")
    :param model: model of the seal, from a pilot; without it, seals drawn from the prior of ``config``
    :param posterior: draws of the parameters of ``model``, or their file: the motion is planned for as many of them as the
        key ``draws`` says, in place of the model itself
    :param after: recordings that are there already; with ``model``
    :param threads: number of threads; 0 takes one per processor. At most four per processor, or 64 if that is more, are used
    :param progress: called on the calling thread with the stage and the fraction done, 0 to 1. By
        default a bar is shown in a terminal, and in a notebook with tqdm and ipywidgets; False
        shows none
    :param changes: keys and sections that replace those of ``config``; a section changes only the keys it has
    :raises PlanError: if there is no such motion: an unknown key or goal, a value out of its range, too little time or travel

    >>> planned = trocar.plan(duration_s=60.0, model=model)
    >>> planned.duration_s <= 60.0 and not planned.is_doubtful
    True
    """
    recordings = [after] if isinstance(after, Recording) else list(after)
    if recordings and model is None:
        raise PlanError("after needs the model of the seal that was recorded\n\nhint: model=trocar.identify(...).model")
    if posterior is not None and model is None:
        raise PlanError("posterior needs the model whose parameters were drawn\n\nhint: model=trocar.identify(...).model")
    text, file, keys = document(config, {})
    with watched(progress) as watching:
        summary, columns = _core.plan(
            text=text,
            name=file,
            changes=as_json(merged(keys, changes), PlanError),
            goal=goal,
            model=model,
            posterior=posterior,
            after=recordings,
            threads=count("threads", threads),
            progress=watching,
        )
    return Plan._of(json.loads(summary), *columns)


def plan_config() -> str:
    """Rig, noise and expected seals with every key at its default, as a documented TOML text.

    >>> "duration_s" in trocar.plan_config()
    True
    """
    return _core.plan_example()


@dataclass(frozen=True)
class Prediction:
    """What to expect of a parameter, SI: medians over the seals that are expected.

    >>> planned = trocar.plan(duration_s=60.0, model=model)
    >>> planned.expected["half_width_m"].determined
    True
    """

    value: float
    #: Standard deviation of its estimate, and half width of its 95 % interval.
    standard_deviation: float
    half_width: float
    #: Half width for the seal for which it is largest.
    largest_half_width: float
    #: Half width over the value; None where the value is 0.
    relative_half_width: Optional[float]
    #: Whether the motion determines it.
    determined: bool

    @classmethod
    def _all(cls, found: Iterable[Mapping[str, Any]]) -> dict[str, Prediction]:
        return {row["name"]: cls(**{own.name: row[own.name] for own in fields(cls)}) for row in found}

    _repr_html_ = _show.fields


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion to record, with what it will tell.

    >>> planned = trocar.plan(duration_s=60.0, model=model)
    >>> again = trocar.bench(motion=(planned.time_s, planned.position_m))  # or on your rig
    """

    #: What the motion is for.
    goal: str
    #: The motion at the rate of the rig.
    time_s: _Array
    position_m: _Array
    #: Angle of the instrument, rad; None on a rig that does not turn it (``rig.turning_rad_s``).
    angle_rad: Optional[_Array]
    #: What to expect after it, by the names of the parameters; of rotation, for a seal as stiff and rough around the shaft as
    #: along it.
    expected: Mapping[str, Prediction]
    #: The same of the paper's protocol on this rig, without rotation, and its duration, s; None where the rig cannot make it.
    paper: Optional[Mapping[str, Prediction]]
    paper_duration_s: Optional[float]
    #: Time after which the precision of the goal is expected, s; None for a goal without one.
    needed_s: Optional[float]
    #: Rig, noise and prior with all their keys.
    config: Mapping[str, Any] = field(repr=False)
    #: The contents of the JSON of the command line, the order of the cycles (``segments``) and ``config``.
    summary: Mapping[str, Any] = field(repr=False)

    @classmethod
    def _of(
        cls, summary: Mapping[str, Any], time_s: _Array, position_m: _Array, angle_rad: Optional[_Array] = None
    ) -> Plan:
        paper = summary["paper_expected"]
        return cls(
            goal=summary["goal"],
            time_s=time_s,
            position_m=position_m,
            angle_rad=angle_rad,
            expected=Prediction._all(summary["expected"]),
            paper=None if paper is None else Prediction._all(paper),
            paper_duration_s=summary["paper_duration_s"],
            needed_s=summary["needed_s"],
            config=summary["config"],
            summary=summary,
        )

    @property
    def duration_s(self) -> float:
        """Time of the motion, s."""
        return float(self.summary["duration_s"])

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that the motion will not determine, without the coefficients of the branches."""
        return tuple(name for name, p in self.expected.items() if not p.determined and "theta" not in name)

    @property
    def is_doubtful(self) -> bool:
        """Whether there is a parameter that the motion will not determine."""
        return bool(self.undetermined)

    def columns(self) -> dict[str, _Array]:
        """The motion, a row for each sample, as the table of the command line has it."""
        angle = {} if self.angle_rad is None else {"angle_rad": self.angle_rad}
        return {"time_s": self.time_s, "position_m": self.position_m, **angle}

    def to_frame(self) -> Any:
        """``columns`` as a data frame, by time: pandas', or polars'.

        :raises ImportError: if neither pandas nor polars is installed
        """
        return _report.frame(self.columns(), "time_s")

    def __repr__(self) -> str:
        lost = f", will not determine {', '.join(self.undetermined)}" if self.undetermined else ""
        return f"<trocar.Plan: for {self.goal}, {self.duration_s:.4g} s, {len(self.summary['segments'])} cycles{lost}>"

    def _repr_html_(self) -> str:
        return _show.plan(self)
