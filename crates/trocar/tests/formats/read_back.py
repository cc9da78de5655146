"""Reads with pyarrow what trocar::table wrote into the folder given, and compares it with what tests/table.rs put in."""

import gzip
import pathlib
import sys

import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.parquet as pq

ROWS = 210_000
folder = pathlib.Path(sys.argv[1])


def check(table):
    assert table.column_names == ["force_n", "count", "is_good", "warnings"], table.column_names
    assert [field.type for field in table.schema] == [pa.float64(), pa.int64(), pa.bool_(), pa.string()], table.schema
    assert table.schema.field("force_n").metadata == {b"unit": b"N"}, table.schema.field("force_n").metadata
    assert table.schema.field("count").metadata is None
    assert table.num_rows == ROWS
    there = [row for row in range(ROWS) if row % 7 != 3]
    for column in table.columns:
        assert column.null_count == ROWS - len(there)
    rows = table.to_pylist()
    for row in there:
        found = rows[row]
        assert found["force_n"] == row / 3, (row, found)
        assert found["count"] == row - (1 << 60), (row, found)
        assert found["is_good"] == (row % 2 == 0), (row, found)
        assert found["warnings"] == f'a, "b" {row}', (row, found)


check(pq.read_table(folder / "a.parquet"))
check(feather.read_table(folder / "a.arrow"))
plain = (folder / "a.csv").read_bytes()
assert gzip.decompress((folder / "a.csv.gz").read_bytes()) == plain
assert pa.CompressedInputStream(str(folder / "a.csv.zst"), "zstd").read() == plain
