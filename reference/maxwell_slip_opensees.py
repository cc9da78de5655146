"""Maxwell-Slip from OpenSeesPy: N materials ElasticPP in Parallel, each a spring in series with a Coulomb slider.

Confirmed by the play of each slider: the spring's free end stays within F_i/k_i of the instrument.
"""

import motion
import opensees
import vectors

SEAL = [(950.0, 0.62), (380.0, 0.81), (160.0, 0.57), (75.0, 0.44)]

SETS = {
    "maxwell_slip_seal": (SEAL, motion.nested(4e-3, 0.03)),
    "maxwell_slip_tiny": (SEAL, motion.creep(8e-3, 0.02, 1e-6)),
    "maxwell_slip_one": ([(1300.0, 2.7)], motion.coarse(7e-3, 0.05)),
    "maxwell_slip_ten": ([(2400.0 * 0.62**i, 0.5 * 0.93**i) for i in range(10)], motion.coarse(0.02, 0.1)),
    "maxwell_slip_stiff": ([(2e8, 1.9), (3e7, 1.1), (1e6, 0.7)], motion.nested(6e-7, 1e-5)),
}


def by_opensees(elements, positions):
    solver = opensees.load()
    opensees.maxwell_slip(solver, elements)
    forces = []
    for position in positions:
        solver.setStrain(position)
        forces.append(solver.getStress())
    return forces


def by_play(elements, positions):
    """Positions of the sliders, not of the springs: s_i follows x at a distance of at most F_i/k_i."""
    sliders = [0.0] * len(elements)
    forces = []
    for position in positions:
        force = 0.0
        for i, (stiffness, limit_force) in enumerate(elements):
            reach = limit_force / stiffness
            sliders[i] = min(max(sliders[i], position - reach), position + reach)
            force += stiffness * (position - sliders[i])
        forces.append(force)
    return forces


def main():
    for name, (elements, legs) in SETS.items():
        times, positions = motion.sampled(legs)
        columns = {
            "time_s": times,
            "position_m": positions,
            "velocity_m_s": [velocity for _, _, velocity in motion.intervals(times, positions)] + [0.0],
            "force_n": by_opensees(elements, positions),
        }
        parameters = {
            "elements": [{"stiffness_n_m": k, "limit_force_n": limit} for k, limit in elements],
            "viscous_damping_n_s_m": 0.0,
        }
        made_with = vectors.versions("openseespy")
        vectors.write(name, "maxwell_slip", made_with, parameters, columns, by_play(elements, positions))


if __name__ == "__main__":
    main()
