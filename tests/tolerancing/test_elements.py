"""Tolerances of elements before the lens: builds against `evaluate` of each alone, and rays through every face."""

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import Design, dumps, loads
from roslf_design.errors import InputError
from roslf_design.evaluation.fields import evaluate_fields
from roslf_design.theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.tolerancing.metrics import Question, builds_of, design_built, evaluate_builds
from roslf_design.tolerancing.places import display, expand, load_grades, nominal_values, perturbable, short_name
from roslf_design.tolerancing.sensitivities import sensitivity
from roslf_design.tolerancing.study import plan_from, tolerance_plan
from roslf_design.tolerancing.trials import differences, measure, one_trial
from tests.oracles.object_space import object_side

WATER = {"index": 1.333, "abbe": 55.8}
FIELDS = ((0.0, 0.0), (11.0, 0.0), (11.0, 7.0))
METRICS = ("fill_factor", "kept_fraction", "centre_error_px", "depth_error_mm")


@pytest.fixture(scope="module")
def scope():
    """A lens, a prism and a window in the bore before water, glass on both sides of the array."""
    return roslf.load("paper").replace(
        {
            "aperture.distance": 117.0,
            "elements": [
                {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": "N-BK7", "diameter": 4.2},
                {"kind": "lens", "distance": 60.0, "focal_length": 300.0, "diameter": 20.0},
                {"kind": "prism", "distance": 80.0, "thickness": 20.0, "material": {"index": 1.6}, "diameter": 15.0},
            ],
            "object_space.medium": WATER,
            "microlens_array.substrate": {"thickness": 0.5, "material": {"index": 1.46}},
            "sensor.cover": {"thickness": 0.4, "material": "N-BK7"},
        }
    )


def builds_with(design, trials, seed, without=(), scale=1.0):
    stream, nominal = np.random.default_rng(seed), nominal_values(design)
    return {
        place: nominal[place] + scale * width * stream.uniform(-1, 1, trials)
        for place, width in load_grades().tolerances("commercial", design).items()
        if not any(word in place for word in without)
    }


def test_builds_are_what_evaluate_says_of_each_alone(scope):
    values = builds_with(scope, 6, 5)
    names = ("image_diameter_mm", "image_pitch_mm", "kept_fraction", "axis_ratio")
    found = evaluate_builds(Question(scope, names, FIELDS, scope.d_f), values, 6).reshape(len(names), len(FIELDS), 6)
    assert found[2].min() < 0.99  # elements cut
    for trial in range(6):
        one = evaluate_fields(scope.replace({place: number[trial] for place, number in values.items()}), FIELDS)
        assert_allclose(found[2, :, trial], [field.kept_fraction for field in one], rtol=1e-9)
        assert_allclose(found[3, :, trial], [field.axis_ratio for field in one], rtol=1e-9)
    straight = builds_with(scope, 3, 6, without=("tilt", "rotation"))
    found = evaluate_builds(Question(scope, names, FIELDS, scope.d_f), straight, 3).reshape(len(names), len(FIELDS), 3)
    for trial in range(3):
        one = Camera.of(scope.replace({place: number[trial] for place, number in straight.items()}))
        assert_allclose(found[0, :, trial], float(microlens_image_diameter(one)), rtol=1e-9)
        assert_allclose(found[1, :, trial], abs(float(microlens_image_pitch(one))), rtol=1e-9)


class Traced:
    """One straight camera in mpmath, in the plane of the x axis; every face of glass a refraction."""

    def __init__(self, design: Design):
        self.design = design
        every = sorted(design.elements, key=lambda element: element.distance)
        self.elements = [
            ("lens", e.distance, e.focal_length, e.decentre[0])
            if e.kind == "lens"
            else ("plate", e.distance, e.thickness, float(e.material.index(design.wavelength)))
            for e in every
        ]
        self.medium = float(design.object_space.medium.index(design.wavelength))

    def before(self, height, slope, z):
        return object_side(height, slope, self.elements, self.medium, [z])[0]

    def ray(self, met):
        """Height and slope before the main lens of the ray that meets some planes at some heights, {z: x}."""
        (z, x), (w, y) = met.items()
        one, two = (
            [self.before(0, 0, at), self.before(1, 0, at) - self.before(0, 0, at), self.before(0, 1, at)]
            for at in (z, w)
        )
        two[2], one[2] = two[2] - two[0], one[2] - one[0]
        solved = mp.lu_solve(mp.matrix([one[1:], two[1:]]), mp.matrix([x - one[0], y - two[0]]))
        return solved[0], solved[1]

    def behind(self, height, slope):
        """Where it meets array and sensor."""
        d = self.design
        slope = slope - height / mp.mpf(d.f)
        place = height + slope * mp.mpf(d.d_1)
        x, left = place, mp.mpf(d.d_2)
        for glass in (d.microlens_array.substrate, d.sensor.cover):
            inside = slope / mp.mpf(float(glass.material.index(d.wavelength)))
            x, left = x + inside * mp.mpf(glass.thickness), left - mp.mpf(glass.thickness)
        return place, x + slope * left

    def chief(self, c):
        """Ray, before the lens, of the microlens at c through the FAP's centre; where it meets the sensor."""
        fap = {self.design.d_3: self.design.aperture.decentre[0]}
        far = self.design.d_3 - 1  # any second plane
        ends = [self.ray(fap | {far: mp.mpf(at)}) for at in (0, 1)]
        u, v = (self.behind(*end)[0] for end in ends)
        share = (c - u) / (v - u)
        ray = tuple(a + share * (b - a) for a, b in zip(*ends, strict=True))
        return ray, self.behind(*ray)[1]

    def slope(self, x, z, believed):
        """Microlenses per pixel between an object point's rays through the FAP's two ends."""
        d, ends = self.design, []
        for sign in (1, -1):
            at = mp.mpf(d.aperture.decentre[0]) + sign * mp.mpf(d.D_F) / 2
            place, on_sensor = self.behind(*self.ray({d.d_3: at, z: x}))
            ends.append((place / mp.mpf(d.d), on_sensor / mp.mpf(d.q) - believed * place / mp.mpf(d.d)))
        return (ends[0][0] - ends[1][0]) / (ends[0][1] - ends[1][1])


@pytest.mark.parametrize("ahead", [1.0, 1.3])
def test_depth_errors_are_those_of_rays_through_every_face(scope, ahead):
    """A decoder that believes in the nominal camera: the depth that has the slope there, found by tracing."""
    tip = 119.0
    distance, c, trials = tip + ahead * (scope.d_f - tip), 7.0, 6
    values = builds_with(scope, trials, 8, without=("tilt", "rotation", "decentre.1", "wedge", "main_lens.decentre"))
    found = evaluate_builds(Question(scope, ("depth_error_mm",), ((c, 0.0),), distance), values, trials)[0]
    with mp.workdps(40):
        nominal = Traced(scope)
        ray, on_sensor = nominal.chief(mp.mpf(c))
        point, believed = nominal.before(*ray, distance), on_sensor / mp.mpf(scope.q) / (mp.mpf(c) / mp.mpf(scope.d))
        assert abs(nominal.slope(point, distance, believed)) > 0
        for trial in range(trials):
            one = Traced(scope.replace({place: float(number[trial]) for place, number in values.items()}))
            seen = one.slope(point, distance, believed)
            depth = mp.findroot(lambda z, seen=seen: nominal.slope(0, z, believed) - seen, (distance, distance + 1))
            assert found[trial] == pytest.approx(float(depth - distance), abs=1e-6)
    assert np.max(np.abs(found)) > 0.1


def test_calibration_through_glass_leaves_nothing_where_nothing_is_tilted(scope):
    values = builds_with(scope, 50, 9, without=("tilt",))
    question = Question(scope, ("depth_error_mm",), FIELDS, 1.1 * scope.d_f)
    as_built, calibrated = (evaluate_builds(question, values, 50, calibrated=c) for c in (False, True))
    assert np.max(np.abs(calibrated)) < 1e-7
    assert np.median(np.abs(as_built)) > 0.1
    assert np.max(np.abs(evaluate_builds(question, {}, 1))) < 1e-9


def test_an_index_missed_alone_is_the_error_of_depth_that_it_makes(scope):
    """In liquid before flat glass a point at z means (z - tip) n_believed/n_true + tip, whatever else."""
    plates = scope.replace({"elements": [scope.elements[0]]})
    tip, z = 119.0, 250.0
    found = evaluate_builds(
        Question(plates, ("depth_error_mm",), FIELDS[:1], z), {"object_space.index": np.array([1.333 + 0.01])}, 1
    )
    n = float(plates.object_space.medium.index(plates.wavelength))
    assert found[0, 0] == pytest.approx((z - tip) * (n / 1.343 - 1), rel=1e-9)


def test_any_build_is_a_design_file(scope):
    values = {place: float(number[0]) for place, number in builds_with(scope, 1, 12).items()}
    again = loads(dumps(scope.replace(values)))
    camera, built = Camera.of(again), Camera.of(scope, values)
    for place, number in built.numbers.items():
        assert camera[place] == pytest.approx(float(number), rel=1e-12), place
    assert again.elements[0].material.index(5e-4) == values["elements.0.index"]


def test_the_worst_of_a_study_loads_again(scope):
    plan, *_ = tolerance_plan(
        {
            "name": "window",
            "design": "",
            "grade": "precision",
            "trials": 64,
            "goals": [{"metric": "depth_error_mm", "max": 1.0}],
            "perturb": [{"place": ["elements.*.index", "elements.*.wedge"], "distribution": "uniform"}],
        },
        scope,
    )
    design, measured = one_trial(plan, 3)
    camera = Camera.of(loads(dumps(design)))
    alone = Question(scope, plan.question.metrics, plan.question.fields, plan.question.object_distance)
    values = {place: np.array([camera[place]]) for place in expand_all(scope)}
    assert_allclose(evaluate_builds(alone, values, 1)[:, 0], measured.variants[0, :, 0], rtol=1e-6)


@pytest.mark.parametrize("wide_end", [None, 18.0], ids=["straight", "cone"])
def test_a_build_whose_own_bore_came_out_wide_is_a_design_file_with_a_thinner_wall(wide_end):
    """At the cone's wide end, 60 mm behind its tip, the wall leaves 18 - 2 * 1 = 16 mm, else 10 mm."""
    tube = {"outer_diameter": 12.0, "wall": 1.0, "length": 60.0} | ({"proximal_diameter": wide_end} if wide_end else {})
    own = 10.0 if wide_end is None else 16.0
    stops = [{"distance": 60.0, "diameter": own, "bore": True}]
    design = roslf.load("paper").replace({"tube": tube, "stops": stops})
    for wider in (-0.04, 0.0, 0.037315):
        built = design_built(design, {"stops.0.diameter": own + wider, "stops.0.decentre.0": 0.1})
        again = loads(dumps(built))
        assert again.stops[0].diameter == own + wider
        assert again.stops[0].bore
        assert again.tube.outer_diameter == 12.0
        assert again.tube.wall == pytest.approx(1.0 - max(wider, 0.0) / 2, abs=1e-12)


def expand_all(design):
    known = Camera.of(design).numbers
    return [place for place in perturbable(design) if place in known and place != "main_lens.focal_plane"]


def test_kinds_names_and_patterns(scope):
    kinds = perturbable(scope)
    assert kinds["elements.0.index"] == kinds["object_space.index"] == kinds["sensor.cover.index"] == "number"
    assert kinds["elements.0.wedge.1"] == "angle"
    assert kinds["elements.1.focal_length"] == kinds["microlens_array.substrate.thickness"] == "length"
    assert expand(scope, "elements.*.thickness") == ("elements.0.thickness", "elements.2.thickness")
    assert expand(scope, "elements.2.wedge") == ("elements.2.wedge.0", "elements.2.wedge.1")
    names = {
        "elements.0.wedge.0": "plate 1 wedge x",
        "elements.2.thickness": "prism 3 thickness",
        "sensor.cover.thickness": "cover thickness",
        "microlens_array.substrate.index": "substrate index",
        "object_space.index": "medium index",
    }
    assert {place: short_name(place, scope) for place in names} == names
    rod = roslf.load("paper").replace(
        {"elements": [{"kind": "grin", "distance": 118.0, "thickness": 4.0, "index": 1.6, "gradient": 0.2}],
         "aperture.distance": 117.0, "main_lens.focal_plane": 300.0}
    )  # fmt: skip
    assert perturbable(rod)["elements.0.gradient"] == "gradient"
    assert display(0.002, "gradient") == "0.002 /mm"
    assert "object_space.index" not in load_grades().tolerances("high", rod)  # air


def test_what_cannot_be_missed_is_told(scope):
    for place, said in (("elements.1.wedge", "did you mean"), ("elements.7.thickness", "did you mean")):
        with pytest.raises(ValueError, match=said):
            expand(scope, place)
    with pytest.raises(ValueError, match="is not a number of this design that a build can miss"):
        expand(roslf.load("paper"), "elements.*.thickness")
    study = {"name": "s", "design": "", "goals": [{"metric": "fill_factor", "max": 1.1}], "grade": "high"}
    with pytest.raises(InputError, match=r"object_distance: 118.5 mm lies within the bore \(its farthest element"):
        tolerance_plan({**study, "object_distance": "118.5 mm"}, scope)
    with pytest.raises(InputError, match="has no tolerance and the grade 'high' does not cover it"):
        plan_from({**study, "design": "paper", "perturb": [{"place": "main_lens.focal_plane"}]})


def test_a_build_is_a_camera_where_its_numbers_are_a_design(scope):
    """Elements in one another, stops in glass, an index below 1."""
    for place, good, bad in (
        ("elements.0.distance", 117.5, 116.5),
        ("elements.2.distance", 61.0, 59.0),
        ("aperture.distance", 118.0, 118.5),
        ("elements.0.index", 1.0, 0.999),
        ("elements.0.thickness", 0.1, 1000.0),
    ):
        assert Camera.of(scope, {place: np.array([good, bad])}).valid.tolist() == [True, False], place
        scope.replace({place: good})
        with pytest.raises(InputError):
            scope.replace({place: bad})


@pytest.mark.parametrize("tilt", [0.0005, 0.01, 0.05])
def test_rims_far_off_the_light_are_left_out_without_a_trace(scope, monkeypatch, tilt):
    """Rims from those that cut to those that never do, up to tilts far beyond any grade: the same to the last bit."""
    trials, left_out = 300, []
    stream = np.random.default_rng(4)
    parts = ("main_lens", "microlens_array", "sensor", "aperture", "elements.0", "elements.2")
    values = builds_with(scope, trials, 4, without=("tilt",)) | {
        f"{part}.tilt.{axis}": stream.uniform(-tilt, tilt, trials) for part in parts for axis in (0, 1)
    }
    for wider in (1.0, 1.1, 1.25, 1.5, 2.0, 3.0):
        sizes = {f"elements.{k}.diameter": wider * scope.elements[k].diameter for k in range(3)}
        wide = scope.replace(sizes)
        own = values | {place: values[place] + size - size / wider for place, size in sizes.items()}
        builds, _ = builds_of(Question(wide, METRICS, FIELDS, wide.d_f), own, trials)
        left_out.append(sum(builds._clear))
        found = builds.shapes
        with monkeypatch.context() as patch:
            patch.setattr(MicrolensImages, "_clear", (False,) * len(builds._clear))
            every = MicrolensImages(builds.camera, FIELDS).shapes
        for name in ("area", "centroid", "second_moments", "kept_fraction", "status"):
            assert_array_equal(getattr(found, name), getattr(every, name))
    assert left_out[0] < 6
    assert max(left_out) >= 3


def test_exact_derivatives_through_glass(scope):
    plan, *_ = tolerance_plan(
        {
            "name": "d",
            "design": "",
            "grade": "precision",
            "goals": [{"metric": "fill_factor", "max": 2.0}],
            "report": ["sigma_z_mm"],
        },
        scope,
    )
    exact = sensitivity(plan).exact
    steps = [(p.place, 1e-3 * p.tolerance) for p in plan.draws.perturbations]
    near = differences(plan, steps)
    for row, column in enumerate(plan.columns):
        for k, p in enumerate(plan.draws.perturbations):
            if np.isfinite(exact[row, k]):
                scale = np.max(np.abs(near[row]))
                assert exact[row, k] == pytest.approx(near[row, k], rel=1e-5, abs=1e-8 * scale), (column.label, p.place)
    thickness = [p.place for p in plan.draws.perturbations].index("elements.0.thickness")
    assert np.isfinite(exact[:, thickness]).any()


def test_builds_of_a_relay_that_focus_on_nothing_are_focused_where_an_adjuster_reaches():
    """An ocular some tenths of a millimetre off puts the plane in focus beyond infinity; the array brings it back."""
    plan = plan_from(
        {
            "name": "relay",
            "design": "cystoscope",
            "trials": 64,
            "goals": [{"metric": "blur_pitches", "max": 1.0, "fields": [0]}],
            "perturb": [{"place": "elements.0.distance", "tolerance": "0.4 mm", "distribution": "uniform"}],
            "compensators": [{"place": "microlens_array.distance", "range": "5 mm"}],
        }
    )
    off = np.linspace(-1.0, 1.0, 11)
    measured = measure(plan, off[None])
    assert np.isnan(measured.variants[0]).all(axis=0).sum() > 3
    assert not np.isnan(measured.variants[-1]).any()
    # To first order the array follows by (50/16)^2: light between ocular and main lens is all but parallel.
    assert_allclose(measured.moved[0], (50 / 16) ** 2 * 0.4 * off, atol=0.6)
    assert np.nanmax(measured.variants[-1]) < 1e-2
