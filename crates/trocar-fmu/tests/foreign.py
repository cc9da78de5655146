"""Runs FMUs of trocar on an emulated platform: python foreign.py TROCAR MODELS MOTION FOLDER PLATFORM LIBRARY

TROCAR is the program for this machine, Linux on x86-64; MODELS a folder of model files, MOTION a CSV file with time_s and
position_m; FOLDER takes what is made. PLATFORM is x86_64-windows (by Wine) or aarch64-linux (by QEMU), LIBRARY trocar-fmu
for it. Exports every model for both versions of FMI with that library beside the one for this machine, and compares the
forces that an importer for the platform finds with `trocar simulate`. Prints the largest difference; ends with 1 if there
is one.
"""

import os
import subprocess
import sys
import zipfile

import fmpy
from check import HEADERS, check, check_words, refusals, simulate


class Windows:
    compiler = ["x86_64-w64-mingw32-gcc", "-D__USE_MINGW_ANSI_STDIO=1"]  # numbers with all their digits
    run = ["wine"]
    folders = {"2": "win64", "3": "x86_64-windows"}
    library = "trocar.dll"

    @staticmethod
    def path(path):
        """As programs under Wine name it."""
        return "Z:" + path.replace("/", "\\")

    @staticmethod
    def uri(path):
        return "file:///Z:" + path


class Aarch64:
    compiler = ["aarch64-linux-gnu-gcc"]
    run = ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"]
    folders = {"2": "aarch64-linux", "3": "aarch64-linux"}
    library = "trocar.so"
    path = staticmethod(lambda path: path)
    uri = staticmethod(lambda path: "file://" + path)


PLATFORMS = {"x86_64-windows": Windows, "aarch64-linux": Aarch64}
NATIVE = {"2": "linux64", "3": "x86_64-linux"}


def build(platform, folder):
    program = os.path.join(folder, "importer.exe")
    source = os.path.join(os.path.dirname(os.path.abspath(__file__)), "importer.c")
    flags = ["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-I", HEADERS]
    subprocess.run([*platform.compiler, *flags, source, "-o", program, "-lm"], check=True)
    return program


def run(platform, importer, fmi, unit, token, motion):
    """Forces, and what the FMU refused."""
    library = platform.path(os.path.join(unit, "binaries", platform.folders[fmi], platform.library))
    resources = os.path.join(unit, "resources")
    place = platform.uri(resources) if fmi == "2" else platform.path(resources + os.sep)
    command = [*platform.run, importer, library, fmi, place, token, platform.path(motion)]
    ran = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    check(ran.returncode == 0, f"{command}: {ran.stderr}")
    return [float(line) for line in ran.stdout.splitlines()], ran.stderr


def main():
    if len(sys.argv) != 7:
        sys.exit(__doc__)
    trocar, models, motion, folder = map(os.path.abspath, sys.argv[1:5])
    name, library = sys.argv[5], os.path.abspath(sys.argv[6])
    platform = PLATFORMS[name]
    importer = build(platform, folder)
    largest = 0.0
    for file in sorted(os.listdir(models)):
        model = os.path.join(models, file)
        forces = [row[0] for row in simulate(trocar, model, motion)]
        for fmi in "23":
            unit = os.path.join(folder, f"{os.path.splitext(file)[0]}.{fmi}")
            path = unit + ".fmu"
            command = [trocar, "--quiet", "export", "fmu", model, "--fmi", fmi, "--input", "position", "--out", path]
            subprocess.run([*command, "--library", f"{name}={library}"], check=True)
            with zipfile.ZipFile(path) as archive:
                inside = {entry.split("/")[1] for entry in archive.namelist() if entry.startswith("binaries/")}
                check({NATIVE[fmi], platform.folders[fmi]} <= inside, f"{path} has libraries for {inside}")
                archive.extractall(unit)
            token = fmpy.read_model_description(path).guid
            found, messages = run(platform, importer, fmi, unit, token, motion)
            check(len(found) == len(forces), f"{len(found)} forces of {len(forces)}")
            largest = max([largest] + [abs(ours - theirs) for ours, theirs in zip(forces, found)])
            # The message of FMI 2.0 is a printf format.
            check_words(refusals(fmi, "no such%/folder" if fmi == "2" else "/no such/folder"), messages)
    print(f"largest difference on {name}: {largest} N")
    check(largest == 0.0, f"the library for {name} finds other forces")


if __name__ == "__main__":
    main()
