"""Posterior draws beside emcee, the affine-invariant ensemble sampler, on the same density.

    python3 -m pip install trocar emcee==3.1.6
    python3 reference/posterior.py

`Posterior.log_density` evaluates the density that `identify(posterior=N)` samples. emcee knows nothing of the sampler, its
reference or its warm-up. Printed are mean and standard deviation of the main parameters by both, the difference of the means in
their combined Monte Carlo errors, and how many evaluations of the density both need for an independent draw. Ends with 1 where
means differ by more than 4 errors, or standard deviations by more than 15 %.
"""

from __future__ import annotations

import sys
import time

import emcee
import numpy as np
import trocar

NAMES = ["coulomb_force_n", "viscous_damping_n_s_m", "offset_n", "half_width_m", "insertion_join_force_n"]
STEPS = 6000
DISCARDED = 1500


def main() -> int:
    recordings = [trocar.bench("steady"), trocar.bench("dynamic")]
    options = {"bootstrap": 0, "free_motion": False, "moving_mass_kg": 0.04, "progress": False}
    alone = trocar.identify(recordings, **options)
    begun = time.perf_counter()
    alone = trocar.identify(recordings, **options)
    without_s = time.perf_counter() - begun
    begun = time.perf_counter()
    found = trocar.identify(recordings, posterior=2000, **options)
    own_s = time.perf_counter() - begun - without_s
    posterior = found.posterior
    assert posterior is not None and alone.posterior is None
    main_structure = found.summary["posterior"]["structures"][0]
    own = {name: posterior[name][posterior["structure"] == main_structure["name"]] for name in NAMES}
    dimension = posterior.dimension
    walkers = 4 * dimension
    rng = np.random.default_rng(1)
    sampler = emcee.EnsembleSampler(
        walkers,
        dimension,
        lambda z: posterior.log_density(z)[0],
        vectorize=True,
        moves=[(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)],
    )
    start = 0.3 * rng.standard_normal((walkers, dimension))
    start = start[np.isfinite(posterior.log_density(start)[0])]
    while len(start) < walkers:
        more = 0.3 * rng.standard_normal((walkers, dimension))
        start = np.concatenate([start, more[np.isfinite(posterior.log_density(more)[0])]])
    begun = time.perf_counter()
    sampler.run_mcmc(start[:walkers], STEPS)
    emcee_s = time.perf_counter() - begun
    chain = sampler.get_chain(discard=DISCARDED)
    z = chain.reshape(-1, dimension)[:: max(1, chain.shape[0] * walkers // 40_000)]
    drawn = posterior.log_density(z, NAMES)[1]
    correlation = sampler.get_autocorr_time(discard=DISCARDED, tol=0).max()
    emcee_ess = chain.shape[0] * walkers / correlation
    wrong = False
    print(f"{dimension} dimensions, structure {main_structure['name']}")
    print("| parameter | draws | emcee | difference, Monte Carlo errors | standard deviations, ratio |\n|---|---|---|---|---|")
    for name in NAMES:
        a, b = own[name], drawn[name]
        ess = found.summary["posterior"]["parameters"][name]["convergence"]["ess_bulk"]
        error = np.hypot(a.std() / np.sqrt(ess), b.std() / np.sqrt(emcee_ess))
        off, ratio = (a.mean() - b.mean()) / error, a.std() / b.std()
        wrong |= abs(off) > 4 or abs(ratio - 1) > 0.15
        print(f"| {name} | {a.mean():.5g} ± {a.std():.2g} | {b.mean():.5g} ± {b.std():.2g} | {off:.1f} | {ratio:.3f} |")
    ess = found.summary["posterior"]["effective_sample_size"]
    evaluations = main_structure["evaluations"]
    print(f"\ndraws: {evaluations} evaluations, {ess:.0f} effective, {evaluations / ess:.1f} for one, {ess / own_s:.0f} effective a second")
    count = STEPS * walkers
    print(f"emcee: {count} evaluations, {emcee_ess:.0f} effective, {count / emcee_ess:.1f} for one, {emcee_ess / emcee_s:.0f} effective a second")
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
