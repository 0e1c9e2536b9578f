"""Objectives that map angles otherwise than f tan: against mpmath, against rays, in their limits, at their ends."""

import json
import math

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import root

import roslf_design as roslf
from roslf_design.bore.mapping import angle_map
from roslf_design.calibration.frames import CalibrationError
from roslf_design.calibration.space import SceneSide
from roslf_design.camera import Camera
from roslf_design.design import DesignError, dumps, loads
from roslf_design.effects.effect import Subject
from roslf_design.effects.geometry import _blur_on_mla, cos4
from roslf_design.evaluation.fields import evaluate_fields
from roslf_design.fates import FATES, RayFate
from roslf_design.lenses.angles import _angle_in_air, _image_height, illumination, stretch
from roslf_design.rays import trace_pupil
from roslf_design.rays.backward import behind_elements, lay_out, mapped
from roslf_design.rays.pupil import paths
from roslf_design.scenes.scene import chief_ray_limits
from roslf_design.theory.light import falloff
from roslf_design.theory.object_space import FAP, ObjectSpaceFaces
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.ideal import IdealBuilds

G = {
    "f theta": lambda t: t,
    "f sin": mp.sin,
    "2f tan(theta/2)": lambda t: 2 * mp.tan(t / 2),
}
"""The laws themselves, h/f of an angle."""
SCOPE = roslf.load("cystoscope")
OBJECTIVE = 5
F = SCOPE.elements[OBJECTIVE].focal_length


def table(law, last=80.0, count=33, focal_length=F):
    angles = np.linspace(0, math.radians(last), count)
    return {"angles": tuple(angles), "heights": tuple(focal_length * float(G[law](mp.mpf(a))) for a in angles)}


def with_mapping(mapping, window=0.4, **changes):
    """The cystoscope with an objective of that mapping; its window has no rim, and may be as good as none."""
    elements = [element.model_dump() for element in SCOPE.elements]
    elements[OBJECTIVE]["mapping"] = mapping
    elements[-1] |= {"diameter": None, "thickness": window}
    return SCOPE.replace({"elements": elements, "main_lens.focal_plane": 121.0, **changes})


def simple(mapping, fap=2.0, **changes):
    """One objective before the paper's camera, the FAP behind or before it, in air."""
    lens = {"kind": "lens", "distance": 5.0, "focal_length": 80.0, "mapping": mapping}
    return roslf.load("paper").replace(
        {
            "elements": [lens],
            "aperture.distance": fap,
            "microlens_array.size": (120.0, 120.0),
            "sensor.size": (100.0, 100.0),
            "main_lens.focal_plane": 60.0,
            **changes,
        }
    )


# --- the laws ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", G)
@pytest.mark.parametrize("index", [1.0, 1.333])
def test_angle_and_slope_are_those_of_the_law(name, index):
    """Rounding alone: the inverse of g in 40 digits, then Snell's law."""
    law = angle_map(name, 1.0).kernel
    angles = np.radians([0.0, 1e-6, 5.0, 40.0, 70.0, 85.0])
    with mp.workdps(40):
        p = np.array([float(G[name](mp.mpf(a))) for a in angles])
        true = [
            mp.findroot(lambda t, x=x: G[name](t) - mp.mpf(x), a) if x else mp.mpf(0)
            for x, a in zip(p, angles, strict=True)
        ]
        slopes = [mp.tan(mp.asin(mp.sin(t) / mp.mpf(index))) for t in true]
        ratio = [float(s * mp.mpf(index) / mp.mpf(x)) if x else 1.0 for s, x in zip(slopes, p, strict=True)]
    # At 85 degrees the inverse of sin has a condition of 11, tan of 12.
    assert_allclose(_angle_in_air(law, p), np.array(true, float), rtol=1e-14)
    assert_allclose(stretch(law, p, index), ratio, rtol=1e-13)
    assert_allclose([stretch.compiled(law, x, index) for x in p], ratio, rtol=1e-13)
    assert_allclose(_image_height(law, angles), p, rtol=1e-14)


@pytest.mark.parametrize("name", G)
def test_fall_off_is_etendue_over_image_area(name):
    """By differences: light through a flat opening from a small patch of angles, over the patch of image it fills."""
    law, step = angle_map(name, 1.0).kernel, mp.mpf("1e-12")
    with mp.workdps(40):
        for degrees in (1, 20, 45, 60, 80):
            t = mp.radians(degrees)
            solid = mp.cos(t - step) - mp.cos(t + step)  # over 2 pi
            area = (G[name](t + step) ** 2 - G[name](t - step) ** 2) / 2
            assert illumination(law, float(G[name](t))) == pytest.approx(float(mp.cos(t) * solid / area), rel=1e-13)


def test_fall_off_in_closed_form():
    t = np.radians([1e-9, 10, 45, 80])
    assert_allclose(illumination(angle_map("f sin", 1.0).kernel, np.sin(t)), 1.0, rtol=0)
    assert_allclose(illumination(angle_map("f theta", 1.0).kernel, t), np.sin(t) * np.cos(t) / t, rtol=1e-14)
    half = illumination(angle_map("2f tan(theta/2)", 1.0).kernel, 2 * np.tan(t / 2))
    assert_allclose(half, np.cos(t) * np.cos(t / 2) ** 4, rtol=1e-13)


@pytest.mark.parametrize("name", G)
def test_a_table_is_the_law_that_it_was_made_of(name):
    """2.5 degrees apart, away from the table's end: cubic splines miss 1e-6 rad, their derivative more."""
    known, made = angle_map(name, 1.0).kernel, with_mapping(table(name)).elements[OBJECTIVE].angle_map.kernel
    p = np.linspace(0, float(G[name](mp.radians(60))), 200)
    assert_allclose(_angle_in_air(made, p), _angle_in_air(known, p), atol=3e-6)
    assert_allclose(illumination(made, p), illumination(known, p), atol=1e-4)
    assert_allclose(_image_height(made, _angle_in_air(made, p)), p, rtol=0, atol=1e-14)


def test_a_measured_f_tan_is_f_tan():
    """In air: no discontinuity between the name and a table of the same."""
    angles = np.linspace(0, math.radians(60), 41)
    measured = simple({"angles": tuple(angles), "heights": tuple(80 * np.tan(angles))})
    a, b = Camera.of(simple("f tan")), Camera.of(measured)
    for name in ("field_half_width_mm", "field_half_diagonal_mm", "field_half_angle_deg", "object_sample_mm"):
        assert float(QUANTITIES[name](b)) == pytest.approx(float(QUANTITIES[name](a)), rel=1e-6), name
    for fap in (2.0, 12.0):  # behind the objective and before it
        one, other = (Subject(simple(mapping, fap)) for mapping in ("f tan", measured.elements[0].mapping))
        assert cos4(other).value == pytest.approx(cos4(one).value, rel=1e-5)


# --- the same as before -----------------------------------------------------------------------------------------------


def test_f_tan_by_name_is_the_camera_without():
    elements = [element.model_dump() for element in SCOPE.elements]
    elements[OBJECTIVE]["mapping"] = "f tan"
    named = SCOPE.replace({"elements": elements})
    assert named == SCOPE
    assert Camera.of(named) == Camera.of(SCOPE)
    assert roslf.evaluate(named).to_dict() == roslf.evaluate(SCOPE).to_dict()


def test_near_the_axis_every_mapping_is_first_order():
    """The first difference is of the angle's third power: a tenth of the field, a thousandth of the change."""
    straight = simple("f tan")
    for name in G:
        changes = []
        for width in (1.0, 0.1):
            narrow = {"sensor.size": (width, width)}
            bent, known = (
                float(QUANTITIES["field_half_width_mm"](Camera.of(design.replace(narrow))))
                for design in (simple(name), straight)
            )
            changes.append((bent - known) / width)
        assert abs(changes[0]) > 1e-9
        assert changes[0] / changes[1] == pytest.approx(100, rel=0.05), name
        for same in ("object_sample_mm", "sigma_z_mm", "fill_factor", "working_distance_mm", "image_diameter_mm"):
            assert QUANTITIES[same](Camera.of(simple(name))) == QUANTITIES[same](Camera.of(straight))


def test_what_lies_behind_the_objective_stays():
    bent, straight = with_mapping("f theta"), with_mapping("f tan")
    here, there = (evaluate_fields(design, [(0.0, 0.0), (1.5, 0.0), (2.4, 1.7)]) for design in (bent, straight))
    for a, b in zip(here, there, strict=True):
        assert (a.area_mm2, a.kept_fraction, a.centroid_mm) == (b.area_mm2, b.kept_fraction, b.centroid_mm)


# --- rays -------------------------------------------------------------------------------------------------------------


def mp_ray(design, height, slope, distance, name):
    """Of a ray just before the main lens, by first order to the objective; then from its point of the entrance pupil.

    The pupil is where two rays of the FAP's middle meet, prolonged. Plane of incidence x-z; windows by Snell's law.
    """

    def to_objective(x, o):
        at = mp.mpf(0)
        x, o = mp.mpf(x), mp.mpf(o)
        for element in sorted(design.elements, key=lambda e: e.distance):
            x, at = x - o * (mp.mpf(element.distance) - at), mp.mpf(element.distance)
            if element.kind == "plate":
                x -= o * mp.mpf(element.thickness) / mp.mpf(float(element.material.index(design.wavelength)))
                at += mp.mpf(element.thickness)
            else:
                o += x / mp.mpf(element.focal_length)
                if getattr(element, "mapping", "f tan") != "f tan":
                    return x, o, at
        raise AssertionError

    fap, objective = design.aperture.distance, max(e.distance for e in design.elements if e.kind == "lens")
    if fap > objective:  # in air before the objective
        pupil = mp.mpf(fap)
    else:
        behind = []
        for o in (mp.mpf(0), mp.mpf(1) / 100):  # two rays of the middle of the FAP, backwards to the lens, and out
            x, at = mp.mpf(0), mp.mpf(fap)
            inside = [e for e in sorted(design.elements, key=lambda e: -e.distance) if e.distance < fap]
            for element in inside:
                end = mp.mpf(element.distance) + (mp.mpf(element.thickness) if element.kind == "plate" else 0)
                x, at = x + o * (at - end), end
                if element.kind == "plate":
                    n = mp.mpf(float(element.material.index(design.wavelength)))
                    x, at = x + o * mp.mpf(element.thickness) / n, mp.mpf(element.distance)
                else:
                    o -= x / mp.mpf(element.focal_length)
            behind.append(to_objective(x + o * at, o))
        (x0, o0, at), (x1, o1, _) = behind
        pupil = at + (x1 - x0) / (o1 - o0)
    x, p, at = to_objective(height, slope)
    angle = mp.findroot(lambda t: G[name](t) - p, p)
    x, o = x - (p - mp.tan(angle)) * (pupil - at), mp.tan(angle)
    for element in sorted(design.elements, key=lambda e: e.distance):
        if element.distance > at:
            x, at = x - o * (mp.mpf(element.distance) - at), mp.mpf(element.distance)
            n = mp.mpf(float(element.material.index(design.wavelength)))
            sine = mp.sin(mp.atan(o)) / n
            x, at = x - mp.tan(mp.asin(sine)) * mp.mpf(element.thickness), at + mp.mpf(element.thickness)
    n = mp.mpf(float(design.object_space.medium.index(design.wavelength)))
    o = mp.tan(mp.asin(mp.sin(mp.atan(o)) / n))
    return x - o * (mp.mpf(distance) - at), o


@pytest.mark.parametrize("name", G)
def test_exact_rays_through_a_mapped_objective_and_its_window(name):
    """Glass between the lenses left out: it is taken to first order here, and by Snell's law by the exact rays."""
    design = with_mapping(name)
    bare = [e.model_dump() for e in design.elements if e.kind == "lens" or e.distance > 90]
    design = design.replace({"elements": bare, "main_lens.focal_plane": 121.0})
    camera = Camera.of(design)
    x = np.array([0.0, 0.3, 1.1, 1.9])
    rays = trace_pupil(camera, (np.array([[0.0], [0.6]]), 0.0), (x, 0.0))
    found = ObjectSpaceFaces.of(camera, clip=False).rays(rays.height, rays.slope)
    assert (found.status == RayFate.KEPT).all()
    with mp.workdps(30):
        for at in np.ndindex(2, 4):
            height, slope = mp_ray(design, rays.height[0][at], rays.slope[0][at], 121.0, name)
            assert found.slope[0][at] == pytest.approx(float(slope), rel=1e-11, abs=1e-15)
            assert found.height[0][at] - found.slope[0][at] * 121 == pytest.approx(float(height), rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("name", G)
@pytest.mark.parametrize("fap", [2.0, 12.0])
def test_closed_forms_are_those_rays_without_a_window(name, fap):
    """Before an objective in air nothing is left out: kernels, drawn rays, field widths."""
    design = simple(name, fap)
    camera = Camera.of(design)
    field = float(np.ravel(np.asarray(camera.sensor_size))[0]) / 2 / float(1 + camera.d_2 * camera.seen.vergence)
    x = np.array([0.0, 0.5 * field, field])
    rays = trace_pupil(camera, (np.array([[0.0], [-0.8]]), 0.0), (x, 0.0))
    layout, distance = lay_out(camera), 60.0
    out = mapped(layout.law, layout.front, *behind_elements(layout.front, 0.0, 0.0, *rays.height, *rays.slope))
    exact = ObjectSpaceFaces.of(camera, clip=False).rays(rays.height, rays.slope)
    drawn = paths(camera, rays, (x, 0.0), distance)
    for at in np.ndindex(2, 3):
        if fap < 5:  # else the FAP's point is not where the oracle's rays cross
            with mp.workdps(30):
                height, slope = mp_ray(design, rays.height[0][at], rays.slope[0][at], distance, name)
            assert out[2][at] == pytest.approx(float(slope), rel=1e-11, abs=1e-14)
            assert out[0][at] - out[2][at] * distance == pytest.approx(float(height), rel=1e-11, abs=1e-11)
        assert exact.slope[0][at] == pytest.approx(out[2][at], rel=1e-11, abs=1e-14)
        assert exact.height[0][at] == pytest.approx(out[0][at], rel=1e-11, abs=1e-11)
        assert drawn[at][0, 0] == pytest.approx(out[0][at] - out[2][at] * distance, rel=1e-11, abs=1e-11)
    if fap > 5:  # every ray crosses the FAP where the first order has it
        crossing = out[0] - out[2] * fap
        assert_allclose(crossing, np.broadcast_to([[0.0], [-0.8 * design.D_F / 2]], (2, 3)), atol=1e-11)
    half = float(QUANTITIES["field_half_width_mm"](camera))
    assert half == pytest.approx(abs(out[0][0, 2] - out[2][0, 2] * distance), rel=1e-11)
    angle = float(QUANTITIES["field_half_angle_deg"](camera))
    assert angle == pytest.approx(math.degrees(math.atan(abs(out[2][0, 2]))), rel=1e-11)


def test_water_narrows_what_the_mapping_images_by_snells_law():
    """Angles of any mapping in air, and in water behind the same window."""
    half = QUANTITIES["field_half_angle_deg"]
    for name in G:
        dry = with_mapping(name, **{"object_space.medium": {"index": 1.0}})
        wet = dry.replace({"object_space.medium": {"index": 1.333}, "microlens_array.distance": dry.d_1})
        in_air, in_water = (math.radians(float(half(Camera.of(design)))) for design in (dry, wet))
        assert math.sin(in_water) == pytest.approx(math.sin(in_air) / 1.333, rel=1e-12)


def test_how_far_off_the_axis_scenes_are_looked_at():
    """The line of the corner's chief ray that planes without bounds are judged by."""
    design = simple("f theta", 2.0)
    camera, corner = Camera.of(design), Subject(design).x_ml
    slope, height = chief_ray_limits(design)
    rays = trace_pupil(camera, (0.0, 0.0), (corner, 0.0))
    layout = lay_out(camera)
    hx, _, ox, _, _ = mapped(layout.law, layout.front, *behind_elements(layout.front, 0, 0, *rays.height, *rays.slope))
    for z in (20.0, 60.0):
        assert slope * z + height == pytest.approx(abs(float(hx - ox * z)), rel=1e-10)


# --- the end of a mapping ---------------------------------------------------------------------------------------------


def test_beyond_90_degrees_rays_are_blocked_by_name():
    """f sin ends at h = f: microlenses that would look farther are dark, and every number stays finite or inf."""
    design = with_mapping("f sin", **{"sensor.size": (10.0, 10.0), "microlens_array.size": (12.0, 12.0)})
    camera = Camera.of(design)
    x = np.linspace(0, 5.5, 12)
    rays = trace_pupil(camera, (0.0, 0.0), (x, 0.0))
    layout = lay_out(camera)
    *out, imaged = mapped(layout.law, layout.front, *behind_elements(layout.front, 0, 0, *rays.height, *rays.slope))
    names = [rim.name for rim in (camera.fap, *camera.rims[1:])]
    stopped = np.array([place >= FAP and names[place - FAP] == "lens 6, mapping" for place in rays.status // FATES])
    assert stopped.any()
    np.testing.assert_array_equal(stopped, ~imaged)
    exact = ObjectSpaceFaces.of(camera).rays(
        rays.height, rays.slope
    )  # met the other way round: the relay takes some before
    assert (exact.status[stopped] // FATES >= FAP).all()
    assert not exact.status[x < 1.9].any()
    assert np.isfinite(np.array(out)).all()
    result = roslf.evaluate(design, [(5.5, 0.0)])
    (field,) = result.fields
    assert (field.status, field.kept_fraction, field.centroid_mm) == ("dark", 0.0, None)
    assert "nan" not in json.dumps(result.to_dict()).lower()
    medium = float(design.object_space.medium.index(design.wavelength))
    angle = math.radians(float(QUANTITIES["field_half_angle_deg"](camera)))
    assert math.sin(angle) == pytest.approx(1 / medium, rel=1e-12)  # 90 degrees in air
    dry = Camera.of(design.replace({"object_space.medium": "air"}))
    assert float(QUANTITIES["field_half_angle_deg"](dry)) == pytest.approx(90.0, rel=1e-12)
    assert math.isinf(float(QUANTITIES["field_half_width_mm"](dry)))
    assert "nan" not in json.dumps(roslf.evaluate(design.replace({"object_space.medium": "air"})).to_dict()).lower()


def test_a_table_ends_where_it_ends():
    design = with_mapping(table("f theta", last=25.0, count=6))
    result = roslf.evaluate(design)
    centre, _, corner = result.fields
    assert centre.status == "full"
    assert corner.status == "dark"
    lost = dict(corner.ray_budget.taken())
    assert lost["lens 6, mapping"] == 1.0
    assert float(QUANTITIES["field_half_angle_deg"](Camera.of(design))) == pytest.approx(
        math.degrees(math.asin(math.sin(math.radians(25)) / float(design.object_space.medium.index(550e-6)))), rel=1e-9
    )
    assert not result.non_distortion.undistorted_in_field
    assert result.non_distortion.limited_by == "lens 6, mapping"


# --- light ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fap", [2.0, 12.0])
def test_light_falls_off_by_the_law_of_angles_before_the_objective(fap):
    """The FAP behind the objective or before it; angles from rays."""
    loss = {name: cos4(Subject(simple(name, fap))).value for name in G}
    camera, corner = Camera.of(simple("f theta", fap)), Subject(simple("f theta", fap)).x_ml
    rays = trace_pupil(camera, (0.0, 0.0), (corner, 0.0))
    layout = lay_out(camera)
    *_, slope, _, _ = mapped(layout.law, layout.front, *behind_elements(layout.front, 0, 0, *rays.height, *rays.slope))
    angle = math.atan(abs(float(slope)))
    assert angle > 0.1
    assert loss["f sin"] == 0.0
    assert loss["f theta"] == pytest.approx(1 - math.sin(angle) * math.cos(angle) / angle, rel=1e-9)
    assert loss["2f tan(theta/2)"] > loss["f theta"] > loss["f sin"]
    assert_allclose(falloff(camera, angle), 1 - loss["f theta"], rtol=1e-12)


# --- sharpness and depth ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fap", [2.0, 12.0])
def test_blur_off_the_axis_is_that_of_rays(fap):
    """A point at the field's edge through the ends of the FAP, along and across the field, against the estimate.

    The estimate is of first order in the FAP's width over the distance, 0.03 here.
    """
    design = simple("f theta", fap, **{"aperture.diameter": 1.0})
    camera, distance = Camera.of(design), 55.0
    place = 12.0
    builds = IdealBuilds(camera, camera, [(place, 0.0)], distance, False)
    x, y = (float(np.ravel(t)[0]) for t in builds.targets)
    spreads = []
    for way in ((1.0, 0.0), (0.0, 1.0)):
        rims = [camera.fap.outline.rim(sign * way[0], sign * way[1]) for sign in (1, -1)]
        ends = [np.array(u, float) * design.d for _, u in builds._landings(x, y, distance, rims)]
        spreads.append(float(np.hypot(*(ends[1] - ends[0]))))
    assert _blur_on_mla(camera, distance, place) == pytest.approx(
        max(*spreads, _blur_on_mla(camera, distance)), rel=0.02
    )


def test_a_decoder_that_knows_the_mapping_tells_depths_off_the_axis():
    camera = Camera.of(with_mapping("f sin"))
    builds = IdealBuilds(camera, camera, [(0.0, 0.0), (1.0, 0.5), (1.9, 1.4)], 121.0, False)
    assert np.max(np.abs(builds.depth_error_mm)) < 1e-3  # of 25: the FAP is no point
    defocused = IdealBuilds(camera, camera, [(0.0, 0.0), (1.0, 0.5), (1.9, 1.4)], 110.0, True)
    assert np.max(np.abs(defocused.depth_error_mm)) < 1e-3


def test_evaluate_tells_local_scales_and_angles():
    """Footprints against differences of where chief rays meet the focal plane; distortion against its definition."""
    design = with_mapping("2f tan(theta/2)")
    camera, place = Camera.of(design), 1.8
    (field,) = roslf.evaluate(design, [(place, 0.0)]).object_space.mapping.fields
    faces, lens = ObjectSpaceFaces.of(camera, clip=False), float(camera.d_1)

    def seen(x, y):
        """By exact rays, aimed at the FAP's middle."""

        def miss(height):
            out = next(
                faces.rays_at(
                    [design.d_3], tuple(height), tuple((np.array([x, y]) - height) / lens + height / design.f)
                )
            )
            return out.height - out.slope * design.d_3

        height = root(miss, [0.0, 0.0], tol=1e-13).x
        (hx, hy), (ox, oy), _ = faces.rays(tuple(height), tuple((np.array([x, y]) - height) / lens + height / design.f))
        return np.array([hx - ox * design.d_f, hy - oy * design.d_f]), math.hypot(ox, oy)

    step = 1e-4
    along = np.hypot(*(seen(place + step, 0.0)[0] - seen(place - step, 0.0)[0])) / (2 * step) * design.d
    across = np.hypot(*(seen(place, step)[0] - seen(place, -step)[0])) / (2 * step) * design.d
    assert field.object_sample_mm == pytest.approx((along, across), rel=1e-6)
    assert math.tan(math.radians(field.angle_deg)) == pytest.approx(seen(place, 0.0)[1], rel=1e-9)
    medium = float(design.object_space.medium.index(design.wavelength))
    in_air = math.asin(medium * math.sin(math.radians(field.angle_deg)))
    assert field.distortion_percent == pytest.approx(100 * (2 * math.tan(in_air / 2) / math.tan(in_air) - 1), rel=1e-10)


# --- files and faults -------------------------------------------------------------------------------------------------


def test_files_hold_mappings():
    for mapping in (*G, table("f sin")):
        design = with_mapping(mapping)
        assert loads(dumps(design)) == design
        assert Camera.of(loads(dumps(design))) == Camera.of(design)


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ("f tann", "did you mean 'f tan'"),
        (3, "is no mapping"),
        ({"angles": (0.0, 0.1, 0.2), "heights": (0.0, 0.1)}, "one height an angle|at least 3"),
        ({"angles": (0.0, 0.2, 0.1), "heights": (0.0, 0.1, 0.2)}, "rise"),
        ({"angles": (0.1, 0.2, 0.3), "heights": (0.0, 0.1, 0.2)}, "begin with 0"),
        ({"angles": (0.0, 1.0, 1.7), "heights": (0.0, 0.8, 0.9)}, "90 degrees"),
        ({"angles": (0.0, 0.1, 0.2), "heights": (0.0, 0.2, 0.4)}, "focal length 2 mm, not 0.95 mm"),
    ],
)
def test_mappings_that_are_none_are_told_in_a_line(mapping, words):
    with pytest.raises(DesignError, match=words) as refused:
        with_mapping(mapping)
    assert all(problem.key.startswith("elements.5.mapping") for problem in refused.value.problems)


def test_what_cannot_stand_before_a_mapped_objective_is_refused():
    lens = {"kind": "lens", "distance": 5.0, "focal_length": 80.0, "mapping": "f theta"}
    ahead = {"kind": "lens", "distance": 9.0, "focal_length": 500.0}
    window = {"kind": "plate", "distance": 9.0, "thickness": 1.0, "material": {"index": 1.5}, "diameter": 9.0}
    for changes, key in (
        ({"elements": [lens, ahead]}, "elements.0.mapping"),
        ({"elements": [lens, window]}, "elements.1.diameter"),
        ({"stops": [{"diameter": 9.0, "distance": 7.0}]}, "stops.0.distance"),
        ({"aperture.distance": 7.0, "aperture.tilt": (0.1, 0.0)}, "aperture.tilt"),
    ):
        with pytest.raises(DesignError) as refused:
            simple("f theta", **changes)
        assert [problem.key for problem in refused.value.problems] == [key]


def test_an_object_side_telecentric_objective_has_no_angles_to_map():
    lens = {"kind": "lens", "distance": 150.0, "focal_length": 33.0, "mapping": "f sin"}
    near = {"elements": [lens], "aperture.distance": 117.01, "main_lens.focal_plane": 160.0}
    design = roslf.load("paper").replace(near)
    assert math.isfinite(float(QUANTITIES["field_half_width_mm"](Camera.of(design))))
    with pytest.raises(DesignError, match="from one angle only") as refused:
        design.replace({"aperture.distance": 117.0})
    assert [problem.key for problem in refused.value.problems] == ["aperture.distance"]


def test_calibration_refuses():
    with pytest.raises(CalibrationError, match=r"elements.5.mapping: .*drop the mapping"):
        SceneSide.of(with_mapping("f theta"))
