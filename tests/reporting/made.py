"""What makes reports quick where a test looks at neither figures nor yields."""

import sys
from dataclasses import replace

import numpy as np

from roslf_design.reporting import printers, story
from roslf_design.reporting.blocks import Figure
from roslf_design.reporting.design import curves, pages
from roslf_design.reporting.sheet import lines as datasheet
from roslf_design.reporting.sheet import resolution
from roslf_design.theory import disparity_error
from roslf_design.theory.resolution import FieldTransfer
from roslf_design.tolerancing import budgets, result
from roslf_design.tolerancing.yields import ScaledBuilds, Yield

NAMES = ("dimensions", "rays", "cells", "view", "images", "waves", "maps", "plane", "depth", "effects")
BLANK = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" width="9pt" height="9pt"></svg>'


def without_figures(patch):
    """Blank figures of every design; those of data sheets and of studies stay."""
    blank = {name: Figure(name, name, name, BLANK) for name in NAMES}
    patch.setattr(pages, "_design_figures", lambda *_: blank)


def rough_resolution(patch):
    """Detail that single views resolve scatters as the refocused image's; curves of MTF are polygons of seven points.

    Where microlens images are long, the transfer of views takes many times the work of all else.
    """
    limit, mtf = datasheet._Resolution._limit, FieldTransfer.__call__

    def refocused(line, transfer):
        return limit(replace(line, row=replace(line.row, image="refocused")), transfer)

    def polygon(transfer, frequencies, *which):
        some = np.asarray(frequencies)[::12]
        return np.interp(frequencies, some, mtf(transfer, some, *which))

    patch.setattr(FieldTransfer, "__call__", polygon)
    patch.setattr(datasheet._Resolution, "_limit", refocused)
    patch.setattr(resolution, "COLUMNS", 3)
    patch.setattr(resolution, "ROWS", 3)


def few_builds(patch):
    """Default tolerances by a handful of builds, at other scales by fewer; sheets' lines and maps by fewer.

    Resolution is rough. Without predicted depth precision, which is many times the work of all else; its curve over
    distance, half of what a whole report takes, is a polygon too. No figure is tried
    smaller so that a page of a PDF is full.
    """
    rough_resolution(patch)
    look, study, over_distance = story._quick_tolerances, story.quick_study, curves._depth_curve

    def without_depth(design, seed=0):
        data = study(design, seed)
        return data | {"goals": [goal for goal in data["goals"] if goal["quantity"] != "sigma_z_mm"]}

    patch.setattr(
        curves, "_depth_curve", lambda design, points=241, *known: over_distance(design, 1 + points // 12, *known)
    )
    patch.setattr(datasheet, "FEW", 6)
    patch.setattr(datasheet, "MANY", 64)
    patch.setattr(printers, "MOST_TRIED", 0)
    patch.setattr(story, "quick_study", without_depth)
    patch.setattr(story, "_quick_tolerances", lambda design, seed, progress: look(design, seed, progress, 200))

    def three(builds, own):
        return tuple((scale, Yield(builds.passed(scale), builds.trials)) for scale in (0.5, 1.0, 2.0))

    patch.setattr(result, "ScaledBuilds", lambda plan, draws, trials: ScaledBuilds(plan, draws, 200))
    patch.setattr(result, "yield_curve", three)
    patch.setattr(result, "scale_for_yield", lambda *of: None)


def views_as_refocused(patch):
    """Detail that single views show is said to be the refocused image's, which takes a hundredth of the work."""
    specification = sys.modules["roslf_design.evaluation.specification"]  # whose function has its name in the package
    each = specification.resolved

    def refocused(images, field, at, image):
        return replace(each(images, field, at, "refocused"), image=image)

    patch.setattr(specification, "resolved", refocused)


def few_waves(patch):
    """Depth precision out of focus by three waves an octave instead of up to forty: a tenth of the work.

    It is off by tens of percent there; `tests/theory` holds the numbers. Other grades, and changes that reach a yield,
    are judged by as few builds as tell it from a smaller one. Single views as above. For where a test looks at no such
    number.
    """
    views_as_refocused(patch)
    patch.setattr(disparity_error, "OCTAVE_NODES", ((np.inf, disparity_error.OCTAVE_NODES[0][1]),))
    patch.setattr(result, "curve_trials", lambda plan: 64)
    patch.setattr(budgets, "MOST_TRIALS", 64)
    patch.setattr(budgets, "FRESH", 1)
