"""Builds that are focused at assembly, against the focus of each one searched for through its own paraxial matrices."""

import json
import math
from functools import reduce

import numpy as np
import pytest
from scipy.optimize import brentq

from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.errors import InputError
from roslf_design.reporting.story import quick_study
from roslf_design.reporting.tolerance.pages import _travel_words, focus_words, headline, remedies, set_words, tables
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.budgets import _adjusted, _Builds, search_trials, searched_builds
from roslf_design.tolerancing.places import load_grades, nominal_values
from roslf_design.tolerancing.result import analyse
from roslf_design.tolerancing.run import tally_chunk
from roslf_design.tolerancing.study import plan_from, tolerance_plan
from roslf_design.tolerancing.trials import lengths_built, measure, one_trial

D_1 = "microlens_array.distance"
FOCUS = {"place": "d_1", "aim": "focus", "error": "0 mm"}


def gap(length, index=1.0):
    """Height and index times slope over a length."""
    return np.array([[1.0, length / index], [0.0, 1.0]])


def bend(power):
    return np.array([[1.0, 0.0], [-power, 1.0]])


def along(*matrices):
    """What light meets, first to last."""
    return reduce(lambda done, matrix: matrix @ done, matrices)


def element(at, kind):
    """Matrix of an element of the bore, from its numbers."""
    if kind == "lens":
        return bend(1 / at["focal_length"])
    if kind == "plate":
        return gap(at["thickness"], at["index"])
    n, g, angle = at["index"], at["gradient"], at["gradient"] * at["thickness"]
    return np.array([[np.cos(angle), np.sin(angle) / (n * g)], [-n * g * np.sin(angle), np.cos(angle)]])


def lens_of(design, at):
    """Matrices of the main lens from vertex to vertex, and its length: thin, or surface by surface."""
    if design.lens is None:
        return [bend(1 / at["main_lens.focal_length"])], 0.0
    steps, before, length = [], 1.0, 0.0
    last = len(design.lens.surfaces)
    for k in range(1, last + 1):
        place = f"main_lens.surfaces.{k}"
        behind, radius = at.get(f"{place}.index", 1.0), at.get(f"{place}.radius", np.inf)
        steps.append(bend((behind - before) / radius))
        if k < last:
            thick = at[f"{place}.thickness"]
            steps.append(gap(thick, behind))
            length += thick
        before = behind
    return steps, length


def tip(design, at):
    """Where the bore ends [mm before the main lens]."""
    lengths = (0.0 if one.kind == "lens" else at[f"elements.{k}.thickness"] for k, one in enumerate(design.elements))
    ends = (at[f"elements.{k}.distance"] + length for k, length in enumerate(lengths))
    return max(at["aperture.distance"], *ends, 0.0)


def focused(design, at, place=D_1):
    """Where the array, or another part, makes the object at the nominal distance from the tip sharp, by search [mm]."""
    nominal = nominal_values(design)
    drawn, drawn_length = lens_of(design, nominal)
    (a, _), (c, d) = along(*drawn)
    front, rear = (d - 1) / c, drawn_length + (1 - a) / c  # principal planes as drawn, from the first vertex
    lens, length = lens_of(design, at)

    def defocus(moved):
        numbers = {**at, place: moved}
        here = tip(design, numbers) + (design.d_f - tip(design, nominal))
        medium, steps = numbers.get("object_space.index", 1.0), []
        for k in sorted(range(len(design.elements)), key=lambda k: -numbers[f"elements.{k}.distance"]):
            own = f"elements.{k}."
            one = {p.removeprefix(own): value for p, value in numbers.items() if p.startswith(own)}
            thick = one.get("thickness", 0.0)
            steps += [gap(here - one["distance"] - thick, medium), element(one, design.elements[k].kind)]
            here, medium = one["distance"], 1.0
        steps += [gap(here - front, medium), *lens]
        glass = 0.0
        if "microlens_array.substrate.thickness" in at:  # in front of the microlenses
            glass = at["microlens_array.substrate.thickness"] * (1 - 1 / at["microlens_array.substrate.index"])
        return along(*steps, gap(rear + numbers[D_1] - length - glass))[0, 1]

    # Of a lens in the bore there may be two such places: the one that is near.
    near = 0.5 if design.lens is None else 8.0
    low, high = (0.2 * at[D_1], 5 * at[D_1]) if place == D_1 else (at[place] - near, at[place] + near)
    return brentq(defocus, low, high, xtol=1e-13, rtol=1e-14)


ACHROMAT = load("paper-singlet").replace({"main_lens.prescription": "AC508-100-A", "main_lens.reversed": False})
WINDOW = load("paper").replace(
    {
        "elements": [{"kind": "plate", "distance": 121.0, "thickness": 2.0, "material": "sapphire"}],
        "object_space.medium": "water",
        "microlens_array.substrate": {"thickness": 1.2, "material": "fused silica", "lenslets": "sensor"},
    }
)
DESIGNS = {
    "thin lens in air": load("paper"),
    "window and liquid": WINDOW,
    "relay": load("cystoscope"),
    "rods": load("grin-needle"),
    "singlet": load("paper-singlet"),
    "achromat": ACHROMAT,
    "achromat behind a lens": ACHROMAT.replace(
        {"elements": [{"kind": "lens", "distance": 10.0, "focal_length": 200.0, "diameter": 45.0}]}
    ),
}


def beside_the_form(design):
    """What a camera is used in, and glass told by its dispersion."""
    places = ["object_space.index", *(f"main_lens.surfaces.{k}.abbe" for k in (1, 2))]
    return [place for place in places if place in nominal_values(design)]


def study(design, goals=({"metric": "working_distance_mm", "min": 0},), **more):
    data = {"name": "n", "design": "", "trials": 64, "seed": 3, "sobol_samples": 0, "goals": list(goals)}
    return tolerance_plan({**data, **more}, design)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        *((name, D_1) for name in DESIGNS),
        ("relay", "elements.0.distance"),  # the ocular
        ("relay", "elements.4.distance"),
        ("rods", "elements.0.distance"),
        ("achromat behind a lens", "elements.0.distance"),
    ],
)
def test_each_build_is_in_the_focus_that_a_search_through_its_matrices_finds(name, place):
    design = DESIGNS[name]
    line = {"place": place, "aim": "focus"}
    plan, *_ = study(design, grade="high", exclude=beside_the_form(design), compensators=[line])
    draws = plan.draws
    deviations = draws.deviations(draws.uniforms(0, 64, 0, 16))
    values = draws.values(deviations)
    nominal = nominal_values(design)
    found = measure(plan, deviations)
    assert found.moved.shape == (1, 16)
    searched = [focused(design, {**nominal, **{p: row[k] for p, row in values.items()}}, place) for k in range(16)]
    built = values.get(place, nominal[place])
    assert found.moved[0] == pytest.approx(searched - built, abs=1e-8)
    assert np.ptp(found.moved[0]) > 1e-3


@pytest.mark.parametrize("name", DESIGNS)
def test_a_build_without_misses_is_left_where_it_is(name):
    design = DESIGNS[name]
    plan, *_ = study(design, grade="high", compensators=[FOCUS])
    found = measure(plan, np.zeros((len(plan.draws.perturbations), 3)))
    assert found.moved == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("name", ["thin lens in air", "window and liquid", "relay", "achromat"])
def test_what_is_in_focus_is_where_the_design_has_it_and_no_unit_is_lost_by_focusing(name):
    """The quantity itself, by the cameras: exact where travel suffices, nearer than as built where it ends."""
    design = DESIGNS[name]
    nominal = study(design, grade="high")[0].nominal[0]
    room = 1e-3 * abs(nominal)
    goals = [{"metric": "working_distance_mm", "min": nominal - room, "max": nominal + room}]
    alike = {"grade": "high", "exclude": beside_the_form(design), "trials": 256}
    free, *_ = study(design, goals, **alike, compensators=[FOCUS])
    built, focused = tally_chunk(free, 0).passed
    assert built < focused == 256
    deviations = free.draws.deviations(free.draws.uniforms(0, free.chunk, 0, 256))
    found = measure(free, deviations)
    assert found.variants[1, 0] == pytest.approx(nominal, rel=1e-9)
    reach = float(np.median(np.abs(found.moved)))
    short, *_ = study(design, goals, **alike, compensators=[{**FOCUS, "range": f"{reach!r} mm"}])
    moved = measure(short, deviations).moved
    assert moved == pytest.approx(np.clip(found.moved, -reach, reach), abs=1e-12)
    tally = tally_chunk(short, 0)
    assert built <= tally.passed[-1] <= 256
    off = np.abs(measure(short, deviations).variants[:, 0] - nominal)
    assert (np.nan_to_num(off[1], nan=np.inf) <= np.nan_to_num(off[0], nan=np.inf) + 1e-9).all()
    assert tally.at_end.tolist() == [(np.abs(found.moved) >= reach).sum()]
    assert tally.travel == pytest.approx(reach)


@pytest.mark.parametrize("elements", [[], [{"kind": "plate", "distance": 121.0, "thickness": 2.0, "material": "BK7"}]])
def test_a_camera_focused_at_infinity_stays_so(elements):
    """Written as 1e12 m; its array follows f."""
    design = load("paper").replace({D_1: None, "main_lens.focal_plane": 1e15, "elements": elements})
    perturb = [{"place": "f", "tolerance": "1 %"}, {"place": "d_3", "tolerance": "1 mm"}]
    perturb += [{"place": "elements.*.thickness", "tolerance": "0.1 mm"}] * len(elements)
    plan, *_ = study(design, [{"metric": "fill_factor", "min": 0}], perturb=perturb, compensators=[FOCUS])
    deviations = plan.draws.deviations(plan.draws.uniforms(0, 64, 0, 64))
    focal_length = plan.draws.values(deviations)["main_lens.focal_length"]
    assert measure(plan, deviations).moved[0] == pytest.approx(focal_length - 100, abs=1e-10)


def test_what_a_camera_is_used_in_is_not_focused_away():
    """Water of another warmth is another plane in focus: the thread is glued by then."""
    perturb = [{"place": "object_space.index", "tolerance": 0.002}]
    plan, *_ = study(WINDOW, perturb=perturb, compensators=[FOCUS])
    found = measure(plan, np.linspace(-1, 1, 5)[None])
    assert found.moved == pytest.approx(0.0, abs=1e-11)
    assert np.array_equal(found.variants[0], found.variants[1])
    warm = load("paper").replace({"environment": {"temperature": 20.0, "housing": "aluminium"}})
    plan, *_ = study(warm, perturb=[{"place": "environment.temperature", "tolerance": "10 K"}], compensators=[FOCUS])
    found = measure(plan, np.linspace(-1, 1, 5)[None])
    assert found.moved == pytest.approx(0.0, abs=1e-11)
    assert np.ptp(found.variants[1, 0]) > 0.1


def test_focus_is_set_last_and_others_are_searched_with_it():
    """The sensor's distance at its best where each build is in focus: by brute force over that distance."""
    goals = [{"metric": "fill_factor", "min": 0.99, "max": 1.02, "fields": [0]}]
    perturb = [{"place": "f", "tolerance": "1 %"}, {"place": "d_1", "tolerance": "0.3 mm"}]
    lines = [FOCUS, {"place": "sensor.distance", "range": "0.1 mm"}]
    plan, *_ = study(load("paper"), goals, perturb=perturb, compensators=lines)
    assert [one.place for one in plan.adjusters] == ["sensor.distance", D_1]
    deviations = np.random.default_rng(1).uniform(-1, 1, (2, 8))
    found = measure(plan, deviations, settled=0.0)
    values = plan.draws.values(deviations)
    f, d_1 = values["main_lens.focal_length"], values[D_1]
    sharp = f * 350 / (350 - f)
    assert found.moved[1] == pytest.approx(sharp - d_1, abs=1e-9)
    d_2 = 2 + np.linspace(-0.1, 0.1, 200_001)
    for k in range(8):  # images as wide as d_2 D_F H/d_1 at a pitch of d (1 + d_2/L), Eq. 7
        fill = (2.9 * (350 / 230) * d_2 / sharp[k]) / (
            0.063 * (1 + d_2 * (120 - f[k]) * (350 - f[k]) / (-230 * f[k] ** 2))
        )
        best = d_2[np.abs(fill - plan.nominal[0]).argmin()]
        assert found.moved[0, k] == pytest.approx(best - 2, abs=2e-6)


def test_a_trial_comes_back_as_a_design_in_focus():
    plan, *_ = study(load("paper"), grade="precision", compensators=[FOCUS])
    design, found = one_trial(plan, 5)
    assert design.d_f - design.d_3 == pytest.approx(230, rel=1e-12)
    assert found.variants[1, 0, 0] == pytest.approx(230, rel=1e-12)


def test_lengths_as_built_are_those_of_cameras_in_focus():
    """d_f scatters with the tip alone, and d_1 with f: as many builds tell the same covariance."""
    plan, *_ = study(load("paper"), grade="high", compensators=[FOCUS])
    built = lengths_built(plan)
    draws = plan.draws
    count = 4096
    deviations = draws.deviations(draws.uniforms(0, count, 0, count))
    values = draws.values(deviations)
    d_1 = (100 / 250) * 350 + 0 * values["main_lens.focal_length"]
    f = values["main_lens.focal_length"]
    plane = values["aperture.distance"] + 230
    d_1 = f * plane / (plane - f)
    row = built.places.index(D_1)
    assert np.sqrt(built.matrix[row, row]) == pytest.approx(d_1.std(), rel=0.05)


@pytest.mark.parametrize(
    ("line", "key", "words"),
    [
        ({"place": "sensor.distance", "aim": "focus"}, "compensators.0.aim", "microlens_array.distance (d_1)"),
        ({"place": "d_1", "aim": "sharp"}, "compensators.0.aim", "write 'limits' or 'focus'"),
        ({"place": "calibration", "aim": "focus"}, "compensators.0.aim", "not by calibration"),
        ({"place": ["d_1", "d_2"], "aim": "focus"}, "compensators.0.aim", "not by sensor.distance"),
        ({"place": ["d_1", "elements.0.distance"], "aim": "focus"}, "compensators.0.place", "elements.0.distance"),
    ],
)
def test_what_cannot_be_focused_is_told(line, key, words):
    with pytest.raises(InputError) as caught:
        study(load("paper"), grade="high", compensators=[line])
    (problem,) = caught.value.problems
    assert problem.key == key
    assert words in problem.message


def test_a_focal_plane_that_misses_and_is_focused_is_a_contradiction():
    plane = "main_lens.focal_plane"
    with pytest.raises(InputError) as caught:
        study(load("paper"), perturb=[{"place": plane, "tolerance": "1 mm"}], compensators=[FOCUS])
    assert [problem.key for problem in caught.value.problems] == ["perturb"]
    with pytest.raises(InputError) as caught:
        study(load("paper"), grade="high", compensators=[FOCUS, {"place": plane}])
    assert [problem.key for problem in caught.value.problems] == ["compensators"]


def test_one_place_focuses_and_it_moves_the_focus():
    ocular = {"place": "elements.0.distance", "aim": "focus"}
    with pytest.raises(InputError, match="cannot all be set to the focus") as caught:
        study(load("cystoscope"), grade="high", compensators=[FOCUS, ocular])
    assert [problem.key for problem in caught.value.problems] == ["compensators"]
    with pytest.raises(InputError, match="a lens in the bore"):  # a window does not
        study(WINDOW, grade="high", compensators=[ocular])


def test_the_page_proposes_focus_where_lengths_that_it_takes_out_are_at_fault():
    """The working distance within 0.4 mm: as built a matter of f, within the thread's travel of all builds focused.

    These are off by no more than their own views show, 0.25 mm.
    """
    goals = [{"metric": "working_distance_mm", "min": 229.6, "max": 230.4}]
    perturb = [{"place": "f", "tolerance": "0.1 %"}, {"place": "d_1", "tolerance": "0.3 mm"}]
    plan, read, grades = study(load("paper"), goals, perturb=perturb, trials=512)
    result = analyse(plan, read, grades, tally_chunk(plan, 0))
    (change,) = (one for one in result.budget.changes if one.aim == "focus")
    ((place, _, travel),) = change.steps
    f, d_1 = 100 * 1.001, 139.7  # the corner of what truncated normals reach
    assert 0.2 < travel < (f * 350 / (350 - f) - d_1) * 1.1
    assert place == D_1
    assert change.result.value == 1.0 > result.final.result.value
    assert "focus the array at assembly: d_1, travel ± " in remedies(result)
    table = next(table for table in tables(result) if table.title == "Changes that reach the target yield")
    assert any(row[0].startswith("focus the array at assembly: d_1, travel ± ") for row in table.rows)
    assert json.dumps(result.to_dict()["budget"]["changes"]).count('"aim": "focus"') == 1
    # As the page says it, as a compensator.
    line = {**FOCUS, "range": f"{travel!r} mm", "error": None}
    plan, read, grades = study(load("paper"), goals, perturb=perturb, trials=512, compensators=[line])
    result = analyse(plan, read, grades, tally_chunk(plan, 0))
    assert result.final.result.value == 1.0
    (said,) = result.to_dict()["compensators"]
    assert (said["place"], said["aim"], said["range"], said["trials_at_end"]) == (D_1, "focus", travel, 0)
    assert _travel_words(result, result.adjusters[0]).startswith(
        "d_1 is set to the focus on each of 512 builds: travel up to ± "
    )
    assert not [one for one in result.budget.adjustments if one.aim == "focus"] if result.budget else True


def test_travel_that_ends_is_told_with_the_builds_that_rest_there():
    perturb = [{"place": "f", "tolerance": "1 %", "distribution": "uniform"}]
    plan, read, grades = study(
        load("paper"), perturb=perturb, trials=1024, sampling="sobol", compensators=[{**FOCUS, "range": "0.98 mm"}]
    )
    result = analyse(plan, read, grades, tally_chunk(plan, 0))
    # d_1 follows f by (d_f/(d_f - f))^2 = 1.96: half of the builds ask for more than 0.98 mm.
    assert result.adjusters[0].at_end == pytest.approx(512, abs=8)
    share = f"{100 * result.adjusters[0].at_end / 1024:.3g} %"
    assert _travel_words(result, result.adjusters[0]).endswith(
        f": {share} of them rest at the end of its travel, ± 0.98 mm."
    )


def test_a_thread_is_as_long_as_units_ask():
    """A relay's focus moves by millimetres, which a thread of half a millimetre would not have mended."""
    goals = [{"metric": "working_distance_mm", "min": 24, "max": 26}]
    relay = load("cystoscope")
    plan, read, grades = study(relay, goals, grade="high", exclude=beside_the_form(relay), trials=256)
    builds = plan.draws.deviations(plan.draws.uniforms(0, plan.chunk, 0, 256))
    now, trials = _Builds(plan.limited, np.ones(len(plan.draws.perturbations))), searched_builds(plan)
    adjusted = _adjusted(now, grades, search_trials(trials, read.yield_target))
    (change,) = (one for one, _ in adjusted if one.aim == "focus")
    ((place, _, travel),) = change.steps
    values = {**nominal_values(relay)} | plan.draws.values(builds)
    first = [focused(relay, {p: np.broadcast_to(v, 256)[k] for p, v in values.items()}) for k in range(16)]
    assert (place, change.result.value) == (D_1, 1.0)
    assert np.abs(first - values[D_1][:16]).max() < travel < relay.d_1 / 2


def test_a_shop_states_what_it_can_focus(tmp_path):
    line = '[[adjustment]]\nplace = "{}"\naim = "{}"\ncost = 1\nprovenance = "this test"\n'
    head = '[grades]\nfair = "turned"\n'
    path = tmp_path / "shop.toml"
    path.write_text(head + line.format("d_1", "focus"))
    assert load_grades(path).adjustments[0].aim == "focus"
    path.write_text(head + line.format("sensor.distance", "focus"))
    with pytest.raises(InputError, match="d_1"):
        load_grades(path)


def test_a_plan_that_focuses_has_two_variants():
    plan = plan_from(
        {
            "name": "n",
            "design": "paper",
            "grade": "high",
            "compensators": [FOCUS],
            "goals": [{"metric": "fill_factor", "min": 0}],
        }
    )
    assert plan.variants == ("as built", "focused")


def test_what_a_compensator_leaves_is_on_top_of_where_it_sets_each_build():
    """d_1 where a thin lens in air has the plane in focus, plus a draw of its own: as built and travel know nothing."""
    perturb = [{"place": "f", "tolerance": "1 %"}]
    line = {**FOCUS, "error": "0.05 mm"}
    plan, *_ = study(load("paper"), perturb=perturb, compensators=[line])
    assert plan.perfect == ()
    f, left = np.array([[-1.0, 0.0, 1.0, 0.5], [0.0, 1.0, -1.0, -0.4]])
    found = measure(plan, np.stack([f, left]))
    focal = 100 * (1 + 0.01 * f)
    sharp = focal * 350 / (350 - focal)
    assert found.moved[0] == pytest.approx(sharp - 140, abs=1e-9)
    d_1 = sharp + 0.05 * left
    assert found.variants[1, 0] == pytest.approx(1 / (1 / focal - 1 / d_1) - 120, rel=1e-9)
    assert found.variants[0, 0] == pytest.approx(1 / (1 / focal - 1 / 140) - 120, rel=1e-9)
    design, _ = one_trial(plan, 5)
    values = plan.draws.values(plan.draws.deviations(plan.draws.uniforms(0, plan.chunk, 5, 6)))
    (focal,), (left,) = values["main_lens.focal_length"], values["compensators.microlens_array.distance"]
    assert design.d_1 == pytest.approx(focal * 350 / (350 - focal) + left, rel=1e-12)


def test_lengths_as_built_scatter_by_what_focusing_leaves():
    """A normal cut off at two sigmas, by its own integral."""
    exact = {"perturb": [{"place": "f", "tolerance": "0 %"}]}
    plan, *_ = study(load("paper"), **exact, compensators=[{**FOCUS, "error": "0.05 mm"}])
    built = lengths_built(plan)
    x = np.linspace(-2, 2, 200_001)
    density = np.exp(-(x**2) / 2)
    sigma = 0.025 * np.sqrt((density * x**2).sum() / density.sum())
    row = built.places.index(D_1)
    assert np.sqrt(built.matrix[row, row]) == pytest.approx(sigma, rel=1e-4)


def test_no_search_knows_what_it_will_leave():
    """With the sensor set to limits and then missing by its own error, images are off by just that: Eq. 7."""
    goals = [{"metric": "fill_factor", "min": 0.99, "max": 1.02, "fields": [0]}]
    line = {"place": "sensor.distance", "range": "0.1 mm", "error": "10 um"}
    plan, *_ = study(load("paper"), goals, perturb=[{"place": "D_F", "tolerance": "1 %"}], compensators=[line])
    deviations = np.array([[0.3, -0.5, 0.8, 0.0], [1.0, -1.0, 0.5, 1.0]])
    found = measure(plan, deviations, settled=0.0)
    free, *_ = study(
        load("paper"), goals, perturb=[{"place": "D_F", "tolerance": "1 %"}], compensators=[{**line, "error": None}]
    )
    alone = measure(free, deviations[:1], settled=0.0)
    assert found.moved == pytest.approx(alone.moved, abs=1e-12)
    d_f, d_1, d_3, f = 350, 140, 120, 100
    d_2 = 2 + found.moved[0] + 0.01 * deviations[1]
    wide = 2.9 * (1 + 0.01 * deviations[0]) * (d_f / (d_f - d_3)) * d_2 / d_1
    pitch = 0.063 * (1 + d_2 * (d_3 - f) / (d_1 * (d_3 - f) - f * d_3))
    assert found.variants[-1, 0] == pytest.approx(wide / pitch, rel=1e-9)


def test_a_calibration_leaves_depth_off_by_what_its_line_states():
    goals = [{"metric": "depth_error_mm", "min": -0.3, "max": 0.3, "fields": [0]}]
    line = {"place": "calibration", "error": "0.5 mm"}
    perturb = [{"place": "f", "tolerance": "0.5 %"}]
    even = {"distribution": "uniform", "trials": 4096, "sampling": "sobol"}
    plan, *rest = study(load("paper"), goals, perturb=perturb, compensators=[line], **even)
    found = measure(plan, np.array([[0.7, 0.7], [0.4, -1.0]]))
    built, calibrated = found.variants[:, 0]
    assert built[0] == built[1] != 0
    assert calibrated == pytest.approx([0.2, -0.5], abs=1e-6)  # three targets on the axis tell all else
    tally = tally_chunk(plan, 0)
    assert tally.passed[-1] == pytest.approx(0.6 * 4096, abs=3)  # evenly within 0.5 mm
    stated = analyse(plan, *rest, tally)
    assert "left no error" not in headline(stated)
    assert any("depth as calibrated" in row for table in tables(stated) for row in table.rows)
    perfect, *rest = study(load("paper"), goals, perturb=perturb, compensators=[{"place": "calibration"}])
    assert "as if calibration left no error of depth" in headline(analyse(perfect, *rest, tally_chunk(perfect, 0)))


@pytest.mark.parametrize("error", ["1 %", "2", "-1 um", "10 mrad"])
def test_an_error_that_a_compensator_cannot_leave_is_told(error):
    with pytest.raises(InputError) as caught:
        study(load("paper"), grade="high", compensators=[{**FOCUS, "error": error}])
    assert [problem.key for problem in caught.value.problems] == ["compensators.0.error"]


def test_parts_set_without_error_are_told_beside_the_depth_that_rests_on_it():
    plan, *_ = study(load("paper"), grade="high", compensators=[FOCUS, {"place": "calibration"}])
    assert plan.perfect == (D_1, "calibration")
    assert set_words(plan).startswith(", d_1 set without error")
    assert not [p for p in plan.draws.perturbations if p.place.startswith("compensators.")]
    plan, *_ = study(load("paper"), grade="high", compensators=[{**FOCUS, "error": "10 um"}])
    assert set_words(plan) == focus_words(plan) == ""  # focused, and it is said how well
    plan, *_ = study(load("paper"), grade="high")
    assert focus_words(plan) == ", not focused at assembly"


def test_a_focus_of_which_nobody_says_what_it_leaves_is_as_fine_as_views_show_it():
    """Of a thin lens in air dz = (d_f/d_1)^2 dd_1; U of one measurement there, or half a view's depth of field."""
    plan, *_ = study(load("paper"), grade="high", compensators=[{**FOCUS, "error": None}])
    camera = Camera.of(load("paper"))
    near, far = (float(QUANTITIES[f"view_depth_of_field_{end}_mm"](camera)) for end in ("near", "far"))
    noise = [float(term.u_mm) for term in depth_budget(camera).terms if term.kind == "precision"]
    shown = min(2 * math.hypot(*noise), (far - near) / 2)
    (left,) = (p for p in plan.draws.perturbations if p.place == "compensators.microlens_array.distance")
    assert left.tolerance == pytest.approx(shown / 2.5**2, rel=1e-6)
    assert plan.perfect == ()
    assert set_words(plan).startswith(f", focused to ± {shown:.3g} mm, as its own views show it (d_1 to ± ")
    perfect, *_ = study(load("paper"), grade="high", compensators=[FOCUS])
    row = lengths_built(plan).places.index(D_1)
    more, less = (lengths_built(one).matrix[row, row] for one in (plan, perfect))
    assert more - less == pytest.approx(left.sigma**2, rel=1e-3)


def test_default_tolerances_are_of_focused_builds_where_focus_would_be_lost():
    for name, focused in (("cystoscope", True), ("paper", False)):
        data = quick_study(load(name))
        assert ({"place": D_1, "aim": "focus"} in data["compensators"]) == focused
        assert ("focused at assembly" in data["question"]) == focused
