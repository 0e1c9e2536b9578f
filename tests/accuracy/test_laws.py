"""Laws over public functions that references alone do not show: precision of inputs, mirrors, scales, stops, seams.

Closed forms' mirrors and scales are in tests/theory, those of discs in tests/shapes, of single rays in tests/rays.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import Stop
from roslf_design.evaluation.fields import evaluate_fields
from roslf_design.imaging.render import render
from roslf_design.shapes.coverage import coverage_image
from roslf_design.shapes.discs import intersect
from roslf_design.theory.quantities import QUANTITIES
from studies.accuracy.forms import CLOSED
from studies.accuracy.hard_forms import FORMS
from studies.accuracy.jobs import CUT, Job, random_job
from studies.accuracy.oracles.closed_forms import ORACLES
from studies.accuracy.promises import methods
from tests.laws import DEAR
from tests.shapes.blocks import area_in_rectangle
from tests.theory.designs import arguments, random_designs
from tests.theory.test_closed_forms import numbers

PAPER = roslf.load("paper")
SEEDS = st.integers(0, 10**6)


def camera(seed, quantity="area"):
    """A camera of other f-numbers, field and vignetting, and a microlens."""
    job = random_job(PAPER, quantity, np.random.default_rng(seed))
    return job.design, job.axis


def discs(seed, count=3):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (count, 2)), rng.uniform(0.5, 2, count)


# --- float32 in ---------------------------------------------------------------------------------------------------


def single(value):
    """The same as 32-bit numbers."""
    if isinstance(value, bool):
        return value
    if isinstance(value, tuple):
        return tuple(np.float32(part) for part in value)
    return np.float32(value)


def widened(value):
    """Those as doubles."""
    if isinstance(value, tuple):
        return tuple(float(part) for part in value)
    return value if isinstance(value, bool) else float(value)


@pytest.mark.parametrize("name", sorted(ORACLES))
def test_closed_forms_of_single_precision_are_those_of_the_same_doubles(name):
    """Numbers, and arrays of them: computed in double precision, or digits would be lost that the input has."""
    function = CLOSED[name]
    for design in random_designs(8, seed=12):
        given_ = {key: single(value) for key, value in arguments(name, design).items()}
        doubles = {key: widened(value) for key, value in given_.items()}
        if doubles.get("pupil_distance", 0.0) >= doubles.get("focal_plane_distance", math.inf):
            continue
        wanted = numbers(function(**doubles))
        assert [float(v) for v in numbers(function(**given_))] == [float(v) for v in wanted], name
        batch = {key: np.array([value]) if isinstance(value, np.float32) else value for key, value in given_.items()}
        for one, other in zip(numbers(function(**batch)), wanted, strict=True):
            assert np.asarray(one).dtype in (np.float64, np.bool_), name
            assert one == other, name


@given(SEEDS)
def test_shapes_and_pixels_of_single_precision_are_those_of_the_same_doubles(seed):
    centres, radii = (part.astype(np.float32) for part in discs(seed))
    wide = centres.astype(float), radii.astype(float)
    for one, other in zip(intersect(centres, radii), intersect(*wide), strict=True):
        assert np.array_equal(one, other, equal_nan=True)
    kept = {"pixel": 0.25, "size": (30, 30)}
    assert np.array_equal(coverage_image([0.0, 0.0], centres, radii, **kept), coverage_image([0, 0], *wide, **kept))
    box = np.float32(-0.3), np.float32(0.4)
    assert area_in_rectangle(centres, radii, (box[0], box[0]), (box[1], box[1])) == area_in_rectangle(
        *wide, (float(box[0]),) * 2, (float(box[1]),) * 2
    )


def test_designs_of_single_precision_are_those_of_the_same_doubles():
    narrow = np.float32(119.7)
    one, other = PAPER.replace(d_3=narrow), PAPER.replace(d_3=float(narrow))
    assert roslf.evaluate(one).to_dict() == roslf.evaluate(other).to_dict()


# --- mirrors ------------------------------------------------------------------------------------------------------


@given(SEEDS)
def test_microlenses_on_the_other_side_are_mirror_images(seed):
    design, (x, y) = camera(seed)
    one, other = evaluate_fields(design, [(x, y), (-x, y)])
    assert other.kept_fraction == pytest.approx(one.kept_fraction, rel=1e-14, abs=1e-15)
    assert other.area_mm2 == pytest.approx(one.area_mm2, rel=1e-14)
    assert other.status == one.status
    if one.centroid_mm is not None:
        assert other.centroid_mm == pytest.approx((-one.centroid_mm[0], one.centroid_mm[1]), rel=1e-12, abs=1e-15)


def test_pictures_of_a_straight_camera_are_their_own_mirror_image():
    """Rays' pixels by exact areas, waves' by the series: both symmetric to single precision."""
    for design, overrides in ((PAPER, ()), (PAPER, ("-microlens_diffraction", "-microlens_defocus"))):
        width, height = design.pixels
        region = (width // 2 - 40, height // 2 - 30, 80, 60)
        pixels = render(design, region=region, overrides=overrides).pixels
        assert np.abs(pixels - pixels[:, ::-1]).max() < 2e-6
        assert np.abs(pixels - pixels[::-1]).max() < 2e-6


# --- scale --------------------------------------------------------------------------------------------------------

LENGTHS = (
    "main_lens.diameter", "main_lens.focal_length", "main_lens.focal_plane", "aperture.diameter", "aperture.distance",
    "microlens_array.pitch", "microlens_array.focal_length", "sensor.distance", "sensor.pixel", "light.wavelength",
)  # fmt: skip


def grown(design, factor):
    values = {
        "main_lens": {"diameter": design.D, "focal_length": design.f, "focal_plane": design.d_f},
        "aperture": {"diameter": design.D_F, "distance": design.d_3},
        "microlens_array": {"pitch": design.d, "focal_length": design.f_ml, "size": design.microlens_array.size},
        "sensor": {"distance": design.d_2, "pixel": design.sensor.pixel, "size": design.sensor.size},
        "light": {"wavelength": design.wavelength},
    }

    def scaled(value):
        return tuple(factor * part for part in value) if isinstance(value, tuple) else factor * value

    parts = {part: {key: scaled(value) for key, value in rows.items()} for part, rows in values.items()}
    return roslf.Design.model_validate({"name": "scaled", **parts})


@given(SEEDS, st.sampled_from([2.0**-20, 0.25, 2.0, 2.0**17]))
@DEAR
def test_a_camera_of_another_size_is_the_same_camera(seed, factor):
    """Powers of two: shares to the last bit, lengths and areas with their power."""
    design, (x, y) = camera(seed)
    small, large = grown(design, 1.0), grown(design, factor)
    (one,) = evaluate_fields(small, [(x, y)])
    (other,) = evaluate_fields(large, [(factor * x, factor * y)])
    assert other.kept_fraction == one.kept_fraction
    assert other.lost_fraction == one.lost_fraction
    assert other.area_mm2 == one.area_mm2 * factor**2
    if one.centroid_mm is not None:
        assert other.centroid_mm == tuple(factor * part for part in one.centroid_mm)
    shares = [q for q in QUANTITIES.values() if q.evaluated and q.evaluated.under in ("f_number", "diffraction")]
    assert len(shares) == 9
    for share in shares:
        told, again = (float(share(Camera.of(each))) for each in (small, large))
        assert again == pytest.approx(told, rel=1e-14), share.name


@pytest.mark.parametrize("quantity", ["pixel image", "textured image", "diffraction image", CUT, "depth"])
def test_quantities_in_pixels_do_not_know_the_cameras_size(quantity):
    job = random_job(PAPER, quantity, np.random.default_rng(3))
    x, y = job.axis
    large = Job(quantity, grown(job.design, 8.0), (8 * x, 8 * y), 8 * job.distance, job.cycles, job.angle)
    small = Job(quantity, grown(job.design, 1.0), job.axis, job.distance, job.cycles, job.angle)
    best = next(one for one in methods(quantity) if one.kind in ("exact", "series", "panels"))
    power = 8.0 if quantity == "depth" else 1.0
    one, other = (best.compute(each, best.levels[-1], 0) for each in (small, large))
    assert np.allclose(other, power * one, rtol=1e-13, atol=1e-14)


# --- what is lost, and stops --------------------------------------------------------------------------------------


@given(SEEDS)
def test_what_is_kept_and_what_is_lost_make_the_whole(seed):
    design, axis = camera(seed)
    (field,) = evaluate_fields(design, [axis])
    assert field.kept_fraction + field.lost_fraction == pytest.approx(1, abs=3e-16)
    job = Job("pixel image", design, axis)
    exact = next(one for one in methods("pixel image") if one.kind == "exact").compute(job, 0, 0)
    # Pixels add up to the image's area: nothing is lost between them.
    assert exact.sum() == pytest.approx(float(intersect(*job.discs).area), rel=2e-13, abs=1e-13)


@given(SEEDS, st.floats(1.0001, 3.0), st.sampled_from(["main_lens.diameter", "aperture.diameter", "stops.0.diameter"]))
@DEAR
def test_wider_stops_let_more_light_through(seed, growth, which):
    design, axis = camera(seed)
    rim = Stop(diameter=0.9 * design.D_F + 0.4 * design.D, distance=0.5 * design.d_3 + 1e-3)
    narrow = design.replace({"stops": (rim,)})
    part = {"main_lens.diameter": narrow.D, "aperture.diameter": narrow.D_F, "stops.0.diameter": rim.diameter}[which]
    if which == "stops.0.diameter":
        wide = narrow.replace({"stops": (rim.model_copy(update={"diameter": part * growth}),)})
    elif which == "aperture.diameter" and part * growth >= narrow.D:
        return  # a FAP wider than the lens is no design
    else:
        wide = narrow.replace({which: part * growth})
    (one,), (other,) = evaluate_fields(narrow, [axis]), evaluate_fields(wide, [axis])
    assert other.area_mm2 >= one.area_mm2 * (1 - 1e-14)
    if which != "aperture.diameter":
        assert other.kept_fraction >= one.kept_fraction - 1e-15
    # Every single pixel gets as much light or more.
    jobs = [Job("pixel image", each, axis) for each in (narrow, wide)]
    exact = next(method for method in methods("pixel image") if method.kind == "exact")
    if which != "aperture.diameter":
        less, more = (exact.compute(job, 0, 0) for job in jobs)
        assert (more >= less - 1e-12).all()


# --- seams --------------------------------------------------------------------------------------------------------


def lengths(result):
    """Numbers of a result, but no flags: those may change at a point, which is what they are for."""
    return [float(v) for v in numbers(result) if not isinstance(v, bool | np.bool_)]


@pytest.mark.parametrize("case", [case for case in FORMS if case.point is not None], ids=lambda case: case.name)
def test_closed_forms_pass_through_their_singular_points(case):
    """Where a form is finite at the point, its neighbours come to the same: no seam between branches shows."""
    singular = {
        "d_3 → d_f": "pupil_distance", "d_3 → 0": "pupil_distance", "d_3 → f": "pupil_distance",
        "d_f → f": "focal_plane_distance", "d_1 → f": "mla_distance", "D_F → 0": "pupil_diameter",
        "d_2 → 0": "sensor_distance", "images just touch": "pupil_diameter", "Z_F → focal plane": "depth",
        "Z_F → A/m": "depth",
    }  # fmt: skip
    if case.name not in singular:
        return  # at infinity there is no neighbour
    key = singular[case.name]
    for name, given_ in case.point(PAPER):
        function = CLOSED[name]
        try:
            there = lengths(function(**given_))
        except (ArithmeticError, ValueError):
            continue
        size = given_[key] or PAPER.f
        for side in (1, -1):
            steps = []
            for step in (1e-6, 1e-9, 1e-12):
                moved = given_[key] + side * step * size
                if moved < 0 or (key == "focal_plane_distance" and moved <= given_.get("focal_length", 0.0)):
                    break
                if "pupil_distance" in given_ and key == "pupil_distance":
                    limit = given_.get("focal_plane_distance", math.inf)
                    if moved > limit:
                        break
                try:
                    near = lengths(function(**given_ | {key: moved}))
                except (ArithmeticError, ValueError):
                    break
                steps.append(near)
            if len(steps) < 3:
                continue
            for at, *near in zip(there, *steps, strict=True):
                if not (math.isfinite(at) and all(map(math.isfinite, near))):
                    continue
                off = [abs(value - at) for value in near]
                scale = max(abs(at), *(abs(value) for value in near), 1e-300)
                assert off[2] <= max(0.02 * off[1], 1e-9 * scale, 1e-13), (name, side, at, near)


@given(SEEDS)
def test_shapes_are_continuous_where_discs_touch(seed):
    """Area, losses and pixels on both sides of tangency from outside and inside, a last place apart."""
    rng = np.random.default_rng(seed)
    r = float(rng.uniform(0.5, 3))
    R = r * float(rng.uniform(1.01, 8))
    for touch in (r + R, R - r):
        values = []
        for d in (math.nextafter(touch, 0), touch, math.nextafter(touch, 9e9)):
            shape = intersect([[0.0, 0.0], [d, 0.0]], [r, R])
            pixels = coverage_image([0.0, 0.0], [[0.0, 0.0], [d, 0.0]], [r, R], pixel=0.5, size=(14, 14))
            values.append([float(shape.area), float(shape.kept_fraction), float(shape.lost_fraction), *pixels.ravel()])
        for one, other in pairwise(values):
            # Pixels are right to 1e-15 of the larger radius, of up to 50 pixels; areas to less.
            assert np.abs(np.subtract(one, other)).max() < 3e-13
