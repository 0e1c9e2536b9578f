"""Commands on focused cameras: what means something is answered, the rest refused in a line with its remedy."""

import json

import numpy as np
import pytest
import tifffile

import roslf_design as roslf
from roslf_design.calibration.options import PlanOptions, calibration_plan
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.errors import InputError
from roslf_design.evaluation import doubts
from roslf_design.explorer.view import glance, lights
from roslf_design.optimization.study import read_study
from roslf_design.reporting.design.pages import parameter_rows
from roslf_design.reporting.sheet.lines import basis, datasheet_json
from roslf_design.theory.quantities import QUANTITIES
from tests.theory.test_focused import KEPLER, RAYTRIX

VIEWS = {quantity.name for quantity in QUANTITIES.values() if quantity.of_views}


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    roslf.save(KEPLER, "kepler.toml")
    roslf.save(RAYTRIX, "raytrix.toml")


STUDY = 'name = "x"\ndesign = "kepler.toml"\ntrials = 64\ngrade = "precision"\n[[goals]]\nmetric = "{}"\nmax = 2\n'
SEARCH = """
name = "x"
design = "kepler.toml"
[variables.{symbol}]
min = "{low} mm"
max = "{high} mm"
[[constraints]]
quantity = "fill_factor"
max = 1.0
[[goals]]
quantity = "{quantity}"
{at}
direction = "min"
"""


@pytest.mark.parametrize("design", ["kepler.toml", "raytrix.toml"])
@pytest.mark.parametrize(
    "arguments",
    [
        ["depth", "DESIGN"],
        ["decode", "raw.tif", "--design", "DESIGN", "-o", "out"],
        ["depth", "raw.tif", "--design", "DESIGN", "-o", "out"],
        ["calibrate", "--plan", "DESIGN"],
        ["sweep", "DESIGN", "--set", "d_3=0..1 mm", "--quantity", "fill_factor,sigma_z_mm", "-o", "x.csv"],
        ["tolerance", "study.toml", "-o", "out"],
        ["optimize", "search.toml", "-o", "out"],
    ],
    ids=lambda arguments: " ".join(arguments[:2]),
)
def test_what_takes_pixels_for_views_is_refused_in_a_line(arguments, design, tmp_path, capsys):
    (tmp_path / "study.toml").write_text(STUDY.format("sigma_z_mm").replace("kepler.toml", design))
    search = SEARCH.format(symbol="D_F", low=0.5, high=1.0, quantity="u_z_mm", at="")
    (tmp_path / "search.toml").write_text(search.replace("kepler.toml", design))
    tifffile.imwrite("raw.tif", np.ones((40, 40), np.uint16))
    assert main([design if argument == "DESIGN" else argument for argument in arguments]) == 2
    out, error = capsys.readouterr()
    assert not out
    (line,) = error.splitlines()
    key = "microlens_array.focal_lengths:" if design == "raytrix.toml" else "microlens_array.focal_length:"
    assert key in line
    assert "does not focus the microlenses" in line
    assert "would image the pupil" in line
    assert not (tmp_path / "out").exists()


def test_what_holds_of_focused_cameras_is_answered(capsys):
    names = "fill_factor,virtual_depth,microlens_blur_px,seen_by,resolution_ratio"
    swept = ["--set", "d_2=0.09..0.11 mm", "--points", "3", "--at", "96 mm", "--quantity", names]
    assert not main(["sweep", "kepler.toml", *swept, "-o", "x.csv"])
    with open("x.csv") as file:
        assert np.isfinite([float(value) for value in file.read().splitlines()[2].split(",")]).all()
    assert not main(["render", "kepler.toml", "--region", "1600,1200,60,60", "-o", "white.tif"])
    assert tifffile.imread("white.tif").max() > 0
    refocused = KEPLER.replace(f_ml=0.0972)  # what the refusal proposes
    assert not any(verdict.name == "pupil_imaged" for verdict in roslf.evaluate(refocused).verdicts)
    capsys.readouterr()


def test_several_types_are_drawn_one_after_the_other(capsys):
    assert main(["render", "raytrix.toml", "-o", "white.tif"]) == 2
    assert "focal_lengths" in capsys.readouterr().err


@pytest.mark.parametrize(
    "changes", [{"variables": {"f_ml": {"min": "0.07 mm", "max": "0.12 mm"}}}, {"microlens_in_focus": True}]
)
def test_searches_that_may_bring_the_pupil_into_focus_are_not_refused(changes, tmp_path):
    goal = {"quantity": "sigma_z_mm", "direction": "min"}
    asked = {"name": "x", "variables": {"D_F": {"min": "0.5 mm", "max": "1 mm"}}, "goals": [goal]}
    assert read_study({**asked, **changes}, tmp_path, design=KEPLER).problem.design == KEPLER
    with pytest.raises(InputError, match="there is no sigma_z_mm"):
        read_study(asked, tmp_path, design=KEPLER)


@pytest.mark.parametrize("design", [KEPLER, RAYTRIX])
def test_evaluations_tell_what_the_microlenses_are_focused_on_and_nothing_of_views(design, monkeypatch):
    monkeypatch.setattr(
        doubts, "share_full", lambda *_, **more: (0.0, 0.0)
    )  # which nothing here asks, of images of many pixels
    result = roslf.evaluate(design)
    first, *others = result.verdicts
    assert (first.name, first.level, first.ok) == ("pupil_imaged", "limit", False)
    fast = {"microlens_speed"} if design.f_ml < 3 * design.d else set()
    assert {verdict.name for verdict in others} == {"f_number_matched", "field_undistorted", "corner_lit"} | fast
    data = json.loads(json.dumps(result.to_dict()))
    for quantity in QUANTITIES.values():
        if quantity.evaluated is not None and quantity.evaluated.under in ("sampling", "depth"):
            group = data[quantity.evaluated.under]
            value = group[quantity.evaluated.key or quantity.name]
            assert (value is None) == quantity.of_views
    assert data["depth"]["expected"] is None
    assert len(data["focused"]["in_focus"]) == len(design.microlens_array.types)
    printed = result.everything
    assert "Focused microlenses" in printed
    assert "Depth" not in printed
    assert "independent views" not in printed
    assert [light["level"] for light in lights(result)] == [verdict.level for verdict in result.verdicts]
    labels = [row["label"] for row in glance(result) if row["label"] != "field of view"]
    assert not any("view" in label or "depth" in label for label in labels)
    words = design.microlens_array.focal_words
    assert len(design.microlens_array.types) == 1 or words in str(parameter_rows(design))


def test_data_sheets_have_no_line_on_views():
    sheet = datasheet_json(basis(KEPLER))
    lines, specified = sheet["lines"], sheet["specification"]
    assert not VIEWS & {line["quantity"] for line in lines}
    assert not {"Depth, expected", "Resolution", "Distances"} & {line["subject"] for line in lines}
    assert {"Field of view", "Body"} <= {line["subject"] for line in lines}
    assert specified["depth_precision"] is specified["resolution"] is specified["working_range_mm"] is None
    assert specified["object_samples"] is None
    assert specified["field"]
    assert specified["focused"]["in_focus"][0]["virtual_depth"] == pytest.approx(3.0)


def test_evaluations_of_others_have_no_word_of_it():
    data = roslf.evaluate("paper").to_dict()
    assert "focused" not in data
    assert "focused" not in roslf.specification("paper").to_dict()
    assert data["depth"]["sigma_z_mm"] > 0


def test_microlenses_that_image_neither_pupil_nor_scene_are_out_of_focus():
    """The main lens images nothing nearer to itself than its focus, 3.99 d_2 before the array; v is 5."""
    assert roslf.quantity("virtual_depth")(Camera.of(KEPLER), 1e6) == pytest.approx(3.99, rel=1e-3)
    verdict = roslf.evaluate(KEPLER.replace(f_ml=0.1 / 1.2, wavelength=500e-6)).verdicts[0]
    assert (verdict.name, verdict.level) == ("pupil_imaged", "fault")
    assert "image nothing ahead of the tip" in verdict.text


def test_plans_say_why_there_are_none():
    with pytest.raises(InputError, match="there is no calibration of views"):
        calibration_plan(KEPLER, PlanOptions.of(board="4x5 6 mm"))
