"""Calibrations through windows and liquids, against rays traced through every face in mpmath."""

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.calibration import (
    Board,
    CalibrationError,
    Captures,
    Observations,
    calibrate,
    camera_of,
    depth_errors,
    derived,
    expected_errors,
    laplace_draws,
    sample_posterior,
    sheet_of,
)
from roslf_design.calibration.model import project_boards, rotation_matrix
from roslf_design.calibration.planning import pupil_of, random_poses
from roslf_design.calibration.posterior import variance_shares
from roslf_design.calibration.space import in_medium, used_in
from roslf_design.camera import Camera
from tests.oracles.object_space import object_side

BENCH = roslf.load("paper").replace({"aperture.distance": 117.0})
WATER = {"index": 1.333}
WINDOW = {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": {"index": 1.5}}
FIELD_LENS = {"kind": "lens", "distance": 60.0, "focal_length": 400.0}
WET = BENCH.replace({"elements": [WINDOW], "object_space.medium": WATER, "main_lens.focal_plane": 350.0})
COVERED = {"thickness": 0.4, "material": {"index": 1.52}}
DESIGNS = {
    "window": WET,
    "cover glass": WET.replace({"sensor.cover": COVERED}),
    "FAP in water": WET.replace({"elements": [{**WINDOW, "distance": 80.0}]}),
    "lens and window": BENCH.replace(
        {"elements": [FIELD_LENS, WINDOW], "object_space.medium": WATER, "main_lens.focal_plane": 350.0}
    ),
}


def faces(design):
    return [
        ("plate", e.distance, e.thickness, e.material.index(design.wavelength))
        if e.kind == "plate"
        else ("lens", e.distance, e.focal_length, 0)
        for e in sorted(design.elements, key=lambda e: e.distance)
    ]


def seen_from(design, point, view, exact=False):
    """Microlens coordinates [pitches, from the axis] in which a view sees a point (x, y, z) of object space [mm].

    Of each axis on its own: the microlens c and the pixel behind it whose ray meets the point; a view's pixel is
    counted from the one that looks through the middle of the FAP.
    """
    cover = design.sensor.cover
    d_2 = design.d_2 - (0 if cover is None else cover.thickness * (1 - 1 / cover.material.index(design.wavelength)))
    medium = design.object_space.medium.index(design.wavelength)

    def heights(c, pixel):
        slope = mp.mpf(pixel) / d_2
        height = c - slope * mp.mpf(design.d_1)
        return object_side(height, slope + height / design.f, faces(design), medium, [design.d_3, point[2]], exact)

    (fap_c, x_c), (fap_p, x_p) = heights(1, 0), heights(0, 1)
    return [
        float((x - x_p * design.q * s) / (x_c - x_p * fap_c / fap_p) / design.d)
        for x, s in zip(point[:2], view, strict=True)
    ]


def board_poses(design, captures, seed=0):
    return random_poses(captures, pupil_of(design), np.random.default_rng(seed))


def traced_observations(design, captures, poses):
    """Corners of rigid boards where rays put them."""
    points, views = captures.board.points, captures.view_grid()
    scene = np.einsum("bij,nj->bni", rotation_matrix(poses.rotation), points) + poses.translation[:, None]
    scene[..., 2] += pupil_of(design)
    own = camera_of(design)
    uv = np.empty((len(scene), len(views), len(points), 2))
    with mp.workdps(20):
        for b, v, n in np.ndindex(uv.shape[:3]):
            uv[b, v, n] = seen_from(design, scene[b, n], views[v])
    return Observations(points, views, uv + np.array([own.x_0, own.y_0]))


@pytest.fixture(scope="module", params=DESIGNS.values(), ids=DESIGNS)
def looking(request):
    design = request.param
    captures = replace(Captures.for_design(design, boards=3, board=Board(4, 5, 6.0)), views=3)
    poses = board_poses(design, captures)
    return design, captures, poses, traced_observations(design, captures, poses)


def test_rigid_boards_are_seen_where_rays_through_every_face_see_them(looking):
    design, captures, poses, observations = looking
    model = project_boards(camera_of(design).vector(), poses.vector, captures.board.points, captures.view_grid()).values
    np.testing.assert_allclose(model, observations.uv, rtol=0, atol=1e-9)


def test_a_calibration_through_elements_gives_the_camera_back(looking):
    design, _, _, observations = looking
    sheet, c = sheet_of(design), Camera.of(design)
    found = calibrate(observations, sheet, guess=camera_of(design).A)
    lengths = derived(found.joint.camera.vector(), sheet)
    for name in ("H", "d_3", "d_1", "d_f", "d_2", "A", "m"):
        assert lengths[name] == pytest.approx(float(getattr(c.seen, name)), rel=1e-6), name
    ruler = sheet.space.ruler(lengths)
    for name in ("d_3", "d_1", "d_f", "d_2"):
        assert ruler[name] == pytest.approx(getattr(design, name), rel=1e-6), name
    assert ruler["H"] == pytest.approx(design.d_f / (design.d_f - design.d_3), rel=1e-5)


def test_glass_about_the_array_alone_shortens_d_2_only():
    bare, covered = BENCH, BENCH.replace({"sensor.cover": COVERED})
    sheet, camera = sheet_of(covered), camera_of(covered)
    assert 1 / camera.inverse_d_2 == pytest.approx(2.0 - 0.4 * (1 - 1 / 1.52))
    assert pytest.approx(camera_of(bare).A) == camera.A
    ruler = sheet.space.ruler(derived(camera.vector(), sheet))
    assert ruler["d_2"] == pytest.approx(2.0)
    assert ruler["d_3"] == pytest.approx(117.0)


@pytest.mark.parametrize("name", ["arthroscope", "cystoscope", "grin-needle", "video-otoscope"])
def test_scopes_that_ship_go_to_their_boards_medium_and_back(name):
    """The GRIN needle's relay turns the picture, which boards do not show: A and m of the fit are positive."""
    design = roslf.load(name)
    camera, sheet, c = camera_of(design), sheet_of(design), Camera.of(design)
    assert camera.A > 0
    assert camera.m > 0
    # The focal plane lies A/m before the pupil, by a ruler.
    assert pupil_of(design) + camera.A / camera.m == pytest.approx(design.d_f, rel=1e-9)
    lengths = derived(camera.vector(), sheet)
    for symbol in ("H", "d_3", "d_1", "d_f", "d_2", "A", "m"):
        assert lengths[symbol] == pytest.approx(float(getattr(c.seen, symbol)), rel=1e-9), symbol
    ruler = sheet.space.ruler(lengths)
    for symbol in ("d_3", "d_1", "d_f", "d_2"):
        assert ruler[symbol] == pytest.approx(getattr(design, symbol), rel=1e-9), symbol


def test_plans_through_elements_promise_what_calibrations_scatter_by():
    design = DESIGNS["lens and window"]
    captures = replace(Captures.for_design(design, boards=6, board=Board(4, 5, 6.0)), views=3)
    sheet = replace(sheet_of(design), f_sigma=0.0, d_sigma=0.0, cell_sigma=0.0)
    promised, camera = expected_errors(camera_of(design), sheet, captures, samples=16), camera_of(design)
    found = []
    for k in range(30):
        rng = np.random.default_rng([5, k])
        poses = random_poses(captures, pupil_of(design), rng)
        points, views = captures.board.points, captures.view_grid()
        uv = project_boards(camera.vector(), poses.vector, points, views).values
        noisy = Observations(points, views, uv + captures.noise * rng.normal(size=uv.shape))
        lengths = derived(calibrate(noisy, sheet, guess=camera.A).fit.camera.vector(), sheet)
        found.append([float(lengths[quantity]) for quantity in ("d_3", "d_2")])
    for quantity, values in zip(("d_3", "d_2"), np.transpose(found), strict=True):
        assert values.std() == pytest.approx(promised.sigma[quantity], rel=0.4)  # 30 trials: 13 %; poses: 20 %


def test_boards_cannot_stand_in_the_window():
    captures = Captures.for_design(WET, distance=120.0, distance_range=4.0, board=Board(4, 5, 0.1))
    with pytest.raises(CalibrationError, match=r"reach into the bore: the farthest element ends at 119\.0 mm"):
        expected_errors(camera_of(WET), sheet_of(WET), captures)


def test_depth_errors_grow_with_the_index():
    """Near the focal plane f alone errs there, in seen space; a millimetre seen is n in water."""
    both = []
    for design in (WET, in_medium(WET, "air")):
        captures = Captures.for_design(design, boards=8, board=Board(4, 5, 6.0))
        poses = board_poses(design, captures)
        views, camera = captures.view_grid(), camera_of(design)
        uv = project_boards(camera.vector(), poses.vector, captures.board.points, views).values
        sheet = replace(sheet_of(design), d_sigma=0.0, cell_sigma=0.0)
        fit = calibrate(Observations(captures.board.points, views, uv), sheet, guess=camera.A).fit
        fit = fit._replace(covariance=fit.covariance._replace(matrix=1e-12 * np.eye(5)))
        draws = laplace_draws(fit, sheet, 4000, np.random.default_rng(0))
        both.append(depth_errors(draws, fit, sheet, np.array([design.d_f]))["from_lens"][0])
    assert both[0] / both[1] == pytest.approx(1.333, rel=1e-3)


GLASS = {"elements.0.focal_length": 2.0, "elements.1.thickness": 0.02, "elements.1.index": 0.01}


def test_what_is_not_known_of_elements_scatters_calibrations_as_told():
    """Instruments whose glass, lens and liquid are off, each calibrated by the data sheet of the one that was drawn."""
    design = DESIGNS["lens and window"].replace({"sensor.cover": COVERED, "sensor.distance": 2.15})
    known = {**GLASS, "object_space.index": 0.002, "sensor.cover.thickness": 0.02}
    captures = replace(Captures.for_design(design, boards=6, board=Board(4, 5, 6.0)), views=3, noise=1e-5)
    sheet = replace(sheet_of(design, uncertain=known), f_sigma=1e-6, d_sigma=0.0, cell_sigma=0.0)
    points, views, distances = captures.board.points, captures.view_grid(), np.array([300.0, 420.0])

    def fitted(instrument, seed):
        camera, rng = camera_of(instrument), np.random.default_rng([7, seed])
        poses = random_poses(captures, pupil_of(design), rng)
        uv = project_boards(camera.vector(), poses.vector, points, views).values
        return calibrate(Observations(points, views, uv + 1e-5 * rng.normal(size=uv.shape)), sheet, guess=camera.A).fit

    fit = fitted(design, 0)
    off, missed, rng = [], [], np.random.default_rng(3)
    for k in range(24):
        drawn = {place: sheet.mean[4 + i] + sigma * rng.normal() for i, (place, sigma) in enumerate(known.items())}
        instrument = design.replace(drawn)  # f, d_1, d_2 and the FAP stay where the ruler has them
        found = derived(fitted(instrument, k).camera.vector(), sheet)
        ruler, told, true = sheet.space.ruler(found), sheet.apparent(found), camera_of(instrument)
        off.append([float(ruler[name] - getattr(instrument, name)) for name in ("d_3", "d_1", "d_2")])
        # Eq. 12: the slope that the instrument shows of a point, and what depth it is told to have.
        z = distances - pupil_of(instrument)
        slope = (true.m - true.A / z) * true.A * true.inverse_d_2
        missed.append(told.A / (told.m - slope * told.d_2 / told.A) + told.pupil - distances)
    normal = laplace_draws(fit, sheet, 4000, np.random.default_rng(0))
    for draws in (normal, sample_posterior(fit, sheet, seed=1, chunk=60, most_steps=60)):
        promised = sheet.space_at(draws.quantities).ruler(draws.quantities)
        spread = [promised[name].std() for name in ("d_3", "d_1", "d_2")]
        np.testing.assert_allclose(np.std(off, axis=0), spread, rtol=0.45)  # 24 instruments: 15 %
        depths = depth_errors(draws, fit, sheet, distances)["from_lens"]
        np.testing.assert_allclose(np.std(missed, axis=0), depths, rtol=0.45)
    shares = variance_shares(fit, sheet)
    assert all(shares[name]["elements"] > 0.99 for name in ("d_3", "d_2"))


# --- calibrated in air, used in water ---------------------------------------------------------------------------------

DRY = in_medium(WET, "air")


def traced_depth(made, used, plane):
    """Depth that a calibration of `made` tells of a point on the axis before `used`, by rays of two views alone."""
    with mp.workdps(30):
        views = [(-4.0, 0.0), (4.0, 0.0)]
        u = [seen_from(used, (0.0, 0.0, plane), view)[0] for view in views]
        slope = (u[1] - u[0]) / 8

        def off(distance):
            one, other = (seen_from(made, (0.0, 0.0, distance), view)[0] for view in views)
            return (other - one) / 8 - slope

        return float(mp.findroot(off, (made.d_3 + 60, made.d_3 + 300), solver="anderson", tol=1e-22))


@pytest.mark.parametrize("name", ["window", "FAP in water", "lens and window"])
def test_depths_in_another_medium_against_rays(name):
    made = in_medium(DESIGNS[name], "air")
    found = used_in(made, "1.333", np.linspace(220.0, 420.0, 3))
    for plane, told in zip(found.distances, found.uncorrected, strict=True):
        assert told == pytest.approx(traced_depth(made, found.design, plane), rel=1e-8)
        # Read with the camera in the medium they are right.
        assert traced_depth(found.design, found.design, plane) == pytest.approx(plane, rel=1e-8)


def test_behind_a_flat_window_depths_are_short_by_the_index():
    found = used_in(DRY, "1.333", np.array([200.0, 300.0, 400.0]))
    np.testing.assert_allclose(found.relative, 1 / 1.333 - 1, rtol=1e-12)
    np.testing.assert_allclose(found.distances, 119.0 + 1.333 * np.array([81.0, 181.0, 281.0]), rtol=1e-12)
    assert found.design.d_1 == DRY.d_1
    assert found.design.d_f == pytest.approx(119.0 + 1.333 * (DRY.d_f - 119.0))


def test_snell_s_law_leaves_the_correction_right_to_the_plate_s_aberration():
    """By Snell's law instead of the paraxial one: a point aside is told right to the square of the angle."""
    found = used_in(DRY, "1.333", np.array([300.0]))
    with mp.workdps(30):
        for aside, bound in ((1.0, 1e-4), (10.0, 1e-2)):
            slope = mp.mpf(aside) / 300
            exact, paraxial = (
                object_side(0, slope, faces(found.design), 1.333, [float(found.distances[0])], kind)[0]
                for kind in (True, False)
            )
            assert abs(exact / paraxial - 1) < bound
    assert math.isclose(float(found.uncorrected[0]), 300.0, rel_tol=1e-12)
