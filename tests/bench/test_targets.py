"""Targets true to scale, as their PDF and SVG say; boards that our own corner finder finds."""

import functools
import itertools
import math
import re
from io import BytesIO
from xml.etree import ElementTree

import cv2
import numpy as np
import pikepdf
import pytest

import roslf_design as roslf
from roslf_design.bench.protocol import Protocol
from roslf_design.bench.targets import DOT, sheets, texture
from roslf_design.calibration.corners import find_corners
from roslf_design.calibration.model import Board
from roslf_design.calibration.options import PlanOptions
from roslf_design.errors import InputError
from roslf_design.evaluation.required import required_depth
from roslf_design.reporting.bench.protocol import protocol_report
from roslf_design.reporting.bench.targets import target_files
from roslf_design.reporting.printers import render_pdf
from roslf_design.theory.depth_budget import depth_budget
from roslf_design.theory.quantities import QUANTITIES

POINT = 25.4 / 72
SVG = "{http://www.w3.org/2000/svg}"


@functools.cache
def protocol(name, board=None):
    return Protocol.of(roslf.load(name), PlanOptions(board=board))


def segments(pdf):
    """Size of a PDF's page and its straight lines, shape (n, 2, 2), all in mm."""
    with pikepdf.open(BytesIO(pdf)) as document:
        (page,) = document.pages
        box = [float(value) for value in page.mediabox]
        lines = []
        _walk(page, np.eye(3), lines)
    return (POINT * (box[2] - box[0]), POINT * (box[3] - box[1])), POINT * np.array(lines)


def _walk(stream, matrix, lines):
    stack, at, start = [], None, None
    for operands, operator in pikepdf.parse_content_stream(stream):
        numbers = [float(value) for value in operands] if str(operator) in ("m", "l", "cm", "re") else []
        match str(operator):
            case "q":
                stack.append(matrix)
            case "Q":
                matrix = stack.pop()
            case "cm":
                matrix = np.array([[*numbers[0:2], 0], [*numbers[2:4], 0], [*numbers[4:6], 1]]) @ matrix
            case "m":
                at = start = numbers
            case "l":
                lines.append([(np.array([*place, 1]) @ matrix)[:2] for place in (at, numbers)])
                at = numbers
            case "h":
                lines.append([(np.array([*place, 1]) @ matrix)[:2] for place in (at, start)])
            case "re":
                x, y, width, height = numbers
                for one, other in (((x, y), (x + width, y)), ((x, y), (x, y + height))):
                    lines.append([(np.array([*place, 1]) @ matrix)[:2] for place in (one, other)])
            case "Do":
                form = stream.Resources.XObject[str(operands[0])]
                if form.Subtype == "/Form":
                    a = [float(value) for value in form.get("/Matrix", [1, 0, 0, 1, 0, 0])]
                    _walk(form, np.array([[*a[0:2], 0], [*a[2:4], 0], [*a[4:6], 1]]) @ matrix, lines)


def lengths(lines):
    return np.hypot(*(lines[:, 1] - lines[:, 0]).T)


def bar_of(svg):
    """Size of an SVG's page and length of its bar [mm]."""
    root = ElementTree.fromstring(svg)
    width, height = (float(root.get(name).removesuffix("mm")) for name in ("width", "height"))
    unit = width / float(root.get("viewBox").split()[2])
    (path,) = [element for element in root.iter(f"{SVG}path") if element.get("data-testid") == "bar"]
    start, end = re.match(r"M([\d.]+) [\d.]+H([\d.]+)M", path.get("d")).groups()
    return (width, height), unit * (float(end) - float(start))


@pytest.mark.parametrize(("name", "bars"), [("paper", {100.0}), ("grin-needle", {100.0, 20.0})])
def test_bars_are_as_long_as_they_say(name, bars):
    shown = protocol(name).sheets
    files = target_files(shown)
    assert {sheet.bar for sheet in shown} == bars
    for sheet in shown:
        size, lines = segments(files[f"{sheet.kind}.pdf"])
        assert size == pytest.approx(sheet.size, abs=0.01)
        level = lines[np.abs(lines[:, 1, 1] - lines[:, 0, 1]) < 1e-3]
        off = np.abs(lengths(level) - sheet.bar)
        assert off.min() < 0.01  # 283.465 pt is 100 mm
        bar = level[np.argmin(off)]
        assert bar[:, 1].max() < 20  # it lies at the foot of the page
        drawn, length = bar_of(files[f"{sheet.kind}.svg"])
        assert drawn == pytest.approx(sheet.size)
        assert length == pytest.approx(sheet.bar, abs=1e-4)


def test_cells_and_edge_are_printed_as_large_as_they_are():
    paper = protocol("paper")
    files = target_files(paper.sheets)
    _, lines = segments(files["board.pdf"])
    assert np.sum(np.abs(lengths(lines) - 6.0) < 0.01) >= 2 * 10  # ten dark cells
    _, lines = segments(files["edge.pdf"])
    way = lines[:, 1] - lines[:, 0]
    turned = np.degrees(np.arctan2(way[:, 1], way[:, 0])) % 90
    sides = np.abs(lengths(lines) - paper.setup.edge.side) < 0.01
    assert sides.sum() >= 4
    np.testing.assert_allclose(np.minimum(turned[sides], 90 - turned[sides]), 5.0, atol=0.01)


@pytest.mark.parametrize(
    "text", ["charuco 7x6 6 mm 4.5 mm DICT_4X4_50", "charuco 5x7 6 mm 3.5 mm DICT_5X5_100", "7x6 6 mm"]
)
def test_boards_are_found_in_a_picture_of_their_drawing(text):
    paper = protocol("paper")
    setup = paper.setup.model_copy(update={"board": paper.setup.board.model_copy(update={"cells": text})})
    sheet = sheets(setup, "test")[0]
    board, scale = Board.parse(text), 16  # pixels a millimetre
    low, high = (f(np.concatenate(sheet.dark), axis=0) for f in (np.min, np.max))
    size = np.array([board.columns, board.rows]) * board.cell
    np.testing.assert_allclose(high - low, size, atol=1e-9)
    rows, columns = (int((side + 12) * scale) for side in size[::-1])
    canvas = np.full((rows, columns), 230, np.uint8)
    for polygon in sheet.dark:
        (left, top), (right, bottom) = (np.rint((polygon - low + 6) * scale).astype(int)[k] for k in (0, 2))
        canvas[top:bottom, left:right] = 20
    turn = np.array([[0.62, 0.08, 30.0], [-0.05, 0.58, 60.0], [6e-5, -4e-5, 1.0]])
    picture = cv2.GaussianBlur(cv2.warpPerspective(canvas, turn, (640, 560), borderValue=230), (0, 0), 1.0)
    corners = find_corners(picture, board).corners
    plane = (board.points[:, :2] + size / 2 + 6) * scale - 0.5
    truth = cv2.perspectiveTransform(plane[None], turn)[0]
    off = min(np.abs(corners - order).max() for order in (truth, truth[::-1]))
    assert off < 0.08  # the picture is interpolated in steps of 1/32 px


def test_targets_say_how_they_are_made():
    needle = protocol("grin-needle").sheets
    assert {sheet.remark for sheet in protocol("paper").sheets} == {"A4"}
    remarks = {sheet.kind: sheet.remark for sheet in needle}
    assert "lithography" in remarks["board"]
    assert "0.3 mm" in remarks["board"]  # cells of 0.2 mm span five microlenses to 94.2 mm, and the focus is at 95.6
    for sheet in needle:
        assert ("lithography" in sheet.remark) == (sheet.bar < 100)
    wide = {sheet.kind: sheet for sheet in protocol("pipe-bore").sheets}["field"]
    assert wide.size > (210, 297)
    assert "page" in wide.remark


@pytest.mark.parametrize("name", ["paper", "rigid-scope", "grin-needle", "pipe-bore", "ear-speculum"])
def test_what_is_printed_can_be_and_what_is_seen_suits_the_field(name):
    setup = protocol(name).setup
    camera = roslf.Camera.of(roslf.load(name))
    footprint = roslf.quantity("object_sample_mm")
    for at in setup.wall.at:
        assert setup.wall.finest >= 2 * footprint(camera, at) * 0.95  # finer dots alias; two digits
    (at,) = setup.spheres.at
    assert setup.spheres.finest >= 2 * footprint(camera, at) * 0.95
    assert setup.spheres.finest < setup.spheres.diameter / 4
    if setup.wall.bar == 100:
        assert setup.wall.finest >= 2 * DOT
    for at in setup.field.at:  # rings both inside the picture and beyond its corner
        half = roslf.quantity("field_half_diagonal_mm")(camera, at)
        inside = np.array(setup.field.radii) < half
        assert inside.sum() >= 4
        assert not inside.all()
    assert len(setup.spheres.at) == 1
    # VDI/VDE 2634-2's spacing of three tenths leaves spheres of a fifth half a diameter between them.
    assert setup.spheres.spacing >= 1.45 * setup.spheres.diameter


def test_texture_has_all_its_octaves():
    dots = texture(256, 5, np.random.default_rng(1))
    assert dots.mean() == pytest.approx(0.5, abs=0.01)
    sizes = [dots.reshape(256 // n, n, 256 // n, n).mean(axis=(1, 3)).var() for n in (1, 2, 4, 8, 16, 32)]
    assert all(coarse < fine for fine, coarse in itertools.pairwise(sizes))
    assert np.all(-np.diff(sizes)[:4] > 0.02)
    assert (dots == texture(256, 5, np.random.default_rng(1))).all()


def test_walls_stand_where_they_are_asked_for():
    """At 330 mm beside the working range's: dots of two microlenses there, a side that fills it, depth's U told."""
    design = roslf.load("paper")
    plan = Protocol.of(design, PlanOptions(board="4x5 6 mm", at=(330.0, 230.0)))
    plain = Protocol.of(design, PlanOptions(board="4x5 6 mm"))
    wall = plan.setup.wall
    assert wall.at == (*plain.setup.wall.at, 330.0)
    camera = roslf.Camera.of(design)
    assert wall.finest == pytest.approx(2 * QUANTITIES["object_sample_mm"](camera, 330.0), rel=0.06)
    assert wall.side > 2 * QUANTITIES["field_half_width_mm"](camera, 330.0)
    assert plan.setup.edge == plain.setup.edge
    right = float(depth_budget(camera, 330.0, calibration=plan.lengths).expanded_mm)  # as drawn, of no camera
    assert right > 2 * float(QUANTITIES["u_z_mm"](camera, 330.0))
    assert f"{right:.2g} mm at 330 mm, as these boards alone calibrate." in repr(protocol_report(plan))


def test_a_wall_is_to_be_as_right_as_the_design_requires():
    """Not as loosely as captures calibrate: a camera that fails what it requires would be accepted."""
    design = roslf.load("paper").replace({"required": {"u_z_mm": {"at": 330.0, "max": 0.05}}})
    plan = Protocol.of(design, PlanOptions(board="4x5 6 mm"))
    alone = float(depth_budget(roslf.Camera.of(design), 330.0, calibration=plan.lengths).expanded_mm)
    told = repr(protocol_report(plan))
    assert "0.1 mm at 330 mm, as required" in told
    assert f"whose tolerances nobody knows, the boards promise {alone:.2g} mm at 330 mm;" in told
    assert required_depth(design, 330.0) == pytest.approx(0.1)
    assert required_depth(design, 300.0) is None


def test_no_wall_stands_where_there_is_no_depth_or_beside_one_that_is_required():
    """A source in the tip fills pixels close to it, by the inverse square; 330 mm and 340 are one wall."""
    sharp = {"view_depth_of_field_near_mm": {"max": 60.0}, "view_depth_of_field_far_mm": {"min": 340.0}}
    light = {"illuminance": 2e4, "measured_at": 230.0, "exposure": "8 ms"}
    design = roslf.load("paper").replace({"light": light, "required": {**sharp, "u_z_mm": {"at": 330.0, "max": 9.0}}})
    camera, well = roslf.Camera.of(design), design.sensor.full_well
    assert (
        float(QUANTITIES["pixel_electrons"](camera, 60.0)) > well > float(QUANTITIES["pixel_electrons"](camera, 230.0))
    )
    plan = Protocol.of(design, PlanOptions(board="4x5 6 mm"))
    assert 60.0 not in plan.setup.wall.at
    assert (330.0 in plan.setup.wall.at, 340.0 in plan.setup.wall.at) == (True, False)
    told = repr(protocol_report(plan))
    assert "No depth at 60 mm: pixels are full" in told
    assert "inf mm" not in told
    with pytest.raises(InputError, match=r"at: 60 mm: the design has no depth there \(pixels are full\); drop it"):
        Protocol.of(design, PlanOptions(board="4x5 6 mm", at=(60.0,)))


def test_a_protocol_says_at_which_temperature_it_is_captured():
    design = roslf.load("paper").replace({"environment": {"temperature": 37.0, "calibrated_at": 23.0}})
    words = "5 K off 23 °C, at which all of this is captured (it is used at 37 °C)"
    assert words in repr(protocol_report(Protocol.of(design, PlanOptions(board="4x5 6 mm"))))


def test_walls_stand_where_the_design_requires_something():
    """As `at` of a limit, and the ends that views must be sharp at; none of a range beyond the camera's own."""
    at = {"u_z_mm": {"at": 330.0, "max": 99.0}, "view_depth_of_field_near_mm": {"max": 220.0}}
    design = roslf.load("paper")
    asked = design.replace({"required": {**at, "view_depth_of_field_far_mm": {"min": 1e5}}})
    plan, plain = (Protocol.of(one, PlanOptions(board="4x5 6 mm")) for one in (asked, design))
    assert plan.setup.wall.at == tuple(sorted((*plain.setup.wall.at, 220.0, 330.0)))
    ahead = [pose.ahead for pose in plan.setup.poses]
    assert min(ahead) <= 220.0 * (1 + 1e-4)  # as bench.toml's digits have it
    assert "not 330 mm, as views are sharp only up to" in repr(protocol_report(plan))
    far = design.replace({"required": {"u_z_mm": [{"at": z, "max": 99.0} for z in (200.0, 230.0, 3e4)]}})
    assert Protocol.of(far, PlanOptions(board="4x5 6 mm")).setup.wall.at[-1] < 3e4  # whose dots hide all other places
    assert "do not suit 3e+04 mm" in repr(protocol_report(Protocol.of(far, PlanOptions(board="4x5 6 mm"))))
    assert plan.setup.edge == plain.setup.edge


@pytest.mark.parametrize("name", ["paper", "grin-needle", "cystoscope"])
def test_the_protocol_is_one_page_with_this_cameras_numbers(name):
    plan = protocol(name)
    page = protocol_report(plan)
    with pikepdf.open(BytesIO(render_pdf(page))) as document:
        assert len(document.pages) == 1
    text = repr(page)
    design = roslf.load(name)
    full = 2**design.sensor.bits - 1
    assert f"{round(0.6 * full)} to {round(0.8 * full)}" in text
    for pose in plan.setup.poses:
        assert f"{pose.ahead:.4g}" in text
    focus = design.d_f - float(roslf.Camera.of(design).tip)
    poses = np.array([pose.ahead for pose in plan.setup.poses])
    assert poses.min() < focus < poses.max()
    assert max(pose.tilt for pose in plan.setup.poses) <= math.radians(20)
