"""`roslf depth` on pictures that a camera took: against simulation, truth, other ways to the same; what it refuses."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import tifffile
from PIL import Image

import roslf_design as roslf
from roslf_design.calibration.decoding import decode
from roslf_design.calibration.lattice import CentreLattice
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.depth.captured import on_array
from roslf_design.depth.geometry import ArrayGeometry
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import PictureOptions, lattice_of
from roslf_design.depth.unmixing import ViewLight
from roslf_design.depth.view_files import pfm_bytes, view_files
from roslf_design.effects.waves import add_noise
from roslf_design.imaging.camera import Region
from roslf_design.imaging.files import write_image
from roslf_design.imaging.render import render
from roslf_design.scenes import make_scene
from roslf_design.theory.length_covariance import LengthCovariance
from roslf_design.theory.photometry import dark_variance

REGION = Region(2200, 1440, 200, 200)
"""15 x 15 microlenses about the axis of the paper's camera."""
SIGMA = 0.1
"""Of f, in a calibration that knows A and m well, and so d_1 and d_3 but for f [mm]."""
WALL = {"kind": "plane", "distance": 342.0, "tilt": (0.0, 0.1)}
TEXTURE = {"kind": "noise", "finest": 0.4, "contrast": 0.1, "seed": 1}


@pytest.fixture(scope="module")
def design():
    return roslf.load("paper")


@pytest.fixture(scope="module")
def trial(design):
    """What the simulation measures of its first exposure."""
    scene = make_scene({"objects": [WALL | {"texture": TEXTURE}]})
    return simulate(design, scene, PictureOptions(region=REGION, seed=3, rays=128))


@pytest.fixture(scope="module")
def folder(design, trial, tmp_path_factory):
    """The same exposure with its margin as files: raw.tif, white.tif, counts.tif as a sensor of 12 bits stores them."""
    place = tmp_path_factory.mktemp("captured")
    white = render(design, None, effects=trial.raw.plan, region=trial.raw.region)
    full = trial.electrons * float(white.pixels.sum() / trial.raw.pixels.sum())
    dark = math.sqrt(float(dark_variance(Camera.of(design))))
    generator = np.random.default_rng(3).spawn(1)[0]
    taken = np.minimum(add_noise(trial.raw.pixels, full, dark, generator), np.float32(design.sensor.full_well / full))
    write_image(replace(trial.raw, pixels=taken), place / "raw.tif")
    write_image(white, place / "white.tif")
    counts = np.clip(np.rint(taken * full / design.sensor.full_well * 4095), 0, 4095)
    tifffile.imwrite(place / "counts.tif", counts.astype(np.uint16))
    calibrated(place / "calibration", design, SIGMA)
    return place


def with_f(design, f):
    """The same with another f, and with d_1 and d_3 as a calibration has them from A and m (Eqs. 10 and 12)."""
    camera = Camera.of(design)
    A, m = float(camera.A), float(camera.m)
    return design.replace(f=f, d_1=f * (1 + m), d_3=f + (f - A) / m)


def calibrated(folder, design, sigma, /, **changes):
    """A calibration's folder: exact but for f, and what follows from it."""
    folder.mkdir()
    other = with_f(design, design.f + sigma)
    off = np.array([getattr(other, name) - getattr(design, name) for name in ("f", "d_1", "d_3")])
    quantity = {"unit": "mm", "sigma": sigma, "interval_68": [0, 1], "interval_95": [0, 1], "variance_shares": {}}
    data = {
        "schema": "roslf.calibration/1", "design": design.name,
        "quantities": {name: {"estimate": 1.0, **quantity} for name in ("H", "d_3")},
        "covariance": {
            "places": ["main_lens.focal_length", "microlens_array.distance", "aperture.distance"],
            "matrix": np.outer(off, off).tolist(),
        },
    }  # fmt: skip
    (folder / "calibration.json").write_text(json.dumps(data | changes))
    roslf.save(design.replace({"name": f"{design.name}, calibrated"}), folder / "calibrated.toml")


@pytest.fixture(scope="module")
def measured(folder):
    return roslf.capture_depth(
        folder / "raw.tif", white=folder / "white.tif", design="paper", calibration=folder / "calibration"
    )


@pytest.fixture(scope="module")
def part(measured, trial):
    """Rows and columns of the capture that the simulation tells."""
    ends = []
    for axis in ("v", "u"):
        all_, some = getattr(measured.first.field, axis), getattr(trial.first.field, axis)
        first = int(np.flatnonzero(all_ == some[0])[0])
        ends.append(slice(first, first + len(some)))
    return tuple(ends)


def test_a_capture_and_the_simulation_of_it_agree(measured, trial, part):
    run, simulated = measured.first.within(*part), trial.first
    np.testing.assert_allclose(run.x_ml, simulated.x_ml, atol=1e-12)
    assert run.measured.mean() > 0.9
    both = run.measured & trial.compared
    # Another range is searched, and the noise known by the mean of the picture: far below the noise itself.
    assert np.sqrt(np.mean((run.depth - simulated.depth)[both] ** 2)) < 0.1 * np.median(simulated.sigma)
    # A few windows are others, where two fit alike.
    assert np.isclose(run.noise_sigma, simulated.sigma, rtol=0.05)[both].mean() > 0.97
    off = ((run.depth - trial.true) / run.noise_sigma)[both]
    # Up to 1.3 by what the estimator promises; of nine windows without common microlenses, to 2/sqrt(18) of it.
    assert 0.5 < np.sqrt(np.mean(off**2)) < 1.3 * (1 + 2 / math.sqrt(18))


def test_counts_of_the_sensor_tell_the_same_noise(folder, measured, trial):
    found = roslf.capture_depth(
        folder / "counts.tif", white=folder / "white.tif", design="paper", region=trial.raw.region
    )
    assert "4095 counts" in found.noise.source
    # The scene of this region is as bright as on average to a few per cent.
    assert found.noise.pixel.electrons == pytest.approx(measured.noise.pixel.electrons, rel=0.03)
    both = found.first.measured & measured.first.measured
    # A step of 2.6 electrons beside noise of 70.
    assert np.median(np.abs(found.first.depth - measured.first.depth)[both]) < 0.02


def test_views_that_decode_writes_give_the_same_depths(folder, design, measured, tmp_path):
    field = roslf.decode(folder / "raw.tif", folder / "white.tif", design="paper").field
    for name, content in view_files(field).items():
        (tmp_path / name).write_bytes(content)
    found = roslf.capture_depth(tmp_path, design="paper")
    both = found.first.measured & measured.first.measured
    assert both.mean() > 0.85
    # Without the white image's light every view weighs alike: half a standard error.
    assert np.abs(found.first.depth - measured.first.depth)[both].mean() < 0.5 * np.median(measured.first.sigma)


def test_a_wrong_calibration_moves_depths_by_what_it_tells(folder, design, measured, part, tmp_path):
    told = measured.first.calibration_sigma
    calibrated(tmp_path / "wrong", with_f(design, design.f + SIGMA), 0.0, design=design.name)
    wrong = roslf.capture_depth(folder / "raw.tif", white=folder / "white.tif", calibration=tmp_path / "wrong")
    both = wrong.first.measured & measured.first.measured
    moved = np.abs(wrong.first.depth - measured.first.depth)
    inner = np.zeros_like(both)
    inner[part] = both[part]
    # d_3 is off by (1 + 1/m) as much as f, and so are distances from the lens; a hundredth for second orders.
    assert np.median(told) == pytest.approx(SIGMA * (1 + 1 / 0.4), rel=0.05)
    assert np.median(np.abs(moved / told - 1)[inner]) < 0.01
    np.testing.assert_allclose(measured.first.sigma[both], np.hypot(told, measured.first.noise_sigma)[both])
    assert (wrong.first.calibration_sigma[both] == 0).all()


def test_a_length_known_to_some_error_counts(folder, measured, part):
    """The FAP's diameter: depth measured for one that is as much smaller moves the other way, by as much."""
    files = {"white": folder / "white.tif", "design": "paper"}
    found = roslf.capture_depth(folder / "raw.tif", sigma={"aperture.diameter": "1%"}, **files).first.within(*part)
    told = np.median(found.calibration_sigma[found.measured])
    np.testing.assert_allclose(found.sigma, np.hypot(found.noise_sigma, np.nan_to_num(found.calibration_sigma)))
    smaller = roslf.load("paper").replace({"aperture.diameter": 2.9 * 0.99})
    other = roslf.capture_depth(folder / "raw.tif", white=files["white"], design=smaller_file(folder, smaller))
    moved = (other.first.depth - measured.first.depth)[part][found.measured]
    assert told == pytest.approx(np.sqrt(np.nanmean(moved**2)), rel=0.2)


def smaller_file(folder, design):
    path = folder / "smaller.toml"
    roslf.save(design, path)
    return path


@pytest.mark.parametrize("changes", [{}, {"sensor.relay_magnification": 0.8}, {"object_space.medium": "water"}])
def test_calibration_error_against_eq_12_solved_for_each_draw(design, changes):
    """Depths of many cameras drawn from a covariance, of what has one slope: their scatter."""
    rng = np.random.default_rng(0)
    if "object_space.medium" in changes:
        window = {"kind": "plate", "distance": 130.0, "thickness": 1.0, "material": "sapphire"}
        changes = changes | {"elements": [window]}
    camera = design.replace(changes, d_1=design.d_1)
    mixing = rng.normal(size=(4, 4))
    scale = np.diag([0.05, 0.1, 0.004, 0.04])
    places = ("aperture.distance", "microlens_array.distance", "sensor.distance", "main_lens.focal_length")
    covariance = scale @ mixing @ mixing.T @ scale
    z = np.array([camera.d_f - 60, camera.d_f - 10, camera.d_f + 25])
    told = ArrayGeometry(camera, LengthCovariance(places, covariance)).calibration_sigma(z)
    best = Camera.of(camera)
    slope = (best.seen.m - best.seen.A / (best.plane(z).distance - best.d_3)) * best.seen.A / best.d_2
    draws = rng.multivariate_normal([float(best[place]) for place in places], covariance, 4000)
    depths = []
    for draw in draws[:800]:
        one = Camera.of(camera, dict(zip(places, draw, strict=True)))
        seen = one.seen.A / (one.seen.m - slope * one.d_2 / one.seen.A) + one.d_3
        depths.append([float(one.plane_seen_at(at)) for at in seen])
    # 800 draws tell a standard deviation to 2.5 %; three of those, and what is not of first order.
    np.testing.assert_allclose(told, np.std(depths, axis=0), rtol=0.09)


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_microlenses_count_from_the_arrays_middle(design, layout):
    """However the lattice of a picture was numbered."""
    camera = Camera.of(design.replace({"microlens_array.layout": layout}))
    lattice = lattice_of(camera, REGION)
    picture = np.random.default_rng(1).uniform(1, 2, (REGION.rows, REGION.columns)).astype(np.float32)
    field = decode(picture, lattice)
    other = CentreLattice(tuple(lattice.nodes(3, -2)), lattice.first, lattice.second, layout)
    found = on_array(decode(picture, other), other, camera, REGION)
    np.testing.assert_allclose(found.v, field.v, atol=1e-9)
    if layout == "hexagonal":  # made square at other places of its rows
        np.testing.assert_allclose(found.hexagonal.starts, field.hexagonal.starts, atol=1e-9)
        assert ((found.view_weight() > 0).mean(axis=0)[[0, -1]] > 0.7).all()
    else:
        np.testing.assert_allclose(found.u, field.u, atol=1e-9)


def test_without_a_white_image_vignetting_is_the_designs(folder, design, trial):
    camera = Camera.of(design)
    lattice = lattice_of(camera, trial.raw.region)
    raw, white = (tifffile.imread(folder / f"{name}.tif") for name in ("raw", "white"))
    with_white, without = decode(raw, lattice, white=white), ViewLight(camera, decode(raw, lattice)).flat_fielded()
    np.testing.assert_array_equal(without.weight > 0, with_white.weight > 0)
    both = (with_white.weight > 0.3) & (without.weight > 0)
    ratio = without.values[both] / with_white.values[both]
    # Interpolation blurs a white image by up to a few per cent, which a formula does not know of.
    assert np.std(ratio / np.median(ratio)) < 0.02


# --- decoded views ----------------------------------------------------------------------------------------------------

PARAMETERS = """
[intrinsics]
focal_length_mm = 100.0
image_resolution_x_px = 48
image_resolution_y_px = 40
sensor_size_mm = 35.0
[extrinsics]
num_cams_x = 5
baseline_mm = 5.0
focus_distance_m = 0.8
"""


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    """A slanted plane as 5 x 5 views of 8 bits, noise 2 of 255, with its disparities; part of the map is unknown.

    Over twenty draws the mean of its 38 windows is off by 0.17 (rms) of the errors reported, by 0.04 on average.
    """
    place, rng = tmp_path_factory.mktemp("views"), np.random.default_rng(5)
    waves = rng.uniform(-0.6, 0.6, (30, 3)) * (1, 1, 10)
    y, x = np.mgrid[:40, :48].astype(float)
    for number in range(25):
        t, s = divmod(number, 5)
        at_x, at_y = x, y
        for _ in range(40):  # where on the middle view's picture it is that this one sees
            b = slant(at_x)
            at_x, at_y = x + b * (s - 2), y + b * (t - 2)
        shades = 120 + sum(10 * np.sin(a * at_x + b * at_y + c) for a, b, c in waves) + rng.normal(0, 2, x.shape)
        Image.fromarray(np.clip(np.rint(shades), 0, 255).astype(np.uint8)).save(place / f"input_Cam{number:03d}.png")
    (place / "parameters.cfg").write_text(PARAMETERS)
    true = slant(x)
    true[:4, :4] = np.nan
    (place / "gt_disp_lowres.pfm").write_bytes(pfm_bytes(true))
    return place


def slant(x):
    """Disparity from view to view [px]."""
    return 0.3 + 0.02 * (x - 23.5)


def test_views_of_the_4d_benchmark_against_their_truth(views, tmp_path, capsys):
    assert main(["depth", str(views), "-o", str(tmp_path / "out"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert (data["kind"], data["design"], data["truth"]) == ("views", "parameters.cfg", "gt_disp_lowres.pfm")
    summary = data["summary"]
    assert summary["measured"] > 0.95
    assert abs(summary["bias_mm"]) < summary["told_mm"] / 3
    # 38 windows of 7 x 7.
    assert 0.53 < summary["inside_68"] < 0.83
    focal = 100 / 35 * 48
    for point in data["points"][::100]:
        column, row = point["pixel"]
        away = 1 / (1 / 800 + slant(column) / (5 * focal))
        assert abs(point["depth_mm"] - away) < 6 * point["sigma_mm"]
        assert point["true_mm"] == (None if max(column, row) < 4 else pytest.approx(away, rel=1e-5))
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"map.png", "errors.png", "epi.svg", "index.html"}


def test_views_of_unknown_cameras_have_disparities_and_no_depths(views, tmp_path, capsys):
    for path in views.glob("input_*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert main(["depth", str(tmp_path), "--truth", str(views / "gt_disp_lowres.pfm"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert data["unit"] == "px"
    assert abs(data["summary"]["bias_px"]) < 0.002
    assert data["summary"]["bias_mm"] is None
    for point in data["points"][::200]:
        assert (point["depth_mm"], point["sigma_mm"], point["true_mm"]) == (None, None, None)
        assert abs(point["disparity_px"] - slant(point["pixel"][0])) < 6 * point["sigma_disparity_px"]


def test_views_without_texture_are_unknown(tmp_path, capsys):
    for number in range(9):
        Image.fromarray(np.full((20, 20), 100, np.uint8)).save(tmp_path / f"view_{number // 3}_{number % 3}.png")
    assert main(["depth", str(tmp_path), "--json"]) == 0
    data = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert data["points"] == []
    assert data["summary"]["measured"] == 0


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def spoilt(folder, views, tmp_path, monkeypatch, design):
    """Files of every kind that cannot be used, in the working folder."""
    monkeypatch.chdir(tmp_path)
    raw = tifffile.imread(folder / "raw.tif")
    for name in ("raw.tif", "white.tif", "counts.tif"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    tifffile.imwrite("narrow.tif", tifffile.imread(folder / "white.tif")[:, :150])
    tifffile.imwrite("black.tif", np.zeros_like(raw))
    tifffile.imwrite("full.tif", np.full(raw.shape, 255, np.uint8))
    (tmp_path / "one").mkdir()
    (tmp_path / "one/view_0_0.png").write_bytes((views / "input_Cam000.png").read_bytes())
    (tmp_path / "unequal").mkdir()
    for number, size in enumerate([(20, 20), (20, 24)]):
        Image.fromarray(np.zeros(size, np.uint8)).save(tmp_path / f"unequal/view_0_{number}.png")
    (tmp_path / "dark").mkdir()
    for number in range(2):
        Image.fromarray(np.zeros((20, 20), np.uint8)).save(tmp_path / f"dark/view_0_{number}.png")
    (tmp_path / "views").symlink_to(views)
    (tmp_path / "nan.pfm").write_bytes(pfm_bytes(np.full((40, 48), np.nan)))
    (tmp_path / "small.pfm").write_bytes(pfm_bytes(np.zeros((4, 5))))
    calibrated(tmp_path / "other", design.replace({"name": "another camera"}), 0.1)
    calibrated(tmp_path / "old", design, 0.1, covariance=None)
    calibrated(tmp_path / "broken", design, 0.1, covariance={"places": ["aperture.distance"], "matrix": [[-1.0]]})
    calibrated(tmp_path / "strange", design, 0.1, covariance={"places": ["elements.7.index"], "matrix": [[1.0]]})
    return tmp_path


WHITE = ["--white", "white.tif"]
PAPER = ["--design", "paper", *WHITE]
PART = ["--region", "2156,1396,288,288"]
"""With the margin of three microlenses, and what views of the wall's disparities look past them."""


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["raw.tif", *WHITE], "--design: is missing; name the camera that took raw.tif"),
        (["absent.tif", *PAPER], "absent.tif: no such file"),
        (["raw.tif", "--design", "papr"], "papr"),
        (["counts.tif", *PAPER], "counts.tif: has 288 x 288 px, and the design's sensor has 4600 x 3080"),
        (["raw.tif", *PAPER, "--region", "0,0,100,100"], "--region says 100 x 100; say which part"),
        (["raw.tif", *PAPER, "--region", "4590,0,200,200"], "is no part of the sensor"),
        (["raw.tif", "--design", "paper", "--white", "narrow.tif"], "narrow.tif differ in size"),
        (["raw.tif", "--design", "paper", "--white", "black.tif"], "raw.tif"),
        (["black.tif", *PAPER, *PART], "black.tif: is black; expose more"),
        (["full.tif", *PAPER, *PART], "is saturated: 100 % of its pixels"),
        (["raw.tif", "--design", "rigid-scope", *WHITE], "--design: microlens images of raw.tif are 12.94 px apart"),
        (["raw.tif", *PAPER, "--calibration", "other"], 'other is of "another camera"'),
        (["raw.tif", *WHITE, "--calibration", "old"], "does not state how its lengths err together"),
        (["raw.tif", *WHITE, "--calibration", "broken"], "not symmetric, or below 0"),
        (["raw.tif", *WHITE, "--calibration", "strange"], "elements.7.index is no length of"),
        (["raw.tif", *WHITE, "--calibration", "nowhere"], "nowhere"),
        (["raw.tif", *PAPER, "--sigma", "aperture.diameter"], 'cannot read "aperture.diameter"'),
        (["raw.tif", *PAPER, "--sigma", "aperture.width=1%"], "aperture.width is no length of"),
        (["raw.tif", *PAPER, "--sigma", "aperture.diameter=40%"], "give more than 0 and 20% at most"),
        (["raw.tif", *PAPER, "--sigma", "aperture.diameter=1 kg"], "aperture.diameter: "),
        (["raw.tif", *PAPER, "--seed", "1", "--scene", "a.toml"], "--scene: goes with a design"),
        (["raw.tif", *PAPER, "--truth", "nan.pfm"], "--truth: goes with decoded views"),
        (["raw.tif", *PAPER, "--window", "4"], "--window: 4 is no window; give an odd number"),
        (["raw.tif", *PAPER, "--between", "300 mm"], '--between: "300 mm" is no pair of distances'),
        (["raw.tif", *PAPER, "--between", "30 mm, 300 mm"], "--between: 30 mm lies where the camera sees nothing"),
        (["raw.tif", *PAPER, "--between", "a, b"], "give two distances"),
        (["paper", *WHITE], "--white: goes with a capture, and this is a design"),
        (["one"], "one: holds 1 view; depth needs two or more"),
        (["unequal"], "view_0_1.png has 24 x 20 px and view_0_0.png 20 x 20 px"),
        (["dark"], "dark: all views are black"),
        (["views", "--truth", "nan.pfm"], "nan.pfm: has no disparity that is a finite number"),
        (["views", "--truth", "small.pfm"], "small.pfm: has 5 x 4 disparities, and the views 48 x 40 pixels"),
        (["views", *WHITE], "--white: goes with a raw image, and these are views"),
        (["unequal", "--between", "1 m, 2 m"], "unequal"),
    ],
)
def test_bad_input_is_refused_in_one_line(spoilt, capsys, arguments, says):
    assert main(["depth", *arguments, "-o", "out"]) == 2
    told = capsys.readouterr()
    assert says in told.err
    assert len(told.err.splitlines()) == (2 if "--seed" in arguments else 1)
    assert told.out == ""
    assert not (spoilt / "out").exists()
