"""The state is the engine's: reset, copied, saved, on threads; and bad input goes through the engine's own channel."""

import concurrent.futures
import copy
import json

import mujoco
import numpy as np
import pytest
from mujoco import rollout
from scene import scene

EVERYTHING = mujoco.mjtState.mjSTATE_INTEGRATION


@pytest.fixture
def m(ems):
    return mujoco.MjModel.from_xml_string(scene(ems))


def shaken(m, d, steps, first=0):
    """Bits of the whole state after each step under a force that slides the seal to and fro."""
    states = []
    for step in range(first, first + steps):
        d.qfrc_applied[0] = 6.0 * np.sin(0.02 * step) + 2.0 * np.sin(0.13 * step)
        mujoco.mj_step(m, d)
        states.append(state(m, d).tobytes())
    return states


def state(m, d, spec=EVERYTHING):
    numbers = np.empty(mujoco.mj_stateSize(m, spec))
    mujoco.mj_getState(m, d, numbers, spec)
    return numbers


def test_a_reset_seal_is_as_new(m):
    d = mujoco.MjData(m)
    first = shaken(m, d, 700)
    mujoco.mj_resetData(m, d)
    assert shaken(m, d, 700) == first


def test_after_a_keyframe_the_seal_rests_where_the_keyframe_is(ems, simulate):
    extra = '<keyframe><key name="inside" time="3" qpos="0.08" qvel="0.1"/></keyframe>'
    m = mujoco.MjModel.from_xml_string(scene(ems, timestep_s=2.0**-9, extra=extra))
    d = mujoco.MjData(m)
    shaken(m, d, 100)
    mujoco.mj_resetDataKeyframe(m, d, 0)
    times, positions, read = [], [], []
    for _ in range(300):
        mujoco.mj_forward(m, d)
        times.append(d.time), positions.append(d.qpos[0]), read.append(d.sensordata[0])
        mujoco.mj_step(m, d)
    assert times[0] == 3.0 and positions[0] == 0.08
    assert read == simulate(ems, times, positions)


def copied_into(m, d):
    second = mujoco.MjData(m)
    mujoco.mj_copyData(second, m, d)
    return second


@pytest.mark.parametrize("make_copy", [
    copied_into,
    lambda m, d: copy.copy(d),
    lambda m, d: copy.deepcopy(d),
], ids=["mj_copyData", "copy", "deepcopy"])
def test_a_copy_goes_on_alike_and_outlives_the_original(m, make_copy):
    d = mujoco.MjData(m)
    shaken(m, d, 300)
    copied = make_copy(m, d)
    expected = shaken(m, d, 400, 300)
    del d
    assert shaken(m, copied, 400, 300) == expected


def test_a_copy_in_the_middle_of_a_step_goes_on_alike(m):
    d = mujoco.MjData(m)
    shaken(m, d, 300)
    mujoco.mj_step1(m, d)
    copied = copy.copy(d)
    mujoco.mj_step2(m, d)
    mujoco.mj_step2(m, copied)
    assert shaken(m, copied, 400, 300) == shaken(m, d, 400, 300)


@pytest.mark.parametrize("spec", [
    EVERYTHING,
    mujoco.mjtState.mjSTATE_FULLPHYSICS | mujoco.mjtState.mjSTATE_WARMSTART | mujoco.mjtState.mjSTATE_QFRC_APPLIED,
], ids=["integration", "full physics"])
def test_a_saved_state_goes_on_alike(m, spec):
    d = mujoco.MjData(m)
    shaken(m, d, 300)
    saved = state(m, d, spec)
    expected = shaken(m, d, 400, 300)
    other = mujoco.MjData(m)
    shaken(m, other, 50)
    mujoco.mj_setState(m, other, saved, spec)
    assert shaken(m, other, 400, 300) == expected


def test_the_plugin_state_alone_can_be_saved(m):
    d = mujoco.MjData(m)
    shaken(m, d, 300)
    saved = state(m, d, mujoco.mjtState.mjSTATE_PLUGIN)
    other = mujoco.MjData(m)
    mujoco.mj_setState(m, other, saved, mujoco.mjtState.mjSTATE_PLUGIN)
    assert (other.plugin_state == d.plugin_state).all() and np.abs(saved).max() > 0.0


def test_rollouts_on_threads_are_those_of_one_thread(m):
    d = mujoco.MjData(m)
    starts = []
    for part in range(24):
        shaken(m, d, 37, 37 * part)
        starts.append(state(m, d, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    control = mujoco.mjtState.mjSTATE_QFRC_APPLIED
    forces = 4.0 * np.sin(np.linspace(0.0, 60.0, 24 * 400)).reshape(24, 400, 1)
    runs = [
        rollout.rollout(m, [mujoco.MjData(m) for _ in range(threads)], np.array(starts), forces,
                        control_spec=control, nstep=400)
        for threads in (1, 4, 4)
    ]
    assert np.ptp(runs[0][1]) > 1.0, "the seal slides both ways"
    for states, sensors in runs[1:]:
        assert (states == runs[0][0]).all() and (sensors == runs[0][1]).all()
    for start, force, states in zip(starts, forces, runs[0][0]):
        mujoco.mj_setState(m, d, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        d.qacc_warmstart[:] = 0.0
        for row in force:
            d.qfrc_applied[:] = row
            mujoco.mj_step(m, d)
        assert (state(m, d, mujoco.mjtState.mjSTATE_FULLPHYSICS) == states[-1]).all()


def test_threads_that_share_a_model_and_copies_give_what_one_gives(m):
    d = mujoco.MjData(m)
    shaken(m, d, 100)
    copies = [copy.copy(d) for _ in range(8)]
    expected = shaken(m, d, 2000, 100)
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        for found in pool.map(lambda copied: shaken(m, copied, 2000, 100), copies):
            assert found == expected


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "RK4", "discrete"])
def test_only_a_step_moves_the_seal(ems, integrator):
    """Neither repeated evaluation, nor inverse dynamics, nor derivatives."""
    m = mujoco.MjModel.from_xml_string(scene(ems, integrator=integrator))
    plain, watched = mujoco.MjData(m), mujoco.MjData(m)
    transition = np.empty((2 * m.nv, 2 * m.nv))
    for step in range(300):
        plain.qfrc_applied[0] = watched.qfrc_applied[0] = 6.0 * np.sin(0.03 * step)
        for _ in range(2):
            mujoco.mj_forward(m, watched)
        if integrator != "RK4":
            mujoco.mjd_transitionFD(m, watched, 1e-6, True, transition, None, None, None)
        saved = watched.qacc.copy()
        mujoco.mj_inverse(m, watched)
        watched.qacc[:] = saved
        watched.qacc_warmstart[:] = plain.qacc_warmstart
        mujoco.mj_step(m, plain)
        mujoco.mj_step(m, watched)
        assert plain.qpos[0] == watched.qpos[0] and plain.sensordata[0] == watched.sensordata[0]


def test_derivatives_of_a_step_contain_the_trocar(m):
    """By finite differences, as the engine takes them of everything."""
    d = mujoco.MjData(m)
    shaken(m, d, 310)
    d.qfrc_applied[0] = 0.0
    transition = np.empty((2, 2))
    mujoco.mjd_transitionFD(m, d, 1e-7, True, transition, None, None, None)

    def velocity_after(position, velocity):
        copied = copy.copy(d)
        copied.qpos[0] += position
        copied.qvel[0] += velocity
        mujoco.mj_step(m, copied)
        return copied.qvel[0]

    by_position = (velocity_after(1e-7, 0.0) - velocity_after(-1e-7, 0.0)) / 2e-7
    by_velocity = (velocity_after(0.0, 1e-7) - velocity_after(0.0, -1e-7)) / 2e-7
    assert transition[1] == pytest.approx([by_position, by_velocity], rel=1e-3)
    assert by_velocity < 0.99, "the seal slows the joint"


def test_an_instrument_that_sleeps_in_its_seal_wakes_by_a_push(ems):
    m = mujoco.MjModel.from_xml_string(scene(ems, option='<flag sleep="enable"/>'))
    d = mujoco.MjData(m)
    d.qvel[0] = 0.2
    for _ in range(2000):
        mujoco.mj_step(m, d)
    assert d.ntree_awake == 0, "it sleeps"
    resting = d.qpos[0]
    d.qfrc_applied[0] = 8.0
    for _ in range(200):
        mujoco.mj_step(m, d)
    assert d.ntree_awake == 1 and d.qpos[0] > resting + 0.01
    assert np.isfinite(d.sensordata[0]) and d.sensordata[0] > 1.0


def two_ports(first, second, joint="right"):
    def instance(name, model, joint):
        return (f'<instance name="{name}"><config key="model" value="{model}"/>'
                f'<config key="joint" value="{joint}"/></instance>')

    def body(joint):
        return (f'<body><joint name="{joint}" type="slide" axis="0 0 1"/>'
                '<geom type="sphere" size="0.01" mass="0.1" contype="0" conaffinity="0"/></body>')

    return f"""<mujoco><option timestep="0.002" gravity="0 0 0"/>
      <extension><plugin plugin="trocar">{instance("a", first, "left")}{instance("b", second, joint)}</plugin></extension>
      <worldbody>{body("left")}{body("right")}</worldbody></mujoco>"""


def test_two_trocars_do_not_know_each_other(ems):
    dahl = ems.with_name("dahl.json")
    both = mujoco.MjModel.from_xml_string(two_ports(ems, dahl))
    singles = [mujoco.MjModel.from_xml_string(scene(path, integrator="Euler")) for path in (ems, dahl)]
    d, alone = mujoco.MjData(both), [mujoco.MjData(single) for single in singles]
    for step in range(1000):
        for joint in range(2):
            force = 6.0 * np.sin(0.02 * step + joint)
            d.qfrc_applied[joint] = alone[joint].qfrc_applied[0] = force
            mujoco.mj_step(singles[joint], alone[joint])
        mujoco.mj_step(both, d)
        assert list(d.qpos) == [alone[0].qpos[0], alone[1].qpos[0]]
    assert np.ptp(d.qpos) > 0.0


def test_a_joint_takes_one_trocar(ems):
    with pytest.raises(ValueError, match="joint 'left' already has the trocar 'a'; one joint takes one"):
        mujoco.MjModel.from_xml_string(two_ports(ems, ems, joint="left"))


def newer(path, tmp_path):
    content = json.loads(path.read_text())
    content["version"] = 99
    file = tmp_path / "newer.json"
    file.write_text(json.dumps(content))
    return file


@pytest.mark.parametrize("arguments, message", [
    (lambda ems, tmp: {"model": tmp / "none.json"}, "none.json: cannot read the model: No such file"),
    (lambda ems, tmp: {"model": newer(ems, tmp)}, "written by another version of trocar: model version 99"),
    (lambda ems, tmp: {"model": __file__}, "test_engine.py"),
    (lambda ems, tmp: {"model": ""}, "no model file given"),
    (lambda ems, tmp: {"model": ems, "joint": ""}, "no joint given"),
    (lambda ems, tmp: {"model": ems, "joint": "elbow"}, "no joint 'elbow' in the model"),
    (lambda ems, tmp: {"model": ems, "joint_type": "hinge"}, "joint 'insertion' is no slide joint"),
    (lambda ems, tmp: {"model": ems, "joint_type": "ball"}, "joint 'insertion' is no slide joint"),
    (lambda ems, tmp: {"model": ems, "joint_type": "free"}, "joint 'insertion' is no slide joint"),
], ids=["no file", "newer", "no model", "model not given", "joint not given", "no joint", "hinge", "ball", "free"])
def test_a_scene_that_cannot_work_is_refused_with_its_reason(ems, tmp_path, arguments, message):
    with pytest.raises(ValueError, match=f"trocar 'port'.*{message}"):
        mujoco.MjModel.from_xml_string(scene(**arguments(ems, tmp_path)))
    mujoco.MjModel.from_xml_string(scene(ems))


def test_a_model_file_is_read_when_data_are_made(ems, tmp_path):
    file = tmp_path / "model.json"
    file.write_bytes(ems.read_bytes())
    m = mujoco.MjModel.from_xml_string(scene(file))
    d, second = mujoco.MjData(m), mujoco.MjData(m)
    file.write_bytes(ems.with_name("dahl.json").read_bytes())
    other = mujoco.MjData(m)
    expected = shaken(m, d, 50)
    assert shaken(m, second, 50) == expected
    assert shaken(m, other, 50) != expected
    mujoco.mj_copyData(other, m, d)
    assert shaken(m, other, 50, 50) == shaken(m, d, 50, 50), "a copy takes the seal with its state"
    file.unlink()
    with pytest.raises(mujoco.FatalError):
        mujoco.MjData(m)
    mujoco.mj_copyData(second, m, d)
    assert shaken(m, second, 50, 100) == shaken(m, d, 50, 100)


@pytest.mark.parametrize("spoil, reason", [
    (lambda m, d: d.qpos.__setitem__(0, np.nan), "not finite"),
    (lambda m, d: d.qpos.__setitem__(0, np.inf), "not finite"),
    (lambda m, d: d.qvel.__setitem__(0, np.nan), "not finite"),
    (lambda m, d: setattr(m.opt, "timestep", 0.0), "must be positive"),
    (lambda m, d: setattr(m.opt, "timestep", -0.002), "must be positive"),
], ids=["NaN position", "infinite position", "NaN velocity", "no timestep", "negative timestep"])
@pytest.mark.parametrize("step", [mujoco.mj_forward, mujoco.mj_Euler], ids=["forward", "advance"])
def test_what_no_seal_can_follow_leaves_the_last_good_state(m, warnings, spoil, reason, step):
    d, unspoiled = mujoco.MjData(m), mujoco.MjData(m)
    shaken(m, d, 300), shaken(m, unspoiled, 300)
    seal, force = d.plugin_state.copy(), d.qfrc_passive[0]
    position, velocity, time = d.qpos[0], d.qvel[0], d.time
    spoil(m, d)
    for _ in range(3):
        step(m, d)
    assert len(warnings) == 1 and reason in warnings[0] and "joint 'insertion'" in warnings[0]
    assert d.qfrc_passive[0] == force
    m.opt.timestep = 0.002
    d.qpos[0], d.qvel[0], d.time = position, velocity, time
    assert (d.plugin_state[:43] == seal[:43]).all()
    mujoco.mj_forward(m, d), mujoco.mj_forward(m, unspoiled)
    assert d.sensordata[0] == unspoiled.sensordata[0]


def test_nan_resets_as_for_any_joint(m):
    d = mujoco.MjData(m)
    first = shaken(m, d, 100)
    d.qpos[0] = np.nan
    d.qfrc_applied[0] = 0.0
    mujoco.mj_step(m, d)
    assert d.time == m.opt.timestep and np.isfinite(state(m, d)).all()
    assert d.warning[mujoco.mjtWarning.mjWARN_BADQPOS].number == 1
    mujoco.mj_resetData(m, d)
    assert shaken(m, d, 100) == first


def test_a_state_that_is_none_is_reported(m, warnings):
    d = mujoco.MjData(m)
    shaken(m, d, 100)
    d.plugin_state[5] = np.nan
    mujoco.mj_step(m, d)
    assert len(warnings) == 1 and np.isfinite(d.qpos[0])
    mujoco.mj_resetData(m, d)
    shaken(m, d, 100)
    assert len(warnings) == 1


def test_a_state_of_another_kind_of_model_is_reported(m, ems, warnings):
    other = mujoco.MjModel.from_xml_string(scene(ems.with_name("dahl.json")))
    d, foreign = mujoco.MjData(m), mujoco.MjData(other)
    shaken(other, foreign, 100)
    d.plugin_state[:] = foreign.plugin_state
    mujoco.mj_step(m, d)
    assert len(warnings) == 1 and "trocar 'port'" in warnings[0]


def test_time_set_back_or_on_changes_nothing(m):
    d, moved = mujoco.MjData(m), mujoco.MjData(m)
    shaken(m, d, 300), shaken(m, moved, 300)
    moved.time = 0.0
    shaken(m, d, 100, 300), shaken(m, moved, 100, 300)
    moved.time = 1e6
    shaken(m, d, 100, 400), shaken(m, moved, 100, 400)
    assert (d.qpos == moved.qpos).all() and (d.sensordata == moved.sensordata).all()


def test_passive_forces_that_are_off_leave_the_seal_following(m, ems, simulate):
    m.opt.timestep = 2.0**-9
    m.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
    d = mujoco.MjData(m)
    times, positions, read = [], [], []
    for step in range(300):
        mujoco.mj_step(m, d)
        d.qvel[0] = 0.05
        assert d.qfrc_passive[0] == 0.0
        mujoco.mj_forward(m, d)
        times.append(d.time), positions.append(d.qpos[0]), read.append(d.sensordata[0])
    assert read == simulate(ems, times, positions)


def test_paths_are_relative_to_the_process_in_text_specs_and_binary_models(ems, tmp_path, monkeypatch):
    (tmp_path / "model.json").write_bytes(ems.read_bytes())
    monkeypatch.chdir(tmp_path)
    text = scene("model.json")
    binary = tmp_path / "scene.mjb"
    m = mujoco.MjModel.from_xml_string(text)
    mujoco.mj_saveModel(m, str(binary))
    expected = shaken(m, mujoco.MjData(m), 100)
    spec = mujoco.MjSpec.from_string(text)
    (tmp_path / "scene.xml").write_text(text)
    for other in (spec.compile(), mujoco.MjModel.from_binary_path(str(binary)), mujoco.MjModel.from_xml_path("scene.xml")):
        assert shaken(other, mujoco.MjData(other), 100) == expected


def test_a_spec_made_in_python(ems):
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    spec.option.gravity = [0, 0, 0]
    body = spec.worldbody.add_body()
    body.add_joint(name="insertion", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], mass=0.1)
    spec.activate_plugin("trocar")
    port = spec.add_plugin(name="port", plugin_name="trocar", active=True)
    port.config = {"model": str(ems), "joint": "insertion"}
    made = spec.compile()
    read = mujoco.MjModel.from_xml_string(scene(ems, integrator="Euler"))
    d, expected = mujoco.MjData(made), mujoco.MjData(read)
    shaken(made, d, 200), shaken(read, expected, 200)
    assert d.qpos[0] == expected.qpos[0]
