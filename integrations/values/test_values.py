"""What `trocar export values` prints, read by the programs that it is for."""

import json
import math
import os
import pathlib
import re
import subprocess
from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from pysdf import SDF
from urdf_parser_py.urdf import URDF

MODELS = pathlib.Path(__file__).resolve().parents[2] / "conformance" / "models"
# A force of newtons changes the velocity by less than its last bit, kg.
IMMOVABLE = 1e20
# Six digits are printed.
DIGITS = 1e-5
STEP_S = 1e-4


def trocar(*arguments):
    command = [os.environ["TROCAR_PROGRAM"], "--quiet", *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@pytest.fixture(params=["ems", "ems_stages", "ems_stribeck", "gms", "lugre", "maxwell_slip", "bouc_wen"])
def model(request):
    return MODELS / f"{request.param}.json"


def values(model):
    """Values by the name of the parameter here, of the place that has them all."""
    places = json.loads(trocar("export", "values", model, "--for", "json"))["places"]
    return {value["from"]: value["value"] for place in places for value in place["values"] if place["program"] != "simulink"}


def test_urdf_is_read_by_its_parser(model):
    own = values(model)
    joint = URDF.from_xml_string(f"""
        <robot name="port"><link name="port"/><link name="instrument"/>
          <joint name="insertion" type="prismatic"><parent link="port"/><child link="instrument"/>
            <limit lower="0" upper="0.2" effort="50" velocity="1"/>{trocar("export", "values", model, "--for", "urdf")}
          </joint></robot>""").joints[0]
    assert joint.dynamics.damping == pytest.approx(own["viscous_damping_n_s_m"], rel=DIGITS)
    assert joint.dynamics.friction == pytest.approx(own["coulomb_force_n"], rel=DIGITS)


def test_sdf_is_read_by_its_parser(model):
    own = values(model)
    dynamics = SDF.from_xml(f"""
        <sdf version="1.9"><model name="port"><link name="trocar"/><link name="instrument"/>
          <joint name="insertion" type="prismatic"><parent>trocar</parent><child>instrument</child>
            <axis><xyz>0 0 1</xyz>{trocar("export", "values", model, "--for", "sdf")}</axis>
          </joint></model></sdf>""").model.joints[0].axis.dynamics
    assert dynamics.damping == pytest.approx(own["viscous_damping_n_s_m"], rel=DIGITS)
    assert dynamics.friction == pytest.approx(own["coulomb_force_n"], rel=DIGITS)


def stroke():
    """Times, s, and positions, m: two strokes at 50 and one at 5 mm/s, with a rest."""
    speeds = np.repeat([0.05, -0.05, 0.0, 0.005], [6000, 6000, 500, 6000])
    return STEP_S * np.arange(len(speeds) + 1), np.concatenate([[0.0], np.cumsum(speeds * STEP_S)])


def in_mujoco(joint, actuator, positions):
    """Force of the instrument at each position but the first, N."""
    m = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{STEP_S}" gravity="0 0 0"/><worldbody><body>{joint}
          <geom size="0.01" mass="{IMMOVABLE}"/></body></worldbody><actuator>{actuator}</actuator></mujoco>""")
    d, forces = mujoco.MjData(m), []
    for velocity in np.diff(positions) / STEP_S:
        d.qvel[0] = velocity
        mujoco.mj_step(m, d)
        d.qvel[0] = velocity
        mujoco.mj_forward(m, d)
        forces.append(-(d.qfrc_passive + d.qfrc_actuator + d.qfrc_constraint)[0])
    return np.array(forces)


def in_trocar(friction, tmp_path):
    motion, path = tmp_path / "motion.csv", tmp_path / "model.json"
    content = json.loads((MODELS / "lugre.json").read_text())
    path.write_text(json.dumps({**content, "friction": friction}))
    times, positions = stroke()
    np.savetxt(motion, np.column_stack([times, positions]), delimiter=",", header="time_s,position_m", comments="", fmt="%.17g")
    lines = trocar("simulate", path, motion, "--out", "-").splitlines()
    column = lines[0].split(",").index("force_n")
    return np.array([float(line.split(",")[column]) for line in lines[2:]])


def test_mujoco_gives_the_force_of_a_stroke(model, tmp_path):
    own, text = values(model), trocar("export", "values", model, "--for", "mujoco")
    joint, actuator = re.findall(r"^<(?:joint|dcmotor).*/>$", text, re.M)
    _, positions = stroke()
    sliding = {name: own[name] for name in ("coulomb_force_n", "static_force_n", "stribeck_velocity_m_s", "viscous_damping_n_s_m")}
    sliding["stribeck_exponent"] = 2.0
    coulomb = {**sliding, "static_force_n": own["coulomb_force_n"]}
    expected = in_trocar({"kind": "static", "sliding": coulomb}, tmp_path)
    forces = in_mujoco(joint, "", positions)
    moving = np.diff(positions) != 0.0  # At rest nothing pushes this joint.
    assert np.abs(forces - expected)[moving].max() < DIGITS * np.abs(expected).max()
    lugre = {"kind": "lugre", "stiffness_n_m": own["stiffness_n_m"], "micro_damping_n_s_m": own["micro_damping_n_s_m"],
             "damping_velocity_m_s": None, "curve": "exponential", "sliding": sliding}
    expected = in_trocar(lugre, tmp_path)
    forces = in_mujoco('<joint name="insertion" type="slide" axis="0 0 1"/>', actuator, positions)
    assert np.ptp(expected) > 2.0 * own["coulomb_force_n"], "it slides both ways"
    assert np.abs(forces - expected).max() < 10.0 * DIGITS * np.abs(expected).max()


@dataclass
class ImplicitActuatorCfg:
    """The fields of isaaclab/actuators/actuator_base_cfg.py of Isaac Lab that are set."""

    joint_names_expr: list
    stiffness: float
    damping: float
    friction: float
    dynamic_friction: float
    viscous_friction: float


def test_isaac_and_urscript_are_programs_with_the_numbers(model):
    own, scope = values(model), {"ImplicitActuatorCfg": ImplicitActuatorCfg}
    exec(trocar("export", "values", model, "--for", "isaac"), scope)
    actuator = scope["trocar"]
    assert actuator.friction == pytest.approx(own["static_force_n"], rel=DIGITS)
    assert actuator.friction >= actuator.dynamic_friction == pytest.approx(own["coulomb_force_n"], rel=DIGITS)
    assert actuator.viscous_friction == pytest.approx(own["viscous_damping_n_s_m"], rel=DIGITS)
    # URScript is Python but for the ends of its blocks.
    exec(re.sub(r"^ *end$", "", trocar("export", "values", model, "--for", "ur"), flags=re.M), scope)
    expected = own["coulomb_force_n"] + 0.05 * own["viscous_damping_n_s_m"]
    assert scope["trocar_force_n"](0.05) == pytest.approx(expected, rel=DIGITS) == -scope["trocar_force_n"](-0.05)
    assert scope["trocar_force_n"](0.0) == 0.0


def test_the_block_of_simscape_has_the_friction_of_the_model(model):
    """Its published equation, with the breakaway force at the breakaway velocity and F_c + β·v far above."""
    own, text = values(model), trocar("export", "values", model, "--for", "simulink")
    named = {name: float(value) for name, value in re.findall(r"'(\w+)', '([^']+)'", text)}

    def force(v):
        rise = math.sqrt(2.0 * math.e) * (named["brkwy_frc"] - named["Col_frc"])
        threshold, coulomb = math.sqrt(2.0) * named["brkwy_vel"], named["brkwy_vel"] / 10.0
        return rise * math.exp(-((v / threshold) ** 2)) * v / threshold + named["Col_frc"] * math.tanh(v / coulomb) + named["visc_coef"] * v

    v = named["brkwy_vel"]
    assert force(v) == pytest.approx(own["static_force_n"] + v * own["viscous_damping_n_s_m"], rel=DIGITS)
    assert force(1.0) == pytest.approx(own["coulomb_force_n"] + own["viscous_damping_n_s_m"], rel=DIGITS)
