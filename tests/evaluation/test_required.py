"""What a design file asks for: verdicts against hand-set limits, in every page, and faults that are told."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design import DesignError, dumps, loads
from roslf_design.design.files import preset_path
from roslf_design.errors import InputError
from roslf_design.evaluation.evaluate import held_as_planned
from roslf_design.evaluation.field_images import FieldImages
from roslf_design.evaluation.required import limits_for_study, required_of
from roslf_design.evaluation.reservations import AS_BUILT
from roslf_design.evaluation.result import answer_tables, depth_budget_tables
from roslf_design.reporting.sheet.lines import basis, datasheet_json
from roslf_design.theory.length_covariance import CalibratedLengths, LengthCovariance
from roslf_design.traced.camera import camera_of
from roslf_design.traced.fields import images_of
from roslf_design.traced.images import forward_rays
from roslf_design.units import parse_quantity
from roslf_design.words import number, uncertainty

PLAIN = preset_path("rigid-scope").read_text()


def asked(text):
    return loads(f"{PLAIN}\n[required]\n{text}\n")


def test_limits_are_held_against_what_the_tables_say():
    result = roslf.evaluate(
        asked(
            'field_of_view_deg = {min = "70 deg"}\n'
            'u_z_mm = [{at = "20 mm", max = "0.5 mm"}, {at = "20 mm", max = "1 um"}]\n'
            "view_depth_of_field_far_mm = {min = 50}\n"
            "outer_diameter_mm = {min = 2, max = 4}"
        ),
        at=[20.0],
    )
    view, near, fine, far, width = result.required
    assert view.value == result.answer.field_of_view_deg.diagonal
    assert near.value == fine.value == result.answer.at[1].u_z_mm
    assert width.value == result.answer.outer_diameter_mm
    assert far.value == math.inf
    assert [one.met for one in result.required] == [False, True, False, True, True]
    levels = ["fault", "limit", "fault", "good", "good"]  # a depth without lengths as built is met as drawn, no more
    assert [verdict.level for verdict in result.verdicts[:5]] == levels
    assert f"missed by {70 - view.value:.4g} deg" in result.verdicts[0].text
    told = result.to_dict()["required"]
    assert told[1] == {
        "quantity": "u_z_mm", "label": near.label, "at_mm": 20.0, "min": None, "max": 0.5, "value": near.value,
        "unit": "mm", "met": True,
        "counts": "of shot and read noise and view mismatch, without lengths as built and temperature",
        "only": "as drawn", "remedy": AS_BUILT, "thin_twin": None, "field": None,
        "caution": "", "x_ml_mm": None, "untold": False,
    }  # fmt: skip
    assert told[3]["value"] is None  # infinite
    assert told[3]["met"]


WARM = {"environment": {"range": ["15 degC", "120 degC"], "housing": "aluminium"}}


def test_a_depth_over_a_range_of_temperatures_tells_its_worse_end_in_brief_too(tmp_path, capsys):
    """U there is that of the term of temperature at one end; met by the mean alone, it is met with that reservation."""
    design = asked('u_z_mm = {max = "0.35 mm"}\nfield_of_view_deg = {max = "90 deg"}\nfill_factor = {max = 2}').replace(
        WARM
    )
    result = roslf.evaluate(design)
    degrees, worst = result.depth_budget.worst
    told = f"at {degrees:g} °C, the worse end of environment.range, U = {worst:.3g} mm"
    depth, view, fill = result.required
    assert depth.caution == result.depth_budget.to_dict()["caution"] == told
    assert depth.value < 0.35 < worst / 2
    assert depth.only == "as drawn, over environment.range, not at its worse end"
    roslf.save(design, tmp_path / "warm.toml")
    assert main(["evaluate", str(tmp_path / "warm.toml")]) == 0
    lines = " ".join(capsys.readouterr().out.split())
    assert f"24.5 mm: {told} " in lines  # below the distances
    assert f"✓ as required: {view.label}; {fill.label} ✓ f-number matched; " in lines
    assert f"~ met {depth.only}: {depth.label} is {depth.value_words}, {told}, required at most 0.35 mm" in lines


def test_sizes_are_judged_and_told_as_at_20_degrees_whatever_the_camera_is_used_at():
    """ISO 1: what was drawn as large as is allowed is so when warm, and what was drawn larger is not when cold."""
    limits = "outer_diameter_mm = {max = 6}\ntotal_length_mm = {max = 100}\nlargest_diameter_mm = {max = 100}"
    design = asked(limits).replace(
        {"tube": {"outer_diameter": 6.0, "wall": 0.2}, "environment": {"housing": "stainless steel"}}
    )
    room = [one.value for one in roslf.evaluate(design).required]
    for degrees in (-10, 20, 60):
        result = roslf.evaluate(design.at_temperature(degrees))
        assert [one.value for one in result.required] == pytest.approx(room, rel=1e-12)
        assert result.required[0].met
        assert "a wall of 0.2 mm leave 5.6 mm" in str(result.verdicts)
        assert ("at 20 °C" in result.required[0].verdict.text) == (degrees != 20)
    wide = design.replace({"tube.outer_diameter": 6.001}).at_temperature(-40)
    assert not roslf.evaluate(wide).required[0].met


def test_an_outer_diameter_is_one_number_that_the_tube_may_have():
    design = asked("outer_diameter_mm = {max = 3}").replace({"tube": {"outer_diameter": 4.0, "wall": 0.21364}})
    result = roslf.evaluate(design.replace({"sensor.size": [3.2, 2.4]}))
    assert result.answer.outer_diameter_mm == pytest.approx(4.42728)  # 4 mm across the sensor
    (told,) = [value for name, value, _ in result.answer.rows if name == "outer diameter"]
    (way,) = [verdict.remedy for verdict in result.verdicts if verdict.name == "fits_tube"]
    assert told == result.required[0].value_words == "4.428 mm"
    assert way.endswith("a tube of 4.428 mm outside")


def test_sizes_of_many_builds_are_those_at_20_degrees():
    """A build's own temperature changes none of its sizes, its own tube does."""
    design = asked("").replace({"tube": {"outer_diameter": 6.0, "wall": 0.2}, "environment": {"housing": "aluminium"}})
    drawn, degrees = np.array([5.9, 6.0, 6.1]), np.array([[20.0], [60.0]])
    outer = roslf.quantity("outer_diameter_mm")
    camera = roslf.Camera.of(design, {"tube.outer_diameter": drawn}).replace({"environment.temperature": degrees})
    np.testing.assert_allclose(outer(camera), np.broadcast_to(drawn, (2, 3)), rtol=1e-12)
    np.testing.assert_allclose(outer(camera.in_row((2, 3), slice(3, 6))), drawn, rtol=1e-12)


def test_contrast_of_detail_that_aliases_is_no_detail_and_gets_no_tick():
    """Sampling by definition: half a period a footprint of a microlens."""
    design = asked('mtf50_lp_per_mm = {at = "20 mm", min = 0.1}')
    fold = 0.5 / roslf.specification(design, 20.0).object_field[-1].object_sample_mm
    sharp = roslf.evaluate(design).required[0].value
    assert sharp > fold  # else this tests nothing
    limits = (0.99 * fold, 1.01 * fold, 1.01 * sharp)
    text = ", ".join(f'{{at = "20 mm", min = {least}}}' for least in limits)
    result = roslf.evaluate(asked(f"mtf50_lp_per_mm = [{text}]"))
    assert [verdict.level for verdict in result.verdicts[:3]] == ["good", "limit", "fault"]
    assert all(f"detail above {number(fold, 4)} lp/mm aliases" in verdict.text for verdict in result.verdicts[:3])
    assert f"believe the sampling: a sample a microlens carries {number(fold, 4)} lp/mm" in result.verdicts[1].remedy
    assert not roslf.evaluate(asked(f'fold_lp_per_mm = {{at = "20 mm", min = {limits[1]}}}')).required[0].met


@pytest.mark.parametrize("colours", ["mono", "RGGB"])
def test_detail_behind_colour_filters_says_where_views_of_a_colour_alias(colours):
    """Of a Bayer pattern half of the pixels are green, a quarter red: a view's samples are that many fewer."""
    fold = 0.5 / roslf.specification(asked(""), 20.0).object_field[-1].object_sample_mm
    text = f'{{at = "20 mm", min = {0.2 * fold:g}}}, {{at = "20 mm", min = {0.6 * fold:g}}}'
    design = asked(f"detail_lp_per_mm = [{text}]").replace({"sensor.colours": colours})
    within, beyond = roslf.evaluate(design).required
    assert within.met
    assert beyond.met
    folds = f"red above {number(fold / 2, 4)}, green above {number(fold * 0.5**0.5, 4)}"
    assert (folds in within.counts, folds in beyond.counts) == (colours != "mono",) * 2
    assert "refocused" not in within.only
    assert ("for refocused images alone" in beyond.only) == (colours != "mono")


def test_what_an_optimiser_held_to_its_tolerance_is_met():
    has = roslf.evaluate(asked("field_of_view_deg = {min = 1}")).required[0].value
    room = roslf.evaluate(asked("non_distortion_room_mm = {min = -99}")).required[0].value
    for name, limit, met in (
        ("field_of_view_deg", has * (1 + 1e-12), True),
        ("field_of_view_deg", has * (1 + 1e-7), False),
        ("non_distortion_room_mm", room + 1e-10, True),
        ("non_distortion_room_mm", room + 1e-6, False),
    ):
        (verdict, *_) = roslf.evaluate(asked(f"{name} = {{min = {limit!r}}}")).verdicts
        assert verdict.ok is met, (name, limit)


def test_a_limit_is_a_number_and_no_flag():
    with pytest.raises(InputError) as caught:
        asked("fill_factor = {max = true}\nu_z_mm = {min = false, max = 1}\naperture_constant = {max = 2}")
    assert [problem.key for problem in caught.value.problems] == ["required.fill_factor.max", "required.u_z_mm.min"]
    assert all("must be a number, or text with a unit" in problem.message for problem in caught.value.problems)


def test_limits_of_a_list_that_contradict_each_other_at_one_place_are_refused():
    for places, refused in ((("15 mm", "15 mm"), True), (("15 mm", "20 mm"), False)):
        least, most = (f'at = "{place}", {end}' for place, end in zip(places, ("min = 6", "max = 5"), strict=True))
        design = asked(f"field_half_width_mm = [{{{least}}}, {{{most}}}]")
        if not refused:
            assert len(roslf.evaluate(design).required) == 2
            continue
        with pytest.raises(InputError, match=r"min 6 mm is above max 5 mm.*both at 15 mm"):
            roslf.evaluate(design)


def test_a_required_expanded_uncertainty_is_told_that_it_is_half_of_it_that_is_named():
    with pytest.raises(InputError, match=r"did you mean 'u_z_mm'\? u_z_mm is the standard uncertainty, half of U"):
        roslf.evaluate(asked('U_z_mm = {at = "15 mm", max = "0.1 mm"}'))


def test_a_required_expanded_uncertainty_is_that_of_u_at_half_told_as_asked():
    """Off the axis and with its reservations, too: one number is judged, and told as the file asks for it."""
    for where in ('at = "20 mm"', 'at = "20 mm", field = "corner"', ""):
        comma = ", " * bool(where)
        once, twice = (
            roslf.evaluate(asked(f'{name} = {{{where}{comma}max = "{most} mm"}}')).required
            for name, most in (("u_z_mm", 0.1), ("expanded_u_z_mm", 0.2))
        )
        for u, expanded in zip(once, twice, strict=True):
            assert replace(expanded, label=u.label, coverage=1.0) == u
            assert expanded.told == 2 * u.value
            assert expanded.label.startswith("depth, expected, U")
            assert expanded.verdict.text.endswith(", required at most 0.2 mm") or ", missed by" in expanded.verdict.text
            assert f" is {uncertainty(2 * u.value, 4)}" in expanded.verdict.text
            assert "u_Z" not in expanded.verdict.text
    told = roslf.evaluate(asked('expanded_u_z_mm = {at = "20 mm", max = "0.2 mm"}')).to_dict()["required"][0]
    assert [told[key] for key in ("quantity", "min", "max")] == ["expanded_u_z_mm", None, 0.2]


def test_what_is_met_with_a_reservation_is_no_failure_to_a_script():
    """As drawn, which no data sheet of builds says: met; over the limit it is not, whatever is reserved."""
    for most, met in ((9.0, True), (1e-3, False)):
        result = roslf.evaluate(asked(f"expanded_u_z_mm = {{max = {most}}}"))
        (required,), (verdict, *_) = result.required, result.verdicts
        assert (required.asked, required.quantity) == ("expanded_u_z_mm", "u_z_mm")
        assert required.told == 2 * required.value
        assert (required.met, verdict.ok) == (met, met)
        assert verdict.level == ("limit" if met else "fault")


def test_expanded_uncertainty_is_what_the_budget_prints():
    design = roslf.load("rigid-scope")
    result = roslf.evaluate(design, at=20.0)
    quantity, camera = roslf.quantity("expanded_u_z_mm"), roslf.Camera.of(design)
    assert float(quantity(camera)) == pytest.approx(float(result.depth_budget.expanded_mm), rel=1e-12)
    assert float(quantity(camera, 20.0)) == pytest.approx(result.answer.at[1].expanded_mm, rel=1e-12)
    assert result.value("expanded_u_z_mm") == 2 * result.value("u_z_mm")
    assert result.value("expanded_u_z_mm", at=20.0) == result.answer.at[1].expanded_mm


def test_a_depth_that_full_pixels_exclude_beside_electrons_elsewhere_says_so():
    """By hand: a source in the tip lights 10 mm (20/10)^2 times as much as 20 mm, at the same image fill."""
    lit = {"light.illuminance": 1e5, "light.measured_at": 20.0, "light.exposure": "10 ms"}
    design = asked("")
    for well in (9000.0, 1e5):
        wanted = design.replace({**lit, "sensor.full_well": well})
        here = [float(roslf.quantity("pixel_electrons")(Camera.of(wanted), at)) for at in (10.0, 20.0)]
        bright = wanted.replace({"light.exposure": 10.0 * well / here[1] * 0.6e-3})
        required = {"u_z_mm": {"at": 10.0, "max": 0.5}, "pixel_electrons": {"at": 20.0, "min": 0.5 * well}}
        depth, charge = roslf.evaluate(bright.replace({"required": required})).required
        assert charge.met
        assert not depth.met
        least = well * here[1] / here[0]
        assert f"with over {number(least, 4)} e- there pixels here are full" in depth.remedy
        loose = {**required, "pixel_electrons": {"at": 20.0, "min": 0.9 * least}}
        assert "expose less" in roslf.evaluate(bright.replace({"required": loose})).required[0].remedy


def test_depth_that_is_required_says_what_it_counts_as_the_budget_has_it():
    text = 'u_z_mm = {at = "20 mm", max = "1 mm"}'
    bare = roslf.evaluate(asked(text))
    built = roslf.evaluate(asked(text), build=LengthCovariance(("sensor.distance",), np.array([[1e-4]])))
    assert built.required[0].value > bare.required[0].value
    assert "without lengths as built and temperature" in bare.verdicts[0].text
    assert "and lengths as built, without temperature" in built.verdicts[0].text
    assert bare.verdicts[0].text.startswith("met as drawn: ")
    assert [(one.verdicts[0].level, one.required[0].met) for one in (bare, built)] == [("limit", True), ("good", True)]
    loose = LengthCovariance(("sensor.distance",), np.array([[1.0]]))
    short = roslf.evaluate(asked(text), build=loose)
    assert [verdict.level for verdict in short.verdicts] == ["fault", *(one.level for one in bare.verdicts[1:])]
    plan = CalibratedLengths(LengthCovariance(("sensor.distance",), np.array([[1e-6]])), planned=True)
    shown, uncalibrated = FieldImages.of(asked(text)), "U = no depth there"
    assert 2 * short.required[0].value > short.required[0].at_mm
    for planned, words in ((None, "met as drawn"), (plan, "met once calibrated as planned")):
        held = held_as_planned(bare, shown, loose, planned)
        assert held.verdicts[0].text.startswith(f"{words}: depth, expected")
        assert f"uncalibrated, by default tolerances, {uncalibrated}" in held.verdicts[0].text
        assert held.verdicts[1:] == bare.verdicts[1:]
    remedy = short.verdicts[0].remedy  # noise alone holds it: what spoils it is no work for an optimiser
    assert "`roslf calibrate --plan`" in remedy
    assert "tighter tolerances" in remedy
    assert "misses still" not in remedy
    fine = asked('u_z_mm = {at = "20 mm", max = "1 um"}')
    assert "`roslf optimize` holds it" in roslf.evaluate(fine).verdicts[0].remedy  # of noise
    both = roslf.evaluate(fine, build=LengthCovariance(("sensor.distance",), np.array([[1.0]]))).verdicts[0].remedy
    assert f"without them u is {number(bare.required[0].value, 4)} mm, and misses still" in both
    given = roslf.evaluate(asked(text).replace({"depth": {"disparity_error": 0.01}})).required[0]
    assert given.counts == "of disparity error, without lengths as built and temperature"  # it has the others in it


def test_an_outer_diameter_that_is_required_is_that_of_the_tube_stated():
    tube = asked('outer_diameter_mm = {max = "4 mm"}').replace({"tube": {"outer_diameter": 4.0, "wall": 0.1}})
    result = roslf.evaluate(tube)
    assert (result.required[0].value, result.answer.outer_diameter_mm) == (4.0, 4.0)
    says = "as stated: parts of 3 mm and walls of 0.1 mm, clearance 0.8 mm; without sensor package or light guide"
    assert says in result.verdicts[0].text
    assert result.required[0].counts == result.answer.outer_diameter_counts == says
    assert ("outer diameter", "4 mm", f"of all of the camera; tube {says}") in result.answer.rows
    assert roslf.evaluate(tube.replace({"tube.outer_diameter": 4.2})).verdicts[0].level == "fault"
    narrow = roslf.evaluate(tube.replace({"tube.outer_diameter": 3.1}))  # than the parts: it cannot be had
    assert narrow.required[0].value == pytest.approx(3.0 + 2 * 0.1)
    assert "3.1 mm as stated is too narrow" in narrow.required[0].counts


def test_a_range_of_working_distances_is_held_to_where_views_are_sharp():
    plain = roslf.evaluate("rigid-scope")
    at, (near, far) = plain.answer.working_distance_mm, plain.answer.working_range_mm

    def light(low, high):
        return roslf.evaluate(asked(f"working_distance_mm = {{min = {low!r}, max = {high!r}}}")).verdicts[0]

    within, beyond = light(1.001 * near, at + 1), light(0.999 * near, at + 1)
    assert (near < at < far, within.level, beyond.level) == (True, "good", "limit")
    assert "view_depth_of_field_near_mm = {max = " in beyond.remedy
    assert light(at + 1, at + 2).level == "fault"
    (one, *_) = roslf.evaluate(asked("working_distance_mm = {min = 1}")).verdicts
    assert one.level == "good"


def test_nothing_asked_for_is_no_verdict():
    result = roslf.evaluate("rigid-scope")
    assert result.to_dict()["required"] == []
    assert not [verdict for verdict in result.verdicts if verdict.name.startswith("required")]


def test_a_real_lens_is_held_to_its_traced_field():
    design = loads(preset_path("paper-singlet").read_text() + "\n[required]\nfield_of_view_width_deg = {min = 1}\n")
    result = roslf.evaluate(design)
    assert result.required[0].value == result.answer.field_of_view_deg.width
    assert result.required[0].thin_twin == float(roslf.QUANTITIES["field_of_view_width_deg"](roslf.Camera.of(design)))


def test_a_real_lens_gets_no_tick_by_a_number_of_its_thin_twin():
    """Rays and thin-lens model apart: a limit between them is missed, what no ray tells is met with a reservation."""
    preset = preset_path("paper-singlet").read_text()
    fast = preset.replace('"2.9 mm"', '"12 mm"')  # spherical aberration counts
    place, thin = 200.0, roslf.Camera.of(loads(fast))
    twin = float(roslf.QUANTITIES["mtf50_lp_per_mm"](thin, at=place))
    traced = roslf.evaluate(loads(fast), at=[place]).answer.at[1]
    assert traced.limited_by == "contrast"
    assert traced.usable_lp_per_mm < twin  # else this tests nothing

    def judged(text, of=preset, **options):
        return roslf.evaluate(loads(f"{of}\n[required]\n{text}\n"), **options)

    between = judged(f'mtf50_lp_per_mm = {{at = "200 mm", min = {(traced.usable_lp_per_mm + twin) / 2!r}}}', fast)
    (one,), verdict = between.required, between.verdicts[0]
    assert (one.value, one.thin_twin, one.met) == (traced.usable_lp_per_mm, twin, False)
    assert verdict.level == "fault"
    assert f"of rays; of the thin-lens model {number(twin, 4)} lp/mm" in verdict.text
    build = LengthCovariance(("sensor.distance",), np.array([[1e-8]]))
    held = judged(
        'mtf50_lp_per_mm = {at = "200 mm", min = 1}\nu_z_mm = {max = "1 m"}\nfill_factor = {min = 0.1}\n'
        'outer_diameter_mm = {max = "1 m"}\nfield_half_width_mm = {min = 1}',
        build=build,
    )
    alone = "by the thin-lens model alone"
    assert [one.only for one in held.required] == ["", alone, alone, "", ""]
    assert [verdict.level for verdict in held.verdicts[:5]] == ["good", "limit", "limit", "good", "good"]
    assert held.required[4].value == held.answer.at[0].width_mm / 2


SCANNER = """
name = "scanner"
main_lens = {part = "AC254-045-A", focal_plane = "90 mm"}
aperture = {diameter = "8 mm", distance = "5 mm"}
microlens_array = {pitch = "25 um", focal_length = "265 um", size = ["12 mm", "9 mm"]}
sensor = {part = "IMX535", distance = "265 um"}
light = {wavelength = "550 nm", illuminance = "10000 lx", reflectance = 0.4, exposure = "5 ms"}
required = {expanded_u_z_mm = [{max = "0.5 mm"}, {max = "1 um"}]}
"""


def test_a_depth_whose_views_aberrations_set_astray_is_not_known():
    """Of spherical aberration a r^3 its best slope leaves a/(6 sqrt 2) of standard deviation along an axis."""
    design = loads(SCANNER)
    result = roslf.evaluate(design)
    loose, tight = result.required
    verdict = next(one for one in result.verdicts if one.name == "required_u_z_mm")
    assert (loose.met, loose.untold, loose.level, verdict.ok) == (False, True, "limit", False)
    assert loose.outcome.startswith("not known")
    assert "roslf depth" in verdict.remedy
    assert not loose.holds(0.0)
    assert (tight.met, tight.untold, tight.outcome) == (False, False, "missed")  # by formulas already
    assert "U is without aberrations" in result.answer.at[0].caution  # beside the number of the first table
    small = roslf.evaluate(design.replace(D_F=4.0))
    assert (small.required[0].met, small.required[0].untold) == (True, False)
    assert "aberrations" not in small.answer.at[0].caution
    lens = camera_of(design)
    away, half = lens.first_order.front_principal - 90.0, lens.fap.diameter / 2
    moved = forward_rays(
        lens, np.zeros(2), half * np.array([[0.0, 0.0], [1e-3, 0.0], [1.0, 0.0]]), lens.wavelength, z=away
    )
    ways = moved[0].T[:, 0] - moved[0].T[0, 0]
    rim = ways[2] - 1e3 * ways[1]
    assert images_of(design, [(0.0, 0.0)]).astray(0, None) == pytest.approx(
        abs(rim) / math.sqrt(72) / design.d, rel=0.1
    )


def test_where_a_real_lens_is_sharpest_is_told_with_the_focal_plane_that_brings_it_there():
    """By a scan of the plane at which the array needs no slope: what it is told to be, and finer detail once moved."""
    design = loads(SCANNER.replace("required", "# required"))
    one = next(one for one in roslf.evaluate(design).verdicts if one.name == "best_focus")
    told = float(one.text.rpartition("sharpest at ")[2].removesuffix(" mm"))
    planes = np.linspace(told - 2, told + 2, 9)
    rates = [images_of(design, [(0.0, 0.0)]).transfer(0, plane).rate for plane in planes]
    assert np.interp(0.0, rates, planes) == pytest.approx(told, abs=0.05)
    plane = float(one.remedy.split('"')[1].removesuffix(" mm"))
    assert plane == pytest.approx(90 + 85 - told, abs=0.01)  # the tip is the FAP
    assert "best_focus" not in [one.name for one in roslf.evaluate("paper-singlet").verdicts]


def test_pixels_that_are_no_views_hold_no_limit_on_views():
    focused = roslf.Design.make(
        {
            "name": "microlenses focused on the scene",
            "main_lens": {"diameter": 1.032, "focal_length": 3.04},
            "aperture": {"diameter": 1.032, "distance": 0.0},
            "microlens_array": {"pitch": 0.03, "focal_length": 0.075, "distance": 3.439, "size": (3.7, 2.8)},
            "sensor": {"distance": 0.1, "pixel": 1.12e-3, "size": (3.6736, 2.75968)},
            "required": {"u_z_mm": {"max": 1e6}, "mtf50_lp_per_mm": {"min": 1.0}},
        }
    )
    result = roslf.evaluate(focused)
    assert result.focused is not None
    for one in result.required:
        assert (one.value, one.met, one.counts) == (None, False, "")
        assert "would image the pupil" in one.verdict.remedy
    corner = focused.replace({"required": {"detail_lp_per_mm": {"min": 1.0, "field": "corner"}}})
    assert required_of(corner)[0].remedy == result.required[0].remedy


def test_a_design_keeps_what_it_is_asked_for():
    design = asked('u_z_mm = [{at = "20 mm", max = "0.5 mm"}, {at = "40 mm", max = 4}]\nouter_diameter_mm = {max = 4}')
    assert loads(dumps(design)) == design
    assert design.replace(d_3=2.0).required == design.required
    assert hash(design) == hash(loads(dumps(design)))


def test_limits_are_written_for_studies_as_files_have_them():
    depth, diameter = asked('u_z_mm = {at = "0.02 m", max = "0.5 mm"}\nouter_diameter_mm = {min = 1, max = 4}').required
    assert depth.limits() == {"at": "0.02 m", "max": "0.5 mm"}
    assert diameter.limits() == {"min": 1, "max": 4}
    for distance in (0.1 + 0.2, 1e-3 / 3, 2e7 / 3):
        text = depth.model_copy(update={"at": distance}).limits()["at"]
        assert parse_quantity(text, "length") == distance


def test_the_data_sheet_says_whether_it_is_met():
    rows = [row for row in basis(asked('outer_diameter_mm = {max = "2 mm"}')).rows if row.subject == "Required"]
    assert [(row.value, row.unit, row.remark) for row in rows] == [
        (3.0, "mm", "✗ missed: at most 2 mm; without wall, sensor package or light guide")
    ]


@pytest.mark.parametrize(
    ("text", "key", "message"),
    [
        ('u_zz_mm = {max = "1 mm"}', "required.u_zz_mm", "did you mean 'u_z_mm'?"),
        ("sensor_width_mm = {max = 3}", "required.sensor_width_mm", "keys of the design state: `roslf keys sensor`"),
        ("sensor_angel_deg = {max = 3}", "required.sensor_angel_deg", "did you mean 'sensor_angle_deg'?"),
        ("depth_mm = {max = 3}", "required.depth_mm", "did you mean 'u_z_mm' or 'sigma_z_mm'"),
        ('field_of_view_deg = {min = "7 mm"}', "required.field_of_view_deg.min", "unit of length"),
        ('u_z_mm = {max = "7 mm", fr = 2}', "required.u_z_mm.fr", "not a known key"),
        ("u_z_mm = {}", "required.u_z_mm", "no limit; give min, max or both"),
        ("u_z_mm = 3", "required.u_z_mm", "must be a table of limits"),
        ('u_z_mm = {max = "1 mm", at = 20}', "required.u_z_mm.at", "unit"),
        ("blur_pitches = {max = 3}", "required.blur_pitches", "needs a distance"),
        ('outer_diameter_mm = {max = 3, at = "2 mm"}', "required.outer_diameter_mm", "drop at"),
        ("kept_fraction = {min = 1}", "required.kept_fraction", "from field to field"),
        ("u_z_mm = {min = 2, max = 1}", "required.u_z_mm", "nothing lies between; did you swap them?"),
        ('u_z_mm = {max = "-1 mm"}', "required.u_z_mm", "is above 0; raise it"),
        ('outer_diameter_mm = {max = "0 mm"}', "required.outer_diameter_mm", "is above 0; raise it"),
    ],
)
def test_faults_are_told_in_a_line(text, key, message, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(f"{PLAIN}\n[required]\n{text}\n")
    with pytest.raises(DesignError) as error:
        roslf.evaluate(path)
    assert str(error.value).startswith(f"{path}: {key}: ")
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_limits_are_judged_in_the_same_run_as_the_design_s_own_faults(tmp_path):
    """Values that cannot be read hide nothing that can: parts in each other, pitches, limits."""
    text = preset_path("cystoscope").read_text()
    for right, wrong in (
        ("[microlens_array]", '[microlens_array]\nlayout = "hex"'),
        ('pitch = "', 'pitch = "1000'),
        ("[main_lens]", "[main_lens]\ncolour = 3"),
    ):
        assert right in text
        text = text.replace(right, wrong, 1)
    text = text.split("[required]")[0]
    limits = 'field_of_view = {min = "80 deg"}\nu_z_mm = {at = "10 mm", max = "0.25"}\nfill_factor = {}'
    (tmp_path / "bad.toml").write_text(f"{text}\n[required]\n{limits}\n")
    with pytest.raises(DesignError) as caught:
        roslf.evaluate(tmp_path / "bad.toml")
    assert {problem.key for problem in caught.value.problems} == {
        "microlens_array.layout", "microlens_array.pitch", "main_lens.colour",
        "required.field_of_view", "required.u_z_mm.max", "required.fill_factor",
    }  # fmt: skip
    assert str(tmp_path / "bad.toml") in str(caught.value)


@pytest.mark.parametrize(
    ("name", "limits", "said"),
    [
        ("working_distance_mm", {"min": "200 m"}, "200 m: did you mean mm? the design has 230 mm"),
        ("u_z_mm", {"max": "0.1 um"}, "0.1 um: did you mean mm? the design has 0.126 mm"),
        ("u_z_mm", {"max": "0.01 mm"}, ""),
        ("working_distance_mm", {"min": "1 m"}, ""),
        ("d_3", {"max": "-1 mm"}, ""),
        ("fill_factor", {"min": 1000}, ""),
    ],
)
def test_a_slip_of_units_is_asked_about(name, limits, said):
    (one,) = required_of(roslf.load("paper").replace({"required": {name: limits}}))
    assert not one.met
    assert one.remedy.startswith(said)
    assert bool(said) == ("did you mean" in one.remedy)


def test_no_depth_is_one_word_in_evaluation_and_sheet():
    design = roslf.load("mismatched-borescope").replace({"required": {"u_z_mm": {"max": "1 mm"}}})
    (one,) = required_of(design)
    assert one.verdict.text.startswith("not as required: depth, expected, u_Z is none (of ")
    result = roslf.evaluate(design)
    tables = [*answer_tables(result), *depth_budget_tables(result)]
    assert "∞ mm" not in " ".join(cell for table in tables for row in table.rows for cell in row[:2])
    data = datasheet_json(basis(design))
    depths = {
        line["name"]: line["text"] for line in data["lines"] if line["subject"] in ("Depth, expected", "Required")
    }
    assert depths[one.label] == "none"
    assert "∞" not in " ".join(depths.values())
    drawn, *others = data["depth_by_lengths"]
    assert (drawn["lengths"], drawn["u_z_mm"], drawn["expanded_mm"]) == ("as drawn", None, None)
    assert [row["lengths"] for row in others] == ["as built", "as calibrated"]


def test_the_sheet_s_answers_by_lengths_are_in_its_json():
    paper = roslf.load("paper")
    drawn, built, calibrated = datasheet_json(basis(paper))["depth_by_lengths"]
    expected = roslf.evaluate(paper).depth.expected
    assert expected["lengths"] == "as drawn"
    assert [drawn["u_z_mm"], drawn["expanded_mm"]] == [expected["u_z_mm"], expected["expanded_mm"]]
    assert built["u_z_mm"] is calibrated["u_z_mm"] is None
    assert "tolerance study" in built["remark"]


@pytest.mark.parametrize(("name", "at"), [("rigid-scope", 40.0), ("paper-singlet", 300.0), ("cystoscope", 15.0)])
def test_the_detail_of_the_table_can_be_required(name, at):
    """As the table has it: of contrast where that ends first, of sampling elsewhere; of rays behind a real lens."""
    limits = [{"at": at, "min": 1e-3}, {"min": 1e-3}]
    design = roslf.load(name).replace({"required": {"detail_lp_per_mm": limits}})
    evaluation = roslf.evaluate(design, at=at)
    table = {row.plane: row.usable_lp_per_mm for row in evaluation.answer.at}
    far, focus = evaluation.required
    assert far.value == pytest.approx(table["asked for"], rel=1e-4)
    assert focus.value == pytest.approx(table["focal plane"], rel=1e-4)


def _remedied(design, **required):
    changed = roslf.loads(roslf.dumps(design) + "\n[required]\n" + "\n".join(f"{k} = {v}" for k, v in required.items()))
    return changed, [one.remedy for one in required_of(changed)]


def test_a_missed_limit_names_its_culprit_and_what_it_says_does():
    design = roslf.load("rigid-scope")
    fold, view = (float(roslf.quantity(name)(Camera.of(design))) for name in ("fold_lp_per_mm", "field_of_view_deg"))
    limit = f"{{min = {1.5 * fold:.4g}}}"
    details = dict.fromkeys(("fold_lp_per_mm", "detail_lp_per_mm", "mtf50_lp_per_mm"), limit)
    _, (finer, *others, wider) = _remedied(design, **details, field_of_view_deg=f'{{min = "{1.2 * view:.4g} deg"}}')
    assert others == [finer, finer]
    pitch = float(re.search(r"microlenses of ([\d.]+) um", finer)[1])
    assert float(roslf.quantity("fold_lp_per_mm")(Camera.of(design.replace(d=pitch / 1e3)))) >= 1.5 * fold * 0.999
    times = float(re.search(r"a sensor ([\d.]+) times as wide", wider)[1])
    sizes = {
        f"{part}.size": [times * side for side in getattr(design, part).size] for part in ("sensor", "microlens_array")
    }
    assert float(roslf.quantity("field_of_view_deg")(Camera.of(design.replace(sizes)))) == pytest.approx(
        1.2 * view, rel=0.02
    )


def test_a_wider_sensor_that_does_not_fit_the_tube_is_said_not_to():
    """Of the round field the nearest side grows: the sensor's diagonal, by hand, against 6 mm less two walls."""
    design = roslf.load("rigid-scope").replace({"sensor.size": (1.6, 0.9), "microlens_array.size": (3.0, 3.0)})
    view = float(roslf.quantity("round_field_of_view_deg")(Camera.of(design)))
    for grown, outer in ((1.5, 6.0), (5.0, 6.0), (5.0, 60.0), (5.0, None)):
        wanted = 2 * np.degrees(np.arctan(grown * np.tan(np.radians(view / 2))))
        tube = "" if outer is None else f'[tube]\nouter_diameter = "{outer} mm"\nwall = "0.3 mm"\n'
        text = roslf.dumps(design.replace({"required": ()})) + f"\n{tube}"
        text += f'[required]\nround_field_of_view_deg = {{min = "{wanted:.9f} deg"}}\n'
        (one,) = required_of(roslf.loads(text))
        assert "times as wide on its nearest side sees that" in one.remedy
        across = np.hypot(max(1.6, 0.9 * grown), 0.9 * grown)
        told = "" if outer is None or across <= outer - 0.6 else f" (too wide for [tube]: {across:.3g} mm across"
        assert ("too wide for [tube]" in one.remedy) == bool(told)
        assert f"sees that{told}" in one.remedy


def test_only_what_is_too_wide_names_the_widest():
    for limit, named in (('{max = "2 mm"}', True), ('{min = "20 mm"}', False)):
        _, (remedy,) = _remedied(roslf.load("rigid-scope"), outer_diameter_mm=limit)
        assert ("the widest is the main lens" in remedy) == named


@pytest.mark.parametrize("full", [{"light.exposure": "1 s"}, {"light.veil": 0.99}])
def test_full_pixels_are_to_be_exposed_less(full):
    _, (remedy,) = _remedied(roslf.load("rigid-scope").replace(full), u_z_mm='{max = "0.1 mm"}')
    assert "pixels are full: expose less" in remedy
    assert "more light" not in remedy


def test_a_distance_where_single_views_blur_is_told():
    design = roslf.load("rigid-scope")
    near = float(roslf.quantity("view_depth_of_field_near_mm")(Camera.of(design)))
    for at, blurs in ((0.8 * near, True), (1.2 * near, False)):
        changed, (remedy,) = _remedied(design, u_z_mm=f'{{at = "{at:.6g} mm", max = "9 mm"}}')
        assert ("focus closer to it" in remedy) == blurs
        assert ("where single views blur" in required_of(changed)[0].only) == blurs


def test_detail_that_the_middle_alone_shows_says_so():
    """The corner's, from the same images as the first answer has it."""
    design = roslf.load("paper-singlet")
    evaluation = roslf.evaluate(design.replace({"required": {"detail_lp_per_mm": {"min": 1e-3}}}))
    middle, corner = evaluation.answer.at[0].usable_lp_per_mm, evaluation.answer.corner_lp_per_mm
    assert corner < middle
    (easy,) = evaluation.required
    assert f"in the field's corner {number(corner, 3)} lp/mm" in easy.verdict.text
    assert "in the middle alone" not in easy.only
    (hard,) = required_of(design.replace({"required": {"detail_lp_per_mm": {"min": (middle + corner) / 2}}}))
    assert hard.met
    assert "in the middle alone" in hard.only
    assert 'field = "corner" requires it there' in hard.remedy
    for share, told in ((0.9, False), (0.4, True)):  # of it in the corner: much less is said before all else
        limit = min(corner / share, middle)
        (one,) = required_of(design.replace({"required": {"detail_lp_per_mm": {"min": limit}}}))
        words = f"met in the middle alone, {number(corner, 3)} lp/mm in the corner: "
        assert one.verdict.text.startswith(words) == (told and limit > 2 * corner)


def test_detail_can_be_required_of_the_corner():
    """As the first answer has it; studies hold what is asked of the middle alone."""
    design = roslf.load("paper-singlet")
    corner = roslf.evaluate(design).answer.corner_lp_per_mm
    limits = [{"min": 0.9 * corner, "field": "corner"}, {"min": 1.1 * corner, "field": "corner"}, {"min": 1e-3}]
    asked_of = roslf.loads(roslf.dumps(design.replace({"required": {"detail_lp_per_mm": limits}})))
    held, missed, middle = required_of(asked_of)
    assert (held.value, missed.value) == (pytest.approx(corner), pytest.approx(corner))
    assert (held.met, missed.met, middle.field) == (True, False, None)
    assert held.verdict.text.startswith("as required: detail in the field's corner is ")
    assert "smaller sensor" in missed.verdict.remedy
    assert limits_for_study(asked_of) == ({"quantity": "detail_lp_per_mm", "min": 1e-3},)
    with pytest.raises(DesignError, match="is of the whole camera; drop field"):
        roslf.evaluate(design.replace({"required": {"outer_diameter_mm": {"max": 99.0, "field": "corner"}}}))


def _corner_of(design, **limits):
    (one,) = required_of(design.replace({"required": {"detail_lp_per_mm": {**limits, "field": "corner"}}}))
    return one


def test_detail_in_the_corner_ends_at_the_sampling_there():
    """Half a period a microlens: its step on the focal plane at the corner, from where the corners of sensors lie."""
    design = roslf.load("cystoscope")

    def corner(scale):
        sized = design.replace({"sensor.size": [scale * side for side in design.sensor.size]})
        rows = [row for row in roslf.specification(sized).resolution if row.plane == "focal plane"]
        row = max(rows, key=lambda row: row.x0_mm)
        return math.hypot(*row.x_ml_mm), row.x0_mm

    (near, inner), (x_ml, x0), (far, outer) = map(corner, (0.999, 1.0, 1.001))
    coarser = max((outer - inner) / (far - near), x0 / x_ml)
    middle = float(roslf.quantity("fold_lp_per_mm")(Camera.of(design)))
    one = _corner_of(design, min=1.03 * middle)
    assert one.value == pytest.approx(0.5 / design.d / coarser, rel=1e-4)
    assert one.value > 1.1 * middle  # else the middle's would do
    assert (one.verdict.level, one.counts, one.remedy) == ("good", "", "")


def test_a_remedy_of_the_corner_is_of_what_is_missed_there():
    ideal, traced = roslf.load("cystoscope"), roslf.load("paper-singlet")
    fine = _corner_of(ideal, min=1.45)
    assert not fine.met
    pitch = float(re.search(r"microlenses of ([\d.]+) um", fine.remedy)[1])
    assert _corner_of(ideal.replace({"microlens_array.pitch": pitch / 1e3}), min=1.0).value >= 1.45
    assert "corrected" not in fine.remedy
    assert "corrected" not in _corner_of(ideal, max=1.0).verdict.remedy
    middle = roslf.evaluate(traced).answer.at[0].usable_lp_per_mm
    for least, held in ((0.99 * middle, True), (1.01 * middle, False)):
        assert ("better corrected" in _corner_of(traced, min=least).verdict.remedy) == held


def test_the_middle_named_is_the_middle_left_out():
    design = asked('detail_lp_per_mm = {min = 0.5, field = "middle"}\nfill_factor = {min = 0.1, field = "middle"}')
    assert [one.verdict.name for one in roslf.evaluate(design).required] == [
        "required_detail_lp_per_mm", "required_fill_factor",
    ]  # fmt: skip
    with pytest.raises(InputError, match=r"min 0.5 lp/mm is above max 0.1 lp/mm"):
        roslf.evaluate(asked('detail_lp_per_mm = [{min = 0.5}, {max = 0.1, field = "middle"}]'))
    with pytest.raises(InputError, match="middle"):
        asked('detail_lp_per_mm = {min = 0.5, field = "korner"}')


def test_a_remedy_of_a_warm_camera_cures_it_and_names_what_it_spoils():
    """Typed into the file, whose lengths are those at 20 degrees C."""
    warm = roslf.load("cystoscope").at_temperature(60)
    warm = warm.replace({"environment.housing": "aluminium"})
    across = float(roslf.quantity("views_geometric")(Camera.of(warm)))
    asked_for = warm.replace({"required": {"views_geometric": [{"min": 1.1 * across}]}})
    remedy = roslf.evaluate(asked_for).verdicts[0].remedy
    found = dict(re.findall(r"(d_2|D_F|d_3) = ([\d.]+) mm", remedy))
    assert {"d_2", "D_F"} <= found.keys()
    for symbol, text in found.items():
        cured = asked_for.at_room.replace({symbol: float(text)}).at_temperature(60)
        (first, second, *_), fill = roslf.evaluate(cured).verdicts, roslf.evaluate(cured).f_number.fill_factor
        assert (first.name, first.ok, second.name) == ("required_views_geometric", True, "f_number_matched"), text
        told = f"{symbol} = {text} mm [spoils the f-number match: image fill {fill:.3g}]"
        assert (told in remedy) != second.ok


def test_behind_a_real_lens_what_the_sensor_sees_is_told_by_rays_wherever_it_is_told():
    result = roslf.evaluate("paper-singlet", [])
    (field,) = [verdict.text for verdict in result.verdicts if verdict.name == "field_undistorted"]
    width, diagonal = result.answer.at[0].width_mm, result.answer.at[0].diagonal_mm
    assert f"the sensor sees {width / 2:.4g} mm (half width), {diagonal / 2:.4g} mm (corner)" in field
    assert diagonal != pytest.approx(math.hypot(width, result.answer.at[0].height_mm), rel=1e-3)
    farthest = max(point.x0_mm for point in FieldImages.of(roslf.load("paper-singlet")).points)
    assert diagonal / 2 == pytest.approx(farthest, rel=0.01)
    assert f"{width / 2:.4g}" != f"{result.non_distortion.field_half_width_mm:.4g}"  # else this tests nothing


OTOSCOPE = """name = "otoscope"
main_lens = {part = "achromat 25.4 mm f30", focal_plane = "60 mm"}
aperture = {diameter = "1.9 mm", distance = "39 mm"}
stops = [{diameter = "4 mm", distance = "45 mm"}]
microlens_array = {pitch = "58 um", focal_length = "0.607 mm", size = ["10 mm", "10 mm"]}
sensor = {part = "IMX304", size = ["SIDE", "SIDE"], distance = "0.607 mm"}
required.field_half_width_mm = {at = "15 mm", min = "LOW"}
required.detail_lp_per_mm = {at = "15 mm", min = 8}
"""


@pytest.mark.parametrize(
    ("side", "way", "low", "outcome"),
    [
        ("9.3 mm", "width", "4.5 mm", "as required"),
        ("5 mm", "width", "2.5 mm", "as required"),
        ("9.3 mm", "diagonal", "6.6 mm", "not as required"),
    ],
)
def test_a_field_that_is_required_is_one_that_gets_light(side, way, low, outcome):
    text = OTOSCOPE.replace("SIDE", side).replace("LOW", low).replace("half_width", f"half_{way}")
    (told, *_) = roslf.evaluate(loads(text)).verdicts
    assert told.text.startswith(outcome + ":"), told.text
    assert ("leave less than a third of the pencils" in told.remedy) == (outcome == "not as required")


def test_no_remedy_puts_the_pupil_ahead_of_the_tip_that_distances_count_from():
    narrow = loads(OTOSCOPE.replace("SIDE", "6.3 mm").replace("LOW", "4.5 mm"))
    told = next(one for one in roslf.evaluate(narrow).verdicts if one.name.startswith("required_field_half"))
    assert told.text.startswith("not as required: field half width")
    assert "d_3" not in told.remedy


def test_the_sheet_s_distortion_is_of_a_place_that_is_lit_and_says_where_it_is_no_finding():
    sheet = basis(loads(OTOSCOPE.replace("SIDE", "9.3 mm").replace("LOW", "4.5 mm")))
    bent, scale = (next(row for row in sheet.rows if row.name.startswith(one)) for one in ("distortion", "local magn"))
    for row in (bent, scale):
        assert "ideal lens: by definition" in row.remark
        assert "the corner is dark" in row.remark
        assert row.of is None  # no scatter of builds, of 0
    assert "12.52 deg" in bent.name
