"""Captures of a bench so far: a line an image, and the page."""

from __future__ import annotations

import math

from ...bench.boards import NextPose
from ...bench.captures import KINDS
from ...bench.check import BenchCheck, ImageCheck
from ...bench.protocol import BRIGHT
from ...words import within
from ..blocks import Block, Paragraph, Report, Section, Statement, Statements, Table
from .protocol import placed_at, tilted


def image_line(one: ImageCheck) -> str:
    """One image, in one line."""
    parts = [f"{one.name}: {one.kind}"]
    if one.corners is not None:
        parts.append(f"{one.corners[0]} of {one.corners[1]} corners in {one.views} views")
    parts += [f"level {_percent(one.level)}", f"saturated {_percent(one.saturated)}"] if one.level is not None else []
    parts += [f"contrast {one.contrast:.2f}"] if one.contrast is not None else []
    parts += [f"{one.pose.ahead:.4g} mm ahead, {tilted(one.pose)}"] if one.pose is not None else []
    return ", ".join(parts) + "".join(f"; {fault}" for fault in one.faults)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.2g} %" if 0 < share < 0.1 else f"{100 * share:.0f} %"


def summary(check: BenchCheck) -> tuple[Statement, ...]:
    """Statements about all images together."""
    sums = [Statement("bad", fault) for fault in check.faults]
    boards = f"{len(check.boards)} sound image{'' if len(check.boards) == 1 else 's'} of the board"
    if check.sigma is None:
        sums.append(Statement("caution", f"{boards}: they do not determine H and d_3 yet."))
    else:
        known = f"{boards}: {_known(check.sigma)} so far (one sigma), the images {_percent(check.by_images)} of d_3's"
        limit = "More boards hardly help: know f, the microlens pitch and the board's cells better."
        few = check.by_images < 0.2
        sums.append(Statement("good", f"{known} variance.", limit if few else ""))
    tilts = [math.degrees(one.pose.tilt) for one in check.boards if one.pose is not None]
    if tilts:
        sides = ", ".join(f"{side} {count}" for side, count in check.tilts.items())
        every = min(check.tilts.values()) > 0
        text = f"Tilts up to {max(tilts):.0f}°; images with a side nearer: {sides}."
        sums.append(Statement("good" if every else "caution", text, "" if every else "Tilt boards towards every side."))
    sums.append(Statement("plain", f"Take next: {_next(check.best)}"))
    if check.missing:
        poses = [name for name in check.missing if name not in KINDS]
        left = [name for name in check.missing if name in KINDS] + (
            [f"{len(poses)} poses of the board"] if poses else []
        )
        sums.append(Statement("plain", f"Not captured yet: {', '.join(left)}."))
    return tuple(sums)


def _known(sigma: dict[str, float]) -> str:
    return f"H to {within(sigma['H'], '±')}, d_3 to {within(sigma['d_3'], '±')} mm"


def _next(best: NextPose) -> str:
    then = "" if best.sigma is None else f"; then {_known(best.sigma)}"
    return f"{best.pose.file}, {placed_at(best.pose)}{then}."


def check_report(name: str, check: BenchCheck) -> Report:
    """The page: what all say together, and each image."""
    rows = tuple(
        (
            one.name,
            one.kind,
            "" if one.corners is None else f"{one.corners[0]} of {one.corners[1]} in {one.views}",
            _percent(one.level),
            "" if one.level is None else _percent(one.saturated),
            "" if one.contrast is None else f"{one.contrast:.2f}",
            "" if one.pose is None else f"{one.pose.ahead:.4g} mm, {tilted(one.pose)}",
            "; ".join(one.faults),
        )
        for one in check.images
    )
    heads = ("image", "kind", "corners in views", "level", "saturated", "contrast", "ahead, tilt", "fault")
    low, high = BRIGHT
    blocks: tuple[Block, ...] = (
        Table(rows, "llrrrrll", heads),
        Paragraph(
            f"Level: brightest pixels over full scale, to be {100 * low:.0f} to {100 * high:.0f} %. Contrast:"
            " Michelson, of the central view."
        ),
    )
    title, subtitle = f"Captures of {name}", "What has been captured so far, and what to take next"
    sections = (Section("Together", (Statements(summary(check)),)), Section("Image by image", blocks))
    return Report(title, subtitle, sections, "roslf bench check")
