"""A slide and a hinge joint of one body: force and torque of `trocar simulate`, and never a source of energy."""

import json

import mujoco
import numpy as np
import pytest
from scene import scene

INTEGRATORS = ["Euler", "implicit", "implicitfast", "discrete", "RK4"]
# Sums of this step are exact, so the times of a recorded motion give the same durations again, s.
BINARY_STEP = 2.0**-9
# Of a shaft of 10 mm, over its mass.
INERTIA_M2 = 0.5 * 5e-3**2


def turned(model, **options):
    m = mujoco.MjModel.from_xml_string(scene(model, hinge="roll", **options))
    return m, mujoco.MjData(m)


def recorded(m, d, steps, drive=lambda time: [0.0, 0.0]):
    """Times, joints, what the sensor reads there, and what was applied in the step that ends there."""
    mujoco.mj_forward(m, d)
    rows = [(d.time, *d.qpos, *d.sensordata, np.nan, np.nan)]
    for _ in range(steps):
        d.qfrc_applied[:] = drive(d.time)
        mujoco.mj_step(m, d)
        applied = [-force for force in d.qfrc_passive]
        mujoco.mj_forward(m, d)
        rows.append((d.time, *d.qpos, *d.sensordata, *applied))
    return np.array(rows).T


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_sensor_reads_force_and_torque_of_simulate(turning_model, integrator, simulate):
    m, d = turned(turning_model, integrator=integrator, timestep_s=BINARY_STEP)
    drive = lambda t: [6.0 * np.sin(9.0 * t) + 2.0 * np.sin(61.0 * t), 0.03 * np.sin(7.0 * t)]
    times, positions, angles, force, torque, *_ = recorded(m, d, 1500, drive)
    assert np.ptp(positions) > 0.01 and np.ptp(angles) > 1.0 and torque.max() > 2e-3
    assert np.array([force, torque]).T.ravel().tolist() == simulate(turning_model, times, positions, angles)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize("mass_kg", [0.01, 0.1, 1.0])
def test_what_a_free_step_feels_is_that_at_its_end(turning_model, integrator, mass_kg):
    m, d = turned(turning_model, integrator=integrator, mass_kg=mass_kg, inertia_kg_m2=INERTIA_M2 * mass_kg)
    d.qvel[:] = [0.2, 20.0]
    *_, force, torque, applied_n, applied_n_m = recorded(m, d, 500)
    assert np.abs(force - applied_n)[1:].max() < 1e-7
    assert np.abs(torque - applied_n_m)[1:].max() < 1e-9


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("mass_kg", [0.01, 0.1, 1.0])
def test_a_thrown_and_spun_instrument_loses_energy_and_stops(turning_model, integrator, mass_kg):
    """At 2 ms: kinetic energy and the work done on the seal never exceed what there was."""
    inertia = INERTIA_M2 * mass_kg
    m, d = turned(turning_model, integrator=integrator, mass_kg=mass_kg, inertia_kg_m2=inertia)
    d.qvel[:] = [0.2, 20.0]
    start = 0.5 * mass_kg * d.qvel[0] ** 2 + 0.5 * inertia * d.qvel[1] ** 2
    _, positions, angles, force, torque, *_ = recorded(m, d, 2500)
    velocity, turn = np.diff(positions) / m.opt.timestep, np.diff(angles) / m.opt.timestep
    if integrator != "RK4":
        kinetic = 0.5 * mass_kg * velocity**2 + 0.5 * inertia * turn**2
        work = np.cumsum(force[1:] * np.diff(positions) + torque[1:] * np.diff(angles))
        assert (kinetic + work).max() <= start * (1.0 + 1e-9)
    # Stuck, the seal is a spring around the shaft; RK4 does not damp its oscillation.
    left = 1e-2 if integrator == "RK4" else 1e-3
    assert 0.5 * mass_kg * d.qvel[0] ** 2 + 0.5 * inertia * d.qvel[1] ** 2 < left * start


def test_turning_lets_go_what_a_seal_holds(turning_model):
    """A load below the friction, held until the instrument is turned."""
    m, d = turned(turning_model, mass_kg=0.1)
    held = recorded(m, d, 1000, lambda t: [1.2, 0.0])[1]
    spun = recorded(m, d, 500, lambda t: [1.2, 0.05])[1]
    assert spun[-1] - held[-1] > 10.0 * max(held[-1] - held[-300], 1e-4)


def test_an_instrument_that_does_not_turn_feels_the_seal_along_its_axis(turning_model):
    """To the last bit, wherever the hinge stands."""
    forces = []
    for hinge in [None, "roll"]:
        m = mujoco.MjModel.from_xml_string(scene(turning_model, hinge=hinge))
        d = mujoco.MjData(m)
        if hinge:
            d.qpos[1] = 0.8
        for step in range(400):
            d.qfrc_applied[0] = 5.0 * np.sin(0.03 * step)
            mujoco.mj_step(m, d)
            forces.append((d.qpos[0], d.qfrc_passive[0]))
    assert forces[:400] == forces[400:]


def test_copies_go_on_alike(turning_model):
    m, d = turned(turning_model)
    d.qvel[:] = [0.1, 5.0]
    recorded(m, d, 30)
    other = mujoco.MjData(m)
    mujoco.mj_copyData(other, m, d)
    assert recorded(m, d, 100)[:5].tolist() == recorded(m, other, 100)[:5].tolist()
    mujoco.mj_resetData(m, d)
    assert not d.plugin_state.any()


@pytest.mark.parametrize("hinge, extra, words", [
    ("nowhere", "", "no joint 'nowhere'"),
    ("insertion", "", "'insertion' is no hinge joint of the body of joint 'insertion'"),
    ("away", '<worldbody><body pos="1 0 0"><joint name="away" type="hinge"/><geom size="0.1"/></body></worldbody>',
     "'away' is no hinge joint of the body of joint 'insertion'"),
])
def test_what_is_no_hinge_is_refused(turning_model, hinge, extra, words):
    with pytest.raises(ValueError, match=words):
        mujoco.MjModel.from_xml_string(scene(turning_model, hinge=hinge, extra=extra))


def test_a_model_of_the_axis_takes_no_hinge(ems, turning_model, tmp_path):
    with pytest.raises(ValueError, match="has no 'rotation': leave the key hinge out"):
        mujoco.MjModel.from_xml_string(scene(ems, hinge="roll"))
    document = json.loads(turning_model.read_text())
    del document["rotation"]
    (tmp_path / "plain.json").write_text(json.dumps(document))
    with pytest.raises(ValueError, match="has no 'rotation'"):
        mujoco.MjModel.from_xml_string(scene(tmp_path / "plain.json", hinge="roll"))
