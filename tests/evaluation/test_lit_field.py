"""The field that pages quote ends where light does: against single rays through the openings."""

import math
import re
from operator import attrgetter

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design._arrays import sunflower
from roslf_design.bench.targets import setup_for
from roslf_design.calibration.planning import Captures, fitting_board
from roslf_design.evaluation.field_images import FieldImages, ObjectField, sides
from roslf_design.lenses.glass import find_glass
from roslf_design.theory.field_of_view import focus_ahead
from roslf_design.theory.vignetting import passed

TUBE = {"outer_diameter": 14.0, "wall": 2.0, "length": 90.0}
RIMS = [{"diameter": 10.0, "distance": 10.0}, {"diameter": 10.0, "distance": 100.0}]
PORT = roslf.load("paper").replace(
    {
        "main_lens": {"diameter": 25.4, "focal_length": 50.0},
        "aperture": {"diameter": 4.7, "distance": 55.0},
        "stops": RIMS,
        "microlens_array.distance": 200 * 50 / 150,
        "microlens_array.size": [14.1, 10.3],
        "sensor.size": [14.1, 10.3],
    }
)


def kept(design, away, plane):
    """Share of the rays of the FAP that get past all stops to a place on a plane, through the microlens it is seen by.

    Straight lines from a point in focus through points that fill the FAP; `plane` counts from the main lens [mm].
    """
    d_f, d_3 = design.d_f, design.d_3
    in_focus = away * (d_f - d_3) / (plane - d_3)
    x, y = design.D_F / 2 * sunflower(20_000)
    passed = np.ones_like(x, bool)
    for stop in design.stops:
        part = (d_f - stop.distance) / (d_f - d_3)
        passed &= np.hypot(in_focus + (x - in_focus) * part, y * part) <= stop.diameter / 2
    return passed.mean()


def test_the_quoted_field_is_lit_and_beyond_it_is_less_than_a_third_of_a_pencil():
    answer = roslf.evaluate(PORT).answer
    shown, tip = FieldImages.of(PORT), 100.0
    for ahead in (60.0, 100.0, 150.0):
        field = ObjectField.of(shown.ends, ahead, "")
        rim = field.diagonal_mm / 2
        assert field.width_mm == pytest.approx(field.diagonal_mm, rel=1e-12)
        # Equal discs a third of whose width is common leave .219, a strip through the middle .416.
        assert 0.21 < kept(PORT, rim, ahead + tip) < 0.42
        assert kept(PORT, 1.2 * rim, ahead + tip) < 0.1
        assert 2 * float(roslf.QUANTITIES["field_half_width_mm"](shown.images.camera, ahead)) == pytest.approx(
            field.width_mm, rel=1e-9
        )
    assert ObjectField.of(shown.seen, 100.0, "").width_mm > 1.4 * answer.at[0].width_mm
    assert answer.rows[0][1].endswith("deg round")
    assert answer.at[0].cells[1].endswith("mm round")
    assert answer.outermost == "corner of the sensor"
    across = math.degrees(2 * math.atan(answer.at[0].width_mm / 2 / (200 - 55)))
    assert answer.field_of_view_deg.width == pytest.approx(across, rel=1e-9)


def test_no_ray_passes_the_bore_beyond_the_radius_that_is_told():
    camera, rng = roslf.Camera.of(PORT), np.random.default_rng(5)
    for ahead in (60.0, 100.0, 150.0):
        through = min(passed(camera, ahead), key=attrgetter("radius"))
        told, pair = through.radius, through.pair
        assert {round(float(rim.ruler_distance)) for rim in pair} == {10, 100}
        # Lines through points of both rims, and of the lens: many on their edges, where the farthest go.
        near, far = (5.0 * np.exp(2j * np.pi * rng.random(200_000)) for _ in RIMS)
        slope = (far - near) / 90.0
        inside = np.abs(near - 10.0 * slope) <= 25.4 / 2
        reached = np.abs(far + ahead * slope)[inside].max()
        assert reached <= told * (1 + 1e-12)
        assert reached > 0.999 * told
    window = {"kind": "plate", "distance": 97.0, "thickness": 3.0, "material": "sapphire", "diameter": 10.0}
    glazed = PORT.replace({"stops": RIMS[:1], "elements": [window]})
    index = float(find_glass("sapphire").index(glazed.wavelength))
    told = min(one.radius for one in passed(roslf.Camera.of(glazed), 100.0))
    assert told == pytest.approx(5 + 100 * 10 / (87 + 3 / index), rel=1e-9)
    wide = PORT.replace({"required": {"round_field_radius_mm": {"at": "100 mm", "min": "20 mm"}}})
    missed = next(one for one in roslf.evaluate(wide).required)
    assert missed.remedy.startswith("no ray passes stop 1 and stop 2 beyond 16.11 mm there, whatever the lens")


def test_targets_lie_in_what_is_lit():
    plan = Captures.for_design(PORT)
    setup = setup_for(PORT, plan.board, (), 1)
    nearest = plan.distance - plan.distance_range / 2
    board = fitting_board(PORT, nearest, plan.distance + plan.distance_range / 2)
    assert board == plan.board
    assert kept(PORT, math.hypot(board.columns, board.rows) * board.cell / 2, nearest) > 0.21
    ball = setup.spheres
    tip, farthest = 100.0, max(setup.field.at)
    assert kept(PORT, setup.field.radii[-1], farthest + tip) > 0.21
    assert kept(PORT, setup.field.radii[-1] + setup.field.radii[-1] - setup.field.radii[-2], farthest + tip) < 0.21
    focus = 100.0 + float(focus_ahead(FieldImages.of(PORT).images.camera))
    assert kept(PORT, (ball.spacing + ball.diameter) / 2, focus) > 0.21
    assert kept(PORT, setup.edge.side / math.sqrt(2), focus) > 0.21
    open_ = PORT.replace({"stops": []})
    assert setup_for(open_, plan.board, (), 1).spheres.diameter > ball.diameter
    assert Captures.for_design(open_).board.cell > board.cell


def test_a_tube_that_would_cut_and_that_no_opening_stands_for_is_told_with_the_stop_that_counts_it():
    stated = PORT.replace({"stops": RIMS[1:], "tube": TUBE})
    (told, *_) = [one for one in roslf.evaluate(stated).verdicts if one.name == "tube_cuts"]
    assert 'distance = "10 mm", bore = true' in told.remedy
    assert "its rear end, 10 mm before the lens and 10 mm wide" in told.text
    whole = PORT.replace({"microlens_array.size": [2.0, 1.5], "sensor.size": [2.0, 1.5], "tube": TUBE})
    for fits in (PORT.replace({"tube": TUBE}), whole.replace({"stops": RIMS[1:]})):
        assert not [one for one in roslf.evaluate(fits).verdicts if one.name == "tube_cuts"]
    narrow = PORT.replace({"microlens_array.size": [7.0, 5.0], "sensor.size": [7.0, 5.0]})
    (told,) = [
        one
        for one in roslf.evaluate(narrow.replace({"stops": RIMS[1:], "tube": TUBE})).verdicts
        if one.name == "tube_cuts"
    ]
    corner = math.hypot(3.5, 2.5) * narrow.d_f / narrow.d_1
    left = 100 * kept(narrow, corner, narrow.d_f)
    shares = [float(word) for word in told.text.replace("%", "").split() if word.replace(".", "").isdigit()]
    assert min(abs(share - left) for share in shares) < 2.0


def test_only_what_light_ends_is_told_as_round():
    assert sides(28.2, 28.2, 28.21, "mm") == "28.2 mm round"
    assert sides(42.8, 31.1, 52.9, "mm") == "42.8 x 31.1 mm"
    assert sides(42.8, 0.1, 42.8, "mm") == "42.8 x 0.1 mm"


NAMED = [{**RIMS[0], "name": "cold end"}, {**RIMS[1], "name": "window"}]
REAL = PORT.replace(
    {
        "main_lens": {"part": "AC254-050-A", "focal_plane": 200.0},
        "microlens_array.distance": None,
        "aperture.diameter": 4.0,
        "stops": NAMED,
    }
)
ROUND = {"required": {"round_field_radius_mm": {"at": 100.0, "min": 20.0}}}


def test_behind_a_real_lens_it_ends_where_its_traced_images_keep_less_than_on_the_axis():
    overfilled = REAL.replace({"aperture.diameter": 10.0, "aperture.distance": 97.0})
    for design in (REAL, overfilled):
        shown = FieldImages.of(design)
        (x, y), *_ = shown.ends.fields[1:2]
        near, far, middle = (
            roslf.evaluate(design, fields=[(share * x, y)]).real_lens.fields[0].kept_fraction
            for share in (0.99, 1.02, 0.0)
        )
        assert far < 0.29 * middle < near + 0.01
    assert 0 < roslf.evaluate(REAL).answer.at[0].width_mm / 2 < 5 + 10 * 100 / 90  # a line through both rims


def test_a_remedy_s_rims_are_wide_enough_by_rays():
    """The openings that are told leave all images of the round field whole; those between do not."""
    asked = REAL.replace(ROUND)

    def widened(share):
        result = roslf.evaluate(asked)
        (told,) = [one.remedy for one in result.verdicts if one.name == "field_undistorted"]
        by = dict(re.findall(r"the (cold end|window) by ([0-9.]+) mm", told))
        stops = [{**stop, "diameter": 10.0 + share * float(by[stop["name"]])} for stop in NAMED]
        return roslf.evaluate(asked.replace({"stops": stops})).real_lens.undistorted_in_field

    assert widened(1.0)
    assert not widened(0.9)


def test_a_round_field_that_the_sensor_ends_is_not_put_down_to_the_lens():
    """Rims as wide as suits: the sensor's half height is what is seen, and one as much higher sees what is asked."""
    limit = {"required": {"round_field_radius_mm": {"at": 100.0, "min": 14.0}}}
    open_ = REAL.replace({**limit, "stops": [], "sensor.size": [14.1, 12.0], "microlens_array.size": [14.1, 12.0]})
    (told,) = [one for one in roslf.evaluate(open_).verdicts if one.name.startswith("required_round")]
    assert "the lens does not image" not in told.remedy
    wider = float(re.search(r"the sensor ends it: about one ([0-9.]+) times as wide", told.remedy)[1])
    size = [14.1, 12.0 * wider * 1.05]
    assert roslf.evaluate(open_.replace({"sensor.size": size, "microlens_array.size": size})).required[0].met
    cut = roslf.evaluate(REAL.replace(ROUND)).required[0].remedy
    assert "the cold end and the window leave less than a third of the pencils there: widen" in cut
    assert "does not image" not in cut
