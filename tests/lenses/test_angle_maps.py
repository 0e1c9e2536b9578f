"""Mappings of angles: f tan in closed form, and the same given as a table to an objective's law."""

import math

import mpmath
import numpy as np
import pytest

from roslf_design.bore.mapping import MappingTable, angle_map
from roslf_design.lenses.angles import F_TAN

ANGLES = np.linspace(0.0, 1.2, 240)
TABLE = angle_map(MappingTable(angles=tuple(ANGLES), heights=tuple(np.tan(ANGLES))), 1.0)
NAMED = {
    "f theta": (lambda angle: angle, lambda a: mpmath.sin(a) * mpmath.cos(a) / a),
    "f sin": (mpmath.sin, lambda a: mpmath.mpf(1)),
    "2f tan(theta/2)": (lambda a: 2 * mpmath.tan(a / 2), lambda a: mpmath.cos(a) * mpmath.cos(a / 2) ** 4),
}


@pytest.mark.parametrize("slope", [0.01, 0.3, 1.0, 2.0])
def test_a_table_of_tangents_is_f_tan(slope):
    assert TABLE.bends
    assert not F_TAN.bends
    for answer in ("angle", "light"):
        assert float(getattr(TABLE, answer)(np.array(slope))) == pytest.approx(getattr(F_TAN, answer)(slope), rel=1e-6)
    assert TABLE.loss(slope) == pytest.approx(F_TAN.loss(slope), rel=1e-5)
    for medium in (1.0, 1.33):
        for answer in ("stretch", "stretch_along"):  # in a medium f tan is bent by its flat face
            angle = math.atan(slope)
            true = math.tan(math.asin(math.sin(angle) / medium)) / (slope / medium)
            if answer == "stretch":
                assert float(TABLE.stretch(np.array(slope), medium)) == pytest.approx(true, rel=1e-6)
            elif medium == 1:
                assert float(TABLE.stretch_along(np.array(slope), medium)) == pytest.approx(1.0, rel=1e-4)
    row, other = np.ones(3), np.ones(3)
    squares = np.array([0.0, 0.2, slope**2])
    F_TAN.dim(row, 0.0, squares)
    TABLE.dim(other, 0.0, squares)
    assert row == pytest.approx(other, rel=1e-6)


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("angle", [0.05, 0.6, 1.3])
def test_laws_by_name_answer_as_their_formulas(name, angle):
    height, light = NAMED[name]
    law = angle_map(name, 1.0)
    with mpmath.workdps(40):
        p, true = float(height(mpmath.mpf(angle))), float(light(mpmath.mpf(angle)))
        slope = float(mpmath.tan(angle))
    assert float(law.angle(np.array(p))) == pytest.approx(angle, rel=1e-13)
    assert float(law.light(np.array(p))) == pytest.approx(true, rel=1e-12)
    assert float(law.first_order(np.array(slope), 1.0)) == pytest.approx(p, rel=1e-12)
    assert p * float(law.stretch(np.array(p), 1.0)) == pytest.approx(slope, rel=1e-12)
    assert float(law.angle(np.array(10.0))) == pytest.approx(law.widest, rel=1e-15)


def test_rays_turn_about_the_entrance_pupil():
    """Drawn rays meet those of the first order where the pupil stands, and are as much steeper as asked."""
    law = angle_map("f sin", 1.0)
    ((height, slope),) = law.redrawn([(0.4, 0.2)], lambda: 1.7, lambda: 3.0)
    assert slope == pytest.approx(0.34)
    assert height - slope * 3.0 == pytest.approx(0.4 - 0.2 * 3.0)
    assert F_TAN.redrawn([(0.4, 0.2)], lambda: 1.7, lambda: 3.0) == [(0.4, 0.2)]
