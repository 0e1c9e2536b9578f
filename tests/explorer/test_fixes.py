"""A fix applied does what its label says, on random designs; one that is refused cannot be done."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.explorer.fixes import proposals
from roslf_design.reporting.design.curves import matching_plane
from roslf_design.theory.exit_pupil import is_telecentric, microlens_image_pitch
from roslf_design.theory.f_number import fill_factor, mismatch_px
from roslf_design.theory.field_of_view import judged_field
from roslf_design.theory.focused import LEAST_VIEWS, filtered_views
from roslf_design.theory.light import sensor_field
from roslf_design.theory.vignetting import field_limit
from tests.laws import DEAR
from tests.reporting.made import few_waves

PAPER = roslf.load("paper")


@pytest.fixture(scope="module", autouse=True)
def quick_consequences():
    """Labels tell depth precision after each fix, two thirds of all work; no law here is about it."""
    with pytest.MonkeyPatch.context() as patch:
        few_waves(patch)
        yield


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
    return field_limit(Camera.of(design)).clearance


@given(designs())
@DEAR
def test_fixes_do_what_they_say_and_what_is_refused_cannot_be_done(design):
    """The laws below, of one set of fixes: to make it is most of the work."""
    fixes = proposals_of(design)
    assert tuple(fixes) == KEYS
    do_what_they_say(design, fixes)
    held_against_every_distance(design, fixes)
    if abs(fill_factor(Camera.of(design)) - 1) > 1e-6:
        refused_matches_have_no_solution(design, fixes)


def proposals_of(design):
    return {fix.key: fix for fix in proposals(design)}


def do_what_they_say(design, fixes):
    for fix in fixes.values():
        assert bool(fix.why_not) != bool(fix.changes)
        assert bool(fix.outcome) == bool(fix.changes)
        if not fix.changes:
            continue
        changed = design.replace(**fix.changes)
        if fix.key.startswith("match-"):
            assert set(fix.changes) - {"f_ml"} == {fix.key.removeprefix("match-")}
            # The solved length is right to rounding; near d_3 = d_f or an exit pupil near the sensor the image fill
            # turns a last bit of it into many more.
            assert fill_factor(Camera.of(changed)) == pytest.approx(1, rel=1e-6)
            verdicts = {verdict.name: verdict.ok for verdict in roslf.evaluate(changed).verdicts}
            # A match that no pixels show is no good news, and has no tick.
            assert verdicts["f_number_matched"] == bool(filtered_views(Camera.of(changed)) >= LEAST_VIEWS)
        elif fix.key == "undistort-d_3":
            assert room(changed) >= 0
            assert room(design) < 0
        elif fix.key == "widest-field-d_3":
            assert field_limit(Camera.of(changed)).radius > field_limit(Camera.of(design)).radius
        else:
            assert is_telecentric(Camera.of(changed))


def corner_clearance(design, d_3):
    """Clearance of the pencils of the sensor's corners at the tightest rim [mm], for each distance of the FAP.

    By straight lines in object space, no formula of the package. Rims are discs, decentres lie along x: the worst
    corner's point, wherever the corner lies, is one of two on the x axis.
    """
    f, d_f, d_2 = design.f, design.d_f, design.d_2
    d_1 = 1 / (1 / f - 1 / d_f)
    with np.errstate(divide="ignore"):
        exit_pupil = 1 / (1 / f - 1 / d_3)  # behind the lens
        grown = np.abs(1 + d_2 / (d_1 - exit_pupil))  # pitch of image centres over that of microlenses
        half = np.minimum(0.5 * np.outer(design.microlens_array.size, np.ones_like(d_3)),
                          0.5 * np.outer(design.sensor.size, np.ones_like(d_3)) / grown)  # fmt: skip
    corner = np.hypot(*half) * d_f / d_1
    rims = [(0.0, design.D, 0.0), *((stop.distance, stop.diameter, stop.decentre[0]) for stop in design.stops)]
    margins = [
        diameter / 2
        - design.D_F / 2 * (d_f - z) / (d_f - d_3)
        - np.abs(side * corner * (z - d_3) / (d_f - d_3) - decentre)
        for z, diameter, decentre in rims
        for side in (-1, 1)
    ]
    return np.min(margins, axis=0)


def largest_field(design, d_3):
    """Radius on the focal plane up to which no rim cuts a pencil [mm], for each distance of the FAP; as above."""
    d_f = design.d_f
    rims = [(0.0, design.D, 0.0), *((stop.distance, stop.diameter, stop.decentre[0]) for stop in design.stops)]
    limits = []
    for z, diameter, decentre in rims:
        axial = diameter / 2 - abs(decentre) - design.D_F / 2 * (d_f - z) / (d_f - d_3)
        taken = np.abs(z - d_3) / (d_f - d_3)  # of each millimetre; none in the rim's own plane
        alike = np.where(axial >= -1e-12 * diameter, np.inf, 0.0)
        limits.append(np.where(taken > 1e-12, axial / np.maximum(taken, 1e-12), alike))
    return np.maximum(np.min(limits, axis=0), 0.0)


def held_against_every_distance(design, fixes):
    """Compare both moves of the FAP with a scan of all distances, and tell which answer the first one gave."""
    slack = 1e-9 * design.d_f  # rounding of lengths up to d_f, and steps of what is compared
    scan = np.linspace(1e-9, 1 - 1e-6, 20_001) * design.d_f
    clearance, free, here = corner_clearance(design, scan), fixes["undistort-d_3"], design.d_3
    if "already" in free.why_not:
        assert corner_clearance(design, np.array([here]))[0] > -slack
    elif free.changes:
        there = free.changes["d_3"]
        assert corner_clearance(design, np.array([there]))[0] > -slack
        nearer = np.abs(scan - here) < abs(there - here) - slack
        assert (clearance[nearer] < slack).all()
    else:
        assert (clearance < slack).all()
    widest = fixes["widest-field-d_3"].changes.get("d_3", here)
    reached = largest_field(design, np.array([widest]))[0]
    assert largest_field(design, scan).max() <= reached * (1 + 1e-6) + slack
    return "already" if "already" in free.why_not else "free" if free.changes else "never"


def test_a_stop_off_the_lens_is_cleared_where_its_pencils_are_narrow_again():
    """What the sensor sees changes with the FAP's distance: room goes before it comes."""
    design = PAPER.replace(
        {
            "stops": ({"diameter": 9.0, "distance": 5.0},),
            "microlens_array.size": (14.375, 10.0625),
            "sensor.size": (14.375, 10.0625),
        },
        f=2.0, d_f=10.0, D=33.0, D_F=0.5, d_3=0.0, d=0.125, d_2=2.5, f_ml=0.25, q=0.0125,
    )  # fmt: skip
    fixes = proposals_of(design)
    assert held_against_every_distance(design, fixes) == "free"
    free = fixes["undistort-d_3"]
    assert room(design.replace(**free.changes)) == pytest.approx(0, abs=1e-9)
    narrower = design.replace({"stops.0.diameter": 2.0})
    fixes = proposals_of(narrower)
    assert held_against_every_distance(narrower, fixes) == "never"
    never = fixes["undistort-d_3"]
    assert never.why_not.startswith("no FAP distance frees it: the ")


def refused_matches_have_no_solution(design, fixes):
    """Brute force over the length: the image fill never crosses 1."""
    for fix in [*fixes.values()][:3]:
        symbol = fix.key.removeprefix("match-")
        if fix.changes:
            continue
        tries = np.linspace(0, 1 - 1e-9, 400) * design.d_f
        if symbol != "d_3":
            tries = getattr(design, symbol) * np.geomspace(1e-3, 1e3, 400)
        if "does not fit" in fix.why_not:
            tries = np.geomspace(1e-3 * design.D, design.D, 400)  # a FAP that the lens lets through
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
    assert "depth noise 1.79 → 1.3" in fixes["telecentric"].outcome
    assert "image fill 0.689 → 1" in fixes["match-D_F"].outcome


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


def test_a_fap_between_rods_goes_through_none_and_nothing_is_offered_where_nothing_is_wrong():
    """Between rods that end 20 and 40 mm before the lens; 0.9 % of a pitch are matched, of lengths as sold."""
    rods = [
        {"kind": "plate", "distance": at, "thickness": 10.0, "material": "F2", "diameter": 24.0} for at in (10.0, 40.0)
    ]
    design = roslf.load("paper").replace({"elements": rods}, d_3=30.0)
    design = design.replace(d_2=1.2 * design.d_2)
    for fix in proposals(design):
        assert 20.0 <= fix.changes.get("d_3", 30.0) <= 40.0
        assert bool(fix.changes) != bool(fix.why_not)
    (match,) = (fix for fix in proposals(design) if fix.key == "match-d_2")
    design = design.replace(match.changes)
    near = design.replace(d=design.d / 0.991)
    told = {fix.key: fix.why_not for fix in proposals(near)}
    assert [told[f"match-{symbol}"] for symbol in ("d_2", "D_F", "d_3")] == ["the f-number is matched already"] * 3


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


def test_a_round_field_is_freed_at_its_rim_and_no_farther():
    """By hand: a pencil of the circle of 20 mm on the focal plane, straight lines from it over the FAP to the lens."""
    asked = {"round_field_radius_mm": {"min": 20.0}}
    design = PAPER.replace({"required": asked, "sensor.size": (30.0, 30.0)}, d_3=250.0)
    fix = proposals_of(design)["undistort-d_3"]
    assert fix.label == "Free the round field by d_3"
    exact = design.d_f * (design.D - design.D_F) / (design.D + 2 * 20.0)
    assert fix.changes["d_3"] == pytest.approx(exact, rel=1e-6)
    assert roslf.evaluate(design.replace(**fix.changes)).non_distortion.undistorted_in_field
    assert "round field undistorted, Eq. 6" in [key.text for key in matching_plane(design).keys]
    square = design.replace({"required": {}})
    assert proposals_of(square)["undistort-d_3"].changes["d_3"] < 0.9 * exact
    there = design.replace(d_3=exact - 1.0)
    assert proposals_of(there)["undistort-d_3"].why_not == "the round field is undistorted already"
    assert proposals_of(square.replace(d_3=exact - 1.0))["undistort-d_3"].changes


@pytest.mark.parametrize("asked", [("round_field_radius_mm", 20.0), ("round_field_of_view_deg", 10.0)])
def test_the_rim_of_a_round_field_of_many_cameras_is_each_one_s_own(asked):
    name, low = asked
    design = PAPER.replace({"required": {name: {"min": low}}})
    places = np.array([0.0, 20.0, 120.0, 250.0])
    field = judged_field(Camera.of(design, {"d_3": places}))
    # By hand: the focal plane is imaged at -d_1/d_f; an angle about the FAP's middle meets it so far off the axis.
    off = np.full(4, low) if asked[0].endswith("mm") else (design.d_f - places) * np.tan(np.radians(low / 2))
    assert np.hypot(*field.half) == pytest.approx(off * design.d_1 / design.d_f, rel=1e-8)
    own = [judged_field(Camera.of(design.replace(d_3=place))).half[0] for place in places]
    assert field.half[0] == pytest.approx(np.array(own), rel=1e-12)
    wide = PAPER.replace({"required": {"round_field_radius_mm": {"min": 200.0}}})
    assert judged_field(Camera.of(wide)).radius == sensor_field(Camera.of(wide)).radius
