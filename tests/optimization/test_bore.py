"""One stop for a bore: exact where it can be, honest where it cannot."""

import numpy as np
import pytest
from pydantic import ValidationError

import roslf_design as roslf
from roslf_design.design import Stop
from roslf_design.optimization.bore import BoreTable, judge_pupil, reduce_bore

PAPER = roslf.load("paper")


def tube_rims(diameter, length, distance):
    return [Stop(diameter=diameter, distance=end) for end in (distance, distance + length)]


def test_a_single_rim_is_itself():
    found = reduce_bore(PAPER, [Stop(diameter=3.3, distance=77.0)])
    assert found.stop == (3.3, 77.0)
    assert found.worst_misplaced == 0
    assert found.worst_kept_difference == 0


def test_a_rim_that_never_cuts_does_not_count():
    found = reduce_bore(PAPER, [Stop(diameter=3.0, distance=110.0), Stop(diameter=60.0, distance=200.0)])
    assert found.stop == (3.0, 110.0)
    assert found.worst_misplaced == 0


BOX = PAPER.replace({"aperture": {"shape": "rectangle", "sides": (3.0, 2.0), "turn": 0.3, "distance": 100.0}})


def box(sides, distance, turn=0.3):
    return Stop(shape="rectangle", sides=sides, turn=turn, distance=distance)


def test_a_single_rectangle_is_itself():
    found = reduce_bore(BOX, [box((3.3, 2.2), 77.0), box((90.0, 80.0), 150.0, 1.0)])
    width = 3.3 * np.cos(0.3) + 2.2 * np.sin(0.3)
    assert found.stop == pytest.approx((width, 77.0), rel=1e-12)
    assert found.worst_misplaced < 1e-12


def test_shares_of_a_square_tube_against_counted_rays():
    """In all directions of the field the counted share is at most what is stated, and in some it is that."""
    tube = [box((7.5, 5.0), 60.0), box((7.5, 5.0), 120.0)]
    found = reduce_bore(BOX, tube)
    assert 60 <= found.pupil_distance_mm <= 120
    assert found.worst_misplaced > 1e-3
    stop = BOX.replace(D_F=found.pupil_diameter_mm, d_3=found.pupil_distance_mm).aperture
    assert stop.sides[0] / stop.sides[1] == pytest.approx(1.5, rel=1e-12)
    rng = np.random.default_rng(0)
    index, counted = 6, []
    for turn in np.linspace(0, np.pi, 8, endpoint=False):
        axis = found.fields_mm[index] * np.array([np.cos(turn), np.sin(turn)])
        scale = BOX.d_2 / BOX.d_1 * BOX.d_f / (BOX.d_f - stop.distance)
        half = 0.75 * found.pupil_diameter_mm * scale
        p = axis * scale * (1 - stop.distance / BOX.f) + half * rng.uniform(-1, 1, (60_000, 2))
        slope = p / BOX.d_2
        height = axis - slope * BOX.d_1
        out = slope + height / BOX.f
        through, model = (np.hypot(*height.T) <= BOX.D / 2 for _ in (0, 1))
        for rim, passes in ((tube[0], through), (tube[1], through), (stop, model)):
            x, y = (height - out * rim.distance).T
            cos, sin = np.cos(rim.turn), np.sin(rim.turn)
            passes &= (np.abs(cos * x + sin * y) <= rim.sides[0] / 2) & (np.abs(cos * y - sin * x) <= rim.sides[1] / 2)
        counted.append((through != model).mean() * (2 * half) ** 2 / (stop.sides[0] * stop.sides[1] * scale**2))
    # Counting 6e4 points: standard deviation below 5e-3 of the pupil's area.
    assert max(counted) == pytest.approx(found.misplaced[index], abs=0.015)


def seen(design, rims, axis, grid):
    """Which sensor points get light, by tracing the pinhole's backward ray as the model states it."""
    p = axis + grid
    slope = (p - axis) / design.d_2
    height = axis - slope * design.d_1
    out = slope + height / design.f
    passes = np.ones(len(grid), bool)
    for diameter, distance in rims:
        passes &= np.hypot(*(height - out * distance).T) <= diameter / 2
    return passes


TUBES = [tube_rims(8.0, 60.0, 60.0), tube_rims(14.0, 40.0, 100.0)]


@pytest.fixture(scope="module")
def reduced():
    return [reduce_bore(PAPER, tube) for tube in TUBES]


@pytest.mark.parametrize("number", [0, 1])
def test_shares_against_counted_rays(reduced, number):
    tube, found = TUBES[number], reduced[number]
    assert tube[0].distance <= found.pupil_distance_mm <= tube[1].distance
    assert found.worst_kept_difference <= found.worst_misplaced + 1e-12
    assert found.worst_misplaced > 1e-3
    rng = np.random.default_rng(0)
    lens = (PAPER.D, 0.0)
    bore = [lens, *((rim.diameter, rim.distance) for rim in tube)]
    stop = found.stop
    for index in (0, 4, 8):
        axis = np.array([found.fields_mm[index], 0.0])
        scale = PAPER.d_2 / PAPER.d_1 * PAPER.d_f / (PAPER.d_f - found.pupil_distance_mm)
        centre = axis * scale * (1 - found.pupil_distance_mm / PAPER.f)
        grid = centre + 0.75 * found.pupil_diameter_mm * scale * rng.uniform(-1, 1, (200_000, 2))
        area = (1.5 * found.pupil_diameter_mm * scale) ** 2 / (np.pi * (found.pupil_diameter_mm / 2 * scale) ** 2)
        through, model = seen(PAPER, bore, axis, grid), seen(PAPER, [lens, stop], axis, grid)
        # Counting 2e5 points: standard deviation below 2e-3 of the pupil's area.
        assert (through != model).mean() * area == pytest.approx(found.misplaced[index], abs=8e-3)
        assert model.mean() * area == pytest.approx(found.kept_pupil[index], abs=8e-3)


def test_no_stop_nearby_does_better(reduced):
    for diameter in np.linspace(0.9, 1.1, 9) * reduced[0].pupil_diameter_mm:
        for distance in np.linspace(60, 120, 13):
            other = judge_pupil(PAPER, TUBES[0], float(diameter), float(distance))
            assert other.worst_misplaced >= reduced[0].worst_misplaced - 1e-6


def test_a_bore_that_leaves_the_corner_dark_is_reduced_for_what_it_lights():
    """Dark corners made a hole of 20 mm best in a tube of 10 mm; a fan tells how far a third of a pencil comes."""
    long = PAPER.replace({"d_f": 200.0, "d_3": 55.0, "D_F": 4.0, "d_2": 0.45})
    tube = tube_rims(10.0, 90.0, 10.0)
    found = reduce_bore(long, tube)
    # All rays to the axis' point on the focal plane pass the far rim's cone, 10 mm at 100 mm, and the near rim's.
    assert found.pupil_diameter_mm <= 10.0
    assert found.kept_bore[0] == pytest.approx(
        (10 / 190 * (200 - found.pupil_distance_mm) / found.pupil_diameter_mm) ** 2, rel=1e-9
    )
    lit = found.dark_beyond_mm
    assert 0 < lit < found.seen_to_mm

    def wide(axis):  # along the way outwards, where both discs' common part is narrowest
        fan = np.stack([np.linspace(-0.5, 0.5, 400_001), np.zeros(400_001)], axis=-1)
        on_sensor = np.array([axis, 0.0]) + fan
        return seen(
            long, [(rim.diameter, rim.distance) for rim in tube], np.array([axis, 0.0]), on_sensor - [axis, 0.0]
        ).mean()

    assert wide(lit) / wide(0.0) == pytest.approx(1 / 3, abs=2e-4)


def test_a_cone_is_its_two_ends_as_what_passes_both_passes_its_wall():
    ends = {"diameter": "6 mm", "proximal_diameter": "9 mm", "distance": "20 mm", "length": "80 mm"}
    near, far = BoreTable.model_validate({"tube": ends}, context={"from_file": True}).rims
    assert (near.diameter, near.distance, far.diameter, far.distance) == (9.0, 20.0, 6.0, 100.0)
    rng = np.random.default_rng(4)
    first, last = (
        stop.diameter / 2 * np.sqrt(rng.random(100_000)) * np.exp(2j * np.pi * rng.random(100_000))
        for stop in (near, far)
    )
    for share in np.linspace(0, 1, 9):
        assert np.abs(first + share * (last - first)).max() <= 4.5 + share * (3.0 - 4.5) + 1e-12
    square = {"shape": "rectangle", "sides": ["6 mm", "6 mm"], **ends}
    del square["diameter"]
    with pytest.raises(ValidationError, match="a cone is round: give diameter"):
        BoreTable.model_validate({"tube": square}, context={"from_file": True})


@pytest.mark.parametrize(
    ("key", "value"), [("decentre", ["0.1 mm", "0 mm"]), ("tilt", ["0 mrad", "2 mrad"]), ("bore", True)]
)
@pytest.mark.parametrize("part", ["tube", "stops"])
def test_what_no_centred_stop_stands_for_is_refused(part, key, value):
    rim = {"diameter": "3 mm", "distance": "50 mm", key: value}
    table = {"tube": {**rim, "length": "20 mm"}} if part == "tube" else {"stops": [rim]}
    with pytest.raises(ValidationError, match="a bore is reduced to one stop on the axis") as fault:
        BoreTable.model_validate(table, context={"from_file": True})
    assert key in fault.value.errors()[0]["loc"]


def test_a_bore_beyond_the_focal_plane_is_refused():
    with pytest.raises(ValueError, match="in the bore"):
        reduce_bore(PAPER, tube_rims(8.0, 400.0, 10.0))
