"""Writes C++ structs for the ROS 2 messages of this package, from the definitions in rosbags: messages.py FOLDER

Both distributions that the package supports must define them alike.
"""

import re
import sys
from pathlib import Path

from rosbags.typesys import Stores, get_typestore
from rosbags.interfaces import Nodetype

NEEDED = [
    "diagnostic_msgs/msg/DiagnosticArray",
    "geometry_msgs/msg/WrenchStamped",
    "rcl_interfaces/msg/FloatingPointRange",
    "rcl_interfaces/msg/ParameterDescriptor",
    "rcl_interfaces/msg/SetParametersResult",
    "sensor_msgs/msg/JointState",
]
BASES = {
    "bool": "bool", "byte": "unsigned char", "string": "std::string", "float64": "double",
    "uint8": "std::uint8_t", "int32": "std::int32_t", "uint32": "std::uint32_t", "int64": "std::int64_t",
    "uint64": "std::uint64_t",
}  # fmt: skip


def include(name):
    package, _, message = name.split("/")
    return f"{package}/msg/{re.sub('(?<=[a-z])(?=[A-Z])', '_', message).lower()}.hpp"


def cpp(kind):
    """The C++ type of a field, and the messages that it needs."""
    node, what = kind
    if node == Nodetype.BASE:
        return BASES[what[0]], []
    if node == Nodetype.NAME:
        return what.replace("/", "::"), [what]
    if node == Nodetype.SEQUENCE:
        inner, needs = cpp(what[0])
        return f"std::vector<{inner}>", needs
    raise ValueError(f"no C++ type for {kind}")


def write(folder, stores, name):
    definitions = [store.fielddefs[name] for store in stores]
    if any(definition != definitions[0] for definition in definitions):
        raise ValueError(f"{name} differs between the distributions")
    constants, fields = definitions[0]
    needs, lines = [], []
    for constant, kind, value in constants:
        lines.append(f"    static constexpr {BASES[kind]} {constant} = {value};")
    for field, kind in fields:
        inner, more = cpp(kind)
        needs += more
        lines.append(f"    {inner} {field}{{}};")
    package, _, message = name.split("/")
    includes = "".join(f"#include <{include(need)}>\n" for need in sorted(set(needs)))
    body = "\n".join(lines)
    text = f"""#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>
{includes}
namespace {package}::msg {{
struct {message} {{
    using SharedPtr = std::shared_ptr<{message}>;
    using ConstSharedPtr = std::shared_ptr<const {message}>;
{body}
}};
}} // namespace {package}::msg
"""
    path = folder / include(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    for need in needs:
        write(folder, stores, need)


def main():
    stores = [get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS2_JAZZY)]
    for name in NEEDED:
        write(Path(sys.argv[1]), stores, name)


if __name__ == "__main__":
    main()
