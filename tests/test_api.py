"""`import roslf_design as roslf`: what it offers, each with an example, and that it costs nothing until used."""

import contextlib
import doctest
import os
import pty
import re
import subprocess
import sys
import warnings

import numpy as np
import pytest
import tifffile

import roslf_design as roslf
from roslf_design.cli import main
from tests.reporting.made import rough_resolution

FUNCTIONS = (
    *("calibrate", "decode", "evaluate", "evaluate_many", "load", "optimize", "quantity", "render", "report"),
    *("bench_check", "bench_report", "datasheet", "tolerance"),
)


def test_importing_it_imports_nothing_heavy():
    code = "import sys, roslf_design; print([m for m in ('numpy', 'pydantic', 'numba', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", [n for n in roslf.__all__ if n != "__version__"])
def test_every_public_name_is_there_and_says_what_it_is(name):
    value = getattr(roslf, name)
    assert name in dir(roslf)
    assert value.__doc__
    if name in FUNCTIONS:
        assert "Examples" in value.__doc__ or name == "load"


def test_examples_run():
    from roslf_design import api

    # An array's digits are printed alike by every numpy that the project allows.
    assert doctest.testmod(api).failed == 0
    with pytest.raises(ValueError, match="did you mean 'fill_factor'"):
        roslf.quantity("fil_factor")


def test_what_rays_would_tell_otherwise_is_said_to_be_of_the_thin_lens_model():
    """By name and lens, at the caller's line; of an ideal lens, or where lengths tell, nothing is said."""
    singlet, wide = roslf.Camera.of(roslf.load("paper-singlet")), roslf.quantity("field_half_width_mm", at=100.0)
    with pytest.warns(UserWarning, match="field_half_width_mm is of the thin-lens model of LA1050-A") as said:
        value = wide(singlet)
    assert said[0].filename == __file__
    assert value == roslf.QUANTITIES["field_half_width_mm"](singlet, 100.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        wide(roslf.Camera.of(roslf.load("paper")))
        roslf.quantity("fill_factor")(singlet)


def test_a_sweep_is_a_camera_with_an_array():
    camera = roslf.Camera.of(roslf.load("paper"), {"d_3": np.linspace(0, 300, 61)})
    fill = roslf.quantity("fill_factor")(camera)
    assert fill.shape == (61,)
    assert fill[24] == pytest.approx(roslf.evaluate("paper").f_number.fill_factor, rel=1e-15)


KINDS = {
    "tolerance": (roslf.tolerance, "study: takes the path of a study file, which names its design"),
    "optimize": (roslf.optimize, "study: takes the path of a study file"),
    "datasheet": (roslf.datasheet, "design: takes a Design, the name of a preset or the path of a file"),
    "calibrate": (lambda x: roslf.calibrate(x, "paper", "4x5 6 mm"), "folder: takes the path of a folder of captures"),
    "capture_depth": (roslf.capture_depth, "image: takes the path of a raw image"),
    "decode": (roslf.decode, "image: takes the path of a raw image"),
    "bench_check": (roslf.bench_check, "folder: takes the path of a folder that `roslf bench` wrote"),
    "bench_report": (roslf.bench_report, "folder: takes the path of a folder that `roslf bench` wrote"),
    "render": (roslf.render, "design: takes a Design, the name of a preset or the path of a design file"),
    "scene": (lambda x: roslf.render("paper", x), "scene: takes a Scene, the path of a scene file, or None"),
    "measure_depth": (lambda x: roslf.measure_depth("paper", x), "scene: takes a Scene"),
    "report": (roslf.report, "subject: takes a design, or what another function of roslf_design returned"),
    "quantity": (roslf.quantity, "quantity: takes the name of a quantity"),
    "load": (roslf.load, "path: takes the path of a design file, or the name of a preset"),
    "loads": (roslf.loads, "text: takes TOML text"),
    "dumps": (roslf.dumps, "design: takes a Design"),
    "save": (lambda x: roslf.save(roslf.load("paper"), x), "path: takes the path of a file to write"),
    "evaluate": (roslf.evaluate, "design: takes a Design"),
    "evaluate_many": (lambda x: roslf.evaluate_many([x]), "design: takes a Design"),
    "designs": (roslf.evaluate_many, "designs: takes a list of designs"),
    "sweep": (lambda x: roslf.sweep("paper", x, "q"), "places: takes a mapping of places to values"),
    "sweep, names": (lambda x: roslf.sweep("paper", {"d_3": [1.0]}, [x]), "quantity: takes the name of a quantity"),
    "specification": (roslf.specification, "design: takes a Design"),
    "render_html": (roslf.render_html, "report: takes a Report"),
    "render_pdf": (roslf.render_pdf, "report: takes a Report"),
    "Camera.of": (roslf.Camera.of, "design: takes a Design"),
}
"""Functions of one argument, and what is said where it is of no kind that they take."""


@pytest.mark.parametrize("name", KINDS)
def test_an_argument_of_the_wrong_kind_is_refused_in_our_words(name):
    function, said = KINDS[name]
    with pytest.raises(roslf.InputError) as error:
        function(5)
    assert str(error.value).startswith(said)
    assert str(error.value).endswith("; got int")


@pytest.mark.parametrize("one", ["paper", roslf.load("paper")])
def test_many_may_be_one_design(one):
    """Python would take a name by its letters, and a design by its parts."""
    assert len(roslf.evaluate_many(one, ["fill_factor"])) == 1


def test_a_design_is_no_study():
    for function in (roslf.tolerance, roslf.optimize):
        with pytest.raises(roslf.InputError, match=r'design = "mine\.toml"; got Design'):
            function(roslf.load("paper"))
    with pytest.raises(roslf.InputError, match="; got None"):
        roslf.evaluate(None)


def test_evaluate_takes_a_preset_a_path_or_a_design(tmp_path):
    path = tmp_path / "mine.toml"
    roslf.save(roslf.load("paper"), path)
    assert roslf.evaluate(path) == roslf.evaluate("paper") == roslf.evaluate(roslf.load("paper"))
    assert roslf.specification(path) == roslf.specification("paper")
    assert roslf.sweep(path, {"D_F": [2.0]}, ["fill_factor"]).values["fill_factor"].shape == (1,)


STUDY = """
name = "small"
design = "paper"
sobol_samples = 0
[[perturb]]
place = "aperture.diameter"
tolerance = "1 %"
[[goals]]
metric = "fill_factor"
max = 1.02
"""


def test_a_tolerance_study_runs_in_this_process(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    result = roslf.tolerance(tmp_path / "study.toml", trials=256, seed=3)
    assert 0 <= result.final.result.value <= 1
    assert result.to_dict()
    assert f"{result.final.result.value:.2%}" in str(result)
    assert len(str(result)) < 300  # not all its arrays


@pytest.mark.parametrize(
    "work",
    [
        lambda heard: roslf.sweep("paper", {"D_F": [2.0]}, ["fill_factor", "f_number_pupil"], progress=heard),
        lambda heard: roslf.evaluate_many(["paper", "paper-singlet"], ["field_of_view_deg"], progress=heard),
        lambda heard: roslf.render("paper", region=(2280, 1520, 40, 30), progress=heard),
        lambda heard: roslf.tolerance("study.toml", trials=64, progress=heard),
        lambda heard: roslf.measure_depth("paper", region=(2240, 1480, 80, 80), progress=heard),
    ],
    ids=["sweep", "evaluate_many", "render", "tolerance", "measure_depth"],
)
def test_long_work_tells_all_progress_in_the_same_way(work, tmp_path, monkeypatch, capsys):
    """A step, how much of it, of how much: never less than before, and to its end; `ProgressLine` shows each."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(STUDY)
    told, line = {}, roslf.ProgressLine()

    def heard(what, done=0.0, total=0.0):
        told.setdefault(what, []).append((done, total))
        line(what, done, total)

    work(heard)
    for steps in told.values():
        shares = [done / total for done, total in steps if total]
        assert shares == sorted(shares)
        assert 0 <= shares[0] <= shares[-1] <= 1
    assert shares[-1] == pytest.approx(1)
    printed = capsys.readouterr()
    assert printed.out == ""
    shown = [re.split(":| \\.", text.rpartition("\r")[2])[0] for text in printed.err.strip().split("\n")]
    assert list(dict.fromkeys(shown)) == list(told)


BAD = (
    'bench_check("captures")',
    'bench_check("nowhere")',
    'bench_report("captures")',
    'bench_report("captures", placed=0.0)',
    'calibrate("nowhere", "paper", "4x5 6 mm")',
    'calibrate("nowhere", "paper", "4 by 5")',
    'calibrate("nowhere", "nothing.toml", "4x5 6 mm")',
    'calibrate("nowhere", "paper", "4x5 6 mm", f_sigma="x", seed=-1, diffraction="maybe", distortion=5)',
    'calibrate("nowhere", "paper", "4x5 6 mm", use_in="0.5")',
    'calibrate("nowhere", "paper", "4x5 6 mm", accuracy=2.0)',
    'calibrate("nowhere", "paper", "4x5 6 mm", distances="none.toml")',
    'calibrate("nowhere", "paper", "4x5 6 mm", sigma={"elements.0.index": "1 %"})',
    'calibrate("nowhere", "paper", "4x5 6 mm", diffracton="on")',
    'calibrate("captures", "paper", "4x5 6 mm")',
    'capture_depth("nope.tif")',
    'capture_depth("nope.tif", design="paper")',
    'capture_depth("nope.tif", design="paper", window=4)',
    'capture_depth("nope.tif", design="paper", truth="x.pfm")',
    'capture_depth("nope.tif", design="paper", between="near")',
    'capture_depth("nope.tif", design="paper", sigma={"aperture": "1%"})',
    'capture_depth("nope.tif", calibration="nowhere")',
    'capture_depth("captures", white="w.tif", dark="d.tif", region=(0, 0, 9, 9))',
    'capture_depth("captures", sigma={"aperture.diameter": "1%"})',
    'capture_depth("captures/white.tif", design="paper")',
    'capture_depth("captures/white.tif", white="captures/white.tif", design="paper")',
    'datasheet("nothing")',
    'datasheet("paper", at="x")',
    'datasheet("paper", calibration="nowhere")',
    'datasheet("paper", calibration="planned", seed=-1)',
    'datasheet("study.toml", seed=-1)',
    'datasheet("paper", seed=-1)',
    'datasheet("paper", seed="x")',
    'datasheet("paper", calibration=5)',
    'datasheet("paper", revision=5)',
    r'datasheet("paper", revision="\n")',
    'decode("nope.tif")',
    'decode("nope.tif", "white.tif")',
    'decode("nope.tif", design="paper", calibration="nowhere")',
    'decode("captures", "white.tif")',
    'decode("captures/white.tif", design="paper", focus=["near"])',
    'evaluate("nothing")',
    'evaluate("paper", accuracy=2)',
    'evaluate("paper", accuracy="fine")',
    'evaluate("paper", [0.0] * 501)',
    'evaluate("paper", [1e16])',
    'evaluate("paper", temperature=500)',
    'evaluate("paper", temperature="warm")',
    "evaluate_many([])",
    'evaluate_many(["paper", "nothing"])',
    'evaluate_many(["paper"], ["kept_fraction"])',
    'evaluate_many(["paper"], ["nothing"])',
    'evaluate_many(["paper"], ["virtual_depth"])',
    'evaluate_many(["paper"], temperature=500)',
    'measure_depth("paper", region=(0, 0, 4, 4))',
    'measure_depth("paper", exposures=0)',
    'measure_depth("paper", rays=0)',
    'measure_depth("paper", "no-scene.toml")',
    'optimize("nothing.toml")',
    'quantity("fil_factor")',
    'render("paper", region=(0, 0, -4, 4))',
    'render("paper", region=(0, 0))',
    'render("paper", region=(0, 0, 4, 4), seed=2**63)',
    'render("paper", region=(0, 0, 4, 4), seed=0.5)',
    'render("paper", region=(0, 0, 4, 4), threads=0)',
    'render("paper", overrides=["+magic"])',
    'render("paper", "no-scene.toml")',
    'report("nothing")',
    'specification("nothing")',
    'sweep("paper", {"nothing": [1.0]}, ["fill_factor"])',
    'sweep("paper", {"d_3": [1.0]}, ["nothing"])',
    'tolerance("nothing.toml")',
    'tolerance("study.toml", trials=0)',
    'tolerance("study.toml", trials=64, seed=-1)',
)
"""Calls that cannot be done, of every function."""
ASK = """
import sys
import roslf_design as roslf
for call in open("calls").read().splitlines():
    try:
        eval("roslf." + call)
    except (ValueError, OSError) as error:
        told = str(error)
        if "--" in told or not told:
            sys.exit(f"{call}: {told}")
    else:
        sys.exit(f"{call}: is not refused")
"""


def test_python_is_told_in_python_s_words_and_nothing_is_printed(tmp_path):
    """On a terminal too, where the shell shows how far it is."""
    (tmp_path / "captures").mkdir()
    noise = np.random.default_rng(0).integers(0, 255, (64, 64), dtype=np.uint8)
    for name in ("white.tif", "board.tif"):
        tifffile.imwrite(tmp_path / "captures" / name, noise)
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "calls").write_text("\n".join(BAD))
    main, ours = pty.openpty()
    done = subprocess.run([sys.executable, "-c", ASK], cwd=tmp_path, stdin=ours, stdout=ours, stderr=ours)
    os.close(ours)
    printed = b""
    with contextlib.suppress(OSError):  # of a terminal whose other end is closed
        while part := os.read(main, 4096):
            printed += part
    os.close(main)
    assert (done.returncode, printed.decode()) == (0, "")


def test_every_function_has_a_call_that_cannot_be_done():
    functions = {name for name in roslf.__all__ if name.islower() and callable(getattr(roslf, name))}
    others = {"dumps", "load", "loads", "preset_names", "render_html", "render_pdf", "save"}  # of files and values
    assert {call.split("(")[0] for call in BAD} == functions - others


def test_a_report_is_made_of_a_design_and_of_a_result_and_shows_itself(tmp_path):
    """Results of pictures have theirs in `docs/notebooks`; no command made any of them."""
    (tmp_path / "study.toml").write_text(STUDY)
    report = roslf.report(roslf.tolerance(tmp_path / "study.toml", trials=256, seed=3))
    names = [figure.name for figure in report.figures]
    assert report.subtitle == "small"
    assert "Run again" not in roslf.render_html(report)
    assert set(report.figure(names[0])._repr_mimebundle_()) == {"image/svg+xml", "text/plain"}
    shown = report._repr_html_()
    assert all(name in shown for name in names)
    assert "<script" not in shown
    with pytest.raises(ValueError, match=f"no figure 'nothing'; there are {names[0]}"):
        report.figure("nothing")


def test_a_data_sheet_is_that_of_the_command(tmp_path, monkeypatch):
    """Of a design as a value, of its file and of a study: the page that `roslf datasheet` writes, but for the date.

    That of the design by a process of its own; that of the study is rough.
    """
    design = roslf.load("rigid-scope")
    roslf.save(design, tmp_path / "scope.toml")
    (tmp_path / "study.toml").write_text(STUDY)
    for subject, file in ((design, "scope.toml"), (tmp_path / "study.toml", "study.toml")):
        page = roslf.render_html(roslf.datasheet(subject, ["20 mm"], revision="B"))
        command = ["datasheet", file, "--at", "20mm", "--revision", "B", "-o", "sheet.html"]
        if subject is design:
            assert subprocess.run([sys.executable, "-m", "roslf_design", *command], cwd=tmp_path).returncode == 0
            rough_resolution(monkeypatch)
            monkeypatch.chdir(tmp_path)
        else:
            assert main(command) == 0
        assert (tmp_path / "sheet.html").read_text() == page
        (tmp_path / "sheet.html").unlink()


def test_a_distance_is_one_number_or_several():
    (alone,), several = ([one.at_mm for one in roslf.evaluate("paper", at=at).answer.at][1:] for at in (15, [15.0, 20]))
    assert [alone, several] == [15.0, [15.0, 20.0]]
    assert roslf.specification("paper", 15) == roslf.specification("paper", [15.0])
    swept = [roslf.sweep("paper", {"d_3": [100.0]}, ["sigma_z_mm"], at).values["sigma_z_mm"][0] for at in (15, [15.0])]
    tabled = [roslf.evaluate_many(["paper"], ["sigma_z_mm"], at=at).columns["sigma_z_mm"][0] for at in (15, [15.0])]
    assert swept[0] == swept[1]
    assert tabled[0] == tabled[1]
    with pytest.raises(roslf.InputError, match="ask once for each"):
        roslf.sweep("paper", {"d_3": [100.0]}, ["sigma_z_mm"], [15, 20])


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("sensor.fps", "known here: .*pixel, size, .*pixels"),
        ("sensor.pixel_size", "is called pixel here"),
        ("sensor.iso", "known here: "),
        ("aperture.d_3", "is called distance here"),
        ("microlens_array.f", r"is focal_length in \[main_lens\]"),
        ("main_lens.aperture", "known here: "),
        ("sensor.noise", "did you mean 'read_noise'"),
    ],
)
def test_a_key_that_is_none_is_told_one_near_in_letters_or_meaning_at_its_place_or_all(place, said):
    with pytest.raises(roslf.InputError, match=f"^{place}: .*{said}"):
        roslf.load("rigid-scope").replace({place: 1.0})


def test_what_is_handed_out_prints_in_lines_that_a_notebook_shows_too(tmp_path):
    values = [
        roslf.load("cystoscope"), roslf.render("paper", region=(2000, 1300, 20, 20)), roslf.specification("paper"),
        roslf.quantity("sigma_z_mm"), roslf.report("paper"),
    ]  # fmt: skip
    for value in values:
        lines = str(value).splitlines()
        assert 0 < len(lines) < 20
        assert max(map(len, lines)) < 500
        assert hasattr(value, "_repr_html_") or hasattr(value, "_repr_pretty_")
    design = str(values[0])
    assert "d_3            62.84 mm  aperture.distance" in design


def test_distances_are_taken_as_text_and_as_numbers_side_by_side():
    """One list of "300mm" and 350 became text all through, in which 350 had no unit; a quantity takes one, too."""
    result = roslf.evaluate("paper", at=["300mm", 350, 360.0])
    assert [plane.at_mm for plane in result.answer.at[1:]] == [300.0, 350.0, 360.0]
    camera = roslf.Camera.of(roslf.load("paper"))
    there = roslf.quantity("u_z_mm", at="300 mm")(camera)
    assert float(there) == float(roslf.quantity("u_z_mm")(camera, 300.0))
    assert float(there) == pytest.approx(result.answer.at[1].u_z_mm)
    assert float(there) != pytest.approx(result.value("u_z_mm"))


def test_an_evaluation_prints_what_the_command_prints():
    result = roslf.evaluate("paper")
    assert "print(result.everything)" in str(result)
    assert "Temperature" not in str(result)
    assert len(str(result).splitlines()) < 40 < len(result.everything.splitlines())
