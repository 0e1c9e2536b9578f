"""Guard bands by a table of the standard's, and the page of an acceptance."""

import json
import math
import re

import pytest

from roslf_design.bench.acceptance import Acceptance, AcceptanceLine, guarded
from roslf_design.commands.terminal import json_text
from roslf_design.design import load
from roslf_design.reporting.bench.acceptance import acceptance_report
from roslf_design.reporting.printers import render_html


@pytest.mark.parametrize(
    ("value", "expanded", "limits", "verdict"),
    [
        (10.0, 0.5, (9.0, 11.0), "in tolerance"),
        (10.5, 0.5, (9.0, 11.0), "in tolerance"),  # the acceptance zone is closed
        (10.6, 0.5, (9.0, 11.0), "undecided"),
        (11.4, 0.5, (9.0, 11.0), "undecided"),
        (11.6, 0.5, (9.0, 11.0), "out"),
        (8.6, 0.5, (9.0, 11.0), "undecided"),
        (8.4, 0.5, (9.0, 11.0), "out"),
        (10.0, 1.5, (9.0, 11.0), "undecided"),  # the test is coarser than the tolerance
        (14.0, 1.5, (9.0, 11.0), "out"),
        (3.0, 0.5, (2.0, math.inf), "in tolerance"),
        (2.2, 0.5, (2.0, math.inf), "undecided"),
        (1.4, 0.5, (2.0, math.inf), "out"),
        (0.1, 0.05, (-math.inf, 0.2), "in tolerance"),
        (0.3, 0.05, (-math.inf, 0.2), "out"),
        (3.0, 0.5, None, "reported"),
        (10.0, math.inf, (9.0, 11.0), "undecided"),
        (math.nan, 0.1, (9.0, 11.0), "undecided"),
    ],
)
def test_guard_band_is_the_measurements_own_uncertainty(value, expanded, limits, verdict):
    assert guarded(value, expanded, limits) == verdict


def result():
    lines = (
        AcceptanceLine("Camera", "H", "", 1.021, 0.004, 1.0204, (1.01, 1.03)),
        AcceptanceLine("Camera", "d_3", "mm", 0.55, 0.02, 0.5, (0.49, 0.51)),
        AcceptanceLine("Resolution", "MTF 50 %, a view", "lp/mm", 2.3, 0.1, 2.34, (2.25, math.inf)),
        AcceptanceLine("Sensor", "gain", "e/count", 2.5, 0.01),
    )
    return Acceptance("rigid scope", lines, ("board_03.tif: overexposed",), ("noise: no dark frame",))


def test_page_has_faults_first_verdicts_and_fields_to_sign():
    page = render_html(acceptance_report(result(), load("rigid-scope"), "result", "B", "2026-11-28"))
    text = " ".join(re.sub(r"<[^>]+>", " ", page.partition("<body")[2]).split())
    assert text.index("board_03.tif: overexposed") < text.index("Of 4 figures") < text.index("2.34")
    for words in (
        "1 in tolerance, 1 out, 1 undecided, 1 reported",
        "out: d",
        "2026-11-28",
        "no dark frame",
        "signature",
        "approved",
    ):
        assert words in text


def test_json_has_limits_and_verdicts():
    data = json.loads(json_text(result().to_dict()))
    assert [line["verdict"] for line in data["lines"]] == ["in tolerance", "out", "undecided", "reported"]
    assert data["verdicts"] == {"in tolerance": 1, "out": 1, "undecided": 1, "reported": 1}
    assert data["lines"][2]["limits"] == [2.25, None]
    assert data["faults"] == ["board_03.tif: overexposed"]
