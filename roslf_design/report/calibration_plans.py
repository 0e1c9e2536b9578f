"""How well the camera could be calibrated: a plan of captures that suits a design, and what it promises."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..calibration import Board, Captures, camera_of, sheet_of
from ..calibration import plan as planned
from ..calibration.section import plan_advice, plan_blocks
from ..design.units import parse_quantity
from ..errors import InputError, Problem
from ..theory.aperture import effective_image_distance
from .blocks import Block, Code, Paragraph, Section, Statement, Statements
from .parts_list import length

if TYPE_CHECKING:
    from ..calibration.planning import CapturePlan as Plan
    from ..design import Design
    from .story_file import CalibrationPart

BOARDS, TILT, NOISE, F_SIGMA = 12, math.radians(20), 0.06, 0.01
"""Images, largest tilt [rad], corner noise [pitches], relative standard deviation of f: what careful work reaches."""
CELLS = (4, 5)
ROOM = 0.8
"""Share of the narrower field that a board of our own choosing may fill at its nearest."""


def calibration_plan(design: Design, asked: CalibrationPart | None = None, seed: int = 0) -> Plan:
    """Plan a calibration.

    Parameters
    ----------
    design : Design
    asked : CalibrationPart, optional
        Board, number of images and the like; what it leaves open is chosen to suit the design.
    seed : int
        Of the boards' poses.

    Raises
    ------
    CalibrationError
        The captures do not determine the camera.
    """
    captures = captures_for(design, asked)
    relative = F_SIGMA if asked is None else f_sigma(asked.f_sigma, design)
    return planned(camera_of(design), sheet_of(design, relative), captures, seed=seed)


def captures_for(design: Design, asked: CalibrationPart | None = None) -> Captures:
    """What to capture with a design: what is asked for, else what suits it."""
    depth = design.d_f - design.d_3
    image = design.D_F * design.d_2 / abs(float(effective_image_distance(design.f, design.d_f, design.d_3)))
    middle = design.d_f if asked is None or asked.distance is None else asked.distance
    spread = depth / 4 if asked is None or asked.range is None else asked.range
    nearest = middle - spread / 2
    board = fitting_board(design, nearest) if asked is None or asked.board is None else Board.parse(asked.board)
    return Captures(
        board=board,
        boards=BOARDS if asked is None else asked.boards,
        distance=middle,
        distance_range=spread,
        tilt=TILT if asked is None else asked.tilt,
        offset=0.035 * max(middle - design.d_3, 0.0),
        noise=NOISE if asked is None else asked.noise,
        # As far out as corners are followed: views at the pupil's rim are left out.
        reach=0.385 * min(design.d, image) / design.q,
    )


def fitting_board(design: Design, nearest: float) -> Board:
    """A board of 4 x 5 cells, their size 1, 2 or 5 times a power of ten, that the sensor sees whole at its nearest."""
    width, height = sorted(field_at(design, nearest))
    columns, rows = CELLS
    largest = ROOM * min(width / columns, height / rows)
    decade = 10.0 ** math.floor(math.log10(largest))
    cell = max(step * decade for step in (1, 2, 5) if step * decade <= largest * (1 + 1e-9))
    return Board(columns, rows, float(f"{cell:.3g}"))


def field_at(design: Design, distance: float) -> tuple[float, float]:
    """What the sensor sees of a plane, across and down [mm], by the middles of its pencils."""
    camera = camera_of(design)
    across, down = (size * abs(distance - design.d_3) / camera.A for size in design.sensor_size)
    return across, down


def f_sigma(text: str, design: Design) -> float:
    """Relative standard deviation of f from text such as "1 %" or "0.5 mm".

    Raises
    ------
    InputError
        It says something else.
    """
    try:
        if text.strip().endswith("%"):
            return float(text.strip()[:-1]) / 100
        return parse_quantity(text, "length") / design.f
    except ValueError:
        raise InputError((Problem("f_sigma", f'"{text}" is not understood; give "1 %" or "0.5 mm"'),)) from None


def calibration_section(design: Design, plan: Plan, known: str = f"{100 * F_SIGMA:g} %") -> Section:
    """The plan as a section."""
    c = plan.captures
    text = (
        f"Before any capture: {c.boards} images of a {c.board.columns} x {c.board.rows} board of "
        f"{length(c.board.cell)} cells, tilted by up to {math.degrees(c.tilt):.3g} degrees, "
        f"{c.distance:.4g} ± {c.distance_range / 2:.3g} mm "
        f"in front of the lens; corners found to {c.noise:g} pitches in {len(c.view_grid())} views; focal length known "
        f"to {known}, microlens pitch and board to 0.1 %. Standard deviations are from the Fisher matrix, medians over "
        "random sets of poses."
    )
    blocks: list[Block] = [
        Paragraph(text),
        Statements((plan_statement(plan), *_unseen(design, plan))),
        *plan_blocks(plan),
    ]
    board = f"{c.board.columns}x{c.board.rows} {c.board.cell:g} mm"
    command = f'roslf calibrate CAPTURES --design design.toml --board "{board}" -o calibration'
    return Section(
        "Calibration plan", (*blocks, Code(command, "Once images are captured, with the design below as design.toml"))
    )


def plan_statement(plan: Plan) -> Statement:
    """What the plan promises, in one sentence."""
    sigma = plan.expected.sigma
    text = (
        f"Calibration as planned will know d_3 to {sigma['d_3']:.2g} mm, H to {sigma['H']:.2g} and d_2 to "
        f"{1e3 * sigma['d_2']:.2g} um (one standard deviation)."
    )
    return Statement("plain", text, plan_advice(plan))


def no_plan(reason: str) -> Section:
    """The section where captures cannot determine the camera."""
    text = f"No plan: {' '.join(reason.split())}."
    return Section("Calibration plan", (Statements((Statement("caution", text),)),))


def _unseen(design: Design, plan: Plan) -> tuple[Statement, ...]:
    c = plan.captures
    field = sorted(field_at(design, c.distance - c.distance_range / 2))
    sides = sorted((c.board.columns * c.board.cell, c.board.rows * c.board.cell))
    if all(side <= seen for side, seen in zip(sides, field, strict=True)):
        return ()
    text = (
        f"The board measures {sides[0]:.3g} x {sides[1]:.3g} mm, but the sensor sees only {field[0]:.3g} x "
        f"{field[1]:.3g} mm at its nearest, and the plan counts every corner as seen."
    )
    return (Statement("caution", text, "Choose a smaller board."),)
