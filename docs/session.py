"""Writes a robot log as the pages of the book read it: a recording of the virtual bench as MCAP, with the topics and joints of an arm.

    python session.py RECORDING.csv SESSION.mcap

Joint states at the rate of the recording, the wrench of the sensor at half of it. Messages are JSON, so that nothing but Python is needed.
"""

import csv
import json
import struct
import sys

MAGIC = b"\x89MCAP0\r\n"
START_NS = 1_700_000_000_000_000_000


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def message(channel: int, number: int, time_ns: int, content: dict[str, object]) -> bytes:
    return record(5, struct.pack("<HIQQ", channel, number, time_ns, time_ns) + json.dumps(content).encode())


def stamp(time_ns: int) -> dict[str, object]:
    return {"stamp": {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}, "frame_id": ""}


topics = {1: ("/PSM1/measured_js", "sensor_msgs/msg/JointState"), 2: ("/ATI/measured_cf", "geometry_msgs/msg/WrenchStamped")}
with open(sys.argv[1], newline="") as source, open(sys.argv[2], "wb") as log:
    log.write(MAGIC + record(1, text("") + text("session.py")))
    for number, (topic, kind) in topics.items():
        log.write(record(3, struct.pack("<H", number) + text(kind) + text("") + text("")))
        log.write(record(4, struct.pack("<HH", number, number) + text(topic) + text("json") + struct.pack("<I", 0)))
    for k, row in enumerate(csv.DictReader(source)):
        now = START_NS + round(float(row["time_s"]) * 1e9)
        joints = {"name": ["yaw", "pitch", "insertion"], "position": [0.1, -0.2, float(row["position_m"])]}
        log.write(message(1, k, now, {"header": stamp(now), **joints}))
        if k % 2 == 0:
            force = {"x": 0.1, "y": -0.05, "z": float(row["force_n"])}
            log.write(message(2, k // 2, now, {"header": stamp(now), "wrench": {"force": force}}))
    log.write(record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC)
