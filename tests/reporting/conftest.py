"""What makes reports quick where a test looks at neither figures nor yields."""

import pytest

from tests.reporting import made


@pytest.fixture
def without_figures(monkeypatch):
    """As `made.without_figures` says."""
    made.without_figures(monkeypatch)


@pytest.fixture(scope="module")
def few_builds():
    """As `made.few_builds` and `made.few_waves` say."""
    with pytest.MonkeyPatch.context() as patch:
        made.few_builds(patch)
        made.few_waves(patch)
        yield
