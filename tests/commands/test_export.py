"""`roslf export`, and glass files in: what is written is read again, by this program and as an axial ray by hand."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from roslf_design import load, loads
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design.files import dumps
from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.lens_file import load_lens, shipped_names
from roslf_design.theory.object_space import ObjectSpaceFaces
from tests.oracles import optiland_rectangles as boxes

WAVE = 550e-6


def axial(rows):
    """Height at each surface of a ray from the axis of the first plane, to first order."""
    height, slope, heights = 0.0, 1e-3, []
    for (curvature, _, index, focal), (*_, before, _) in zip(rows[1:], rows[:-1], strict=True):
        height += slope * rows[len(heights)][1]
        slope = (before * slope - (index - before) * curvature * height) / index
        slope -= 0.0 if focal is None else height / focal
        heights.append(height)
    return heights


@pytest.mark.parametrize("name", ["paper", "paper-singlet", "arthroscope", "cystoscope"])
def test_the_plane_in_focus_meets_the_microlens(name, tmp_path):
    out = tmp_path / "new" / "camera.json"
    assert main(["export", name, "-o", str(out)]) == 0
    data = json.loads(out.read_text())
    surfaces = data["surface_group"]["surfaces"]
    z = [one["geometry"]["cs"]["z"] for one in surfaces]
    rows = [
        (1 / one["geometry"]["radius"], after - here, one["material_post"]["index"],
         one.get("interaction_model", {}).get("focal_length"))
        for one, here, after in zip(surfaces, z, [*z[1:], z[-1]], strict=True)
    ]  # fmt: skip
    names = [one["comment"] for one in surfaces]
    heights = axial(rows)
    assert heights[names.index("microlens") - 1] == pytest.approx(0, abs=1e-9 * max(map(abs, heights)))
    stop = next(one for one in surfaces[1:] if one["is_stop"])
    design = load(name)
    assert stop["aperture"]["r_max"] == design.D_F / 2
    behind = z[names.index("sensor")] - z[names.index("microlens")]
    assert behind == pytest.approx(design.d_2, rel=1e-12)
    # The same in the other file, line by line.
    other = tmp_path / "camera.zmx"
    assert main(["export", name, "-o", str(other)]) == 0
    lines = other.read_text().split("\n")
    gaps = [float(line.split()[1]) for line in lines if line.startswith("  DISZ")]
    assert gaps[:-1] == pytest.approx([thickness for _, thickness, *_ in rows[:-1]], abs=1e-12)
    bends = [float(line.split()[1]) for line in lines if line.startswith("  CURV")]
    assert bends == pytest.approx([curvature for curvature, *_ in rows], abs=1e-15)


def test_rectangles_in_optilands_file_pass_the_rays_that_ours_pass(tmp_path):
    """Openings as Optiland has them, the plane in focus, and 1000 rays that it traced through its file."""
    surfaces = json.loads(boxes.exported(tmp_path, "boxes.json"))["surface_group"]["surfaces"]
    z = [one["geometry"]["cs"]["z"] for one in surfaces]
    by_name = {one["comment"]: one for one in surfaces}
    fap, first, second = (by_name[name]["aperture"] for name in ("FAP", "stop 1", "stop 2"))
    corners = np.array(boxes.DESIGN.aperture.outline.corners)
    assert fap["type"] == "PolygonAperture"
    np.testing.assert_array_equal(np.stack([fap["x"], fap["y"]], -1), corners)
    assert first == {"type": "RectangularAperture", "x_min": -2.5, "x_max": 2.5, "y_min": -2.0, "y_max": 2.0}
    assert second["r_max"] == 15.0
    rows = [
        (0.0, after - here, one["material_post"]["index"], one.get("interaction_model", {}).get("focal_length"))
        for one, here, after in zip(surfaces, z, [*z[1:], z[-1]], strict=True)
    ]
    heights = axial(rows)
    assert heights[list(by_name).index("microlens") - 1] == pytest.approx(0, abs=1e-9 * max(map(abs, heights)))
    traced = np.load(Path(boxes.__file__).with_name("rectangle_rays.npz"))
    found = ObjectSpaceFaces.of(Camera.of(boxes.DESIGN)).rays(tuple(traced["height"]), tuple(traced["slope"]))
    np.testing.assert_array_equal(found.status == 0, traced["passed"])
    assert 100 < traced["passed"].sum() < 900


def test_rectangles_in_a_zmx_file_are_turned_by_breaks_about_them(tmp_path):
    text = boxes.exported(tmp_path, "boxes.zmx")
    surfaces = [
        {line.split()[0]: line.split()[1:] for line in part.splitlines()[1:]} for part in text.split("SURF ")[1:]
    ]
    names = [" ".join(surface["COMM"]) for surface in surfaces]
    before, fap, after = surfaces[1:4]
    assert names[1:4] == ["FAP, turn", "FAP", "FAP, turn back"]
    turn = math.degrees(boxes.DESIGN.aperture.turn)
    assert [float(one["PARM"][1]) for one in (before, after)] == [turn, -turn]
    assert {one["PARM"][0] for one in (before, after)} == {"5"}  # about z
    assert "STOP" in fap
    assert [float(part) for part in fap["SQAP"][:2]] == [1.45, 0.95]
    assert [float(part) for part in surfaces[names.index("stop 1")]["SQAP"][:2]] == [2.5, 2.0]
    assert float(surfaces[names.index("stop 2")]["CLAP"][1]) == 15.0
    gaps = [float(surface["DISZ"][0]) for surface in surfaces]
    places = dict(zip(names, [0.0, *np.cumsum(gaps)], strict=False))
    camera = Camera.of(boxes.DESIGN)
    assert places["main lens"] == pytest.approx(float(camera.ruler.d_f), rel=1e-14)
    for name, distance in (("FAP", 120.0), ("stop 1", 100.0), ("stop 2", 30.0)):
        assert places["main lens"] - places[name] == pytest.approx(distance, rel=1e-13)


def test_lenses_come_back_from_their_zmx(tmp_path):
    for name in (*shipped_names(), "tests/oracles/lens_rays/asphere.toml"):
        out = tmp_path / "lens.zmx"
        assert main(["export", name, "-o", str(out)]) == 0
        lens, again = load_lens(name), load_lens(out)
        for ours, theirs in zip(lens.surfaces, again.surfaces, strict=True):
            for what in ("curvature", "thickness", "conic", "asphere", "semi_diameter"):
                assert getattr(theirs, what) == getattr(ours, what)
            assert theirs.glass.name == ours.glass.name


def test_what_cannot_be_exported_is_told(tmp_path, capsys):
    for arguments, said in (
        (["grin-needle", "-o", str(tmp_path / "a.zmx")], "gradient-index rod"),
        (["paper", "-o", str(tmp_path / "a.txt")], "end it in .zmx or .json"),
        (["nothing", "-o", str(tmp_path / "a.zmx")], "nothing"),
        (["paper", "-o", str(tmp_path)], "end it in"),
    ):
        assert main(["export", *arguments]) == 2
        assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


AGF = """CC made for a test
NM N-BK7 2 517642.251 1.5168 64.17 0 1 0
ED 7.1 8.3 2.51 -0.0009 0
CD 1.03961212E+00 6.00069867E-03 2.31792344E-01 2.00179144E-02 1.01046945E+00 1.03560653E+02 0 0 0 0
TD 1.86E-06 1.31E-08 -1.37E-11 4.34E-07 6.27E-10 0.17 20
LD 0.3 2.5
NM OLD 1 0 1.5168 64.17 0 1 0
CD 2.2718929 -1.0108077e-2 1.0592509e-2 2.0816965e-4 -7.6472538e-6 4.9240991e-7
LD 0.365 1.014
NM CONRADY 5 0 1.5 60 0
CD 1.5 0.01 0.001
LD 0.4 0.7
"""
PAGE = """DATA:
  - type: formula 1
    wavelength_range: 0.3 2.5
    coefficients: 0 1.03961212 0.0774641767 0.231792344 0.141484679 1.01046945 10.1764755
CONDITIONS:
    n_is_absolute: false
SPECS:
    thermal_dispersion:
      - type: "Schott formula"
        coefficients: 1.86e-06 1.31e-08 -1.37e-11 4.34e-07 6.27e-10 0.17
    thermal_expansion:
      - temperature_range: -30 70 °C
        coefficient: 7.1e-06 K<sup>-1</sup>
"""


def test_glasses_out_of_other_catalogues(tmp_path):
    (tmp_path / "schott.agf").write_text(AGF)
    (tmp_path / "page.yml").write_text(PAGE)
    own = find_glass("N-BK7")
    for text in ('{file = "schott.agf", name = "n-bk7"}', '{file = "page.yml"}'):
        design = loads(dumps(load("paper")).replace("[main_lens]", f"[main_lens]\nmaterial = {text}"), "", tmp_path)
        glass = design.main_lens.material
        assert float(glass.index(WAVE)) == pytest.approx(float(own.index(WAVE)), abs=1e-8)
        assert float(glass.index(WAVE, 60.0)) == pytest.approx(float(own.index(WAVE, 60.0)), abs=1e-8)
        assert glass.warming.expansion == 7.1e-6
        assert loads(dumps(design)) == design  # its numbers are in the file then
    lens = tmp_path / "lens.toml"
    lens.write_text(
        '[glasses]\nOLD = {file = "schott.agf"}\n[[surfaces]]\nradius = "50 mm"\nthickness = "5 mm"\nglass = "OLD"\n'
        'diameter = "20 mm"\n[[surfaces]]\nradius = "inf"\ndiameter = "20 mm"\n'
    )
    assert float(load_lens(lens).surfaces[0].glass.index(WAVE)) == float(find_glass("BK7").index(WAVE))
    assert math.isclose(load_lens(lens).surfaces[0].radius, 50)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{file = "schott.agf", name = "N-BK8"}', "did you mean 'N-BK7'?"),
        ('{file = "schott.agf", name = "CONRADY"}', "dispersion formula 5"),
        ('{file = "none.agf", name = "X"}', "none.agf"),
        ('{file = "notes.txt", name = "X"}', "neither a .agf catalogue nor a .yml page"),
        ('{file = 3}', "must be text, got 3"),
    ],
)  # fmt: skip
def test_glass_files_that_cannot_be_used(text, message, tmp_path):
    (tmp_path / "schott.agf").write_text(AGF)
    (tmp_path / "notes.txt").write_text("no glass")
    changed = dumps(load("paper")).replace("[main_lens]", f"[main_lens]\nmaterial = {text}")
    with pytest.raises(ValueError, match=r"main_lens\.material") as error:
        loads(changed, "", tmp_path)
    assert message in str(error.value)
