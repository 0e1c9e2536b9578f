"""The protocol of a bench on one page."""

from __future__ import annotations

import math

from ...bench.captures import BoardPose, Distances
from ...bench.protocol import BRIGHT, Protocol
from ...bench.targets import CLOSE, PAPER_BAR
from ...camera import Camera
from ...evaluation.required import required_depth
from ...lenses.glass import AIR
from ...theory.depth_budget import depth_budget
from ...theory.depth_error import temperatures_met
from ...theory.photometry import exposure
from ...words import listed, within
from ..blocks import Bullets, Paragraph, Report, Section, Table
from ..calibrate.pages import cover_statement

SIDES = ("right", "upper right", "top", "upper left", "left", "lower left", "bottom", "lower right")
"""Sides of a board, by eighths of a turn from its right."""
LEVEL = 1.0
"""Tilt below which a board stands square to the axis [degrees]."""


def tilted(pose: BoardPose) -> str:
    """Tilt of a board, as it is set."""
    degrees = math.degrees(pose.tilt)
    if degrees < LEVEL:
        return "square to the axis"
    return f"{degrees:.0f}°, {SIDES[round(8 * pose.towards / math.tau) % 8]} nearer"


def placed_at(pose: BoardPose) -> str:
    """Place of a board's middle and its tilt, in words."""
    right, up = ("right" if pose.right >= 0 else "left"), ("up" if pose.up >= 0 else "down")
    aside = f"{abs(pose.right):.2g} mm {right}, {abs(pose.up):.2g} mm {up}"
    return f"{pose.ahead:.4g} mm ahead, {aside}, {tilted(pose)}, turned {math.degrees(pose.turn):.0f}°"


def protocol_report(protocol: Protocol) -> Report:
    """The page that lies beside the bench."""
    design, setup = protocol.design, protocol.setup
    sections = (
        Section("Order", (_steps(protocol),)),
        Section("Poses of the board", (Paragraph(_promise(protocol)), _poses(setup.poses))),
        Section("Targets", (_targets(protocol),)),
        Section("Redo all of it when", (Bullets(_redo(protocol)),)),
    )
    subtitle = (
        "Distances are mm ahead of the tip, the instrument's front. Raw counts: fixed gain, gamma 1, no sharpening."
    )
    if design.object_space.medium != AIR:
        subtitle += " Targets stand in the medium that the design looks into: laminated, or on glass."
    return Report(f"Bench of {design.name}", subtitle, sections, "roslf bench")


def _names(kind: str, at: Distances) -> str:
    return ", ".join(f"{kind}_{z:g}mm.tif" for z in at)


def _steps(protocol: Protocol) -> Table:
    design, setup, (low, high) = protocol.design, protocol.setup, protocol.counts
    camera = Camera.of(design)
    level = f"brightest {low} to {high} of {protocol.full} DN"
    right, more = [], []
    for at in setup.wall.at:
        alone = float(depth_budget(camera, at, calibration=protocol.lengths).expanded_mm)
        required = required_depth(design, at)
        held = ("as these boards alone calibrate", alone) if required is None else ("as required", required)
        right.append(f"{held[1]:.2g} mm at {at:g} mm, {held[0]}")
        if required is not None and alone > required:
            more.append(f"{alone:.2g} mm at {at:g} mm")
    beyond = (
        ""
        if not more
        else (
            " What is required holds: by captures alone, of a camera whose tolerances nobody knows, the boards promise "
            f"{listed(more)}; what they do where a study's are known, `roslf calibrate --plan` STUDY tells."
        )
    )
    begin = f"begin at {1e3 * float(exposure(camera)):.3g} ms, the design's"
    rows = [
        ("Warm up", "Lamp and camera on for 30 min. Set focus and stop, lock both: untouched from here on.", ""),
        (
            "White",
            "Opal glass close before the tip, lit evenly from behind; two exposures alike, then two at half the light.",
            f"{level}; white_1.tif, white_2.tif, ...",
        ),
        ("Dark", "Cap on, the exposure of the white; two.", "dark_1.tif, dark_2.tif"),
        (
            "Board",
            "The poses below, within a tenth of the distance and 5°; what is not reached is left out.",
            f"white cells {low} to {high} DN, {begin}; {setup.poses[0].file} ...",
        ),
        ("Check", "roslf bench check, after every few boards: what is wrong, what to take next.", "check.html"),
        (
            "Flat wall",
            f"Square to the axis; its depth is to be right, U with k = 2, to {'; to '.join(right)}."
            f"{beyond}{_without_wall(protocol)}",
            _names("wall", setup.wall.at),
        ),
        ("Edge", "In the middle of the field, square to the axis.", _names("edge", setup.edge.at)),
        ("Spheres", "Both in sight, one as near as the other.", _names("spheres", setup.spheres.at)),
        (
            "Field",
            "Rings centred on the picture, square to the axis; the distances to 0.1 mm.",
            _names("field", setup.field.at),
        ),
        ("White", "Once more: shows that nothing moved.", "white_5.tif"),
        ("Report", "roslf bench report: measured beside the data sheet.", "acceptance.html"),
    ]  # fmt: skip
    numbered = tuple((str(k), *row) for k, row in enumerate(rows, 1))
    share = f"{100 * BRIGHT[0]:.0f} to {100 * BRIGHT[1]:.0f} %"
    caption = (
        f"{low} to {high} DN are {share} of full scale, which is {design.sensor.full_well:.0f} electrons. "
        "Steps 2 to 4 and 10 go into calibration/, 6 to 9 into acceptance/; .png, .npy and stacks will do."
    )
    return Table(
        numbered, "llll", ("", "step", "what", "level; files"), caption=caption, dense=True, widths=(1.5, 6, 0, 25)
    )


def _without_wall(protocol: Protocol) -> str:
    """Distances required or asked for at which there is no depth, or the one wall shows too few dots, or aliases."""
    cover, stands = protocol.cover, [float(f"{at:.4g}") for at in protocol.setup.wall.at]
    wanted = sorted((*cover.covered_mm, *(one.at_mm for one in cover.uncovered)))
    left = [at for at in wanted if not any(abs(at - stand) <= CLOSE * stand for stand in stands)]
    causes = {at: depth_budget(Camera.of(protocol.design), at) for at in left}
    without = {f"{at:.4g}": budget.cause for at, budget in causes.items() if math.isinf(budget.u_z_mm)}
    unsuited = [f"{at:.4g}" for at in left if f"{at:.4g}" not in without]
    told = f" No depth at {listed([*without])} mm: {listed([*dict.fromkeys(without.values())])}." if without else ""
    return told + (f" Its dots do not suit {listed(unsuited)} mm." if unsuited else "")


def _promise(protocol: Protocol) -> str:
    sigma, board = protocol.plan.expected.sigma, protocol.setup.board
    return (
        f"Board {board.cells}, {len(protocol.setup.poses)} images: H to {within(sigma['H'], '±')}, d_3 to"
        f" {within(sigma['d_3'], '±')} mm (one sigma, data sheet's errors in it)."
        + (f" {covered.text}" if (covered := cover_statement(protocol.cover)) else "")
    )


def _poses(poses: tuple[BoardPose, ...]) -> Table:
    def cells(pose: BoardPose | None) -> tuple[str, ...]:
        if pose is None:
            return ("",) * 6
        number, turn = pose.file.removesuffix(".tif").removeprefix("board_"), round(math.degrees(pose.turn))
        return number, f"{pose.ahead:.4g}", f"{pose.right:+.1f}", f"{pose.up:+.1f}", tilted(pose), f"{turn}°"

    half = (len(poses) + 1) // 2
    others: list[BoardPose | None] = [*poses[half:], *[None] * (2 * half - len(poses))]
    rows = tuple((*cells(one), *cells(other)) for one, other in zip(poses[:half], others, strict=True))
    heads = ("board", "ahead", "right", "up", "tilt", "turn")
    return Table(rows, "lrrrlr" * 2, heads * 2, dense=True, widths=(5, 4.5, 3.5, 3.5, 0, 4.5) * 2)


def _targets(protocol: Protocol) -> Table:
    rows = tuple((sheet.kind, sheet.title, sheet.remark) for sheet in protocol.sheets)
    caption = (
        "Print targets/*.pdf at 100 %, glue them to glass or aluminium. Measure each bar"
        f" ({PAPER_BAR:.2f} mm, 20.00 mm on glass), write what it is to bench.toml (printed_bar): sizes follow it."
    )
    return Table(rows, "lll", ("target", "what", "made as"), caption=caption, dense=True, widths=(5, 0, 20))


def _redo(protocol: Protocol) -> tuple[str, ...]:
    return (
        "focus, stop, microlens array or sensor was touched, or check says that something moved;",
        f"the camera's temperature is 5 K off{_calibrated_at(protocol)}, or it was dropped, or heated beyond its use; "
        "the lamp's brightness drifted by 3 %;",
        "another target was printed, or a bar was measured again: boards and the files made of it.",
    )


def _calibrated_at(protocol: Protocol) -> str:
    """Temperature at which a design says that it is calibrated, and those at which it is used."""
    met = temperatures_met(Camera.of(protocol.design))
    if met is None:
        return ""
    coldest, warmest, known = (f"{float(degrees):g}" for degrees in met)
    used = coldest if coldest == warmest else f"{coldest} to {warmest}"
    return f" {known} °C, at which all of this is captured (it is used at {used} °C)"
