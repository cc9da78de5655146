"""Recordings from arrays, data frames and files are equal; invalid ones give clear errors."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pandas as pd
import polars as pl
import pytest
import xarray as xr

import trocar


def columns(samples: int = 3000) -> dict[str, np.ndarray]:
    """Strokes in integer micrometres and millinewtons, so that unit conversion does not round twice."""
    time = np.arange(samples)
    position = np.round(20_000 * (1 - np.cos(3e-3 * time)))
    force = np.round(3000 * np.sign(np.gradient(position)) + 5 * np.sin(time))
    return {"time_ms": time.astype(float), "Position (um)": position, "force_mN": force}


def made() -> trocar.Recording:
    time, position, force = columns().values()
    return trocar.Recording(time / 1e3, position / 1e6, force / 1e3)


def same(a: trocar.Recording, b: trocar.Recording) -> bool:
    pairs = ((a.time_s, b.time_s), (a.position_m, b.position_m), (a.force_n, b.force_n))
    return all(np.array_equal(x, y) for x, y in pairs)


@pytest.mark.parametrize("frame", [dict, pd.DataFrame, pl.DataFrame], ids=["dictionary", "pandas", "polars"])
def test_frames_of_all_kinds_are_understood(frame: object) -> None:
    recording = trocar.Recording.from_frame(frame(columns()))
    assert same(recording, made()) and recording.sha256 == made().sha256


def test_record_arrays_and_files_are_understood(tmp_path: Path) -> None:
    table = columns()
    record = np.rec.fromarrays(list(table.values()), names="time_ms,position_um,force_mN")
    assert same(trocar.Recording.from_frame(record), made())
    pd.DataFrame(table).to_csv(tmp_path / "strokes.csv", index=False)
    read = trocar.read(tmp_path / "strokes.csv")
    assert same(read, made()) and read.name == "strokes.csv"
    read.save(tmp_path / "again.csv")
    assert same(trocar.read(tmp_path / "again.csv"), made())


def test_columns_are_named_in_order_where_names_say_nothing() -> None:
    table = dict(zip("abcd", [*list(columns().values())[:2], np.zeros(3000), columns()["force_mN"]]))
    recording = trocar.Recording.from_frame(pd.DataFrame(table), columns="time_ms,position_um,-,force_mn")
    assert same(recording, made())
    with pytest.raises(trocar.RecordingError, match="no time, position or force column among 'a, b, c, d'"):
        trocar.Recording.from_frame(table)
    with pytest.raises(trocar.RecordingError, match="for 3 columns, but frame has 4"):
        trocar.Recording.from_frame(table, columns="time_ms,position_um,force_mn")


NAMED = {"time_ms": "zeit", "position_um": "weg", "force_mn": "kraft"}


def test_columns_are_named_by_a_dictionary(tmp_path: Path) -> None:
    table = dict(zip(NAMED.values(), columns().values()))
    assert same(trocar.Recording.from_frame(pd.DataFrame(table), columns=NAMED), made())
    pd.DataFrame(table).to_csv(tmp_path / "strokes.csv", index=False)
    assert same(trocar.read(tmp_path / "strokes.csv", columns=NAMED), made())
    flipped = trocar.Recording.from_frame({**table, "kraft": -table["kraft"]}, columns={**NAMED, "force_mn": "-kraft"})
    assert same(flipped, made())
    odd = {"t, (s)": table["zeit"], 'the "way"': table["weg"], "kraft, reversed": -table["kraft"]}
    spelled = {"time_ms": "t, (s)", "position_um": 'the "way"', "force_mn": "-kraft, reversed"}
    assert same(trocar.Recording.from_frame(odd, columns=spelled), made())


def test_a_file_is_read_like_the_recordings_of_a_model(tmp_path: Path, training: list[trocar.Recording]) -> None:
    steady = training[0]
    volts = pd.DataFrame({"t": steady.time_s, "counts": steady.position_m / 4e-6, "U": -steady.force_n / 22.2})
    volts.to_csv(tmp_path / "volts.csv", index=False)
    named = {"time_s": "t", "position_mm": "0.004*counts", "force_n": "-22.2*U"}
    model = trocar.identify(trocar.read(tmp_path / "volts.csv", columns=named), paper=True).model
    with pytest.raises(trocar.RecordingError):
        trocar.read(tmp_path / "volts.csv")
    like = trocar.read(tmp_path / "volts.csv", like=model)
    assert np.allclose(like.force_n, steady.force_n, atol=1e-9)
    assert np.allclose(like.position_m, steady.position_m, atol=1e-12)


def test_a_dictionary_the_wrong_way_round_is_answered_by_the_right_one() -> None:
    table = dict(zip(NAMED.values(), columns().values()))
    wrong = {theirs: ours for ours, theirs in NAMED.items()}
    with pytest.raises(trocar.ParameterError) as raised:
        trocar.Recording.from_frame(table, columns=wrong)
    assert f"columns={NAMED}" in str(raised.value)
    with pytest.raises(trocar.RecordingError, match="a name that no column has, expected one of zeit, weg, kraft"):
        trocar.Recording.from_frame(table, columns={**NAMED, "force_mn": "f"})
    for nonsense in (3, ["time_ms"], {"time_ms": 0}):
        with pytest.raises(TypeError, match="columns must be a text or a dictionary of texts"):
            trocar.Recording.from_frame(table, columns=nonsense)  # type: ignore[arg-type]


START = pd.Timestamp("2026-03-01T10:00:00")


def dated(times: object) -> list[object]:
    """Frames whose times are dates: in a column of any name for a time, or in the index."""
    _, position, force = columns().values()
    data = {"position_um": position, "force_mn": force}
    index = pd.Index(times)
    return [
        pd.DataFrame({"timestamp": index, **data}),
        pd.DataFrame({"time_ms": index, **data}),
        pd.DataFrame(data, index=index),
        pd.DataFrame(data, index=index.rename("Uhrzeit")),
        {"time": index, **data},
    ]


@pytest.mark.parametrize("kind", ["dates", "with a time zone", "durations"])
def test_times_may_be_dates_or_durations(kind: str) -> None:
    durations = pd.to_timedelta(columns()["time_ms"], unit="ms")
    dates = START + durations
    times = {"dates": dates, "with a time zone": dates.tz_localize("Europe/Berlin"), "durations": durations}[kind]
    frames = dated(times)
    if kind == "dates":
        frames.append(pl.DataFrame({"timestamp": times.to_numpy(), **frames[-1]}).drop("time"))
    for frame in frames:
        assert same(trocar.Recording.from_frame(frame), made()), frame
    _, position, force = columns().values()
    for values in (times, pd.Series(times), times.to_numpy() if kind != "with a time zone" else times):
        assert same(trocar.Recording(values, position / 1e6, force / 1e3), made())
    model = trocar.Model.plausible()
    assert np.array_equal(
        trocar.simulate(model, times, position / 1e6), trocar.simulate(model, made().time_s, position / 1e6)
    )


def test_a_missing_date_is_a_missing_sample() -> None:
    frame = dated(START + pd.to_timedelta(columns()["time_ms"], unit="ms"))[0]
    frame.loc[[0, 5], "timestamp"] = pd.NaT
    recording = trocar.Recording.from_frame(frame)
    assert len(recording) == 2998 and recording.time_s[0] == 0 and recording.warnings


def test_the_index_is_the_time_only_where_no_column_is() -> None:
    frame = pd.DataFrame(columns()).set_index("time_ms")
    assert same(trocar.Recording.from_frame(frame), made())
    both = pd.DataFrame(columns(), index=START + pd.to_timedelta(np.arange(3000.0), unit="h"))
    assert same(trocar.Recording.from_frame(both), made())
    with pytest.raises(trocar.RecordingError, match="no time column among"):
        trocar.Recording.from_frame(frame.reset_index(drop=True))


def test_data_sets_of_xarray_are_understood() -> None:
    time, position, force = columns().values()
    units = {"weg": "um", "kraft": "mN"}
    dates = START.to_datetime64() + (time * 1e6).astype("timedelta64[ns]")
    data = xr.Dataset({"weg": ("time", position), "kraft": ("time", force)}, coords={"time": dates, "seal": "a"})
    for name, unit in units.items():
        data[name].attrs["units"] = unit
    named = {"position": "weg", "force": "kraft", "time": "time"}
    assert same(trocar.Recording.from_frame(data, columns=named), made())
    renamed = data.rename(weg="position", kraft="force")
    assert same(trocar.Recording.from_frame(renamed), made())
    assert same(trocar.Recording(renamed.time, renamed.position / 1e6, renamed.force / 1e3), made())
    array = renamed.rename(position="position_um", force="force_mn").to_dataarray("channel")
    assert same(trocar.Recording.from_frame(array), made())
    with pytest.raises(TypeError, match="a DataArray needs a dimension of samples and one that names the columns"):
        trocar.Recording.from_frame(renamed.force)


def test_recordings_are_sliced() -> None:
    whole = trocar.bench("step")
    part = whole[100:300]
    for name in ("time_s", "position_m", "force_n", "velocity_m_s"):
        assert np.array_equal(getattr(part, name), getattr(whole, name)[100:300]), name
    assert len(whole[:]) == len(whole) and len(whole[-50:]) == 50 and whole[:-50].time_s[-1] == whole.time_s[-51]
    assert part.name == f"{whole.name}, samples 100 to 300" and part.sha256 != whole.sha256
    assert set(whole.notes) <= set(part.notes)
    for wrong in (5, slice(0.1, 0.2), "force_n"):
        with pytest.raises(TypeError, match=r"recording\[1000:5000\]"):
            whole[wrong]  # type: ignore[index]
    with pytest.raises(trocar.ParameterError, match="step 2: a recording keeps its sampling"):
        whole[::2]
    with pytest.raises(trocar.RecordingError, match="found 0 usable samples"):
        whole[10:10]


def test_recordings_are_cropped_by_time_as_files_are(tmp_path: Path) -> None:
    whole = made()
    whole.save(tmp_path / "whole.csv")
    for limits in ({"from_s": 0.5, "to_s": 1.5}, {"from_s": 2.0}, {"to_s": 0.25}, {}):
        cropped = whole.crop(**limits)
        assert same(cropped, trocar.read(tmp_path / "whole.csv", **limits)), limits
    later = trocar.Recording(whole.time_s + 100, whole.position_m, whole.force_n)
    assert np.array_equal(later.crop(1, 2).force_n, whole.crop(1, 2).force_n)
    with pytest.raises(trocar.ParameterError, match="to_s must be finite"):
        whole.crop(to_s=np.inf)
    with pytest.raises(trocar.ParameterError, match="from_s is 2 s, expected less than to_s, 1 s"):
        whole.crop(2, 1)


def test_a_part_keeps_the_limit_of_the_sensor() -> None:
    time, position, force = columns().values()
    clipped = trocar.Recording(time / 1e3, position / 1e6, np.clip(force / 1e3, -2, 2), sensor_limit_n=2)
    part = clipped[200:2000]
    assert {found["level_n"] for found in part.quality["saturated"]} == {-2.0, 2.0}


def test_hints_speak_python() -> None:
    with pytest.raises(trocar.RecordingError) as raised:
        trocar.Recording.from_frame({"time": [0], "position_mm": [0], "force_n": [0]})
    assert "columns='time_s=time' (replace them by your units)" in str(raised.value)
    assert "--" not in str(raised.value)


def test_missing_values_are_left_out_and_told() -> None:
    frame = pd.DataFrame(columns()).astype("Float64")
    frame.iloc[[5, 700], 2] = pd.NA
    recording = trocar.Recording.from_frame(frame)
    assert len(recording) == 2998
    assert any("samples 5, 700" in warning for warning in recording.warnings)
    polar = pl.DataFrame(columns()).with_columns(pl.col("force_mN").replace(pl.col("force_mN").max(), None))
    assert trocar.Recording.from_frame(polar).warnings


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda t: t.assign(force_mN="x"), trocar.ArrayError, "force_mN must hold numbers, got objects"),
        (lambda t: t.assign(force_mN=pd.Timestamp(0)), trocar.ArrayError, "force_mN must hold numbers, got dates"),
        (lambda t: t.assign(time_ms=pd.Timestamp(0)), trocar.RecordingError, "time stays at 0 s in all 3000 samples"),
        (lambda t: t.drop(columns="force_mN"), trocar.RecordingError, "no force column among 'time_ms, Position (um)'"),
        (lambda t: t.assign(force_2_n=1.0), None, ""),
        (lambda t: t.assign(Force_N=1.0), trocar.RecordingError, "force could be 'force_mN' or 'Force_N'"),
        (lambda t: t.head(3), trocar.RecordingError, "found 3 usable samples, expected at least 8"),
        (lambda t: t.iloc[::-1], trocar.RecordingError, "time goes back from 2.999 s to 2.998 s"),
        (lambda t: t.assign(time_ms=1.0), trocar.RecordingError, "time stays at 0.001 s in all 3000 samples"),
        (lambda t: t.rename(columns={"Position (um)": "x_m"}), trocar.RecordingError, "expected at most 2 m"),
    ],
)
def test_frames_that_cannot_be_used_are_refused(change: object, error: type | None, words: str) -> None:
    frame = change(pd.DataFrame(columns()))
    if error is None:
        assert len(trocar.Recording.from_frame(frame)) == 3000
        return
    with pytest.raises(error) as raised:
        trocar.Recording.from_frame(frame)
    assert words in str(raised.value)


def test_things_that_are_no_frames_are_refused() -> None:
    for thing in (3, "frame", None, np.zeros((3, 3))):
        with pytest.raises(TypeError, match="expected a data frame or a dictionary of columns"):
            trocar.Recording.from_frame(thing)
    with pytest.raises(TypeError, match="LazyFrame holds no data yet; call its collect"):
        trocar.Recording.from_frame(pl.DataFrame(columns()).lazy())


def test_lengths_are_named() -> None:
    with pytest.raises(trocar.RecordingError, match="force has 9 samples, expected 10 as time has"):
        trocar.Recording(range(10), np.zeros(10), np.zeros(9))
    with pytest.raises(trocar.RecordingError, match="velocity has 1 samples, expected 10 as time has"):
        trocar.Recording(range(10), np.zeros(10), np.zeros(10), [0.0])


def test_options_of_the_sensor() -> None:
    time, position, force = columns().values()
    flipped = trocar.Recording(time / 1e3, position / 1e6, -force / 1e3, flip_force=True, name="upside down")
    assert np.array_equal(flipped.force_n, made().force_n) and flipped.name == "upside down"
    assert "sign of the force reversed" in flipped.notes
    clipped = trocar.Recording(time / 1e3, position / 1e6, np.clip(force / 1e3, -2, 2), sensor_limit_n=2)
    assert clipped.quality["saturated"]
    with pytest.raises(trocar.ParameterError, match="sensor_limit_n must be positive, got -1 N"):
        trocar.Recording(time, position, force, sensor_limit_n=-1)


def test_columns_of_a_recording_cannot_be_written_to() -> None:
    recording = made()
    assert recording.time_s is recording.time_s
    with pytest.raises(ValueError, match="read-only"):
        recording.force_n[0] = 1


def test_recordings_are_pickled_with_all_that_is_known() -> None:
    time, position, force = columns().values()
    force[[3, 4]] = np.nan
    for recording in (trocar.bench("step"), trocar.Recording(time / 1e3, position / 1e6, force / 1e3)):
        restored = pickle.loads(pickle.dumps(recording))
        assert same(recording, restored)
        assert (restored.name, restored.sha256, restored.quality) == (recording.name, recording.sha256, recording.quality)
        assert (restored.velocity_m_s is None) == (recording.velocity_m_s is None)


def test_the_bench_says_what_it_does_not_know() -> None:
    with pytest.raises(trocar.ParameterError, match='unknown protocol "dance"'):
        trocar.bench("dance")  # type: ignore[arg-type]
    with pytest.raises(trocar.BenchError):
        trocar.bench("step", config="[rig]\nsample_rate_hz = -1")
    assert "[rod]" in trocar.bench_config()
    assert trocar.bench("step", seed=2).sha256 != trocar.bench("step").sha256 == trocar.bench("step", seed=1).sha256
