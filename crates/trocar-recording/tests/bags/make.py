"""Writes the robot logs in this folder with the Python packages mcap, mcap-ros2-support and rosbags.

Run once, in an environment with requirements.txt; the files are committed, and the tests need no Python:

    python make.py

Every log holds the same motion, position(t) = 0.12 + 0.05 sin(pi t) m, on several topics:

    topic              type                              interval   header stamps
    /psm1/measured_js  sensor_msgs/msg/JointState        2 ms       START + k 2 ms
    /psm1/setpoint_js  sensor_msgs/msg/JointState        20 ms      as above
    /psm1/measured_cf  geometry_msgs/msg/WrenchStamped   5 ms       START + 1 ms + k 5 ms, of k = 20..27 none
    /psm1/measured_cp  geometry_msgs/msg/PoseStamped     20 ms      START + k 20 ms
    /sim/measured_cv   geometry_msgs/msg/TwistStamped    20 ms      5 s + k 20 ms: a clock of its own
    /load              std_msgs/msg/Float64              10 ms      none
    /levels            std_msgs/msg/Float64MultiArray    20 ms      none
    /state             std_msgs/msg/String               50 ms      none

The .bag files are bags of ROS 1 with the same messages; python make.py bags writes these alone.

odd.mcap holds a message of every kind of field, /little and /big endian; ros1.mcap two of the topics as ROS 1 lays them out.

Values: insertion = position(t), its effort = 1 + 10 position(t), yaw = k, outer = -k; force.z = 20 position(t) - 2, force.x = 0.25;
load.data = 20 position(log time) - 2. A message is logged LATENCY + (7919 k mod 97) us behind its time.
"""

import io
import math
import pathlib
import shutil
import sqlite3
import sys

import numpy as np
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from mcap_ros2._dynamic import serialize_dynamic
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

HERE = pathlib.Path(__file__).parent
START = 1_700_000_000_123_456_789
LATENCY = 300_000
MS = 1_000_000
STORE = get_typestore(Stores.ROS2_HUMBLE)
ROS1 = get_typestore(Stores.ROS1_NOETIC)
SAMPLES = 100


def position(ns):
    return 0.12 + 0.05 * math.sin(math.pi * ((ns - START) * 1e-9))


def make(kind, **fields):
    return STORE.types[kind](**fields)


def header(stamp):
    time = make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    return make("std_msgs/msg/Header", stamp=time, frame_id="psm1")


def vector(x, y, z):
    return make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def joints(stamp, k):
    p = position(stamp)
    v = 0.05 * math.pi * math.cos(math.pi * ((stamp - START) * 1e-9))
    return make(
        "sensor_msgs/msg/JointState",
        header=header(stamp),
        name=["yaw", "insertion", "outer"],
        position=np.array([float(k), p, -float(k)]),
        velocity=np.array([0.0, v, 0.0]),
        effort=np.array([0.0, 1 + 10 * p, 0.0]),
    )


def wrench(stamp):
    force = vector(0.25, 0.0, 20 * position(stamp) - 2)
    value = make("geometry_msgs/msg/Wrench", force=force, torque=vector(0.0, 0.0, 0.0))
    return make("geometry_msgs/msg/WrenchStamped", header=header(stamp), wrench=value)


def pose(stamp):
    at = make("geometry_msgs/msg/Point", x=0.001, y=0.002, z=position(stamp))
    turned = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    value = make("geometry_msgs/msg/Pose", position=at, orientation=turned)
    return make("geometry_msgs/msg/PoseStamped", header=header(stamp), pose=value)


def twist(stamp, k):
    value = make("geometry_msgs/msg/Twist", linear=vector(0.0, 0.0, 0.001 * k), angular=vector(0.0, 0.0, 0.0))
    return make("geometry_msgs/msg/TwistStamped", header=header(stamp), twist=value)


def levels(k):
    layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    return make("std_msgs/msg/Float64MultiArray", layout=layout, data=np.array([k, k + 0.5], dtype=float))


def plain(message):
    """The message as mcap-ros2-support takes it."""
    if hasattr(message, "__msgtype__"):
        return {name: plain(getattr(message, name)) for name in message.__dataclass_fields__ if name != "__msgtype__"}
    return message.tolist() if isinstance(message, np.ndarray) else message


def messages():
    """(log time, publish time, topic, type, message), by log time."""
    found = []

    def add(time, k, topic, kind, message):
        log = time + LATENCY + (7919 * k % 97) * 1000
        found.append((log, time + LATENCY // 2, topic, kind, message))

    for k in range(SAMPLES):
        t = START + k * 2 * MS
        add(t, k, "/psm1/measured_js", "sensor_msgs/msg/JointState", joints(t, k))
    for k in range(2 * SAMPLES // 5):
        stamp = START + k * 5 * MS + MS
        if not 20 <= k < 28:
            add(stamp, k, "/psm1/measured_cf", "geometry_msgs/msg/WrenchStamped", wrench(stamp))
    for k in range(SAMPLES // 5):
        t = START + k * 10 * MS
        log = t + LATENCY + (7919 * k % 97) * 1000
        add(t, k, "/load", "std_msgs/msg/Float64", make("std_msgs/msg/Float64", data=20 * position(log) - 2))
    for k in range(SAMPLES // 10):
        t = START + k * 20 * MS
        add(t, k, "/psm1/setpoint_js", "sensor_msgs/msg/JointState", joints(t, k))
        add(t, k, "/psm1/measured_cp", "geometry_msgs/msg/PoseStamped", pose(t))
        add(t, k, "/sim/measured_cv", "geometry_msgs/msg/TwistStamped", twist(5 * 10**9 + k * 20 * MS, k))
        add(t, k, "/levels", "std_msgs/msg/Float64MultiArray", levels(k))
    for k in range(SAMPLES // 25):
        add(START + k * 50 * MS, k, "/state", "std_msgs/msg/String", make("std_msgs/msg/String", data="ready"))
    found.sort(key=lambda row: row[0])
    return found


def write_mcap(name, rows, **options):
    """Plain MCAP, the messages laid out by mcap-ros2-support."""
    stream = io.BytesIO()
    writer = McapWriter(stream, chunk_size=8192, **options)
    writer.start(profile="ros2", library="make.py")
    schemas, channels, encoders = {}, {}, {}
    for log, publish, topic, kind, message in rows:
        if kind not in schemas:
            text = STORE.generate_msgdef(kind, ros_version=2)[0]
            schemas[kind] = writer.register_schema(kind, "ros2msg", text.encode())
            encoders[kind] = serialize_dynamic(kind, text)[kind]
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
        writer.add_message(channels[topic], log, encoders[kind](plain(message)), publish)
    writer.finish()
    (HERE / name).write_bytes(stream.getvalue())


def write_json(name):
    """Foxglove's JSON, and a channel of an encoding that nobody reads here."""
    stream = io.BytesIO()
    writer = McapWriter(stream, compression=CompressionType.LZ4)
    writer.start(library="make.py")
    schema = writer.register_schema("Rig", "jsonschema", b'{"type": "object"}')
    rig = writer.register_channel("/rig", "json", schema)
    other = writer.register_channel("/other", "protobuf", writer.register_schema("Other", "protobuf", b"\x0a\x00"))
    for k in range(SAMPLES):
        t = START + k * 2 * MS
        stamp = f'{{"sec": {t // 10**9}, "nsec": {t % 10**9}}}'
        text = f'{{"stamp": {stamp}, "position": {position(t)!r}, "force": {{"z": {k}}}, "ok": true, "tag": "a"}}'
        writer.add_message(rig, t, text.encode(), t)
        writer.add_message(other, t, b"\x08\x01", t)
    writer.finish()
    (HERE / name).write_bytes(stream.getvalue())


def write_bag(name, rows, big_endian=False, compressed=False, storage=StoragePlugin.SQLITE3, version=9):
    """A bag of rosbags, in its folder."""
    folder = HERE / name
    shutil.rmtree(folder, ignore_errors=True)
    writer = BagWriter(folder, version=version, storage_plugin=storage)
    if compressed:
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for log, _, topic, kind, message in rows:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            data = STORE.serialize_cdr(message, kind, little_endian=not big_endian)
            writer.write(connections[topic], log, data)
    return folder


PART = "uint8 flag\nfloat64 size\nstring label"
ODD = """# Fields that need padding, of changing lengths
uint8 NEVER=3
bool on
int16 small
string tag
int64 big
uint8[3] bytes
float32 ratio
Part[] parts
Part[2] pair
builtin_interfaces/Duration span
string[] joint_names
geometry_msgs/Vector3 tip
float64[] angles
string<=10 end
uint64 last
"""


def odd(k):
    def part(flag):
        return make("trocar_msgs/msg/Part", flag=flag, size=flag + 0.5, label="p" * (k % 3))

    names = ["a", "b"] if k % 2 == 0 else ["b", "a"]
    return make(
        "trocar_msgs/msg/Odd",
        on=k % 2 == 1,
        small=-k,
        tag="x" * k,
        big=k * 10**10,
        bytes=np.array([k, k + 1, k + 2], dtype=np.uint8),
        ratio=k / 4,
        parts=[part(k + j) for j in range(2 + k % 2)],
        pair=[part(10), part(20 + k)],
        span=make("builtin_interfaces/msg/Duration", sec=k, nanosec=500_000_000),
        joint_names=names,
        tip=vector(0.0, -0.5 * k, 1.0),
        angles=np.array([1.0 * k, -1.0 * k] if names[0] == "a" else [-1.0 * k, 1.0 * k]),
        end="e" * (k % 5),
        last=3 * k,
    )


def write_odd(name):
    """Messages of every kind of field in both byte orders."""
    kind = "trocar_msgs/msg/Odd"
    STORE.register(get_types_from_msg(PART, "trocar_msgs/msg/Part"))
    STORE.register(get_types_from_msg(ODD, kind))
    stream = io.BytesIO()
    writer = McapWriter(stream)
    writer.start(profile="ros2", library="make.py")
    schema = writer.register_schema(kind, "ros2msg", STORE.generate_msgdef(kind, ros_version=2)[0].encode())
    for topic, is_little in (("/little", True), ("/big", False)):
        channel = writer.register_channel(topic, "cdr", schema)
        for k in range(20):
            data = STORE.serialize_cdr(odd(k), kind, little_endian=is_little)
            writer.add_message(channel, START + k * MS, bytes(data), START + k * MS)
    writer.finish()
    (HERE / name).write_bytes(stream.getvalue())


def as_ros1(message):
    """The same message with ROS 1's types."""
    if not hasattr(message, "__msgtype__"):
        return message
    if message.__msgtype__.endswith("/Time"):
        return ROS1.types["builtin_interfaces/msg/Time"](sec=message.sec, nanosec=message.nanosec)
    fields = {name: as_ros1(getattr(message, name)) for name in message.__dataclass_fields__ if name != "__msgtype__"}
    if message.__msgtype__.endswith("/Header"):
        fields["seq"] = 7
    return ROS1.types[message.__msgtype__](**fields)


def write_ros1(name, rows):
    """Messages of ROS 1, as bags of ROS 1 are converted to MCAP."""
    stream = io.BytesIO()
    writer = McapWriter(stream)
    writer.start(profile="ros1", library="make.py")
    channels = {}
    for log, publish, topic, kind, message in rows:
        if topic not in channels:
            text = ROS1.generate_msgdef(kind, ros_version=1)[0]
            schema = writer.register_schema(kind.replace("/msg/", "/"), "ros1msg", text.encode())
            channels[topic] = writer.register_channel(topic, "ros1", schema)
        writer.add_message(channels[topic], log, bytes(ROS1.serialize_ros1(as_ros1(message), kind)), publish)
    writer.finish()
    (HERE / name).write_bytes(stream.getvalue())


def write_ros1_bag(name, rows, compression=None):
    """A bag of ROS 1 in chunks of some 4 kB."""
    path = HERE / name
    path.unlink(missing_ok=True)
    writer = Ros1Writer(path)
    if compression:
        writer.set_compression(compression)
    writer.chunk_threshold = 4096
    with writer:
        connections = {}
        for log, _, topic, kind, message in rows:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS1)
            writer.write(connections[topic], log, bytes(ROS1.serialize_ros1(as_ros1(message), kind)))


def only(rows, *topics):
    return [row for row in rows if row[2] in topics]


def disordered(rows):
    """Neighbours swapped by up to 40 places, so that chunks overlap in time."""
    order = sorted(range(len(rows)), key=lambda k: k + 7919 * k % 41)
    return [rows[k] for k in order]


def write_split(rows):
    """Two files of one bag whose names sort the wrong way round."""
    folder = HERE / "split"
    shutil.rmtree(folder, ignore_errors=True)
    half = len(rows) // 2
    parts = [write_bag("part_a", rows[:half]), write_bag("part_b", rows[half:])]
    folder.mkdir()
    shutil.move(parts[0] / "part_a.db3", folder / "split_10.db3")
    shutil.move(parts[1] / "part_b.db3", folder / "split_9.db3")
    text = (parts[0] / "metadata.yaml").read_text()
    text = text.replace("  - part_a.db3", "  - split_10.db3\n  - split_9.db3").replace("part_a.db3", "split_10.db3")
    (folder / "metadata.yaml").write_text(text)
    for part in parts:
        shutil.rmtree(part)


def write_old(rows):
    """A bag as rosbag2 wrote it before definitions went with it."""
    folder = write_bag("old_bag", rows)
    shutil.move(folder / "old_bag.db3", HERE / "old.db3")
    shutil.rmtree(folder)
    with sqlite3.connect(HERE / "old.db3") as base:
        base.execute("DROP TABLE message_definitions")
        base.commit()
        base.execute("VACUUM")


def write_ros1_bags(rows):
    write_ros1_bag("ros1_none.bag", rows)
    write_ros1_bag("ros1_bz2.bag", rows, Ros1Writer.CompressionFormat.BZ2)
    write_ros1_bag("ros1_lz4.bag", rows, Ros1Writer.CompressionFormat.LZ4)


def main():
    rows = messages()
    write_ros1_bags(rows)
    if sys.argv[1:] == ["bags"]:
        return
    write_mcap("zstd.mcap", rows, compression=CompressionType.ZSTD)
    write_mcap("lz4.mcap", rows, compression=CompressionType.LZ4)
    write_mcap("plain.mcap", rows, compression=CompressionType.NONE)
    write_mcap("unchunked.mcap", rows, use_chunking=False)
    bare = dict(index_types=IndexType.NONE, use_statistics=False, use_summary_offsets=False)
    write_mcap("bare.mcap", rows, repeat_channels=False, repeat_schemas=False, **bare)
    write_mcap("disordered.mcap", disordered(rows))
    write_json("json.mcap")
    few = only(rows, "/psm1/measured_js", "/psm1/measured_cf")
    write_odd("odd.mcap")
    write_ros1("ros1.mcap", few)
    write_bag("sqlite", rows)
    write_bag("big_endian", few[:50], big_endian=True)
    write_bag("compressed", few[:50], compressed=True)
    write_bag("mcap", few[:45], storage=StoragePlugin.MCAP, version=8)
    write_split(few[:50])
    write_old(few[:50])


if __name__ == "__main__":
    main()
