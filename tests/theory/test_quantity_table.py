"""Tables of quantities: what notebooks, files and pandas get of a sweep."""

import csv
import io
import sys
from itertools import product

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.errors import refusal
from roslf_design.optimization import Constraint, Goal
from roslf_design.theory.quantity_table import MOST_ROWS
from tests.optimization.posing import posed

GRID = {"d_3": [0.0, 120.0], "aperture.diameter": [1.0, 2.0, 3.0]}


@pytest.fixture(scope="module")
def swept():
    return roslf.sweep("paper", GRID, ["fill_factor", "d_1"])


def test_a_row_a_point_and_units_where_names_do_not_state_them(swept):
    heads, *rows = csv.reader(io.StringIO(swept.table.csv().decode()))
    assert heads == ["d_3 [mm]", "aperture.diameter [mm]", "fill_factor", "d_1 [mm]"]
    assert [tuple(map(float, row[:2])) for row in rows] == [(d_3, D_F) for d_3 in (0, 120) for D_F in (1, 2, 3)]
    fill = roslf.quantity("fill_factor")
    for row in rows:
        design = roslf.load("paper").replace(d_3=float(row[0]), D_F=float(row[1]))
        assert float(row[2]) == pytest.approx(float(fill(roslf.Camera.of(design))), rel=1e-14)


def test_a_file_is_not_written_over_unless_asked(swept, tmp_path):
    path = tmp_path / "sweep.csv"
    swept.to_csv(path)
    first = path.read_bytes()
    assert first == swept.table.csv()
    other = roslf.sweep("paper", {"d_3": [1.0]}, ["fill_factor"])
    assert str(other).split() == ["d_3", "[mm]", "fill_factor", "1", f"{other.values['fill_factor'][0]:.5g}"]
    with pytest.raises(FileExistsError, match="overwrite=True"):
        other.to_csv(path)
    assert path.read_bytes() == first
    other.to_csv(path, overwrite=True)
    assert path.read_bytes() == other.table.csv()
    assert [one.name for one in tmp_path.iterdir()] == ["sweep.csv"]


def test_what_rays_tell_is_traced_behind_a_real_lens_and_the_rest_marked(monkeypatch, without_views):
    """A field of view by sweep was the thin lens's beside the one that `evaluate` traces."""
    names = ["field_of_view_deg", "mtf50_lp_per_mm", "sigma_z_mm", "working_distance_mm"]
    grid = {"d_3": [100.0, 120.0], "D_F": [2.0, 3.0]}
    shares = []
    swept = roslf.sweep(
        "paper-singlet", grid, names, at=300.0, progress=lambda what, done, total: shares.append(done / total)
    )
    assert shares == sorted(shares)
    assert len(names) < len(shares)
    assert (shares[0], shares[-1]) == (0, 1)
    for (i, d_3), (j, d_f) in product(enumerate(grid["d_3"]), enumerate(grid["D_F"])):
        sheet = roslf.specification(roslf.load("paper-singlet").replace(d_3=d_3, D_F=d_f), 300.0)
        assert swept.values["field_of_view_deg"][i, j] == sheet.field_of_view_deg[0].diagonal
        assert swept.values["mtf50_lp_per_mm"][i, j] in [one.mtf50_lp_per_mm for one in sheet.resolution]
    told = "thin-lens model, not of rays through LA1050-A reversed: sigma_z_mm; `roslf evaluate` traces"
    assert told in str(swept)
    assert "not of rays through LA1050-A" in swept._repr_html_()
    assert swept.to_pandas().attrs["note"] == swept.note
    monkeypatch.setattr("roslf_design.evaluation.sweep.MOST_TRACED", 3)
    coarse = roslf.sweep("paper-singlet", grid, names, at=300.0)
    assert "field_of_view_deg, mtf50_lp_per_mm and sigma_z_mm; `roslf evaluate` traces" in coarse.note
    assert coarse.note.endswith("a sweep of up to 3 points, too)")
    assert coarse.values["field_of_view_deg"][0, 0] != swept.values["field_of_view_deg"][0, 0]
    apart = roslf.sweep("paper-singlet", {"f": [99.0, 101.0]}, names)  # which are other lenses
    assert all(np.isnan(values).all() for values in apart.values.values())
    assert not apart.valid.any()
    assert "contradicts the prescription" in apart.refused(roslf.load("paper-singlet"))[0]
    many = roslf.evaluate_many(["paper", "paper-singlet"], names[:2])
    assert many.columns[names[0]][1] == roslf.specification("paper-singlet").field_of_view_deg[0].diagonal
    assert not many.note
    monkeypatch.setattr("roslf_design.evaluation.many.MOST_TRACED", 0)
    assert "of up to 0 designs, too)" in roslf.evaluate_many(["paper-singlet"], names[:2]).note
    assert not roslf.sweep("paper-singlet", {"d_3": [100.0]}, ["working_distance_mm"]).note
    assert not roslf.sweep("paper", {"d_3": [100.0]}, ["sigma_z_mm"]).note


def test_a_lens_whose_rays_fail_ends_no_sweep_and_no_table(monkeypatch):
    def lost(shown, *_):
        if shown.design.d_3 > 110:
            raise refusal("aperture.distance", "no ray comes through")
        return 1.0

    monkeypatch.setattr("roslf_design.evaluation.field_images.FieldImages.half_field", lost)
    swept = roslf.sweep("paper-singlet", {"d_3": [100.0, 120.0]}, ["field_half_width_mm"])
    assert swept.valid.tolist() == [True, False]
    assert "at d_3 = 120 mm: aperture.distance: no ray" in swept.refused(roslf.load("paper-singlet"))[0]
    far = roslf.load("paper-singlet").replace(d_3=120.0)
    table = roslf.evaluate_many({"far": far, "ideal": "paper"}, ["field_half_width_mm"])
    assert np.isnan(table.columns["field_half_width_mm"]).tolist() == [True, False]
    assert table.note == "far without what rays tell: aperture.distance: no ray comes through"
    posed_at = posed(
        {"d_3": (120, 130)},
        [Constraint(quantity="field_half_width_mm", min=1.0)],
        Goal(quantity="sigma_z_mm", direction="min"),
        design=far,
    )
    assert posed_at.told_by_rays(np.zeros(1)) == (posed_at, 0.0)


def test_html_has_every_number_and_no_markup_of_a_name():
    swept = roslf.sweep("paper", {"d_3": [0.0, 120.0]}, ["fill_factor"])
    page = swept._repr_html_()
    assert page.count("<tr>") == 3
    assert "<th>d_3 [mm]</th><th>fill_factor</th>" in page
    assert "1.0051" in page
    shown = roslf.evaluate_many({"<b>": "paper"}, ["fill_factor"])._repr_html_()
    assert "&lt;b&gt;" in shown
    assert "<b>" not in shown


def test_the_middle_of_a_long_table_is_left_out_on_the_screen_alone():
    swept = roslf.sweep("paper", {"d_3": np.linspace(0, 150, 1000)}, ["fill_factor"])
    assert len(swept.table) == 1000
    assert swept._repr_html_().count("<tr>") == MOST_ROWS + 2  # a heading, and a row of dots
    assert swept.table.csv().count(b"\n") == 1001


def test_what_has_no_camera_is_empty():
    swept = roslf.sweep("paper", {"d_3": [120.0, 500.0], "d_f": [350.0]}, ["fill_factor"])
    assert not swept.valid[1, 0]
    assert swept.table.csv().decode().splitlines()[2] == "500.0,350.0,"
    assert "nan" not in swept._repr_html_()


def test_pandas_gets_the_columns_with_their_units(swept):
    pandas = pytest.importorskip("pandas")
    frame = swept.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == ["d_3", "aperture.diameter", "fill_factor", "d_1"]
    assert frame.attrs["units"]["d_3"] == "mm"
    np.testing.assert_array_equal(frame["fill_factor"], swept.values["fill_factor"].ravel())
    frame.loc[0, "fill_factor"] = 0.0  # is its own
    assert swept.values["fill_factor"][0, 0] > 0


def test_without_pandas_it_says_what_to_install(swept, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install pandas.*to_csv") as caught:
        swept.to_pandas()
    assert "\n" not in str(caught.value)
