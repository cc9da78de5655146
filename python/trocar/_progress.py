"""How far a long call is: a bar where somebody watches."""

from __future__ import annotations

import importlib.util
import multiprocessing
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Callable, Optional, Union

#: Called with the stage of the work and the fraction done, 0 to 1.
Progress = Callable[[str, float], object]


@contextmanager
def watched(progress: Union[Progress, bool, None]) -> Iterator[Optional[Progress]]:
    """What to call with stage and fraction: ``progress``, a bar while the work lasts, or nothing.

    By default (None) there is a bar in a terminal, and in a notebook with tqdm and ipywidgets; none
    in worker processes and threads.
    False turns it off, True asks for it on standard error wherever that leads.
    """
    if progress is None or isinstance(progress, bool):
        bar = _bar(always=progress is True) if progress is not False else None
    elif callable(progress):
        yield progress
        return
    else:
        raise TypeError(f"progress must be a function, True, False or None, got {progress!r}")
    try:
        yield None if bar is None else bar.show
    finally:
        if bar is not None:
            bar.close()


def _bar(always: bool) -> Union[_Tqdm, _Line, None]:
    is_main = (
        multiprocessing.current_process().name == "MainProcess"
        and threading.current_thread() is threading.main_thread()
    )
    if not always and not is_main:
        return None
    if is_notebook():
        return _Tqdm("tqdm.notebook") if _has("tqdm") and _has("ipywidgets") else None
    if not always and not (sys.stderr is not None and sys.stderr.isatty()):
        return None
    return _Tqdm("tqdm") if _has("tqdm") else _Line()


def is_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return type(shell).__name__ == "ZMQInteractiveShell"


def _has(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


class _Tqdm:
    """A bar of tqdm that disappears at the end."""

    def __init__(self, module: str) -> None:
        tqdm: Any = importlib.import_module(module)
        self._bar = tqdm.tqdm(
            total=100,
            leave=False,
            bar_format="{desc}: {percentage:3.0f}%|{bar}| {elapsed}",
            # A stage may be over within tqdm's pause between two drawings: show each report.
            mininterval=0,
            miniters=0,
        )

    def show(self, stage: str, part: float) -> None:
        self._bar.set_description_str(stage, refresh=False)
        self._bar.update(100 * part - self._bar.n)

    def close(self) -> None:
        self._bar.close()


class _Line:
    """A line on standard error that disappears at the end."""

    def __init__(self) -> None:
        self._width = 0

    def show(self, stage: str, part: float) -> None:
        self._write(f"{stage}: {part:.0%}")

    def close(self) -> None:
        self._write("")
        sys.stderr.write("\r")
        sys.stderr.flush()

    def _write(self, text: str) -> None:
        sys.stderr.write("\r" + text.ljust(self._width))
        sys.stderr.flush()
        self._width = len(text)
