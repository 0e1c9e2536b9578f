"""Builds behind a real lens, against one build at a time written out as a design and traced on its own."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roslf_design._arrays import sunflower
from roslf_design.camera import Camera
from roslf_design.design import load, loads, preset_path
from roslf_design.evaluation.field_images import FieldImages, FieldOfView, ObjectField
from roslf_design.evaluation.required import required_of
from roslf_design.evaluation.specification import specification
from roslf_design.fates import ImageFate
from roslf_design.lenses.prescription import first_order
from roslf_design.reporting.story import _run_tolerances
from roslf_design.reporting.tolerance.pages import statements
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.metrics import METRICS, Question, builds_of, evaluate_builds, faults_of
from roslf_design.tolerancing.places import LENS, LENSLETS, load_grades, nominal_values, perturbable
from roslf_design.tolerancing.result import builds_of_analyses, share_that_meets, sobol_samples
from roslf_design.tolerancing.run import WorkerSettings, run_trials, tally_chunk
from roslf_design.tolerancing.study import Adjuster, plan_from, tolerance_plan
from roslf_design.tolerancing.summaries import summarise
from roslf_design.tolerancing.traced import as_built, real_lens_builds
from roslf_design.tolerancing.trials import one_trial
from roslf_design.tolerancing.yields import curve_trials
from roslf_design.traced.camera import camera_of, microlenses
from roslf_design.traced.images import measured_bound, real_field, real_images
from tests.lenses.vector_rays import Rays, trace
from tests.tolerancing.alone import apart
from tests.traced.brute import lit_part

FIELDS = ((0.0, 0.0), (6.0, 0.0), (9.0, -6.0))


def behind(lens, **changes):
    """The paper's bench behind a lens."""
    design = load("paper-singlet")
    return design.replace({"main_lens.prescription": lens, "main_lens.reversed": False, **changes})


DESIGNS = {
    "singlet": behind("LB1630-A"),
    "achromat": behind("AC508-100-A"),
    "reversed": load("paper-singlet"),
    "bore": behind("LB1630-A", **{"main_lens.diameter": 34.0}).replace(
        {"stops": [{"diameter": 20.0, "distance": 60.0}, {"diameter": 7.0, "distance": 105.0}]}
    ),
    "rectangles": behind("LB1630-A").replace(
        {
            "aperture": {"shape": "rectangle", "sides": (2.6, 2.0), "turn": 0.4, "distance": 120.0},
            "stops": [
                {"shape": "rectangle", "sides": (20.0, 15.0), "turn": 0.3, "distance": 60.0},
                {"shape": "rectangle", "sides": (6.0, 5.0), "distance": 105.0, "decentre": (0.2, 0.1)},
            ],
        }
    ),
    "pupil behind": behind("LA1050-A", **{"aperture.distance": -25.0, "aperture.diameter": 4.6}),
    "pupil behind, window": behind("AC508-100-A", **{"aperture.distance": -60.0, "aperture.diameter": 9.0}).replace(
        {
            "elements": [{"kind": "plate", "distance": 40.0, "thickness": 2.0, "material": "sapphire"}],
            "object_space.medium": "water",
            "stops": [{"diameter": 25.0, "distance": 60.0}],
        }
    ),
    "window": behind("LB1630-A", **{"aperture.distance": 115.0}).replace(
        {
            "elements": [
                {"kind": "grin", "distance": 60.0, "thickness": 7.0, "index": 1.6, "gradient": 0.01, "diameter": 40.0},
                {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": "sapphire", "diameter": 4.2},
            ],
            "object_space.medium": "water",
            "stops": [{"diameter": 30.0, "distance": 90.0}],
            "sensor.cover": {"thickness": 0.4, "material": "D263"},
            "microlens_array.substrate": {"thickness": 1.2, "material": "fused silica", "lenslets": "sensor"},
        }
    ),
}


def builds(design, trials, seed, places=None):
    """Every place of a design missed at once, generously."""
    width = {
        "length": 0.1,
        "angle": 2e-3,
        "ratio": 0.0,
        "number": 1e-3,
        "curvature": 1e-5,
        "gradient": 1e-4,
        "form": 1e-4,
    }
    kinds, nominal, stream = perturbable(design), nominal_values(design), np.random.default_rng(seed)
    special = {"sensor.distance": 0.02, "light.wavelength": 2e-6, "microlens_array.pitch": 1e-5, "sensor.pixel": 1e-6}
    special |= {"main_lens.focal_plane": None, "microlens_array.focal_length": 0.01, "microlens_array.sag": 1e-5}
    found = {}
    for place, kind in kinds.items():
        if place.startswith(LENSLETS):  # no part of a design
            continue
        step = special.get(place, width[kind])
        if step is None or (places is not None and not any(word in place for word in places)):
            continue
        found[place] = nominal[place] + step * stream.uniform(-1, 1, trials)
    return found


def one_of(values, trial):
    return {place: float(numbers[trial]) for place, numbers in values.items()}


@pytest.mark.parametrize("name", DESIGNS)
def test_builds_equal_one_at_a_time_tracing(name):
    design = DESIGNS[name]
    count = 2
    values = builds(design, count, 1)
    names = (
        "image_diameter_mm",
        "image_area_mm2",
        "kept_fraction",
        "axis_ratio",
        "centre_error_x_px",
        "centre_error_y_px",
    )
    question = Question(design, names, FIELDS, 350.0)
    rows = evaluate_builds(question, values, count).reshape(len(names), len(FIELDS), count)
    found = dict(zip(names, rows, strict=True))
    nominal = evaluate_builds(question, {}, 1).reshape(len(names), len(FIELDS))
    assert_allclose(nominal[-2:], 0, atol=1e-9)  # the decoder knows the nominal lens
    drawn = real_images(camera_of(design), microlenses(design, FIELDS))
    for trial in range(count):
        one = as_built(design, one_of(values, trial))
        camera = camera_of(one)
        images = real_images(camera, microlenses(one, FIELDS))
        assert_allclose(found["image_diameter_mm"][:, trial], images.diameter, rtol=1e-8)
        for k in range(len(FIELDS)):
            area, ratio, kept = images.area[k], images.axis_ratio[k], images.kept_fraction[k]
            if images.status[k] != ImageFate.FULL:
                points = 6144 if camera.fap.straight else 3072  # corners cost polygons 20/K^2
                area, ratio, kept = lit_part(camera, microlenses(one, FIELDS[k]), points)
            assert found["kept_fraction"][k, trial] == pytest.approx(kept, abs=2e-6)
            assert found["image_area_mm2"][k, trial] == pytest.approx(area, rel=1e-6)
            assert found["axis_ratio"][k, trial] == pytest.approx(ratio, abs=1e-6)
        centre = pixels(one, images.chief)
        index = np.array(FIELDS) / one.d
        believed = pixels(design, drawn.chief) + believed_move(design, index * design.d - FIELDS)
        for axis, key in enumerate(("centre_error_x_px", "centre_error_y_px")):
            # A place between the microlenses of the nominal design is told to second order.
            assert_allclose(found[key][:, trial], (centre - believed)[:, axis], atol=2e-6)


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_builds_are_each_its_own_wherever_their_stops_and_elements_stand(order):
    """Between which elements a build's FAP stands, or behind the lens, is no other build's affair."""
    design = DESIGNS["window"]
    values = {
        "aperture.distance": np.array([115.0, 119.5, 50.0, 85.0, -20.0, 115.0]),
        "elements.1.distance": np.array([118.0, 118.0, 118.0, 118.0, 118.0, 114.0]),
        "stops.0.distance": np.array([90.0, 117.0, 90.0, 55.0, 90.0, 90.0]),
    }
    values = {place: numbers[order] for place, numbers in values.items()}
    names = ("image_diameter_mm", "centre_error_x_px", "blur_pitches", "depth_error_mm", "non_distortion_room_mm")
    question = Question(design, names, FIELDS, 350.0)
    together = evaluate_builds(question, values, 6).reshape(len(names), len(FIELDS), 6)
    for trial in range(6):
        single = {place: numbers[[trial]] for place, numbers in values.items()}
        alone = evaluate_builds(question, single, 1).reshape(len(names), len(FIELDS))
        assert_allclose(together[:, :, trial], alone, rtol=1e-9, atol=1e-12)
        one = as_built(design, one_of(values, trial))
        images = real_images(camera_of(one), microlenses(one, FIELDS))
        assert_allclose(together[0, :, trial], images.diameter, rtol=1e-8)


def pixels(design, chief):
    """Image centres in the sensor's own frame [px]."""
    camera = camera_of(design)
    there = microlenses(design, FIELDS) + chief
    aside = np.subtract(design.sensor.decentre, design.main_lens.decentre)
    assert camera.detector.tilt == design.sensor.tilt
    return (there - aside) / design.q


def believed_move(design, step):
    """How far nominal image centres move with small steps over the array [px]."""
    ends = [real_images(camera_of(design), microlenses(design, np.array(FIELDS) + s * step)) for s in (0.0, 1.0)]
    return (ends[1].chief - ends[0].chief + step) / design.q


def test_twins_of_builds_have_their_lenses_constants():
    design = DESIGNS["achromat"]
    values = builds(design, 5, 2)
    twins = builds_of(Question(design, (), FIELDS, 350.0), values, 5)[0]
    for trial in range(5):
        one = as_built(design, one_of(values, trial))
        own = first_order(one.lens, one.wavelength)
        assert twins.made.lens.power[trial] == pytest.approx(own.power, rel=1e-13)
        assert twins.camera.d_1[trial] == pytest.approx(one.d_1, rel=1e-13)
        assert twins.camera.d_f[trial] == pytest.approx(one.d_f, rel=1e-12)
        assert twins.camera.d_3[trial] == pytest.approx(one.d_3, rel=1e-12)


@pytest.mark.parametrize("name", ["bore", "rectangles"])
def test_the_room_is_what_the_pencil_leaves(name):
    design = DESIGNS[name]
    values = builds(design, 4, 3)
    question = Question(design, ("non_distortion_room_mm", "kept_fraction"), FIELDS, 350.0)
    room, kept = evaluate_builds(question, values, 4).reshape(2, len(FIELDS), 4)
    assert np.array_equal(room >= 0, kept == 1)
    assert np.any(room < 0)
    assert np.any(room > 0)


@pytest.mark.parametrize(
    "aperture",
    [{"diameter": 0.3}, {"shape": "rectangle", "sides": (0.3, 0.18), "turn": 0.5}],
    ids=["disc", "rectangle"],
)
def test_a_thin_lens_in_glass_behaves_as_the_ideal_one(aperture):
    """A lens of long radii and small apertures has hardly any aberration: the thin lens's metrics are its own."""
    design = behind("AC508-150-A", aperture={**aperture, "distance": 120.0})
    field = ((0.4, 0.3),)
    names = ("image_diameter_mm", "image_pitch_mm", "fill_factor", "centre_shift_px", "kept_fraction", "sigma_z_mm")
    names += ("image_area_mm2", "axis_ratio")
    values = builds(design, 4, 4, ("aperture.", "microlens_array", "sensor."))
    real = evaluate_builds(Question(design, names, field, 350.0), values, 4)
    thin = evaluate_builds(Question(design.thin_twin, names, field, 350.0), values, 4)
    assert_allclose(real, thin, rtol=2e-3)


def test_a_calibrated_decoder_measures_affine_errors_away():
    design = DESIGNS["singlet"]
    values = builds(design, 3, 5, ("microlens_array.rotation", "sensor.decentre", "sensor.distance", "pitch"))
    question = Question(design, ("centre_error_px", "depth_error_mm"), FIELDS[:2], 330.0)
    blind, known = (evaluate_builds(question, values, 3, calibrated=on) for on in (False, True))
    assert np.all(np.abs(known[0]) < 1e-2 * np.abs(blind[0]))
    assert np.max(np.abs(known[1])) < 0.1 * np.max(np.abs(blind[1]))
    # On the axis, at the middle of the calibration's depths, a calibrated depth is exact.
    middle = Question(design, ("depth_error_mm",), FIELDS[:1], 350.0)
    assert_allclose(evaluate_builds(middle, values, 3, calibrated=True), 0, atol=1e-6)


def test_depth_errors_are_those_of_the_focal_length_to_first_order():
    """A longer radius lengthens f: decoded depths move on the axis as behind an ideal lens of that f."""
    design = DESIGNS["singlet"]
    place = f"{LENS}surfaces.1.radius"
    radius = nominal_values(design)[place]
    values = {place: radius + np.array([-0.05, 0.05])}
    real = evaluate_builds(Question(design, ("depth_error_mm",), ((0.0, 0.0),), 350.0), values, 2)[0]
    f = 1 / real_lens_builds(design, values, 2).lens.power
    thin = evaluate_builds(
        Question(design.thin_twin, ("depth_error_mm",), ((0.0, 0.0),), 350.0), {"main_lens.focal_length": f}, 2
    )[0]
    # The principal planes move too, and the pencil of 2.9 mm has some spherical aberration.
    assert_allclose(np.diff(real), np.diff(thin), rtol=0.05)


@pytest.mark.parametrize("name", ["bore", "rectangles"])
def test_blur_is_that_of_rays_traced_one_build_at_a_time(name):
    """Against some thousand rays evenly over the FAP of each build, sent one build after the other."""
    design = DESIGNS[name]
    values = builds(design, 3, 7)
    found = evaluate_builds(Question(design, ("blur_pitches",), FIELDS, 340.0), values, 3)
    known = builds_of(Question(design, (), FIELDS, 340.0), {}, 1)[0].known
    for trial in range(3):
        one = as_built(design, one_of(values, trial))
        camera, fap = camera_of(one), camera_of(one).fap
        places = np.concatenate([fap.opening.places(*sunflower(4000)), np.zeros((1, 4000))])
        pupil = np.moveaxis(np.array([fap.x, fap.y, fap.z]) + places.T @ fap.axes, -1, 0)
        # The points stand in the system's frame, which the nominal lens's first vertex counts from.
        shift = [*np.negative(one.main_lens.decentre), 0.0]
        for field, point in enumerate(known.points + shift):
            rays = Rays(pupil, Rays.between(point[:, None], pupil).direction)
            traced = trace(camera.lens, rays, one.wavelength, plane=camera.array.z)
            lit = traced.kept
            for stop in camera.rims[1:]:
                slope = rays.direction[:2] / rays.direction[2]
                where = stop.crossed(rays.position[:2] + slope * (stop.z - rays.position[2]), slope, stop.z)
                lit &= stop.opening.contains(*(where - [[stop.x], [stop.y]]))
            x, y, _ = traced.position
            slope = traced.direction[:2] / traced.direction[2]
            place = camera.array.crossed(np.stack([x, y]), slope, camera.array.z)[:, lit]
            rms = np.sqrt(np.sum(np.var(place, axis=1)))
            # 48 rays and 4000, both cut by rims here and there.
            assert found[field, trial] == pytest.approx(rms / one.d, rel=2e-3 if lit.all() else 0.05)


def test_builds_far_from_the_design_are_those_of_each_alone():
    """As an optimiser has them: other sides and turns of rectangles, from no ray of the design's."""
    design = DESIGNS["rectangles"]
    values = {"aperture.sides.0": np.array([1.5, 3.0]), "aperture.turn": np.array([1.2, -0.3])}
    values |= {"stops.1.sides.1": np.array([4.0, 7.0]), f"{LENS}surfaces.2.radius": np.array([-120.0, -85.0])}
    found = builds_of(Question(design, (), FIELDS, 350.0), values, 2, afresh=True)[0]
    for trial in range(2):
        one = as_built(design, one_of(values, trial))
        for k, place in enumerate(FIELDS):
            area, ratio, kept = lit_part(camera_of(one), microlenses(one, place), 6144)
            assert found.shapes.kept_fraction[k, trial] == pytest.approx(kept, abs=3e-6)
            assert found.shapes.area[k, trial] == pytest.approx(area, rel=3e-6)
            assert found.shapes.axis_ratio[k, trial] == pytest.approx(ratio, abs=3e-6)


def test_studies_give_the_same_bytes_for_any_number_of_workers(tmp_path):
    data = {
        "name": "n",
        "design": "paper-singlet",
        "grade": "high",
        "goals": [{"metric": "kept_fraction", "min": 0.5}, {"metric": "centre_error_px", "max": 1.0}],
        "fields": [["0 mm", "0 mm"], ["9 mm", "0 mm"]],
        "trials": 9000,
        "keep_trials": 5,
    }
    plan = replace(plan_from(data), chunk=8192)
    contents = []
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        run_trials(plan, folder, WorkerSettings(workers))
        contents.append([path.read_bytes() for path in sorted((folder / "chunks").iterdir())])
    assert len(contents[0]) == 2
    assert contents[0] == contents[1]
    design, measured = one_trial(plan, 8500)
    again = evaluate_builds(plan.question, plan.draws.values(measured.deviations), 1)
    assert_allclose(measured.variants[0], again, rtol=1e-12)
    assert real_field(design, [(9.0, 0.0)]).images.kept_fraction[0] == pytest.approx(again[1, 0], abs=1e-9)


def test_builds_of_a_study_are_each_traced_alone():
    data = {
        "name": "n",
        "design": "paper-singlet",
        "grade": "high",
        "goals": [{"metric": "fill_factor", "min": 0.5}],
        "fields": [["0 mm", "0 mm"], ["10 mm", "0 mm"]],
    }
    plan = plan_from(data)
    values = plan.draws.values(plan.draws.deviations(plan.draws.uniforms(0, 64)[:, :3]))
    found = apart(plan.question.design, builds_of(plan.question, values, 3)[0], values)
    assert found.centre_px < 1e-9
    assert found.diameter_share < 1e-8
    assert found.kept_fraction < 1e-6


def test_analyses_take_fewer_builds_where_depth_is_limited_behind_a_real_lens():
    data = {"name": "n", "grade": "high", "trials": 20_000, "goals": [{"quantity": "u_z_mm", "max": 1000}]}
    taken = {}
    for design in ("paper-singlet", "paper"):
        plan, study, grades = tolerance_plan({**data, "design": design})
        adjusted = replace(plan, adjusters=(Adjuster("sensor.distance", 1.0),))
        taken[design] = curve_trials(plan), curve_trials(adjusted), sobol_samples(plan, study)
        assert sobol_samples(plan, study.model_copy(update={"sobol_samples": 0})) == 0
        told = study.model_validate({**data, "design": design, "sobol_samples": 512})
        assert sobol_samples(plan, told) == 512
        assert sum(builds_of_analyses(plan, study, grades)) < (400_000 if plan.dear else 10**7)
    assert taken["paper"] == (16384, 4096, 1024)
    assert taken["paper-singlet"][:2] == (2048, 512)
    assert taken["paper-singlet"][2] in (64, 128, 256)


def test_limits_whose_numbers_are_summed_are_weighed_in_the_time_that_is_left():
    """How far each part may be off is looked for far from nominal, where no series tells depth errors."""
    shares = []
    for goal in ({"quantity": "fill_factor", "min": 0.5}, {"quantity": "u_z_mm", "max": 1000}):
        plan, study, grades = tolerance_plan({"name": "n", "design": "paper", "grade": "high", "goals": [goal]})
        taken = builds_of_analyses(plan, study, grades, budgets=False)
        shares.append(taken[5] / sum(taken))
    assert shares[0] < 0.05 < 0.1 < shares[1] < 0.8


def test_the_undistorted_field_of_builds_begins_at_the_one_that_rays_through_the_nominal_lens_see():
    """The design's own is traced; of builds traced one by one it has the sign and .4 to 1 of the change."""
    moved = {"place": "aperture.distance", "tolerance": "2 mm"}
    data = {"name": "n", "trials": 64, "sobol_samples": 0, "perturb": [moved]}
    data["goals"] = [{"metric": "undistorted_field_mm", "min": 0.5}]
    lens = load("paper-singlet")
    distance = nominal_values(lens)["aperture.distance"]
    builds = distance + np.array([0.0, 2.0, -2.0])
    plan = tolerance_plan({**data, "design": "paper-singlet"})[0]
    own, *told = evaluate_builds(plan.question, {"aperture.distance": builds}, 3)[0]
    nominal, *traced = (measured_bound(as_built(lens, {"aperture.distance": float(d)}))[0] for d in builds)
    assert own == pytest.approx(nominal, rel=1e-9)
    for mine, rays in zip(told, traced, strict=True):
        assert 0.4 < (mine - own) / (rays - nominal) < 1
    for design, behind in (("paper-singlet", True), ("paper", False)):
        result = _run_tolerances({**data, "design": design}, budgets=False)
        assert any("undistorted_field_mm; what wedges" in w for w in result.warnings) == behind
        assert not any("undistorted_field_mm is not traced" in w for w in result.warnings)
        first = next(statements(result)).text  # ahead of all remedies
        assert (
            first.startswith("Undistorted field radius (37.65 nominal) is of rays through the nominal lens")
            == ("non_distortion_room_mm at a field" in first)
            == behind
        )


PLACED = (("decentre", "50 um"), ("tilt", "1 mrad"))


def test_a_study_says_which_misalignments_move_no_number_of_the_whole_camera():
    """A stop's decentre takes undistorted field from both sides alike; no tilt does, and what the sensor sees stays."""
    perturb = [{"place": f"aperture.{kind}.1", "tolerance": size} for kind, size in PLACED]
    data = {"name": "n", "design": "rigid-scope", "trials": 64, "sobol_samples": 0, "perturb": perturb}
    data["goals"] = [{"metric": name, "max": 1000} for name in ("undistorted_field_mm", "field_half_width_mm")]
    result = _run_tolerances(data, budgets=False)
    assert result.sensitivity.plus[0, 0, 0] < 0
    assert [w for w in result.warnings if "moved by no" in w] == [
        "of the whole camera, moved by no decentre here: field_half_width_mm",
        "of the whole camera, moved by no tilt here: undistorted_field_mm, field_half_width_mm",
    ]


def test_a_study_has_at_nominal_what_evaluate_traces():
    """What no rays tell says that it is the thin-lens model's."""
    data = {
        "name": "n",
        "trials": 64,
        "sobol_samples": 0,
        "perturb": [{"place": "sensor.distance", "tolerance": "1 um"}],
    }
    data["goals"] = [
        {"metric": "field_of_view_deg", "min": 60},
        {"metric": "hyperfocal_mm", "max": 1},
        {"metric": "outer_diameter_mm", "max": 1},
        {"metric": "mtf50_lp_per_mm", "at": "200 mm", "min": 1},
    ]
    for design, behind in (("paper-singlet", True), ("paper", False)):
        plan = plan_from({**data, "design": design})
        view, sharp, diameter = plan.nominal_misses()
        sheet = specification(design, 200.0)
        nominal = float(QUANTITIES["hyperfocal_mm"](Camera.of(plan.question.design)))
        assert sharp == "hyperfocal_mm" + f" ({nominal:.4g} of the thin-lens model)" * behind
        assert (view, diameter) == ("field_of_view_deg", "outer_diameter_mm")
        assert plan.of_thin_twins == ("hyperfocal_mm",) * behind
        assert [column.label for column in plan.by_rays] == ["field_of_view_deg", "mtf50_lp_per_mm at 200 mm"] * behind
        values = dict(zip((column.label for column in plan.columns), plan.nominal.tolist(), strict=True))
        assert values["field_of_view_deg"] == pytest.approx(sheet.field_of_view_deg[0].diagonal, rel=1e-12)
        (detail,) = (r for r in sheet.resolution if r.at_mm == 200 and r.image == "refocused" and r.x_ml_mm == (0, 0))
        assert values["mtf50_lp_per_mm at 200 mm"] == pytest.approx(
            detail.mtf50_lp_per_mm, rel=1e-12 if behind else 1e-7
        )


def test_angles_of_builds_are_those_of_each_traced_alone():
    """To a twentieth of what the thin-lens model errs: so many times its own."""
    goals = [{"metric": "field_of_view_deg", "min": 1}, {"metric": "field_half_width_mm", "min": 1}]
    plan = plan_from({"name": "n", "design": "paper-singlet", "grade": "precision", "goals": goals})
    values = plan.draws.values(plan.draws.deviations(plan.draws.uniforms(0, 64)[:, :8]))
    found = evaluate_builds(plan.question, values, 8)
    for build in range(8):
        alone = as_built(plan.question.design, {place: float(numbers[build]) for place, numbers in values.items()})
        ends, focus = FieldImages.of(alone).ends, float(QUANTITIES["working_distance_mm"](Camera.of(alone)))
        traced = FieldOfView.of(ends, None).diagonal, ObjectField.of(ends, focus, "focal plane").width_mm / 2
        for value, own, name in zip(found[:, build], traced, ("field_of_view_deg", "field_half_width_mm"), strict=True):
            thin = float(QUANTITIES[name](Camera.of(alone)))
            assert abs(value - own) < 0.05 * abs(thin - own)


def test_images_partly_out_of_the_lenss_sight_are_those_of_each_build_traced_alone():
    design = DESIGNS["reversed"]
    fields = ((11.0, 7.0), (14.0, 0.0), (17.0, 0.0))
    values = {
        "main_lens.decentre.0": np.array([0.0, 0.3, -0.4]),
        "aperture.diameter": np.array([2.9, 3.2, 6.0]),
        f"{LENS}surfaces.2.radius": np.array([-51.5, -51.2, -51.9]),
    }
    found = evaluate_builds(
        Question(design, ("kept_fraction", "image_area_mm2", "axis_ratio"), fields, 350.0), values, 3
    )
    kept, area, ratio = found.reshape(3, 3, 3)
    for trial in range(3):
        one = as_built(design, {place: float(numbers[trial]) for place, numbers in values.items()})
        assert np.isnan(real_images(camera_of(one), microlenses(one, np.array(fields))).whole_area).all()  # part of it
        for k, place in enumerate(fields):
            told = lit_part(camera_of(one), microlenses(one, np.array(place)), points=12288)
            # The FAP's points run away from each other where the boundary is that rays are lost at.
            assert kept[k, trial] == pytest.approx(told[2], abs=1e-5)
            if told[2] > 0:
                assert area[k, trial] == pytest.approx(told[0], rel=1e-5)
                assert ratio[k, trial] == pytest.approx(told[1], abs=1e-5)
            else:
                assert np.isnan(area[k, trial]) or area[k, trial] == 0
    assert ((kept > 0) & (kept < 1)).sum() >= 6


def test_impossible_builds_are_undefined():
    design = DESIGNS["singlet"]
    place = f"{LENS}surfaces.1.radius"
    values = {place: np.array([-50.0, 101.38, 10.0]), f"{LENS}surfaces.1.thickness": np.array([9.47, 9.47, 9.47])}
    found = evaluate_builds(Question(design, tuple(METRICS), FIELDS, 350.0), values, 3)
    assert np.all(np.isnan(found[:, 0]))
    assert np.all(np.isnan(found[:, 2]))
    assert not np.any(np.isnan(found[:, 1]))
    faults = faults_of(Question(design, tuple(METRICS), FIELDS, 350.0), values, 3)
    assert np.any(list(faults.values()), axis=0).tolist() == [True, False, True]


@pytest.mark.parametrize("grade", ["commercial", "precision", "high"])
def test_grades_cover_a_real_lens(grade):
    design = DESIGNS["achromat"]
    found = load_grades().tolerances(grade, design)
    for what in ("surfaces.1.radius", "surfaces.2.thickness", "surfaces.2.index", "elements.1.wedge.0"):
        assert found[LENS + what] > 0
    # A quarter of 633 nm from peak to valley, twice, and a third of it: coma shared with five modes, and spherical.
    quarter = {"commercial": 2, "precision": 1, "high": 1 / 3}[grade] * 633e-6 / 4
    assert found[f"{LENS}surfaces.2.irregularity.2"] == pytest.approx(quarter / math.sqrt(32 * 6), rel=0.05)
    assert found[f"{LENS}surfaces.2.irregularity.6"] == pytest.approx(quarter / (1.5 * math.sqrt(5)), rel=0.05)
    assert "main_lens.focal_length" not in found
    ideal = load_grades().tolerances(grade, design.thin_twin)
    assert not any(place.startswith(f"{LENS}surfaces") for place in ideal)
    assert "main_lens.focal_length" in ideal


def test_depths_through_a_window_err_as_behind_an_ideal_lens():
    """Thicker, farther, another gradient or liquid: near the axis of a corrected lens as the closed forms have it."""
    design = DESIGNS["window"].replace({"main_lens.prescription": "AC508-100-A", "aperture.diameter": 1.0})
    question = Question(design, ("depth_error_mm",), ((0.0, 0.0), (1.0, 0.0)), 350.0)
    twin = replace(question, design=design.thin_twin)
    values = {
        "elements.1.thickness": np.array([1.5, 1.0, 1.0, 1.0]),
        "elements.1.distance": np.array([118.0, 119.0, 118.0, 118.0]),
        "elements.0.gradient": np.array([0.01, 0.01, 0.0102, 0.01]),
        "object_space.index": nominal_values(design)["object_space.index"] + np.array([0.0, 0.0, 0.0, 0.01]),
    }
    real, ideal = (evaluate_builds(asked, values, 4).reshape(2, 4) for asked in (question, twin))
    assert_allclose(real, ideal, rtol=0.02, atol=2e-3)
    assert np.all(np.abs(ideal[:, [0, 2, 3]]) > 0.05)


def test_blur_through_a_window_is_that_of_the_traced_field():
    design = DESIGNS["window"]
    blur = evaluate_builds(Question(design, ("blur_pitches",), FIELDS, design.d_f), {}, 1)[:, 0]
    # 200 rays there, 48 by Gauss's rule here.
    assert_allclose(blur, real_field(design, FIELDS).maps.blur / design.d, rtol=0.05)


def test_a_yield_of_what_is_required_counts_what_rays_tell(without_views):
    """Required between the thin-lens model's angle and the traced one: every build has it, none by the former."""
    design = load("paper-singlet")
    thin = float(QUANTITIES["field_of_view_deg"](Camera.of(design)))
    traced = specification(design).field_of_view_deg[0].diagonal
    asked = f"[required]\nfield_of_view_deg = {{min = {(thin + traced) / 2!r}}}\n"
    design = loads(f"{preset_path('paper-singlet').read_text()}\n{asked}")
    moved = {"place": "sensor.distance", "tolerance": "1 um"}
    data = {"name": "n", "design": "d", "perturb": [moved], "goals": [{"metric": "fill_factor", "min": 0.5}]}
    plan, *_ = tolerance_plan({**data, "trials": 64}, design)
    (one,) = required_of(design)
    held = share_that_meets(plan, summarise(plan, tally_chunk(plan, 0))[-1], one)
    assert (one.met, held.value) == (True, 1.0)
