"""Writes the recordings that tests/formats.rs reads, with other people's libraries.

One known signal in every file: 240 rows, 100 Hz,
    time_s      k / 100
    position_mm 30 (1 - cos(2 pi k / 200))
    force_n     1.5 sin(2 pi k / 200) + 0.01 (k mod 7)
Run from this folder with the packages of requirements.txt, all of it or the functions named (python make.py xlsx); the files are
committed, so that tests need no Python.
"""

import datetime
import pathlib
import re
import sys
import zipfile

import flatbuffers
import h5py
import numpy as np
import openpyxl
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.ipc as ipc
import pyarrow.parquet as pq
import scipy.io
import scipy.sparse

HERE = pathlib.Path(__file__).parent
ROWS = 240
k = np.arange(ROWS)
time_s = k / 100
position_mm = 30 * (1 - np.cos(2 * np.pi * k / 200))
force_n = 1.5 * np.sin(2 * np.pi * k / 200) + 0.01 * (k % 7)
count = (k * k - 50).astype(np.int64)
is_in = k % 3 == 0
SIGNAL = {"time_s": time_s, "position_mm": position_mm, "force_n": force_n}
# Columns of the files that are about packing and paging alone.
FEW = ["time_s", "position", "force_n", "note", "gappy"]
# Nanoseconds since 1970 that an f64 cannot tell apart: 10 ms steps with 1 ns more each.
NANOSECONDS = 1_700_000_000_123_456_789 + k.astype(np.int64) * 10_000_001


def arrow_table():
    """Every kind of column, units beside the names."""
    fields = [
        pa.field("time_s", pa.float64()),
        pa.field("position", pa.float64(), metadata={"unit": "mm"}),
        pa.field("force_n", pa.float64(), metadata={"description": "sensor 3"}),
        pa.field("force_f32", pa.float32()),
        pa.field("count", pa.int64()),
        pa.field("small", pa.int16()),
        pa.field("unsigned", pa.uint64()),
        pa.field("is_in", pa.bool_()),
        pa.field("gappy", pa.float64()),
        pa.field("stamp", pa.timestamp("ns", tz="UTC")),
        pa.field("stamp_ms", pa.timestamp("ms")),
        pa.field("elapsed", pa.duration("us")),
        pa.field("note", pa.string()),
        pa.field("kind", pa.dictionary(pa.int32(), pa.string())),
        pa.field("last", pa.float64()),
    ]
    gappy = [None if row % 5 == 2 else float(row) for row in range(ROWS)]
    note = [f"row {row}" if row % 4 else None for row in range(ROWS)]
    columns = [
        time_s,
        position_mm,
        force_n,
        force_n.astype(np.float32),
        count,
        (k - 200).astype(np.int16),
        k.astype(np.uint64) + np.uint64(1 << 63),
        is_in,
        gappy,
        NANOSECONDS,
        NANOSECONDS // 1_000_000,
        k * 10_000,
        note,
        pa.array([["push", "pull"][row % 2] for row in range(ROWS)]).dictionary_encode(),
        force_n * 2,
    ]
    arrays = [c if isinstance(c, pa.Array) else pa.array(c, type=f.type) for c, f in zip(columns, fields)]
    return pa.table(arrays, schema=pa.schema(fields))


def parquet():
    pq.write_table(arrow_table(), HERE / "pyarrow_snappy.parquet", compression="snappy", row_group_size=150)
    table = arrow_table().select(FEW)
    for codec in ["none", "zstd", "gzip", "lz4"]:
        pq.write_table(table, HERE / f"pyarrow_{codec}.parquet", compression=codec, row_group_size=150)
    table = arrow_table()
    options = {"compression": "snappy", "use_dictionary": False}
    pq.write_table(table.select(FEW), HERE / "pyarrow_v2.parquet", data_page_version="2.0", data_page_size=512, **options)
    split = ["time_s", "position", "force_n"]
    pq.write_table(table.select(split), HERE / "pyarrow_split.parquet", use_byte_stream_split=split, **options)
    delta = {"count": "DELTA_BINARY_PACKED"}
    pq.write_table(table.select(["count"]), HERE / "pyarrow_delta.parquet", column_encoding=delta, **options)
    pq.write_table(table.select(["stamp"]), HERE / "pyarrow_int96.parquet", use_deprecated_int96_timestamps=True)
    pq.write_table(table.select(["time_s"]), HERE / "pyarrow_brotli.parquet", compression="brotli")
    nested = pa.table({"pose": [{"x": float(row), "list": [1.0]} for row in range(ROWS)], "force_n": force_n})
    pq.write_table(nested, HERE / "pyarrow_nested.parquet")
    frame = pd.DataFrame({"position_mm": position_mm, "force_n": force_n}, index=pd.Index(time_s, name="time_s"))
    frame.to_parquet(HERE / "pandas_index.parquet")
    pl.DataFrame(SIGNAL).with_columns(note=pl.lit("word")).write_parquet(HERE / "polars.parquet", row_group_size=100)


def arrow():
    feather.write_feather(arrow_table(), HERE / "pyarrow_lz4.feather", compression="lz4", chunksize=150)
    table = arrow_table().select(FEW)
    for codec in ["uncompressed", "zstd"]:
        feather.write_feather(table, HERE / f"pyarrow_{codec}.feather", compression=codec, chunksize=150)
    with ipc.new_stream(HERE / "pyarrow.arrows", table.schema) as stream:
        stream.write_table(table, max_chunksize=150)
    frame = pl.DataFrame({"note": [f"a rather long note {row}" for row in range(ROWS)], **SIGNAL})
    frame.write_ipc(HERE / "polars.arrow", compression="zstd")


def matlab():
    classes = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "single", "double"]
    held = {f"as_{name}": k[:100].astype(np.dtype({"single": "f4", "double": "f8"}.get(name, name))) for name in classes}
    run = {**SIGNAL, "fs_hz": 100.0, "inner": {"force_n": force_n[:50]}, "note": "a run"}
    samples = np.zeros(5, dtype=[("speed", "O"), ("label", "O"), ("trace", "O")])
    for row in range(5):
        samples[row] = (float(row) / 4, f"label {row}", force_n[: 10 + row])
    cell = np.empty((1, 2), dtype=object)
    cell[0, 0], cell[0, 1] = force_n[:20], "text"
    extra = {"wide": np.stack([time_s, position_mm, force_n]), "tall": np.stack([time_s, force_n], axis=1)}
    odd = {"sparse": scipy.sparse.eye(4).tocsc(), "complex": force_n * 1j, "cube": np.zeros((2, 3, 4)), "name": "seal 7"}
    everything = {**SIGNAL, **held, **extra, **odd, "run": run, "samples": samples, "cell": cell, "is_in": is_in, "gain": 2.5}
    scipy.io.savemat(HERE / "scipy_plain.mat", everything)
    scipy.io.savemat(HERE / "scipy_compressed.mat", everything, do_compression=True)
    scipy.io.savemat(HERE / "scipy_column.mat", SIGNAL, oned_as="column", do_compression=True)
    scipy.io.savemat(HERE / "scipy_v4.mat", SIGNAL, format="4")


def fill(group):
    """The signal with the ways that h5py stores arrays."""
    plain = group.create_dataset("time_s", data=time_s)
    plain.attrs["units"] = "s"
    position = group.create_dataset("position", data=position_mm, chunks=(64,), compression="gzip", shuffle=True)
    position.attrs["unit"] = np.bytes_("mm")
    group.create_dataset("force_n", data=force_n, chunks=(100,), compression="lzf", fletcher32=True)
    group.create_dataset("force_f32", data=force_n.astype(np.float32))
    group.create_dataset("big_endian", data=count.astype(">i4"))
    group.create_dataset("is_in", data=is_in)
    group.create_dataset("tall", data=np.stack([time_s, force_n], axis=1), chunks=(64, 2), compression="gzip")
    group.create_dataset("note", data=np.array([b"word"] * ROWS))
    group.create_dataset("gain", data=2.5)
    group.create_dataset("pairs", data=np.zeros(ROWS, dtype=[("a", "f8"), ("b", "i4")]))


def hdf5():
    with h5py.File(HERE / "h5py.h5", "w", libver=("earliest", "v110")) as file:
        fill(file.create_group("runs/first"))
        file.create_dataset("force_n", data=force_n[:30])
    for libver in ["v110", "latest"]:
        with h5py.File(HERE / f"h5py_{libver}.h5", "w", libver=libver) as file:
            file.create_dataset("time_s", data=time_s, chunks=(50,), compression="gzip", shuffle=True)
            file.create_dataset("force_n", data=force_n)


def mat73():
    """As MATLAB 7.3 writes it: 512 bytes of text in front, vectors transposed, classes as attributes, structs as groups."""
    path = HERE / "mat73.mat"
    with h5py.File(path, "w", userblock_size=512, libver=("earliest", "v108")) as file:
        def put(group, name, values, kind="double"):
            chunks = {"chunks": (1, 100), "compression": "gzip"} if values.size > 300 else {}
            group.create_dataset(name, data=values, **chunks).attrs["MATLAB_class"] = np.bytes_(kind)

        for name, values in SIGNAL.items():
            put(file, name, values[None, :])
        put(file, "tall", np.stack([time_s, force_n]))
        put(file, "is_in", is_in.astype(np.uint8)[None, :], "logical")
        put(file, "name", np.array([[ord(c)] for c in "seal 7"], dtype=np.uint16), "char")
        run = file.create_group("run")
        run.attrs["MATLAB_class"] = np.bytes_("struct")
        put(run, "time_s", time_s[None, :])
        put(run, "force_n", force_n[None, :])
        put(run, "fs_hz", np.array([[100.0]]))
        series = file.create_dataset("ts", data=np.zeros((1, 6), dtype=np.uint32))
        series.attrs["MATLAB_class"] = np.bytes_("timeseries")
        series.attrs["MATLAB_object_decode"] = np.int32(3)
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1 00:00:00 2024 HDF5 schema 1.00 ."
    head = text.ljust(116) + bytes(8) + b"\x00\x02IM"
    with open(path, "r+b") as file:
        file.write(head.ljust(512, b"\0"))


def xlsx():
    """Sheets as people fill them: lines before the header, units below it, dates, formulas with their results, faults."""
    book = openpyxl.Workbook()
    data = book.active
    data.title = "Data"
    rows = [["Operator", "A. Nobody"], ["Test", 7], [], ["Time", "Position", "Force", "gappy", "double", "note"], ["s", "mm", "N"]]
    for row in range(ROWS):
        gappy = None if row % 5 == 2 else row
        note = "inserted" if row % 4 else None
        rows.append([time_s[row], position_mm[row], force_n[row], gappy, f"=2*C{row + 6}", note])
    for row in rows:
        data.append(row)
    dates = book.create_sheet("Dates")
    dates.append([None, "Stamp", "Weg [mm]", "Kraft [N]", "iso"])
    start = datetime.datetime(2026, 11, 22, 23, 59, 59)
    for row in range(ROWS):
        stamp = start + datetime.timedelta(milliseconds=10 * row)
        dates.append([None, stamp, position_mm[row], force_n[row], stamp.isoformat()])
        dates.cell(row + 2, 2).number_format = "yyyy-mm-dd hh:mm:ss.000"
    fault = book.create_sheet("Fault")
    fault.append(["time_s", "position_mm", "force_n"])
    for row in range(ROWS):
        fault.append([time_s[row], "off" if row == 15 else position_mm[row], "#N/A" if row == 7 else force_n[row]])
    book.create_sheet("Remarks").append(["The seal was new."])
    book.create_sheet("Empty")
    plain = HERE / "plain.xlsx"
    book.save(plain)
    # openpyxl writes formulas without their results, which any spreadsheet program stores.
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(HERE / "openpyxl.xlsx", "w", zipfile.ZIP_DEFLATED) as new:
        for item in old.infolist():
            text = old.read(item)
            if item.filename == "xl/worksheets/sheet1.xml":
                result = lambda row: f"<f>2*C{row}</f><v>{float(2 * force_n[int(row) - 6])!r}</v>".encode()
                text, count = re.subn(rb"<f>2\*C(\d+)</f><v ?/?>(?:</v>)?", lambda found: result(found[1].decode()), text)
                assert count == ROWS, count
            new.writestr(item, text)
    plain.unlink()


def odd_xlsx():
    """Sheets with rows that are no readings: above a header that names nothing, a header in the middle, results at the end."""
    book = openpyxl.Workbook()
    rows = [[time_s[row], position_mm[row], force_n[row]] for row in range(ROWS)]
    names, units = ["Time", "Position", "Force"], ["s", "mm", "N"]
    results = [[], ["Mean", 30.0, 0.0], ["Range", 60.0, 3.0]]
    sheets = {
        "Again": [names, units, *rows[:100], names, units, *rows[100:]],
        "Results": [names, units, *rows, *results],
        "Skip": [[1, 2, 3], [4, 5, 6], names, units, *rows],
        "Middle": [names, units, *rows[:100], ["paused"], *rows[100:]],
        "Last": [names[::-1], units[::-1], *[row[::-1] for row in rows], [0.0, 30.0, "Mean"], [3.0, 60.0, "Range"]],
        "Units": [names, units, *rows[:100], [0.1, 30.0, "1.2 N"], *rows[101:]],
        "AllUnits": [names, *[[time, position, f"{force:.2f} N"] for time, position, force in rows]],
        "LastMiddle": [names[::-1], units[::-1], *[row[::-1] for row in rows[:100]], [0.0, 30.0, "Mean"],
                       *[row[::-1] for row in rows[100:]]],
        # Of two forces none is chosen, although the next sheet holds one.
        "TwoForces": [["time_s", "position_mm", "Force A (N)", "Force B (N)"], *[[*row, row[2]] for row in rows]],
        "OneForce": [["k", "force_n"], *[[k, row[2]] for k, row in enumerate(rows)]],
    }
    book.remove(book.active)
    for name, lines in sheets.items():
        sheet = book.create_sheet(name)
        for line in lines:
            sheet.append(line)
    book.save(HERE / "openpyxl_odd.xlsx")


def more_parquet():
    """Decimals in every physical type, and half floats."""
    decimal = lambda digits, scale: pa.array(force_n).cast(pa.decimal128(digits, scale), safe=False)
    table = pa.table({
        "time_s": pa.array(time_s).cast(pa.decimal128(9, 3)),
        "position_mm": pa.array(position_mm.astype(np.float16)),
        "force_n": decimal(17, 9),
        "wide": decimal(38, 20),
        "gappy": pa.array([None if row % 5 == 2 else float(row) for row in range(ROWS)]).cast(pa.decimal128(9, 2)),
    })
    pq.write_table(table, HERE / "pyarrow_decimal.parquet", store_decimal_as_integer=True)
    pq.write_table(table, HERE / "pyarrow_fixed_decimal.parquet")


def big_endian():
    """The beginning of an Arrow stream with numbers in big endian: one column of floats, no rows. pyarrow writes none."""
    make = flatbuffers.Builder(256)
    name = make.CreateString("time_s")
    make.StartObject(1)  # FloatingPoint
    make.PrependInt16Slot(0, 2, 0)
    kind = make.EndObject()
    make.StartVector(4, 0, 4)
    children = make.EndVector()
    make.StartObject(7)  # Field
    make.PrependUOffsetTRelativeSlot(0, name, 0)
    make.PrependUint8Slot(2, 3, 0)
    make.PrependUOffsetTRelativeSlot(3, kind, 0)
    make.PrependUOffsetTRelativeSlot(5, children, 0)
    field = make.EndObject()
    make.StartVector(4, 1, 4)
    make.PrependUOffsetTRelative(field)
    fields = make.EndVector()
    make.StartObject(4)  # Schema
    make.PrependInt16Slot(0, 1, 0)
    make.PrependUOffsetTRelativeSlot(1, fields, 0)
    schema = make.EndObject()
    make.StartObject(5)  # Message
    make.PrependInt16Slot(0, 4, 0)
    make.PrependUint8Slot(1, 1, 0)
    make.PrependUOffsetTRelativeSlot(2, schema, 0)
    make.Finish(make.EndObject())
    message = bytes(make.Output())
    message += bytes(-len(message) % 8)
    start = b"\xff" * 4
    (HERE / "big_endian.arrows").write_bytes(start + len(message).to_bytes(4, "little") + message + start + bytes(4))


def apart():
    """Position and force in groups of their own, with times of their own; and a table that is a compound."""
    with h5py.File(HERE / "h5py_apart.h5", "w") as file:
        for name, values, step in [("position", position_mm / 1000, 1), ("load", force_n, 2)]:
            group = file.create_group(name)
            group["time_s"] = time_s[::step]
            group["data" if name == "position" else "force_n"] = values[::step]
        file["log"] = np.zeros(3, dtype=[("time_s", "f8"), ("force_n", "f8")])


def mat74():
    """As mat73, with another version in its text, and with a longer block of text."""
    whole = (HERE / "mat73.mat").read_bytes().replace(b"MATLAB 7.3 MAT", b"MATLAB 7.4 MAT", 1)
    (HERE / "mat74.mat").write_bytes(whole)
    path = HERE / "h5py_block.mat"
    with h5py.File(path, "w", userblock_size=2048, libver=("earliest", "v108")) as file:
        for name, values in SIGNAL.items():
            file[name] = values[None, :]
    with open(path, "r+b") as file:
        file.write(whole[:512].ljust(2048, b"\0"))


for write in [parquet, arrow, matlab, hdf5, mat73, xlsx, odd_xlsx, more_parquet, big_endian, mat74, apart]:
    if len(sys.argv) == 1 or write.__name__ in sys.argv:
        write()
