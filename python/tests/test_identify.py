"""Identification, validation, comparison and compensation give the results of the command line."""

from __future__ import annotations

import json
import multiprocessing
import pickle
import threading
from pathlib import Path

import numpy as np
import pytest

import trocar

from .conftest import CONFORMANCE, ROD_KG

#: Parameters of the bench's plausible seal.
TRUTH = {"coulomb_force_n": 3.0, "viscous_damping_n_s_m": 5.0, "half_width_m": 8e-3}


def test_the_truth_lies_in_the_intervals(found: trocar.Identification) -> None:
    for name, truth in TRUTH.items():
        parameter = found.parameters[name]
        assert parameter.determined and parameter.ci95_low <= truth <= parameter.ci95_high, parameter
        assert name.endswith(parameter.unit.replace(" ", "_").replace("/", "_").lower())
    assert found.validation is not None and not found.is_doubtful
    # N rms: twice the sensor noise and force fluctuation of the bench.
    assert found.validation.rms_n < 0.06


def test_the_summary_says_how_the_fit_came_out(found: trocar.Identification) -> None:
    fit, friction = found.summary["fit"], found.summary["friction_scale"]
    assert fit["converged"] and 0 < fit["rms_n"] < 0.06
    assert {trial["term"] for trial in fit["terms"]} >= {"stribeck", "seal_damping"}
    # The bench lets the force vary from stroke to stroke by 1 %, without drift or jump.
    assert 0.003 < friction["scatter"] < 0.03 and friction["drift"] < 0.02 and not friction["jumps"]
    assert {phase["phase"] for phase in found.summary["phases"]} == {"deforming", "sliding"}


def test_results_are_reproducible_and_saved(
    found: trocar.Identification, training: list[trocar.Recording], held_out: list[trocar.Recording], tmp_path: Path
) -> None:
    again = trocar.identify(training, validate=held_out, moving_mass_kg=ROD_KG, threads=1)
    assert again.summary == found.summary and again.model == found.model
    found.save(tmp_path / "results")
    assert json.loads((tmp_path / "results" / "summary.json").read_text()) == found.summary
    assert trocar.Model.load(tmp_path / "results" / "model.json") == found.model
    found.report(tmp_path / "report.html")
    assert (tmp_path / "report.html").read_bytes() == (tmp_path / "results" / "report.html").read_bytes()
    for name, figure in found.figures.items():
        assert (tmp_path / "results" / "figures" / f"{name}.svg").read_text() == figure
    with pytest.raises(OSError):
        found.report(tmp_path / "no such folder" / "report.html")


def test_a_validation_that_contradicts_is_doubtful(
    training: list[trocar.Recording], held_out: list[trocar.Recording]
) -> None:
    stroke = held_out[0]
    other = trocar.Recording(stroke.time_s, stroke.position_m, 1.5 * stroke.force_n, name="other seal")
    found = trocar.identify(training, validate=other, moving_mass_kg=ROD_KG)
    assert found.is_doubtful and found.validation is not None and found.validation.is_doubtful
    (warning,) = [warning for warning in found.warnings if warning.subject == "other seal"]
    assert warning.doubtful and "times the model's own error" in warning.message


def test_validation_alone_says_the_same(found: trocar.Identification, held_out: list[trocar.Recording]) -> None:
    validation = trocar.validate(found.model, held_out)
    assert found.validation is not None
    assert validation.rms_n == pytest.approx(found.validation.rms_n, rel=1e-9)
    forces = validation.forces("validation")
    error = forces.measured_n - forces.model_n
    details = validation.recordings[0]
    scored = error[details.samples_before_known :]
    assert np.sqrt((scored**2).mean()) == pytest.approx(details.rms_n, rel=1e-6)
    assert set(validation.figures) == {"validation-1", "validation-2"}
    with pytest.raises(KeyError, match="no recording 'x'; there are validation, surgeon"):
        validation.forces("x")
    with pytest.raises(IndexError):
        validation.forces(2)
    with pytest.raises(trocar.ParameterError, match="offset_n must be finite"):
        trocar.validate(found.model, held_out, offset_n=np.nan)
    with pytest.raises(trocar.ParameterError, match="no recording to validate on"):
        trocar.validate(found.model, [])


def test_what_cannot_be_identified_is_told(training: list[trocar.Recording]) -> None:
    time = np.arange(100) * 1e-3
    still = trocar.Recording(time, np.zeros(100), np.zeros(100), name="still")
    with pytest.raises(trocar.IdentifyError, match="no steady sliding found"):
        trocar.identify(still)
    with pytest.raises(trocar.IdentifyError, match="no recording to identify from"):
        trocar.identify([])
    with pytest.raises(trocar.IdentifyError, match="hold the same bytes"):
        trocar.identify([training[0], training[0]])
    upside_down = trocar.Recording(training[0].time_s, training[0].position_m, -training[0].force_n)
    with pytest.raises(trocar.IdentifyError, match="flip_force=True"):
        trocar.identify(upside_down)
    with pytest.warns(UserWarning, match="validated on what it was identified from"):
        trocar.identify(training, validate=training[0], moving_mass_kg=ROD_KG)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"seed": -1}, trocar.ParameterError, "seed must be a whole number from 0 on, got -1"),
        ({"seed": 1.5}, TypeError, "seed must be a whole number, got 1.5"),
        ({"degrees": (1, 4)}, trocar.ParameterError, "polynomial degree must be between 2 and 7, got 1"),
        ({"degrees": (4,)}, trocar.ParameterError, "degrees must be two numbers"),
        ({"without": ["salt"]}, trocar.ParameterError, 'without "salt": expected one of stribeck'),
        ({"moving_mass_kg": -1}, trocar.ParameterError, "moving_mass_kg must be finite and not negative, got -1 kg"),
        ({"gravity_m_s2": -9.81}, trocar.ParameterError, "gravity_m_s2 is -9.81 m/s² without a moving mass"),
        ({"gravity_m_s2": np.inf}, trocar.ParameterError, "gravity_m_s2 must be finite"),
        ({"offset_n": np.inf}, trocar.ParameterError, "offset_n must be a finite number, got inf"),
        ({"fix": {"half_width": 0.006}}, trocar.ParameterError, 'fix: "half_width": expected one of coulomb_force_n'),
        ({"fix": {"half_width_m": "6 mm"}}, trocar.ParameterError, "fix: half_width_m must be a number or two"),
    ],
)
def test_options_out_of_range_are_refused(
    training: list[trocar.Recording], options: dict[str, object], error: type, words: str
) -> None:
    with pytest.raises(error) as raised:
        trocar.identify(training, **options)  # type: ignore[arg-type]
    assert words in str(raised.value)


def test_parameters_are_kept(training: list[trocar.Recording]) -> None:
    kept = trocar.identify(training, moving_mass_kg=ROD_KG, fix={"half_width_m": 8e-3, "coulomb_force_n": (1.0, 2.9)})
    width, force = (kept.parameters[name] for name in ("half_width_m", "coulomb_force_n"))
    assert width.value == width.ci95_low == width.ci95_high == 8e-3
    # The truth lies beyond the range.
    assert 1.0 <= force.value <= 2.9


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("strokes.csv", "read it with trocar.read"),
        ([np.zeros(3)], "expected trocar.Recording, got ndarray"),
    ],
)
def test_things_that_are_no_recordings_are_refused(given: object, words: str) -> None:
    with pytest.raises(TypeError, match=words):
        trocar.identify(given)  # type: ignore[arg-type]


def test_progress_is_told_and_may_call_off(training: list[trocar.Recording]) -> None:
    def enough(stage: str, part: float) -> None:
        assert stage and 0 <= part <= 1
        raise LookupError(stage)

    with pytest.raises(LookupError):
        trocar.compare(training, models="gms:1-10", moving_mass_kg=ROD_KG, progress=enough)


def test_several_threads_identify_at_once(training: list[trocar.Recording]) -> None:
    results = []
    work = lambda: results.append(trocar.identify(training, moving_mass_kg=ROD_KG).summary)  # noqa: E731
    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 3 and results[0] == results[1] == results[2]


def _coulomb_force(recordings: list[trocar.Recording]) -> tuple[float, trocar.Model]:
    found = trocar.identify(recordings, moving_mass_kg=ROD_KG)
    return found.parameters["coulomb_force_n"].value, found.model


def test_forked_processes_work_too(found: trocar.Identification, training: list[trocar.Recording]) -> None:
    # The parent has used several threads before; a fork does not inherit them.
    with multiprocessing.get_context("fork").Pool(1) as pool:
        force, model = pool.apply_async(_coulomb_force, (training,)).get(timeout=60)
    assert force == pytest.approx(found.parameters["coulomb_force_n"].value, rel=1e-9)
    assert len(trocar.simulate(model, [0, 1], [0, 0.01])) == 2


def test_models_are_compared(training: list[trocar.Recording], held_out: list[trocar.Recording], tmp_path: Path) -> None:
    options = {"models": ["ems", "dahl", "gms:2-3"], "moving_mass_kg": ROD_KG}
    comparison = trocar.compare(training, validate=held_out[0], **options)
    assert {model.label for model in comparison} == {"ems", "dahl", "gms-2", "gms-3"}
    assert comparison.best.label == "ems" and not comparison.held_out
    errors = [model.validate_rms_n for model in comparison]
    assert errors == sorted(errors)
    assert comparison["dahl"].model.kind == "dahl" and comparison["ems"].ns_per_sample is None
    assert comparison["dahl"].estimates["coulomb_force_n"].unit == "N"
    comparison.save(tmp_path / "compared")
    assert trocar.Model.load(tmp_path / "compared" / "models" / "gms-2.json") == comparison["gms-2"].model
    assert json.loads((tmp_path / "compared" / "compare.json").read_text()) == comparison.summary
    with pytest.raises(KeyError, match="no model 'x'"):
        comparison["x"]
    with pytest.raises(trocar.CompareError, match="fitted or scored on, and once only"):
        trocar.compare(training, validate=training[0])
    with pytest.raises(trocar.ParameterError, match='models: no model "granite"'):
        trocar.compare(training, models="granite")


def test_the_tissue_is_told_from_the_trocar(found: trocar.Identification, held_out: list[trocar.Recording]) -> None:
    recording = held_out[0]
    estimate = trocar.compensate(found.model, recording)
    # This bench has no tissue: the remainder is the error of the model, within its band.
    settled = estimate.tissue_force_n[1500:]
    assert np.abs(settled).mean() < 2 * found.parameters["coulomb_force_n"].value / 50
    assert (np.abs(settled) < 3 * estimate.tissue_force_std_n[1500:]).mean() > 0.95
    assert estimate.drift.level == pytest.approx(1, abs=0.05) and not estimate.faults and not estimate.is_doubtful
    live = trocar.Compensator(found.model)
    times = np.diff(recording.time_s, prepend=recording.time_s[0])
    rows = zip(recording.position_m[:500].tolist(), recording.force_n[:500].tolist(), times[:500].tolist())
    stepped = [live.step(*row).tissue_force_n for row in rows]
    assert np.array_equal(stepped, estimate.tissue_force_n[:500])
    rest = live.run(recording.time_s[500:] - recording.time_s[0], recording.position_m[500:], recording.force_n[500:])
    assert np.allclose(rest.tissue_force_n, estimate.tissue_force_n[500:], atol=1e-6)  # N; the times differ by rounding


def test_live_readings_have_the_sign_of_the_sensor(
    training: list[trocar.Recording], held_out: list[trocar.Recording]
) -> None:
    def upside_down(recording: trocar.Recording) -> trocar.Recording:
        return trocar.Recording(
            recording.time_s, recording.position_m, -recording.force_n, flip_force=True, name=recording.name
        )

    model = trocar.identify([upside_down(recording) for recording in training], moving_mass_kg=ROD_KG).model
    recording = held_out[0]
    columns = (recording.time_s, recording.position_m)
    expected = trocar.compensate(model, recording)
    live = trocar.Compensator(model).run(*columns, -recording.force_n)
    assert np.array_equal(live.tissue_force_n, expected.tissue_force_n)
    plain = trocar.Compensator(model, flip_force=False).run(*columns, recording.force_n)
    assert np.array_equal(plain.tissue_force_n, expected.tissue_force_n) and not plain.faults
    wrong = trocar.Compensator(model, flip_force=False).run(*columns, -recording.force_n)
    assert "opposite_sign" in wrong.faults and wrong.is_doubtful


def test_faulty_samples_are_named(found: trocar.Identification) -> None:
    live = trocar.Compensator(found.model, sensor_limit_n=20)
    live.step(0.1, 0.0, 0.0)
    faults = [(0.1, np.nan, 1e-3), (np.nan, 0.0, 1e-3), (0.1, 0.0, 0.0), (0.1, 25.0, 1e-3), (0.9, 0.0, 1e-3), (0.9, 0.0, 5.0)]
    names = [live.step(*sample).fault for sample in faults]
    assert names == ["no_reading", "no_position", "no_duration", "saturated", "jump", "gap"]
    assert set(names) < {name for name, _ in trocar.Compensation.FAULTS}
    with pytest.raises(trocar.MotionError, match="force_n has 1 samples, expected 2"):
        live.run([9, 10], [0, 0], [0])
    with pytest.raises(trocar.MotionError, match="sample 1: time_s goes back"):
        live.run([10, 9], [0, 0], [0, 0])
    with pytest.raises(trocar.ParameterError, match="force_error_n"):
        trocar.Compensator(trocar.Model.plausible())
    with pytest.raises(trocar.ParameterError, match="sensor_limit_n must be above 0"):
        trocar.Compensator(found.model, sensor_limit_n=0)
    with pytest.raises(trocar.ParameterError, match="the offset of the model includes the weight"):
        trocar.Compensator(found.model, gravity_m_s2=-9.81)
    with pytest.raises(trocar.ParameterError, match="without a moving mass"):
        trocar.Compensator(found.model, offset_n=0.1, moving_mass_kg=0.0, gravity_m_s2=-9.81)


def test_figures_and_parts_of_results_are_pickled(found: trocar.Identification) -> None:
    figure = pickle.loads(pickle.dumps(found.figures["static-friction"]))
    assert (figure, figure.heading) == (found.figures["static-friction"], found.figures["static-friction"].heading)
    assert pickle.loads(pickle.dumps((found.model, found.summary)))[0] == found.model


def test_everything_shows_itself(found: trocar.Identification, training: list[trocar.Recording]) -> None:
    classical = trocar.Model.load(CONFORMANCE / "models" / "gms.json")
    assert found.validation is not None
    estimate = trocar.compensate(found.model, training[1])
    things = [found, found.validation, found.model, classical, training[0], found.figures["static-friction"], estimate]
    for thing in things:
        html = thing._repr_html_()
        assert html.startswith("<") and html.count("<div") == html.count("</div") and "nan" not in html
        assert repr(thing).startswith(("<trocar.", "Validation("))
    assert found._repr_html_().count("data:image/svg+xml;base64,") == 3
    named = trocar.Recording(*(np.arange(9.0) / 9,) * 3, name="<script>alert(1)</script>")
    assert "<script>" not in named._repr_html_()
