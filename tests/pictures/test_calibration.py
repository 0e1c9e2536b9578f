"""Pictures of a calibration of synthetic corners: what they show is what was found."""

import re
from dataclasses import replace
from pathlib import Path as FilePath
from types import SimpleNamespace

import numpy as np
import pytest

from roslf_design.calibration import Captures, calibrate
from roslf_design.drawing.marks import Area, Disc, Dots, Line
from roslf_design.drawing.svg import redrawn
from roslf_design.reporting.calibrate.pages import calibration_pictures
from roslf_design.reporting.calibrate.pictures import residuals
from tests.calibration.made import SHEET, captured


@pytest.fixture(scope="module")
def outcome():
    rng = np.random.default_rng(1)
    found = calibrate(captured(Captures(noise=0.05, boards=5), 1), SHEET)
    samples = {name: rng.normal(k + 1.0, 0.1, 4000) for k, name in enumerate(("H", "d_3", "d_2", "A", "m", "f"))}
    distance = np.linspace(200.0, 400.0, 21)
    half = 1e-5 * distance**2
    return SimpleNamespace(
        calibration=found, sheet=SHEET, posterior=None, draws=SimpleNamespace(draws=samples.get), samples=samples,
        depths={"distance": distance, "low_95": -half, "high_95": half, "from_lens": half / 2, "from_pupil": half / 3},
        estimates={"d_3": SimpleNamespace(value=120.0)}, seed=0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def pictures(outcome):
    return calibration_pictures(outcome)


def test_every_picture_is_printed_both_ways_and_always_the_same(outcome, pictures, real_pngs):
    again = calibration_pictures(outcome)
    for name, picture in pictures.items():
        assert picture.svg() == again[name].svg()
        assert "nan" not in picture.svg().lower()
    assert pictures["residuals"].to_png(40).startswith(b"\x89PNG")
    assert "Laplace" in pictures["posterior"].svg()


def test_residuals_and_lines_are_those_of_the_fit(outcome, pictures):
    found = outcome.calibration
    (circle,) = [mark for mark in pictures["residuals"].marks if isinstance(mark, Disc)]
    assert circle.radius == found.joint.rms
    (line,) = [mark for mark in pictures["epi-lines"].panels[0].marks if isinstance(mark, Line) and len(mark.x) > 2]
    np.testing.assert_array_equal(np.sort(line.x), np.sort(1e3 * found.second.inverse_depth))
    rest = next(mark for mark in pictures["epi-lines"].panels[1].marks if isinstance(mark, Dots))
    order = np.argsort(found.second.inverse_depth)
    np.testing.assert_allclose(rest.y, 1e3 * (found.second.slope - found.second.fitted)[order])


def test_residuals_are_drawn_at_random_from_all_views(outcome):
    found = outcome.calibration
    off = np.zeros((4, 50, 20, 2))  # a stride of the whole would meet the same corner in every view
    off[..., 0] = np.arange(50)[:, None]
    off[..., 1] = np.arange(20)
    seen = SimpleNamespace(seen=np.ones(off.shape[:3], bool), names="abcd")
    lines = found.lines._replace(mean=np.zeros((4, 20, 2)), at=np.zeros((4, 20, 2)), slope=np.zeros((4, 20)))
    joint = found.joint._replace(residuals=off)
    many = SimpleNamespace(calibration=replace(found, joint=joint, observations=seen, lines=lines), seed=3)
    dots = next(mark for mark in residuals(many).panels[0].marks if isinstance(mark, Dots))
    assert len(dots.x) == 2000
    assert len(set(dots.x)) == 50
    assert len(set(dots.y)) == 20
    other = SimpleNamespace(calibration=many.calibration, seed=4)
    assert residuals(other).svg() != residuals(many).svg() == residuals(many).svg()


def test_regions_hold_the_shares_of_the_draws_that_they_promise(outcome, pictures):
    from matplotlib.path import Path

    panel = pictures["posterior"].panels[1]  # d_3 over H
    draws = np.stack([outcome.samples["H"], outcome.samples["d_3"]], -1)
    for mark, share in zip([m for m in panel.marks if isinstance(m, Area)], (0.95, 0.68), strict=True):
        corners = np.stack([mark.x, mark.y], -1)
        rings = np.split(corners, np.flatnonzero(np.isnan(corners[:, 0])))
        inside = np.logical_xor.reduce([Path(r[~np.isnan(r[:, 0])]).contains_points(draws) for r in rings])
        # Smoothing widens regions by about a bin; 4000 draws scatter by less than a hundredth.
        assert float(inside.mean()) == pytest.approx(share, abs=0.04)


def test_depth_errors_stand_over_their_distances(outcome, pictures):
    area = next(mark for mark in pictures["depth"].marks if isinstance(mark, Area))
    np.testing.assert_allclose(area.y[:21], outcome.depths["high_95"])


def test_a_picture_from_a_file_is_the_same_when_written_anew(pictures):
    for name, picture in pictures.items():
        text = picture.svg(name=f"calibration-{name}")
        assert redrawn(text, f"calibration-{name}") == text


REPORTS = FilePath(__file__).parents[2] / "reports"


@pytest.mark.skipif(not REPORTS.is_dir(), reason="no kept reports here")
def test_every_picture_of_the_kept_reports_is_the_same_when_written_anew():
    pages = [page.read_text("utf-8") for page in REPORTS.rglob("*.html")]
    texts = [text for page in pages for text in re.findall(r"<svg xmlns.*?</svg>", page, re.DOTALL)]
    assert len(texts) > 20
    for text in texts:
        name = re.search('data-testid="picture-([^"]+)"', text)
        assert name is not None
        assert redrawn(text, name[1]) == text


OPEN = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">'


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        (f"{OPEN}<script>alert(1)</script></svg>", "<script>"),
        (f"{OPEN}<g><foreignObject><p>x</p></foreignObject></g></svg>", "<foreignObject>"),
        (f'{OPEN}<h:script xmlns:h="http://www.w3.org/1999/xhtml">1</h:script></svg>', "xhtml}script"),
        (f'{OPEN}<rect onclick="alert(1)"/></svg>', "onclick"),
        (OPEN.replace(">", ' onload="alert(1)">') + "</svg>", "onload"),
        (f'{OPEN}<image href="https://example.org/a.png"/></svg>', "href"),
        (f'{OPEN}<image href="data:image/svg+xml;base64,PHN2Zz4="/></svg>', "href"),
        (f'{OPEN}<rect fill="url(https://example.org/a)"/></svg>', "fill"),
        (f'{OPEN}<rect fill="u\\72l(//example.org/a)"/></svg>', "fill"),
        (f'{OPEN}<rect style="background:red"/></svg>', "style"),
        (f"{OPEN}<style>p {{ display: none }}</style></svg>", "<style>"),
        (f'{OPEN}<title id="summary">x</title></svg>', "id"),
        (f"{OPEN}<title><![CDATA[<script>alert(1)</script>]]></title></svg>", "declaration"),
        (f"{OPEN}<!-- <script> --></svg>", "declaration"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + OPEN + "&b;</svg>", "declaration"),
        (OPEN + "<g>" * 50 + "</g>" * 50 + "</svg>", "deep"),
        (OPEN, "no SVG"),
        ("<svg/>", "no SVG"),
        ("", "no SVG"),
        ("\0", "no SVG"),
    ],
)
def test_what_no_picture_of_ours_holds_is_refused(text, holds):
    with pytest.raises(ValueError, match=r"holds|is no SVG") as told:
        redrawn(text, "a")
    assert holds in str(told.value)


def test_text_of_a_picture_stays_text():
    text = f"{OPEN}<text>&lt;script&gt;alert(1)&lt;/script&gt;</text></svg>"
    assert redrawn(text, "a") == text
