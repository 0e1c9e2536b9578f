"""Remedies with numbers: typed into the file as printed, each does what it says."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.camera import Camera
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
