"""Writes a reference trajectory and its parameters; refuses one that a second way of computing does not confirm."""

import csv
import importlib.metadata
import io
import json
import os
import pathlib

# N: largest difference to the second computation with which a trajectory is still written.
CONFIRMED = 1e-10


def folder():
    """Where the files go: `vectors` beside this file, or TROCAR_VECTORS."""
    return pathlib.Path(os.environ.get("TROCAR_VECTORS", pathlib.Path(__file__).parent / "vectors"))


def versions(*packages):
    """`name version` of installed packages."""
    return [f"{package} {importlib.metadata.version(package)}" for package in packages]


def write(name, model, made_with, parameters, columns, confirmation, within=CONFIRMED):
    """Writes NAME.csv and the entry NAME of parameters.json.

    columns: dict of equally long lists, the names with units; confirmation: forces of the second computation, N;
    within: largest difference allowed, N.
    """
    forces = columns["force_n"]
    if len(forces) != len(confirmation) or any(force != force for force in confirmation):
        raise SystemExit(f"{name}: the second computation is not complete")
    difference = max(abs(force - other) for force, other in zip(forces, confirmation))
    largest = max(abs(force) for force in forces)
    print(f"{name:28} {len(forces):4} rows, force up to {largest:.3g} N, confirmed to {difference:.1e} N")
    # Written this way round, a difference that is no number is refused too.
    if not difference <= within:
        raise SystemExit(f"{name}: refused, {difference} N is more than {within} N")
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows([repr(value) for value in row] for row in zip(*columns.values(), strict=True))
    (folder() / f"{name}.csv").write_text(text.getvalue())
    record({name: {"model": model, "made_with": made_with, **parameters}})


def record(entries):
    """Merges entries into parameters.json, sorted by name."""
    path = folder() / "parameters.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    path.write_text(json.dumps({**known, **entries}, indent=1, sort_keys=True) + "\n")


def sliding(coulomb, static, stribeck_velocity, viscous, exponent=2.0):
    """The sliding curve as it stands in parameters.json."""
    return {
        "coulomb_force_n": coulomb,
        "static_force_n": static,
        "stribeck_velocity_m_s": stribeck_velocity,
        "stribeck_exponent": exponent,
        "viscous_damping_n_s_m": viscous,
    }
