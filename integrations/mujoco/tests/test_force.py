"""The force: equal to that of `trocar simulate`, in balance with what acts on the joint, and never a source of energy."""

import mujoco
import numpy as np
import pytest
from conftest import REPOSITORY
from drive import drive, read_motion
from scene import scene

INTEGRATORS = ["Euler", "implicit", "implicitfast", "discrete", "RK4"]
# Sums of this step are exact, so the times of a recorded motion give the same durations again, s.
BINARY_STEP = 2.0**-9


def recorded(m, d, steps, drive_n=lambda time: 0.0):
    """Times, positions, what the sensor reads there, and the force applied in the step that ends there."""
    mujoco.mj_forward(m, d)
    times, positions, read, applied = [d.time], [d.qpos[0]], [d.sensordata[0]], [np.nan]
    for _ in range(steps):
        d.qfrc_applied[0] = drive_n(d.time)
        mujoco.mj_step(m, d)
        applied.append(-d.qfrc_passive[0])
        mujoco.mj_forward(m, d)
        times.append(d.time), positions.append(d.qpos[0]), read.append(d.sensordata[0])
    return tuple(np.array(column) for column in (times, positions, read, applied))


def test_a_driven_joint_feels_the_force_of_simulate(model, simulate):
    times, positions = read_motion(REPOSITORY / "conformance" / "motion.csv")
    assert drive(model, times, positions) == simulate(model, times, positions)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_sensor_reads_the_force_of_simulate_along_a_free_motion(model, integrator, simulate):
    m = mujoco.MjModel.from_xml_string(scene(model, integrator=integrator, timestep_s=BINARY_STEP))
    times, positions, read, _ = recorded(m, mujoco.MjData(m), 1500, lambda t: 6.0 * np.sin(9.0 * t) + 2.0 * np.sin(61.0 * t))
    assert np.ptp(positions) > 0.01, "the motion deforms the seal and slides through it"
    assert list(read) == simulate(model, times, positions)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize("mass_kg", [0.01, 0.1, 1.0])
def test_the_force_of_a_free_step_is_that_at_its_end(smooth_model, integrator, mass_kg):
    m = mujoco.MjModel.from_xml_string(scene(smooth_model, mass_kg=mass_kg, integrator=integrator))
    d = mujoco.MjData(m)
    d.qvel[0] = 0.2
    _, _, read, applied = recorded(m, d, 500)
    assert np.abs(read[1:] - applied[1:]).max() < 1e-8


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("load_n", [-1.0, 0.3, 1.5])
def test_a_seal_holds_what_is_below_its_friction(model, integrator, load_n):
    """At rest the applied force is the load: the estimate of the other forces leaves no error behind."""
    m = mujoco.MjModel.from_xml_string(scene(model, integrator=integrator))
    d = mujoco.MjData(m)
    _, positions, read, applied = recorded(m, d, 3000, lambda _: load_n)
    if model.stem == "ems_slow":
        assert applied[-1] == pytest.approx(load_n, abs=1e-3)  # creeps on
        return
    assert applied[-1] == pytest.approx(load_n, abs=1e-4)
    assert abs(positions[-1] - positions[-200]) < 1e-6
    if model.stem != "static":
        assert read[-1] == pytest.approx(load_n, abs=1e-3)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("mass_kg", [0.01, 0.1, 1.0])
def test_a_thrown_instrument_loses_energy_and_stops(model, integrator, mass_kg):
    """At 2 ms; kinetic energy and the work done on the seal, by the seal's own force, never exceed what there was."""
    m = mujoco.MjModel.from_xml_string(scene(model, mass_kg=mass_kg, integrator=integrator))
    d = mujoco.MjData(m)
    d.qvel[0] = 0.2
    start = 0.5 * mass_kg * d.qvel[0] ** 2
    _, positions, read, applied = recorded(m, d, 2500)
    # At rest the force of static friction is any between two limits: what it applies is the balance, what it last was a limit.
    force = applied[1:] if model.stem == "static" else read[1:]
    velocities = np.diff(positions) / m.opt.timestep
    assert np.abs(velocities).max() <= 0.2
    if integrator != "RK4":
        kinetic = 0.5 * mass_kg * velocities**2
        assert (kinetic + np.cumsum(force * np.diff(positions))).max() <= start * (1.0 + 1e-9)
    assert 0.5 * mass_kg * d.qvel[0] ** 2 < 1e-3 * start


@pytest.mark.parametrize("stiffness_n_m", [1e3, 1e4, 1e5])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("mass_kg", [0.01, 0.1, 1.0])
def test_a_stiff_seal_stops_a_light_instrument(stiffness_n_m, integrator, mass_kg, stiff_model):
    """Where a force that is only read before the step would diverge: up to 40 times the limit of h^2 k / m."""
    m = mujoco.MjModel.from_xml_string(scene(stiff_model(stiffness_n_m), mass_kg=mass_kg, integrator=integrator))
    d = mujoco.MjData(m)
    d.qvel[0] = 0.2
    speeds = []
    for _ in range(2000):
        mujoco.mj_step(m, d)
        speeds.append(abs(d.qvel[0]))
    assert max(speeds) <= 0.2
    assert max(speeds[-100:]) < 1e-6


TISSUE = '<worldbody><geom type="plane" size="1 1 0.1" pos="0 0 -0.125"/></worldbody>'
PRESSED = [
    (integrator, mass_kg, servo)
    for integrator in INTEGRATORS
    for mass_kg in (0.01, 0.1, 1.0)
    for servo in (False, True)
    # Euler takes the damping of a servo explicitly: 5 N s/m on 10 g in 2 ms is its limit.
    if not (integrator == "Euler" and mass_kg == 0.01 and servo)
]


def pressed(model, integrator, mass_kg, servo):
    """A joint that presses on a contact, by a motor or a servo: its motion."""
    actuator = '<position joint="insertion" kp="500" kv="5"/>' if servo else '<motor joint="insertion"/>'
    m = mujoco.MjModel.from_xml_string(
        scene(model, mass_kg=mass_kg, integrator=integrator, extra=f"{TISSUE}<actuator>{actuator}</actuator>"))
    d = mujoco.MjData(m)
    d.ctrl[0] = -0.05 if servo else -10.0
    motion = recorded(m, d, 1500)
    assert d.ncon > 0 and d.qpos[0] < -0.015, "it presses on the tissue"
    return motion


@pytest.mark.parametrize("integrator, mass_kg, servo", PRESSED)
def test_an_instrument_pressed_into_tissue_rests_there(model, integrator, mass_kg, servo):
    _, positions, _, applied = pressed(model, integrator, mass_kg, servo)
    assert np.ptp(positions[-200:]) < 1e-4
    assert np.ptp(applied[-200:]) < (0.1 if model.stem == "ems_slow" or mass_kg == 0.01 else 0.02)


@pytest.mark.parametrize("integrator, mass_kg, servo", PRESSED)
def test_on_tissue_only_a_light_instrument_in_a_very_stiff_seal_chatters(integrator, mass_kg, servo, stiff_model):
    """10 g at 1e5 N/m, h^2 k / m = 40: what docs/reference/mujoco.md states as a limit."""
    _, positions, _, _ = pressed(stiff_model(1e5), integrator, mass_kg, servo)
    assert np.ptp(positions[-200:]) < (0.5e-3 if mass_kg == 0.01 else 1e-6)


def swinging_arm(integrator, extension="", stiffness_n_m=0.0):
    """Energy that an arm with a sliding instrument gains at most while it swings, J."""
    m = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="0.002" integrator="{integrator}"><flag energy="enable"/></option>{extension}
        <worldbody><body><joint type="hinge" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
          <body pos="0.3 0 0"><joint name="insertion" type="slide" axis="1 0 0" stiffness="{stiffness_n_m}"/>
            <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.005" mass="0.05"/></body></body></worldbody></mujoco>""")
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    start = most = d.energy.sum()
    for _ in range(2000):
        mujoco.mj_step(m, d)
        most = max(most, d.energy.sum())
    return most - start


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_on_a_swinging_arm_a_trocar_brings_no_energy(model, integrator):
    """No more than the integrator's own error, which a spring in place of the trocar shows."""
    port = (f'<extension><plugin plugin="trocar"><instance name="port"><config key="model" value="{model}"/>'
            '<config key="joint" value="insertion"/></instance></plugin></extension>')
    own = swinging_arm(integrator, stiffness_n_m=300.0)
    assert swinging_arm(integrator, port) <= 1.2 * own + 1e-4


def test_the_length_of_a_step_may_change(model, simulate):
    m = mujoco.MjModel.from_xml_string(scene(model))
    d = mujoco.MjData(m)
    d.qvel[0] = 0.1
    mujoco.mj_forward(m, d)
    times, positions, read = [0.0], [d.qpos[0]], [d.sensordata[0]]
    for step in range(200):
        m.opt.timestep = 2.0 ** -(8 + step % 3)
        mujoco.mj_step(m, d)
        mujoco.mj_forward(m, d)
        times.append(d.time), positions.append(d.qpos[0]), read.append(d.sensordata[0])
    assert read == simulate(model, times, positions)
