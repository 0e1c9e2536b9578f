"""What `roslf report --figure` writes besides the page's own figures: the instrument in 3D."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..design import Design

SOLID = {"model": "model.vtp", "3d": "3d.png"}
"""Name of a 3D file to its file name."""


def design_in_3d(names: Sequence[str], compare: bool) -> Design:
    """The one design that a 3D model can be made of.

    Raises
    ------
    InputError
        Several designs, or a study.
    """
    from ..design import load, preset_names
    from ..errors import InputError, Problem
    from ..report.story import load_story_or_study

    (name, *others) = names
    if not others and not compare:
        if name in preset_names() and not Path(name).exists():
            return load(name)
        if load_story_or_study(Path(name))[0] == "design":
            return load(name)
    raise InputError((Problem("--figure", "3d and model are of one design; name its file alone"),))


def solid_files(design: Design, wanted: Sequence[str]) -> dict[str, bytes]:
    """The model and its picture; a picture that cannot be drawn here is told on stderr and left out."""
    from ..report.model import picture, vtp_bytes
    from ..report.offscreen import NoPictureError

    files = {}
    if "model" in wanted:
        files[SOLID["model"]] = vtp_bytes(design)
    if "3d" in wanted:
        try:
            files[SOLID["3d"]] = picture(design)
        except NoPictureError as error:
            print(f"roslf: {SOLID['3d']} is left out: {error}", file=sys.stderr)
    return files
