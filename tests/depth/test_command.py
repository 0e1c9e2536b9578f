"""`roslf depth`: what it prints and writes, and what it refuses."""

import json

import numpy as np
import pytest
import tifffile

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.depth import geometry
from roslf_design.depth.estimate import DisparityStatus
from roslf_design.depth.pictures import region_about
from roslf_design.reporting.depth.pages import _as_predicted, known
from roslf_design.theory.stop_images import MicrolensImages
from tests.depth.made import fewer_rays

REGION = "2240,1480,110,110"
"""Nine by nine microlenses or so, about the axis of the paper's camera."""
PLAIN_WALL = """
[[objects]]
kind = "plane"
distance = "350 mm"
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory, real_pngs):
    """A folder that the command wrote, and what its JSON says; of two exposures."""
    folder = tmp_path_factory.mktemp("depth")
    with pytest.MonkeyPatch.context() as patch:
        fewer_rays(patch)
        assert main(["depth", "paper", "--region", REGION, "--exposures", "2", "--seed", "3", "-o", str(folder)]) == 0
    return folder, json.loads((folder / "depth.json").read_text(), parse_constant=pytest.fail)


def test_json_tells_points_summary_and_assumptions(written):
    _, data = written
    assert data["schema"] == "roslf.depth/1"
    assert (data["seed"], data["exposures"]) == (3, 2)
    assert {"bias_mm", "spread_mm", "predicted_mm", "inside_68", "measured", "unknown"} <= set(data["summary"])
    assert {"electrons", "contrast", "views", "window", "sigma_disparity_pitches"} <= set(data["assumes"])
    assert 0 < len(data["points"]) <= 2000
    for point in data["points"]:
        parts = {"sigma_noise_mm", "sigma_calibration_mm", "u_mm", "ahead_of_tip_mm"}
        assert set(point) == {"x_ml_mm", "true_mm", "depth_mm", "sigma_mm"} | parts
        assert point["sigma_calibration_mm"] is None
        assert point["u_mm"] == point["sigma_mm"] == point["sigma_noise_mm"]
    # The wall slants through the focal plane; near the axis it is within a millimetre of it.
    assert all(abs(point["true_mm"] - 350) < 1 for point in data["points"])
    off = np.array([(p["depth_mm"] - p["true_mm"]) / p["sigma_mm"] for p in data["points"]])
    assert np.abs(off).max() < 6


def test_maps_agree_with_points(written):
    folder, data = written
    depth, sigma, status = (tifffile.imread(folder / f"{name}.tif") for name in ("depth", "sigma", "status"))
    columns, rows = data["microlenses"]
    assert depth.shape == sigma.shape == status.shape == (rows, columns)
    assert np.isfinite(depth).all()
    assert np.isfinite(sigma).all()
    assert ((depth > 0) == (status == 0)).all()
    assert ((sigma > 0) == (status == 0)).all()
    # Floats of 32 bits; fewer points than would be thinned out.
    for key, drawn in (("depth_mm", depth), ("sigma_mm", sigma)):
        np.testing.assert_allclose([point[key] for point in data["points"]], drawn[status == 0], rtol=1e-6)
    for name in ("depth", "dense"):  # pages count from the tip, and so the file says where that is
        with tifffile.TiffFile(folder / f"{name}.tif") as file:
            assert file.pages[0].description == (
                f"Z from the main lens [mm]; ahead of the tip, as pages count, it is {data['tip_mm']:g} mm less; "
                "0 where unknown"
            )
    assert data["status"]["0"] == DisparityStatus.MEASURED.reason
    assert {str(code) for code in np.unique(status)} <= set(data["status"])


def test_page_asks_and_answers(written):
    folder, _ = written
    page = (folder / "index.html").read_text()
    for question in ("How much of the field", "How far does it scatter", "Is it as predicted", "errors reported"):
        assert question in page
    for name in ("map", "profile", "errors", "epi"):
        assert f'data-testid="picture-depth-{name}"' in page
        assert (folder / f"{name}.png").stat().st_size > 1000
        assert (folder / f"{name}.svg").read_text().startswith("<?xml")


def test_same_seed_same_bytes(written, tmp_path, few_rays):
    folder, _ = written
    again = tmp_path / "again"
    assert main(["depth", "paper", "--region", REGION, "--exposures", "2", "--seed", "3", "-o", str(again)]) == 0
    files, rest = (
        {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}
        for root in (folder, again)
    )
    # The page and nothing else says where it was written.
    page, other = (found.pop("index.html").decode() for found in (files, rest))
    assert page.replace(str(folder), "") == other.replace(str(again), "")
    assert files == rest
    assert "tables/in-numbers.csv" in files


def test_a_wall_without_texture_is_unknown(tmp_path, capsys, few_rays):
    (tmp_path / "wall.toml").write_text(PLAIN_WALL)
    assert main(["depth", "paper", "--region", REGION, "--scene", str(tmp_path / "wall.toml"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert data["points"] == []
    assert data["summary"]["measured"] == 0
    assert data["summary"]["bias_mm"] is None
    assert data["summary"]["unknown"] == {DisparityStatus.NO_TEXTURE.reason: 1.0}
    assert data["assumes"]["texture"] == "the design's, not the scene's"


def test_images_that_overlap_twice_are_called_so(monkeypatch, few_rays):
    """As behind a real lens, where texture and disparity are not fitted together."""
    monkeypatch.setattr(geometry._ArrayViewing, "jointly", lambda *_: None)
    design = roslf.load("paper")
    design = design.replace({"aperture.diameter": 2.2 * design.D_F, "light.exposure": 1e-3})
    trial = roslf.measure_depth(design, region=(2240, 1480, 110, 110))
    assert trial.unknown() == {DisparityStatus.MIXED.reason: 1.0}
    answer = known(trial, trial.summary())
    assert answer.tone == "bad"
    assert "2.2 times as wide as they lie apart, and a pixel has light of 3.8 microlenses" in answer.remedy
    assert "Match the f-number" in answer.remedy


def test_scatter_beyond_the_prediction_that_reported_errors_count_is_said_to_be_theirs():
    part = "errors reported, each by what its own window shows, are 1.31 times that as well"
    assert part in _as_predicted(0.256, 0.191, 0.25)  # paper-singlet's wall
    assert "1.34 times that." in _as_predicted(0.256, 0.191, 0.25)
    for spread, told in ((0.24, 0.25), (0.256, 0.191), (0.4, 0.25)):  # as predicted; reported as predicted; neither
        assert "errors reported" not in _as_predicted(spread, 0.191, told)


def test_a_wrong_belief_shows_as_bias(few_rays):
    region = (2240, 1480, 110, 110)
    design = roslf.load("paper")
    trial = roslf.measure_depth(design, region=region, believed=design.replace(f=101.0))
    right = roslf.measure_depth(design, region=region)
    assert abs(trial.summary().bias_mm) > 5 * abs(right.summary().bias_mm)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--exposures", "0"], "--exposures: 0 is none; give 1 or more"),
        (["--seed", "-1"], "--seed: -1 is negative"),
        (["--region", "0,0,30"], 'cannot read "0,0,30"'),
        (["--region", "0,0,30,30"], "region: fewer than 5 x 5 microlens images"),
        (["--region", "0,0,3,3"], "region: fewer than 5 x 5 microlens images"),
        (["--region", "9000,0,100,100"], "is no part of the sensor"),
        (["--scene", "nowhere.toml"], "nowhere.toml"),
        (["--believed", "papr"], "papr"),
        (["--scene", "lens.toml"], "objects.0"),
        (["--between", "300 mm, 400 mm", "--scene", "x.toml"], "--between: goes with a capture, and this is a design"),
        (["--sigma", "d=1%"], "--sigma: goes with a capture, and this is a design"),
    ],
)
def test_bad_input_is_refused_in_one_line(options, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lens.toml").write_text(PLAIN_WALL.replace("350 mm", "20 mm"))
    assert main(["depth", "paper", "-o", "out", *options]) == 2
    told = capsys.readouterr()
    assert says in told.err
    assert len(told.err.splitlines()) == 1
    assert told.out == ""
    assert not (tmp_path / "out").exists()


def test_an_objective_with_a_mapping_is_refused(tmp_path, capsys):
    lens = {"kind": "lens", "distance": 150.0, "focal_length": 800.0, "mapping": "f theta"}
    path, out = tmp_path / "design.toml", tmp_path / "out"
    path.write_text(roslf.dumps(roslf.load("paper").replace({"elements": [lens]})))
    assert main(["depth", str(path), "-o", str(out)]) == 2
    error = capsys.readouterr().err
    assert "elements.0.mapping: depth is computed for rays as f tan has them" in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.usefixtures("unpredicted")
def test_a_regions_border_is_as_good_as_its_inside():
    """A margin brings its neighbours' light and windows; hexagonal arrays would tell nothing of most of it without."""
    design = roslf.load("paper").replace({"microlens_array.layout": "hexagonal"})
    run = roslf.measure_depth(design, region=(2240, 1480, 90, 90), rays=32).first
    assert run.measured.mean() > 0.9
    inner = run.sigma[1:-1, 1:-1]
    border = np.concatenate([run.sigma[0], run.sigma[-1], run.sigma[1:-1, 0], run.sigma[1:-1, -1]])
    # Texture differs from place to place; half of a window would make it 1.4.
    assert np.median(border) < 1.25 * np.median(inner)


@pytest.mark.usefixtures("unpredicted")
def test_microlenses_out_of_focus_on_the_fap_put_nothing_into_depths():
    """5 % of the rigid scope: 0.87 mm if views were taken to look through the microlenses' middles."""
    design = roslf.load("rigid-scope")
    trial = roslf.measure_depth(design, region=region_about(design, (0.0, 0.0), 9), exposures=4, rays=64)
    assert trial.raw.plan.on("microlens_defocus")
    summary = trial.summary()
    # Of three windows in four exposures: 0.3 of the errors told by chance, and what rays scatter.
    assert abs(summary.bias_mm) < summary.told_mm < 0.3


@pytest.mark.usefixtures("light_from_48_px", "unpredicted")
def test_a_strip_from_the_dark_to_whole_images_is_right_all_along():
    """The light's edge cuts images to nothing within 30 microlenses; errors told hold on both sides."""
    cut = roslf.load("paper").replace({"main_lens.diameter": 24.0})
    trial = roslf.measure_depth(cut, region=(250, 1378, 650, 144), seed=1, rays=32)
    assert trial.unknown().get(DisparityStatus.INCONSISTENT.reason, 0) < 0.02
    scores = (trial.errors / trial.first.sigma)[0]
    kept = MicrolensImages(Camera.of(cut), trial.first.x_ml[5]).shapes.kept_fraction[:, 0]
    for here in ((kept > 0.3) & (kept < 0.95), kept >= 0.95):
        some = trial.compared & here
        assert trial.first.measured[2:-2, here].mean() > 0.9
        # Some five windows of their own, nine where images are cut: the share within is known to a fifth.
        assert 0.4 < (np.abs(scores[some]) < 1).mean() < 0.95
        assert np.abs(scores[some]).max() < 6


@pytest.mark.usefixtures("near_light", "unpredicted")
def test_a_hexagonal_array_whose_images_overlap_has_the_noise_that_is_told():
    """Where two images overlap the white image is twice as bright as elsewhere."""
    wide = {"microlens_array.layout": "hexagonal", "aperture.diameter": 1.3 * roslf.load("paper").D_F}
    design = roslf.load("paper").replace(wide)
    run = roslf.measure_depth(design, region=(2240, 1480, 90, 90), rays=32).first
    # Interpolated samples have less noise than pixels; with brightness told twice as large it was 1.5.
    assert np.median(run.disparities.chi2) < 1
