"""What fits inside the tube of a scope, by hand: widths, decentres, what lies behind a short tube; and limits on it."""

import json
import math
import re

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design import DesignError, dumps, loads, save
from roslf_design.explorer.fixes import proposals
from roslf_design.lenses.glass import AIR, find_glass
from roslf_design.lenses.prescription import Prescription, Surface
from roslf_design.optimization.solve import Settings, solve
from roslf_design.optimization.variables import name_faults
from roslf_design.theory.tube import housed, room, unsaid_bore
from tests.optimization.posing import goal, limit, posed

TUBE = {"outer_diameter": 10.0, "wall": 0.25}


@pytest.fixture(scope="module")
def scope():
    """Widths: FAP 2, stop 5, window 6 and 0.1 aside, lens 8, array 3 x 4, sensor 6 x 8; ends at 119 mm."""
    return roslf.load("paper").replace(
        {
            "aperture.distance": 116.0,
            "aperture.diameter": 2.0,
            "stops": [{"diameter": 5.0, "distance": 50.0}],
            "elements": [
                {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": "N-BK7", "diameter": 6.0,
                 "decentre": (0.06, 0.08)}
            ],
            "main_lens.diameter": 8.0,
            "microlens_array.size": (3.0, 4.0),
            "sensor.size": (6.0, 8.0),
            "tube": TUBE,
        }
    )  # fmt: skip


def fits(design):
    return next(verdict for verdict in roslf.evaluate(design).verdicts if verdict.name == "fits_tube")


def outer(design):
    return float(roslf.quantity("outer_diameter_mm")(Camera.of(design)))


def inserted(design):
    return float(roslf.quantity("insertion_diameter_mm")(Camera.of(design)))


@pytest.fixture
def fold():
    """A mirror at 45 degrees of 18.5 mm, whose rim reaches 18.5/2 sin 45° = 6.541 mm, and a window 6 mm before it."""
    return roslf.load("paper").replace(
        {
            "aperture.distance": 5.0,
            "elements": [
                {"kind": "mirror", "distance": 75.0, "angle": math.radians(45.0), "diameter": 18.5},
                {"kind": "plate", "distance": 81.0, "thickness": 1.0, "material": "N-BK7"},
            ],
        }
    )


def test_parts_that_collide_are_a_fault_a_limit_and_a_reason(fold, tmp_path):
    short = 18.5 / 2 * math.sin(math.radians(45)) - 6
    said = roslf.evaluate(fold).verdicts[0]
    assert (said.name, said.level) == ("parts_clear", "fault")
    assert f"mirror 1 and plate 2 collide by {short:.3g} mm" in said.text
    for clear in ({"elements.0.diameter": 16.8}, {"elements.1.distance": 81 + short + 1e-9}):
        assert "parts_clear" not in [one.name for one in roslf.evaluate(fold.replace(clear)).verdicts]
    still = posed({"d_2": (1.9, 2.1)}, (), goal("aperture_constant", "max"), design=fold)  # neither part moves
    assert not solve(still, Settings(starts=1, seed=1), lambda *_: None).feasible
    moved = {"elements.1.distance": (79.0, 90.0), "d_2": (1.9, 2.1)}
    problem = posed(moved, (), goal("working_distance_mm", "max"), design=fold)
    found = solve(problem, Settings(starts=1, seed=1), lambda *_: None)
    assert found.feasible
    assert problem.named(found.unit)["elements.1.distance"] == pytest.approx(81 + short, rel=1e-5)
    save(fold, tmp_path / "fold.toml")
    study = 'name = "s"\ndesign = "fold.toml"\ngrade = "precision"\n[[goals]]\nquantity = "fill_factor"\nmin = 0.9\n'
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    with pytest.raises(roslf.InputError, match="cannot be built: mirror 1 and plate 2 collide"):
        roslf.tolerance(tmp_path / "study.toml")


def verdict(design, name):
    return next(verdict for verdict in roslf.evaluate(design).verdicts if verdict.name == name)


def test_no_remedy_is_wider_than_the_tube_or_the_lens_leave_room_for():
    """Microlenses so wide that images match through a FAP that nothing holds; a main lens, and a window, that cut."""
    scope = roslf.load("rigid-scope")
    wide = scope.replace(d=2.5 * scope.d)
    (needed,) = (fix.changes["D_F"] for fix in proposals(scope.replace(d=1.05 * scope.d)) if fix.key == "match-D_F")
    needed *= 2.5 / 1.05
    for lens, tube, fitting in ((1.1, 1.2, True), (0.9, 1.2, False), (1.1, 0.9, False)):
        tubes = {"tube": {"outer_diameter": tube * needed + 0.2, "wall": 0.1}}
        held = wide.replace({**tubes, "main_lens.diameter": lens * needed})
        assert ("D_F = " in verdict(held, "f_number_matched").remedy) == fitting
        (fix,) = (fix for fix in proposals(held) if fix.key == "match-D_F")
        assert bool(fix.changes) == fitting
        assert ("does not fit" in fix.why_not) != fitting
    cut = scope.replace({"main_lens.diameter": 0.9}, d_3=3.0)
    wanted = float(verdict(cut, "field_undistorted").remedy.split(" mm")[0].split()[-1])
    for tube, fitting in ((wanted + 0.3, True), (wanted + 0.1, False)):
        remedy = verdict(cut.replace({"tube": {"outer_diameter": tube, "wall": 0.1}}), "field_undistorted").remedy
        assert (f"{wanted:g} mm clear aperture" in remedy) == fitting
        assert ("and the tube leaves" in remedy) != fitting
    head = cut.replace({"tube": {"outer_diameter": wanted + 0.1, "wall": 0.1, "length": 1.0}})  # the lens 3 mm behind
    assert f"{wanted:g} mm clear aperture" in verdict(head, "field_undistorted").remedy


def test_no_aperture_is_advised_inside_a_window():
    """Where d_3 as it matches is known, a window about it in place of air."""
    bench = roslf.load("paper-mismatched")
    place = next(fix.changes["d_3"] for fix in proposals(bench) if fix.key == "match-d_3")
    told = float(verdict(bench, "f_number_matched").remedy.partition("d_3 = ")[2].split(" mm")[0])
    assert place - 0.01 < told <= place  # on the side where images do not overlap
    window = {"kind": "plate", "distance": place - 4.0, "thickness": 12.0, "material": {"index": 1.0001}}
    assert "d_3 = " not in verdict(bench.replace({"elements": [window]}), "f_number_matched").remedy


def test_each_part_that_is_too_wide_is_named_with_what_is_missing(scope):
    assert outer(scope) == pytest.approx(10 + 0.5)  # the sensor's diagonal
    told = fits(scope)
    assert not told.ok
    assert "tube: sensor of 10 mm is 0.5 mm too wide; 10 mm outside and a wall of 0.25 mm leave 9.5 mm" in told.text
    assert "a tube of 10.5 mm outside" in told.remedy
    narrow = fits(scope.replace({"tube.outer_diameter": 6.5}))
    for words in (
        "plate 1 of 6.2 mm is 0.2 mm too wide",
        "main lens of 8 mm is 2 mm too wide",
        "sensor of 10 mm is 4 mm too wide",
    ):
        assert words in narrow.text
    assert "stop 1" not in narrow.text
    assert "microlens array" not in narrow.text
    assert outer(scope.replace({"tube.outer_diameter": 12.0})) == 12.0  # the tube's own, wider than the parts need
    exact = fits(scope.replace({"tube.outer_diameter": 10.5}))
    assert exact.ok
    assert "widest is the sensor, 10 mm" in exact.text


@pytest.mark.parametrize(
    ("length", "wide"),
    # From the tip at 119 mm; the lens at 0, the array 140 mm and the sensor 142 mm behind it.
    [(60.0, 6.2), (118.9, 6.2), (119.1, 8.0), (258.0, 8.0), (260.9, 8.0), (261.1, 10.0)],
)
def test_what_lies_behind_a_short_tube_need_not_fit(scope, length, wide):
    tube = {**TUBE, "outer_diameter": 1.0}  # too narrow: what parts need is its outer diameter
    assert inserted(scope.replace({"tube": {**tube, "length": length}})) == pytest.approx(wide + 0.5)
    # the head behind it counts for the whole, as wide as it is, with no wall of the tube's
    assert outer(scope.replace({"tube": {**tube, "length": length}})) == pytest.approx(10.5 if wide == 10 else 10)


def test_what_is_inserted_and_what_stays_outside_are_two_lines(scope):
    """The first 60 mm, to the lens's 8 mm and the sensor's 10 mm behind; all of it; and no word on it."""
    short = scope.replace({"tube": {"outer_diameter": 7.0, "wall": 0.25, "length": 60.0}})
    rows = {name: (value, remark) for name, value, remark in roslf.evaluate(short).answer.rows}
    assert rows["inserted width"][0] == "7 mm"
    assert rows["inserted width"][1].startswith("the first 60 mm: tube as stated: parts of 6.2 mm and walls of 0.25 mm")
    words = "of the whole camera, by its head, which stays outside: sensor, 10 mm, without wall or sensor package"
    assert rows["outer diameter"] == ("10 mm", words)
    for tube, says in (
        (TUBE, "of all of the camera; tube"),
        (None, "no [tube] stated: without wall, "),
    ):
        answer = roslf.evaluate(scope.replace({"tube": tube})).answer
        (remark,) = [remark for name, _, remark in answer.rows if name == "outer diameter"]
        assert says in remark
        assert answer.insertion_diameter_mm == answer.outer_diameter_mm == pytest.approx(10.5 if tube else 10)


def test_a_stop_behind_the_tube_makes_it_no_wider(scope):
    """The FAP of 2 mm lies 20 mm before the lens, the window's 6.2 mm alone in the first 10 mm of the tube."""
    tube = {"outer_diameter": 1.0, "wall": 0.25, "length": 10.0}
    wide = scope.replace({"aperture.distance": 20.0, "aperture.diameter": 7.0, "tube": tube})
    assert inserted(wide) == pytest.approx(6.2 + 0.5)


@pytest.mark.parametrize(("most", "level"), [(7.0, "good"), (6.9, "fault")])
def test_a_limit_of_what_is_inserted_does_not_count_the_head(scope, most, level):
    tube = {"outer_diameter": 7.0, "wall": 0.25, "length": 60.0}
    asked = scope.replace({"tube": tube, "required": {"insertion_diameter_mm": {"max": most}}})
    told = verdict(asked, "required_insertion_diameter_mm")
    assert told.level == level
    assert "the first 60 mm: as stated" in told.text
    assert "sensor package" not in told.text
    sheet = roslf.specification(asked)
    assert (sheet.insertion_diameter_mm, sheet.outer_diameter_mm) == (7.0, pytest.approx(10))
    if level == "fault":
        assert "the widest is plate 1, 6.2 mm" in told.remedy


def test_a_sensor_behind_a_relay_may_be_anywhere(scope):
    relayed = scope.replace({"sensor.relay_magnification": 0.5, "tube.outer_diameter": 8.0})  # narrower than the lens's
    assert outer(relayed) == pytest.approx(8.5)


def test_designs_without_a_tube_say_nothing_of_it(scope):
    bare = scope.replace({"tube": None})
    assert all(verdict.name != "fits_tube" for verdict in roslf.evaluate(bare).verdicts)
    assert outer(bare) == pytest.approx(10.0)


def test_files_hold_a_tube_and_say_what_cannot_be(scope, tmp_path, capsys):
    assert loads(dumps(scope)) == scope
    text = dumps(scope)
    for old, new, said in (
        ('wall = "250 um"', 'wall = "5 mm"', "leaves no room; make it thinner"),
        ('wall = "250 um"', "wall = 0.25", "0.25 has no unit"),
        ('wall = "250 um"', 'wall = "250 um"\nlenght = "1 mm"', "did you mean 'length'?"),
        ('wall = "250 um"\n', "", "tube.wall"),
        ('wall = "250 um"', 'wall = "0 mm"', "must be greater than zero"),
    ):
        mended = text.replace('wall = "0.25 mm"', 'wall = "250 um"')
        assert old in mended
        (tmp_path / "bad.toml").write_text(mended.replace(old, new))
        assert main(["evaluate", str(tmp_path / "bad.toml")]) == 2
        err = capsys.readouterr().err
        assert said in err, err
        assert len(err.splitlines()) == 1
    with pytest.raises(DesignError):
        scope.replace({"tube.wall": 6.0})


def test_the_command_tells_it(scope, tmp_path, capsys):
    save(scope, tmp_path / "scope.toml")
    assert main(["evaluate", str(tmp_path / "scope.toml")]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert (
        "does not fit inside the tube: sensor of 10 mm is 0.5 mm too wide → smaller ones, or a tube of 10.5 mm" in told
    )


def test_an_array_too_wide_is_diced_to_what_the_sensor_sees(tmp_path, capsys):
    tube = {"outer_diameter": 4.0, "wall": 0.2}
    wide = roslf.load("rigid-scope").replace({"microlens_array.size": (10.0, 10.0), "tube": tube})

    def fits(design):
        return next(verdict for verdict in roslf.evaluate(design).verdicts if verdict.name == "fits_tube")

    assert "an array diced to all that the sensor sees, " in fits(wide).remedy
    size = re.search(r"microlens_array.size = (\[.*?\])", fits(wide).remedy)[1]
    save(wide, tmp_path / "wide.toml")
    assert main(["evaluate", str(tmp_path / "wide.toml")]) == 0
    assert f"microlens_array.size = {size}" in " ".join(capsys.readouterr().out.split())  # in brief, too
    cut = wide.replace({"microlens_array.size": json.loads(size)})
    assert fits(cut).level == "good"
    assert roslf.evaluate(cut).value("field_half_width_mm") == roslf.evaluate(wide).value("field_half_width_mm")


def test_the_optimiser_holds_it(scope):
    """Against brute force over the lens's and the window's width: the widest lens that a tube of 7 mm leaves."""
    small = scope.replace({"sensor.size": (3.0, 4.0), "tube.outer_diameter": 7.0})  # a wider tube would hold no limit
    problem = posed(
        {"D": (3.0, 12.0), "elements.0.diameter": (3.0, 12.0)},
        (limit("outer_diameter_mm", high=7.0),),
        goal("f_number_main_lens", "min"),
        design=small,
    )
    answer = solve(problem, Settings(starts=3, check=False, isres=False), lambda *_: None)
    assert answer.feasible
    assert answer.problem.named(answer.unit)["D"] == pytest.approx(6.5, rel=1e-6)
    labels = [row.label for row in problem.rows if "outer_diameter" in row.label]
    assert "outer_diameter_mm (main lens) <= 7 mm" in labels
    assert {"outer_diameter_mm (plate 1) <= 7 mm", "outer_diameter_mm (tube) <= 7 mm"} <= set(labels)
    units = np.random.default_rng(1).uniform(0, 1, (500, 2))
    rows, cameras = problem.vector(units)[1:], problem.cameras(units)
    by_hand = np.maximum(cameras["main_lens.diameter"], cameras["elements.0.diameter"] + 0.2) + 0.5
    by_hand = np.maximum(by_hand, 7.0)  # the tube as stated
    named = np.array(["outer_diameter" in row.label for row in problem.rows])
    assert np.array_equal(np.all(rows[named] <= 0, axis=0), by_hand <= 7)
    assert "is nothing that can vary" in next(name_faults(("tube.wall",), problem.base.numbers))


def test_a_tube_counts_the_sensors_package_and_a_light_guide_and_says_what_it_does_not():
    scope = roslf.load("rigid-scope").replace({"tube": {"outer_diameter": 4.0, "wall": 0.1}})
    bare = fits(scope).text
    assert "without sensor package or light guide" in bare
    packaged = scope.replace({"sensor.package": (2.0, 2.4)})
    camera = Camera.of(packaged)
    assert {part.name: float(part.width) for part in housed(camera)}["sensor"] == pytest.approx(math.hypot(2.0, 2.4))
    assert "without light guide" in fits(packaged).text
    lit = packaged.replace({"tube.light_guide": 0.35})
    assert float(room(Camera.of(lit), 0.0)) == pytest.approx(4.0 - 2 * (0.1 + 0.35))
    held = fits(lit)
    assert "does not fit" in held.text  # 3.12 mm of package in 3.1 mm
    assert "wall with its light guide of 0.45 mm" in held.text
    assert "without" not in held.text
    with pytest.raises(DesignError, match="wall and light_guide are half the outer diameter"):
        lit.replace({"tube.light_guide": 1.95})


def test_a_real_lens_is_as_wide_as_its_widest_surface_whatever_its_clear_aperture(scope):
    """A window of 9.6 mm before a lens of 6 and 5 mm, in a bore of 9.5 mm; a stop at it makes it no narrower."""
    glass, half = find_glass("N-BK7"), (4.8, 4.8, 3.0, 2.5)
    shapes = [(-0.002, 1.0, glass), (-0.002, 2.0, AIR), (0.0095, 2.0, glass), (-0.0095, 0.0, AIR)]
    lens = Prescription(tuple(Surface(c, h, t, g) for h, (c, t, g) in zip(half, shapes, strict=True)))
    small = {"sensor.size": (3.0, 4.0)}
    group = {"kind": "prescription", "distance": 60.0, "prescription": lens}
    in_bore = scope.replace({**small, "elements": [*scope.elements, group]})
    for design, name in (
        (in_bore, "prescription 2"),
        (scope.replace({**small, "main_lens": {"prescription": lens}}), "main lens"),
    ):
        told = fits(design)
        assert f"tube: {name} of 9.6 mm is 0.1 mm too wide; " in told.text
        assert "a tube of 10.1 mm outside" in told.remedy
        assert outer(design) == pytest.approx(9.6 + 0.5)
    assert float(design.D) == 5.0
    assert outer(design.replace({"main_lens.diameter": 4.0})) == pytest.approx(10.1)
    asked = (limit("outer_diameter_mm", high=10.0),)
    problem = posed({"d_3": (100.0, 120.0)}, asked, goal("d_3", "max"), design=design)
    row = [row.label for row in problem.rows].index("outer_diameter_mm (main lens) <= 10 mm")
    assert (problem.vector(np.full((3, 1), 0.5))[1:][row] > 0).all()


@pytest.fixture(scope="module")
def sideways():
    """A prism 4 mm long turns the view by 90 degrees at 10 mm, then a window 2 mm wide ends 4 mm aside."""
    prism = {"kind": "prism", "distance": 8.0, "thickness": 4.0, "material": "N-BK7", "diameter": 4.0,
             "deviation": math.pi / 2, "azimuth": 0.3, "reflections": 1}  # fmt: skip
    window = {"kind": "plate", "distance": 13.0, "thickness": 1.0, "material": "N-BK7", "diameter": 2.0}
    return roslf.load("rigid-scope").replace(
        {"elements": [prism, window], "tube": {"outer_diameter": 9.0, "wall": 0.5}}, d_3=5.0
    )


def test_what_lies_ahead_of_a_fold_stands_sideways(sideways):
    """Window's rim by Pythagoras, beside the exit face of the prism; by several reflections no one knows."""
    assert fits(sideways).ok
    assert outer(sideways.replace({"tube": None})) == pytest.approx(2 * math.hypot(4, 1))
    far = sideways.replace({"elements.1.distance": 18.0})
    assert f"out to {math.hypot(9, 1):.4g} mm from the tube's axis, of 4.5 mm" in fits(far).text
    assert outer(far) == pytest.approx(2 * math.hypot(9, 1))
    assert outer(far.replace({"elements.1.diameter": None})) == pytest.approx(18)
    long = sideways.replace({"elements.0.thickness": 4.9, "elements.1.diameter": 0.1, "elements.0.diameter": 8.0})
    assert f"prism 1 lies sideways, out to {math.hypot(2.45, 4):.4g} mm" in fits(long).text
    slanting = far.replace({"elements.0.deviation": math.pi / 6})
    assert outer(slanting.replace({"tube": None})) == pytest.approx(2 * (9 / 2 + math.cos(math.pi / 6)))
    unknown = fits(far.replace({"elements.0.reflections": 2}))
    assert (unknown.ok, unknown.level) == (False, "limit")
    assert "not judged: what lies ahead of prism 1 stands sideways" in unknown.text


def test_a_short_tube_is_named_where_what_is_too_wide_lies_behind_it(scope):
    assert "ends before the main lens, say so: [tube] length, below 119 mm" in fits(scope.replace(
        {"tube.outer_diameter": 7.5}
    )).remedy  # fmt: skip
    assert "[tube] length" not in fits(scope.replace({"tube.outer_diameter": 7.5, "tube.length": 119.5})).remedy


@pytest.mark.parametrize("turn", [60.0, 90.0, 120.0])
def test_a_prism_whose_square_block_does_not_fit_counts_as_ground_round_and_says_so(sideways, turn):
    """Corners of both faces in space, the second turned about the middle of the path; endoscopes have them ground."""
    half, path, angle = 2.3, 5.0, math.radians(turn)
    changes = {"elements.0.diameter": 2 * half, "elements.0.thickness": path, "elements.0.deviation": angle}
    alone = sideways.replace({"elements": sideways.elements[:1]}).replace(changes)
    beyond = [math.hypot(path / 2 * math.sin(angle) + way * half * math.cos(angle), half) for way in (-1, 1)]
    corners = 2 * max(math.hypot(half, half), *beyond)
    words = f"across the corners of a square block it is {corners:.4g} mm"
    for left, said in ((corners * 0.999, True), (corners * 1.001, False)):
        told = fits(alone.replace({"tube": {"outer_diameter": left + 0.4, "wall": 0.2}}))
        assert told.ok
        assert (words in told.text) == said


def test_a_prism_of_one_reflection_is_as_long_as_its_aperture_takes(sideways):
    """In the fold's plane: neither the mirror nor the faces of a prism may end within the beam."""
    for degrees, least in ((60, 4 / math.tan(math.radians(30))), (90, 4.0), (120, 4 * math.tan(math.radians(60)))):
        for share, told in ((0.99, True), (1.01, False)):
            path = share * least
            design = sideways.replace(
                {
                    "elements.0.thickness": path, "elements.0.deviation": math.radians(degrees),
                    "elements.1.distance": 8.5 + path, "tube": None,
                }
            )  # fmt: skip
            assert [one.name for one in roslf.evaluate(design).verdicts].count("prism_too_short") == told


def test_a_length_that_a_fold_shortens_and_the_part_that_takes_the_room_are_told(sideways):
    """The fold stands at 10 mm, the tip at 14: of 12 mm 8 go along the tube; the window ends 4.12 mm aside."""
    rows = roslf.evaluate(sideways.replace({"tube.length": 12.0, "tube.outer_diameter": 8.0})).answer.rows
    (remark,) = (remark for name, _, remark in rows if name == "inserted width")
    assert remark.startswith("the first 12 mm of the light's way, 8 mm of them up to its fold: ")
    assert f"plate 2, sideways, out to {math.hypot(4, 1):.4g} mm" in remark


def test_a_picture_reversed_by_one_reflection_is_told_of(sideways):
    assert "reversed, left and right, by one reflection: prism 1" in verdict(sideways, "picture_reversed").text
    twice = roslf.evaluate(sideways.replace({"elements.0.reflections": 2}))
    assert all(one.name != "picture_reversed" for one in twice.verdicts)


def test_a_bought_window_counts_to_its_outside(scope):
    """Light passes its clear aperture; the tube holds all of it. One made to a drawing has its diameter only."""
    drawn = {"kind": "plate", "distance": 118.0, "thickness": 1.0, "material": "sapphire", "diameter": 7.2}
    tube = {"outer_diameter": 7.9, "wall": 0.25}
    thin = scope.replace({"main_lens.diameter": 7.0, "sensor.size": (3.0, 4.0), "tube": tube, "elements": [drawn]})
    assert fits(thin).ok
    told = fits(thin.replace({"elements": [{**drawn, "part": "sapphire 8 x 1 mm"}]}))
    assert not told.ok
    assert "plate 1 of 8 mm is 0.6 mm too wide" in told.text


def test_a_window_of_an_own_catalogue_counts_to_its_outside(scope, tmp_path):
    own = 'part = "quote 7"\ndiameter = "8 mm"\nclear_aperture = "7 mm"\nthickness = "1 mm"\nmaterial = "sapphire"'
    (tmp_path / "mine.toml").write_text(f'[[windows]]\n{own}\nprovenance = "quote"\nconfidence = "typical"\n')
    tube = {"outer_diameter": 7.9, "wall": 0.25}
    thin = scope.replace({"main_lens.diameter": 7.0, "sensor.size": (3.0, 4.0), "tube": tube, "elements": []})
    part = 'part = {file = "mine.toml", name = "quote 7"}'
    for drawn, wide in ((part, 8.0), (f'{part}\ndiameter = "6.8 mm"', 8.0), (f'{part}\nouter_diameter = "9 mm"', 9.0)):
        (tmp_path / "camera.toml").write_text(
            dumps(thin) + f'\n[[elements]]\nkind = "plate"\ndistance = "118 mm"\n{drawn}\n'
        )
        design = roslf.load(tmp_path / "camera.toml")
        assert outer(design) == pytest.approx(wide + 2 * 0.25)
        assert f"plate 1 of {wide:g} mm is {wide - 7.4:.2g} mm too wide" in fits(design).text
        assert outer(roslf.loads(dumps(design))) == outer(design)


def test_a_bought_lens_counts_to_its_edge(scope, tmp_path):
    """Of an own catalogue as of the one that ships; a lens made to a drawing has its diameter only."""
    own = 'part = "quote 118"\ndiameter = "8.4 mm"\nfocal_length = "20 mm"\nclear_aperture = "7 mm"'
    (tmp_path / "mine.toml").write_text(f'[[lenses]]\n{own}\nprovenance = "quote"\nconfidence = "typical"\n')
    thin = scope.replace({"sensor.size": (3.0, 4.0), "tube": {"outer_diameter": 8.7, "wall": 0.25}})
    text = dumps(thin.replace({"main_lens.diameter": 7.0}))
    part = 'part = {file = "mine.toml", name = "quote 118"}'
    path = tmp_path / "camera.toml"
    path.write_text(re.sub(r"(?m)^(\[main_lens\]\n)diameter = .*", rf"\1{part}", text))
    for design, ok in ((loads(text), True), (roslf.load(path), False)):
        told = fits(design)
        assert (float(design.D), told.ok) == (7.0, ok)
    assert "main lens of 8.4 mm is 0.2 mm too wide" in told.text
    assert outer(design) == pytest.approx(8.9)
    bought = scope.replace(
        {"main_lens": {"part": "achromat 25.4 mm f30", "focal_plane": 300.0}, "d_1": None, "tube": TUBE}
    )
    assert bought.main_lens.outer_diameter == 25.4
    assert fits(bought).text.startswith("does not fit inside the tube: main lens of 25.4 mm is 15.9 mm too wide")


def test_what_no_tube_holds_stands_before_all_but_what_is_asked_for():
    """A lens that cannot be put in is no question of images that match."""
    tight = roslf.load("video-otoscope").replace({"main_lens.diameter": 4.0, "aperture.diameter": 0.3})
    names = [verdict.name for verdict in roslf.evaluate(tight).verdicts]
    assert names[:3] == ["required_insertion_diameter_mm", "fits_tube", "f_number_matched"]
    bare = roslf.evaluate(tight.replace({"required": []})).verdicts
    assert bare[0].name == "fits_tube"
    assert bare[0].remedy
    fitting = roslf.evaluate(roslf.load("video-otoscope")).verdicts
    assert [verdict.name for verdict in fitting].index("fits_tube") > 2


# --- openings that are the tube's own bore ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def speculum(scope):
    """The tube of 5 mm with walls of 0.5 mm ends in a rim as wide as its bore, 119 mm before the lens."""
    changes = {
        "stops": [{"diameter": 4.0, "distance": 118.5, "bore": True}],
        "elements": [],
        "tube": {"outer_diameter": 5.0, "wall": 0.5, "length": 10.0},
    }
    return scope.replace(changes)


def test_builds_of_a_rim_that_is_the_bore_leave_the_tube_as_wide_as_it_is(speculum):
    """By hand: a rim of its own, 0.05 mm wider and 0.1 mm aside, takes 4.05 + 0.2 mm and two walls."""
    missed = {"stops.0.diameter": [4.0, 4.05, 3.9], "stops.0.decentre.0": [0.0, 0.1, 0.0]}
    width = roslf.quantity("insertion_diameter_mm")
    assert width(Camera.of(speculum, missed)) == pytest.approx([5.0, 5.0, 5.0], rel=1e-12)
    alone = speculum.replace({"stops.0.bore": False})
    assert width(Camera.of(alone, missed)) == pytest.approx([5.0, 5.25, 5.0], rel=1e-12)
    wider = {**missed, "tube.outer_diameter": [5.0, 5.02, 4.99]}
    assert width(Camera.of(speculum, wider)) == pytest.approx([5.0, 5.02, 4.99], rel=1e-12)


def test_a_rim_as_wide_as_the_bore_is_asked_whether_it_is_that(speculum):
    alone = speculum.replace({"stops.0.bore": False})
    assert unsaid_bore(Camera.of(alone)) == (
        "stop 1 as wide as the tube leaves: if that is its own bore, give it bore = true"
    )
    for said in (speculum, alone.replace({"stops.0.diameter": 3.9}), alone.replace({"tube": None})):
        assert not unsaid_bore(Camera.of(said))


def test_a_rim_that_is_the_bore_fits_and_is_written_and_read(speculum):
    assert "widest is stop 1, 4 mm" in fits(speculum).text
    assert loads(dumps(speculum)) == speculum
    assert "bore = true" in dumps(speculum)
    assert "bore" not in dumps(speculum.replace({"stops.0.bore": False}))
    camera = Camera.of(speculum)
    assert camera != Camera.of(speculum.replace({"stops.0.bore": False}))


def test_a_rim_wider_than_what_the_tube_leaves_is_no_bore_of_it(speculum):
    with pytest.raises(
        DesignError, match=r"stops\.0\.bore: the tube.s own bore is 4 mm wide .* and this rim 4\.1 mm; make"
    ):
        speculum.replace({"stops.0.diameter": 4.1})


def test_an_array_named_by_its_part_counts_as_it_is_cut_from_its_stock():
    """By the sensor over 1 + d_2/L, and .1 mm on each side; all of it where a size is stated, or it is cut smaller."""
    scope = roslf.load("rigid-scope").replace({"sensor.size": (6.0, 8.0), "main_lens.diameter": 1.0})
    text = dumps(scope)
    named = loads(re.sub(r"(?ms)^\[microlens_array\].*?(?=^\[)", '[microlens_array]\npart = "MLA150-5C"\n', text))
    assert named.microlens_array.size == (10.0, 10.0)
    camera = Camera.of(named)
    grown = 1 + float(camera.seen.d_2 * camera.seen.vergence)
    cut = [side / grown + 0.2 for side in (6.0, 8.0)]
    assert roslf.evaluate(named).answer.outer_diameter_mm == pytest.approx(max(math.hypot(*cut), 10.0), rel=1e-9)
    (array,) = (part for part in housed(camera) if part.name == "microlens array")
    assert array.width == pytest.approx(math.hypot(*cut), rel=1e-9)
    assert f"array cut to {cut[0]:.3g} x {cut[1]:.3g} mm" in roslf.evaluate(named).answer.rows[-1][2]
    for size in ((9.0, 9.0), (4.0, 4.0)):
        parts = housed(Camera.of(named.replace({"microlens_array.size": size})))
        (stated,) = (part for part in parts if part.name == "microlens array")
        assert stated.width == pytest.approx(math.hypot(*size))
