"""Simulation of many models along one motion; the package re-exports these functions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _core
from ._arrays import array, column, count as count_of, names, series
from ._core import Model

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: One model or several.
Models = Union[Model, Iterable[Model]]
_Array = npt.NDArray[np.float64]
_Columns = Optional[list[tuple[str, _Array]]]


def simulate_many(
    models: Models,
    time_s: ArrayLike,
    position_m: ArrayLike,
    *,
    parameters: Any = None,
    initial_force_n: Optional[float] = None,
    initial_deflection_m: Optional[float] = None,
    out: Optional[_Array] = None,
    threads: int = 0,
) -> _Array:
    """Forces of many models along one motion, N: an array with one row per model and one column per sample.

    Each row equals the result of ``simulate`` for that model, bit for bit. The models are stepped in parallel on all cores.

    :param models: a list of models; or one model, from which ``parameters`` makes many
    :param parameters: columns of values with the names of ``Model.tunables``, as a dictionary, a data frame or a record array. Row i
        gives the model ``model.tuned(**row)``; a single number applies to all rows. Hundreds of thousands of rows are
        possible, because no Python object is created per model
    :param out: array for the result: contiguous, writable, float64, of that shape
    :param threads: number of threads; 0 takes one per processor

    >>> models = [model.tuned(F_c=force) for force in (2.0, 4.0)]
    >>> trocar.simulate_many(models, [0.0, 0.4], [0.0, 0.02]).round(2).tolist()
    [[0.0, 2.25], [0.0, 4.25]]
    """
    own, columns, count = _ensemble(models, parameters)
    time, position = column("time_s", time_s), column("position_m", position_m)
    if out is None:
        out = np.empty((count, len(time)))
    options = {"initial_force_n": initial_force_n, "initial_deflection_m": initial_deflection_m}
    _core.run_many(own, columns, time, position, None, **options, out=out, threads=count_of("threads", threads))
    return out


def squared_error_many(
    models: Models,
    time_s: ArrayLike,
    position_m: ArrayLike,
    force_n: ArrayLike,
    *,
    parameters: Any = None,
    initial_force_n: Optional[float] = None,
    initial_deflection_m: Optional[float] = None,
    out: Optional[_Array] = None,
    threads: int = 0,
) -> _Array:
    """Residual sum of squares of each of many models against readings, N².

    A Monte Carlo study, an ABC sampler or a particle filter needs this number for each draw. The forces are not stored.
    Each sum is Σ(force_n - simulate(model, ...))², from the first sample to the last; the rms error is the square root of the
    sum divided by the number of readings. The forces are those on the seal: subtract the sensor's offset and the inertia of
    a moving mass first. Readings that are nan are left out.

    :param models: as for ``simulate_many``, like ``parameters``
    :param force_n: measured forces, N

    >>> models = [model.tuned(F_c=force) for force in (2.0, 4.0)]
    >>> trocar.squared_error_many(models, [0.0, 0.4], [0.0, 0.02], [0.0, 3.25]).round(2).tolist()
    [1.0, 1.0]
    """
    own, columns, count = _ensemble(models, parameters)
    if out is None:
        out = np.empty(count)
    _core.run_many(
        own,
        columns,
        time_s,
        position_m,
        force_n,
        initial_force_n=initial_force_n,
        initial_deflection_m=initial_deflection_m,
        out=out,
        threads=count_of("threads", threads),
    )
    return out


def _ensemble(models: Models, parameters: Any) -> tuple[list[Model], _Columns, int]:
    """Models, columns of parameters, and the resulting number of models."""
    own = [models] if isinstance(models, Model) else list(models)
    for item in own:
        if not isinstance(item, Model):
            raise TypeError(f"models: expected trocar.Model, got {type(item).__name__}")
    if parameters is None:
        return own, None, len(own)
    given = [(name, array(name, series(parameters, index))) for index, name in enumerate(names(parameters))]
    counts = {name: len(values) for name, values in given if values.ndim > 0}
    count = next(iter(counts.values()), 1)
    columns = [(name, column(name, np.atleast_1d(values))) for name, values in given]
    return own, [(name, c if name in counts else np.full(count, c[0])) for name, c in columns], count
