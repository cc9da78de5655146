"""Many recordings, each identified by itself, to one table: in a pipeline of your own, here, or on a Dask cluster.

    from trocar import fleet

    row = fleet.identify_one("recordings/0001.csv")                       # a dictionary of plain values, whatever happens
    fleet.identify_dataset("recordings", "table.parquet", engine="dask")  # two processes and more, or a cluster

A recording that cannot be read or identified is a row with its reason, not an exception. The rows are those of
``trocar fleet``. Tables and Parquet need ``pyarrow``, the engine ``distributed``: ``pip install trocar[dask]``; neither is
imported before it is used.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
import importlib
import itertools
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Callable, Optional, Union

from . import _core
from ._core import InternalError, ParameterError, TrocarError, __version__

__all__ = ["Config", "Outcome", "columns", "identify_dataset", "identify_one"]

_Path = Union[str, "os.PathLike[str]"]
Row = dict[str, Any]

#: Files that are taken for recordings in a folder; those of other names are passed over.
SUFFIXES = (".csv", ".tsv", ".txt", ".gz", ".zst", ".parquet", ".arrow", ".feather", ".mat", ".h5", ".hdf5", ".mcap", ".db3")
#: Recordings that a cluster knows of at one time, for each of its threads.
IN_FLIGHT = 3
#: Reasons that lie with the machine, not with the recording: tried again when a run goes on.
_PASSING = ("worker_died", "cannot_open", "too_large_for_memory")


@dataclasses.dataclass(frozen=True)
class Config:
    """How to read and identify each recording; equal configurations and recordings give equal rows.

    ``depth`` is ``quick`` (the two steps, refined) or ``full`` (all that ``trocar.identify`` does); ``bootstrap`` 0 takes the
    quicker jackknife for the intervals. The rest is as in ``trocar.read`` and ``trocar.identify``.
    """

    depth: str = "quick"
    bootstrap: int = 0
    seed: int = 1
    moving_mass_kg: float = 0.0
    gravity_m_s2: float = 0.0
    columns: Optional[str] = None
    flip_force: bool = False
    sensor_limit_n: Optional[float] = None
    #: Most memory that one identification may take.
    memory_limit_bytes: Optional[int] = None

    def __post_init__(self) -> None:
        _native(self)

    def hash_text(self) -> str:
        """What stands in the column ``config`` of every row."""
        return _native(self).hash_text()


@functools.lru_cache(maxsize=16)
def _native(config: Config) -> _core.FleetConfig:
    return _core.FleetConfig(**dataclasses.asdict(config))


def columns() -> dict[str, str]:
    """Names of the columns of every row, in order, with what they hold: float, integer, flag or text."""
    return dict(_core.fleet_columns())


@functools.lru_cache(maxsize=1)
def _names() -> tuple[str, ...]:
    return tuple(columns())


def identify_one(recording: Any, config: Config = Config(), *, name: Optional[str] = None) -> Row:
    """Identifies one recording by itself: a pure function, to be called from any pipeline, process or machine.

    What goes wrong is part of the row: ``status`` is ``ok``, ``doubtful`` or ``failed``, with ``reason_kind`` and ``reason``. One
    thread does the work. Empty cells are None.

    :param recording: path of a file, or columns: a data frame, an Arrow table, a dictionary
    :param name: what to call columns in the table
    """
    given = os.fspath(recording) if isinstance(recording, os.PathLike) else recording
    if isinstance(given, str):
        return dict(zip(_names(), _core.fleet_file(given, _native(config))))
    name = "recording" if name is None else name
    try:
        return dict(zip(_names(), _core.fleet_frame(given, name, _native(config))))
    except (TrocarError, TypeError) as error:
        return _failed(name, config, "cannot_read", str(error))


def _failed(name: str, config: Config, kind: str, reason: str) -> Row:
    row: Row = dict.fromkeys(_names())
    program, settings = f"trocar {__version__}", config.hash_text()
    row.update(path=name, program=program, config=settings, depth=config.depth)
    row.update(moving_mass_kg=float(config.moving_mass_kg), status="failed", reason_kind=kind, reason=reason)
    return row


@dataclasses.dataclass(frozen=True)
class _Unit:
    """One recording of a data set: a file, or the rows of Parquet files in which the column ``group`` says ``value``."""

    name: str
    files: tuple[str, ...]
    #: Of the data set about the recording: columns of the table in front of the row's own.
    about: tuple[tuple[str, Any], ...] = ()
    group: Optional[str] = None
    value: Any = None

    def stamp(self) -> str:
        """The same for the same recording, another once its files are others."""
        stats = [os.stat(file) if os.path.exists(file) else None for file in self.files]
        changed = [(each.st_size, each.st_mtime_ns) if each else None for each in stats]
        return json.dumps([self.name, self.files, changed, self.group, repr(self.value), self.about])

    def row(self, config: Config) -> Row:
        if self.group is None:
            return identify_one(self.files[0], config)
        try:
            frame = _rows_of(self.files, self.group, self.value)
        except (OSError, ValueError) as error:
            return _failed(self.name, config, "cannot_read", str(error))
        return identify_one(frame, config, name=self.name)


def _work(unit: _Unit, config: Config) -> Row:
    return unit.row(config)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a data set."""

    table: Path
    recordings: int
    ok: int
    doubtful: int
    #: Name of the recording, and why it failed.
    failed: tuple[tuple[str, str], ...]
    #: Recordings whose rows an interrupted run had left behind.
    taken_over: int


def identify_dataset(
    dataset: Union[_Path, Iterable[_Path]],
    out: _Path,
    *,
    config: Config = Config(),
    group: Optional[str] = None,
    engine: str = "dask",
    client: Any = None,
    workers: Optional[int] = None,
    progress: Optional[Callable[[int, int], object]] = None,
) -> Outcome:
    """Identifies every recording of a data set and writes one Parquet table with a row for each, in the order of their names.

    The table is the same whatever the engine, the number of workers, their order and their fate. Rows done are kept beside
    ``out`` until it is written: an interrupted call, made again, goes on where it was.

    :param dataset: a folder (folders in it named ``key=value`` become columns), a manifest (CSV or Parquet with a column ``path``,
        relative to it; its other columns are kept), or paths
    :param out: the table; it appears whole or not at all
    :param group: the column that tells recordings apart where Parquet files hold rows of several: each value within a folder is
        one recording
    :param engine: ``dask``, or ``serial`` for this process alone
    :param client: a ``distributed.Client`` of a running cluster; by default a cluster of processes on this machine
    :param workers: processes of that cluster; by default one for each processor
    :param progress: called with the recordings done and all of them
    """
    if engine not in ("dask", "serial"):
        raise ParameterError(f"engine {engine!r}: expected dask or serial")
    out = Path(out)
    units = sorted(_units(dataset, group), key=lambda unit: unit.name)
    twins = {unit.name for unit, next_ in zip(units, units[1:]) if unit.name == next_.name}
    if twins:
        raise ParameterError(f"{min(twins)}: in the data set more than once")
    if not units:
        raise ParameterError("no recording in the data set")
    taken = {key for unit in units for key, _ in unit.about} & set(_names())
    if taken:
        raise ParameterError(f"the data set has a column {min(taken)}, which the table fills by itself")
    journal = _Journal(out, units, config)
    missing = [index for index in range(len(units)) if index not in journal.rows]
    taken_over = len(units) - len(missing)
    with journal:
        if progress is not None:
            progress(taken_over, len(units))
        rows = _serial(units, missing, config) if engine == "serial" else _dask(units, missing, config, client, workers)
        for index, row in rows:
            journal.add(index, row)
            if progress is not None:
                progress(len(journal.rows), len(units))
    done = [journal.rows[index] for index in range(len(units))]
    _write(out, units, done)
    journal.remove()
    failed = tuple((unit.name, row["reason"]) for unit, row in zip(units, done) if row["status"] == "failed")
    ok = sum(row["status"] == "ok" for row in done)
    return Outcome(out, len(units), ok, len(units) - ok - len(failed), failed, taken_over)


def _serial(units: Sequence[_Unit], missing: Sequence[int], config: Config) -> Iterator[tuple[int, Row]]:
    for index in missing:
        yield index, _work(units[index], config)


def _dask(
    units: Sequence[_Unit],
    missing: Sequence[int],
    config: Config,
    client: Any,
    workers: Optional[int],
    work: Callable[[_Unit, Config], Row] = _work,
) -> Iterator[tuple[int, Row]]:
    """Rows as they come. A worker that dies loses its task to another; a recording that kills worker after worker is a row."""
    distributed = _needed("distributed", "the engine dask")
    if client is None:
        options = {"n_workers": workers or os.cpu_count() or 1, "threads_per_worker": 1, "dashboard_address": None}
        with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as own:
            yield from _dask(units, missing, config, own, None, work)
        return
    _same_everywhere(client)
    submit = functools.partial(client.submit, work, config=config, pure=False)
    suspects = []
    for index, future in _in_flight(distributed, client, submit, units, missing):
        try:
            yield index, future.result()
        except distributed.scheduler.KilledWorker:
            # Perhaps it only stood in line where another one killed.
            suspects.append(index)
    for index in suspects:
        try:
            row = submit(units[index]).result()
        except distributed.scheduler.KilledWorker:
            row = _failed(units[index].name, config, "worker_died", "every worker that worked on it died")
        yield index, row


def _in_flight(
    distributed: Any, client: Any, submit: Callable[[_Unit], Any], units: Sequence[_Unit], missing: Sequence[int]
) -> Iterator[tuple[int, Any]]:
    """Finished futures; a cluster is never given more than it soon gets to."""
    waiting = iter(missing)
    at_once = IN_FLIGHT * max(sum(client.nthreads().values()), 1)
    of_key: dict[Any, int] = {}

    def following(count: int) -> list[Any]:
        futures = []
        for index in itertools.islice(waiting, count):
            futures.append(submit(units[index]))
            of_key[futures[-1].key] = index
        return futures

    running = distributed.as_completed(following(at_once))
    for future in running:
        yield of_key.pop(future.key), future
        future.release()
        running.update(following(1))


def _same_everywhere(client: Any) -> None:
    """Refuses workers without this package, which would wait for ever, and those with another version."""
    for address, has in client.get_versions(packages=["trocar"])["workers"].items():
        found = has["packages"].get("trocar")
        if found != __version__:
            text = f"worker {address} has {f'trocar {found}' if found else 'no trocar'}, expected {__version__}"
            raise RuntimeError(text)


class _Journal:
    """Rows done, beside the table to be: one line each, so that what a kill tears is the last line alone."""

    def __init__(self, out: Path, units: Sequence[_Unit], config: Config) -> None:
        self.path = out.with_name(out.name + ".partial")
        self.stamps = [unit.stamp() for unit in units]
        self.config = config.hash_text()
        self.rows: dict[int, Row] = {}
        places = {stamp: index for index, stamp in enumerate(self.stamps)}
        for stamp, settings, row in self._lines():
            if settings == self.config and stamp in places:
                self.rows[places[stamp]] = row

    def _lines(self) -> Iterator[tuple[str, str, Row]]:
        if not self.path.exists():
            return
        with open(self.path, encoding="utf-8") as file:
            for line in file:
                try:
                    stamp, settings, row = json.loads(line)
                except ValueError:
                    continue
                yield stamp, settings, row

    def __enter__(self) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        # A line of its own, should the last one be torn.
        self.file = open(self.path, "a", encoding="utf-8")
        self.file.write("\n")

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def add(self, index: int, row: Row) -> None:
        """Keeps a row; those that failed for a passing reason are kept for this run alone."""
        if index in self.rows:
            raise InternalError(f"{self.stamps[index]} came twice")
        self.rows[index] = row
        if row["reason_kind"] not in _PASSING:
            self.file.write(json.dumps([self.stamps[index], self.config, row], allow_nan=False) + "\n")
            self.file.flush()

    def remove(self) -> None:
        self.path.unlink()


def _write(out: Path, units: Sequence[_Unit], rows: Sequence[Row]) -> None:
    pyarrow = _needed("pyarrow", "a table in Parquet")
    types = {"float": pyarrow.float64(), "integer": pyarrow.int64(), "flag": pyarrow.bool_(), "text": pyarrow.string()}
    arrays: dict[str, Any] = {}
    for name in dict.fromkeys(key for unit in units for key, _ in unit.about):
        arrays[name] = pyarrow.array([dict(unit.about).get(name) for unit in units])
    for name, kind in columns().items():
        arrays[name] = pyarrow.array([row[name] for row in rows], types[kind])
    whole = out.with_name(out.name + ".new")
    importlib.import_module("pyarrow.parquet").write_table(pyarrow.table(arrays), whole)
    os.replace(whole, out)


def _needed(module: str, purpose: str) -> Any:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        text = f"{purpose} needs the package {module}\n\nhint: pip install 'trocar[dask]'"
        raise ModuleNotFoundError(text, name=module) from error


# What a data set holds.


def _units(dataset: Union[_Path, Iterable[_Path]], group: Optional[str]) -> Iterator[_Unit]:
    if not isinstance(dataset, (str, os.PathLike)):
        entries = [(os.fspath(path), Path(os.fspath(path)), ()) for path in dataset]
        return _grouped(entries, group)
    root = Path(dataset)
    if root.is_dir():
        return _grouped(list(_folder(root)), group)
    if not root.exists():
        raise FileNotFoundError(f"{root}: no such folder or manifest")
    return _grouped(list(_manifest(root)), group)


_Entry = tuple[str, Path, tuple[tuple[str, Any], ...]]


def _folder(root: Path) -> Iterator[_Entry]:
    for path in sorted(root.rglob("*")):
        inner = path.relative_to(root)
        hidden = any(part.startswith((".", "_")) for part in inner.parts)
        if path.is_file() and path.suffix.lower() in SUFFIXES and not hidden:
            pairs = [part.split("=", 1) for part in inner.parts[:-1] if "=" in part]
            yield inner.as_posix(), path, tuple((key, value) for key, value in pairs)


def _manifest(path: Path) -> Iterator[_Entry]:
    rows: Iterable[Mapping[str, Any]]
    if path.suffix.lower() == ".parquet":
        _needed("pyarrow", "a manifest in Parquet")
        rows = importlib.import_module("pyarrow.parquet").read_table(path).to_pylist()
    else:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    for number, row in enumerate(rows, 1):
        if not row.get("path"):
            raise ParameterError(f"{path} row {number}: no path")
        about = tuple((key, value) for key, value in row.items() if key != "path")
        yield str(row["path"]), path.parent / str(row["path"]), about


def _grouped(entries: Sequence[_Entry], group: Optional[str]) -> Iterator[_Unit]:
    """One unit for each file; with `group` one for each of its values within a folder and what is known of it."""
    folders: dict[tuple[str, tuple[tuple[str, Any], ...]], list[str]] = {}
    for name, path, about in entries:
        if group is None or path.suffix.lower() != ".parquet":
            yield _Unit(name, (str(path),), about)
        else:
            folders.setdefault((os.path.dirname(name), about), []).append(str(path))
    for (folder, about), files in folders.items():
        for value in _values_of(files, str(group)):
            yield _Unit(f"{folder}/{value}" if folder else str(value), tuple(files), about, group, value)


def _values_of(files: Sequence[str], group: str) -> list[Any]:
    _needed("pyarrow", "grouped Parquet")
    parquet = importlib.import_module("pyarrow.parquet")
    values: dict[Any, None] = {}
    for file in files:
        schema = parquet.read_schema(file)
        if group not in schema.names:
            raise ParameterError(f"{file}: no column {group}, has {', '.join(schema.names)}")
        found = parquet.ParquetFile(file).read(columns=[group]).column(0).unique().to_pylist()
        values.update(dict.fromkeys(found))
    return [value for value in values if value is not None]


def _rows_of(files: Sequence[str], group: str, value: Any) -> Any:
    """The rows of one recording as an Arrow table, in the order of the files."""
    pyarrow, parquet = _needed("pyarrow", "grouped Parquet"), importlib.import_module("pyarrow.parquet")
    filters = [(group, "=", value)]
    parts = [parquet.read_table(file, filters=filters, partitioning=None) for file in files]
    return pyarrow.concat_tables([part for part in parts if part.num_rows]).drop_columns([group])
