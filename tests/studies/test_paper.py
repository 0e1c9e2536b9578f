"""The study of the paper's numbers: what it computes, by exact fractions, and the verdicts that follow."""

from __future__ import annotations

from fractions import Fraction

import pytest

from studies.paper.study import Row, main, rows

BY_HAND = {
    "microlens f-number": (Fraction(2000, 63), "agrees"),
    "pupil f-number d_1": (Fraction(920, 29), "agrees"),
    "image fill": (Fraction(29, 460) / (Fraction(63, 1000) * (1 - Fraction(2, 460))), "not given"),
    "main-lens f-number": (Fraction(1400, 508), "agrees"),
    "pupil f-number with": (Fraction(1320, 29), "agrees"),
    "non-distortion bound": (Fraction(350, 2) * (Fraction(479, 1200) - Fraction(508, 3500)), "agrees"),
    "field of view": (Fraction(23 * 5, 2), "misread"),
    "pixel pitch": (Fraction(22300, 4600), "disagrees"),
    "microlens image across": (Fraction(29000, 460) * Fraction(4600, 22300), "agrees"),
    "calibrated d_1": (Fraction(142), "agrees"),
    "calibrated d_f": (Fraction(14200, 42), "agrees"),
    "calibrated H": (Fraction(14200, 9109), "agrees"),
    "calibrated d_3": (100 + Fraction(891, 42), "agrees"),
    "m of Table 2": (Fraction(42, 100), "misread"),
    "Airy radius": (Fraction(122, 100) * Fraction(550, 1000) * Fraction(2000, 63), "not given"),
    "Fresnel number": (Fraction(63 * 63, 4 * 550 * 2), "not given"),
    "independent views": (Fraction(63 * 63, 550 * 2), "not given"),
}


def test_all_rows_are_known():
    quantities = [row.quantity for row in rows()]
    assert len(quantities) == len(BY_HAND)
    assert all(quantity.startswith(start) for quantity, start in zip(quantities, BY_HAND, strict=True))


@pytest.mark.parametrize("start", BY_HAND)
def test_row_has_the_value_and_verdict_of_a_computation_by_hand(start):
    value, verdict = BY_HAND[start]
    (row,) = [row for row in rows() if row.quantity.startswith(start)]
    assert row.value == pytest.approx(float(value), rel=2e-7)  # the design file's pixel has seven digits
    assert row.verdict == verdict
    assert row.reason or row.verdict == "agrees"


def test_verdict_follows_from_the_printed_digits():
    assert Row("x", "2.76", 2.7559, "", "").verdict == "agrees"
    assert Row("x", "2.75", 2.7559, "", "").verdict == "disagrees"
    assert Row("x", "2.76", 2.7559, "", "", misread=True).verdict == "misread"
    assert Row("x", "", 2.7559, "", "").verdict == "not given"


def test_reasons_are_what_the_numbers_say():
    field = next(row for row in rows() if row.quantity.startswith("field"))
    assert "half width 28.75 mm, corner 40.66 mm, inside the bound" in field.reason
    overlap = next(row for row in rows() if row.quantity.startswith("image fill"))
    assert "overlap by 0.065 px" in overlap.reason


def test_runs_as_a_script(capsys):
    main()
    said = capsys.readouterr()
    assert "10 agrees, 1 disagrees, 2 misread, 4 not given" in said.out
    assert said.err == ""
