"""Remedies with numbers: typed into the file as printed, each does what it says."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.evaluation.remedies import MATCH
from roslf_design.evaluation.required import required_of
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.units import parse_quantity
from roslf_design.words import on_side
from tests.pictures.designs import UNLIKE

SET = re.compile(r"\b(d_2|D_F|d_3) = ([\d.e-]+ mm)(?: with f_ml = ([\d.e-]+ mm))?")
LIMITED = (
    "fill_factor", "views_independent", "f_number_view", "telecentric_offset_mm", "non_distortion_room_mm",
    "total_length_mm", "image_diameter_px", "view_baseline_mm",
)  # fmt: skip


def typed(design, text):
    """Each change that a remedy prints, typed back."""
    for symbol, value, focal in SET.findall(text):
        changes = {symbol: value} | ({"f_ml": focal} if focal else {})
        yield changes, design.replace({name: parse_quantity(length, "length") for name, length in changes.items()})


@pytest.mark.parametrize(("number", "name"), [*enumerate(UNLIKE)])
def test_every_remedy_of_a_limit_holds_it_as_typed(number, name):
    """Each quantity with one kind of limit a preset: all three by turns."""
    design = roslf.load(name).thin_twin
    camera, told, random = Camera.of(design), 0, np.random.default_rng(len(name))
    for turn, quantity in enumerate((QUANTITIES[one] for one in LIMITED), number):
        value = float(quantity(camera))
        off = random.uniform(0.02, 0.3) * max(abs(value), 1e-3)
        kinds = ({"max": value - off}, {"min": value + off}, {"min": value + off, "max": value + off})
        limits = kinds[turn % 3]
        if quantity.fault_of_limits(limits.get("min"), limits.get("max")):
            continue
        asked = design.replace({"required": {quantity.name: limits}})
        (one,) = required_of(asked)
        for changes, changed in typed(asked, one.remedy):
            (after,) = required_of(changed)
            assert after.met, (quantity.name, limits, changes, after.value)
            told += 1
    assert told > 1


WAY = re.compile(
    r"\b(d_2|D_F|d_3) = ([\d.e-]+ mm)(?: with f_ml = [\d.e-]+ mm)?(?: \[spoils ([^\]:]+)(?:: image fill ([\d.]+))?\])?"
)


@pytest.mark.parametrize("name", ["paper", "rigid-scope"])
def test_what_a_remedy_spoils_is_what_the_changed_design_misses(name):
    """By the length changed in the design's file, alone, and all of it judged anew."""
    design, spoilt = roslf.load(name), set[str]()
    camera = Camera.of(design)
    keep = {one: float(QUANTITIES[one](camera)) for one in ("view_baseline_mm", "f_number_view", "f_number_pupil")}
    near = {one: {"min": 0.9 * value, "max": 1.1 * value} for one, value in keep.items()}
    wide = 1.25 * float(QUANTITIES["image_diameter_px"](camera))
    asked = design.replace({"required": {"image_diameter_px": {"min": wide}, **near}})
    assert [one.met for one in required_of(asked)] == [False, True, True, True]
    ways = WAY.findall(required_of(asked)[0].remedy)
    assert {symbol for symbol, *_ in ways} >= {"d_2", "D_F"}
    for symbol, value, told, fill in ways:
        after = roslf.evaluate(asked.replace({symbol: parse_quantity(value, "length")}), fields=[])
        verdicts = {one.name: one.ok for one in after.verdicts}
        missed = {f"{one.label} as required" for one in after.required[1:] if not one.met}
        missed |= {MATCH} - ({MATCH} if verdicts["f_number_matched"] else set())
        assert set(told.replace(" and ", ", ").split(", ")) - {""} == missed
        assert (float(fill) if fill else None) == (
            pytest.approx(after.f_number.fill_factor, rel=5e-3) if MATCH in missed else None
        )
        spoilt |= missed
    assert MATCH in spoilt
    assert len(spoilt) > 1


@pytest.mark.parametrize("name", UNLIKE)
@pytest.mark.parametrize("factor", [0.7, 1.13])
def test_what_matches_the_f_number_leaves_no_overlap_as_typed(name, factor):
    design = roslf.load(name).thin_twin
    design = design.replace({"D_F": factor * float(Camera.of(design)["aperture.diameter"])})
    verdict = next(one for one in roslf.evaluate(design, fields=[]).verdicts if one.name == "f_number_matched")
    required = {"required": {"fill_factor": {"min": 0.99, "max": 1.0}}}
    for changes, changed in typed(design.replace(required), verdict.remedy):
        (one,) = required_of(changed)
        assert one.met, (changes, one.value)


@given(st.floats(1e-9, 1e9), st.integers(2, 9), st.sampled_from([-1.0, 1.0]))
def test_digits_on_a_side_are_on_it_and_no_farther_than_one_of_the_last(size, digits, sign):
    value = sign * size
    for up in (True, False):
        told = float(on_side(value, up, digits))
        off = (told - value) if up else (value - told)
        assert -1e-12 * size <= off <= 10.0 ** (np.floor(np.log10(size)) + 1 - digits) * (1 + 1e-6)
