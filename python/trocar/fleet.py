"""Many recordings, each identified by itself, to one table: in a pipeline of your own, here, or on a Dask cluster.

    from trocar import fleet

    row = fleet.identify_one("recordings/0001.csv")                       # a dictionary of plain values, whatever happens
    fleet.identify_dataset("recordings", "table.parquet", engine="dask")  # two processes and more, or a cluster

A recording that cannot be read or identified is a row with its reason, not an exception. Rows and table are those of
``trocar fleet``, byte for byte. The engine needs ``distributed``, which is not imported before it is used:
``pip install trocar[dask]``.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import itertools
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Callable, Optional, Union

from . import _core
from ._core import ParameterError, TrocarError, __version__

__all__ = ["Config", "Outcome", "columns", "identify_dataset", "identify_one"]

_Path = Union[str, "os.PathLike[str]"]
Row = dict[str, Any]

#: Files that a cluster knows of at one time, for each of its threads.
IN_FLIGHT = 3


@dataclasses.dataclass(frozen=True)
class Config:
    """How to read and identify each recording; equal configurations and recordings give equal rows.

    ``depth`` is ``quick`` (without the optional terms that rests and partial reversals determine) or ``full`` (all that
    ``trocar.identify`` does); ``bootstrap`` 0 takes the quicker jackknife for the intervals. The rest is as in ``trocar.read`` and ``trocar.identify``.
    """

    depth: str = "quick"
    bootstrap: int = 0
    seed: int = 1
    moving_mass_kg: float = 0.0
    gravity_m_s2: float = 0.0
    columns: Optional[str] = None
    topics: tuple[str, ...] = ()
    from_s: Optional[float] = None
    to_s: Optional[float] = None
    flip_force: bool = False
    sensor_limit_n: Optional[float] = None
    #: Of a longer recording excerpts are taken, spread over the whole.
    most_samples: Optional[int] = 2_000_000
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
    """Names of the columns of every row, in order, with what they hold: number, whole, truth or text."""
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
    #: Files that were passed over for their extension.
    left_out: tuple[str, ...]


def identify_dataset(
    dataset: _Path,
    out: _Path,
    *,
    config: Config = Config(),
    group_by: Optional[str] = None,
    engine: str = "dask",
    client: Any = None,
    workers: Optional[int] = None,
    progress: Optional[Callable[[int, int], object]] = None,
) -> Outcome:
    """Identifies every recording of a data set and writes one table with a row for each.

    The table is that of ``trocar fleet``, whatever the engine, the number of workers, their order and their fate. Rows done are
    kept in a journal beside ``out``: an interrupted call, made again, goes on where it was; so does ``trocar fleet``.

    :param dataset: a folder (folders in it named ``key=value`` become columns), a manifest (CSV or Parquet with a column ``path``,
        relative to it; its other columns are kept), or a Parquet file; workers must see it under the same path. Parquet files of a
        folder may be the parts of a partitioned data set, with rows of one recording in several of them
    :param out: the table: .parquet, .csv, .csv.gz, .csv.zst or .arrow; it appears whole or not at all
    :param group_by: the column, or the key of folders, that tells recordings apart where Parquet files hold rows of several;
        by default ``recording`` where there is one
    :param engine: ``dask``, or ``serial`` for this process alone
    :param client: a ``distributed.Client`` of a running cluster; by default a cluster of processes on this machine
    :param workers: processes of that cluster; by default one for each processor
    :param progress: called with the files done and all of them
    """
    if engine not in ("dask", "serial"):
        raise ParameterError(f"engine {engine!r}: expected dask or serial")
    table = _core.FleetTable(Path(dataset).absolute(), Path(out).absolute(), _native(config), group_by=group_by)
    try:
        orders = table.orders()
        parts = _serial(orders, config) if engine == "serial" else _dask(orders, config, client, workers)
        taken_over = 0
        for done, (source, text) in enumerate(parts, 1):
            if text is None:
                table.lose(source, "worker_died", "every worker that worked on it died or failed")
            else:
                _, taken_over, _ = table.add(source, text)
            if progress is not None:
                progress(done, len(orders))
        said = table.write()
    finally:
        table.close()
    failed = tuple((name, str(reason)) for name, status, reason in said if status == "failed")
    ok = sum(status == "ok" for _, status, _ in said)
    doubtful = len(said) - ok - len(failed)
    return Outcome(Path(out), len(said), ok, doubtful, failed, taken_over, tuple(table.left_out))


def _work(order: str, config: Config) -> str:
    return _core.fleet_source(order, _native(config))


#: Number of a file with the text of its rows; None where its workers died.
_Parts = Iterator[tuple[int, Optional[str]]]


def _serial(orders: Sequence[str], config: Config) -> _Parts:
    for source, order in enumerate(orders):
        yield source, _work(order, config)


def _dask(
    orders: Sequence[str],
    config: Config,
    client: Any,
    workers: Optional[int],
    work: Callable[[str, Config], str] = _work,
) -> _Parts:
    """Rows as they come. A worker that dies loses its file to another; a file that kills worker after worker is given up."""
    distributed = _needed("distributed")
    if client is None:
        options = {"n_workers": workers or os.cpu_count() or 1, "threads_per_worker": 1, "dashboard_address": None}
        with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as own:
            yield from _dask(orders, config, own, None, work)
        return
    _same_everywhere(client)
    submit = functools.partial(client.submit, work, config=config, pure=False)
    suspects = []
    for source, future in _in_flight(distributed, client, submit, orders):
        try:
            yield source, future.result()
        except Exception:
            # A killed worker: perhaps this file only stood in line where another one killed. A failure: it may pass.
            suspects.append(source)
    for source in suspects:
        try:
            text = submit(orders[source]).result()
        except Exception:  # whatever it is, it is this file's
            text = None
        yield source, text


def _in_flight(
    distributed: Any, client: Any, submit: Callable[[str], Any], orders: Sequence[str]
) -> Iterator[tuple[int, Any]]:
    """Finished futures; a cluster is never given more than it soon gets to."""
    waiting = iter(enumerate(orders))
    at_once = IN_FLIGHT * max(sum(client.nthreads().values()), 1)
    of_key: dict[Any, int] = {}

    def following(count: int) -> list[Any]:
        futures = []
        for source, order in itertools.islice(waiting, count):
            futures.append(submit(order))
            of_key[futures[-1].key] = source
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


def _needed(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        text = f"the engine dask needs the package {module}\n\nhint: pip install 'trocar[dask]', or engine='serial'"
        raise ModuleNotFoundError(text, name=module) from error
