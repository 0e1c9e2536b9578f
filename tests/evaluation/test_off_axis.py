"""What is required off the axis, and of a round field: closed forms of a thin lens, and of images that nothing cuts."""

import math

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import DesignError, dumps, loads
from roslf_design.design.files import preset_path
from roslf_design.evaluation.field_images import FieldImages
from roslf_design.evaluation.fields import default_fields
from roslf_design.evaluation.required import limits_for_study
from roslf_design.optimization.goals import Constraint
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.theory.vignetting import lit_pairs
from roslf_design.tolerancing.result import analyse, share_that_meets
from roslf_design.tolerancing.run import tally_chunk
from roslf_design.tolerancing.study import make_plan, read_study
from roslf_design.traced.fields import images_of

PLAIN = preset_path("rigid-scope").read_text()


def asked(text, plain=PLAIN):
    return loads(f"{plain}\n[required]\n{text}\n")


def slope(design, place):
    """Slope of a microlens's chief ray before a thin lens: through the middle of the FAP, d_3 before it."""
    # Height on the lens is u d_3, slope behind it u - u d_3/f, height on the array that after d_1.
    return math.hypot(*place) / abs(design.d_3 + design.d_1 * (1 - design.d_3 / design.f))


@pytest.mark.parametrize("at", [None, 8.0, 20.0])
def test_a_height_on_the_object_belongs_to_the_microlens_whose_chief_ray_meets_it(at):
    plane = "" if at is None else f'at = "{at} mm", '
    design = asked(f'detail_lp_per_mm = {{{plane}object_height = "3 mm", min = 0.1}}')
    (told,) = roslf.evaluate(design).required
    tip = float(Camera.of(design).tip)
    away = design.d_f - design.d_3 if at is None else tip + at - design.d_3
    assert slope(design, told.x_ml_mm) * away == pytest.approx(3.0, rel=1e-6)
    assert told.met


def test_an_angle_off_the_axis_has_its_cos_to_the_fourth_of_light():
    design = asked('relative_illumination = [{field_angle = "20 deg", min = 0.7}, {field_angle = "20 deg", min = 0.8}]')
    met, missed = roslf.evaluate(design).required
    assert math.atan(slope(design, met.x_ml_mm)) == pytest.approx(math.radians(20), rel=1e-6)
    assert met.value == missed.value == pytest.approx(math.cos(math.radians(20)) ** 4, rel=1e-6)
    assert (met.met, missed.met) == (True, False)
    assert met.verdict.text.startswith("as required: relative illumination 20 deg off the axis is 0.7797")


def test_close_to_the_axis_all_is_as_on_it():
    place = 'at = "15 mm", object_height = "1 nm"'
    design = asked(
        f'u_z_mm = [{{at = "15 mm", max = 1}}, {{{place}, max = 1}}]\n'
        f'sigma_z_mm = [{{at = "15 mm", max = 1}}, {{{place}, max = 1}}]\n'
        f'detail_lp_per_mm = [{{at = "15 mm", min = 1}}, {{{place}, min = 1}}]'
    )
    pairs = roslf.evaluate(design).required
    for on_axis, off in zip(pairs[::2], pairs[1::2], strict=True):
        assert off.value == pytest.approx(on_axis.value, rel=1e-5)


def test_depth_and_detail_off_the_axis_in_focus_are_those_of_its_microlens():
    design = asked('u_z_mm = {object_height = "8 mm", max = 1}\ndetail_lp_per_mm = {field = "corner", min = 0.1}')
    depth, detail = roslf.evaluate(design).required
    (field,) = roslf.evaluate(design, fields=[depth.x_ml_mm]).fields
    assert depth.value == pytest.approx(field.u_z_mm, rel=1e-9)
    rows = [row for row in roslf.specification(design).resolution if row.plane == "focal plane"]
    assert detail.value == max(rows, key=lambda row: math.hypot(*row.x_ml_mm)).usable_lp_per_mm


def test_what_the_sensor_does_not_see_is_none_and_says_how_far_it_sees():
    design = asked('relative_illumination = {object_height = "50 mm", min = 0.1}')
    result = roslf.evaluate(design)
    (told,) = result.required
    assert (told.value, told.met, told.x_ml_mm) == (None, False, None)
    sees = result.non_distortion.field_half_diagonal_mm
    assert f"to {sees:.4g} mm in its corner" in told.remedy
    assert limits_for_study(design) == ()


def test_behind_a_real_lens_the_place_is_that_of_traced_rays():
    plain = preset_path("paper-singlet").read_text()
    corner = FieldImages.of(roslf.load("paper-singlet")).points[-1]
    design = asked(f'distortion_percent = {{object_height = "{corner.x0_mm!r} mm", max = 100}}', plain)
    (told,) = roslf.evaluate(design, fields=[]).required
    np.testing.assert_allclose(told.x_ml_mm, corner.x_ml_mm, rtol=1e-5)
    assert told.value == pytest.approx(corner.distortion_percent, rel=1e-3)


def test_a_round_field_is_as_wide_as_the_sensor_is_high_on_its_nearer_side():
    design = asked('round_field_of_view_deg = {min = 30}\nround_field_radius_mm = {at = "10 mm", min = 3}')
    angle, radius = roslf.evaluate(design).required
    assert angle.value == pytest.approx(roslf.evaluate(design).answer.field_of_view_deg.height, rel=1e-12)
    away = float(Camera.of(design).tip) + 10.0 - design.d_3
    assert radius.value == pytest.approx(math.tan(math.radians(angle.value / 2)) * away, rel=1e-9)
    up = design.replace({"sensor.decentre": ["0 mm", "0.1 mm"]})
    lower = design.replace({"sensor.size": [design.sensor.size[0], design.sensor.size[1] - 0.2]})
    values = [float(roslf.quantity("round_field_of_view_deg")(Camera.of(one))) for one in (up, lower)]
    assert values[0] == pytest.approx(values[1], rel=1e-9)


def test_of_a_round_field_the_corners_of_the_sensor_do_not_matter():
    """A main lens so wide that it cuts the corners alone: cut without a round field, whole and lit with one."""
    plain, field = loads(PLAIN), roslf.quantity("undistorted_field_mm")
    low, high = (float(roslf.quantity(f"field_half_{way}_mm")(Camera.of(plain))) for way in ("height", "diagonal"))
    narrow = min(
        (plain.replace({"main_lens.diameter": float(diameter)}) for diameter in np.linspace(0.2, 3.0, 400)),
        key=lambda one: abs(float(field(Camera.of(one))) - (low + high) / 2),
    )
    assert low < float(field(Camera.of(narrow))) < high
    angle = 0.99 * float(roslf.quantity("round_field_of_view_deg")(Camera.of(narrow)))
    text = dumps(narrow)
    cut, whole = roslf.evaluate(narrow), roslf.evaluate(asked(f"round_field_of_view_deg = {{min = {angle}}}", text))
    verdicts = [{one.name: one for one in result.verdicts} for result in (cut, whole)]
    assert [one["field_undistorted"].ok for one in verdicts] == [False, True]
    assert "rim of the round field" in verdicts[1]["field_undistorted"].text
    light = math.cos(math.radians(angle / 2)) ** 4
    assert whole.answer.corner_light == pytest.approx(light, rel=1e-6)
    assert "the rim of the round field gets" in verdicts[1]["corner_lit"].text
    assert whole.required[0].met
    assert any(row[0] == "light at the rim of the round field" for row in whole.answer.rows)


@pytest.mark.parametrize("kind", ["radius", "angle"])
def test_clearance_of_every_command_is_that_at_the_rim_of_the_round_field(kind):
    """By straight lines through points in air: a pencil of the rim's point on the focal plane at each stop."""
    stop = {"diameter": 4.0, "distance": 128.0}, {"diameter": 30.0, "distance": 60.0}
    low, name, at = (6.0, "round_field_radius_mm", 200.0) if kind == "radius" else (3.2, "round_field_of_view_deg", 0.0)
    design = roslf.load("paper").replace(
        {
            "stops": stop,
            "required": {name: {"min": low} | ({"at": at} if at else {})},
            "microlens_array.decentre": (0.2, 0),
        }
    )
    places, tip = np.array([100.0, 118.0, 124.0]), 128.0
    slopes = low / (tip + at - places) if at else np.tan(np.radians(low / 2))
    point, gap = slopes * (design.d_f - places), design.d_f - places  # from the FAP's middle to the focal plane
    rooms = [
        radius - point * np.abs(z - places) / gap - design.D_F / 2 * (design.d_f - z) / gap
        for radius, z in ((design.D / 2, 0.0), (2.0, 128.0), (15.0, 60.0))
    ]
    least = np.min(rooms, axis=0)
    cameras, clearance = Camera.of(design, {"d_3": places}), roslf.quantity("non_distortion_room_mm")
    assert clearance(cameras) == pytest.approx(least, rel=1e-9)
    assert roslf.sweep(design, {"d_3": places}, clearance.name).values[clearance.name] == pytest.approx(least, rel=1e-9)
    held = Constraint(quantity=clearance.name, min=0.0)
    assert held.values(cameras) == pytest.approx(least, rel=1e-9)
    assert held.measured(cameras).min(axis=0) == pytest.approx(least, rel=1e-9)
    for k, place in enumerate(places):
        told = roslf.evaluate(design.replace(d_3=place), fields=[]).non_distortion.room_at_corner_mm
        assert told == pytest.approx(least[k], rel=1e-9)


def test_a_round_field_that_is_dark_at_its_rim_is_missed():
    design = asked("round_field_of_view_deg = {min = 30}").replace(
        {"main_lens.diameter": 0.4, "aperture.distance": 2.0}
    )
    (told,) = roslf.evaluate(design).required
    assert not told.met
    assert "the FAP and the main lens leave less than a third of the pencils there" in told.remedy


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"aperture.diameter": 6.0, "stops.0.decentre": (0.3, 0.1), "aperture.decentre": (0.05, -0.2)},
        {"aperture.distance": 20.0},
        {"stops": [{"shape": "rectangle", "sides": [4.0, 3.0], "distance": 53.0}]},
    ],
)
def test_a_round_field_ends_where_exact_areas_leave_a_third_of_its_light(changes):
    stops = [{"diameter": 4.0, "distance": 53.0}, {"diameter": 16.0, "distance": 18.0}]
    tip = {"main_lens.focal_plane": 67.5, "main_lens.focal_length": 30.0, "main_lens.diameter": 22.86}
    lengths = {**tip, "aperture.diameter": 0.53, "aperture.distance": 45.0, "stops": stops}
    design = roslf.load("paper").replace({**lengths, "environment": None}).replace(changes)
    camera = Camera.of(design)
    radius = min(float(end) for *_, end in lit_pairs(camera))
    # Along the worst direction, all openings in a row: how much of it a straight line through their middles has.
    turn = np.linspace(0, 2 * np.pi, 721)
    circle = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    images = MicrolensImages(camera, np.concatenate([circle, [(0.0, 0.0)]]))
    kept = images.shapes.kept_fraction[:, 0]
    # Equal discs leave .219, a strip through the middle .416; a straight edge a segment a third of the diameter high.
    assert 0.219 < kept[:-1].min() / kept[-1] < 0.417
    if isinstance(design.stops[0].sides, tuple):
        assert kept.min() == pytest.approx((math.acos(1 / 3) - math.sqrt(8) / 9) / math.pi, rel=1e-4)
    # Where the sensor sees farther, the field ends there, and a study holds the same.
    wide = camera.replace(
        {"sensor.size.0": 80.0, "sensor.size.1": 80.0, "microlens_array.size.0": 80.0, "microlens_array.size.1": 80.0}
    )
    value = float(roslf.quantity("round_field_radius_mm")(wide))
    rim = MicrolensImages(camera, [(radius, 0.0), (-radius, 0.0), (0.0, radius), (0.0, -radius)])
    ahead = design.d_f - max(design.d_3, 53.0)
    assert value == pytest.approx(np.min(np.hypot(*rim.on_plane(ahead))), rel=1e-9)
    seen = FieldImages.of(design.replace({f"{part}.size": [80.0, 80.0] for part in ("sensor", "microlens_array")}))
    slope = radius * (design.d_f / design.d_1) / (design.d_f - design.d_3)
    answer = roslf.evaluate(seen.design).answer
    straight = isinstance(design.stops[0].sides, tuple)
    assert answer.at[0].field.endswith("mm round") != straight
    assert "lit no farther, the sensor spans" in answer.rows[0][2]
    if straight:  # the opening's height ends it first
        assert answer.field_of_view_deg.height == pytest.approx(2 * math.degrees(math.atan(slope)), rel=1e-9)
        assert answer.field_of_view_deg.width > 1.05 * answer.field_of_view_deg.height
    elif "aperture.decentre" not in changes:
        across = 2 * math.degrees(math.atan(slope))
        view = answer.field_of_view_deg
        assert (view.width, view.height, view.diagonal) == pytest.approx([across] * 3, rel=1e-9)
        names = ("field_of_view_width_deg", "field_of_view_height_deg", "field_of_view_deg")
        assert [float(roslf.quantity(name)(wide)) for name in names] == pytest.approx([across] * 3, rel=1e-9)
        object_radius = radius * design.d_f / design.d_1
        for way in ("width", "height", "diagonal"):
            half = float(roslf.quantity(f"field_half_{way}_mm")(wide))
            assert half == pytest.approx(object_radius, rel=1e-9)
            assert getattr(answer.at[0], f"{way}_mm") == pytest.approx(2 * object_radius, rel=1e-9)


def test_a_rim_that_a_real_lens_loses_is_missed_by_what_it_shows():
    """Microlenses one after the other from the axis, until the lens loses the chief ray; farther out it folds."""
    stops = [{"diameter": 4.0, "distance": 53.0}, {"diameter": 16.0, "distance": 18.0}]
    lens = {"part": "AC254-030-A", "focal_plane": 67.5}
    limits = [{"at": 15.0, "min": 4.5}, {"at": 15.0, "min": 3.0}]
    changes = {"main_lens": lens, "aperture": {"diameter": 0.57, "distance": 45.0}, "stops": stops}
    design = roslf.load("paper").replace({**changes, "microlens_array.distance": None})
    missed, met = (
        roslf.evaluate(design.replace({"required": {"round_field_radius_mm": one}})).required[0] for one in limits
    )
    away = np.linspace(0.0, 4.0, 401)
    met_at = np.hypot(*images_of(design, np.column_stack([np.zeros_like(away), away])).on_plane(15.0)).ravel()
    shown = met_at[: np.argmax(np.isnan(met_at))]
    assert np.isnan(met_at).any()
    assert shown[-1] <= missed.value == met.value < shown[-1] + 2 * (shown[-1] - shown[-2])
    assert (missed.met, met.met) == (False, True)
    assert "the lens does not image a rim so wide" in missed.remedy


def test_images_that_a_lens_folds_before_a_rim_cuts_them_are_told_as_folded():
    """One image after the other: whole up to there, folded beyond, though all of the FAP is seen; no rim to widen."""
    lens = {"part": "AC254-030-A", "focal_plane": 67.5}
    changes = {"main_lens": lens, "aperture": {"diameter": 0.57, "distance": 45.0}, "microlens_array.distance": None}
    design = roslf.load("paper").replace(changes)
    beyond = roslf.evaluate(design, fields=[]).real_lens.folded_beyond_mm
    result = roslf.evaluate(design, fields=[(share * beyond, 0.0) for share in (0.5, 0.97, 1.03, 1.2)])
    assert [field.status for field in result.real_lens.fields] == ["full", "full", "folded", "folded"]
    assert result.real_lens.x_ml_max_mm > 1.2 * beyond
    (told,) = (one for one in result.verdicts if one.name == "field_undistorted")
    assert "folds them over" in told.text
    other = result.real_lens.turned_x_ml_max_mm
    assert told.remedy.startswith(f"the other way round the lens sees whole images out to {other:.4g} mm; a better ")
    turned = roslf.evaluate(
        design.replace({"main_lens.reversed": True}), fields=[(share * other, 0.0) for share in (0.5, 0.97, 1.03)]
    )
    assert [field.status == "full" for field in turned.real_lens.fields] == [True, True, False]


def test_studies_hold_it_at_the_microlens_that_sees_it():
    """Light there is cos^4 of the chief ray's angle, which the array's distance alone moves."""
    design = asked(
        'relative_illumination = {field_angle = "20 deg", min = 0.778}\n'
        'u_z_mm = {field_angle = "20 deg", max = 100}\ndetail_lp_per_mm = {field_angle = "20 deg", min = 3}'
    )
    perturb = [{"place": "microlens_array.distance", "tolerance": "30 um", "distribution": "uniform"}]
    data = {"name": "off axis", "design": "", "trials": 300, "sobol_samples": 0, "perturb": perturb}
    study, _, grades = read_study(data, design=design)
    plan = make_plan(study, design, grades)
    light, depth, detail = roslf.evaluate(design).required
    assert (light.met, depth.met, detail.met) == (True, True, False)
    assert plan.question.fields[3] == pytest.approx(light.x_ml_mm, rel=1e-12)
    assert [plan.columns[limit.column].label for limit in plan.limits] == [
        "relative_illumination@3",
        "u_z_at_field_mm@3",
    ]
    result = analyse(plan, study, grades, tally_chunk(plan, 0), budgets=False)
    d_1 = design.d_1 + 0.03 * plan.draws.deviations(plan.draws.uniforms(0, plan.chunk, 0, 300))[0]
    slopes = math.hypot(*light.x_ml_mm) / (design.d_3 + d_1 * (1 - design.d_3 / design.f))
    good = np.mean(np.cos(np.arctan(slopes)) ** 4 >= 0.778)
    assert 0.1 < good < 0.9
    assert share_that_meets(plan, result.final, light).value == good
    assert share_that_meets(plan, result.final, depth) is None  # lengths as built are not in it
    (short,) = (words for words, share in result.short_of if share == 0)  # detail is none of the yield's
    assert short.startswith(detail.label)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ('detail_lp_per_mm = {min = 1, field = "edge", object_height = "1 mm"}', "field and object_height are two"),
        ('outer_diameter_mm = {max = 4, field_angle = "3 deg"}', "is of the whole camera; drop field_angle"),
        ("relative_illumination = {min = 0.3}", "differs from field to field; say where by field"),
        ("u_z_at_field_mm = {max = 1}", "differs from field to field; say where by field"),
        ('kept_fraction = {min = 1, field = "corner", at = "5 mm"}', "the same at all distances; drop at"),
        ('kept_fraction = {min = 1, field_angle = "200 deg"}', "above 0 and below 180 deg"),
    ],
)  # fmt: skip
def test_faults_name_the_key(text, fault):
    with pytest.raises(DesignError, match=fault):
        roslf.evaluate(asked(text))


def test_default_fields_stay_where_no_round_field_is_required():
    plain = loads(PLAIN)
    (_, _), (x, _), (u, v) = default_fields(asked("round_field_of_view_deg = {min = 30}"))
    assert x == pytest.approx(math.hypot(u, v), rel=1e-12)
    assert math.hypot(*default_fields(plain)[2]) > x


@pytest.mark.parametrize("share", [0.25, 0.5, 0.9])
def test_a_share_of_the_field_is_judged_at_its_rim_as_far_towards_the_corner(share):
    design = asked(
        f'relative_illumination = {{field = {share}, min = 0.5}}\nsigma_z_mm = {{field = "{share}", max = 1}}'
    )
    light, depth = roslf.evaluate(design).required
    corner = np.array(default_fields(design)[2])
    assert light.x_ml_mm == depth.x_ml_mm == pytest.approx(tuple(share * corner))
    assert light.value == pytest.approx(math.cos(math.atan(slope(design, share * corner))) ** 4, rel=1e-6)
    assert light.verdict.text.startswith(f"as required: relative illumination at the rim of the middle {share} of")
    near = Camera.of(design)
    error = roslf.quantity("sigma_z_at_field_mm").at_fields(MicrolensImages(near, [share * corner]))
    assert depth.value == pytest.approx(float(np.ravel(error)[0]), rel=1e-9)
    assert loads(dumps(design)).required == design.required
    assert [limit["field"] for limit in limits_for_study(design)] == 2 * [[f"{x!r} mm" for x in light.x_ml_mm]]


def test_depth_at_a_field_is_required_by_either_name():
    place = 'object_height = "3 mm"'
    both = (asked(f"{name} = {{{place}, max = 1}}") for name in ("u_z_mm", "u_z_at_field_mm"))
    one, two = (roslf.evaluate(design).required[0] for design in both)
    assert (one.value, one.x_ml_mm) == (two.value, two.x_ml_mm)
    away = asked(f'u_z_at_field_mm = {{at = "15 mm", {place}, max = 1}}')
    assert limits_for_study(away) == ()


@pytest.mark.parametrize("field", ['"3 mm"', "0", "1", "true", "[1, 2]", "1.5"])
def test_no_place_in_the_field(field):
    with pytest.raises(DesignError, match=r'a share of its half diagonal, as 0\.5 .* is object_height = "5 mm"'):
        asked(f"u_z_mm = {{field = {field}, max = 1}}")


@pytest.mark.parametrize("name", ["rigid-scope", "paper", "cystoscope"])
def test_a_range_of_distances_is_both_its_ends_between_which_no_depth_is_worse(name):
    plain = preset_path(name).read_text()
    focus = float(roslf.quantity("working_distance_mm")(Camera.of(loads(plain))))
    near, far = 0.6 * focus, 2.0 * focus
    text = f'expanded_u_z_mm = {{at = ["{near!r} mm", "{far!r} mm"], max = "1 m"}}'
    ends = roslf.evaluate(asked(text, plain.split("[required]")[0])).required
    assert [one.at_mm for one in ends] == [near, far]
    camera = Camera.of(loads(plain))
    between = [float(roslf.quantity("u_z_mm")(camera, at)) for at in np.linspace(near, far, 41)]
    assert max(between) == pytest.approx(max(one.value for one in ends), rel=1e-6)


def test_no_range():
    for at in ('["1 mm"]', '["1 mm", "2 mm", "3 mm"]'):
        with pytest.raises(DesignError, match=r"required\.u_z_mm\.at: of a range is its two ends"):
            asked(f"u_z_mm = {{at = {at}, max = 1}}")
    with pytest.raises(DesignError, match="has no unit"):
        asked('u_z_mm = {at = ["1 mm", 5], max = 1}')
