"""The gallery: every row of its tables on its page, its numbers against their sources, and faulty tables."""

import json
import math
import re
import shutil
import subprocess
import sys
from html import unescape

import numpy as np
import pytest

from roslf_design.errors import InputError
from studies.instruments import gallery
from studies.instruments.entries import CLOSE, HERE, SUFFIX, Instrument, Pictures

BENCH = """
instrument = "Bench"
design = "paper"
[given]
views = 13
"""
NUMBER = """
[[number]]
figure = "distance to the array"
subject = "lengths"
unit = "mm"
published = 140
source = "the paper"
predict = "d_1"
"""


@pytest.fixture(scope="module")
def instruments():
    return Instrument.all()


@pytest.fixture(scope="module")
def rows(instruments):
    return [row for one in instruments for row in one.rows(Pictures.written())]


def named(rows, instrument, figure):
    return next(row for row in rows if row.instrument.startswith(instrument) and figure in row.figure)


def bench(folder, numbers):
    path = folder / f"bench{SUFFIX}"
    path.write_text(BENCH + numbers)
    return path


def test_the_gallery_has_many_numbers_and_those_that_differ_say_why(instruments, rows):
    assert len(instruments) >= 10
    assert len(rows) >= 40
    for row in rows:
        assert row.source
        assert row.ratio is not None or row.why
        assert row.ratio is None or abs(row.ratio - 1) <= CLOSE or row.why, row


def test_every_design_has_its_table(instruments):
    designs = {path.stem for path in HERE.glob("*.toml") if not path.name.endswith(SUFFIX)}
    assert designs <= {one.name for one in instruments}


def test_distances_meet_those_of_another_estimator(rows):
    # Focused at 1000 km in place of infinity; four decimals are given.
    assert named(rows, "Hahne", "over a baseline").ratio == pytest.approx(1, abs=1e-5)
    assert named(rows, "Hahne", "plane refocused to").predicted == pytest.approx(962.7459, abs=1e-4)
    assert named(rows, "Hahne", "six pixels").predicted == pytest.approx(3.7956, abs=5e-5)


def test_published_disparities_are_those_of_the_calibration(rows, shared_data):
    """A ray (i, k) of H meets (x, 0) at Z where x = H11 i + H13 k + Z (H31 i + H33 k): dk/di of a point that stays."""
    H = np.array(json.loads((shared_data / "lytro-checkerboard" / "CalInfo.json").read_text())["EstCamIntrinsicsH"])
    for row, ahead in zip((row for row in rows if row.unit == "pitches/px"), (0.16, 0.5), strict=True):
        own = []
        for k in (0, 1):
            s, u = H[k], H[k + 2]
            z = ahead - s[k + 2] / u[k + 2]  # from the pupil, where all samples of one view meet
            own.append(-(s[k] + z * u[k]) / (s[k + 2] + z * u[k + 2]) * math.sqrt(3) / 2)
        assert row.published == pytest.approx(own, abs=1e-3)


def test_the_multi_focus_array_is_as_rays_through_its_lengths_have_it(rows):
    """Kinds of microlenses by hand: where the sensor's image lies, and the rims' rays of pupil and microlens."""
    F, D, d_1, d_2, d, q = 49.885286, 12.471321, 56.859967, 0.3371257, 0.12745, 0.0055
    planes = [row for row in rows if row.instrument == "Raytrix R12" and "plane in focus" in row.figure]
    widths = [row for row in rows if row.instrument == "Raytrix R12" and "white image" in row.figure]
    assert len(planes) == len(widths) == 3
    for f_ml, plane, width in zip((0.58267, 0.524025, 0.560574), planes, widths, strict=True):
        image = d_1 + 1 / (1 / d_2 - 1 / f_ml)  # behind the array, as f_ml > d_2
        assert plane.predicted == pytest.approx(1 / (1 / F - 1 / image), rel=1e-9)
        edge = d / 2 + d_2 * ((d / 2 + D / 2) / d_1 - d / 2 / f_ml)  # of the ray from the opposite rim
        assert width.predicted == pytest.approx(2 * edge / q, rel=1e-9)
        assert width.ratio == pytest.approx(1, abs=2e-3)


def test_the_vesicles_white_frame_is_measured_and_predicted(rows):
    """Diffraction's width lambda d_2/d, and an aperture of 1.2 that fills the cells; real images are narrower."""
    width, blur, veil = (row for row in rows if row.measured.startswith("vesicle"))
    assert width.predicted == pytest.approx(1, abs=1e-6)
    # Laws of how dark the pupil's rim is leave its width open by 3 % (GUV's: 6.97 to 7.40 mm); blur takes the rest.
    assert width.published[0] == pytest.approx(0.885, rel=0.03)
    assert blur.predicted == pytest.approx(0.593e-3 * 2.5 / 0.1 / 6.5e-3, rel=1e-9)
    # 2.28 px of 3.0 to 3.3, once the pupil's darker rim is fitted as well: of an evenly lit one 3.68 had been blur.
    assert 0.65 < blur.ratio < 0.79
    assert 0 < veil.published[0] < 4
    assert veil.ratio is None


def test_predictions_are_what_the_expressions_say(tmp_path):
    """Closed forms of the paper's bench, by hand: f 100, d_f 350, D_F 2.9, d_3 120 or 20, d 0.063, d_2 2 mm."""
    cases = {
        "d_1": 140.0, "2 * f_number_microlens": 2 * 2 / 0.063, "-(d_1 - f) ** 2": -1600.0, "views / 2": 6.5,
        "sqrt(d_1 * d_f)": math.sqrt(140 * 350), "object_sample_mm(230)": 0.063 / 0.4,
        "evaluate.f_number.pupil": 140 * (350 - 120) / 350 / 2.9,
    }  # fmt: skip
    numbers = "".join(NUMBER.replace('"d_1"', f'"{text}"') for text in cases)
    mismatched = NUMBER.replace('"d_1"', '"f_number_pupil"') + "set = { d_3 = 20.0 }\n"
    rows = list(Instrument.read(bench(tmp_path, numbers + mismatched)).rows(None))
    assert [row.predicted for row in rows[:-1]] == pytest.approx(list(cases.values()))
    assert rows[-1].predicted == pytest.approx(140 * (350 - 20) / 350 / 2.9)
    assert rows[0].ratio == pytest.approx(1)


def test_two_instruments_make_a_page_with_every_row(tmp_path):
    for name in ("hahne-f193.toml", f"hahne-f193{SUFFIX}", f"bedard-2017{SUFFIX}"):
        shutil.copy(HERE / name, tmp_path)
    rows = gallery.write(tmp_path, tmp_path / "out")
    text = unescape(re.sub("<[^>]+>", " ", (tmp_path / "out" / "index.html").read_text()))
    page = " ".join(text.replace("\u200b", "").split())
    written = json.loads((tmp_path / "out" / "instruments.json").read_text())["rows"]
    tables = [path.read_text() for path in tmp_path.glob(f"*{SUFFIX}")]
    assert len(rows) == len(written) == sum(text.count("[[number]]") for text in tables)
    for row in rows:
        assert row.figure in page
        assert row.source in page
        assert row.why in page
    assert "962.7459" in page
    assert "0.21 to 0.44" in page


@pytest.mark.parametrize(
    ("numbers", "messages"),
    [
        (NUMBER.replace("140", '"140"').replace('"lengths"', '"length"'), ("number.0.published", "number.0.subject")),
        (NUMBER.replace("d_1", "d1"), ("number.0.predict: 'd1' is no quantity; did you mean 'd_1'?",)),
        (NUMBER.replace("d_1", "d_1 +"), ("number.0.predict", "is no expression; write one such as")),
        (NUMBER.replace("d_1", "evaluate.f_number.pupl"), ("number.0.predict: 'pupl' is no number of that name",)),
        (NUMBER.replace("d_1", "evaluate.focused.in_focus[0].ahead_mm"), ("'focused' is no number of that name",)),
        (NUMBER.replace("d_1", "scene_disparity"), ("number.0.predict: 'scene_disparity' is no quantity",)),
        (NUMBER.replace("d_1", "__import__('os')"), ("number.0.predict",)),
        (NUMBER.replace('predict = "d_1"', ""), ("number.0.why: is missing; say why nothing is predicted",)),
        (NUMBER.replace("published = 140", ""), ("number.0: must have either `published`",)),
        (NUMBER.replace("source", "sauce"), ("number.0.source: is missing", "number.0.sauce: is not a known key")),
        ("", ("number: is missing",)),
    ],
)
def test_a_faulty_table_gets_one_clear_message(tmp_path, numbers, messages):
    path = bench(tmp_path, numbers)
    with pytest.raises(InputError) as refused:
        gallery.write(tmp_path, tmp_path / "out")
    for message in messages:
        assert message in str(refused.value)
    assert all(line.startswith(f"{path}: ") for line in str(refused.value).splitlines())
    assert not (tmp_path / "out").exists()


def test_the_script_ends_with_2_and_no_traceback(tmp_path, root):
    bench(tmp_path, NUMBER.replace("d_1", "d1"))
    command = [sys.executable, "studies/instruments/gallery.py", "--folder", tmp_path, "-o", tmp_path / "out"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "number.0.predict" in done.stderr
