"""Plots: matplotlib's axes where matplotlib is installed, figures (SVG) elsewhere."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ._core import Recording
    from .results import Forces


def has_matplotlib() -> bool:
    """Whether plots are matplotlib's."""
    return importlib.util.find_spec("matplotlib") is not None


def recording(found: Recording, ax: Any = None) -> Any:
    """Force and position over time, in ``ax`` (two axes, or one for the force) or a new figure."""
    if ax is None and not has_matplotlib():
        from .results import _figures

        return _figures(found._figures())["recording"]
    axes = _axes(ax)
    time = found.time_s
    _panel(axes, 0, "force (N)", [(time, found.force_n, "measured")])
    _panel(axes, 1, "position (mm)", [(time, 1e3 * found.position_m, "")])
    return _finished(axes, ax, found.name)


def forces(found: Forces, name: str, ax: Any = None) -> Any:
    """Forces and their residual over time, in ``ax`` (two axes, or one for the forces) or new."""
    axes = _axes(ax)
    time = found.time_s
    _panel(
        axes, 0, "force (N)", [(time, found.measured_n, "measured"), (time, found.model_n, "model")]
    )
    _panel(axes, 1, "residual (N)", [(time, found.residual_n, "")])
    return _finished(axes, ax, name)


def _axes(ax: Any) -> Sequence[Any]:
    if ax is None:
        from matplotlib import pyplot

        _, axes = pyplot.subplots(2, sharex=True, height_ratios=(2, 1), layout="constrained")
        return list(axes)
    return [ax] if hasattr(ax, "plot") else list(np.ravel(ax))


def _panel(axes: Sequence[Any], place: int, label: str, lines: list[tuple[Any, Any, str]]) -> None:
    if place >= len(axes):
        return
    for x, y, name in lines:
        axes[place].plot(x, y, label=name or None, linewidth=0.8)
    axes[place].set_ylabel(label)
    if any(name for _, _, name in lines):
        axes[place].legend(loc="upper right")


def _finished(axes: Sequence[Any], ax: Any, title: str) -> Any:
    axes[-1].set_xlabel("time (s)")
    axes[0].set_title(title)
    return np.array(axes) if ax is None else ax
