"""Depth precision over the working range, of one design or of several."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..camera import Camera
from ..theory.light_field import SIGMA_DISPARITY, depth_sigma, rim_disparity
from .lettering import SMALL, short, text_width
from .marks import Dots, Floats, Key, Line, Mark, Point, Text, line_key
from .panel import Panel, Scale
from .picture import Picture, legend_height, one_panel

if TYPE_CHECKING:
    from ..design import Design

LOOKS = (("blue", ""), ("orange", "7 4"), ("green", "8 3 2 3"))
"""Colour and line of each design that is compared."""


class DepthCurve(NamedTuple):
    """What the picture shows."""

    distance: Floats
    """Z from the main lens [mm], shape (N,)."""
    sigma: Floats
    """sigma_Z [mm]."""
    blur: Floats
    """Spread of an object point over the MLA [microlens pitches]."""


def depth_curve(design: Design, points: int = 241) -> DepthCurve:
    """Depth precision from 0.4 to 1.8 times the focal plane's depth, both counted from the FAP."""
    camera = Camera.of(design)
    depth = np.linspace(0.4, 1.8, points) * camera.gap
    return DepthCurve(depth + design.d_3, depth_sigma(camera, depth), np.abs(rim_disparity(camera, depth)))


def _in_focus(design: Design) -> float:
    """sigma_Z at the focal plane [mm]."""
    camera = Camera.of(design)
    return float(depth_sigma(camera, camera.gap))


def depth_precision(design: Design, size: Point = (560, 320)) -> Picture:
    """Draw sigma_Z over the object distance Z, and the defocus there on a second axis; `size` in px.

    The picture's mapping takes pixels to Z and sigma_Z [mm].
    """
    curve, focus = depth_curve(design, 121), _in_focus(design)
    keys = [
        line_key(f"σ_Z for {SIGMA_DISPARITY:g} pitch of disparity error", "blue", 2.2),
        line_key("spread of a point on the MLA (right axis)", "orange", 1.8, "7 4"),
    ]
    left, top, right = 58.0, 14.0, 56.0
    across = Scale(float(curve.distance[0]), float(curve.distance[-1]))
    up = Scale(0.0, 1.08 * float(np.max(curve.sigma)))
    other = Scale(0.0, 1.08 * max(float(np.max(curve.blur)), 1e-9))
    words = f"at d_f = {short(design.d_f)} mm: {short(focus, 3)} mm"
    width = max(size[0] - left - right, 80.0)
    leftwards = float(across.share(design.d_f)) * width + text_width(words, SMALL) + 16 > width
    # Between the two curves, which both leave the upper middle free.
    anchor, dx = ("end", -8.0) if leftwards else ("start", 8.0)
    marks: list[Mark] = [
        Line([design.d_f] * 2, [0.0, up.high], "grey", 1.2, "6 3"),
        Line(curve.distance, curve.sigma, "blue", 2.2, testid="sigma-curve"),
        Dots([design.d_f], [focus], "vermillion", size=6, edge="ground", width=2),
        Text(design.d_f, up.high, words, "ink", SMALL, anchor, dx, 14, halo=True),
    ]
    panel = Panel(
        (0, 0, 1, 1), across, up, tuple(marks), "object distance from the main lens Z [mm]", "depth precision σ_Z [mm]",
        y_colour="blue",
    )  # fmt: skip
    title = f"Depth precision of {design.name}: {focus:.3g} mm at the focal plane, {design.d_f:.4g} mm from the lens"
    picture = one_panel("depth", title, size, panel, keys, left=left, top=top, right=right)
    blur = Line(curve.distance, curve.blur, "orange", 1.8, "7 4")
    beside = Panel(
        picture.panels[0].box, across, other, (blur,), y_label="spread [pitches]", x_ticks=(), grid="", right=True,
        y_colour="orange",
    )  # fmt: skip
    return Picture(picture.name, title, size, (*picture.panels, beside), picture.keys, picture.key_box)


def depth_comparison(designs: Mapping[str, Design], size: Point = (768, 320)) -> Picture:
    """Draw sigma_Z of up to three named designs over the distance from the FAP, Z_F; both axes are logarithmic."""
    marks: list[Mark] = []
    keys: list[Key] = []
    xs, ys = [], []
    for (name, design), (colour, dash) in zip(designs.items(), LOOKS, strict=False):
        curve = depth_curve(design)
        xs.append(curve.distance - design.d_3)
        ys.append(curve.sigma)
        dot = Dots([design.d_f - design.d_3], [_in_focus(design)], colour, size=5, edge="ground", width=1.5)
        marks += [Line(xs[-1], ys[-1], colour, 2.0, dash), dot]
        keys.append(line_key(f"{name}: {design.name}", colour, 2.0, dash))
    ends = [(float(np.min(v)), float(np.max(v))) for v in (np.concatenate(xs), np.concatenate(ys))]
    across, up = (Scale(low / 1.15, high * 1.15, log=True) for low, high in ends)
    panel = Panel((0, 0, 1, 1), across, up, tuple(marks), "object distance from the FAP Z_F [mm]", "σ_Z [mm]")
    title = f"Depth precision of {', '.join(design.name for design in designs.values())}"
    return one_panel("depth-comparison", title, (size[0], size[1] + legend_height(keys, size[0] - 24)), panel, keys)
