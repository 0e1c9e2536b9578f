"""Many designs in one table are what each is alone."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.design import preset_names

QUANTITIES = ("field_of_view_width_deg", "fill_factor", "u_z_mm", "non_distortion_room_mm", "d_1")


def alone(design, name):
    if name == "field_of_view_width_deg" and design.lens is not None:
        return roslf.specification(design).field_of_view_deg[0].width
    return float(roslf.quantity(name)(roslf.Camera.of(design)))


def test_every_preset_has_the_numbers_that_it_has_alone(without_views):
    table = roslf.evaluate_many(preset_names(), QUANTITIES)
    assert table.columns["design"].tolist() == list(preset_names())
    for row, preset in enumerate(preset_names()):
        for name in QUANTITIES:
            expected = pytest.approx(alone(roslf.load(preset), name), rel=1e-9, abs=1e-12)
            assert table.columns[name][row] == expected, (preset, name)
    assert table.units["fill_factor"] == ""
    assert table.units["d_1"] == "mm"


@pytest.mark.parametrize("preset", ["paper", "cystoscope", "paper-singlet"])
def test_designs_alike_and_unlike_in_any_order(preset, without_views):
    base = roslf.load(preset)
    designs = {f"{part:g}": base.replace(D_F=part * base.D_F) for part in (0.9, 1.0, 0.8)}
    designs["other"] = roslf.load("rigid-scope")
    designs["coarse"] = base.replace(d=1.1 * base.d)
    table = roslf.evaluate_many(designs, QUANTITIES)
    assert table.columns["design"].tolist() == list(designs)
    for row, design in enumerate(designs.values()):
        for name in QUANTITIES:
            assert table.columns[name][row] == pytest.approx(alone(design, name), rel=1e-9), name


def test_rows_are_named_as_they_were_asked_for(tmp_path):
    roslf.save(roslf.load("paper"), tmp_path / "mine.toml")
    table = roslf.evaluate_many(["paper", tmp_path / "mine.toml", roslf.load("paper")], ["fill_factor"])
    assert table.columns["design"].tolist() == ["paper", str(tmp_path / "mine.toml"), roslf.load("paper").name]
    assert len(set(table.columns["fill_factor"])) == 1


def test_views_of_focused_microlenses_have_no_number(root):
    bench = roslf.load("paper")
    focused = roslf.load(root / "studies/instruments/raytrix-r12.toml")
    assert roslf.evaluate(focused).focused is not None
    table = roslf.evaluate_many({"views": bench, "focused": focused}, ["fill_factor", "u_z_mm"])
    assert np.isfinite(table.columns["fill_factor"]).all()
    assert np.isnan(table.columns["u_z_mm"]).tolist() == [False, True]


def test_at_a_distance_and_at_a_temperature():
    warm = roslf.load("cystoscope").at_temperature(37.0)
    for temperature in (37, 37.0, "37 degC"):
        assert roslf.evaluate("cystoscope", temperature=temperature) == roslf.evaluate(warm)
        table = roslf.evaluate_many(["cystoscope"], ["fill_factor", "u_z_mm"], at=10.0, temperature=temperature)
        assert table.columns["fill_factor"][0] == pytest.approx(roslf.evaluate(warm).f_number.fill_factor, rel=1e-12)
        (ahead,) = (one for one in roslf.evaluate(warm, at=[10.0]).answer.at if one.at_mm == 10.0)
        assert 2 * table.columns["u_z_mm"][0] == pytest.approx(ahead.expanded_mm, rel=1e-6)
    assert roslf.evaluate("cystoscope", temperature=37) != roslf.evaluate("cystoscope")
    with pytest.raises(roslf.DesignError, match="at most 150"):
        roslf.evaluate("cystoscope", temperature=500)


def test_no_camera_is_swept_beyond_the_temperatures_that_one_may_have():
    warm = roslf.load("video-otoscope").replace({"environment": {"housing": "stainless steel", "range": (0.0, 40.0)}})
    for place in ("environment.temperature", "environment.range.1"):
        swept = roslf.sweep(warm, {place: [-400.0, 20.0, 600.0]}, ["fill_factor"])
        assert swept.valid.tolist() == [False, True, False]
        assert np.isnan(swept.values["fill_factor"]).tolist() == [True, False, True]
        assert "150" in " ".join(swept.refused(warm))


def test_a_row_says_why_it_has_no_value(root):
    bench = roslf.load("paper")
    swapped = bench.replace({"microlens_array.focal_length": 3.0 * bench.f_ml})  # and d_2 left as it is
    table = roslf.evaluate_many({"own": bench, "swapped": swapped}, ["fill_factor", "u_z_mm"])
    assert list(table.reasons) == ["swapped"]
    assert "pixels are no views and there is no u_z_mm" in table.reasons["swapped"]
    assert "or set sensor.distance (d_2)" in str(table)
    assert table.to_pandas().attrs["reasons"] == table.reasons
    assert not roslf.evaluate_many({"swapped": swapped}, ["fill_factor"]).reasons
    lit = roslf.load("rigid-scope").replace({"light": {"illuminance": 1e9, "exposure": 0.01}})
    (why,) = roslf.evaluate_many({"lit": lit}, ["u_z_mm"]).reasons.values()
    assert why == "u_z_mm infinite: pixels are full"


def test_windows_of_unlike_size_on_the_object_are_named():
    own = roslf.load("rigid-scope")
    coarse = own.replace({"microlens_array.pitch": 1.5 * own.d, "aperture.diameter": 1.5 * own.D_F})
    table = roslf.evaluate_many({"own": own, "coarse": coarse}, ["u_z_mm", "depth_window_mm"], at=20.0)
    # As many footprints of a microlens across, each half the period of the finest detail that it samples.
    for design, window in zip((own, coarse), table.columns["depth_window_mm"], strict=True):
        finest = float(roslf.quantity("fold_lp_per_mm")(roslf.Camera.of(design), at=20.0))
        assert window == pytest.approx(design.depth.window / (2 * finest), rel=1e-12)
    assert "from windows of unlike size" in table.note
    assert not roslf.evaluate_many({"own": own, "same": own}, ["u_z_mm"]).note
    assert not roslf.evaluate_many({"own": own, "coarse": coarse}, ["fill_factor"]).note
    swept = roslf.sweep(own, {"d": [own.d, 1.5 * own.d]}, ["sigma_z_mm"])
    assert "sigma_z_mm from windows of unlike size" in swept.note
    assert not roslf.sweep(own, {"D_F": [own.D_F, 0.9 * own.D_F]}, ["sigma_z_mm"]).note
