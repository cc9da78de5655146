"""Teleoperation gives the figures of the command line to the last bit; what cannot run is named with its key."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import polars
import pytest

import trocar
from trocar import _plot

from .conftest import ROOT

SOFT = "[tissue]\nstiffness_n_m = 50.0\n"

#: Without compensation it never comes to rest.
FAR = "[channel]\ndelay_s = 0.01\n[tissue]\nstiffness_n_m = 400.0\n"
FAR_KEYS: dict[str, Any] = {"channel": {"delay_s": 0.01}, "tissue": {"stiffness_n_m": 400}}

#: Reflects so much more than the sensor reads that a device leaves its range.
DIVERGING = "[control]\nforce_gain = 50.0\n" + FAR

#: What draws random numbers: the same seed gives the same ones.
NOISY = (
    'seed = 7\n[channel]\ndelay_s = 0.002\njitter_s = 0.001\nloss = 0.1\non_loss = "zero"\n'
    '[control]\narchitecture = "four_channel"\npassivity = true\n[compensation]\nfraction = 0.7\n'
    '[sensor]\nnoise_n = 0.05\nresolution_n = 0.01\n[tissue]\nkind = "hunt_crossley"\ndissipation_s_m = 0.5\n'
)


def command(folder: Path, model: trocar.Model, loop: str, *options: str) -> tuple[dict[str, Any], Path]:
    """What the command line prints as JSON, and the folder that it writes."""
    program = os.environ.get("TROCAR_PROGRAM")
    if program is None:
        pytest.skip("TROCAR_PROGRAM names no command line")
    model.save(folder / "model.json")
    (folder / "loop.toml").write_text(loop)
    run = [program, "--quiet", "teleop", "loop.toml", "--model", "model.json", "--json", "--out", "found"]
    done = subprocess.run([*run, *options], check=False, capture_output=True, text=True, cwd=folder)
    assert done.returncode in (0, 3), done.stderr
    return json.loads(done.stdout), folder / "found"


@pytest.mark.parametrize("loop", [SOFT, NOISY, NOISY.replace("four_channel", "position_force"), trocar.teleop_config("phantom"), DIVERGING])
def test_figures_and_course_are_those_of_the_command_line(loop: str, tmp_path: Path, model: trocar.Model) -> None:
    ours = trocar.teleop(model, loop)
    theirs, folder = command(tmp_path, model, loop)
    assert ours.summary == theirs
    path = folder / "course.parquet"
    assert path.exists() == (ours.unstable_after_s is None)
    if path.exists():
        course = polars.read_parquet(path)
        assert list(ours.columns()) == course.columns and len(course) == len(ours["time_s"])
        for name in course.columns:
            assert np.array_equal(ours[name], course[name].to_numpy()), name


def test_the_advice_is_that_of_the_command_line(tmp_path: Path, found: trocar.Identification) -> None:
    ours = trocar.teleop(found.model, FAR, advise=True, draws=2, threads=2)
    theirs, _ = command(tmp_path, found.model, FAR, "--advise", "--draws", "2")
    assert ours.summary == theirs
    assert ours.advice is not None and ours.advice.pairs == 5
    drawn = trocar.teleop(found.model, FAR, advise=True, compensator_draws=2, threads=2)
    theirs, _ = command(tmp_path, found.model, FAR, "--advise", "--compensator-draws", "2")
    assert drawn.summary == theirs and drawn.advice is not None and drawn.advice.pairs == 7


def test_a_folder_is_that_of_the_command_line(tmp_path: Path, model: trocar.Model) -> None:
    ours = trocar.teleop(model, FAR, hybrid=True)
    _, folder = command(tmp_path, model, FAR)
    ours.save(tmp_path / "ours")
    names = {path.name for path in folder.iterdir()}
    assert names == {path.name for path in (tmp_path / "ours").iterdir()} and "report.html" in names
    for name in ("summary.json", "course.parquet", "hybrid.parquet"):
        assert (tmp_path / "ours" / name).read_bytes() == (folder / name).read_bytes(), name
    ours.report(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_bytes() == (tmp_path / "ours" / "report.html").read_bytes()


def test_the_hybrid_matrix_is_that_of_the_command_line(tmp_path: Path, model: trocar.Model) -> None:
    ours = trocar.teleop(model, FAR, hybrid=True).hybrid
    _, folder = command(tmp_path, model, FAR)
    theirs = polars.read_parquet(folder / "hybrid.parquet")
    assert ours is not None and list(ours.columns()) == theirs.columns
    for name, column in ours.columns().items():
        assert np.array_equal(column, theirs[name].to_numpy()), name


def test_the_figures_are_those_of_the_documentation(model: trocar.Model) -> None:
    figures = trocar.teleop(model, SOFT).figures
    assert figures is not None
    page = (ROOT / "docs" / "explanation" / "teleoperation.md").read_text()
    for value in (figures.displayed_stiffness_n_m, figures.true_stiffness_n_m, figures.force_error_rms_n):
        assert f"{value:#.4g}" in page


def test_all_forms_of_a_loop_are_the_same(tmp_path: Path, model: trocar.Model) -> None:
    (tmp_path / "loop.toml").write_text(FAR)
    numpy_keys = {"channel": {"delay_s": np.float64(0.01)}, "tissue": {"stiffness_n_m": np.int64(400)}}
    found = [trocar.teleop(model, config) for config in (FAR, FAR_KEYS, numpy_keys, tmp_path / "loop.toml", str(tmp_path / "loop.toml"))]
    found += [trocar.teleop(model, **FAR_KEYS), trocar.teleop(model, {"tissue": {"stiffness_n_m": 1}}, **FAR_KEYS)]
    assert all(one.summary == found[0].summary for one in found)
    assert found[0].config["tissue"]["stiffness_n_m"] == 400 and found[0].config["tissue"]["damping_n_s_m"] == 1
    default, printed = trocar.teleop(model), trocar.teleop(model, trocar.teleop_config())
    assert default.summary == printed.summary != found[0].summary


def test_a_change_of_a_section_leaves_its_other_keys(model: trocar.Model) -> None:
    by_name = trocar.teleop(model, "dvrk", leader={"damping_n_s_m": 3}, seed=9, compensation={"fraction": 0.9})
    text = trocar.teleop_config("dvrk").replace("seed = 1 ", "seed = 9 ")
    text = text.replace("damping_n_s_m = 2.0 ", "damping_n_s_m = 3.0 ").replace("\nfraction = 0.0 ", "\nfraction = 0.9 ")
    assert by_name.summary == trocar.teleop(model, text).summary
    assert by_name.config["leader"]["mass_kg"] == 0.6 and by_name.config["leader"]["damping_n_s_m"] == 3


def test_printed_loops_are_those_of_the_command_line() -> None:
    program = os.environ.get("TROCAR_PROGRAM")
    if program is None:
        pytest.skip("TROCAR_PROGRAM names no command line")
    for device in (None, "dvrk", "phantom"):
        command = [program, "teleop", "--print-config", *([device] if device else [])]
        printed = subprocess.run(command, capture_output=True, text=True, check=True)
        assert printed.stdout == trocar.teleop_config(device)
    with pytest.raises(trocar.ParameterError, match="device must be one of dvrk, phantom, got 'davinci'"):
        trocar.teleop_config("davinci")


def test_an_unstable_loop_is_a_result_without_figures(model: trocar.Model) -> None:
    loop = trocar.teleop(model, FAR)
    assert not loop.settles and not loop.is_stable and loop.figures is None and loop.unstable_after_s is None
    assert loop.is_doubtful and "does not come to rest" in loop.warnings[0]
    assert len(loop["leader_force_n"]) == 4000 and "unstable" in repr(loop)
    stable = trocar.teleop(model, FAR, compensation={"fraction": 1.0})
    assert stable.is_stable and not stable.is_doubtful and stable.figures is not None


def test_a_loop_that_diverges_says_when(model: trocar.Model) -> None:
    loop = trocar.teleop(model, DIVERGING)
    assert loop.unstable_after_s is not None and 0 < loop.unstable_after_s < 4
    assert loop.figures is None and f"diverged after {loop.unstable_after_s:.4g} s" in repr(loop)
    for use in (loop.columns, loop.plot, loop.to_frame, lambda: loop["time_s"], lambda: loop.felt_force_n):
        with pytest.raises(trocar.TrocarError, match=r"no course: the loop diverged after .* s\n\nhint: advise=True"):
            use()
    assert "diverged after" in loop._repr_html_()


def test_figures_follow_from_the_course(model: trocar.Model) -> None:
    heavy_hand: dict[str, Any] = {"operator": {"mass_kg": 1.0}, "compensation": {"fraction": 1.0}}
    for architecture in ("position_force", "four_channel"):
        loop = trocar.teleop(model, control={"architecture": architecture}, **heavy_hand)
        assert loop.figures is not None
        error = loop.felt_force_n - loop["tissue_force_n"]
        assert np.sqrt(np.mean(error**2)) == pytest.approx(loop.figures.force_error_rms_n, rel=1e-12)
        assert np.abs(error).max() == loop.figures.force_error_peak_n
        touching = loop["tissue_force_n"] > 0
        assert (loop.depth_m[touching] > 0).all() and touching.any()


def test_a_tip_out_of_reach_is_doubtful(model: trocar.Model) -> None:
    loop = trocar.teleop(model, tissue={"surface_m": 0.2})
    assert loop.figures is not None and loop.figures.true_stiffness_n_m is None
    assert loop.is_doubtful and "does not reach the tissue" in loop.warnings[0] and "no contact" in repr(loop)
    assert not trocar.teleop(model, tissue={"kind": "none"}).is_doubtful


def test_advice_says_which_fractions_are_stable(found: trocar.Identification) -> None:
    loop = trocar.teleop(found.model, FAR, advise=True, draws=2)
    advice = loop.advice
    assert advice is not None and advice.fraction is not None and advice.pairs == 5
    assert advice.noticeable_with is not None and advice.noticeable_with.is_noticed and advice.noticeable_without is None
    columns = advice.columns()
    assert np.array_equal(columns["fraction"], np.arange(61) * 0.025)
    errors = columns["force_error_rms_n"]
    assert np.array_equal(np.isnan(errors), ~columns["stable"])
    assert columns["fraction"][np.nanargmin(errors)] == advice.fraction
    assert advice.figures_with is not None and advice.figures_with.force_error_rms_n == np.nanmin(errors)
    assert advice.figures_without is None and not columns["stable"][0] and "without compensation" in advice._repr_html_().lower()
    (low, high), *_ = advice.stable
    assert columns["stable"][(columns["fraction"] >= low) & (columns["fraction"] <= high)].all()
    assert trocar.teleop(found.model, FAR, advise=True, draws=2, threads=1).summary == loop.summary
    assert trocar.teleop(found.model, FAR, advise=True, draws=2, seed=2).summary != loop.summary
    frame = advice.to_frame()
    assert frame.index.name == "fraction" and len(frame) == 61


def test_the_map_is_where_loops_settle(model: trocar.Model) -> None:
    told: list[tuple[str, float]] = []
    loop = trocar.teleop(
        model, map=True, delays_s=[0.005, 0.01], fractions=[0.0, 0.9, 1.2], progress=lambda *news: told.append(news)
    )
    found = loop.map
    assert found is not None and found.stiffness_n_m.shape == found.least_stiffness_n_m.shape == (2, 3)
    bounded = 0
    for row, delay in enumerate(found.delays_s):
        for place, fraction in enumerate(found.fractions):
            greatest = found.stiffness_n_m[row, place]
            assert np.isnan(found.least_stiffness_n_m[row, place]) == (greatest == 0)
            if 0 < greatest < 20_000:
                bounded += 1
                # It is found to within 2 %.
                settles = [
                    trocar.teleop(
                        model,
                        channel={"delay_s": delay},
                        compensation={"fraction": fraction},
                        tissue={"stiffness_n_m": factor * greatest},
                    ).settles
                    for factor in (0.97, 1.03)
                ]
                assert settles == [True, False], (delay, fraction)
    assert bounded >= 4
    assert {stage for stage, _ in told} <= {"stability map"} and all(0 < part <= 1 for _, part in told)
    frame = polars.DataFrame(found.columns())
    assert frame.shape == (6, 5) and frame["ranges"].to_list() == [len(cell) for row in found.z_width_n_m for cell in row] and frame["stiffness_n_m"].to_list() == found.stiffness_n_m.ravel().tolist()
    assert len(found.to_frame()) == 6 and "5 ms" in found._repr_html_()
    own = trocar.teleop(model).z_width_n_m
    assert own == ((0.0, 20_000.0),)
    cell = trocar.teleop(model, channel={"delay_s": 0.005}, compensation={"fraction": 0.9}).z_width_n_m
    assert cell is not None and cell[0][0] == found.least_stiffness_n_m[0, 1]
    # Its own stiffness is tried, too, so that the bisection begins elsewhere.
    assert cell[0][1] == pytest.approx(found.stiffness_n_m[0, 1], rel=0.02)


def test_the_hybrid_matrix_transmits_what_it_says(model: trocar.Model) -> None:
    found = trocar.teleop(model, "dvrk", hybrid=True, compensation={"fraction": 0.9}, channel={"delay_s": 0.005}).hybrid
    assert found is not None and len(found) == 61
    assert found.frequency_hz[0] == pytest.approx(0.1) and found.frequency_hz[-1] == pytest.approx(100)
    # Solved as a system: F_h = h11 v_m + h12 F_e, -v_s = h21 v_m + h22 F_e, F_e = Z_e v_s, at v_m = 1.
    for k, tissue in enumerate(found.tissue_n_s_m):
        system = np.array([[1, -found.h12[k], 0], [0, -found.h22[k], -1], [0, 1, -tissue]])
        force, _, _ = np.linalg.solve(system, np.array([found.h11[k], found.h21[k], 0]))
        assert force == pytest.approx(found.transmitted_n_s_m[k], rel=1e-9)
    # With a delay the loop is not stable with every operator and tissue.
    assert found.llewellyn_margin.min() < 0
    two = trocar.teleop(model, hybrid=True, frequencies_hz=[1, 2.5]).hybrid
    assert two is not None and two.frequency_hz.tolist() == [1, 2.5]
    assert two.to_frame()["h11_real_n_s_m"].tolist() == two.h11.real.tolist()
    # Nothing but masses and dampers where there is no delay, trocar or tissue to add to them.
    free = trocar.teleop(model, hybrid=True, frequencies_hz=[1], sensor={"place": "tip"}).hybrid
    assert free is not None and free.h11[0] == pytest.approx(1.0 + 2j * np.pi * 0.5, rel=1e-12)


def test_another_model_in_the_compensator(model: trocar.Model) -> None:
    stronger = model.tuned(insertion_coulomb_force_n=4.0, withdrawal_coulomb_force_n=4.0)
    compensation = {"fraction": 1.0}
    own, other = (trocar.teleop(model, compensator=c, compensation=compensation) for c in (None, stronger))
    assert own.summary == trocar.teleop(model, compensator=model, compensation=compensation).summary
    assert own.figures is not None and other.figures is not None
    assert other.figures.force_error_rms_n > 2 * own.figures.force_error_rms_n


def test_adaptation_takes_the_error_of_the_model(found: trocar.Identification, model: trocar.Model) -> None:
    adapting = {"fraction": 1.0, "adaptation": True}
    loop = trocar.teleop(found.model, compensation=adapting)
    assert loop.config["compensation"]["force_error_n"] > 0
    with pytest.raises(trocar.TeleopError, match=r"compensation.force_error_n, or identify the model again with validate=\.\.\.$"):
        trocar.teleop(model, compensation=adapting)
    assert trocar.teleop(model, compensation={**adapting, "force_error_n": 0.1}).settles


@pytest.mark.parametrize(
    ("config", "kind", "words"),
    [
        ({"tissue": {"stifness_n_m": 1}}, trocar.TeleopError, "tissue.stifness_n_m: unknown field `stifness_n_m`, expected one of"),
        ({"tisue": {"stiffness_n_m": 1}}, trocar.TeleopError, "tisue.stiffness_n_m: unknown field `tisue`"),
        ({"tisue": {}}, trocar.TeleopError, "hint: `trocar.teleop_config()` prints a loop with every key"),
        ({"tissue": {"stiffness_n_m": "stiff"}}, trocar.TeleopError, "tissue.stiffness_n_m: invalid type: string"),
        ({"tissue": {"stiffness_n_m": None}}, trocar.TeleopError, "tissue.stiffness_n_m: invalid type: null"),
        ({"tissue": {"stiffness_n_m": np.nan}}, trocar.TeleopError, "tissue.stiffness_n_m must be finite, got nan"),
        ({"sample_time_s": np.float64(np.inf)}, trocar.TeleopError, "sample_time_s must be finite, got inf"),
        ({"sample_time_s": {"s": 1}}, trocar.TeleopError, "sample_time_s.s: invalid type: map"),
        ({"tissue": 3}, trocar.TeleopError, "tissue: invalid type: integer `3`"),
        ({"substeps": 2.5}, trocar.TeleopError, "substeps: invalid type: floating point `2.5`"),
        ({"leader": {"mass_kg": -1}}, trocar.TeleopError, "leader.mass_kg must be from 1e-6 to 1e15, got -1"),
        ({"channel": {"delay_s": 0.0015}}, trocar.TeleopError, "channel.delay_s must be a multiple of the sample time, 0.001 s"),
        ({"channel": {"delay_s": -0.001}}, trocar.TeleopError, "channel.delay_s must be from 0 to"),
        ({"control": {"architecture": "wav"}}, trocar.TeleopError, "control.architecture: unknown variant `wav`"),
        ({"tissue": {"stiffness_n_m": {1}}}, TypeError, "a number, text, list or dictionary is expected, got set"),
        ("[tissue]\nstifness_n_m = 1.0\n", trocar.TeleopError, "TOML parse error at line 2"),
        ("[leader]\nmass_kg = -1.0\n", trocar.TeleopError, "leader.mass_kg must be"),
        ("dvkr", FileNotFoundError, "no device has this name (dvrk, phantom): 'dvkr'"),
        (7, TypeError, "config must be the name of a device, a path, a TOML text or a dictionary, got int"),
    ],
)
def test_what_is_no_loop_is_named_with_its_key(config: Any, kind: type, words: str, model: trocar.Model) -> None:
    with pytest.raises(kind) as raised:
        trocar.teleop(model, config)
    assert words in str(raised.value)
    if isinstance(config, dict):
        with pytest.raises(kind) as raised:
            trocar.teleop(model, **config)
        assert words in str(raised.value)


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"least_friction": 0.5}, trocar.ParameterError, "least_friction changes nothing without advise=True"),
        ({"advise": True, "least_friction": 0.0}, trocar.ParameterError, "least_friction must be from 0.01 to 1"),
        ({"advise": True, "draws": 5}, trocar.TeleopError, "draws needs a model with 95 % intervals"),
        ({"advise": True, "draws": 1001}, trocar.ParameterError, "draws must be from 1 to 1000, got 1001"),
        ({"advise": True, "draws": -1}, trocar.ParameterError, "draws must be a whole number from 0 on"),
        ({"draws": 5}, trocar.ParameterError, "draws changes nothing without advise=True"),
        ({"compensator_draws": 5}, trocar.ParameterError, "compensator_draws changes nothing without advise=True"),
        ({"advise": True, "compensator_draws": 5}, trocar.TeleopError, "compensator_draws needs a model with 95 % intervals"),
        ({"delays_s": [0.0]}, trocar.ParameterError, "delays_s changes nothing without map=True"),
        ({"frequencies_hz": [1.0]}, trocar.ParameterError, "frequencies_hz changes nothing without hybrid=True"),
        ({"map": True, "delays_s": [0.0015]}, trocar.TeleopError, "channel.delay_s must be a multiple"),
        ({"map": True, "fractions": [-1.0]}, trocar.TeleopError, "compensation.fraction must be 0 or above"),
        ({"map": True, "fractions": []}, trocar.ParameterError, "fractions must hold at least one number"),
        ({"hybrid": True, "frequencies_hz": [0.0]}, trocar.TeleopError, "frequency_hz must be from 1e-9 to 1e6, got 0"),
        ({"hybrid": True, "frequencies_hz": "all"}, trocar.ArrayError, "frequencies_hz must hold numbers"),
        ({"advise": True, "sensor": {"place": "tip"}}, trocar.TeleopError, "hint: leave out advise and map"),
        ({"advice": True}, trocar.TeleopError, "advice: unknown field `advice`"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    options: dict[str, Any], kind: type, words: str, model: trocar.Model
) -> None:
    with pytest.raises(kind) as raised:
        trocar.teleop(model, **options)
    assert words in str(raised.value)


def test_messages_name_the_file(tmp_path: Path, model: trocar.Model) -> None:
    (tmp_path / "loop.toml").write_text("[leader]\nmass_kg = -1.0\n")
    with pytest.raises(trocar.TeleopError, match=r"loop.toml: leader.mass_kg must be"):
        trocar.teleop(model, tmp_path / "loop.toml")


def test_results_display_themselves(model: trocar.Model) -> None:
    loop = trocar.teleop(model, SOFT, advise=True, map=True, delays_s=[0.0], fractions=[0.0, 0.9])
    assert loop.figures is not None and loop.advice is not None and loop.map is not None
    shown = f"{loop.figures.displayed_stiffness_n_m:.4g} N/m displayed for {loop.figures.true_stiffness_n_m:.4g} N/m"
    assert "0 % of the trocar's force compensated" in repr(loop) and shown in repr(loop)
    html = loop._repr_html_()
    for text in (f"{loop.figures.force_error_rms_n:.4g}", "position_force", "Compensate", "Stability map"):
        assert text in html
    assert "<script" not in html and "1 delays, 2 fractions" in repr(loop.map)
    frame = loop.to_frame()
    assert isinstance(frame, pandas.DataFrame) and frame.index.name == "time_s" and len(frame) == 4000
    with pytest.raises(KeyError, match="no column 'force'; there are time_s, "):
        loop["force"]


def test_plots_draw_what_the_results_hold(model: trocar.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    from matplotlib import pyplot

    loop = trocar.teleop(model, FAR, advise=True, map=True, delays_s=[0.0, 0.005, 0.01], fractions=[0.0, 1.0], hybrid=True)
    assert loop.advice is not None and loop.map is not None and loop.hybrid is not None
    over_time, over_depth = loop.plot()
    assert np.array_equal(over_time.lines[0].get_ydata(), loop.felt_force_n)
    assert np.array_equal(over_time.lines[1].get_ydata(), loop["tissue_force_n"])
    assert np.array_equal(over_depth.lines[0].get_xdata(), 1e3 * loop.depth_m)
    assert over_time.get_xlabel() == "time (s)" and "depth" in over_depth.get_xlabel()
    mesh = loop.map.plot().collections[0]
    assert mesh.get_array().shape == (3, 2)
    assert np.array_equal(mesh.get_array().filled(0.0), loop.map.stiffness_n_m)
    (crosses,) = loop.map.plot().lines
    assert len(crosses.get_xdata()) == (loop.map.least_stiffness_n_m > 0).sum()
    errors = loop.advice.plot()
    assert np.array_equal(errors.lines[0].get_ydata(), loop.advice.columns()["force_error_rms_n"], equal_nan=True)
    assert len(errors.patches) == (~loop.advice.columns()["stable"]).sum() > 0
    assert np.array_equal(loop.hybrid.plot()[1].lines[0].get_ydata(), loop.hybrid.llewellyn_margin)
    _, ax = pyplot.subplots()
    assert loop.plot(ax) is ax and loop.advice.plot(ax) is ax
    pyplot.close("all")
    monkeypatch.setattr(_plot, "has_matplotlib", lambda: False)
    for draw in (loop.plot, loop.map.plot, loop.advice.plot, loop.hybrid.plot):
        with pytest.raises(ImportError, match="needs matplotlib"):
            draw()


def test_the_example_of_the_documentation_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: trocar.Identification
) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    from matplotlib import pyplot

    text = (ROOT / "docs" / "reference" / "python.md").read_text().split("## Teleoperation", 1)[1]
    found.model.save(tmp_path / "model.json")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(text.split("```python\n", 1)[1].split("```", 1)[0], names)
    assert names["loop"].is_stable and names["mapped"].columns()
    pyplot.close("all")
