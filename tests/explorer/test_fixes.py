"""A fix applied does what its label says, on random designs; one that is refused cannot be done."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.explorer.fixes import facts, proposals
from roslf_design.theory.exit_pupil import is_telecentric, microlens_image_pitch
from roslf_design.theory.f_number import mismatch_px
from roslf_design.theory.light import sensor_field
from roslf_design.theory.vignetting import field_limit

PAPER = roslf.load("paper")
KEYS = ("match-d_2", "match-D_F", "match-d_3", "undistort-d_3", "widest-field-d_3", "telecentric")


def share(low, high):
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def designs(draw):
    f = draw(share(2, 100))
    d_f = f * draw(share(1.2, 8))
    d = draw(share(0.02, 0.2))
    stops = [
        {
            "diameter": draw(share(1, 40)),
            "distance": draw(share(0, 0.9)) * d_f,
            "decentre": (draw(share(-0.5, 0.5)), 0.0),
        }
        for _ in range(draw(st.integers(0, 2)))
    ]
    side = draw(share(20, 200)) * d
    return PAPER.replace(
        {"stops": tuple(stops), "microlens_array.size": (side, 0.7 * side), "sensor.size": (side, 0.7 * side)},
        f=f, d_f=d_f, D=draw(share(2, 60)), D_F=draw(share(0.2, 20)), d_3=draw(share(0, 0.95)) * d_f, d=d,
        d_2=d * draw(share(2, 60)), f_ml=d * draw(share(2, 60)), q=d / draw(share(3, 30)),
    )  # fmt: skip


def corner(design):
    camera = Camera.of(design)
    return float(sensor_field(camera).radius * camera.inverse_m)


def room(design):
    return field_limit(Camera.of(design)).room


@given(designs())
@settings(max_examples=40)
def test_fixes_do_what_they_say(design):
    fixes = {fix.key: fix for fix in proposals(design)}
    assert tuple(fixes) == KEYS
    for fix in fixes.values():
        assert bool(fix.why_not) != bool(fix.changes)
        assert bool(fix.outcome) == bool(fix.changes)
        if not fix.changes:
            continue
        changed = design.replace(**fix.changes)
        if fix.key.startswith("match-"):
            assert set(fix.changes) - {"f_ml"} == {fix.key.removeprefix("match-")}
            # The solved length is right to rounding; near d_3 = d_f or an exit pupil near the sensor the fill factor
            # turns a last bit of it into many more.
            assert facts(changed).fill_factor == pytest.approx(1, rel=1e-6)
            assert roslf.evaluate(changed).verdicts[0].ok
        elif fix.key == "undistort-d_3":
            assert room(changed) >= 0
            assert room(design) < 0
        elif fix.key == "widest-field-d_3":
            assert facts(changed).undistorted_mm > facts(design).undistorted_mm
        else:
            assert is_telecentric(Camera.of(changed))


@given(designs(), st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_no_distance_tried_at_random_beats_the_widest_field_or_frees_more_cheaply(design, seed):
    fixes = {fix.key: fix for fix in proposals(design)}
    tries = np.random.default_rng(seed).uniform(0, 0.999, 40) * design.d_f
    best = design.replace(**fixes["widest-field-d_3"].changes)
    top = facts(best).undistorted_mm
    free = fixes["undistort-d_3"]
    now = room(design) >= 0
    moved = abs(design.replace(**free.changes).d_3 - design.d_3) if free.changes else math.inf
    for d_3 in tries:
        other = design.replace(d_3=float(d_3))
        assert facts(other).undistorted_mm <= top * (1 + 1e-6) + 1e-9
        if not now and room(other) >= 0:
            assert free.changes
            assert abs(d_3 - design.d_3) >= moved - 1e-6 * design.d_f


@given(designs())
@settings(max_examples=40)
def test_refused_matches_have_no_solution(design):
    """Brute force over the length: the fill factor never crosses 1."""
    assume(abs(facts(design).fill_factor - 1) > 1e-6)
    for fix in proposals(design)[:3]:
        symbol = fix.key.removeprefix("match-")
        if fix.changes:
            continue
        tries = np.linspace(0, 1 - 1e-9, 400) * design.d_f
        if symbol != "d_3":
            tries = getattr(design, symbol) * np.geomspace(1e-3, 1e3, 400)
        camera = Camera.of(design, {symbol: tries})
        pitch = np.broadcast_to(microlens_image_pitch(camera), tries.shape)
        # Crossings where images' order is reversed match nothing real.
        real = pitch > 0
        signs = np.sign(mismatch_px(camera)[real])
        assert abs(signs.sum()) >= len(signs) - 2


def test_closed_form_of_the_distance_that_frees_the_sensor():
    design = PAPER.replace({"sensor.size": (40.0, 40.0)}, d_3=200.0)  # the array's corner bounds the field
    (fix,) = (fix for fix in proposals(design) if fix.key == "undistort-d_3")
    exact = design.d_f * (design.D - design.D_F) / (design.D + 2 * corner(design))
    assert fix.changes["d_3"] == pytest.approx(exact, rel=1e-12)
    assert fix.changes["d_3"] <= exact * (1 + 1e-15)


def test_papers_numbers():
    fixes = {fix.key: fix for fix in proposals(roslf.load("paper-mismatched").replace({"depth.disparity_error": 0.1}))}
    assert fixes["match-d_3"].changes["d_3"] == pytest.approx(120.0, abs=5)
    assert fixes["telecentric"].changes == {"d_3": 100.0}
    assert "depth precision 1.79 → 1.3" in fixes["telecentric"].outcome
    assert "fill factor 0.689 → 1" in fixes["match-D_F"].outcome


def test_what_is_right_already_says_so():
    design = PAPER.replace(d_3=100.0)
    (first, *_) = (fix for fix in proposals(design) if fix.key == "match-d_2")
    design = design.replace(**first.changes)
    told = {fix.key: fix.why_not for fix in proposals(design)}
    assert "already" in told["match-d_2"]
    assert "already" in told["match-D_F"]
    assert "already" in told["telecentric"]
    assert "already" in told["undistort-d_3"]


def test_a_fap_beyond_a_rim_of_the_bore_can_go_to_it():
    """With two rims the best place is between them, where their bounds are equal."""
    design = PAPER.replace({"stops": ({"diameter": 12.0, "distance": 100.0},)}, d_3=200.0)
    (fix,) = (fix for fix in proposals(design) if fix.key == "widest-field-d_3")
    best = design.replace(**fix.changes)

    def bound(rim_diameter, z):
        axial = rim_diameter * (best.d_f - best.d_3) - best.D_F * (best.d_f - z)
        return axial / (2 * abs(best.d_3 - z))

    assert bound(design.D, 0.0) == pytest.approx(bound(12.0, 100.0), rel=1e-6)


def test_a_real_lens_is_mended_by_its_thin_twin():
    for fix in proposals(roslf.load("paper-singlet")):
        assert bool(fix.changes) != bool(fix.why_not)


@pytest.mark.parametrize("name", ["cystoscope", "grin-needle", "video-otoscope", "arthroscope"])
def test_fixes_behind_a_bore_do_what_they_say(name):
    design = roslf.load(name)
    design = design.replace(d_2=1.1 * design.d_2)
    fixes = {fix.key: fix for fix in proposals(design)}
    done = {key: Camera.of(design.replace(**fix.changes)) for key, fix in fixes.items() if fix.changes}
    for key in done.keys() & {"match-d_2", "match-D_F", "match-d_3"}:
        assert mismatch_px(done[key]) == pytest.approx(0, abs=1e-6), key
    if "telecentric" in done:
        assert is_telecentric(done["telecentric"])
    assert {"match-d_2", "match-D_F"} <= done.keys()
