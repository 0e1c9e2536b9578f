"""Every scalar closed form against rays traced at 60 digits, in ulps, next to its condition number."""

from __future__ import annotations

import inspect

import mpmath as mp
import numpy as np
import pytest

from roslf_design import theory
from studies.accuracy.oracles.closed_forms import ORACLES, flat, judge
from tests.theory.designs import P1, arguments, random_designs

BUDGET = 4.0
"""Ulps per (1 + condition number): a chain of up to a dozen roundings, each counted in its own argument's condition."""

DESIGNS = tuple(random_designs(200))

MATRICES = {  # judged in test_projection.py and test_calibration.py
    "pupil_frame",
    "view_projection",
    "microlens_projection",
    "light_field_projection",
    "light_field_reconstruction",
    "ray_matrix",
    "decoding_matrix",
    "project",
    "from_homogeneous",
    "back_substitution_covariance",
}
NOT_NUMBERS = {"conjugates", "is_telecentric"}


def numbers(result):
    """Numbers of a closed form's result, as its oracle orders them."""
    if isinstance(result, tuple):
        return [part for item in result for part in numbers(item)]
    return list(np.ravel(result))


def test_every_public_function_has_an_oracle():
    public = {name for name in theory.__all__ if inspect.isfunction(getattr(theory, name))}
    assert public - MATRICES - NOT_NUMBERS == set(ORACLES)


@pytest.mark.parametrize("name", sorted(ORACLES))
def test_200_random_designs_within_budget(name):
    function = getattr(theory, name)
    for design in DESIGNS:
        given = arguments(name, design)
        for judged in judge(ORACLES[name], numbers(function(**given)), given, BUDGET):
            assert judged.ulps <= BUDGET * (1 + judged.condition), (given, judged)


@pytest.mark.parametrize("name", sorted(ORACLES))
def test_batched_is_scalar_to_the_last_bit(name):
    function = getattr(theory, name)
    given = [arguments(name, design) | {"exact": True} for design in DESIGNS[:20]]
    if "exact" not in arguments(name, DESIGNS[0]):
        given = [arguments(name, design) for design in DESIGNS[:20]]
    batch = {key: True if key == "exact" else np.array([one[key] for one in given]) for key in given[0]}
    together = function(**batch)
    fields = together if isinstance(together, tuple) else (together,)
    for i, one in enumerate(given):
        assert numbers(function(**one)) == numbers(tuple(field[i] for field in fields))


@pytest.mark.parametrize("name", sorted(set(ORACLES) - {"stop_disc", "back_substitution_jacobian"}))
def test_scalars_in_numpy_scalars_out(name):
    result = getattr(theory, name)(**arguments(name, DESIGNS[0]))
    for value in result if isinstance(result, tuple) else (result,):
        assert isinstance(value, np.float64 | np.bool_)


def test_float32_is_taken_as_what_it_is():
    name = "microlens_image_pitch"
    narrow = {key: np.float32(value) for key, value in P1.items() if key in arguments(name, DESIGNS[0])}
    wide = {key: float(value) for key, value in narrow.items()}
    assert theory.microlens_image_pitch(**narrow) == theory.microlens_image_pitch(**wide)


def test_oracle_traces_the_papers_camera():
    """The oracles themselves, against numbers computed by hand from the paper's lengths."""
    by_hand = {
        "mla_distance": (140, 1),
        "aperture_constant": (35, 23),
        "exit_pupil_distance": (600, 1),
        "exit_pupil_vergence": (-1, 460),
        "effective_image_distance": (92, 1),
    }
    with mp.workdps(60):
        for name, (numerator, denominator) in by_hand.items():
            (traced,) = flat(ORACLES[name](**arguments(name, P1)))
            assert abs(traced * denominator - numerator) < mp.mpf(10) ** -50
