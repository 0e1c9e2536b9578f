"""What a report takes for granted, and which effects it leaves out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .blocks import Block, Bullets, Paragraph

if TYPE_CHECKING:
    from ..design import Design
    from ..evaluation.result import Evaluation

IDEAL = (
    "The main lens is ideal and thin: no aberrations, distortion, field curvature or colour. Real lenses add theirs."
)
REAL = (
    "The main lens is real. Its exact rays stand under Real main lens and in the verdicts; all else, tables, ray "
    "diagrams, maps and design space, is its thin twin: an ideal lens of the same focal length and clear diameter, "
    "with distances counted from the principal planes."
)
MODEL = (
    "Microlenses are pinholes at the focal plane's image; their finite aperture, defocus and diffraction are sized "
    "under Effects and not drawn.",
    "Stops are thin circular openings; a tube counts by its rims. Walls neither reflect nor scatter.",
    "Light is of one wavelength, the scene white and at the focal plane unless a figure says otherwise.",
    "Geometry is paraxial in the closed forms; an ideal lens makes it exact at any field, so traced rays agree.",
)
"""True of every report."""


def assumptions(design: Design, result: Evaluation) -> tuple[Block, ...]:
    """The blocks of the section."""
    items = [IDEAL if result.real_lens is None else REAL, *MODEL]
    if design.sensor.relay_magnification != 1:
        items.append("The relay to the sensor is ideal: it only scales the pixels.")
    if not design.aligned:
        items.append(
            "Tilts are traced in the ray diagrams, the 3D view and the table of microlens images over the field; drawn "
            "microlens images and maps are those of the untilted parts."
        )
    exceeded = [e.name.replace("_", " ") for e in result.effects if e.on and abs(e.estimate) > e.budget]
    left = [e.name.replace("_", " ") for e in result.effects if not e.on and e.estimate != 0]
    blocks: list[Block] = [Bullets(tuple(items))]
    if exceeded:
        blocks.append(
            Paragraph(f"Above their budgets, so that a simulation of this design must include them: {_list(exceeded)}.")
        )
    if left:
        blocks.append(Paragraph(f"Of some size but below their budgets: {_list(left)}."))
    blocks.append(Paragraph(result.method))
    return tuple(blocks)


def _list(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
