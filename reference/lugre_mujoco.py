"""LuGre and Dahl from MuJoCo: the passive `dcmotor` without electrics, its bristle advanced by an exact hold of v.

    dz/dt = v - sigma0 |v| z / g(v),    g = F_c + (F_s - F_c) exp(-(v/v_s)^2),    F = sigma0 z + sigma1 dz/dt + sigma2 v

MuJoCo calls sigma2 the `damping` of the actuator. Dahl with exponent 1 is the case F_s = F_c, sigma1 = sigma2 = 0.
Confirmed by solve_ivp on the differential equation, one interval after the other.
"""

import math

import mujoco
import scipy.integrate

import motion
import vectors

XML = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body><joint name="slide" type="slide" axis="1 0 0"/><geom size="0.1" mass="{mass}"/></body>
  </worldbody>
  <actuator>
    <dcmotor joint="slide" input="none" resistance="1" motorconst="0" lugre="{lugre}" damping="{damping}"/>
  </actuator>
</mujoco>
"""

# sigma0 N/m, sigma1 N s/m, F_c N, F_s N, v_s m/s, sigma2 N s/m
SEAL = (720.0, 1.3, 2.1, 2.9, 0.015, 4.2)
DAHL = (540.0, 0.0, 1.8, 1.8, 0.01, 0.0)

LUGRE = {
    "lugre_seal": (SEAL, motion.nested(4e-3, 0.03)),
    "lugre_coarse": (SEAL, motion.coarse(6e-3, 0.02)),
    "lugre_tiny": (SEAL, motion.creep(8e-3, 0.02, 1e-6)),
    "lugre_slow": ((1500.0, 800.0, 0.9, 1.7, 2e-7, 1e4), motion.nested(2e-3, 3e-7)),
    "lugre_stiff": ((4e7, 900.0, 0.8, 1.3, 2e-3, 0.5), motion.nested(2e-6, 1e-3)),
}

DAHL_SETS = {
    "dahl_seal": (DAHL, motion.nested(5e-3, 0.04)),
    "dahl_tiny": (DAHL, motion.creep(8e-3, 0.02, 1e-6)),
    "dahl_stiff": ((6e7, 0.0, 3.3, 3.3, 0.01, 0.0), motion.coarse(2e-7, 1e-4)),
}


def model(parameters, mass=1.0):
    """The compiled MuJoCo model of one friction joint that moves `mass`, kg."""
    *lugre, damping = parameters
    lugre = " ".join(map(repr, lugre))
    return mujoco.MjModel.from_xml_string(XML.format(lugre=lugre, damping=damping, mass=mass))


def by_mujoco(parameters, times, positions):
    """Deflection and force at the start of each interval; the last row at rest."""
    solver = model(parameters)
    data = mujoco.MjData(solver)
    deflections, forces = [], []
    for (_, duration, velocity), position in zip(motion.intervals(times, positions) + [(0.0, 1.0, 0.0)], positions):
        solver.opt.timestep = duration
        data.qpos[0], data.qvel[0] = position, velocity
        mujoco.mj_forward(solver, data)
        deflections.append(float(data.act[0]))
        # What MuJoCo's joint feels is the opposite of the force that moves the instrument.
        forces.append(float(-data.qfrc_actuator[0] - data.qfrc_passive[0]))
        mujoco.mj_step(solver, data)
    return deflections, forces


def by_integration(parameters, times, positions):
    """The same forces from the differential equation."""
    stiffness, micro, coulomb, static, stribeck, viscous = parameters
    deflection, forces = 0.0, []
    for _, duration, velocity in motion.intervals(times, positions) + [(0.0, 1.0, 0.0)]:
        level = coulomb + (static - coulomb) * math.exp(-((velocity / stribeck) ** 2))

        def rate(_, z):
            return velocity - stiffness * abs(velocity) * z / level

        forces.append(stiffness * deflection + micro * rate(0.0, deflection) + viscous * velocity)
        tolerance = {"rtol": 1e-13, "atol": 1e-14 * level / stiffness}
        solution = scipy.integrate.solve_ivp(rate, (0.0, duration), [deflection], "DOP853", **tolerance)
        deflection = float(solution.y[0, -1])
    return forces


def trajectory(name, kind, described, parameters, legs):
    times, positions = motion.sampled(legs)
    deflections, forces = by_mujoco(parameters, times, positions)
    columns = {
        "time_s": times,
        "position_m": positions,
        "velocity_m_s": [velocity for _, _, velocity in motion.intervals(times, positions)] + [0.0],
        "deflection_m": deflections,
        "force_n": forces,
    }
    confirmation = by_integration(parameters, times, positions)
    vectors.write(name, kind, vectors.versions("mujoco"), described, columns, confirmation)


def main():
    for name, (parameters, legs) in LUGRE.items():
        stiffness, micro, coulomb, static, stribeck, viscous = parameters
        described = {
            "stiffness_n_m": stiffness,
            "micro_damping_n_s_m": micro,
            "damping_velocity_m_s": None,
            "curve": "exponential",
            "sliding": vectors.sliding(coulomb, static, stribeck, viscous),
        }
        trajectory(name, "lugre", described, parameters, legs)
    for name, (parameters, legs) in DAHL_SETS.items():
        described = {"stiffness_n_m": parameters[0], "coulomb_force_n": parameters[2], "exponent": 1.0}
        trajectory(name, "dahl", described, parameters, legs)


if __name__ == "__main__":
    main()
