"""Checks FMUs of trocar by FMPy: python check.py TROCAR MODELS MOTION FOLDER

TROCAR is the program, MODELS a folder of model files, MOTION a CSV file with time_s and position_m, FOLDER takes what is
made. Exports every model for both versions of FMI and both inputs, and holds the FMUs against `trocar simulate`. Prints
what was compared; ends with 1 at the first difference.
"""

import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import zipfile

import fmpy
import numpy
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

from drive import Instance, Unit, read_motion

HEADERS = os.path.join(os.path.dirname(fmpy.__file__), "c-code")

# N: velocity times duration gives a position that is off by rounding, some 1e-17 m, and so the force by that times the
# steepest stiffness, with room for what a slip amplifies.
VELOCITY_TOLERANCE_N = 1e-9
# N: FMPy counts time in multiples of the step, not by adding up.
GRID_TOLERANCE_N = 1e-9
# N: 6 % of a rational Stribeck curve are left at 0.1 m/s, and F_s, 1.3 times F_c, grows with it.
STEADY_TOLERANCE_N = 5e-3
# N: how much more friction the test asks for.
MORE_N = 0.25


def check(is_so, what):
    if not is_so:
        raise AssertionError(what)


def skipped(why):
    """Reports a part that is not tested, also to the file that TROCAR_SKIPPED names (./test lists them); fails where CI is true."""
    line = f"skipped: {why}"
    print(line, flush=True)
    if "TROCAR_SKIPPED" in os.environ:
        with open(os.environ["TROCAR_SKIPPED"], "a") as reasons:
            print(line, file=reasons)
    check(os.environ.get("CI") != "true", why)


def refused(instance, action, *words):
    """The call fails with an error, and the FMU says why with these words."""
    before = len(instance.messages)
    try:
        action()
    except FMICallException as error:
        check(error.status == 3, f"status 3 expected: {error}")
    else:
        raise AssertionError(f"not refused: {words}")
    messages = "\n".join(instance.messages[before:])
    check(all(word in messages for word in words), f"{words} expected in: {messages}")


def refused_instance(unit, words, **options):
    """There is no instance, and the FMU says why with these words."""
    instance = Instance.__new__(Instance)
    try:
        instance.__init__(unit, **options)
    except Exception:
        check_words([words], "\n".join(instance.messages))
        return
    raise AssertionError(f"instantiated: {options}")


def simulate(trocar, model, motion):
    """Columns of `trocar simulate`: force, and for EMS elements deflection and mode."""
    command = [trocar, "--quiet", "simulate", model, motion, "--out", "-"]
    text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    rows = [line.split(",")[2:] for line in text.splitlines()[1:]]
    if len(rows[0]) == 1:
        return [(float(force),) for (force,) in rows]
    return [(float(force), float(deflection), {"deforming": 1, "sliding": 2}[mode]) for force, deflection, mode in rows]


def check_forces(unit, rows, truth):
    """Equal to the last bit, and again after a reset."""
    instance = Instance(unit)
    names = ["force_n", "deflection_m"][: len(truth[0])]
    for _ in range(2):
        instance.start(*rows[0])
        for row, expected in zip(rows, truth):
            instance.advance(*row)
            found = tuple(instance.get(*names)) + ((instance.mode(),) if len(expected) == 3 else ())
            check(found == expected, f"at {row[0]} s: {found}, simulated {expected}")
        instance.fmu.terminate()
        instance.fmu.reset()
    check(instance.messages == [], f"messages: {instance.messages}")
    instance.close()


def check_states(unit, rows, forces):
    """State in the middle of the way: back, into another instance by bytes, and a damaged one refused."""
    middle = len(rows) // 2
    first, second = Instance(unit, "first"), Instance(unit, "second")
    first.start(*rows[0])
    for row in rows[1:middle]:
        first.advance(*row)
    state = first.state()
    text = first.to_bytes(state)
    for _ in range(2):
        check([first.advance(*row) for row in rows[middle:]] == forces[middle:], "a state brought back goes on as before")
        first.set_state(state)
    copy = second.from_bytes(text, state[1])
    second.set_state(copy)
    check([second.advance(*row) for row in rows[middle:]] == forces[middle:], "a state by bytes goes on as before")
    refused(second, lambda: second.from_bytes(text[:-1], 0.0), "bytes")
    flipped = text[:40] + bytes([text[40] ^ 1]) + text[41:]
    refused(second, lambda: second.from_bytes(flipped, 0.0), "damaged")
    for instance, kept in [(first, state), (second, copy)]:
        instance.free_state(kept)
        instance.close()
    return text


def check_two(unit, rows, forces):
    """Two instances, step by step in turn, the second one late: each as if alone."""
    pair = [Instance(unit, "one"), Instance(unit, "two")]
    for instance in pair:
        instance.start(*rows[0])
    late = len(rows) // 5
    found = [[pair[0].force()], [pair[1].force()]]
    for k, row in enumerate(rows[1:], 1):
        found[0].append(pair[0].advance(*row))
        if k > late:
            found[1].append(pair[1].advance(*rows[k - late]))
    check(found[0] == forces, "the first of two instances is as if alone")
    check(found[1] == forces[: len(found[1])], "the second of two instances is as if alone")
    for instance in pair:
        instance.close()


def check_velocity(unit, rows, forces):
    """Driven by velocity; returns the largest difference, N."""
    instance = Instance(unit)
    off = max(abs(found - expected) for found, expected in zip(instance.run(rows), forces))
    check(off <= VELOCITY_TOLERANCE_N, f"driven by velocity, force is off by {off} N")
    instance.close()
    return off


def steady(instance):
    """Force after 600 mm at 0.1 m/s, N."""
    for _ in range(1200):
        end = instance.time + 5e-3
        instance.fmu.doStep(currentCommunicationPoint=instance.time, communicationStepSize=end - instance.time)
        instance.time = end
    return instance.force()


def check_functions(unit, fmi):
    """Every function that the headers of the standard declare is there."""
    with open(os.path.join(HEADERS, f"fmi{fmi}FunctionTypes.h")) as file:
        names = re.findall(rf"\b(fmi{fmi}\w+)TYPE\b", file.read())
    library = Instance(unit)
    missing = [name for name in names if not hasattr(library.fmu.dll, name)]
    check(len(names) > 40 and missing == [], f"functions missing: {missing}")
    library.close()


def c_compiler(purpose):
    """Reports if there is none, and fails where CI is true."""
    found = shutil.which("cc") or shutil.which("gcc")
    if found is None:
        skipped(f"{purpose}: no C compiler")
    return found


def check_by_c(unit, fmi, motion, forces, folder, words):
    """An importer in C with the headers of the standard, and sanitizers for memory. It prints the messages
    for the calls that are refused, with `words`."""
    compiler = c_compiler("the importer in C")
    if compiler is None:
        return
    program = os.path.join(folder, "importer")
    if not hasattr(check_by_c, "built"):
        source = os.path.join(os.path.dirname(os.path.abspath(__file__)), "importer.c")
        flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-g", "-fsanitize=address,undefined", "-I", HEADERS]
        subprocess.run([compiler, *flags, source, "-o", program, "-ldl", "-lm"], check=True)
        check_by_c.built = True
    place = {"2": ("linux64", pathlib.Path(unit.folder, "resources").as_uri())}
    place["3"] = ("x86_64-linux", os.path.join(unit.folder, "resources") + os.sep)
    name = unit.description.coSimulation.modelIdentifier + ".so"
    library = os.path.join(unit.folder, "binaries", place[fmi][0], name)
    command = [program, library, fmi, place[fmi][1], unit.description.guid, motion]
    ran = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    check(ran.returncode == 0, f"{command}: {ran.stderr}")
    check([float(line) for line in ran.stdout.splitlines()] == forces, "the importer in C finds the same forces")
    check_words(words, ran.stderr)


def check_words(words, messages):
    for expected in words:
        check(expected in messages, f"{expected} expected in {messages}")


def refusals(fmi, path):
    """The messages of a library for the calls of importer.c that are refused; `path` is where it looks for the model."""
    words = ["a state takes", "must be finite", "value reference 77", "null pointer for", "step size must be"]
    words += ["communication point must be", "beyond the stop time", "stop time must be", "not allowed now"]
    words += ["there are no derivatives"] + (["inputs are not interpolated"] if fmi == "2" else [])
    return words + ["for co-simulation only", path] + (["no event mode"] if fmi == "3" else [])


def source_refusals(fmi):
    """The same for an FMU with source code."""
    words = ["no state of this model", "must be finite", "no such variable", "null pointer for", "longer than 0"]
    words += ["begin at the present time", "beyond the stop time", "the start time must be finite", "not be called now"]
    words += ["for co-simulation only", "GUID or token is not that of this FMU", "not offered"]
    return words + (["no event mode", "one value for each"] if fmi == "3" else [])


def gain_at_end(model):
    """What the position-dependent force is multiplied by after the last knot."""
    with open(model) as file:
        profile = json.load(file).get("position_profile")
    return profile["gain"][-1] if profile else 1.0


def check_tuning(unit, gain):
    """More friction in the midst of a slide is felt as such, and taken back again; other values are refused."""
    names = [name for name in unit.starts if name.endswith("coulomb_force_n") and "withdrawal" not in name]
    if not names:
        return
    instance = Instance(unit)
    instance.start(0.0, 0.1)
    instance.set({"velocity_m_s": 0.1})
    before = steady(instance)
    old = [unit.starts[name] for name in names]
    instance.set({name: value + MORE_N for name, value in zip(names, old)})
    more = steady(instance) - before
    asked = gain * MORE_N * len(names)
    check(abs(more - asked) < STEADY_TOLERANCE_N, f"{asked} N more of {names} are {more} N")
    for bad in [0.0, -1.0, math.nan, math.inf]:
        refused(instance, lambda: instance.set({names[0]: bad}), names[0], "must be", "old value stays")
    check(instance.get(names[0])[0] == old[0] + MORE_N, "a refused value leaves the old one")
    instance.set(dict(zip(names, old)))
    after = steady(instance)
    check(abs(after - before) < STEADY_TOLERANCE_N, f"taken back, {after} N instead of {before} N")
    instance.close()


def check_faults(unit, rows, forces):
    """What is refused changes nothing: the forces are those of an undisturbed run."""
    instance = Instance(unit)
    step = instance.fmu.doStep
    refused(instance, lambda: step(0.0, 1e-3), "not allowed now", "not yet in initialization mode")
    instance.start(*rows[0])
    found = [instance.force()]
    for k, row in enumerate(rows[1:600]):
        now = instance.time
        if k % 100 == 50:
            for size in [0.0, -1e-3, math.nan, math.inf]:
                refused(instance, lambda: step(now, size), "step size must be positive and finite")
            refused(instance, lambda: step(now + 1.0, 1e-3), "communication point must be", "got")
            for value in [math.nan, math.inf, -math.inf]:
                refused(instance, lambda: instance.set({instance.input: value}), instance.input, "must be finite")
            refused(instance, lambda: instance.set({"force_n": 1.0}), "force_n cannot be set")
            refused(instance, lambda: instance.set({"initial_force_n": 1.0}), "initial_force_n cannot be set while")
            refused(instance, lambda: instance.fmu.exitInitializationMode(), "not allowed now", "stepping")
        found.append(instance.advance(*row))
    check(found == forces[:600], "refused calls change nothing")
    instance.fmu.terminate()
    refused(instance, lambda: step(instance.time, 1e-3), "terminated")
    instance.close()


def check_instantiation(unit, folder):
    """Wrong tokens and missing or damaged resources: no instance, and a message."""
    resources = os.path.join(unit.folder, "resources")
    with open(os.path.join(resources, "model.f64"), "rb") as file:
        model = file.read()
    cases = [
        (None, "cannot read the model"),
        (b"", "damaged"),
        (model[: len(model) // 2], "damaged"),
        (b"\xff" * len(model), "damaged"),
    ]
    cases = [(content, None, words) for content, words in cases]
    cases.append((model, "{00000000-0000-0000-0000-000000000000}", "is not that of the model"))
    for content, token, words in cases:
        # A blank and a percent sign: FMI 2.0 gives the folder as a URI.
        broken = os.path.join(folder, "broken 100%")
        shutil.rmtree(broken, ignore_errors=True)
        shutil.copytree(unit.folder, broken)
        path = os.path.join(broken, "resources", "model.f64")
        os.remove(path)
        if content is not None:
            with open(path, "wb") as file:
                file.write(content)
        refused_instance(unit, words, token=token, folder=broken)
    whole = os.path.join(folder, "whole 100% of it")
    shutil.rmtree(whole, ignore_errors=True)
    shutil.copytree(unit.folder, whole)
    Instance(unit, folder=whole).close()


def check_simulate_fmu(trocar, model, paths, folder):
    """FMPy's own loop, which sets the input that holds at the beginning of a step. A velocity is that of the step; a position comes
    one step late, and the force with it. Returns how far the first is off (N, largest) and how far the second is late (N, rms)."""
    step, count = 1e-3, 1000
    way = [0.1 + 0.004 * math.sin(2 * math.pi * 3.0 * k * step) for k in range(count + 1)]

    def along(positions):
        motion = os.path.join(folder, "motion.csv")
        with open(motion, "w") as file:
            file.write("time_s,position_m\n" + "".join(f"{k * step!r},{x!r}\n" for k, x in enumerate(positions)))
        return numpy.array([row[0] for row in simulate(trocar, model, motion)])

    def found(drive, values, start):
        signals = numpy.array([(k * step, x) for k, x in enumerate(values)], dtype=[("time", "f8"), (drive, "f8")])
        result = simulate_fmu(paths[drive.split("_")[0]], stop_time=count * step, output_interval=step, input=signals, start_values=start, output=["force_n"])
        return result["force_n"]

    truth = along(way)
    late = found("position_m", way, {})
    off = max(abs(late - along([way[0]] + way[:-1])))
    check(off <= GRID_TOLERANCE_N, f"by position simulate_fmu is off by {off} N from a motion one step late")
    velocities = [(b - a) / step for a, b in zip(way, way[1:])]
    on_time = found("velocity_m_s", velocities + velocities[-1:], {"initial_position_m": way[0]})
    off = max(abs(on_time - truth))
    check(off <= GRID_TOLERANCE_N, f"by velocity simulate_fmu is off by {off} N")
    return off, float(numpy.sqrt(numpy.mean((late - truth) ** 2)))


def check_source(trocar, model, fmi, motion, forces, folder):
    """An FMU with source code, compiled here, gives the same forces; its parameters are constants."""
    rows = read_motion(motion)
    for drive, tolerance in [("position", 0.0), ("velocity", VELOCITY_TOLERANCE_N)]:
        path = os.path.join(folder, f"source.{drive}.{fmi}.fmu")
        command = [trocar, "--quiet", "export", "fmu", model, "--source", "--fmi", fmi, "--input", drive, "--out", path]
        subprocess.run(command, check=True)
        problems = validate_fmu(path)
        check(problems == [], f"{path}: {problems}")
        with Unit(path) as unit:
            instance = Instance(unit)
            found = instance.run(rows)
            off = max(abs(a - b) for a, b in zip(found, forces))
            check(len(found) == len(forces) and off <= tolerance, f"{path}: {off} N")
            instance.close()
            check_source_calls(unit, rows, forces if drive == "position" else found)
            if drive == "position":
                check_by_c(unit, fmi, motion, forces, folder, source_refusals(fmi))


def check_source_calls(unit, rows, forces):
    """States, refusals and resets of an FMU with source code."""
    half = len(rows) // 2
    instance = Instance(unit)
    instance.start(*rows[0])
    for row in rows[1:half]:
        instance.advance(*row)
    state = instance.state()
    text = instance.to_bytes(state)
    for start in [state, instance.from_bytes(text, state[1])]:
        instance.set_state(start)
        check([instance.advance(*row) for row in rows[half:]] == forces[half:], "a state is not restored")
        instance.free_state(start)
    refused(instance, lambda: instance.from_bytes(b"x" + text[1:], 0.0), "no state of this model")
    refused(instance, lambda: instance.from_bytes(text[1:], 0.0), "no state of this model")
    constant = next(v for v in unit.description.modelVariables if v.variability == "constant")
    check(instance.get(constant.name)[0] == float(constant.start), f"{constant.name} is not its start value")
    refused(instance, lambda: instance.set({constant.name: 1.0}), "cannot be set")
    refused(instance, lambda: instance.set({instance.input: math.nan}), "must be finite")
    refused(instance, lambda: instance.fmu.doStep(currentCommunicationPoint=instance.time, communicationStepSize=0.0),
            "longer than 0")
    refused(instance, lambda: instance.fmu.doStep(currentCommunicationPoint=instance.time + 1.0,
                                                  communicationStepSize=1e-3), "present time")
    instance.fmu.reset()
    check(instance.run(rows) == forces, "a reset FMU does not begin anew")
    instance.close()
    refused_instance(unit, "GUID or token is not that of this FMU", token="{another}")


def standard_headers(folder):
    """The standard's headers. FMPy has changed that of FMI 2.0, which gives the names of functions no prefix."""
    headers = os.path.join(folder, "headers")
    shutil.copytree(HEADERS, headers, dirs_exist_ok=True)
    path = pathlib.Path(headers, "fmi2Functions.h")
    plain = "#define fmi2FullName(name) name\n"
    prefixed = """#define fmi2Paste(a, b) a ## b
#define fmi2PasteB(a, b) fmi2Paste(a, b)
#define fmi2FullName(name) fmi2PasteB(FMI2_FUNCTION_PREFIX, name)
"""
    text = path.read_text()
    check(text.count(plain) == 1, f"{path} has another fmi2FullName")
    path.write_text(text.replace(plain, prefixed))
    return headers


def check_linked(trocar, models, motion, folder):
    """Two FMUs with source code in one program, under the names that the standard gives their functions."""
    compiler = c_compiler("two FMUs in one program")
    if compiler is None:
        return
    headers = standard_headers(folder)
    flags = [compiler, "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-I", headers]
    source = os.path.join(os.path.dirname(os.path.abspath(__file__)), "linked.c")
    names = ["ems", "dahl"]
    files = [os.path.join(models, f"{name}.json") for name in names]
    truth = [[row[0] for row in simulate(trocar, file, motion)] for file in files]
    for fmi in "23":
        objects, tokens = [], []
        for name, file in zip(names, files):
            unit = os.path.join(folder, f"linked.{name}")
            command = [trocar, "--quiet", "export", "fmu", file, "--source", "--fmi", fmi, "--input", "position"]
            subprocess.run([*command, "--out", unit + ".fmu"], check=True)
            with zipfile.ZipFile(unit + ".fmu") as archive:
                archive.extractall(unit)
            objects.append(f"{unit}.o")
            subprocess.run([*flags, "-c", f"{unit}/sources/fmi{fmi}.c", "-o", objects[-1]], check=True)
            description = fmpy.read_model_description(unit)
            check(description.coSimulation.modelIdentifier == f"trocar_{name}", "another model identifier")
            tokens.append(description.guid)
            symbols = subprocess.run(["nm", "-g", "--defined-only", objects[-1]], check=True, stdout=subprocess.PIPE, text=True)
            visible = [line.split()[-1] for line in symbols.stdout.splitlines()]
            check(all(symbol.startswith(f"trocar_{name}_fmi{fmi}") for symbol in visible), f"{visible}")
        program = os.path.join(folder, "linked")
        macros = [f"-DFMI={fmi}", "-DFIRST=trocar_ems", "-DSECOND=trocar_dahl"]
        subprocess.run([*flags, *macros, source, *objects, "-o", program, "-lm"], check=True)
        ran = subprocess.run([program, *tokens, motion], check=True, stdout=subprocess.PIPE, text=True)
        found = [list(map(float, line.split())) for line in ran.stdout.splitlines()]
        check([list(column) for column in zip(*found)] == truth, f"two FMUs of FMI {fmi} in one program find other forces")
    print(f"two FMUs with source code in one program: {len(found)} rows bit-identical", flush=True)


def check_turning(trocar, model, motion, folder, by_source):
    """A model that turns: force and torque by position to the last bit, by velocity to rounding, with a library and from source."""
    name, rows = pathlib.Path(model).stem, read_motion(motion)
    command = [trocar, "--quiet", "simulate", model, motion, "--out", "-"]
    lines = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    columns = [lines[0].split(",").index(column) for column in ["force_n", "torque_n_m"]]
    truth = [float(line.split(",")[column]) for line in lines[1:] for column in columns]
    for fmi in "23":
        for drive, tolerance in [("position", 0.0), ("velocity", VELOCITY_TOLERANCE_N)]:
            for form in [[], ["--source"]] if by_source else [[]]:
                path = os.path.join(folder, f"{name}.{drive}.{fmi}{len(form)}.fmu")
                command = [trocar, "--quiet", "export", "fmu", model, *form, "--fmi", fmi, "--input", drive]
                subprocess.run([*command, "--out", path], check=True)
                problems = validate_fmu(path)
                check(problems == [], f"{path}: {problems}")
                with Unit(path) as unit:
                    instance = Instance(unit)
                    off = max(abs(a - b) for a, b in zip(instance.turn(rows), truth, strict=True))
                    check(off <= tolerance, f"{path}: {off}")
                    turn = "angle_rad" if drive == "position" else "angular_velocity_rad_s"
                    refused(instance, lambda: instance.set({turn: math.nan}), "must be finite")
                    instance.close()
    print(f"{name}: force and torque of {len(rows)} rows bit-identical", flush=True)


def has_cmake():
    """FMPy compiles source code by CMake."""
    if shutil.which("cmake"):
        return True
    skipped("FMUs with source code: no cmake to compile them")
    return False


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    trocar, models, motion, folder = map(os.path.abspath, sys.argv[1:])
    os.makedirs(folder, exist_ok=True)
    rows = read_motion(motion)
    foreign = {}
    by_source = has_cmake()
    check_linked(trocar, models, motion, folder)
    turning = pathlib.Path(models).parent / "turning"
    for model in sorted((turning / "models").iterdir()):
        check_turning(trocar, str(model), str(turning / "motion.csv"), folder, by_source)
    for file in sorted(os.listdir(models)):
        name, model = os.path.splitext(file)[0], os.path.join(models, file)
        truth = simulate(trocar, model, motion)
        forces = [row[0] for row in truth]
        results = []
        for fmi in "23":
            paths = {}
            for drive in ["position", "velocity"]:
                path = paths[drive] = os.path.join(folder, f"{name}.{drive}.{fmi}.fmu")
                command = [trocar, "--quiet", "export", "fmu", model, "--fmi", fmi, "--input", drive, "--out", path]
                subprocess.run(command, check=True)
                problems = validate_fmu(path)
                check(problems == [], f"{path}: {problems}")
                with zipfile.ZipFile(path) as archive:
                    check(archive.testzip() is None, f"{path}: archive is damaged")
            with Unit(paths["position"]) as unit:
                check_forces(unit, rows, truth)
                text = check_states(unit, rows, forces)
                check_two(unit, rows, forces)
                check_faults(unit, rows, forces)
                check_instantiation(unit, folder)
                other = foreign.get(fmi)
                if other is not None:
                    instance = Instance(unit)
                    refused(instance, lambda: instance.from_bytes(other, 0.0), "another model")
                    instance.close()
                foreign[fmi] = text
                if name == "ems_profile":
                    check_functions(unit, fmi)
                    # The message of FMI 2.0 is a printf format.
                    path = "/no such%/folder/model.f64" if fmi == "2" else "/no such/folder/model.f64"
                    check_by_c(unit, fmi, motion, forces, folder, refusals(fmi, path))
            with Unit(paths["velocity"]) as unit:
                off = check_velocity(unit, rows, forces)
                check_tuning(unit, gain_at_end(model))
            if by_source:
                check_source(trocar, model, fmi, motion, forces, folder)
            own, late = check_simulate_fmu(trocar, model, paths, folder)
            results.append(f"FMI {fmi}.0 by velocity {off:.1e} N; simulate_fmu by velocity {own:.1e} N, by position one step late, {late:.1e} N rms")
        print(f"{name}: {len(rows)} rows bit-identical; {'; '.join(results)}", flush=True)


if __name__ == "__main__":
    main()
