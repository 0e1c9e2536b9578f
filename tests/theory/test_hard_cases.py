"""On the way to every singular point, at it, and through every combination of such points."""

from __future__ import annotations

import itertools
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from roslf_design import theory
from studies.accuracy.oracles.closed_forms import ORACLES, flat, judge, keywords
from tests.theory.designs import P1, arguments, random_designs
from tests.theory.test_against_rays import BUDGET, numbers
from tests.theory.walks import WALKS, walk

BASE: dict[str, Any] = next(iter(random_designs(1))) | P1 | {"stop_diameter": 5.0, "stop_distance": 50.0, "exact": True}
BASE |= {"distance": 1000.0, "depth": 90.0, "mla_distance": 140.0}


@pytest.mark.parametrize("kind", WALKS)
def test_budget_holds_up_to_the_last_ulp_before_the_singular_point(kind):
    for name in ORACLES:
        seen = set()
        for design in walk(kind):
            given = arguments(name, design)
            if tuple(given.items()) in seen:
                continue
            seen.add(tuple(given.items()))
            for judged in judge(ORACLES[name], numbers(getattr(theory, name)(**given)), given, BUDGET):
                assert judged.ulps <= BUDGET * (1 + judged.condition), (name, given, judged)


with mp.workdps(60):
    TINY, HUGE = mp.mpf(10) ** -30, mp.mpf(10) ** 30
    LIMITS = {
        "d_3 = f": ("pupil_distance", 100.0, [100 - TINY, 100 + TINY]),
        "d_3 = 0": ("pupil_distance", 0.0, [TINY]),
        "d_3 = d_f": ("pupil_distance", 350.0, [350 - TINY]),
        "d_f = f": ("focal_plane_distance", 100.0, [100 + TINY]),
        "d_f = inf": ("focal_plane_distance", np.inf, [HUGE]),
        "d_1 = f": ("mla_distance", 100.0, [100 + TINY]),
        "d_1 = inf": ("mla_distance", np.inf, [HUGE]),
        "D_F = 0": ("pupil_diameter", 0.0, [TINY]),
        "d_2 = 0": ("sensor_distance", 0.0, [TINY]),
        "Z_F = g": ("depth", 230.0, [230 - TINY, 230 + TINY]),
        "Z_F = 0": ("depth", 0.0, [TINY]),
        "Z_F = inf": ("depth", np.inf, [HUGE]),
        "f_ml = inf": ("microlens_focal_length", np.inf, [HUGE]),
        "X = 0": ("radius", 0.0, [-TINY, TINY]),
        "A = 0": ("effective_image_distance", 0.0, [TINY]),
        "L = inf": ("exit_pupil_vergence", 0.0, [-TINY, TINY]),
        "slope = 0": ("slope", 0.0, [-TINY, TINY]),
        "e_k = 0": ("stop_decentre", (0.0, 0.0), [(TINY, -TINY)]),
    }


@pytest.mark.parametrize("limit", LIMITS)
def test_value_at_a_singular_point_is_the_limit_there(limit):
    key, point, neighbours = LIMITS[limit]
    base = BASE | ({"pupil_distance": 20.0} if limit == "d_f = f" else {})
    for name in ORACLES:
        if key not in keywords(name) or (name, limit) in {("back_substitution_jacobian", "A = 0")}:
            continue  # the Jacobian refuses A = 0: see test_calibration.py
        given = arguments(name, base)
        values = numbers(getattr(theory, name)(**given | {key: point}))
        for neighbour in neighbours:
            for value, nearby in zip(values, flat(ORACLES[name](**given | {key: neighbour})), strict=True):
                check_limit(name, limit, value, nearby)


def check_limit(name, limit, value, nearby):
    where = (name, value, nearby)
    if name.startswith("matched") and limit in {"D_F = 0", "d_2 = 0"}:
        return  # nothing matches without pupil or image, though something does up to there: see test_matched.py
    if isinstance(nearby, bool):
        return  # its length is judged
    if name.startswith("matched") and np.isinf(value):
        assert nearby > 1e20 or nearby < 1e-20, where  # none, or one that vanishes or runs off
    elif abs(nearby) > 1e20:
        assert abs(value) == np.inf, where
    elif abs(nearby) < 1e-20:
        assert abs(value) <= 1e-20, where
    else:
        assert abs(value - nearby) <= 1e-13 * abs(nearby), where


@pytest.mark.parametrize("microlens_pitch", [0.063, 0.127, 1 / 3])
@pytest.mark.parametrize("sensor_distance", [0.5, 2.0, 2.81])
def test_telecentric_image_pitch_is_the_microlens_pitch_to_the_last_bit(microlens_pitch, sensor_distance):
    for f, d_f in [(100.0, 350.0), (1.8, 25.0), (20.1, 20.3), (0.7, np.inf)]:
        assert theory.microlens_image_pitch(microlens_pitch, sensor_distance, f, d_f, f) == microlens_pitch


def test_pitch_crosses_the_telecentric_point_without_a_step():
    f, d_f = 100.0, 350.0
    places = [np.nextafter(f, 0), f, np.nextafter(f, 200)]
    pitch = theory.microlens_image_pitch(0.063, 2.0, f, d_f, places)
    assert np.all(np.abs(pitch - 0.063) <= np.spacing(0.063))
    assert np.all(np.diff(theory.exit_pupil_vergence(f, d_f, places)) < 0)


SPECIAL: dict[str, list[Any]] = {
    "focal_plane_distance": [100.0, float(np.nextafter(100, 200)), 350.0, 1e300, np.inf],
    "pupil_distance": [0.0, 5e-324, 100.0, float(np.nextafter(350, 0)), 350.0],
    "pupil_diameter": [0.0, 1e-300, 2.9],
    "sensor_distance": [0.0, 1e-300, 2.0],
    "depth": [0.0, 1e-300, 230.0, 1e300, np.inf],
    "mla_distance": [100.0, 140.0, np.inf],
    "radius": [0.0, -1e6, 27.0],
    "microlens_focal_length": [2.0, np.inf],
    "effective_image_distance": [0.0, 92.0],
    "magnification": [0.0, 0.4, 1e12],
    "exit_pupil_vergence": [0.0, -0.002, np.inf, -np.inf],
    "pixel": [0.0, 3.0],
    "centre": [0.0, 3.0],
    "coordinate": [0.0, 1.0],
    "slope": [0.0, 0.2],
    "index": [0.0, 7.0],
    "exact": [True, False],
    "disparity_sigma": [0.0, 0.1],
    "field_radius": [0.0, 27.0, np.inf],
    "distance": [1000.0, 1e300],
    "point": [(0.0, 0.0), (3.0, 1.0)],
    "microlens_centre": [(0.0, 0.0), (3.0, 1.0)],
    "stop_decentre": [(0.0, 0.0), (0.1, -0.2)],
    "stop_distance": [0.0, 50.0, 350.0],
}


@pytest.mark.parametrize("name", sorted(ORACLES))
def test_never_nan_and_inf_only_where_documented(name):
    """Every combination of singular points, and no warning from numpy either (warnings are errors here)."""
    function = getattr(theory, name)
    special = SPECIAL | ({"distance": [*SPECIAL["distance"], np.inf]} if name == "nondistortion_bound" else {})
    if name.startswith("back_substitut"):
        special = special | {"magnification": [1e-12, 0.4, 1e12]}
    if name == "back_substitution_jacobian":
        special = special | {"effective_image_distance": [1e-12, 92.0]}
    keys = keywords(name)
    for combination in itertools.product(*[special.get(key, [BASE[key]]) for key in keys]):
        given = dict(zip(keys, combination, strict=True))
        values = np.array(numbers(function(**given)), dtype=float)
        assert not np.isnan(values).any(), given
        if np.isinf(values).any():
            assert "inf" in str(function.__doc__), given


FACTORED = (
    "gap",
    "aperture_constant",
    "inverse_aperture_constant",
    "effective_image_distance",
    "pupil_angle",
    "pupil_f_number",
    "mla_distance",
    "mla_excess",
    "magnification",
    "inverse_magnification",
    "focal_plane_distance",
    "exit_pupil_distance",
    "exit_pupil_vergence",
    "exit_pupil_diameter",
    "microlens_image_diameter",
    "centre_shift_per_microlens",
    "approximate_fill_factor",
    "geometric_views",
    "object_sample",
)


@pytest.mark.parametrize("kind", ["d_3 -> d_f", "d_3 -> f", "d_f -> f", "d_1 -> f", "d_f -> inf", "scale"])
def test_factored_forms_lose_nothing_however_ill_conditioned(kind):
    """Products of exactly taken differences: a dozen half ulps at most, whatever the condition number."""
    for name in FACTORED:
        for design in walk(kind):
            given = arguments(name, design)
            for judged in judge(ORACLES[name], numbers(getattr(theory, name)(**given)), given, enough=8.0):
                assert judged.ulps <= 8, (name, given, judged)


def test_residual_is_good_to_ulps_of_its_smaller_term():
    """f/d_f + f/d_1 - 1 of a focal plane close to the front focus: terms of 1 that cancel to f/d_1."""
    for design in walk("d_f -> f"):
        d_f = design["focal_plane_distance"]
        d_1 = 1.01 * theory.mla_distance(100.0, d_f)
        given = {"focal_length": 100.0, "focal_plane_distance": d_f, "mla_distance": d_1}
        (exact,) = flat(ORACLES["conjugate_residual"](**given))
        assert abs(theory.conjugate_residual(**given) - exact) <= 4 * np.spacing(100.0 / d_1)
