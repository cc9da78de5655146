"""What a user of lmfit looks for: report, parameters, covariance, residuals, predictions."""

from __future__ import annotations

import functools
import multiprocessing
import pickle
import re
import sys

import joblib
import numpy as np
import pandas as pd
import polars as pl
import pytest

import trocar

from .conftest import ROD_KG

#: Parameters of the bench's plausible seal.
TRUTH = {"coulomb_force_n": 3.0, "viscous_damping_n_s_m": 5.0, "half_width_m": 8e-3}

quick = functools.partial(trocar.identify, moving_mass_kg=ROD_KG)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def without(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    """Hides installed modules."""
    import importlib.util

    found = importlib.util.find_spec
    hidden = lambda name, *rest: None if name in modules else found(name, *rest)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", hidden)


@pytest.fixture(scope="session")
def undetermined() -> trocar.Identification:
    """One speed determines no viscous damping."""
    time = np.arange(40_000) * 1e-3
    position = 0.05 + np.abs((0.02 * time + 0.06) % 0.12 - 0.06)
    force = trocar.simulate(trocar.Model.plausible(), time, position)
    noise = np.random.default_rng(1).normal(0, 0.02, len(time))
    return trocar.identify(trocar.Recording(time, position, force + noise))


def test_params_have_the_fields_of_lmfit(found: trocar.Identification) -> None:
    assert found.params is found.parameters
    for name, truth in TRUTH.items():
        p = found.params[name]
        assert p.determined and p.stderr is not None and p.interval == (p.ci95_low, p.ci95_high)
        assert abs(p.value - truth) < 4 * p.stderr
        # The interval is that of Student's t: at least as wide as that of the normal distribution.
        assert p.interval[1] - p.interval[0] > 2 * 1.9 * p.stderr
    with pytest.raises(KeyError, match="no parameter 'stiffness'; there are coulomb_force_n, visc"):
        found.params["stiffness"]


def test_parameters_have_the_range_of_the_model(found: trocar.Identification) -> None:
    ranges = {name: (p.min, p.max) for name, p in found.params.items()}
    assert ranges["half_width_m"] == ranges["coulomb_force_n"] == (0, np.inf)
    assert ranges["offset_n"] == (-np.inf, np.inf)
    assert all(p.min <= p.value <= p.max for p in found.params.values())
    # An interval does not leave the range.
    assert all(p.min <= p.ci95_low for p in found.params.values())


def test_statistics_have_the_names_of_lmfit(
    found: trocar.Identification, undetermined: trocar.Identification
) -> None:
    assert found.nvarys == found.summary["free_parameters"] < len(found.params)
    known = np.concatenate(found.residuals)
    known = known[~np.isnan(known)]
    assert found.ndata == pytest.approx(len(known), rel=0.05)
    # The fit scores strokes only, so that the residuals have a few more samples.
    assert found.chisqr == pytest.approx(np.sum(known**2), rel=0.05)
    assert found.redchi == pytest.approx(np.var(known), rel=0.05)
    assert found.success and re.fullmatch(r"converged after \d+ iterations", found.message)
    report = undetermined.fit_report()
    assert f"chi-square         = {undetermined.chisqr:.6g} N²" in report
    assert not hasattr(found, "aic"), "trocar.compare counts independent samples"


def test_what_is_not_determined_has_no_standard_error(undetermined: trocar.Identification) -> None:
    damping = undetermined.params["viscous_damping_n_s_m"]
    assert (
        not damping.determined and damping.stderr is None and damping.interval == (-np.inf, np.inf)
    )
    assert undetermined.covariance is not None
    assert damping.name not in undetermined.covariance.names
    # Said once, beside the parameter and not among the warnings.
    (line,) = [
        line
        for line in undetermined.fit_report().splitlines()
        if line.strip().startswith(damping.name)
    ]
    assert (
        "not determined" in line
        and damping.note is not None
        and damping.note in line
        and "+/-" not in line
    )


def test_the_report_holds_what_the_parameters_say(found: trocar.Identification) -> None:
    report = found.fit_report()
    headings = re.findall(r"^\[\[([\w ]+)\]\]", report, re.MULTILINE)
    assert headings == ["Model", "Fit Statistics", "Variables", "Correlations"]
    lines = re.findall(
        r"^    (\w+): +(\S+) \+/- (\S+) \(\S+%\) (.+?), 95 % \[(\S+), (\S+)\]", report, re.MULTILINE
    )
    assert {line[0] for line in lines} >= set(TRUTH)
    for name, value, stderr, unit, low, high in lines:
        p = found.params[name]
        assert float(value) == pytest.approx(p.value, rel=1e-5) and float(stderr) == pytest.approx(
            p.stderr, rel=0.1
        )
        assert unit == p.unit and (float(low), float(high)) == pytest.approx(p.interval, rel=1e-5)
    assert "_theta" not in report and "insertion_theta1_0_n:" in found.fit_report(coefficients=True)
    listed = [
        abs(float(value)) for value in re.findall(r"C\(.*\) += ([+-][\d.]+)", found.fit_report(0.5))
    ]
    assert listed == sorted(listed, reverse=True) and 0.5 <= min(listed) <= max(listed) <= 1
    points = re.search(r"# data points += (\d+)", report)
    assert points and int(points[1]) == pytest.approx(
        sum(len(r) for r in found.recordings), rel=0.05
    )


def test_parameters_become_data_frames(
    found: trocar.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = found.to_frame()
    assert isinstance(frame, pd.DataFrame) and list(frame.index) == list(found.params)
    assert frame.loc["half_width_m", "value"] == found.params["half_width_m"].value
    assert frame.loc["half_width_m", "stderr"] == found.params["half_width_m"].stderr
    assert np.isnan(frame.loc["seal_damping_n_s_m", "stderr"])
    without(monkeypatch, "pandas")
    polar = found.to_frame()
    assert isinstance(polar, pl.DataFrame) and polar["name"].to_list() == list(found.params)
    assert polar["value"].to_list() == frame["value"].tolist()
    without(monkeypatch, "pandas", "polars")
    with pytest.raises(ImportError, match="needs pandas or polars.*pip install pandas"):
        found.to_frame()


def test_the_covariance_belongs_to_the_standard_errors(found: trocar.Identification) -> None:
    covariance = found.covariance
    assert covariance is not None and set(TRUTH) <= set(covariance.names)
    errors = [found.params[name].stderr for name in covariance.names]
    assert np.sqrt(np.diag(covariance.matrix)) == pytest.approx(errors, rel=1e-6)
    assert np.array_equal(covariance.matrix, np.transpose(covariance.matrix))
    correlation = covariance.correlation
    assert np.diag(correlation) == pytest.approx(1) and np.abs(correlation).max() < 1 + 1e-9
    # A covariance: no combination of parameters has a negative variance.
    assert np.linalg.eigvalsh(correlation).min() > -1e-9
    frame = covariance.to_frame()
    assert frame.loc["coulomb_force_n", "offset_n"] == frame.loc["offset_n", "coulomb_force_n"]


def test_estimates_of_repeated_benches_scatter_as_the_covariance_says(
    found: trocar.Identification,
) -> None:
    again = [
        quick([trocar.bench("steady", seed=seed), trocar.bench("dynamic", seed=seed)])
        for seed in range(2, 10)
    ]
    names = list(TRUTH)
    values = np.array([[one.params[name].value for name in names] for one in again])
    stderrs = np.mean([[one.params[name].stderr for name in names] for one in again], axis=0)
    # Standard deviations of eight values are known within a factor of about 2; the standard errors
    # of F_c and c are widened on purpose (1.35 and 1.8).
    assert np.all(values.std(axis=0, ddof=1) / stderrs < 2) and np.all(
        values.std(axis=0, ddof=1) / stderrs > 0.2
    )
    assert found.covariance is not None
    at = [found.covariance.names.index(name) for name in names[1:]]
    expected = found.covariance.correlation[at[0], at[1]]
    assert expected < -0.7
    assert np.corrcoef(values[:, 1], values[:, 2])[0, 1] < -0.3


def test_the_two_steps_have_no_covariance(training: list[trocar.Recording]) -> None:
    steps = quick(training, paper=True)
    assert steps.covariance is None
    assert (
        "the paper's two steps" in steps.fit_report() and "Correlations" not in steps.fit_report()
    )
    assert steps.params["coulomb_force_n"].stderr is not None
    assert steps.success and "two steps" in steps.message


def test_residuals_are_what_the_model_leaves(found: trocar.Identification) -> None:
    assert len(found.residuals) == len(found.recordings) == 2
    # The identification scores strokes only, without clipped readings.
    assert rms(np.concatenate(found.residuals)) == pytest.approx(found.residual_rms_n, rel=0.02)
    for residual, recording in zip(found.residuals, found.recordings):
        forces = found.forces(recording.name)
        assert len(residual) == len(forces.time_s) == len(recording)
        known = ~np.isnan(residual)
        assert np.array_equal(known, forces.known) and known.mean() > 0.8 and not known[0]
        assert np.array_equal(residual[known], (forces.measured_n - forces.model_n)[known])
        # What was subtracted is the offset, and an inertia that is zero on average.
        assert (recording.force_n - forces.measured_n).mean() == pytest.approx(
            found.params["offset_n"].value, abs=2e-3
        )
    with pytest.raises(KeyError, match="no recording 'x'; there are steady, dynamic"):
        found.forces("x")


def test_predictions_are_simulations(
    found: trocar.Identification, held_out: list[trocar.Recording]
) -> None:
    time, position = held_out[0].time_s, held_out[0].position_m
    assert np.array_equal(
        found.predict(time, position), trocar.simulate(found.model, time, position)
    )
    predicted = found.predict(held_out[0])
    assert found.validation is not None
    assert np.array_equal(predicted, found.validation.forces(0).model_n)
    residual = held_out[0].force_n - predicted - found.model.sensor_offset_n
    # Not the inertia of the rod, which is a twentieth of the force.
    assert rms(residual) < 0.1 * rms(held_out[0].force_n)
    with pytest.raises(TypeError, match=r"predict\(time_s, position_m\)"):
        found.predict(time)
    with pytest.raises(TypeError, match="the recording has its own"):
        found.predict(held_out[0], position)


def test_results_are_drawn_into_axes(
    found: trocar.Identification, training: list[trocar.Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    from matplotlib import pyplot

    forces, residual = found.plot(recording="dynamic")
    measured, model = forces.get_lines()
    assert np.array_equal(measured.get_ydata(), found.forces("dynamic").measured_n)
    assert np.array_equal(model.get_ydata(), found.forces("dynamic").model_n)
    assert np.array_equal(residual.get_lines()[0].get_ydata(), found.residuals[1], equal_nan=True)
    assert forces.get_ylabel() == "force (N)" and residual.get_xlabel() == "time (s)"
    _, ax = pyplot.subplots()
    assert training[0].plot(ax) is ax and np.array_equal(
        ax.get_lines()[0].get_ydata(), training[0].force_n
    )
    assert found.validation is not None
    assert len(found.validation.plot(recording="surgeon")) == len(training[0].plot()) == 2
    pyplot.close("all")
    without(monkeypatch, "matplotlib")
    for drawn in (training[0].plot(), found.plot(), found.validation.plot(recording=1)):
        assert isinstance(drawn, trocar.Figure) and drawn.startswith("<svg") and "force" in drawn


def test_results_are_pickled_whole(found: trocar.Identification, tmp_path: object) -> None:
    restored = pickle.loads(pickle.dumps(found))
    assert "_done" not in vars(restored)
    assert (
        restored.summary == found.summary
        and restored.model == found.model
        and restored.fit_report() == found.fit_report()
    )
    assert restored.to_frame().equals(found.to_frame())
    assert all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(restored.residuals, found.residuals)
    )
    assert "_done" not in vars(restored), "none of these repeats the identification"
    assert found.validation is not None
    assert np.array_equal(restored.validation.forces(1).model_n, found.validation.forces(1).model_n)
    assert restored.figures == found.figures and restored._repr_html_() == found._repr_html_()


def test_a_pickle_that_gives_other_numbers_is_refused(found: trocar.Identification) -> None:
    restored = pickle.loads(pickle.dumps(found))
    restored.summary["residual_rms_n"] *= 2
    with pytest.raises(trocar.TrocarError, match="the repeated work gave other numbers"):
        restored.figures


def test_comparisons_and_compensations_are_pickled(
    found: trocar.Identification, training: list[trocar.Recording], held_out: list[trocar.Recording]
) -> None:
    comparison = trocar.compare(training, models=["coulomb", "dahl"], moving_mass_kg=ROD_KG)
    restored = pickle.loads(pickle.dumps(comparison))
    assert restored.summary == comparison.summary and restored["dahl"].model == comparison["dahl"].model
    assert (
        restored["dahl"].estimates["coulomb_force_n"] == comparison["dahl"].estimates["coulomb_force_n"]
    )
    assert restored.figures == comparison.figures
    estimate = trocar.compensate(found.model, held_out[0])
    again = pickle.loads(pickle.dumps(estimate))
    assert (
        np.array_equal(again.tissue_force_n, estimate.tissue_force_n, equal_nan=True)
        and again.drift == estimate.drift
    )


@pytest.mark.skipif(sys.platform == "win32", reason="the start of a process takes long")
def test_identifications_come_back_from_other_processes(training: list[trocar.Recording]) -> None:
    here = quick(training)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (there,) = pool.map(functools.partial(quick, threads=1), [training])
    assert there.summary == here.summary
    jobs = (joblib.delayed(quick)(training, threads=1, seed=seed) for seed in (1, 2))
    first, second = joblib.Parallel(n_jobs=2)(jobs)
    assert first.fit_report() == here.fit_report() and second.params.keys() == here.params.keys()
