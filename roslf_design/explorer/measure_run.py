"""Simulated measurement of depth, and how the page shows it."""

from __future__ import annotations

from typing import Any

from ..depth.measure import Trial, simulate
from ..depth.pictures import PictureOptions, region_about
from ..drawing.theme import short
from ..reporting.depth.pages import statements
from .forms import MeasureRequest
from .jobs import Tell

ACROSS = 35
"""Microlenses along each side of what is measured: as many windows as tell bias and spread well."""
FEWEST, PIXELS = 15, 500.0
"""Microlenses along each side at least, where these are of many pixels; pixels along it at most, but for these."""


def run_measure(request: MeasureRequest, tell: Tell = lambda share, text: None) -> Trial:
    """Depth measured in pictures of a slanted wall, as `roslf depth` does, of microlenses about one of them.

    Raises
    ------
    InputError
        What depth is not computed for, or no light there.
    """
    across = round(min(max(PIXELS * request.design.q / request.design.d, FEWEST), ACROSS))
    region = region_about(request.design, request.place, across)
    doing = {
        "white": "rendering a white image", "picture": "tracing rays to the wall",
        "depth": "exposing, decoding and measuring",
    }  # fmt: skip
    options = PictureOptions(region=region, seed=request.seed, exposures=request.exposures)
    return simulate(request.design, options=options, progress=lambda what, share: tell(share, doing[what]))


def trial_page(trial: Trial) -> dict[str, Any]:
    """Values for the page."""
    result, (rows, columns) = trial.summary(), trial.true.shape
    headline = "No microlens has a depth"
    if result.spread_mm is not None and result.bias_mm is not None:
        predicted = "" if result.predicted_mm is None else f", {short(result.predicted_mm, 2)} mm predicted"
        headline = (
            f"Scatter {short(result.spread_mm, 2)} mm{predicted}; off by {short(result.bias_mm, 2)} mm on average"
        )
    x, y = trial.first.x_ml[rows // 2, columns // 2]
    return {
        "headline": headline,
        "question": f"{columns} x {rows} microlenses about ({short(x, 3)}, {short(y, 3)}) mm on the array, in "
        f"{len(trial.runs)} exposure{'s' * (len(trial.runs) > 1)} of a {trial.scene.name}, as roslf depth measures it.",
        "sentences": [
            {
                "tone": s.tone,
                "text": s.text,
                "remedy": "Take more exposures." if "--exposures" in s.remedy else s.remedy,
            }
            for s in statements(trial)
        ],
    }
