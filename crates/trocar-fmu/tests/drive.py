"""Runs an FMU of trocar along a motion: python drive.py FMU MOTION

MOTION is a CSV file with the columns time_s and position_m. Prints one force in newtons per row, with as many digits as
give the number back. The first row is where the instrument stands; a row at the time of the row before changes nothing.
An FMU driven by velocity gets the velocity that leads to the position of the row. With a third column angle_rad, which begins
at 0, it also turns, and a torque in newton metres follows each force.

Needs FMPy 0.3.32, and with it Python 3.10, for FMUs with source code also CMake: pip install --no-deps -r requirements.txt
"""

import csv
import os
import shutil
import sys

import fmpy
from fmpy.build import build_platform_binary
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave


def build(folder):
    """Compiles the source code of an FMU by CMake; what that prints goes to standard error."""
    sys.stdout.flush()
    output = os.dup(1)
    os.dup2(2, 1)
    try:
        build_platform_binary(folder)
    finally:
        os.dup2(output, 1)
        os.close(output)


class Unit:
    """A decompressed FMU; one with source code is compiled."""

    def __init__(self, path):
        self.description = fmpy.read_model_description(path)
        self.folder = fmpy.extract(path)
        if not os.path.isdir(os.path.join(self.folder, "binaries")):
            build(self.folder)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.starts = {v.name: float(v.start) for v in self.description.modelVariables if v.start is not None}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        shutil.rmtree(self.folder, ignore_errors=True)


class Instance:
    """One instance of a unit. A call that is refused raises FMICallException; `messages` holds what the FMU said."""

    def __init__(self, unit, name="seal", token=None, folder=None):
        self.unit = unit
        self.messages = []
        self.is_fmi2 = unit.description.fmiVersion.startswith("2")
        self.input = "position_m" if "velocity_m_s" not in unit.references else "velocity_m_s"
        kind = FMU2Slave if self.is_fmi2 else FMU3Slave
        self.fmu = kind(
            guid=unit.description.guid if token is None else token,
            unzipDirectory=unit.folder if folder is None else folder,
            modelIdentifier=unit.description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        if self.is_fmi2:
            callbacks = fmi2CallbackFunctions()
            callbacks.logger = fmi2CallbackLoggerTYPE(lambda _e, _n, _s, _c, text: self.messages.append(text.decode()))
            self.fmu.instantiate(callbacks=callbacks)
        else:
            self.fmu.instantiate(logMessage=lambda _e, _s, _c, text: self.messages.append(text.decode()))

    def set(self, values):
        """Sets variables by name, all in one call."""
        references = [self.unit.references[name] for name in values]
        (self.fmu.setReal if self.is_fmi2 else self.fmu.setFloat64)(references, list(values.values()))

    def get(self, *names):
        references = [self.unit.references[name] for name in names]
        return (self.fmu.getReal if self.is_fmi2 else self.fmu.getFloat64)(references)

    def force(self):
        return self.get("force_n")[0]

    def mode(self):
        """1 deforming, 2 sliding."""
        reference = [self.unit.references["mode"]]
        return (self.fmu.getInteger if self.is_fmi2 else self.fmu.getInt64)(reference)[0]

    def start(self, time, position):
        """Begins at rest at `position`, m."""
        self.time, self.angle = time, 0.0
        if self.is_fmi2:
            self.fmu.setupExperiment(startTime=time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=time)
        self.set({"initial_position_m" if self.input == "velocity_m_s" else "position_m": position})
        self.fmu.exitInitializationMode()

    def advance(self, time, position, angle=None):
        """Steps to `position` (m) and `angle` (rad) at `time` (s), unless that is now."""
        duration = time - self.time
        if duration > 0.0:
            if angle is not None:
                name = "angle_rad" if self.input == "position_m" else "angular_velocity_rad_s"
                self.set({name: angle if self.input == "position_m" else (angle - self.angle) / duration})
                self.angle = angle
            if self.input == "position_m":
                self.set({"position_m": position})
            else:
                self.set({"velocity_m_s": (position - self.get("position_m")[0]) / duration})
            self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=duration)
            self.time = time
        return self.force()

    def run(self, motion):
        """Forces along all of `motion`, N."""
        self.start(*motion[0][:2])
        return [self.force()] + [self.advance(*row) for row in motion[1:]]

    def turn(self, motion):
        """Force (N) and torque (N m) along all of `motion`, in turn."""
        self.start(*motion[0][:2])
        pairs = [self.get("force_n", "torque_n_m")]
        for row in motion[1:]:
            self.advance(*row)
            pairs.append(self.get("force_n", "torque_n_m"))
        return [value for pair in pairs for value in pair]

    def state(self):
        return (self.fmu.getFMUstate if self.is_fmi2 else self.fmu.getFMUState)(), self.time

    def set_state(self, state):
        (self.fmu.setFMUstate if self.is_fmi2 else self.fmu.setFMUState)(state[0])
        self.time = state[1]

    def free_state(self, state):
        (self.fmu.freeFMUstate if self.is_fmi2 else self.fmu.freeFMUState)(state[0])

    def to_bytes(self, state):
        return (self.fmu.serializeFMUstate if self.is_fmi2 else self.fmu.serializeFMUState)(state[0])

    def from_bytes(self, text, time):
        read = self.fmu.deSerializeFMUstate if self.is_fmi2 else self.fmu.deserializeFMUState
        return read(text), time

    def close(self):
        self.fmu.fmi2FreeInstance(self.fmu.component) if self.is_fmi2 else self.fmu.fmi3FreeInstance(self.fmu.component)


def read_motion(path):
    """Rows (time in s, position in m, and where there is one the angle in rad)."""
    with open(path, newline="") as file:
        rows = csv.DictReader(file)
        names = [name for name in ["time_s", "position_m", "angle_rad"] if name in rows.fieldnames]
        return [tuple(float(row[name]) for name in names) for row in rows]


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    with Unit(sys.argv[1]) as unit:
        instance = Instance(unit)
        try:
            motion = read_motion(sys.argv[2])
            forces = instance.turn(motion) if len(motion[0]) == 3 else instance.run(motion)
        except FMICallException as error:
            sys.exit("\n".join([str(error)] + instance.messages))
        instance.close()
    sys.stdout.write("".join(f"{force!r}\n" for force in forces))


if __name__ == "__main__":
    main()
