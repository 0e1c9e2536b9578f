"""A calibration that was made: what `roslf calibrate` left in its folder, as a section of a report."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, Problem
from .blocks import Block, Bullets, Figure, Section, Statement, Statements, Table

if TYPE_CHECKING:
    from ..design import Design

FILE, SCHEMA = "calibration.json", "roslf.calibration/"
FIGURES = {
    "residuals": ("What the joint fit leaves over", "A pattern that boards share speaks of distortion not asked for."),
    "epi-lines": ("Epipolar slopes against inverse depth", "Slope and zero of the line give d_2 and the focal plane."),
    "posterior": ("How sure: the posterior", "Dark and light regions hold 68 % and 95 %; dashed lines hold 68 %."),
    "depth": (
        "What it means for measured depths",
        "The same in all images, so averaging does not take it away; beyond the ticks the calibration extrapolates.",
    ),
}
"""Title and caption of each drawing in the folder."""
SOURCES = {"images": "images", "f": "f", "q": "pixel pitch", "d": "microlens pitch", "board": "board's scale"}


@dataclass(frozen=True, eq=False)
class Calibrated:
    """What a folder holds."""

    data: Mapping[str, Any]
    """Its calibration.json."""
    drawings: Mapping[str, str]
    """SVG text by name."""


def read_calibration(place: Path) -> Calibrated:
    """Read the folder of a calibration, or its calibration.json.

    Raises
    ------
    InputError
        It is not there, or is something else.
    """
    file = place / FILE if place.is_dir() else place
    try:
        data = json.loads(file.read_bytes())
    except FileNotFoundError:
        message = f"{file}: no such file; name the folder that roslf calibrate wrote"
        raise InputError((Problem("calibration", message),)) from None
    except OSError as error:
        raise InputError((Problem("calibration", f"{file} cannot be read: {error.strerror}"),)) from None
    except ValueError:
        raise InputError((Problem("calibration", f"{file} is no JSON; roslf calibrate writes it anew"),)) from None
    schema = data.get("schema", "") if isinstance(data, dict) else ""
    if not str(schema).startswith(SCHEMA) or not isinstance(data.get("quantities"), dict):
        message = f"{file} is no calibration (schema {schema!r}); name the folder that roslf calibrate wrote"
        raise InputError((Problem("calibration", message),))
    drawings = {name: file.with_name(f"{name}.svg") for name in FIGURES}
    return Calibrated(data, {name: _inline(path.read_text()) for name, path in drawings.items() if path.is_file()})


def _inline(svg: str) -> str:
    """A drawing of a file of its own as text for a page."""
    return re.sub(r"\s*<style>.*?</style>", "", svg[svg.index("<svg") :], count=1, flags=re.DOTALL).strip()


def calibrated_statement(found: Calibrated) -> Statement:
    """What was found, in one sentence."""
    told = []
    for name in ("H", "d_3"):
        row = found.data["quantities"][name]
        told.append(f"{name} = {_rounded(row)} ± {row['sigma']:.2g} {row['unit']}".strip())
    warned = bool(found.data.get("warnings")) or found.data.get("converged") is False
    images = len(found.data.get("images_used", ()))
    return Statement(
        "caution" if warned else "good", f"Calibrated from {images} images: {', '.join(told)} (standard deviations)."
    )


def calibrated_section(design: Design, found: Calibrated) -> Section:
    """Estimates with their intervals, where their variance comes from, drawings and warnings."""
    data = found.data
    said = [calibrated_statement(found)]
    posterior = data.get("posterior")
    if posterior:
        said.append(Statement("good" if data.get("converged") else "bad", f"Posterior {posterior['message']}."))
    if data["design"] not in (design.name, f"{design.name}, calibrated") and not design.name.startswith(data["design"]):
        text = f"The calibration is of a camera built to another design: {data['design']}."
        said.append(Statement("caution", text))
    blocks: list[Block] = [Statements(tuple(said)), _quantities(data), _shares(data)]
    for name, svg in found.drawings.items():
        title, caption = FIGURES[name]
        blocks.append(Figure(f"calibration-{name}", title, caption, svg))
    if data.get("warnings"):
        blocks.append(Bullets(tuple(data["warnings"])))
    return Section("Calibration", tuple(blocks))


def _quantities(data: Mapping[str, Any]) -> Table:
    rows = []
    for name, row in data["quantities"].items():
        intervals = (f"{low:.6g} to {high:.6g}" for low, high in (row["interval_68"], row["interval_95"]))
        rows.append((name, _rounded(row), row["unit"], f"{row['sigma']:.2g}", *intervals))
    source = data.get("intervals_from", "")
    title = "Calibrated, with intervals" + (f" of the {source}" if source else "")
    return Table(tuple(rows), "ldllll", ("", "estimate", "", "sigma", "68 % interval", "95 % interval"), title)


def _shares(data: Mapping[str, Any]) -> Table:
    rows = tuple(
        (name, *(f"{100 * row['variance_shares'].get(source, 0.0):.1f} %" for source in SOURCES))
        for name, row in data["quantities"].items()
    )
    return Table(rows, "l" + "r" * len(SOURCES), ("", *SOURCES.values()), "Where the variance comes from")


def _rounded(row: Mapping[str, Any]) -> str:
    """An estimate to two digits of its standard deviation."""
    sigma = row["sigma"]
    places = max(0, min(8, 1 - math.floor(math.log10(sigma)))) if sigma > 0 else 6
    return f"{row['estimate']:.{places}f}"
