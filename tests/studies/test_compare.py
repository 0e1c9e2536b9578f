"""Exported files against rays of our own through their text; other programs where they are installed."""

import json
import math
import re
from itertools import pairwise

import pytest

from studies.compare import compare_study as study
from studies.compare.zmx_rays import Face, trace

ROUNDING = 1e-12
"""Rays of some 300 mm through ten surfaces, in double precision, against 40 digits [mm]."""


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    return study.cases(tmp_path_factory.mktemp("files"))


def test_the_referee_knows_a_sphere_and_an_ideal_lens():
    """Against closed forms: a sphere images its aplanatic point, an ideal lens every point."""
    flat = Face("", "STANDARD", 0.0, 0.0, {}, 5.0, "", 1.0, False)
    index, radius = 1.5, 10.0
    # From R (1 + 1/n) before the vertex inside the glass, concave to it: the image lies at R (1 + n), on the same side.
    behind = flat._replace(curvature=-1 / radius, thickness=3.0)
    row = [flat._replace(thickness=radius * (1 + 1 / index)), behind, flat]
    for slope in (0.05, 0.3, 0.6):
        *_, (_, y1), (_, y2) = trace(row, [index, 1.0, 1.0], (0.0, 0.0), (0.0, slope, 1.0), 0.0)
        z1 = -radius + math.sqrt(radius**2 - float(y1) ** 2)
        met = float(y1) - (z1 + radius * (1 + index)) * float(y2 - y1) / (3.0 - z1)
        assert met == pytest.approx(0.0, abs=1e-13 * radius)
    lens = flat._replace(kind="PARAXIAL", parameters={1: 20.0}, thickness=60.0)
    row = [flat._replace(thickness=30.0), lens, flat]
    for slope in (-0.4, 0.0, 0.7):
        *_, (x, y) = trace(row, [1.0, 1.0, 1.0], (1.0, 2.0), (0.1, slope, 1.0), 0.0)
        assert (float(x), float(y)) == pytest.approx((-2.0, -4.0), abs=1e-14)


def test_rays_through_exported_text_end_where_ours_do(cases):
    assert {case.name for case in cases} == {*study.CAMERAS, *study.LENSES}
    for case in cases:
        names = [face.name for face in case.row]
        for ray, points in zip(case.rays, case.refereed, strict=True):
            for place, ours in ray.met.items():
                assert points[names.index(place)] == pytest.approx(ours, abs=ROUNDING), (case.name, ray.name, place)


def test_both_files_of_a_lens_end_at_its_focus(cases):
    """Two files say the same places; the last is where a ray close to the axis crosses it."""
    for case in cases:
        row, places = case.row, json.loads(case.files[".json"].read_text())["surface_group"]["surfaces"]
        z = [one["geometry"]["cs"]["z"] for one in places]
        gaps = [after - here for here, after in pairwise(z[1:])]
        assert gaps == pytest.approx([face.thickness for face in row[1:-1]], abs=1e-12)
        if case.before:
            *_, (_, height) = trace(row, case.indices, (0.0, 1e-5), (0.0, 0.0, 1.0), case.before)
            assert abs(float(height)) < 1e-13
        else:
            fields = re.search(r"(?m)^YFLN (.*)$", case.files[".zmx"].read_text())[1].split()
            assert row[0].semi_diameter >= max(map(float, fields))


def test_a_program_that_is_not_there_or_errs_is_told(cases, monkeypatch):
    """One is missing, one answers as ours but reads a stop's size wrong, loses a ray, and fails on a file."""
    monkeypatch.setattr(study, "installed", lambda peer: None)
    missing = study.asked(study.PROGRAMS[0], cases, fetch=False)
    assert "not installed" in missing.missing
    first, second, third = cases[:3]
    points = first.refereed
    stop = next(k for k, face in enumerate(first.row) if face.stop)
    told = {
        "surfaces": len(first.row), "stop": stop, "ideal": [2, 3], "stop_size": first.row[stop].semi_diameter,
        "places": [0.0, 0.0, 120.0, 260.0, 262.0],
    }  # fmt: skip
    moved = [[[x + 1e-6 * k, y] for k, (x, y) in enumerate(ray)] for ray in points]
    lost = [ray[:2] for ray in second.refereed]
    answers = study.Answers(study.PROGRAMS[1], (
        {"stated": told, "indices": first.indices, "our_indices": points, "as_read": moved},
        {"stated": told | {"surfaces": 4}, "indices": second.indices, "our_indices": lost, "as_read": lost},
        *({"error": "KeyError: x"} for _ in cases[2:]),
    ), "1.2.3")  # fmt: skip
    all_of = study.Comparison.of(cases, [missing, answers])
    good, short, failed = (all_of.find(case, study.PROGRAMS[1]) for case in (first, second, third))
    assert good.ours.worst < ROUNDING
    at = [face.name for face in first.row].index("microlens")
    assert (good.own.chief, good.own.marginal) == pytest.approx((at * 1e-6, at * 1e-6), rel=1e-6)
    assert good.losses == [
        "the stop's semi-diameter is taken for its diameter: rays that it aims itself fill half of the stop"
    ]
    assert math.isinf(short.ours.worst)
    assert short.losses == [f"4 surfaces of {len(second.row)}"]
    assert failed.losses == ["not read: KeyError: x"]
    page = study.render_html(study.report(all_of))
    for words in ("left out", "lost", "not read", "Nobody ran OpticStudio", study._hash(first.files[".zmx"])):
        assert words in page


@pytest.mark.parametrize("program", study.PROGRAMS[::2], ids=lambda program: program.label)  # these start quickly
def test_a_program_that_is_there(program, cases):
    """The ideal lenses of ray-optics are others than paraxial surfaces: see reports/compare."""
    if study.installed(program.peer) is None:
        pytest.skip("not installed")
    some = [case for case in cases if case.name in ("paper-singlet", "arthroscope", "AC254-050-A")]
    answers = study.asked(program, some, fetch=False)
    assert not answers.missing
    for row in study.Comparison.of(some, [answers]).rows:
        real = row.ours.lens if program.peer is study.RAYOPTICS else row.ours.worst
        assert real < study.BAR, row.case.name
