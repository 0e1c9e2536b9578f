"""What makes reports quick where a test looks at neither figures nor yields."""

import pytest

from roslf_design.reporting import datasheet, design, story
from roslf_design.reporting.blocks import Figure

NAMES = ("dimensions", "rays", "cells", "view", "images", "waves", "maps", "plane", "depth", "effects")
BLANK = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" width="9pt" height="9pt"></svg>'


@pytest.fixture
def without_figures(monkeypatch):
    """Blank figures in every design's report."""
    blank = {name: Figure(name, name, name, BLANK) for name in NAMES}
    monkeypatch.setattr(design, "design_figures", lambda *_: blank)


@pytest.fixture(scope="module")
def few_builds():
    """A first look at tolerances with a handful of builds, without the yields at other scales."""
    from roslf_design.tolerancing import result

    look = story.quick_tolerances
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(datasheet, "FEW", 6)
        patch.setattr(datasheet, "MANY", 64)
        patch.setattr(story, "quick_tolerances", lambda design, seed, progress: look(design, seed, progress, 500))
        patch.setattr(
            result, "yield_curve", lambda plan, own: tuple((s, result.yield_at(plan, s, 500)) for s in (0.5, 1.0, 2.0))
        )
        patch.setattr(result, "scale_for_yield", lambda plan, target, curve: None)
        yield
