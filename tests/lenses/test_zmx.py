""".zmx files: the lens that is meant, or a refusal that names the line."""

from __future__ import annotations

import re

import numpy as np
import pytest

from roslf_design.cli import main
from roslf_design.design import dumps, load
from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.lens_file import _parse_zmx, load_lens
from roslf_design.lenses.prescription import LensError, first_order

GOOD = """VERS 90910 258 36214
MODE SEQ
NAME AC254-050-A
NOTE 0 catalogue achromat, f = 50
PFIL 0 0 0
UNIT MM X W X CM MR CPMM
ENPD 2.286E+1
ENVD 2.0E+1 1 0
GFAC 0 0
GCAT SCHOTT
RAIM 0 0 1 1 0 0 0 0 0
FTYP 0 0 1 3 0 0 0
XFLN 0 0 0
YFLN 0 0 0
WAVM 1 4.861E-1 1
WAVM 2 5.876E-1 1
WAVM 3 6.563E-1 1
PWAV 2
SURF 0
  TYPE STANDARD
  CURV 0.0 0 0 0 0 ""
  HIDE 0 0 0 0 0 0 0 0 0 0
  MIRR 2 0
  SLAB 1
  DISZ INFINITY
  DIAM 0 0 0 0 1 ""
  POPS 0 0 0 0 0 0 0 0 1 1 1 1 0 0 0 0
SURF 1
  STOP
  TYPE STANDARD
  CURV 2.999400119976E-2 0 0 0 0 ""
  COAT THORA
  COMM front
  DISZ 9
  GLAS N-BAF10 0 0 1.67 4.7E+1 0 0 0 0 0 0
  DIAM 1.27E+1 1 0 0 1 ""
  FLAP 0 1.27E+1 0
SURF 2
  TYPE STANDARD
  CURV -4.488330341113E-2 0 0 0 0 ""
  DISZ 2.5
  GLAS SF10 0 0 1.7 2.8E+1 0 0 0 0 0 0
  DIAM 1.27E+1 1 0 0 1 ""
SURF 3
  TYPE STANDARD
  CURV -3.435245620062E-3 0 0 0 0 ""
  DISZ 43.2
  MAZH 0 0
  DIAM 1.27E+1 1 0 0 1 ""
SURF 4
  TYPE STANDARD
  CURV 0.0 0 0 0 0 ""
  DISZ 0
  DIAM 1.2E-2 0 0 0 1 ""
TOL TOFF 0 0
MNUM 1 1
MOFF 0 1 "" 0 0 0 1 1 0 0.0 "" 0
"""


def test_a_catalogue_file_is_the_lens_that_ships():
    lens, shipped = _parse_zmx(GOOD, "ac.zmx"), load_lens("AC254-050-A")
    assert lens.name == "AC254-050-A"
    assert lens.wavelength == pytest.approx(587.6e-6)
    for ours, theirs in zip(lens.surfaces, shipped.surfaces, strict=True):
        assert ours.curvature == pytest.approx(theirs.curvature, rel=1e-11)
        assert (ours.thickness, ours.glass, ours.semi_diameter) == (theirs.thickness, theirs.glass, 12.7)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings(tmp_path, encoding):
    text = GOOD.replace("catalogue achromat", "Objektiv für Mikroskop, 5 µm")
    path = tmp_path / "lens.zmx"
    for ending in ("\n", "\r\n"):
        path.write_bytes(text.replace("\n", ending).encode(encoding))
        lens = load_lens(path)
        assert (lens.surfaces, lens.source) == (_parse_zmx(GOOD, "").surfaces, "lens.zmx")


@pytest.mark.parametrize(("unit", "scale"), [("MM", 1.0), ("CM", 10.0), ("IN", 25.4), ("METER", 1000.0)])
def test_units(unit, scale):
    text = GOOD.replace("UNIT MM", f"UNIT {unit}").replace(
        "TYPE STANDARD\n  CURV 2", "TYPE EVENASPH\n  PARM 2 1E-7\n  CURV 2"
    )
    lens, plain = _parse_zmx(text, ""), _parse_zmx(GOOD, "")
    for big, small in zip(lens.surfaces, plain.surfaces, strict=True):
        assert big.radius == pytest.approx(scale * small.radius, rel=1e-15)
        assert big.semi_diameter == pytest.approx(scale * small.semi_diameter)
    # the sag of a lens that is scaled up is scaled up
    rise = lens.surfaces[0].sag(10 * scale) - plain.surfaces[0].sag(10.0) * scale
    assert rise == pytest.approx(1e-7 * 10**4 * scale, rel=1e-9)


def test_conic_asphere_clear_aperture_and_stop():
    text = (
        GOOD.replace(
            'CURV -3.435245620062E-3 0 0 0 0 ""', 'CURV -3.4E-3 1 0 0 0 ""\n  CONI -1.5\n  PARM 1 0\n  PARM 3 -2E-9'
        )
        .replace("FLAP 0 1.27E+1 0", "CLAP 0 1.1E+1 0")
        .replace("  STOP\n", "")
    )
    text = text.replace("SURF 3\n  TYPE STANDARD", "SURF 3\n  STOP\n  TYPE EVENASPH")
    lens = _parse_zmx(text, "x.zmx")
    assert lens.surfaces[0].semi_diameter == 11.0
    assert lens.surfaces[2].conic == -1.5
    assert lens.surfaces[2].asphere == (0.0, 0.0, -2e-9)


def spaced(stop):
    """The achromat with a plane in air 5 mm in front, and one behind."""
    dummy = '  TYPE STANDARD\n  CURV 0.0 0 0 0 0 ""\n  DISZ {}\n  DIAM 8 0 0 0 1 ""\n'
    head, *parts = GOOD.split("SURF ")
    parts.insert(1, "1\n" + ("  STOP\n" if stop else "") + dummy.format("5.0"))
    parts[2] = parts[2].replace("  STOP\n", "")
    parts.insert(5, "5\n" + dummy.format("40.0"))
    parts[4] = parts[4].replace("  MAZH 0 0\n", "")
    numbered = [f"{i}\n" + part.split("\n", 1)[1] for i, part in enumerate(parts)]
    return "SURF ".join([head, *numbered])


def test_planes_in_air_are_left_out_unless_they_stop_light():
    assert _parse_zmx(spaced(False), "").surfaces == _parse_zmx(GOOD, "").surfaces
    stopped = _parse_zmx(spaced(True), "a.zmx")
    assert len(stopped.surfaces) == 4
    assert (stopped.surfaces[0].semi_diameter, stopped.surfaces[0].thickness) == (8.0, 5.0)
    assert "clear diameters of surfaces 1 are the file's automatic ones" in stopped.source
    a, b = (first_order(lens, 550e-6).focal_length for lens in (stopped, _parse_zmx(GOOD, "")))
    assert a == pytest.approx(b, rel=1e-14)


PLATE = "  GLAS N-BK7 0 0 1.5 64 0 0 0 0 0 0\n"
HEAD, *PARTS = GOOD.split("SURF ")
UNSTOPPED = PARTS[1].replace("  STOP\n", "")


def plane(thickness, semi=5.0, before="", after=""):
    return f'x\n{before}  TYPE STANDARD\n  CURV 0.0 0 0 0 0 ""\n{after}  DISZ {thickness}\n  DIAM {semi} 0 0 0 1 ""\n'


def surfaces(*parts):
    """A file of these surfaces, numbered."""
    return "SURF ".join([HEAD, *(f"{i}\n" + part.split("\n", 1)[1] for i, part in enumerate(parts))])


def covered(*behind):
    """The achromat with more surfaces from 38 mm behind it to the image."""
    return surfaces(*PARTS[:3], PARTS[3].replace("DISZ 43.2\n  MAZH 0 0", "DISZ 38"), *behind, PARTS[4])


FIELDS = "FTYP 0 0 1 3 0 0 0\nXFLN 0 0 0\nYFLN 0 0 0\n"
AS_IT_IS = {
    "a field on the axis alone": GOOD.replace(FIELDS, "FTYP 0 0 1 1 0 0 0\nXFLN 0\nYFLN 0\n"),
    "no fields": GOOD.replace(FIELDS, ""),
    "vignetting factors": GOOD.replace(FIELDS, FIELDS + "VDXN 0 0 0\nVDYN 0 0.1 0.1\nVCYN 0 0.2 0.4\nVANN 0 0 0\n"),
    "vignetting factors, one a line": GOOD.replace(FIELDS, FIELDS + "FWGT 1\nXFLD 0\nZVDY 0.1\nZVCY 0.3\nZVAN 0\n"),
    "a place to measure from, in front": surfaces(PARTS[0], plane(-6), *PARTS[1:]),
}  # fmt: skip


@pytest.mark.parametrize("variant", AS_IT_IS)
def test_what_a_file_says_of_fields_and_places_is_nothing_of_the_lens(variant):
    assert _parse_zmx(AS_IT_IS[variant], "").surfaces == _parse_zmx(GOOD, "").surfaces


@pytest.mark.parametrize(
    ("encoding", "comment"),
    [("utf-16", "\u524d\u9762"), ("utf-16-le", "\u00d6ffnung"), ("cp1252", "front\u2026 \u2013 \u201cachromat\u201d"),
     ("shift_jis", "\u8868\u9762\u30bd"), ("cp1251", "\u043b\u0438\u043d\u0437\u0430"), ("mac_roman", "\u00d6ffnung"),
     ("utf-8", "front\u2028face\u0085")],
)  # fmt: skip
def test_comments_of_any_code_page_end_no_line(tmp_path, encoding, comment):
    path = tmp_path / "lens.zmx"
    text = GOOD.replace("COMM front", f"COMM {comment}").replace("NOTE 0", f"NOTE 0 {comment}")
    path.write_bytes(text.encode(encoding))
    assert load_lens(path).surfaces == _parse_zmx(GOOD, "").surfaces


def test_a_stop_in_front_and_a_cover_glass_behind_are_read_where_they_stand():
    lens = _parse_zmx(GOOD, "")
    stopped = _parse_zmx(surfaces(PARTS[0], plane(6, 3.0, "  STOP\n"), UNSTOPPED, *PARTS[2:]), "a.zmx")
    assert stopped.surfaces[1:] == lens.surfaces
    assert (stopped.surfaces[0].semi_diameter, stopped.surfaces[0].thickness) == (3.0, 6.0)
    for behind in (3, 0):
        plated = _parse_zmx(covered(plane(0.5, after=PLATE), plane(behind)), "a.zmx")
        assert "surfaces 4 and 5, a plane plate, are counted as the lens's own" in plated.source
        assert plated.surfaces[2].thickness == 38
        assert (plated.surfaces[3].thickness, plated.surfaces[3].glass.name) == (0.5, "N-BK7")
        assert first_order(plated, 550e-6).focal_length == pytest.approx(
            first_order(lens, 550e-6).focal_length, rel=1e-12
        )
    assert "plate" not in lens.source


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            surfaces(PARTS[0], plane(6, 0, "  STOP\n"), UNSTOPPED, *PARTS[2:]),
            "has no clear diameter; give DIAM or CLAP",
        ),
        (surfaces(PARTS[0], plane(-6, 3, "  STOP\n"), UNSTOPPED, *PARTS[2:]), "-6 mm must not be negative; order"),
        (
            covered(plane(0.5, after=PLATE)),
            "ends in N-BK7; .* A cover glass on the image is the design",
        ),
    ],
)
def test_stops_and_cover_glasses_that_cannot_be_are_one_message(text, words):
    with pytest.raises(LensError, match=words) as caught:
        _parse_zmx(text, "a.zmx")
    assert len(caught.value.problems) == 1


def swap(old, new, count=1):
    assert old in GOOD
    return GOOD.replace(old, new, count)


def at(text):
    """Number of the line of the good file that `text` begins on."""
    return f"line {GOOD[: GOOD.index(text)].count(chr(10)) + 1}:"


BROKEN = {
    "cut off within a surface": (GOOD[: GOOD.index("  GLAS SF10")], "cut off"),
    "cut off between surfaces": (GOOD[: GOOD.index("SURF 3")], "ends in N-BAF10; is the file cut off"),
    "cut off in the header": (GOOD[: GOOD.index("UNIT")], "has no UNIT line"),
    "cut off within a line": (
        GOOD[: GOOD.index("2.5\n")],
        f"{at('  DISZ 2.5')} DISZ lacks its number; is the line cut off",
    ),
    "surface missing": (swap("SURF 2", "SURF 3"), f"{at('SURF 2')} SURF 3 where SURF 2 was due"),
    "unknown unit": (swap("UNIT MM", "UNIT FURLONG"), "line 6: UNIT FURLONG is not a lens unit"),
    "coordinate break": (
        swap("TYPE STANDARD\n  CURV -4", "TYPE COORDBRK\n  CURV -4"),
        f"{at(f'  TYPE STANDARD{chr(10)}  CURV -4')} TYPE COORDBRK cannot",
    ),
    "unknown keyword in a surface": (swap("  STOP", "  TLTX 0.1"), "line 29: TLTX is not understood"),
    "unknown keyword in the header": (swap("GFAC 0 0", "ZOOM 3"), "line 9: ZOOM is not understood"),
    "pickup of a thickness": (
        swap("  DISZ 2.5", "  DISZ 2.5\n  PZUP 1 -1 0 0"),
        f"{at('  GLAS SF10')} PZUP is a pickup",
    ),
    "pickup of a curvature": (swap("E-2 0 0 0 0", "E-2 4 1 -1 0"), "line 31: CURV has a solve or pickup"),
    "pickup of a glass": (swap("SF10 0 0", "SF10 2 1"), f"{at('  GLAS SF10')} GLAS SF10 is a pickup"),
    "solve for a thickness": (swap("  DISZ 9", "  DISZ 9\n  MAZH 0 0"), "line 28: the thickness .* is a solve"),
    "unknown glass": (
        swap("GLAS SF10", "GLAS SF99"),
        f"{at('  GLAS SF10')} 'SF99' is not a known glass; the nearest known",
    ),
    "model glass": (
        swap("GLAS SF10 0 0", "GLAS ___BLANK 1 0"),
        f"{at('  GLAS SF10')} GLAS ___BLANK: a model glass is a guess",
    ),
    "mirror": (swap("GLAS SF10", "GLAS MIRROR"), f"{at('  GLAS SF10')} GLAS MIRROR: mirrors cannot be read"),
    "central obstruction": (swap("FLAP 0 1", "CLAP 2 1"), "line 37: CLAP 2 .*: a central obstruction"),
    "comma for a point": (swap("DISZ 2.5", "DISZ 2,5"), f"{at('  DISZ 2.5')} DISZ 2,5: not a number"),
    "not a number": (swap("CURV -4.488330341113E-2", "CURV NAN"), f"{at('  CURV -4')} CURV NAN: not a finite number"),
    "non-ASCII digits": (swap("DISZ 2.5", "DISZ ٢٫٥"), f"{at('  DISZ 2.5')} DISZ ٢٫٥: not a number"),
    "non-ASCII keyword": (swap("  STOP", "  ŠTOP"), "line 29: ŠTOP is not understood"),
    "no clear diameter": (
        swap('  DIAM 1.27E+1 1 0 0 1 ""\nSURF 3', "SURF 3"),
        f"{at('SURF 2')} .* has no clear diameter",
    ),
    "aperture wider than its sphere": (swap("CURV -4.488330341113E-2", "CURV -9E-2"), f"{at('SURF 2')} .*turns back"),
    "no glass left at the rim": (swap("DISZ 9", "DISZ 1"), "line 28: the N-BAF10 is .* the surfaces cross"),
    "immersed object": (swap("  SLAB 1", "  GLAS N-BK7 0 0"), "line 19: the object lies in N-BK7"),
    "coefficients on a sphere": (swap("  DISZ 9", "  DISZ 9\n  PARM 2 1E-5"), "line 28: .*make it EVENASPH"),
    "too many coefficients": (
        swap("  DISZ 9", "  DISZ 9\n  PARM 9 1E-5"),
        f"{at('  GLAS N-BAF10')} PARM 9: an even asphere has terms",
    ),
    "several configurations": (swap("MNUM 1 1", "MNUM 3 1"), "MNUM 3: the file holds 3 configurations"),
    "not sequential": (swap("MODE SEQ", "MODE NSC"), "line 2: MODE NSC: only sequential"),
    "another temperature": (swap("ENVD 2.0E+1 1 0", "ENVD 6.0E+1 1 1"), "line 8: ENVD asks for indices at 6"),
    "negative wavelength": (swap("WAVM 1 4.8", "WAVM 1 -4.8"), "line 15: WAVM -0.4861: a wavelength must be positive"),
    "infinite thickness": (swap("DISZ 2.5", "DISZ INFINITY"), f"{at('SURF 2')} the thickness .* is infinite"),
    "lines of another format": ("LEN NEW\nRDM\n" + "SO 0 1e11\n" * 40, "and 22 more lines that are not understood"),
    "only object and image": (GOOD[: GOOD.index("SURF 2")], "has 2 surfaces"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_files_name_the_line(case, tmp_path):
    text, told = BROKEN[case]
    path = tmp_path / "broken lens.zmx"
    path.write_text(text, "utf-8")
    with pytest.raises(LensError, match=told) as caught:
        load_lens(path)
    for line in str(caught.value).splitlines():
        assert line.startswith(f"{path}: ")
        assert len(line) < 400


@pytest.mark.parametrize("case", ["cut off within a surface", "lines of another format"])
def test_broken_files_end_evaluate_with_one_line_for_each_fault(case, tmp_path, capsys):
    text, told = BROKEN[case]
    (tmp_path / "lens.zmx").write_text(text, "utf-8")
    design = tmp_path / "d.toml"
    design.write_text(dumps(load("paper-singlet")).replace('"LA1050-A"', '"lens.zmx"'), "utf-8")
    assert main(["evaluate", str(design)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.search(told, err.replace("\n", " "))
    for line in err.splitlines():
        assert line.startswith(f"roslf: {design}: main_lens.prescription: {tmp_path / 'lens.zmx'}: ")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "is empty"),
        (b"\x00\x00\x00\x00", "is empty"),
        (b"\xff\xfe" + GOOD.encode("utf-16-le")[:301], "is cut off or damaged utf-16"),
        (b"PK\x03\x04" + bytes(range(256)), "is not text"),
        ("\ufeffMODE".encode("utf-16-be") + b"\xd8", "is cut off or damaged"),
    ],
)
def test_files_that_are_not_text(content, told, tmp_path):
    path = tmp_path / "lens.zmx"
    path.write_bytes(content)
    with pytest.raises(LensError, match=told):
        load_lens(path)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(LensError, match="no such file"):
        load_lens(tmp_path / "none.zmx")
    folder = tmp_path / "folder.zmx"
    folder.mkdir()
    with pytest.raises(LensError, match="is a folder; name the file inside it"):
        load_lens(folder)


def test_same_index_on_both_sides_leaves_no_surface():
    text = swap("CURV 2.999400119976E-2", "CURV 0.0").replace(
        "GLAS N-BAF10 0 0 1.67 4.7E+1 0 0 0 0 0 0\n", "COMM none\n"
    )
    lens = _parse_zmx(text.replace("  STOP\n", ""), "")
    assert [surface.glass for surface in lens.surfaces] == [find_glass("SF10"), find_glass("air")]
    assert np.isfinite(first_order(lens, 550e-6).focal_length)
