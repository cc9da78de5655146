"""OpenSeesPy's materials, tested one by one at prescribed strain: F_c, k and x as stress, modulus and strain."""

import ctypes
import importlib.util
import pathlib

# The wheel brings its BLAS but does not say where: a system without one would not find it.
LIBRARIES = ("libquadmath.so.0", "libgfortran.so.4", "libblas.so.3", "liblapack.so.3")


def load():
    """The module openseespy.opensees, whether or not the system has a BLAS."""
    package = pathlib.Path(importlib.util.find_spec("openseespylinux").origin).parent
    for library in LIBRARIES:
        ctypes.CDLL(str(package / "lib" / library), mode=ctypes.RTLD_GLOBAL)
    return importlib.import_module("openseespy.opensees")


def maxwell_slip(opensees, elements):
    """Makes (stiffness N/m, limit force N) elements in parallel the material under test, at rest at x = 0."""
    opensees.wipe()
    tags = list(range(1, len(elements) + 1))
    for tag, (stiffness, limit_force) in zip(tags, elements):
        opensees.uniaxialMaterial("ElasticPP", tag, stiffness, limit_force / stiffness)
    opensees.uniaxialMaterial("Parallel", len(tags) + 1, *tags)
    opensees.testUniaxialMaterial(len(tags) + 1)
