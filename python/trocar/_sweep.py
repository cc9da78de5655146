"""Sweeps; the package shows the function as its own."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Callable, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _core
from ._arrays import count
from ._core import Model, SweepError
from .results import SweepTable

_Path = Union[str, "os.PathLike[str]"]


def sweep(
    config: Union[_Path, Mapping[str, Any]],
    *,
    out: Optional[_Path] = None,
    traces: Optional[_Path] = None,
    seed: Optional[int] = None,
    threads: int = 0,
    progress: Optional[Callable[[str, float], object]] = None,
) -> SweepTable:
    """One model many times, with parameters of seal and rig drawn at random or taken from a grid: ``trocar sweep``.

    A row depends on the document and on its number alone: the same document and seed give the same table on any number of
    threads, and the file of the command line, byte for byte. A run whose parameters make no model is a row with its reason.

    :param config: what to vary: path of a TOML file, its text (of several lines), or a dictionary of the same keys, whose ``model`` may
        also be a ``Model``; ``sweep_config()`` gives an example that describes every key. Files that a text or a dictionary
        names are sought in the current directory
    :param out: the table: .parquet, .arrow, .csv, .csv.gz or .csv.zst; it appears whole or not at all. Nothing is then kept in memory,
        however many rows there are
    :param traces: folder for time, position and force of each run, a Parquet file each
    :param seed: in place of that of the document
    :param threads: to work on; 0 takes one for each processor, and there are at most four for each, or 64
    :param progress: called with the stage and the part done, 0 to 1, on the calling thread
    :raises SweepError: for a document that cannot be understood
    """
    text, name, folder, model = _document(config)
    rows, failed, first_failure, table = _core.sweep(
        text,
        is_json=isinstance(config, Mapping),
        name=name,
        folder=folder,
        model=model,
        out=None if out is None else os.path.abspath(out),
        traces=None if traces is None else os.path.abspath(traces),
        seed=None if seed is None else count("seed", seed),
        threads=count("threads", threads),
        progress=progress,
    )
    columns = None if table is None else {name: _cells(cells) for name, cells in table}
    return SweepTable(rows, failed, first_failure, None if out is None else Path(out), columns)


def _cells(cells: Any) -> npt.NDArray[Any]:
    return cells if isinstance(cells, np.ndarray) else np.array(cells, dtype=object)


def _document(config: Union[_Path, Mapping[str, Any]]) -> tuple[str, Optional[str], str, Optional[Model]]:
    """Text of a sweep, what to call it, where its files are, and its model if there is one already."""
    if isinstance(config, Mapping):
        given = dict(config)
        model = given.pop("model") if isinstance(given.get("model"), Model) else None
        try:
            return json.dumps(given, default=_plain, allow_nan=False), None, "", model
        except ValueError as error:
            raise SweepError(f"config: numbers must be finite ({error})") from error
    if isinstance(config, str) and "\n" in config:
        return config, None, "", None
    if not isinstance(config, (str, os.PathLike)):
        raise TypeError(f"config must be a path, a TOML text or a dictionary, got {type(config).__name__}")
    path = os.fspath(config)
    with open(path, encoding="utf-8") as file:
        return file.read(), str(path), os.path.dirname(path), None


def _plain(value: Any) -> Any:
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"config: a number, text, list or dictionary is expected, got {type(value).__name__}")
