"""Metrics of many builds at once, against one build at a time followed ray by ray."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.design import Design, load
from roslf_design.evaluation import evaluate
from roslf_design.tolerancing.metrics import METRICS, Question, evaluate_builds
from roslf_design.tolerancing.places import load_grades, nominal_values, perturbable
from tests.laws import DEAR
from tests.oracles.tolerance import evaluate_one

EXACT = (
    "image_diameter_mm",
    "image_pitch_mm",
    "fill_factor",
    "mismatch_px",
    "kept_fraction",
    "axis_ratio",
    "centre_error_px",
    "centre_error_x_px",
    "centre_error_y_px",
    "centre_shift_px",
    "depth_error_mm",
)


@pytest.fixture(scope="module")
def bored():
    """The paper's camera behind a narrow bore that clips its outer fields, and a lens that does too."""
    return load("paper").replace(
        {
            "stops": [{"diameter": 19.5, "distance": 60.0}, {"diameter": 7.6, "distance": 105.0}],
            "main_lens.diameter": 37.0,
        }
    )


def random_builds(design, trials, seed, scale=3.0, without=()):
    tolerances = load_grades().tolerances("commercial", design)
    tolerances |= {f"sensor.{pose}": 0.003 for pose in ("tilt.0", "tilt.1")}
    tolerances |= {f"sensor.decentre.{axis}": 0.05 for axis in (0, 1)}
    stream, nominal = np.random.default_rng(seed), nominal_values(design)
    return {
        place: nominal[place] + scale * width * stream.uniform(-1, 1, trials)
        for place, width in tolerances.items()
        if not any(word in place for word in without)
    }


def compare(design, values, field, distance, trials, rows=EXACT, rays=1024):
    question = Question(design, rows, (field,), distance)
    found = dict(zip(rows, evaluate_builds(question, values, trials), strict=True))
    shapes = {"kept_fraction": 1e-5, "axis_ratio": 1e-4}  # of the oracle's edge, sampled in `rays` directions
    for trial in range(trials):
        one = design.replace({place: float(numbers[trial]) for place, numbers in values.items()})
        expected = evaluate_one(one, design, field, distance, rays)
        for name in rows:
            # The oracle's Newton steps and its camera's far coordinates cost about eight digits.
            tolerance = shapes.get(name, 1e-7 * max(1.0, abs(expected[name])))
            assert found[name][trial] == pytest.approx(expected[name], abs=tolerance, nan_ok=True), (name, trial)
    return found


def test_random_builds_equal_one_at_a_time_ray_tracing(bored):
    found = compare(bored, random_builds(bored, 24, 1), (11.15, 7.466), 350.0, 24)
    assert 0 < np.min(found["kept_fraction"]) < 0.9 < np.max(found["kept_fraction"])  # the case clips, more and less


def test_aligned_builds_with_decentres_take_the_exact_discs(bored):
    values = random_builds(bored, 20, 2, without=("tilt",))
    found = compare(bored, values, (11.15, 0.0), 300.0, 20)
    assert np.any(found["kept_fraction"] < 1)


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "ear-speculum", "pipe-bore", "mismatched-borescope"])
def test_presets_on_and_off_axis(name):
    design = load(name)
    half = design.sensor_size[0] / 2
    values = random_builds(design, 4, 3, scale=0.1)
    for field in ((0.0, 0.0), (0.6 * half, 0.0)):
        compare(design, values, field, 0.9 * design.d_f, 4)


def test_room_is_that_of_traced_edge_rays(bored):
    question = Question(bored, ("non_distortion_room_mm",), ((11.15, 7.466),), 350.0)
    decentred = random_builds(bored, 15, 4, without=("tilt",))
    tilted = random_builds(bored, 15, 4)
    # 64 edge rays miss the closest point by up to 1 - cos(pi/64) of the pencil's radius; tilts act in second order.
    for values, slack in ((decentred, 3e-3), (tilted, 6e-3)):
        found = evaluate_builds(question, values, 15)[0]
        for trial in range(15):
            one = bored.replace({place: float(numbers[trial]) for place, numbers in values.items()})
            expected = evaluate_one(one, bored, (11.15, 7.466), 350.0, 64)["non_distortion_room_mm"]
            assert found[trial] == pytest.approx(expected, abs=slack)


@pytest.mark.parametrize("name", ["paper", "paper-mismatched", "rigid-scope", "pipe-bore"])
def test_nominal_values_are_those_of_evaluate(name):
    design = load(name)
    result = evaluate(design)
    grow = result.microlens_image.pitch_mm / design.d
    corner = [
        min(*sides) / 2 for sides in zip(design.microlens_array.size, np.divide(design.sensor_size, grow), strict=True)
    ]
    fields = (*(field.x_ml_mm for field in result.fields), tuple(corner))
    names = tuple(METRICS)
    question = Question(design, names, fields, design.d_f)
    row = dict(zip([column.label for column in question.columns], evaluate_builds(question, {}, 1)[:, 0], strict=True))
    data = result.to_dict()
    image, numbers = data["microlens_image"], data["f_number"]
    expected = {
        "fill_factor@0": numbers["fill_factor"],
        "mismatch_px@1": numbers["mismatch_px"],
        "image_diameter_mm@0": image["diameter_mm"],
        "image_diameter_px@2": image["diameter_px"],
        "image_pitch_mm@0": image["pitch_mm"],
        "centre_shift_px_per_microlens": image["centre_shift_px_per_microlens"],
        "f_number_microlens": numbers["microlens"],
        "f_number_pupil": numbers["pupil"],
        "f_number_main_lens": numbers["main_lens"],
        "disparity_pitches_per_mm": data["depth"]["disparity_pitches_per_mm"],
        "sigma_z_mm": data["depth"]["sigma_z_mm"],
        "views_independent": data["sampling"]["views_independent"],
        "object_sample_mm": data["sampling"]["object_sample_mm"],
        "view_baseline_mm": data["sampling"]["view_baseline_mm"],
        "fresnel_number": data["diffraction"]["fresnel_number"],
        "airy_radius_px": data["diffraction"]["airy_radius_px"],
        "inverse_aperture_constant": data["inverse_aperture_constant"],
        "vergence_at_mla_per_mm": data["exit_pupil"]["vergence_at_mla_per_mm"],
        "non_distortion_room_mm@3": data["non_distortion"]["room_at_corner_mm"],
    }
    for index, field in enumerate(data["fields"]):
        expected[f"kept_fraction@{index}"] = field["kept_fraction"]
        expected[f"image_area_mm2@{index}"] = field["area_mm2"]
        expected[f"axis_ratio@{index}"] = np.nan if field["axis_ratio"] is None else field["axis_ratio"]
        expected[f"depth_error_mm@{index}"] = expected[f"centre_error_px@{index}"] = 0.0
        shift = image["centre_shift_px_per_microlens"] * np.hypot(*field["x_ml_mm"]) / design.d
        expected[f"centre_shift_px@{index}"] = shift
    for label, value in expected.items():
        assert row[label] == pytest.approx(value, rel=1e-10, abs=1e-9, nan_ok=True), label


def test_full_calibration_leaves_nothing_where_nothing_is_tilted():
    design = load("paper")
    values = random_builds(design, 200, 6, without=("tilt",))
    fields = ((0.0, 0.0), (11.15, 0.0), (11.15, 7.466))
    for distance in (280.0, 350.0, 500.0):
        question = Question(design, ("depth_error_mm", "centre_error_px"), fields, distance)
        before = evaluate_builds(question, values, 200)
        after = evaluate_builds(question, values, 200, calibrated=True)
        assert np.abs(before[:3]).max() > 1
        # Millimetres out of hundreds through a fractional linear map; pixels out of thousands.
        assert np.abs(after[:3]).max() < 1e-6
        assert np.abs(after[3:]).max() < 1e-9


def test_what_is_no_design_is_undefined_everywhere_and_nothing_else_is():
    design = load("paper")
    question = Question(design, tuple(METRICS), ((0.0, 0.0), (11.15, 0.0)), 350.0)
    values = {
        "aperture.distance": np.array([120.0, 350.0, 400.0, -1.0, 120.0, 120.0]),
        "sensor.distance": np.array([2.0, 2.0, 2.0, 2.0, -0.1, 2.0]),
        "microlens_array.distance": np.array([140.0, 140.0, 140.0, 140.0, 140.0, 99.0]),
    }
    found = evaluate_builds(question, values, 6)
    cameras = [0, 3]  # a pupil may cross the lens
    assert np.isfinite(found[:, cameras]).all()
    assert np.isnan(np.delete(found, cameras, axis=1)).all()


def test_a_dark_image_keeps_nothing_and_has_no_shape():
    design = load("paper").replace({"stops": [{"diameter": 1.0, "distance": 60.0}]})
    question = Question(design, ("kept_fraction", "axis_ratio", "fill_factor"), ((11.15, 0.0),), 350.0)
    for values in ({"stops.0.distance": np.array([60.0])}, {"stops.0.tilt.0": np.array([0.01])}):
        kept, ratio, fill = evaluate_builds(question, values, 1)[:, 0]
        assert kept == 0
        assert np.isnan(ratio)
        assert fill == pytest.approx(1.00506, rel=1e-3)


@DEAR
@given(st.integers(0, 10**6), st.floats(0.2, 5.0))
def test_scaling_all_lengths_scales_lengths_and_leaves_ratios(seed, factor):
    design = load("paper")
    lengths = {place: kind == "length" for place, kind in perturbable(design).items()}
    values = random_builds(design, 12, seed, scale=1.0)
    grown = Design.make(_scaled(design.model_dump(), factor))
    scaled = {place: numbers * (factor if lengths[place] else 1.0) for place, numbers in values.items()}
    names = ("fill_factor", "kept_fraction", "axis_ratio", "depth_error_mm", "image_diameter_mm", "centre_error_px")
    field = (11.15, 7.466)
    a = evaluate_builds(Question(design, names, (field,), 350.0), values, 12)
    b = evaluate_builds(Question(grown, names, ((factor * field[0], factor * field[1]),), factor * 350.0), scaled, 12)
    units = np.array([1, 1, 1, factor, factor, 1])[:, None]
    np.testing.assert_allclose(b, a * units, rtol=1e-6, atol=1e-7)


def _scaled(data, factor):
    if isinstance(data, dict):
        keep = ("tilt", "rotation", "relay_magnification", "quantum_efficiency", "full_well", "read_noise", "bits")
        keep += ("illuminance", "reflectance", "transmission", "contrast", "prnu", "dsnu", "veil", "view_mismatch")
        return {key: value if key in keep else _scaled(value, factor) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_scaled(value, factor) for value in data]
    return data * factor if isinstance(data, float) else data


@DEAR
@given(st.integers(0, 10**6))
def test_a_build_seen_in_a_mirror(seed):
    design = load("paper").replace({"stops": [{"diameter": 19.5, "distance": 60.0}]})
    values = random_builds(design, 12, seed)
    flipped = ("decentre.0", "tilt.1", "rotation")
    mirrored = {place: -v if place.endswith(flipped) else v for place, v in values.items()}
    names = (
        "fill_factor",
        "kept_fraction",
        "axis_ratio",
        "depth_error_mm",
        "centre_error_px",
        "non_distortion_room_mm",
    )
    a = evaluate_builds(Question(design, names, ((11.15, 7.466),), 350.0), values, 12)
    b = evaluate_builds(Question(design, names, ((-11.15, 7.466),), 350.0), mirrored, 12)
    np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-9)
