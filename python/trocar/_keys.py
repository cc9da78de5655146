"""Configurations as a path, a text or a dictionary, and the keys that change them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from typing import Any, Optional, Union

from ._arrays import plain

_Path = Union[str, "os.PathLike[str]"]


def document(
    config: Union[_Path, Mapping[str, Any], None],
    presets: Mapping[str, str],
) -> tuple[Optional[str], Optional[str], Mapping[str, Any]]:
    """Text of a configuration, its name, and the keys of a dictionary; ``presets``: texts by the names of devices."""
    if config is None:
        return None, None, {}
    if isinstance(config, Mapping):
        return None, None, config
    if isinstance(config, str) and "\n" in config:
        return config, None, {}
    if not isinstance(config, (str, os.PathLike)):
        what = f"config must be {'the name of a device, ' if presets else ''}a path, a TOML text or a dictionary"
        raise TypeError(f"{what}, got {type(config).__name__}")
    path = os.fspath(config)
    if isinstance(config, str) and path in presets:
        return presets[path], None, {}
    try:
        with open(path, encoding="utf-8") as file:
            return file.read(), str(path), {}
    except FileNotFoundError as error:
        names = f", and no device has this name ({', '.join(presets)})" if presets else ""
        raise FileNotFoundError(error.errno, f"{error.strerror}{names}", str(path)) from None


def merged(keys: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``keys`` with those of ``changes``; a section changes only the keys it has."""
    merged = dict(keys)
    for name, value in changes.items():
        old = merged.get(name)
        are_sections = isinstance(old, Mapping) and isinstance(value, Mapping)
        merged[name] = {**old, **value} if are_sections else value  # type: ignore[dict-item]
    return merged


def as_json(keys: Mapping[str, Any], error: type[Exception]) -> str:
    """``keys`` as JSON, which has no numbers that are not finite: ``error`` is raised then."""
    for name, value in keys.items():
        own = value if isinstance(value, Mapping) else {"": value}
        for inner, leaf in own.items():
            number = leaf.tolist() if hasattr(leaf, "tolist") else leaf
            if isinstance(number, float) and not math.isfinite(number):
                raise error(f"{name}{'.' if inner else ''}{inner} must be finite, got {number}")
    return json.dumps(keys, default=plain, allow_nan=False)
