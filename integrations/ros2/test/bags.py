"""The library without ROS along recorded bags gives the numbers of `trocar compensate` along the same bags.

    bags.py TROCAR REPLAY FOLDER [RECORDING.csv ...]

TROCAR is the program, REPLAY that of replay.cpp. Bags are written from the virtual bench, and from any RECORDING given (time, position,
force in SI units); the bag in the repository is read, too. Ends with 1 where a number differs.
"""

import csv
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

REPOSITORY = Path(__file__).resolve().parents[3]
MODEL = REPOSITORY / "conformance/models/ems.json"
STORE = get_typestore(Stores.ROS2_JAZZY)
START_NS = 1_700_000_000_000_000_000
FORCE_ERROR_N = "0.1"

# Where the clock of the bag starts with the first stamp, both programs compute with the same times: the same bits. Otherwise times
# differ in their last digit, and forces by what that does.
EXACT_N = 0.0
ROUNDED_N = 1e-6


def make(kind, /, **fields):
    return STORE.types[kind](**fields)


def stamped(time_ns, frame):
    stamp = make("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def joint_state(time_ns, position_m, order):
    names = ["outer_yaw", "outer_pitch", "outer_insertion"]
    places = [0.1, 0.2, position_m]
    return make(
        "sensor_msgs/msg/JointState",
        header=stamped(time_ns, ""),
        name=[names[k] for k in order],
        position=np.array([places[k] for k in order]),
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )


def wrench(time_ns, force_n):
    vector = lambda x, y, z: make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)  # noqa: E731
    both = make("geometry_msgs/msg/Wrench", force=vector(0.3, -0.2, force_n), torque=vector(0.0, 0.0, 0.0))
    return make("geometry_msgs/msg/WrenchStamped", header=stamped(time_ns, "sensor"), wrench=both)


def read_recording(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    force = "force_n" if "force_n" in rows[0] else "force_N"
    return [np.array([float(row[name]) for row in rows]) for name in ("time_s", "position_m", force)]


def write_bag(folder, recording, joint_ns, wrench_ns, offset_ns, latency_ns, storage):
    """Joint states every joint_ns, wrenches every wrench_ns from offset_ns on; logged latency_ns after their stamp."""
    time_s, position_m, force_n = recording
    end_ns = int((time_s[-1] - time_s[0]) * 1e9)
    rows = []
    for k, after_ns in enumerate(range(0, end_ns, joint_ns)):
        place = np.interp(after_ns / 1e9, time_s - time_s[0], position_m)
        order = [0, 1, 2] if k % 3 else [2, 0, 1]
        message = joint_state(START_NS + after_ns, place, order)
        rows.append((START_NS + after_ns + latency_ns, "/PSM1/measured_js", "sensor_msgs/msg/JointState", message))
    for after_ns in range(offset_ns, end_ns, wrench_ns):
        force = np.interp(after_ns / 1e9, time_s - time_s[0], force_n)
        message = wrench(START_NS + after_ns, force)
        rows.append((START_NS + after_ns + latency_ns, "/PSM1/measured_cf", "geometry_msgs/msg/WrenchStamped", message))
    rows.sort(key=lambda row: row[0])
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        connections = {}
        for log_ns, topic, kind, message in rows:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], log_ns, STORE.serialize_cdr(message, kind))
    return folder


def messages(bag, joint):
    """Lines for REPLAY, in the order of the log."""
    lines = []
    with AnyReader([bag], default_typestore=STORE) as reader:
        for connection, _, data in reader.messages():
            message = None
            if connection.msgtype.endswith(("/JointState", "/WrenchStamped")):
                message = reader.deserialize(data, connection.msgtype)
                stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            if connection.topic.endswith("/measured_js"):
                lines.append(f"position {stamp} {float(message.position[message.name.index(joint)])!r}")
            elif connection.topic.endswith("/measured_cf"):
                lines.append(f"reading {stamp} {float(message.wrench.force.z)!r}")
    return "\n".join(lines) + "\n"


def compensated(trocar, bag, folder, options):
    out = folder / f"{bag.name}.csv"
    command = [trocar, "--quiet", "compensate", MODEL, bag, "--force-error-n", FORCE_ERROR_N, "--out", out, *options]
    ran = subprocess.run(command, capture_output=True, text=True)
    if ran.returncode not in (0, 3):  # 3: done, with rows that have no tissue force
        raise SystemExit(f"{bag.name}: trocar compensate ended with {ran.returncode}\n{ran.stderr}")
    with open(out, newline="") as file:
        rows = list(csv.reader(file))[1:]
    return np.array([[float(cell) for cell in row] for row in rows])


def replayed(replay, bag, joint, longest_s):
    command = [replay, MODEL, FORCE_ERROR_N, str(longest_s)]
    ran = subprocess.run(command, input=messages(bag, joint), capture_output=True, text=True, check=True)
    rows = [line.split(",") for line in ran.stdout.splitlines()]
    # Position, reading, trocar, tissue, standard deviation, adapting: the columns of trocar compensate after its time.
    return np.array([[float(cell) for cell in row[1:7]] for row in rows])


def compare(programs, bag, joint, longest_s, bound_n, options=()):
    trocar, replay, folder = programs
    expected = compensated(trocar, bag, folder, options)[:, 1:7]
    found = replayed(replay, bag, joint, longest_s)
    if found.shape != expected.shape:
        print(f"{bag.name}: {len(found)} samples, trocar compensate has {len(expected)}")
        return False
    missing = np.isnan(expected)
    difference = np.where(missing, 0.0, np.abs(found - expected))
    same_missing = np.array_equal(missing, np.isnan(found))
    largest = float(difference.max())
    good = same_missing and largest <= bound_n and not math.isnan(largest)
    print(
        f"{bag.name}: {len(found)} samples, {int(missing[:, 3].sum())} without tissue force, largest difference {largest:.3g}, "
        f"at most {bound_n:g}{'' if same_missing else '; missing values differ'}"
    )
    return good


def main():
    trocar, replay, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    programs = trocar, replay, folder
    bench = folder / "bench.csv"
    subprocess.run([trocar, "--quiet", "bench", "dynamic", "--out", bench], check=True)
    recordings = [bench, *map(Path, sys.argv[4:])]
    ms = 1_000_000
    cases = {
        "alike": (ms, ms, 0, 0, StoragePlugin.SQLITE3, EXACT_N),
        "late_wrench": (ms, 2 * ms, 300_000, 0, StoragePlugin.MCAP, EXACT_N),
        "slow_joints": (10 * ms, ms, 400_000, 0, StoragePlugin.SQLITE3, EXACT_N),
        "slow_wrench": (ms, 10 * ms, 0, 0, StoragePlugin.MCAP, EXACT_N),
        "logged_later": (ms, ms, 250_000, 1_234_567, StoragePlugin.SQLITE3, ROUNDED_N),
    }
    good = True
    for path in recordings:
        recording = read_recording(path)
        for name, (joint_ns, wrench_ns, offset_ns, latency_ns, storage, bound_n) in cases.items():
            bag = write_bag(
                folder / f"{path.stem}_{name}", recording, joint_ns, wrench_ns, offset_ns, latency_ns, storage
            )
            good &= compare(programs, bag, "outer_insertion", 0.05, bound_n)
    # One that other tests read: 500 Hz and 200 Hz, a gap in the wrench that trocar compensate finds by itself (3 usual intervals).
    bag = REPOSITORY / "crates/trocar-recording/tests/bags/sqlite"
    # Beside the wrench it has a load cell and a motor's effort, so the force is named.
    force = ["--columns", "force_n=/psm1/measured_cf.wrench.force.z"]
    good &= compare(programs, bag, "insertion", 0.015, ROUNDED_N, force)
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
