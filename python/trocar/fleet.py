"""Identification of many recordings, one by one, into one table: in your own pipeline, in this process, or on a Dask cluster.

    from trocar import fleet

    row = fleet.identify_one("recordings/0001.csv")                       # a dictionary of plain values, also after an error
    fleet.identify_dataset("recordings", "table.parquet", engine="dask")  # local processes, or a cluster

A recording that cannot be read or identified gives a row with the reason, not an exception. Rows and table equal those of
``trocar fleet``, byte for byte. The Dask engine needs ``distributed``, which is imported only when it is used:
``pip install trocar[dask]``.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Callable, Optional, Union

from . import _core, _show
from ._arrays import columns_in_words
from ._core import ParameterError, TrocarError, __version__

__all__ = ["Config", "Outcome", "columns", "identify_dataset", "identify_one"]

_Path = Union[str, "os.PathLike[str]"]
Row = dict[str, Any]

#: Files submitted to a cluster at one time, per thread of the cluster.
IN_FLIGHT = 3


@dataclasses.dataclass(frozen=True)
class Config:
    """How to read and identify each recording; equal configurations and recordings give equal rows.

    ``depth`` is ``quick`` (without the optional model terms that rests and partial reversals determine) or ``full`` (everything
    that ``trocar.identify`` does). The other fields are as in ``trocar.read`` and ``trocar.identify``; a dictionary of ``columns`` becomes the text that means the same.

    >>> fleet.Config(depth="quick", moving_mass_kg=0.04).depth
    'quick'
    """

    depth: str = "quick"
    seed: int = 1
    moving_mass_kg: float = 0.0
    gravity_m_s2: float = 0.0
    columns: Union[str, Mapping[str, str], None] = None
    topics: tuple[str, ...] = ()
    from_s: Optional[float] = None
    to_s: Optional[float] = None
    flip_force: bool = False
    sensor_limit_n: Optional[float] = None
    #: From a longer recording, excerpts spread over its whole length are used.
    most_samples: Optional[int] = 2_000_000
    #: Maximum memory of one identification.
    memory_limit_bytes: Optional[int] = None

    def __post_init__(self) -> None:
        if self.columns is not None:
            object.__setattr__(self, "columns", columns_in_words(self.columns))
        _native(self)

    def hash_text(self) -> str:
        """The text in the column ``config`` of every row."""
        return _native(self).hash_text()

    _repr_html_ = _show.fields


@functools.lru_cache(maxsize=16)
def _native(config: Config) -> _core.FleetConfig:
    keys = dataclasses.asdict(config)
    mass = {"mass_kg": keys.pop("moving_mass_kg"), "gravity_m_s2": keys.pop("gravity_m_s2")}
    return _core.FleetConfig(moving_mass=mass, **keys)


def columns() -> dict[str, str]:
    """Names of the columns of every row, in order, with the type of their values: number, integer, boolean or text.

    >>> fleet.columns()["coulomb_force_n"]
    'number'
    """
    return dict(_core.fleet_columns())


@functools.lru_cache(maxsize=1)
def _names() -> tuple[str, ...]:
    return tuple(columns())


def identify_one(recording: Any, config: Config = Config(), *, name: Optional[str] = None) -> Row:
    """Identifies one recording: a pure function that any pipeline, process or machine can call.

    Errors are part of the row: ``status`` is ``ok``, ``doubtful`` or ``failed``, with ``reason_kind`` and ``reason``. The call
    uses one thread. Empty cells are None.

    :param recording: path of a file, or columns: a data frame, an Arrow table, a dictionary
    :param name: name in the table of a recording given as columns

    >>> row = fleet.identify_one("strokes.csv")
    >>> row["status"], round(row["coulomb_force_n"], 1)
    ('ok', 3.0)
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
    """Summary of the identification of a data set.

    >>> outcome = fleet.identify_dataset("recordings", "table.csv", engine="serial")
    >>> outcome.recordings == outcome.ok + outcome.doubtful + len(outcome.failed)
    True
    """

    table: Path
    recordings: int
    ok: int
    doubtful: int
    #: Name of each failed recording, and the reason.
    failed: tuple[tuple[str, str], ...]
    #: Recordings whose rows were reused from an interrupted run.
    reused: int
    #: Files skipped because of their extension.
    left_out: tuple[str, ...]

    _repr_html_ = _show.fields


def identify_dataset(
    dataset: _Path,
    out: _Path,
    *,
    config: Config = Config(),
    engine: str = "dask",
    client: Any = None,
    workers: Optional[int] = None,
    progress: Optional[Callable[[int, int], object]] = None,
) -> Outcome:
    """Identifies every recording of a data set and writes one table with one row per recording.

    The table equals that of ``trocar fleet``. It does not depend on the engine, on the number or order of the workers, or on
    workers that die. Finished rows are kept in a journal beside ``out``: a repeated call continues an interrupted one, and so
    does ``trocar fleet``.

    :param dataset: a folder (subfolders named ``key=value`` become columns), or a manifest (CSV or Parquet with a column ``path``,
        relative to the manifest; its other columns are kept). Workers must see it under the same path
    :param out: file for the table: .parquet, .csv, .csv.gz, .csv.zst or .arrow; it is written completely or not at all
    :param engine: ``dask``, or ``serial`` for this process alone
    :param client: a ``distributed.Client`` of a running cluster; by default a cluster of processes on this machine
    :param workers: number of processes of that local cluster; by default one per processor
    :param progress: called with the number of finished files and the total number

    >>> fleet.identify_dataset("recordings", "table.csv", engine="serial").recordings
    1
    """
    if engine not in ("dask", "serial"):
        raise ParameterError(f"engine {engine!r}: expected dask or serial")
    table = _core.FleetTable(Path(dataset).absolute(), Path(out).absolute(), _native(config))
    try:
        orders = table.orders()
        rows = _serial(orders, config) if engine == "serial" else _dask(orders, config, client, workers)
        reused = 0
        for done, (source, text) in enumerate(rows, 1):
            if text is None:
                table.lose(source, "worker_died", "every worker that worked on it died or failed")
            else:
                _, reused, _ = table.add(source, text)
            if progress is not None:
                progress(done, len(orders))
        written = table.write()
    finally:
        table.close()
    failed = tuple((name, str(reason)) for name, status, reason in written if status == "failed")
    ok = sum(status == "ok" for _, status, _ in written)
    doubtful = len(written) - ok - len(failed)
    return Outcome(Path(out), len(written), ok, doubtful, failed, reused, tuple(table.left_out))


def _work(order: str, config: Config) -> str:
    return _core.fleet_source(order, _native(config))


#: Index of a file and the text of its row; None if its workers died.
_Rows = Iterator[tuple[int, Optional[str]]]


def _serial(orders: Sequence[str], config: Config) -> _Rows:
    for source, order in enumerate(orders):
        yield source, _work(order, config)


def _dask(
    orders: Sequence[str],
    config: Config,
    client: Any,
    workers: Optional[int],
    work: Callable[[str, Config], str] = _work,
) -> _Rows:
    """Rows in order of completion. If a worker dies, another one takes its file; a file that repeatedly kills workers is abandoned."""
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
            # If the worker was killed, another file may have caused it. Other failures may be transient.
            suspects.append(source)
    for source in suspects:
        try:
            text = submit(orders[source]).result()
        except Exception:  # any failure now is due to this file
            text = None
        yield source, text


def _in_flight(
    distributed: Any, client: Any, submit: Callable[[str], Any], orders: Sequence[str]
) -> Iterator[tuple[int, Any]]:
    """Finished futures; the number of submitted files is limited."""
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
    """Rejects workers without this package, which would wait forever, and workers with another version of it."""
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
