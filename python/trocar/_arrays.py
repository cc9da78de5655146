"""Conversion of array-like input to columns; the native part calls it if it cannot use an array directly."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ._core import ArrayError, ParameterError

#: Kinds of NumPy's numeric types: signed integer, unsigned integer, floating point.
_NUMBERS = "iuf"

_KINDS = {
    "b": "truth values",
    "c": "complex numbers",
    "m": "time differences",
    "M": "dates",
    "O": "objects",
    "S": "bytes",
    "U": "text",
    "V": "records",
}

_HINTS = {"O": "\n\nhint: is there a None, or a text, among the numbers?"}

#: Sign and factor in front of the name of a column, such as -22.2*U.
_SCALED = re.compile(r"(-?\s*(?:[0-9.]+(?:[eE][+-]?[0-9]+)?\s*\*)?)(.*)", re.DOTALL)
#: Our names in a mapping of columns, such as position_mm.
_OURS = re.compile(r"(time|position|force|velocity)(_\w+)?", re.IGNORECASE)


def column(name: str, values: Any) -> npt.NDArray[np.float64]:
    """``values`` as contiguous float64; missing values become nan, dates and durations seconds."""
    found = seconds(values) if name == "time_s" else None
    found = array(name, values) if found is None else found
    if found.dtype.kind not in _NUMBERS:
        kind_ = found.dtype.kind
        raise ArrayError(f"{name} must hold numbers, got {_KINDS.get(kind_, found.dtype)}{_HINTS.get(kind_, '')}")
    if found.ndim != 1:
        raise ArrayError(f"{name} must have one dimension, got shape {found.shape}")
    return np.require(found, dtype=np.float64, requirements=["C_CONTIGUOUS", "ALIGNED"])


def array(name: str, values: Any) -> npt.NDArray[Any]:
    """``values`` as an array of any kind; masked or missing values become nan."""
    if isinstance(values, np.ma.MaskedArray):
        return np.ma.asarray(values, dtype=np.float64).filled(np.nan)
    kind_ = getattr(getattr(values, "dtype", None), "kind", None)
    if kind_ in ("i", "u", "f") and hasattr(values, "to_numpy") and hasattr(values, "iloc"):
        # pandas: its own types may contain NA.
        return np.asarray(values.to_numpy(dtype="float64", na_value=np.nan))
    try:
        return np.asarray(values.to_numpy() if hasattr(values, "to_numpy") else values)
    except (TypeError, ValueError) as error:
        raise ArrayError(f"{name} must be a row of numbers: {error}") from error


def seconds(values: Any) -> npt.NDArray[np.float64] | None:
    """Dates in s after the first, durations in s; missing ones become nan. None for the rest."""
    if isinstance(values, np.ndarray) and values.dtype.kind not in "mM":
        return None
    kind_ = getattr(getattr(values, "dtype", None), "kind", None)
    # pandas' dates with a time zone are objects to NumPy.
    is_pandas = kind_ == "M" and hasattr(values, "array")
    found = values.to_numpy(dtype="datetime64[ns]") if is_pandas else array("time_s", values)
    if found.dtype.kind == "M":
        known = found[~np.isnat(found)]
        found = found - known[0] if len(known) else found - found
    return found / np.timedelta64(1, "s") if found.dtype.kind == "m" else None


def count(name: str, value: int) -> int:
    """``value``, if it is an integer in the range of the native part."""
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    if not 0 <= value < 2**64:
        raise ParameterError(f"{name} must be a whole number from 0 on, got {value}")
    return value


def kind(values: Any) -> str:
    """Description of ``values`` for messages."""
    if isinstance(values, np.ndarray):
        order = "" if values.dtype.isnative else " in foreign byte order"
        return f"an array of {values.dtype.name}{order} of shape {values.shape}"
    return f"{type(values).__name__}"


def json_text(values: Any) -> str:
    """``values`` of a dictionary as JSON; its numbers may be NumPy's."""
    if not isinstance(values, Mapping):
        raise TypeError(f"expected a dictionary, got {type(values).__name__}")
    try:
        return json.dumps(dict(values), default=plain, allow_nan=False)
    except ValueError as error:
        raise ParameterError(f"numbers must be finite ({error})") from error


def plain(value: Any) -> Any:
    """``value`` as JSON takes it."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, Mapping):
        return dict(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a number, text, list or dictionary is expected, got {type(value).__name__}")


def columns_in_words(columns: Any) -> str:
    """``columns`` as the native part takes it: a text as it is, a mapping as ``ours=theirs``."""
    if isinstance(columns, str):
        return columns
    texts = isinstance(columns, Mapping) and [item for pair in columns.items() for item in pair]
    if not texts or not all(isinstance(text, str) for text in texts):
        raise TypeError(f"columns must be a text or a dictionary of texts, got {columns!r}")
    pairs = columns.items()
    if any(_OURS.fullmatch(theirs) and not _OURS.fullmatch(ours) for ours, theirs in pairs):
        right = {theirs: ours for ours, theirs in columns.items()}
        what = "columns maps our names to those of the columns"
        raise ParameterError(f"{what}: columns={right}, got {dict(columns)}")

    def entry(ours: str, theirs: str) -> str:
        scaled = _SCALED.match(theirs)
        front, name = scaled.groups() if scaled else ("", theirs)
        quoted = "," in name or '"' in name or name.strip() != name
        return f'{ours}={front}"{name}"' if quoted else f"{ours}={front}{name}"

    return ",".join(entry(*pair) for pair in columns.items())


def table(frame: Any) -> Any:
    """``frame``, or for a data set or array of xarray the dictionary of its columns."""
    if hasattr(frame, "to_dataset") and hasattr(frame, "dims"):
        labelled = [dim for dim in frame.dims if dim in frame.coords]
        named = [dim for dim in labelled if frame[dim].dtype.kind in "OUT"]
        if len(named) != 1 or frame.ndim != 2:
            what = "a DataArray needs a dimension of samples and one that names the columns"
            raise TypeError(what)
        frame = frame.to_dataset(dim=named[0])
    if hasattr(frame, "data_vars"):
        return {name: frame[name] for name in frame.variables if frame[name].ndim == 1}
    return frame


def described(frame: Any) -> tuple[list[str], list[str], list[int]]:
    """Names of the columns, units that xarray declares, indices of dates and durations."""
    found = names(frame)
    columns = [series(frame, index) for index in range(len(found))]
    units = [str(getattr(values, "attrs", {}).get("units", "")) for values in columns]
    return found, units, [index for index, values in enumerate(columns) if _are_times(values)]


def _are_times(values: Any) -> bool:
    """By the names that NumPy, pandas, polars and Arrow give to such types."""
    kind_ = str(getattr(values, "dtype", getattr(values, "type", ""))).lower()
    return kind_.startswith(("datetime", "timedelta", "timestamp", "duration"))


def with_index(frame: Any) -> dict[str, Any] | None:
    """A pandas data frame's columns after its index, if that has dates or a name; or None."""
    index: Any = getattr(frame, "index", None)
    if not hasattr(frame, "iloc") or getattr(index, "ndim", 0) != 1:
        return None
    name = "time_s" if index.dtype.kind in "mM" else index.name
    columns = {own: series(frame, k) for k, own in enumerate(names(frame))}
    return None if name is None else {str(name): index, **columns}


def names(frame: Any) -> list[str]:
    """Names of the columns of a data frame, a table, a record array or a dictionary, in order."""
    if isinstance(frame, Mapping):
        found: Any = frame.keys()
    elif hasattr(frame, "column_names"):
        found = frame.column_names
    elif hasattr(frame, "collect") and not hasattr(frame, "to_series"):
        raise TypeError(f"{type(frame).__name__} holds no data yet; call its collect() first")
    elif hasattr(frame, "columns"):
        found = frame.columns
    elif getattr(getattr(frame, "dtype", None), "names", None):
        found = frame.dtype.names
    else:
        raise TypeError(f"expected a data frame or a dictionary of columns, got {type(frame).__name__}")
    return [str(name) for name in found]


def series(frame: Any, index: int) -> Any:
    """The column at ``index`` of any object that ``names`` accepts."""
    if isinstance(frame, Mapping):
        return list(frame.values())[index]
    if hasattr(frame, "column_names"):
        return frame.column(index)
    if hasattr(frame, "iloc"):
        return frame.iloc[:, index]
    if hasattr(frame, "to_series"):
        return frame.to_series(index)
    return frame[names(frame)[index]]
