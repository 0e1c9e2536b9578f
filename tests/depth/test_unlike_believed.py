"""Pictures that are not as believed: other noise, overexposed, views in another order, beyond the search."""

import functools
import itertools
import math

import numpy as np
import pytest
from PIL import Image

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.depth.captured import CaptureNoise, disagreement, measured_with_noise
from roslf_design.depth.estimate import DisparityStatus, PixelNoise
from roslf_design.depth.from_files import CaptureOptions, captured
from roslf_design.depth.geometry import GridGeometry, depth_of
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import PictureOptions, default_scene
from roslf_design.depth.view_files import view_files
from roslf_design.depth.view_order import AS_NAMED, ORDERS, in_order
from roslf_design.reporting.depth.pages import statements
from roslf_design.scenes import make_scene
from roslf_design.scenes.scene import chief_ray_limits
from roslf_design.theory.depth_error import seen_at
from roslf_design.theory.disparity_error import axial_disparity_sigma
from roslf_design.theory.light import object_scale
from roslf_design.theory.photometry import exposure
from roslf_design.traced.camera import camera_of, microlenses, sensor_of_pupil
from tests.depth.made import Texture, at_first_sight, exposed, fewer_rays, sharp

ACROSS, SIZE, ELECTRONS, READ = 7, (56, 56), 4000.0, 10.0
SEARCH = (-1.0, 3.0)


def pupil_of(rows, columns):
    """Places of a grid of views as `GridGeometry` has them."""
    t, s = np.meshgrid(np.arange(rows) - (rows - 1) / 2, np.arange(columns) - (columns - 1) / 2, indexing="ij")
    return np.stack([-s, -t]) / max(rows, columns)


def views_of(disparity, rows=ACROSS, columns=ACROSS, seed=3, size=SIZE):
    pupil = pupil_of(rows, columns)
    views = sharp(Texture.of(seed, 0.25), disparity, pupil, np.ones((rows, columns), bool), size)
    return views, np.ones((rows, columns, 1, 1), np.float32)


def believed(times):
    """Noise that is so many times less than that of the picture."""
    return CaptureNoise(PixelNoise(ELECTRONS, READ).times(1 / times), 1.0, "a data sheet")


@pytest.mark.parametrize("times", [0.7, 1.0, 1.3, 1.6, 2.0, 3.0])
def test_noise_unlike_the_sheets_is_measured_and_the_wall_known(times):
    views, light = views_of(1.2)
    field = exposed(views, light, ELECTRONS, READ, 5)
    run, noise = measured_with_noise(GridGeometry(ACROSS), field, believed(times), SEARCH, True)
    inner = (slice(5, -5), slice(5, -5))
    assert run.measured[inner].mean() >= 0.95
    # Of 2,116 microlenses' samples; interpolation leaves some 5 % less than pixels have.
    assert noise.times == pytest.approx(times, rel=0.08) or (times == 1.0 and noise.times == 1.0)
    score = (run.disparities.disparity - 1.2)[inner] / run.disparities.sigma[inner]
    score = score[np.isfinite(score)]
    # 85 windows of 5 x 5 without common microlenses: 68 % to 10 %.
    assert 0.58 < np.mean(np.abs(score) < 1) < 0.8


def test_a_step_in_a_noisy_picture_is_still_a_step():
    columns = np.arange(float(SIZE[1]))
    near, light = views_of(2.5)
    far, _ = views_of(0.0, seed=4)
    pupil = pupil_of(ACROSS, ACROSS)
    # The near half covers, in each view, what lies right of its edge.
    edges = SIZE[1] / 2 + 2.5 * pupil[0]
    views = np.where(columns > edges[..., None, None], near, far)
    run, noise = measured_with_noise(
        GridGeometry(ACROSS), exposed(views, light, ELECTRONS, READ, 6), believed(2.0), (-1.0, 3.5), True
    )
    assert noise.times == pytest.approx(2.0, rel=0.15)
    status = run.disparities.status
    sides = np.concatenate([status[5:-5, 5:20].ravel(), status[5:-5, 36:-5].ravel()])
    assert np.mean(sides == DisparityStatus.MEASURED) > 0.95
    middle = status[5:-5, 25:31]
    assert np.mean(middle == DisparityStatus.INCONSISTENT) > 0.1


def turned(field_values, transposed, rows, columns):
    values = field_values.swapaxes(0, 1) if transposed else field_values
    values = values[::-1] if rows else values
    return values[:, ::-1] if columns else values


@functools.cache
def slanted():
    """Views of a slanted wall, and their light."""
    return views_of(lambda u: 4.0 + 0.01 * u)


@pytest.mark.parametrize(("transposed", "rows", "columns"), list(itertools.product([False, True], repeat=3)))
def test_every_order_of_the_views_is_put_right_but_for_half_a_turn(transposed, rows, columns):
    """Rows and columns swapped, each or both reversed: the eight ways to name a grid."""
    views, light = slanted()
    values = turned(views, transposed, rows, columns)
    field = exposed(values, light, ELECTRONS, READ, 7)
    ordered = in_order(field, functools.partial(disagreement, across=ACROSS))
    right = exposed(views, light, ELECTRONS, READ, 7).values
    apart = [np.abs(ordered.field.values - one).mean() for one in (right, right[::-1, ::-1])]
    # Same noise in other places: two pictures of the same differ by 1.1 sigma of it on average, of others by more.
    assert min(apart) < 1.5 * np.sqrt(0.4 / ELECTRONS)
    assert (ordered.order == AS_NAMED) == (not transposed and rows == columns)
    assert bool(ordered.warning) == (ordered.order != AS_NAMED)


def test_views_that_do_not_differ_stay_as_named():
    views, light = views_of(0.0)
    ordered = in_order(exposed(views, light, ELECTRONS, READ, 8), functools.partial(disagreement, across=ACROSS))
    assert ordered.order == AS_NAMED


def test_orders_undo_themselves():
    views, light = views_of(2.0, rows=5, columns=7)
    field = exposed(views, light, ELECTRONS, READ, 9)
    for order in ORDERS[:3]:
        again = order.of(order.of(field))
        np.testing.assert_array_equal(again.values, field.values)
        np.testing.assert_array_equal(again.s, field.s)


@pytest.fixture(scope="module")
def lytro(shared_data, tmp_path_factory):
    """Of the middle quarter of real views, the middle 7 x 7 of them, what `told` has."""
    folder, place = shared_data / "lytro-views", tmp_path_factory.mktemp("lytro")
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    for path in folder.glob("*_0[2-8]_0[2-8].png"):
        Image.open(path).crop((64, 64, 192, 192)).save(place / path.name)
    return told(place)


def test_real_views_named_by_column_and_row_are_known(lytro):
    measured, _ = lytro
    assert measured.summary().measured > 0.9
    assert any("rows and columns of views are swapped" in warning for warning in measured.warnings)


def test_the_search_is_widened_where_the_scene_goes_on():
    views, light = views_of(lambda u: 1.0 + 0.08 * u)
    field = exposed(views, light, ELECTRONS, READ, 10)
    noise = believed(1.0)
    narrow, _ = measured_with_noise(GridGeometry(ACROSS), field, noise, (0.5, 2.0), True)
    wide, _ = measured_with_noise(GridGeometry(ACROSS), field, noise, (0.5, 2.0), False)
    assert narrow.measured.mean() < 0.6
    assert narrow.disparities.outside[1] > 0.1
    inner = wide.measured[6:-6, 6:-12]
    assert inner.mean() > 0.95
    assert wide.disparities.search[0] == 0.5  # nothing is nearer to that end


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Nine views of a wall at 0.3 px from view to view."""
    place = tmp_path_factory.mktemp("views")
    views, light = views_of(0.9, rows=3, columns=3, size=(32, 32))
    for name, content in view_files(exposed(views, light, ELECTRONS, READ, 11)).items():
        (place / name).write_bytes(content)
    return place


def test_between_takes_disparities_also_negative(folder):
    measured = roslf.capture_depth(folder, between="-2,2")
    assert measured.first.disparities.search == (-6.0, 6.0)
    assert np.median(measured.first.depth[measured.first.measured]) == pytest.approx(0.3, abs=0.01)
    assert roslf.capture_depth(folder, between="-2 px, 2px").first.disparities.search == (-6.0, 6.0)


def test_between_that_misses_the_scene_says_where_else_to_look(folder, capsys):
    assert main(["depth", str(folder), "--between=-2,-1"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "beyond the disparities searched. Search elsewhere: --between takes disparities" in said


@pytest.mark.parametrize("text", ["1", "1,1", "1,2,3", "nan,2", "1,x", "300 mm, 400 mm"])
def test_between_that_is_no_range_is_refused(folder, tmp_path, text, capsys):
    assert main(["depth", str(folder), f"--between={text}", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "--between" in error
    assert error.count("\n") <= 2


def test_disparities_of_a_benchmark_are_searched(folder, tmp_path):
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    numbers = {
        "intrinsics": {"focal_length_mm": 100, "sensor_size_mm": 35} | {f"image_resolution_{a}_px": 32 for a in "xy"},
        "extrinsics": {"num_cams_x": 3, "baseline_mm": 50, "focus_distance_m": 8},
        "meta": {"disp_min": -0.5, "disp_max": 1.5},
    }
    lines = [
        line for section, keys in numbers.items() for line in (f"[{section}]", *(f"{k} = {v}" for k, v in keys.items()))
    ]
    (tmp_path / "parameters.cfg").write_text("\n".join(lines))
    low, high = roslf.capture_depth(tmp_path).first.disparities.search
    assert low < 3 * -0.5 < 3 * 1.5 < high < 3 * 2.5


@pytest.mark.parametrize("times", [2.2, 4.0])
def test_overexposed_pictures_are_saturated_not_occluded(times):
    design = roslf.load("paper")
    longer = design.replace({"light.exposure": times * float(exposure(Camera.of(design)))})
    with pytest.MonkeyPatch.context() as patch:
        fewer_rays(patch)
        trial = simulate(longer, options=PictureOptions(region=(2240, 1480, 110, 110)))
    assert trial.saturated > 0.3
    assert trial.brightest > 1
    assert trial.unknown()[DisparityStatus.SATURATED.reason] > 0.8
    assert sum(trial.unknown().values()) == pytest.approx(trial.unknown()[DisparityStatus.SATURATED.reason], abs=0.02)
    assert not any("neither light nor texture" in line.text for line in statements(trial))
    (told,) = (line.text for line in statements(trial) if line.text.startswith("Is the exposure right?"))
    assert "of the part looked at, exposed to its own mean" in told


def walls(name):
    """The default wall of a camera, the slope of its outermost chief ray and its distance from the FAP."""
    design = roslf.load(name)
    plane = default_scene(design).objects[0]
    return math.tan(plane.tilt[1]), abs(chief_ray_limits(design)[0]), design.d_f - design.d_3


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "ear-speculum", "video-otoscope", "cystoscope"])
def test_the_default_wall_shows_no_texture_finer_than_two_microlenses(name):
    """Own chief rays, evenly apart in slope, cut with the wall; its finest detail is 2.5 frontal steps."""
    slope, sight, gap = walls(name)
    assert slope > 0.02
    tangents = np.linspace(-sight, sight, 2001)
    x = tangents * gap / (1 - slope * tangents)
    steps = np.hypot(np.diff(x), slope * np.diff(x)) / (gap * np.diff(tangents))
    assert 2.5 / steps.max() >= 2.0


@pytest.mark.parametrize("name", ["paper-singlet", "grin-needle"])
def test_a_real_lens_sees_the_default_texture_on_a_wall_that_faces_it(name):
    """Rays from the FAP's middle to neighbouring microlenses, half a step to either side of corners and rims."""
    design = roslf.load(name)
    lens, finest = camera_of(design), default_scene(design).objects[0].texture.finest
    half = np.array(design.sensor.size) / 2 / abs(design.sensor.relay_magnification)
    apart = []
    for step in design.d / 2 * np.eye(2):
        ends = (np.array([(1.0, 1.0), (1.0, 0.0), (0.3, 0.9), (0.0, 0.0)]) * half + way * step for way in (-1, 1))
        rays = (sensor_of_pupil(lens, microlenses(design, end), lens.fap.centre).views for end in ends)
        first, second = (ray.at(lens.fap.z - lens.first_order.front_principal + design.d_f) for ray in rays)
        apart.append(second - first)
    longest = np.linalg.svd(np.stack(apart, 1), compute_uv=False).max(1)
    assert finest / longest.max() == pytest.approx(2.5, rel=0.01)
    assert finest / longest[-1] > 2.7


def test_texture_is_finer_to_the_side_of_a_real_lens(monkeypatch):
    """The singlet spreads its field towards the sides, by more than a tenth: 2.1 steps of the axis alias there."""
    # No more microlenses than are looked at: where the light of each falls is traced beforehand.
    design = roslf.load("paper-singlet").replace({"microlens_array.size": (23.0, 2.0)})
    fewer_rays(monkeypatch)
    at_first_sight(monkeypatch)
    texture = {"kind": "noise", "finest": 2.1 * float(roslf.quantity("object_sample_mm")(Camera.of(design.thin_twin)))}
    scene = make_scene({"objects": [{"kind": "plane", "distance": design.d_f, "texture": texture}]})
    width, height = Camera.of(design.thin_twin).pixels
    for left, share in ((width // 2 - 35, 0.0), (width // 10, 1.0)):
        assert simulate(design, scene, PictureOptions(region=(left, height // 2 - 35, 70, 70))).aliased == share


def test_texture_too_fine_is_called_aliasing(monkeypatch):
    design, part = roslf.load("paper"), PictureOptions(region=(2240, 1480, 110, 110))
    step = float(roslf.quantity("object_sample_mm")(Camera.of(design)))
    fewer_rays(monkeypatch)
    at_first_sight(monkeypatch)
    # Of 0.3 in each octave a twelfth is black: its edges are twice as fine.
    for periods, contrast, share, edge in (
        *((1.8, 0.15, 1.0, 0.0), (1.985, 0.15, 0.0, 1.0), (2.2, 0.15, 0.0, 0.0)),
        *((3.6, 0.3, 1.0, 0.0), (4.4, 0.3, 0.0, 0.0)),
    ):
        texture = {"kind": "noise", "finest": periods * step, "contrast": contrast, "seed": 1}
        scene = make_scene({"objects": [{"kind": "plane", "distance": design.d_f, "texture": texture}]})
        trial = simulate(design, scene, part)
        assert (trial.aliased, trial.edge) == (share, edge)
        assert any("field it aliases" in line.text for line in statements(trial)) == (share > 0)
        assert any("about two microlenses a period" in line.text for line in statements(trial)) == (edge > 0)
        assert any("black" in line.text for line in statements(trial)) == (share > 0 and contrast > 0.2)


def test_depth_of_texture_that_aliases_errs_as_predicted():
    """Half a pitch out of focus, in a sixteenth of the light: three times as much as noise makes it."""
    design = roslf.load("paper")
    camera = Camera.of(design)
    design = design.replace({"light.exposure": float(exposure(camera)) / 16})
    z = float(depth_of(camera, np.asarray(0.5)))
    sample = float(camera.d * object_scale(camera, np.asarray(z - camera.tip)))
    off, predicted = [], []
    for seed in (1, 2):
        texture = {"kind": "noise", "finest": 1.5 * sample, "seed": seed}
        scene = make_scene({"objects": [{"kind": "plane", "distance": z, "texture": texture}]})
        trial = simulate(design, scene, PictureOptions(region=(2110, 1350, 360, 360), seed=seed))
        off.append(trial.first.disparities.disparity[trial.compared] - 0.5)
        predicted.append(trial.prediction.disparity)
        assert trial.first.measured.mean() > 0.8
    noise = float(axial_disparity_sigma(camera, seen_at(camera, z - camera.tip))) * 4
    assert np.mean(predicted) > 2.2 * noise
    assert 0.7 < np.sqrt(np.mean(np.square(np.concatenate(off)))) / np.mean(predicted) < 1.5


def told(place):
    """What a capture of views measures, and its steps in words with the shares of each that are told done."""
    steps = []

    def tell(what, done=0.0, total=0.0):
        if not total:
            steps.append((what, []))
        else:
            assert (what, total) == (steps[-1][0], 1.0)
            steps[-1][1].append(done)

    return captured(place, CaptureOptions(), tell), steps


def test_captures_tell_what_is_done(folder, lytro):
    """Each step begins in words; its shares rise, and those of the last end at 1."""
    for steps in (told(folder)[1], lytro[-1]):
        names = [what for what, _ in steps]
        assert names[:2] == ["reading views", "comparing orders of views"]
        assert names[-2:] == ["measuring noise", "measuring depth"]
        assert all(shares == sorted(shares) and max(shares, default=0.0) <= 1 for _, shares in steps)
        assert len(set(steps[-1][1])) > 4
        assert steps[-1][1][-1] == 1.0


def test_a_step_between_walls_whose_texture_is_seen_is_no_aliasing(monkeypatch):
    """Across it neighbours look at points far apart, of two walls, each with three microlenses a period."""
    design, part = roslf.load("paper"), PictureOptions(region=(2240, 1480, 110, 110))
    fewer_rays(monkeypatch)
    at_first_sight(monkeypatch)
    texture = {"kind": "noise", "finest": 3.0 * float(roslf.quantity("object_sample_mm")(Camera.of(design)))}
    walls = [{"kind": "plane", "distance": design.d_f, "texture": texture}]
    walls += [{"kind": "plane", "distance": design.d_f - 6, "size": (40, 40), "centre": (20, 0), "texture": texture}]
    trial = simulate(design, make_scene({"objects": walls}), part)
    assert len({*np.round(trial.true[np.isfinite(trial.true)], 3)}) == 2
    assert trial.aliased == 0
