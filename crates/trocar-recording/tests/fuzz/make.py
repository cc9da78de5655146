"""Writes the smallest forms of some inputs that failed; the others are as `./fuzz` kept them."""

import pathlib
import re
import sqlite3
import struct
import zipfile

here = pathlib.Path(__file__).parent
MAGIC = b"\x89MCAP0\r\n"
record = lambda code, body: struct.pack("<BQ", code, len(body)) + body
text = struct.pack("<I", 0x7FFFFFFF)

# A text in a schema, and in what stands in place of the footer, of 2 GB.
(here / "schema.mcap").write_bytes(MAGIC + record(3, struct.pack("<H", 1) + text + b"name"))
(here / "footer.mcap").write_bytes(MAGIC + record(1, text + bytes(16)) + MAGIC)

# Messages 1, 2 and 1 again, where ascending numbers are taken for granted.
bag = here / "order.db3"
bag.unlink(missing_ok=True)
connection = sqlite3.connect(bag)
connection.execute("PRAGMA page_size = 512")
connection.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
connection.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
connection.execute("INSERT INTO topics VALUES (1, '/bench/force_n', 'std_msgs/msg/Float64', 'cdr')")
value = b"\x00\x01\x00\x00" + struct.pack("<d", 1.5)
for number in (1, 2, 3):
    connection.execute("INSERT INTO messages VALUES (?, 1, ?, ?)", (number, 1000000 * number, value))
connection.commit()
connection.close()
whole = bag.read_bytes()
at = whole.index(b"\x03\x05\x00")
bag.write_bytes(whole[:at] + b"\x01" + whole[at + 1 :])

# page_header.parquet was found by ./fuzz: bytes in place of a page header that state an endless list.
# date_beyond_header.txt, too: rows with a date in a cell for which the header has no name.

# A workbook without compression: changed bytes reach the XML. Only the first 40 rows of each sheet.
source = here.parent / "formats" / "openpyxl.xlsx"
with zipfile.ZipFile(source) as old, zipfile.ZipFile(here / "stored.xlsx", "w", zipfile.ZIP_STORED) as new:
    for item in old.infolist():
        content = old.read(item)
        if item.filename.startswith("xl/worksheets/"):
            content = re.sub(rb'<row r="(4[1-9]|[5-9]\d|\d{3})".*?</row>', b"", content, flags=re.S)
        new.writestr(zipfile.ZipInfo(item.filename), content)
