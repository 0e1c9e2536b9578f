"""A speculum that is a cone: what its wall cuts against rays through many thin stops, and what fits by hand."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.design import DesignError, dumps, loads
from roslf_design.reporting.design.instrument import instrument_scene
from roslf_design.reporting.design.rays import meridional
from roslf_design.theory.tube import housed, room
from tests.evaluation.test_tube import fits, inserted, outer, verdict

CONE = {"outer_diameter": 4.0, "proximal_diameter": 7.0, "wall": 0.5, "length": 20.0}


@pytest.fixture(scope="module")
def speculum():
    """From 3 to 6 mm inside, over the 20 mm behind the FAP at its tip; the lens stands 10 mm behind the wide end."""
    return roslf.load("ear-speculum").replace(
        {"aperture.diameter": 2.0, "stops": [{"distance": 10.0, "bore": True, "name": "wide end"}], "tube": CONE}
    )


def passing(design, c, profile, count=400_001):
    """Share of the rays of a pinhole microlens at c that pass the FAP, so many thin stops, and the ideal lens.

    A stop is seen from the point that the microlens looks at as a disc in the FAP's plane, aside and larger or smaller.
    """
    k = np.arange(count) + 0.5
    radius, turn = design.D_F / 2 * np.sqrt(k / count), k * np.pi * (3 - np.sqrt(5))
    x, square = radius * np.cos(turn), radius**2
    point, d_f, d_3 = -c * design.d_f / design.d_1, design.d_f, design.d_3
    kept = np.ones(count, bool)
    for z, half in (*profile, (0.0, design.D / 2)):
        scale = (d_f - z) / (d_f - d_3)
        aside = point * (1 - scale) / scale
        kept &= square + 2 * aside * x <= (half / scale) ** 2 - aside**2
    return kept.mean()


@pytest.mark.parametrize("wide_end", [5.0, 7.0, 9.0])
def test_the_wall_cuts_as_many_thin_stops_along_it_do(speculum, wide_end):
    """To what the grid of rays leaves of an area with that edge."""
    design = speculum.replace({"tube.proximal_diameter": wide_end})
    profile = [(z, (3 + (wide_end - 4) * (30 - z) / 20) / 2) for z in np.linspace(30, 10, 60)]
    places = (0.0, 0.8, 1.4, 2.2)
    for c, field in zip(places, roslf.evaluate(design, fields=[(c, 0.0) for c in places]).fields, strict=True):
        assert field.kept_fraction == pytest.approx(passing(design, c, profile), abs=5e-5)
        assert (field.kept_fraction < 0.9) == (c * 3 > wide_end - 3)


def test_rims_of_the_wall_follow_it_in_builds_sweeps_and_at_other_temperatures(speculum):
    wide_ends, lengths = [5.0, 7.0, 9.0], [20.0, 25.0, 40.0]
    builds = Camera.of(speculum, {"tube.proximal_diameter": wide_ends, "tube.length": lengths})
    by_hand = [3 + (end - 4) * min(20 / length, 1) for end, length in zip(wide_ends, lengths, strict=True)]
    assert builds["stops.0.diameter"] == pytest.approx(by_hand, rel=1e-14)
    single = [
        float(Camera.of(speculum.replace({"tube.proximal_diameter": end, "tube.length": length}))["stops.0.diameter"])
        for end, length in zip(wide_ends, lengths, strict=True)
    ]
    assert builds["stops.0.diameter"] == pytest.approx(single, rel=1e-15)
    assert Camera.of(speculum, {"stops.0.diameter": 5.5})["stops.0.diameter"] == 5.5
    assert Camera.of(speculum, {"stops.0.distance": 20.0})["stops.0.diameter"] == pytest.approx(4.5, rel=1e-14)
    warm = speculum.replace({"environment": {"temperature": "60 degC", "housing": "aluminium"}})
    assert Camera.of(warm)["stops.0.diameter"] == pytest.approx(6 * (1 + 40 * 23.6e-6), rel=1e-9)
    cold = Camera.of(warm, {"environment.temperature": 20.0})
    assert cold["stops.0.diameter"] == pytest.approx(6, rel=1e-9)


def test_a_rim_of_a_straight_tube_is_as_wide_as_its_bore(speculum):
    straight = speculum.replace({"tube": {key: CONE[key] for key in ("outer_diameter", "wall", "length")}})
    assert straight["stops.0.diameter"] == 3.0
    stated = straight.replace({"stops.0.diameter": 3.0})
    a, b = (roslf.evaluate(design).to_dict() for design in (straight, stated))
    assert a == b


def test_each_part_fits_or_not_where_it_stands(speculum):
    """By hand: a window as wide as 4.5 mm fits where 4.5 mm are left, 10 mm behind the tip, and no farther ahead."""

    def window(ahead, wide):
        plate = {"kind": "plate", "distance": ahead - 1.0, "thickness": 1.0, "material": "N-BK7", "diameter": wide}
        return speculum.replace({"elements": [plate], "aperture.diameter": 1.0})

    assert float(room(Camera.of(speculum), 20.0)) == pytest.approx(4.5, rel=1e-14)
    good, bad = window(20.0, 4.45), window(22.0, 4.45)
    assert fits(good).ok
    assert "4 to 7 mm outside and a wall of 0.5 mm leave 3 to 6 mm" in fits(good).text
    assert not fits(bad).ok
    assert "plate 1 of 4.45 mm is 0.25 mm too wide" in fits(bad).text
    assert "a tube of 4.25 to 7.25 mm outside" in fits(bad).remedy
    assert inserted(good) == pytest.approx(7.0, rel=1e-12)
    assert inserted(bad) == pytest.approx(7.25, rel=1e-12)
    assert outer(good) == 25.4  # its head
    (plate,) = (part for part in housed(Camera.of(bad)) if part.name == "plate 1")
    assert plate.place == 22.0
    limited = bad.replace({"required": {"insertion_diameter_mm": {"max": "7 mm"}}})
    assert "the widest is plate 1, 4.45 mm" in verdict(limited, "required_insertion_diameter_mm").remedy


def test_the_field_s_remedy_counts_the_wall_where_it_cuts(speculum):
    remedy = verdict(speculum, "field_undistorted").remedy
    assert "the whole field takes wide end" in remedy.replace("the wide end", "wide end")
    assert "the tube leaves 6 mm there" in remedy


def test_a_wall_that_no_rim_stands_for_is_told(speculum):
    open_ = speculum.replace({"stops": ()})
    assert fits(open_).text.endswith('its wall cuts no rays, until [[stops]] says distance = "10 mm", bore = true')
    assert "cuts no rays" not in fits(speculum).text


def test_files_hold_a_cone_and_say_what_cannot_be(speculum):
    text = dumps(speculum)
    assert 'proximal_diameter = "7 mm"' in text
    assert loads(text) == speculum
    assert '{ bore = true, distance = "10 mm", name = "wide end" }' in text
    for changes, words in (
        ({"tube.length": None}, r"proximal_diameter is where a cone ends; give its length"),
        ({"tube.proximal_diameter": 3.0}, r"below outer_diameter, which is the tip's; swap them"),
        ({"tube": None}, r"stops\.0\.diameter: is missing; give it, or the \[tube\]"),
        ({"stops.0.diameter": 6.1}, r"bore is 6 mm wide .* this rim 6\.1 mm"),
    ):
        with pytest.raises(DesignError, match=words):
            speculum.replace(changes)


def test_drawings_show_the_cone(speculum):
    walls = [mark for mark in meridional(speculum).panels[0].marks if mark.testid == "tube"]
    assert [np.round(np.abs(wall.y), 9).tolist() for wall in walls] == [[2.0, 3.5, 3.0, 1.5]] * 2
    assert {tuple(np.round(wall.x, 9).tolist()) for wall in walls} == {(-30.0, -10.0, -10.0, -30.0)}
    (tube,) = (part for part in instrument_scene(speculum).parts if part.label == "tube")
    ends = {(round(float(np.hypot(x, y)), 9), round(float(z), 9)) for x, y, z in tube.points}
    assert ends == {(2.0, -30.0), (3.5, -10.0)}
