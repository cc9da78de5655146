"""Conversion of array-like input to columns; the native part calls it if it cannot use an array directly."""

from __future__ import annotations

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

_HINTS = {
    "m": "\n\nhint: give seconds, for example column.dt.total_seconds()",
    "M": "\n\nhint: give seconds from the start, for example (column - column.iloc[0]).dt.total_seconds()",
    "O": "\n\nhint: is there a None, or a text, among the numbers?",
}


def column(name: str, values: Any) -> npt.NDArray[np.float64]:
    """``values`` as contiguous float64; missing values become nan."""
    found = array(name, values)
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
