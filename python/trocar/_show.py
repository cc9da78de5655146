"""Display of objects in a notebook: small tables, and figures as images."""

from __future__ import annotations

import base64
import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ._core import Model, Recording
    from ._plan import Plan
    from ._teleop import Advice, Merit, StabilityMap, Teleoperation
    from .results import Comparison, Compensation, Covariance, Figure, Identification, Parameter, Posterior, Validation

#: Figures of an identification that are shown by default, if they exist.
_FIRST = ("cross-validation", "static-friction", "deformation-force")
#: Maximum number of rows of a comparison table; further models are in a collapsed section.
_MOST_ROWS = 12

#: Units for display.
_DISPLAY = {"m": (1e3, "mm"), "m/s": (1e3, "mm/s"), "N/m": (1e-3, "N/mm"), "kg": (1e3, "g")}

_LEFT = "text-align:left"
_SMALL = "font-size:85%;opacity:0.75"


def _number(value: float, digits: int = 4) -> str:
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return f"{value:.{digits}g}".replace("-", "−")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> str:
    """An HTML table. Cells are already HTML; the first column and columns without a heading are left-aligned."""

    def cells(tag: str, row: Sequence[str]) -> str:
        style = [f' style="{_LEFT}"' if i == 0 or not heading else "" for i, heading in enumerate(head)]
        return "".join(f"<{tag}{style[i]}>{cell}</{tag}>" for i, cell in enumerate(row))

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    top = f'<p style="margin:0.5em 0 0">{caption}</p>' if caption else ""
    return f"{top}<table><thead><tr>{cells('th', head)}</tr></thead><tbody>{body}</tbody></table>"


def _fold(summary: str, inside: str) -> str:
    return f"<details><summary>{escape(summary)}</summary>{inside}</details>"


def _list(title: str, lines: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f'<p style="margin:0.5em 0 0">{title}</p><ul style="margin:0">{items}</ul>' if items else ""


def figure(found: Figure) -> str:
    """A figure as an embedded image, so that its content cannot conflict with the rest of the page."""
    data = base64.b64encode(found.encode()).decode()
    picture = (
        f'<img src="data:image/svg+xml;base64,{data}" alt="{escape(found.heading)}" '
        'style="width:44em;max-width:100%;background:#fff">'
    )
    caption = f'<figcaption style="{_SMALL};max-width:52em"><b>{escape(found.heading)}.</b> {escape(found.caption)}</figcaption>'
    return f'<figure style="margin:1em 0">{picture}{caption}</figure>'


def _gallery(figures: Mapping[str, Figure], first: Iterable[str]) -> str:
    shown = [name for name in first if name in figures] or list(figures)[:1]
    others = [name for name in figures if name not in shown]
    more = f'<p style="{_SMALL}">More in <code>.figures</code>: {escape(", ".join(others))}.</p>' if others else ""
    return "".join(figure(figures[name]) for name in shown) + more


def _parameter(found: Parameter) -> tuple[str, str, str, str]:
    scale, unit = _DISPLAY.get(found.unit, (1.0, found.unit))
    low, high = (_number(scale * end) for end in (found.ci95_low, found.ci95_high))
    interval = f"{low} … {high}" if found.determined else "not determined by the data"
    return f"<code>{escape(found.name)}</code>", _number(scale * found.value), interval, escape(unit)


def parameters(found: Mapping[str, Parameter]) -> str:
    head = ("parameter", "value", "95 % interval", "unit")
    main = [_parameter(p) for p in found.values() if not p.is_coefficient]
    rest = [_parameter(p) for p in found.values() if p.is_coefficient]
    fold = _fold(f"{len(rest)} coefficients of the deformation force", _table(head, rest)) if rest else ""
    return _table(head, main) + fold


def _value(value: object) -> str:
    """A number, or the extent of a column, or words."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size:
        ends = [_number(float(end), 3) for end in (np.nanmin(value), np.nanmax(value))]
        return f"{value.size} values, {ends[0]} … {ends[1]}"
    if isinstance(value, np.ndarray):
        return f"{value.size} values"
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, (tuple, list)):
        return escape("; ".join(str(one) for one in value))
    return "–" if value is None else escape(str(value))


def fields(found: Any) -> str:
    """What a record holds and shows, one row a field."""
    if dataclasses.is_dataclass(found):
        names = [own.name for own in dataclasses.fields(found) if own.repr]
    else:
        names = list(getattr(found, "_fields", [own for own in dir(found) if own[0] != "_"]))
    return _table((type(found).__name__, ""), [(f"<code>{name}</code>", _value(getattr(found, name))) for name in names])


def plan(found: Plan) -> str:
    rows = [
        (f"<code>{name}</code>", _number(p.value), f"± {_number(p.half_width, 3)}" if p.determined else "not determined")
        for name, p in found.expected.items()
        if "theta" not in name
    ]
    return _table(("parameter", "expected", "95 % interval"), rows, escape(repr(found)))


def covariance(found: Covariance) -> str:
    rows = [(f"<code>{name}</code>", *map(_number, row)) for name, row in zip(found.names, found.matrix.tolist())]
    return _table(("covariance", *found.names), rows)


def posterior(found: Posterior) -> str:
    ends = ((name, np.nanquantile(found[name], [0.025, 0.5, 0.975])) for name in found.parameters if "_theta" not in name)
    rows = [(f"<code>{name}</code>", _number(mid), f"{_number(low)} … {_number(high)}") for name, (low, mid, high) in ends]
    return _table(("draws", "median", "95 %"), rows, escape(repr(found)))


def identification(found: Identification) -> str:
    names = ", ".join(r["name"] for r in found.summary["recordings"] if r["used_for"] == "identification")
    caption = f"<b>Identified</b> from {escape(names)}: {_number(found.residual_rms_n, 3)} N rms left"
    recordings = () if found.validation is None else found.validation.recordings
    # The validation table lists the warnings of its recordings.
    listed = {f"{r.name}: {warning}" for r in recordings for warning in r.warnings}
    warnings = [str(warning) for warning in found.warnings if warning.doubtful and str(warning) not in listed]
    remarks = [str(warning) for warning in found.warnings if not warning.doubtful]
    validated = "" if found.validation is None else _validation_table(found.validation)
    return (
        f'<div><p style="margin:0">{caption}</p>{parameters(found.parameters)}{validated}'
        f"{_list('<b>Doubtful:</b>', warnings)}{_list('Remarks:', remarks)}"
        f"{_gallery(found.figures, _FIRST)}</div>"
    )


def _validation_table(found: Validation) -> str:
    head = ("recording", "rms N", "fit %", "bias N", "worst N", "samples")
    rows = [
        (escape(r.name), _number(r.rms_n, 3), f"{r.fit_percent:.2f}", _number(r.bias_n, 3), _number(r.worst_n, 3), f"{r.samples}")
        for r in found.recordings
    ]
    if len(rows) > 1:
        rows.append(("all", _number(found.rms_n, 3), f"{found.fit_percent:.2f}", "", "", ""))
    caption = (
        f"<b>Validation</b>, offset {_number(found.offset_n, 3)} N and moving mass {_number(found.moving_mass_kg, 3)} kg subtracted"
    )
    warnings = [f"{r.name}: {warning}" for r in found.recordings for warning in r.warnings]
    return _table(head, rows, caption) + _list("<b>Doubtful:</b>", warnings)


def validation(found: Validation) -> str:
    return f"<div>{_validation_table(found)}{_gallery(found.figures, list(found.figures)[:2])}</div>"


def comparison(found: Comparison) -> str:
    head = ("model", "parameters", "train N", "validate N", "fit %", "worst reversal N", "AIC", "BIC", "warnings")
    rows = [
        (
            f"<code>{escape(m.label)}</code>",
            f"{m.parameters}",
            _number(m.train_rms_n, 3),
            _number(m.validate_rms_n, 3),
            f"{m.fit_percent:.2f}",
            _number(m.worst_reversal_n, 3),
            f"{m.aic:.1f}".replace("-", "−"),
            f"{m.bic:.1f}".replace("-", "−"),
            f"{len(m.warnings) or ''}",
        )
        for m in found
    ]
    where = "on the last third of each recording, held out from the fits" if found.held_out else "on recordings not fitted"
    caption = f"<b>{len(rows)} friction models</b>, scored {where}"
    table = _table(head, rows[:_MOST_ROWS], caption)
    if rows[_MOST_ROWS:]:
        table += _fold(f"{len(rows) - _MOST_ROWS} more", _table(head, rows[_MOST_ROWS:]))
    warnings = _list("<b>Doubtful:</b>", found.warnings)
    return f"<div>{table}{_list('', found.claims)}{warnings}{_gallery(found.figures, ('error-by-parameters',))}</div>"


def recording(found: Recording) -> str:
    rows = [
        ("samples", f"{len(found)}"),
        ("duration", f"{found.duration_s:.1f} s"),
        ("interval", f"{_number(1e3 * found.median_interval_s)} ms"),
        ("stroke", f"{1e3 * found.stroke_m:.1f} mm"),
        ("force", f"{_number(float(found.force_n.min()), 3)} … {_number(float(found.force_n.max()), 3)} N"),
    ]
    table = _table((escape(found.name), ""), rows)
    return f"<div>{table}{_list('<b>Doubtful:</b>', found.warnings)}{_list('Notes:', found.notes)}</div>"


def model(found: Model) -> str:
    intervals = found.to_dict().get("intervals", {})

    def interval(name: str) -> str:
        if name not in intervals:
            return ""
        low, high = (math.inf if end is None else end for end in intervals[name]["ci95"])
        return f"{_number(low)} … {_number(high)}"

    rows = [
        (f"<code>{escape(t.name)}</code>", _number(t.value), escape(t.unit), f'<span style="{_SMALL}">{escape(t.description)}</span>')
        for t in found.tunables
    ]
    shown = [(f"<code>{escape(name)}</code>", interval(name)) for name in intervals if "_theta" not in name]
    fold = _fold("95 % intervals of the identification", _table(("parameter", "interval"), shown)) if shown else ""
    return f"<div>{_table(('parameter', 'value', 'unit', ''), rows, escape(repr(found)))}{fold}</div>"


def compensation(found: Compensation) -> str:
    drift = found.drift
    rows = [
        ("samples", f"{len(found)}"),
        ("friction, of the model's", f"{drift.level:.3f} ± {drift.level_std:.3f}"),
        ("viscosity, of the model's", f"{drift.viscosity:.3f} ± {drift.viscosity_std:.3f}"),
        ("followed in", f"{100 * float(found.adapting.mean()) if len(found) else 0:.0f} % of the samples"),
    ]
    words = dict(found.FAULTS)
    faults = [f"{count} samples: {words[name]}" for name, count in found.faults.items()]
    return f"<div>{_table(('Force on the tissue', ''), rows)}{_list('<b>Faults:</b>', faults)}</div>"


def _merits(cases: Sequence[tuple[str, Merit]]) -> str:
    """Figures of merit side by side, each under its heading."""

    def row(name: str, unit: str, values: Iterable[float | None]) -> tuple[str, ...]:
        cells = ("no contact" if value is None else _number(value) for value in values)
        return (name, *cells, unit)

    merits = [merit for _, merit in cases]
    rows = [
        row("stiffness displayed", "N/m", (m.displayed_stiffness_n_m for m in merits)),
        row("stiffness of the tissue", "N/m", (m.true_stiffness_n_m for m in merits)),
        row("contact from rest: displayed", "N/m", (m.displayed_from_rest_n_m for m in merits)),
        row("contact from rest: tissue", "N/m", (m.true_from_rest_n_m for m in merits)),
        row("contact while sliding: displayed", "N/m", (m.displayed_sliding_n_m for m in merits)),
        row("contact while sliding: tissue", "N/m", (m.true_sliding_n_m for m in merits)),
        row("error of the force felt, rms", "N", (m.force_error_rms_n for m in merits)),
        row("error of the force felt, peak", "N", (m.force_error_peak_n for m in merits)),
        row("in just noticeable differences, rms", "1", (m.force_error_rms_jnd for m in merits)),
        row("error of position, rms", "mm", (1e3 * m.position_error_rms_m for m in merits)),
        row("energy from the leader", "mJ", (1e3 * m.leader_energy_j for m in merits)),
        row("energy to the follower", "mJ", (-1e3 * m.follower_energy_j for m in merits)),
    ]
    return _table(("figure", *(heading for heading, _ in cases), "unit"), rows)


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.4g} %"


def advice(found: Advice) -> str:
    if found.fraction is None:
        return f"<p>{escape(found.refusal)}.</p>"
    ranges = ", ".join(f"{_percent(low)} to {_percent(high)}" for low, high in found.stable)
    text = f"<b>Compensate {_percent(found.fraction)}</b> of the trocar's force; stable in all {found.pairs} cases: {ranges}"
    cases = [("without", found.figures_without), (_percent(found.fraction), found.figures_with)]
    table = _merits([(heading, merit) for heading, merit in cases if merit is not None])
    unstable = "" if found.figures_without is not None else "<p>Without compensation the loop is unstable.</p>"
    return f'<p style="margin:0.5em 0 0">{text}</p>{table}{unstable}'


def stability_map(found: StabilityMap) -> str:
    head = ("delay", *(_percent(fraction) for fraction in found.fractions))
    rows = [
        (f"{1e3 * delay:.4g} ms", *("–" if stiffness == 0 else f"{stiffness:.0f}" for stiffness in row))
        for delay, row in zip(found.delays_s, found.stiffness_n_m)
    ]
    caption = "<b>Greatest stiffness of the tissue, N/m,</b> with which the loop is stable, over delay and fraction compensated; –: none"
    return _table(head, rows, caption)


def teleoperation(found: Teleoperation) -> str:
    control, fraction = found.config["control"], found.config["compensation"]["fraction"]
    delay = f"{1e3 * found.config['channel']['delay_s']:.4g} ms of delay each way"
    caption = f"<b>Teleoperation</b>, <code>{escape(control['architecture'])}</code>, {delay}"
    table = "" if found.figures is None else _merits([(f"{_percent(fraction)} compensated", found.figures)])
    width = "Stable with no tissue from 0 to 20,000 N/m"
    if found.z_width_n_m is None:
        width = "No tissue"
    elif found.z_width_n_m:
        ranges = ("{:,.0f} to {:,.0f}".format(*ends) for ends in found.z_width_n_m)
        width = f"Stable with tissue of {' and of '.join(ranges)} N/m"
    parts = [
        f'<p style="margin:0">{caption}</p>{table}<p style="margin:0">{width}.</p>',
        _list("<b>Doubtful:</b>", found.warnings),
        "" if found.advice is None else advice(found.advice),
        "" if found.map is None else _fold("Stability map", stability_map(found.map)),
    ]
    return f"<div>{''.join(parts)}</div>"
