"""Relays: behind power in the bore nothing happens where d_1 passes through f; the main lens then sees what is in
focus at infinity and beyond."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

import roslf_design as roslf
from roslf_design.calibration import camera_of, derived, sheet_of
from roslf_design.camera import Camera
from roslf_design.depth.geometry import depth_of, disparity_of
from roslf_design.design import DesignError
from roslf_design.evaluation.near_cases import near_cases
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from tests.oracles.relays import in_focus, relay_scopes

SCOPE = roslf.load("cystoscope")
PLANE = 121.0
SHARES = np.array([1e-3, 1e-5, 1e-7, 0.0, -1e-7, -1e-5, -1e-3])


def collimated(plane=PLANE):
    """The cystoscope with an ocular behind which the main lens sees a plane at infinity."""

    def power_left(focal_length):
        return float(Camera.of(SCOPE, {"elements.0.focal_length": focal_length}).plane(plane).a)

    return SCOPE.replace({"elements.0.focal_length": brentq(power_left, 15.0, 16.9, xtol=1e-13)})


def focused_by_matrices(design, d_1):
    """Plane in focus [mm before the main lens], by ray matrices from the array outwards."""

    def gap(length, index=1.0):
        return np.array([[1.0, length / index], [0.0, 1.0]])

    def lens(f):
        return np.array([[1.0, 0.0], [-1.0 / f, 1.0]])

    way, here = lens(design.f) @ gap(d_1), 0.0
    for element in sorted(design.elements, key=lambda element: element.distance):
        way, here = gap(element.distance - here) @ way, element.distance + element.length
        if element.kind == "lens":
            way = lens(element.focal_length) @ way
        else:
            way = gap(element.thickness, float(element.material.index(design.wavelength))) @ way
    water = float(design.object_space.medium.index(design.wavelength))
    # All rays of a point of the array meet again where the way's upper right element is 0.
    return here - water * way[0, 1] / way[1, 1]


@pytest.mark.parametrize("share", SHARES)
def test_the_plane_in_focus_is_that_of_ray_matrices(share):
    scope = collimated()
    d_1 = scope.f * (1 + share)
    design = scope.replace(d_1=d_1)
    # The plane moves by 2.7 m a unit of the share; rounding of the matrices by some 1e-13 of that.
    assert design.d_f == pytest.approx(focused_by_matrices(scope, d_1), abs=1e-9)
    assert Camera.of(scope, {"d_1": d_1})["main_lens.focal_plane"] == pytest.approx(design.d_f, abs=1e-9)


def test_every_quantity_goes_on_as_if_nothing_happened():
    camera = Camera.of(collimated()).replace({"d_1": SCOPE.f * (1 + SHARES)})
    assert camera.valid.all()
    counted = 0
    for name, quantity in QUANTITIES.items():
        if quantity.at == "needed":
            continue
        if quantity.of is not None:
            values = np.broadcast_to(np.asarray(quantity(camera), float), SHARES.shape)
        else:
            fields = [(1.2, 0.7)]
            values = np.array(
                [quantity.at_fields(MicrolensImages(camera.build(k), fields)).item() for k in range(len(SHARES))]
            )
        if not np.isfinite(values).any():  # the far end of the depth of field
            assert (values == values[0]).all() or np.isnan(values).all(), name
            continue
        counted += 1
        # The plane moves by 2.7 m a unit of the share, 2.7 mm at the ends, over 25 mm from the tip: values change by
        # up to a quarter between the ends, by 1e-4 of that between the inner ones, and bend by some hundredths.
        size = np.abs(values).max()
        assert abs(values[2] - values[4]) <= 3e-4 * size, (name, values)
        assert abs(values[3] - (values[2] + values[4]) / 2) <= 1e-8 * size, (name, values)
        assert abs(values[0] - 2 * values[3] + values[6]) <= 1e-1 * size, (name, values)
    assert counted > 60


def test_what_is_seen_at_infinity_can_be_asked_for():
    design = collimated().replace(d_f=PLANE)
    assert design.d_1 == pytest.approx(SCOPE.f, rel=1e-12)
    assert roslf.specification(design).working_distance_mm == pytest.approx(25.0, abs=1e-9)


def test_only_what_is_imaged_nowhere_is_refused():
    scope, taken = collimated(), []
    tip = float(Camera.of(scope).tip)
    for d_1 in scope.f * np.append(np.linspace(0.98, 1.02, 20), np.linspace(1.1, 3.0, 11)):
        if focused_by_matrices(scope, d_1) > tip:
            taken.append(scope.replace(d_1=float(d_1)).d_1)
        else:  # beyond infinity, or in the bore
            with pytest.raises(DesignError):
                scope.replace(d_1=float(d_1))
    assert 0 < len(taken) < 31
    assert min(taken) < scope.f < max(taken)
    with pytest.raises(DesignError, match="no real image"):
        roslf.load("paper").replace(f=100.0, d_1=100.0)


@pytest.mark.parametrize("share", [2e-3, 0.0, -2e-3])
def test_builds_on_both_sides_are_builds(share):
    scope = collimated().replace(d_1=SCOPE.f * (1 + share))
    builds = Camera.of(scope, {"d_1": scope.d_1 + np.linspace(-0.02, 0.02, 9)})
    assert builds.valid.all()
    assert (np.diff(builds["main_lens.focal_plane"]) < 0).all()


@pytest.mark.parametrize("share", SHARES)
def test_depths_and_disparities_turn_back_into_each_other(share):
    scope = collimated()
    camera = Camera.of(scope, {"d_1": scope.f * (1 + share)})
    z = np.array([97.0, 105.0, 118.0, 121.0, 130.0, 200.0])
    # Disparities cancel near the plane in focus: to 1e-13 of those far from it.
    np.testing.assert_allclose(depth_of(camera, disparity_of(camera, z)), z, rtol=1e-9)
    assert np.isnan(depth_of(camera, disparity_of(camera, np.array(1e12)) - 1.0))  # beyond infinity


@pytest.mark.parametrize("share", SHARES)
def test_a_calibration_tells_the_lengths_from_what_boards_show(share):
    scope = collimated()
    design = scope.replace(d_1=scope.f * (1 + share))
    camera, sheet = Camera.of(design), sheet_of(design)
    lengths = derived(camera_of(design).vector(), sheet)
    for name in ("d_1", "d_2", "d_3", "A", "H", "m"):
        # m is a difference of the boards' and the bore's, some 1e-13 of them off.
        assert lengths[name] == pytest.approx(float(getattr(camera.seen, name)), rel=1e-9, abs=1e-11), name
    by_ruler = sheet.space_at(lengths).ruler(lengths)
    for name in ("d_1", "d_2", "d_3", "d_f"):
        assert by_ruler[name] == pytest.approx(float(getattr(camera.ruler, name)), rel=1e-9), name


NEARNESS = st.builds(lambda side, power: side * 10.0**-power, st.sampled_from([-1, 1]), st.floats(1, 15))


@given(relay_scopes(), NEARNESS)
@settings(max_examples=25)
def test_any_relay_is_in_focus_where_matrices_say(scope, share):
    d_1 = scope.f * (1 + share)
    plane, together = in_focus(scope, d_1)
    camera = Camera.of(scope, {"d_1": d_1})
    tip = float(Camera.of(scope).tip)
    if plane > tip:
        assert camera.valid.all()
        # Distances ahead of the tip come of lengths up to plane / f_objective larger, good to 1e-16 of theirs.
        assert scope.replace(d_1=d_1).d_f == pytest.approx(float(plane), rel=1e-9)
        return
    told = [words for words, flags in camera.faults().items() if flags.any()]
    assert told == ["focal plane in the bore" if together else "in focus beyond infinity"]
    words = "is not in front of the farthest element" if together else "focuses beyond infinity"
    with pytest.raises(DesignError, match=words):
        scope.replace(d_1=d_1)


def numbers_of(data, place=""):
    """Every number of a JSON object, by its place."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from numbers_of(value, f"{place}.{key}")
    elif isinstance(data, list | tuple):
        for key, value in enumerate(data):
            yield from numbers_of(value, f"{place}.{key}")
    elif isinstance(data, float):
        yield place, data


@given(relay_scopes(), st.floats(6, 15))
@settings(max_examples=4)
def test_evaluate_goes_through_f_without_a_step(scope, power):
    """Both sides of f, and f itself, within what the slope of the plane in focus allows."""
    step = 10.0**-power
    here, *sides = (
        dict(numbers_of(roslf.evaluate(scope.replace(d_1=scope.f * (1 + share))).to_dict()))
        for share in (0.0, -step, step)
    )
    ahead = scope.d_f - float(Camera.of(scope).tip)
    moved = max(abs(float(in_focus(scope, scope.f * (1 + share))[0]) - scope.d_f) for share in (-step, step)) / ahead
    for side in sides:
        assert side.keys() == here.keys()
        for place, value in here.items():
            assert np.isfinite(value), place
            there = side[place]
            if "seen_distance" in place or "seen_diameter" in place:  # of what is at infinity as the main lens sees it
                value, there = 1 / value, 1 / there
            # Optics changes as the working distance does; what crosses 0 there, as its own size.
            assert there == pytest.approx(value, rel=30 * moved + 1e-6, abs=30 * moved + 1e-7), place


@pytest.mark.parametrize("share", [1e-3, 1e-6])
def test_hard_cases_are_as_near_on_both_sides_of_f(share):
    scope = collimated()
    ahead, beyond = (
        {one.case: one for one in near_cases(scope.replace(d_1=scope.f * (1 + way)))} for way in (share, -share)
    )
    # Seen at f over the share on either side; other cases change as the plane in focus does, by 2.7 m times the share.
    for case in ("d_f → ∞", "d_3 → f", "d_3 → 0"):
        assert ahead[case].distance == pytest.approx(beyond[case].distance, rel=0.05), case
    assert ahead["d_f → ∞"].near
    assert "main lens sees" in beyond["d_f → ∞"].says
    assert not any(cases["d_f → f"].near for cases in (ahead, beyond))
