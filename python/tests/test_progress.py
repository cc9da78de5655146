"""Who watches sees how far the work is; nobody else is bothered."""

from __future__ import annotations

import importlib.util
import io
import sys
import time
import types

import pytest

import trocar
from trocar import _progress

from .conftest import ROD_KG


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def work(recordings: list[trocar.Recording], **options: object) -> trocar.Identification:
    same = {"moving_mass_kg": ROD_KG}
    return trocar.identify(recordings, **same, **options)  # type: ignore[arg-type]


def watched(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO) -> io.StringIO:
    """``stream`` as standard error; not a fixture, because pytest puts its own in place later."""
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


@pytest.fixture()
def no_tqdm(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *rest: None if name == "tqdm" else found(name, *rest),
    )


def test_a_terminal_shows_a_bar_that_disappears(
    training: list[trocar.Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = watched(monkeypatch, Terminal())
    work(training)
    assert "%|" in terminal.getvalue() and "steady state" in terminal.getvalue()
    assert not terminal.getvalue().split("\r")[-1].strip()


@pytest.mark.usefixtures("no_tqdm")
def test_without_tqdm_it_is_a_line(
    training: list[trocar.Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = watched(monkeypatch, Terminal())
    work(training)
    lines = [line.strip() for line in terminal.getvalue().split("\r")]
    assert not lines[-1] and "\n" not in terminal.getvalue()
    shown = [int(line.rpartition(" ")[2].rstrip("%")) for line in lines if line]
    assert shown and shown == sorted(shown) and 0 <= shown[0] and shown[-1] <= 100


def test_the_part_done_is_that_of_the_time(training: list[trocar.Recording], held_out: list[trocar.Recording]) -> None:
    begin, reports = time.perf_counter(), []
    work(training, validate=held_out, progress=lambda _, part: reports.append((time.perf_counter() - begin, part)))
    end = time.perf_counter() - begin
    late = max(part - at / end for at, part in reports)
    assert late < 0.35, "it says that all is nearly done long before the end"


def test_the_line_disappears_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = watched(monkeypatch, Terminal())
    bar = _progress._Line()
    bar.show("a long stage", 0.5)
    bar.show("short", 0.6)
    bar.close()
    lines = terminal.getvalue().split("\r")
    assert lines[1:3] == ["a long stage: 50%", "short: 60%       "] and not lines[3].strip()


def test_nobody_is_bothered_elsewhere(
    training: list[trocar.Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = watched(monkeypatch, Terminal())
    work(training, progress=False)
    assert not terminal.getvalue()
    file = watched(monkeypatch, io.StringIO())
    work(training)
    assert not file.getvalue()
    work(training, progress=True)
    assert "steady state" in file.getvalue()
    with pytest.raises(TypeError, match="progress must be a function, True, False or None, got 3"):
        work(training, progress=3)


def test_a_notebook_has_a_bar_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    class ZMQInteractiveShell:
        pass

    fake = types.SimpleNamespace(get_ipython=ZMQInteractiveShell)
    monkeypatch.setitem(sys.modules, "IPython", fake)
    assert _progress.is_notebook()
    monkeypatch.setattr(_progress, "_has", lambda module: module != "ipywidgets")
    with _progress.watched(None) as watching:
        assert watching is None
    calls: list[object] = []

    class Bar:
        n = 0.0

        def __init__(self, **options: object) -> None:
            calls.append(options["total"])

        def set_description_str(self, stage: str, refresh: bool) -> None:
            calls.append(stage)

        def update(self, more: float) -> None:
            self.n += more
            calls.append(self.n)

        def close(self) -> None:
            calls.append("closed")

    monkeypatch.setattr(_progress, "_has", lambda module: True)
    monkeypatch.setitem(sys.modules, "tqdm.notebook", types.SimpleNamespace(tqdm=Bar))
    with _progress.watched(None) as watching:
        assert watching is not None
        watching("fitting", 0.25)
        watching("scoring", 0.5)
    assert calls == [100, "fitting", 25, "scoring", 50, "closed"]
