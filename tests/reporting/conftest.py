"""What makes reports quick where a test looks at neither figures nor yields."""

import pytest

from roslf_design.reporting.blocks import Figure
from roslf_design.reporting.design import pages as design
from tests.reporting import made

NAMES = ("dimensions", "rays", "cells", "view", "images", "waves", "maps", "plane", "depth", "effects")
BLANK = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" width="9pt" height="9pt"></svg>'


@pytest.fixture
def without_figures(monkeypatch):
    """Blank figures in every design's report."""
    blank = {name: Figure(name, name, name, BLANK) for name in NAMES}
    monkeypatch.setattr(design, "_design_figures", lambda *_: blank)


@pytest.fixture(scope="module")
def few_builds():
    """As `made.few_builds` says."""
    with pytest.MonkeyPatch.context() as patch:
        made.few_builds(patch)
        yield
