"""Parameter sweeps; the package re-exports the function."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _core
from ._arrays import count, plain
from ._core import Model, SweepError
from ._progress import Progress, watched
from .results import Posterior, SweepTable

_Path = Union[str, "os.PathLike[str]"]


def sweep(
    config: Union[_Path, Mapping[str, Any]],
    *,
    out: Optional[_Path] = None,
    traces: Optional[_Path] = None,
    seed: Optional[int] = None,
    threads: int = 0,
    progress: Union[Progress, bool, None] = None,
) -> SweepTable:
    """Simulates one model many times, with parameters of seal and rig drawn at random or taken from a grid (``trocar sweep``).

    A row depends only on the configuration and on the row number. The same configuration and seed therefore give the same table
    on any number of threads, byte for byte equal to the file of the command line. If the parameters of a run do not give a
    valid model, its row contains the reason.

    :param config: what to vary: path of a TOML file, TOML text (of several lines), or a dictionary with the same keys, whose ``model``
        may also be a ``Model``, and whose ``posterior`` a ``Posterior``. ``sweep_config()`` gives an example that describes every key. Relative paths in a text or a
        dictionary refer to the current directory
    :param out: file for the table: .parquet, .arrow, .csv, .csv.gz or .csv.zst. It is written completely or not at all. The table is
        then not kept in memory, so the number of rows is not limited by it
    :param traces: folder for time, position and force of each run, one Parquet file per run
    :param seed: replaces the seed of the configuration
    :param threads: number of threads; 0 takes one per processor. At most four per processor, or 64 if that is more, are used
    :param progress: called on the calling thread with the stage and the fraction done, 0 to 1. By
        default a bar is shown in a terminal, and in a notebook with tqdm and ipywidgets; False
        shows none
    :raises SweepError: if the configuration is invalid
    """
    text, name, folder, model, posterior = _document(config)
    with watched(progress) as watching:
        rows, failed, first_failure, table = _core.sweep(
            text,
            is_json=isinstance(config, Mapping),
            name=name,
            folder=folder,
            model=model,
            posterior=posterior,
            out=None if out is None else os.path.abspath(out),
            traces=None if traces is None else os.path.abspath(traces),
            seed=None if seed is None else count("seed", seed),
            threads=count("threads", threads),
            progress=watching,
        )
    columns = None if table is None else {name: _cells(cells) for name, cells in table}
    return SweepTable(rows, failed, first_failure, None if out is None else Path(out), columns)


def _cells(cells: Any) -> npt.NDArray[Any]:
    return cells if isinstance(cells, np.ndarray) else np.array(cells, dtype=object)


def _document(config: Union[_Path, Mapping[str, Any]]) -> tuple[str, Optional[str], str, Optional[Model], Optional[Posterior]]:
    """Text of a sweep, its name, the folder of its files, and its model and draws if they were given as objects."""
    if isinstance(config, Mapping):
        given = dict(config)
        model = given.pop("model") if isinstance(given.get("model"), Model) else None
        posterior = given.pop("posterior") if isinstance(given.get("posterior"), Posterior) else None
        try:
            return json.dumps(given, default=plain, allow_nan=False), None, "", model, posterior
        except ValueError as error:
            raise SweepError(f"config: numbers must be finite ({error})") from error
    if isinstance(config, str) and "\n" in config:
        return config, None, "", None, None
    if not isinstance(config, (str, os.PathLike)):
        raise TypeError(f"config must be a path, a TOML text or a dictionary, got {type(config).__name__}")
    path = os.fspath(config)
    with open(path, encoding="utf-8") as file:
        return file.read(), str(path), os.path.dirname(path), None, None
