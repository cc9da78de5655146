"""Identification, validation and simulation of the friction force between an instrument and a trocar.

    import trocar

    recording = trocar.read("strokes.csv")          # or trocar.Recording(time_s, position_m, force_n), .from_frame(df)
    found = trocar.identify([recording])
    found.parameters["coulomb_force_n"]             # value, unit, 95 % interval
    force_n = trocar.simulate(found.model, time_s, position_m)

All quantities are in SI units, and each name includes its unit. Position and force are positive on insertion; the force
is the one that the instrument exerts on the seal. Invalid input raises ``TrocarError`` (a ``ValueError``) or a subclass,
and leaves no partial results. Not a medical device.

The book in the folder ``docs`` of the repository goes on from here: tutorials, recipes, and ``docs/reference/python.md``.
"""

from __future__ import annotations

import json
import os
import warnings as _python_warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from numbers import Real
from typing import TYPE_CHECKING, Optional, Union

from . import _core, fleet
from ._core import (
    ArrayError,
    BenchError,
    CompareError,
    Compensator,
    IdentifyError,
    InternalError,
    Model,
    ModelFileError,
    MotionError,
    NotConverged,
    ParameterError,
    PlanError,
    Recording,
    RecordingError,
    Stepper,
    TeleopError,
    TissueForce,
    TrocarError,
    Tunable,
    __version__,
    bench,
    bench_config,
    read,
    simulate,
)
from ._arrays import column as _column, count as _count
from ._many import simulate_many, squared_error_many
from ._plan import Plan, Prediction, plan, plan_config
from ._progress import Progress as _Progress, watched as _watched
from ._teleop import Advice, HybridMatrix, Merit, NoticeableStep, StabilityMap, Teleoperation, teleop, teleop_config
from .results import (
    ComparedModel,
    Comparison,
    Compensation,
    Covariance,
    Drift,
    Figure,
    Forces,
    Identification,
    Parameter,
    Parameters,
    Posterior,
    RecordingValidation,
    ResultWarning,
    Simulation,
    Validation,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = [
    "Advice",
    "ArrayError",
    "BenchError",
    "CompareError",
    "ComparedModel",
    "Comparison",
    "Compensation",
    "Compensator",
    "Covariance",
    "Drift",
    "Figure",
    "Forces",
    "HybridMatrix",
    "Identification",
    "IdentifyError",
    "InternalError",
    "Merit",
    "Model",
    "ModelFileError",
    "MotionError",
    "NotConverged",
    "NoticeableStep",
    "Parameter",
    "ParameterError",
    "Parameters",
    "Plan",
    "PlanError",
    "Posterior",
    "Prediction",
    "Recording",
    "RecordingError",
    "RecordingValidation",
    "ResultWarning",
    "Simulation",
    "StabilityMap",
    "Stepper",
    "TeleopError",
    "Teleoperation",
    "TissueForce",
    "TrocarError",
    "Tunable",
    "Validation",
    "__version__",
    "bench",
    "bench_config",
    "compare",
    "compensate",
    "fleet",
    "identify",
    "plan",
    "plan_config",
    "read",
    "simulate",
    "simulate_full",
    "simulate_many",
    "squared_error_many",
    "teleop",
    "teleop_config",
    "validate",
]

#: One recording or several.
Recordings = Union[Recording, Iterable[Recording]]
#: Called with the stage of the work and the fraction done, 0 to 1; or whether to show a bar.
Progress = Union[_Progress, bool, None]


def __dir__() -> list[str]:
    return list(__all__)


def identify(
    recordings: Recordings,
    *,
    validate: Optional[Recordings] = None,
    seed: int = 1,
    degrees: Sequence[int] = (4, 4),
    free_motion: bool = True,
    without: Sequence[str] = (),
    offset_n: Optional[float] = None,
    fix: Optional[Mapping[str, Union[float, tuple[float, float]]]] = None,
    shaft_diameter_m: Optional[float] = None,
    paper: bool = False,
    posterior: Optional[int] = None,
    prior: Optional[Model] = None,
    prior_spread: float = 0.3,
    moving_mass_kg: float = 0.0,
    gravity_m_s2: float = 0.0,
    threads: int = 0,
    progress: Progress = None,
) -> Identification:
    """Identifies a model from recordings and validates it on the recordings given as ``validate``.

    Each recording contributes to every parameter that it determines. A parameter that the recordings do not determine has
    an infinite interval and a warning.

    :param seed: seed of all random numbers; equal recordings and seed give equal results
    :param degrees: degrees of the two joined polynomials of each branch, 2 to 7
    :param free_motion: try the optional model terms that rests and partial reversals determine: creep,
        dwell, relaxation, second_relaxation, minor_loops, second_stage
    :param without: optional model terms not to try: stribeck, stribeck_exponent, seal_damping, minor_loops, creep, dwell, relaxation,
        second_relaxation, unmodelled_mass, side_load, tilt, gas_pressure, asymmetry, second_stage
    :param offset_n: known reading of the sensor without load (its tare); estimated if not given
    :param fix: parameters that keep a value, or a range (low, high), in the unit of their name: ``{"half_width_m": 0.006}``
    :param shaft_diameter_m: also identifies how the seal resists rotation, from recordings with an angle, and a torque if there
        is one, in addition to strokes without turning
    :param paper: use only the two identification steps of the paper
    :param posterior: number of draws of the parameters from their posterior, a multiple of 4 from 400; None takes none
    :param prior: model of a trocar of the same type, whose parameters the recordings update
    :param prior_spread: spread of the friction between trocars of that type, relative
    :param moving_mass_kg: mass between sensor and seal; its inertia is subtracted from the readings
    :param gravity_m_s2: component of gravity along the insertion that acts on the reading of that mass, which must be
        above 0; with 0 the weight is part of the offset
    :param threads: number of threads; 0 takes one per processor. At most four per processor, or 64 if that is more, are used
    :param progress: called on the calling thread with the stage and the fraction done, 0 to 1. By
        default a bar is shown in a terminal, and in a notebook with tqdm and ipywidgets; False
        shows none
    :raises IdentifyError: if the recordings contain nothing to identify from

    >>> found = trocar.identify(recording, validate=checks, moving_mass_kg=0.04)
    >>> round(found.parameters["F_c"].value, 1), found.parameters["F_c"].unit
    (3.0, 'N')
    """
    training = _recordings("recordings", recordings)
    held_out = [] if validate is None else _recordings("validate", validate)
    seen = {recording.sha256 for recording in training}
    overlap = [recording.name for recording in held_out if recording.sha256 in seen]
    if overlap:
        text = f"{', '.join(overlap)}: validated on what it was identified from: no validation"
        _python_warnings.warn(text, stacklevel=2)
    work = partial(
        _core.identify,
        training,
        held_out,
        seed=_count("seed", seed),
        degrees=_degrees(degrees),
        free_motion=free_motion,
        without=[without] if isinstance(without, str) else list(without),
        offset_n=offset_n,
        fix=_ranges(fix or {}),
        shaft_diameter_m=shaft_diameter_m,
        paper=paper,
        posterior=None if posterior is None else _count("posterior", posterior),
        prior=prior,
        prior_spread=prior_spread,
        moving_mass_kg=moving_mass_kg,
        gravity_m_s2=gravity_m_s2,
        threads=_count("threads", threads),
        progress=None,
    )
    with _watched(progress) as watching:
        done = work(progress=watching)
    return Identification._of(done, work)


def validate(
    model: Model,
    recordings: Recordings,
    *,
    moving_mass_kg: Optional[float] = None,
    offset_n: Optional[float] = None,
    threads: int = 0,
) -> Validation:
    """Runs a model along the positions of recordings and compares its force with the readings.

    Only samples with a known state of the seal are scored, that is those after it has slid once.

    :param moving_mass_kg: mass whose inertia is subtracted from the readings; by default that of the model's sensor
    :param offset_n: reading at rest without any force of the seal; by default that of the model's sensor

    >>> trocar.validate(found.model, checks).rms_n < 0.05
    True
    """
    scored = _recordings("recordings", recordings)
    options = {"moving_mass_kg": moving_mass_kg, "offset_n": offset_n}
    work = partial(_core.validate, model, scored, **options, threads=_count("threads", threads))
    done = work()
    result = Validation._of(json.loads(done.summary_json()), done.taken_out(), work)
    return result._with(done)  # type: ignore[no-any-return]


def compare(
    recordings: Recordings,
    *,
    validate: Optional[Recordings] = None,
    models: Union[str, Sequence[str]] = "all",
    seed: int = 1,
    timing: bool = False,
    moving_mass_kg: float = 0.0,
    gravity_m_s2: float = 0.0,
    threads: int = 0,
    progress: Progress = None,
) -> Comparison:
    """Fits friction models to the same recordings and scores all of them on the recordings given as ``validate``.

    Without ``validate`` the last third of each recording is held out from the fits and used for scoring.

    :param models: names, separated by commas or in a list: ems, ems-output-error, coulomb, coulomb-viscous, stribeck, dahl,
        bouc-wen, lugre, lugre-rational, leuven, maxwell-slip, gms. The last three accept a number or range of elements, as in gms:4-10
    :param timing: measure the time of a step and of each fit; the results then differ from run to run
    :param progress: as for ``identify``
    :raises NotConverged: if the fit of a model did not converge from any initial value

    >>> both = trocar.compare(recording, validate=checks, models="ems,coulomb", moving_mass_kg=0.04)
    >>> both.best.label
    'ems'
    """
    held_out = [] if validate is None else _recordings("validate", validate)
    work = partial(
        _core.compare,
        _recordings("recordings", recordings),
        held_out,
        models=models if isinstance(models, str) else ",".join(models),
        seed=_count("seed", seed),
        timing=timing,
        moving_mass_kg=moving_mass_kg,
        gravity_m_s2=gravity_m_s2,
        threads=_count("threads", threads),
        progress=None,
    )
    with _watched(progress) as watching:
        done = work(progress=watching)
    return Comparison._of(done, work)


def compensate(
    model: Model,
    recording: Recording,
    *,
    offset_n: Optional[float] = None,
    moving_mass_kg: Optional[float] = None,
    gravity_m_s2: float = 0.0,
    sensor_limit_n: Optional[float] = None,
    force_error_n: Optional[float] = None,
    adaptation: bool = True,
    posterior: Union[Posterior, str, os.PathLike[str], None] = None,
) -> Compensation:
    """Subtracts the trocar force from the readings of a sensor outside the body, which leaves the tissue force.

    The samples are processed in order and causally; ``Compensator`` does the same with live samples. Options that are
    None take their values from the model. The observer tracks friction that has changed since the identification, unless
    ``adaptation`` is False. The recording has the sign of the model: where the sensor counts the other way round, it was
    made with ``flip_force``.

    :param offset_n: reading of the sensor without any force, with the sign of the recording
    :param moving_mass_kg: mass between sensor and seal; its inertia is subtracted
    :param gravity_m_s2: gravity as it acts on the reading of that mass; 0 if the weight is part of the offset, as it is of that
        of the model: with gravity, state ``offset_n`` without the weight
    :param sensor_limit_n: largest force that the sensor can read; readings at this limit give no tissue force
    :param force_error_n: standard deviation of the model's force; by default the value of the model, by phase
    :param posterior: draws of the model's parameters, or their file: ``std_n`` has the error of the parameters from their
        forces, in place of the intervals of the model

    >>> along = trocar.compensate(found.model, checks)
    >>> bool(np.nanstd(along.tissue_force_n) < 0.1)  # nothing was touched
    True
    """
    (scored,) = _recordings("recording", recording)
    columns = (scored.time_s, scored.position_m, scored.force_n)
    angle_rad = scored.angle_rad
    estimate, drift = _core.compensate(
        model,
        *columns,
        angle_rad=angle_rad,
        offset_n=offset_n,
        flip_force=False,
        moving_mass_kg=moving_mass_kg,
        gravity_m_s2=gravity_m_s2,
        sensor_limit_n=sensor_limit_n,
        force_error_n=force_error_n,
        adaptation=adaptation,
        posterior=posterior,
    )
    found = Compensation._of(columns, estimate, drift)
    if found.torque_n_m is not None and angle_rad is None:
        text = f"{scored.name}: no angle, and the model has 'rotation': the instrument is taken not to turn"
        _python_warnings.warn(text, stacklevel=2)
    return found


def simulate_full(
    model: Model,
    time_s: ArrayLike,
    position_m: ArrayLike,
    *,
    initial_force_n: Optional[float] = None,
    initial_deflection_m: Optional[float] = None,
) -> Simulation:
    """Like ``simulate``, and also returns the deflection of the seal and whether it slides.

    >>> run = trocar.simulate_full(model, [0.0, 0.1, 0.2], [0.0, 0.004, 0.02])
    >>> run.mode.tolist()
    ['deforming', 'deforming', 'sliding']
    """
    time, position = _column("time_s", time_s), _column("position_m", position_m)
    options = {"initial_force_n": initial_force_n, "initial_deflection_m": initial_deflection_m}
    force, deformation = _core.simulate_full(model, time, position, **options)
    deflection, sliding = deformation or (None, None)
    return Simulation(time, position, force, deflection, sliding)


def _recordings(name: str, given: Recordings) -> list[Recording]:
    if isinstance(given, Recording):
        return [given]
    if isinstance(given, (str, bytes, os.PathLike)):
        raise TypeError(f"{name}: expected recordings, got a path; read it with trocar.read({given!r})")
    if hasattr(given, "columns"):
        raise TypeError(f"{name}: expected recordings, got a data frame; use trocar.Recording.from_frame(frame)")
    found = list(given)
    for item in found:
        if not isinstance(item, Recording):
            raise TypeError(f"{name}: expected trocar.Recording, got {type(item).__name__}")
    return found


def _ranges(fix: Mapping[str, Union[float, tuple[float, float]]]) -> list[tuple[str, tuple[float, float]]]:
    ranges = []
    for name, given in fix.items():
        ends = tuple(given) if isinstance(given, (tuple, list)) else (given, given)
        if len(ends) != 2 or not all(isinstance(end, Real) for end in ends):
            raise ParameterError(f"fix: {name} must be a number or two, (low, high), got {given!r}")
        ranges.append((str(name), (float(ends[0]), float(ends[1]))))
    return ranges


def _degrees(degrees: Sequence[int]) -> tuple[int, int]:
    if isinstance(degrees, (str, bytes)) or len(degrees) != 2:
        raise ParameterError(f"degrees must be two numbers such as (4, 4), got {degrees!r}")
    return _count("degrees", degrees[0]), _count("degrees", degrees[1])
