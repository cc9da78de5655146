"""Posterior draws, and a model as prior."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import trocar

from .conftest import ROD_KG


@pytest.fixture(scope="module")
def drawn(training: list[trocar.Recording]) -> trocar.Identification:
    told: list[tuple[str, float]] = []
    tell = lambda stage, part: told.append((stage, part))  # noqa: E731
    found = trocar.identify(training, moving_mass_kg=ROD_KG, posterior=1000, progress=tell)
    assert ("posterior draws", 0.4) in told, "half of the work"
    return found


def test_draws_are_columns_and_models(drawn: trocar.Identification, tmp_path: Path) -> None:
    posterior = drawn.posterior
    assert posterior is not None
    force_n = posterior["coulomb_force_n"]
    assert force_n.shape == (1000,) and set(posterior["chain"]) == {0, 1, 2, 3}
    found = drawn.parameters["coulomb_force_n"]
    assert abs(force_n.mean() - found.value) < 3 * force_n.std()
    time_s = np.linspace(0.0, 2.0, 2001)
    forces = trocar.simulate_many(posterior.models[:50], time_s, 0.03 * time_s)
    sliding = force_n[:50] + 0.03 * posterior["viscous_damping_n_s_m"][:50]
    if "static_force_n" not in posterior:
        assert np.allclose(forces[:, -1], sliding, rtol=0.02)
    posterior.write(tmp_path / "draws.parquet")
    again = trocar.Posterior.read(tmp_path / "draws.parquet")
    assert np.array_equal(again["half_width_m"], posterior["half_width_m"])
    copied = pickle.loads(pickle.dumps(posterior))
    assert np.array_equal(copied["coulomb_force_n"], force_n)
    with pytest.raises(KeyError, match="no column 'nothing'"):
        posterior["nothing"]


def test_the_density_is_there_for_other_samplers(drawn: trocar.Identification) -> None:
    posterior = drawn.posterior
    assert posterior is not None
    z = np.zeros((2, posterior.dimension))
    z[1, -1] = 1.0
    logarithms, there = posterior.log_density(z, ["coulomb_force_n"])
    # Nearly standard normal: one standard deviation away the logarithm falls by about a half.
    assert abs(logarithms[0]) < 1e-9 and -1.5 < logarithms[1] < -0.1
    assert there["coulomb_force_n"][0] == pytest.approx(np.mean(posterior["coulomb_force_n"]), rel=0.05)
    with pytest.raises(trocar.ParameterError, match="columns"):
        posterior.log_density(np.zeros((1, 2)))


# ArviZ announces its next version on import.
@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_arviz_takes_the_draws(drawn: trocar.Identification) -> None:
    posterior = drawn.posterior
    assert posterior is not None
    data = posterior.to_arviz()
    assert data.posterior["coulomb_force_n"].shape == (4, 250)


def test_a_model_is_a_prior_for_a_few_strokes(
    drawn: trocar.Identification, training: list[trocar.Recording]
) -> None:
    updated = trocar.identify(training[:1], moving_mass_kg=ROD_KG, prior=drawn.model, progress=False)
    assert updated.summary["prior"]["spread"] == 0.3
    assert updated.posterior is None
    with pytest.raises(trocar.ParameterError, match="prior_spread"):
        trocar.identify(training, prior=drawn.model, prior_spread=-1.0)
    with pytest.raises(trocar.ParameterError, match="multiple of 4"):
        trocar.identify(training, posterior=10)


def test_compensation_takes_draws_and_goes_on_after_pickling(
    drawn: trocar.Identification, training: list[trocar.Recording], tmp_path: Path
) -> None:
    posterior = drawn.posterior
    assert posterior is not None
    posterior.write(tmp_path / "posterior.parquet")
    options = {"adaptation": False, "moving_mass_kg": ROD_KG}
    stroke = training[0].crop(0.0, 12.0)
    plain = trocar.compensate(drawn.model, stroke, **options)
    given = trocar.compensate(drawn.model, stroke, posterior=posterior, **options)
    read = trocar.compensate(drawn.model, stroke, posterior=tmp_path / "posterior.parquet", **options)
    assert np.array_equal(given.tissue_force_std_n, read.tissue_force_std_n)
    assert np.array_equal(plain.tissue_force_n, given.tissue_force_n)
    assert not np.array_equal(plain.tissue_force_std_n, given.tissue_force_std_n)
    live = trocar.Compensator(drawn.model, posterior=posterior, **options)
    half = len(stroke) // 2
    columns = (stroke.time_s, stroke.position_m, stroke.force_n)
    live.run(*(column[:half] for column in columns))
    copied = pickle.loads(pickle.dumps(live))
    rest = tuple(column[half:] for column in columns)
    assert np.array_equal(copied.run(*rest).tissue_force_std_n, live.run(*rest).tissue_force_std_n)
    with pytest.raises(trocar.TrocarError):
        trocar.compensate(drawn.model, stroke, posterior=Path(__file__))


def test_plans_and_advice_take_draws(drawn: trocar.Identification) -> None:
    posterior = drawn.posterior
    assert posterior is not None
    planned = trocar.plan(model=drawn.model, posterior=posterior, draws=3, duration_s=40.0, progress=False)
    force_n = posterior["coulomb_force_n"]
    assert force_n.min() <= planned.expected["coulomb_force_n"].value <= force_n.max()
    with pytest.raises(trocar.PlanError, match="needs the model"):
        trocar.plan(posterior=posterior)
    advice = trocar.teleop(drawn.model, advise=True, draws=5, posterior=posterior, progress=False).advice
    assert advice is not None and advice.pairs == 6
    with pytest.raises(trocar.ParameterError, match="posterior changes nothing"):
        trocar.teleop(drawn.model, posterior=posterior)


def test_the_bench_makes_a_planned_motion() -> None:
    planned = trocar.plan(duration_s=40.0, draws=1, progress=False)
    made = trocar.bench(motion=(planned.time_s, planned.position_m), seed=3)
    assert made.duration_s == pytest.approx(planned.duration_s, abs=0.1)
    at = np.interp(planned.time_s, made.time_s, made.position_m)
    assert np.max(np.abs(at - planned.position_m)) < 2e-3
    with pytest.raises(trocar.ParameterError, match="not both"):
        trocar.bench("steady", motion=(planned.time_s, planned.position_m))
    with pytest.raises(trocar.ParameterError, match="not both"):
        trocar.bench()
