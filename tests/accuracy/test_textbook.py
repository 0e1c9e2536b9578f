"""Textbook formulas at 60 digits against rays traced at 60 digits: two derivations, one number."""

import mpmath as mp
import pytest

from roslf_design.accuracy import textbook, textbook_scene
from roslf_design.accuracy.digits import DIGITS, exactly, flat
from studies.accuracy.oracles.closed_forms import ORACLES, keywords
from tests.theory.designs import arguments, random_designs

DESIGNS = tuple(random_designs(60, seed=7))


def test_every_closed_form_has_its_textbook_formula():
    assert set(textbook.formulas()) == set(ORACLES)
    for name in ORACLES:
        assert textbook.keywords(name) == keywords(name), name


@pytest.mark.parametrize("name", sorted(ORACLES))
def test_textbook_formula_is_the_traced_one(name):
    function = textbook.exact(name)
    for design in DESIGNS:
        given = arguments(name, design)
        singular = given.get("pupil_distance") in (0.0, given.get("focal_length"), given.get("focal_plane_distance"))
        if singular:
            continue  # 0/0 in the textbook: the limits are tests/theory's part
        with mp.workdps(DIGITS):
            formula = flat(function(**{key: exactly(value) for key, value in given.items()}))
            for one, other in zip(formula, flat(ORACLES[name](**given)), strict=True):
                if isinstance(one, bool) or mp.isinf(other):
                    assert one == other, given
                else:
                    # Differences of equal terms: 25 digits are left where gaps are 1e-15 of their lengths.
                    assert abs(one - other) <= mp.mpf(10) ** -22 * abs(other) + mp.mpf(10) ** -40, given


def test_overlap_of_discs_is_the_area_between_slices():
    from studies.accuracy.oracles.discs import area

    for r, R, d in [(2.2, 25.4, 27.0), (2.2, 25.4, 23.5), (1.0, 1.0, 0.5), (3.0, 2.0, 4.9)]:
        with mp.workdps(40):
            sliced = area([[0.0, 0.0], [d, 0.0]], [r, R], digits=40)
            assert abs(textbook_scene.overlap(mp, *exactly((r, R, d))) - sliced) < mp.mpf(10) ** -28
