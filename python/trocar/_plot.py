"""Plots: matplotlib's axes where matplotlib is installed, elsewhere the figures (SVG) of the report where it has them."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ._core import Recording
    from ._teleop import Advice, HybridMatrix, StabilityMap, Teleoperation
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


def course(found: Teleoperation, ax: Any = None) -> Any:
    """Forces over time and over the depth of the tip, in ``ax`` (two axes, or one for time) or new."""
    named = [(found.felt_force_n, "felt"), (found["tissue_force_n"], "on the tissue")]
    time, depth = found["time_s"], 1e3 * found.depth_m
    _need_matplotlib(ax)
    axes = _axes(ax, sharex=False, height_ratios=(1, 1))
    _panel(axes, 0, "force (N)", [(time, force, name) for force, name in named])
    _panel(axes, 1, "force (N)", [(depth, force, "") for force, _ in named])
    for axis, label in zip(axes, ("time (s)", "depth of the tip in the tissue (mm)")):
        axis.set_xlabel(label)
    fraction = 100 * found.config["compensation"]["fraction"]
    axes[0].set_title(f"{fraction:.4g} % of the trocar's force compensated", loc="left")
    # Beside the title: within the axes it would cover the course.
    axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(named), frameon=False)
    return np.array(axes) if ax is None else ax


def advice(found: Advice, ax: Any = None) -> Any:
    """Force error over the fraction, in ``ax`` or a new figure."""
    axis = _axis(ax)
    columns = found.columns()
    percent, stable = 100 * columns["fraction"], columns["stable"]
    axis.plot(percent, columns["force_error_rms_n"], marker=".", label="force error")
    half = 0.5 * float(np.diff(percent).min())
    for place in np.flatnonzero(~stable):
        label = "unstable" if place == np.flatnonzero(~stable)[0] else None
        ends = percent[place] - half, percent[place] + half
        axis.axvspan(*ends, color="0.85", linewidth=0, label=label)
    if found.fraction is not None:
        axis.axvline(100 * found.fraction, color="0.3", linestyle="--", label="advice")
    axis.set(xlabel="fraction compensated (%)", ylabel="force error, rms (N)")
    axis.set_xlim(percent[0], percent[-1])
    axis.legend(loc="best")
    return axis


def stability_map(found: StabilityMap, ax: Any = None) -> Any:
    """Greatest stable stiffness as a heat map, in ``ax`` or a new figure."""
    axis = _axis(ax)
    from matplotlib.colors import LogNorm

    held = np.ma.masked_less_equal(found.stiffness_n_m, 0.0)
    percent, delay_ms = 100 * found.fractions, 1e3 * found.delays_s
    # The stiffest tissue that is tried, and the softest but none.
    norm = LogNorm(vmin=1.0, vmax=20_000.0)
    mesh = axis.pcolormesh(percent, delay_ms, held, norm=norm, shading="nearest")
    axis.set_facecolor("0.85")
    axis.grid(False)
    rows, places = np.nonzero(found.least_stiffness_n_m > 0)
    axis.plot(percent[places], delay_ms[rows], "x", color="0.2", markersize=4)
    label = "greatest stable stiffness (N/m)\ngrey: none, ×: unstable with softer tissue"
    axis.figure.colorbar(mesh, ax=axis, label=label)
    axis.set(xlabel="fraction compensated (%)", ylabel="delay of one direction (ms)")
    return axis


def hybrid(found: HybridMatrix, ax: Any = None) -> Any:
    """Impedances and Llewellyn's margin over frequency, in ``ax`` (two axes, or one) or new."""
    _need_matplotlib(ax)
    axes = _axes(ax)
    frequency = found.frequency_hz
    lines = [
        (frequency, np.abs(found.transmitted_n_s_m), "felt"),
        (frequency, np.abs(found.tissue_n_s_m), "tissue"),
    ]
    _panel(axes, 0, "impedance (N s/m)", lines)
    axes[0].set(xscale="log", yscale="log")
    _panel(axes, 1, "margin", [(frequency, found.llewellyn_margin, "")])
    for axis in axes[1:2]:
        axis.axhline(0.0, color="0.6", linewidth=0.8)
    axes[-1].set_xlabel("frequency (Hz)")
    return np.array(axes) if ax is None else ax


def _need_matplotlib(ax: Any) -> None:
    if ax is None and not has_matplotlib():
        raise ImportError("plot() needs matplotlib, which is not installed: pip install matplotlib")


def _axis(ax: Any) -> Any:
    _need_matplotlib(ax)
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def _axes(ax: Any, sharex: bool = True, height_ratios: tuple[int, int] = (2, 1)) -> Sequence[Any]:
    if ax is None:
        from matplotlib import pyplot

        options: dict[str, Any] = {"sharex": sharex, "height_ratios": height_ratios}
        _, axes = pyplot.subplots(2, layout="constrained", **options)
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
