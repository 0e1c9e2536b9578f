"""What may vary: scaling both ways, derived lengths, and what would be set twice."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.optimize.problem import DesignProblem, Goal, Variable, check_name, check_together
from roslf_design.theory.quantities import quantity_named

TUBE = roslf.load("paper").replace({"stops": ({"diameter": 5.0, "distance": 150.0},)})


@pytest.mark.parametrize("variable", [Variable("d", 0.01, 0.5), Variable("d_3", 0.0, 200.0), Variable("f", 90, 110)])
def test_scaled_values_and_back(variable):
    units = np.linspace(0, 1, 11)
    values = variable.value(units)
    assert values[0] == variable.low
    assert values[-1] == variable.high
    assert [variable.unit(float(value)) for value in values] == pytest.approx(units.tolist(), abs=1e-14)
    middle = (variable.value(np.array(0.5 + 1e-6)) - variable.value(np.array(0.5 - 1e-6))) / 2e-6
    assert variable.rate(0.5) == pytest.approx(float(middle), rel=1e-6)
    assert variable.unit(variable.high + 1) == 1
    assert variable.unit(variable.low - 1) == 0


def test_derived_lengths_set_the_places_they_mean():
    variables = (
        Variable("tube_length", 10.0, 60.0),
        Variable("tube_diameter", 2.0, 6.0),
        Variable("working_distance", 100.0, 300.0),
    )
    problem = DesignProblem("tube", TUBE, variables, (), (Goal(quantity_named("sigma_z_mm"), "min"),))
    unit = np.array([0.5, 0.25, 0.5])
    design = problem.design_at(unit)
    values = {variable.name: float(variable.value(u)) for variable, u in zip(variables, unit, strict=True)}
    assert design.stops[0].distance == pytest.approx(design.d_3 + values["tube_length"])
    assert design.D_F == design.stops[0].diameter == pytest.approx(values["tube_diameter"])
    assert design.d_f - design.stops[0].distance == pytest.approx(values["working_distance"])
    cameras = problem.cameras(unit[None])
    assert float(cameras.d_f[0]) == pytest.approx(design.d_f)
    assert float(cameras.d_1[0]) == pytest.approx(design.d_1)


def test_microlenses_in_focus():
    problem = DesignProblem(
        "focus", TUBE, (Variable("d_2", 1.0, 4.0),), (), (Goal(quantity_named("sigma_z_mm"), "min"),), in_focus=True
    )
    design = problem.design_at(np.array([0.3]))
    vergence = roslf.evaluate(design, []).exit_pupil.vergence_at_mla_per_mm
    assert 1 / design.f_ml == pytest.approx(1 / design.d_2 + vergence, rel=1e-12)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("f", "d_f", "d_1"), "two of them give the third"),
        (("working_distance", "d_f"), "sets d_f"),
        (("working_distance", "f", "d_1"), "two of them give the third"),
        (("d_3", "aperture.distance"), "varies twice"),
        (("tube_diameter", "D_F"), "one of which varies too"),
    ],
)
def test_what_would_be_set_twice(names, said):
    for name in names:
        check_name(name, Camera.of(TUBE).numbers)
    with pytest.raises(ValueError, match=said):
        check_together(names)
