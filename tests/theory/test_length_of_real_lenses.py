"""Length of a camera behind a real lens: beside the thicknesses of the surfaces that it is exported as."""

import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.design import Design, dumps
from roslf_design.theory.quantities import QUANTITIES


def length_of(design: Design) -> float:
    return float(QUANTITIES["total_length_mm"](Camera.of(design)))


def as_exported(design: Design, folder) -> float:
    """First surface behind the object to the sensor: what a lens designer's program has between them."""
    (folder / "lens.toml").write_text(dumps(design))
    assert main(["export", str(folder / "lens.toml"), "-o", str(folder / "lens.zmx")]) == 0
    read = (folder / "lens.zmx").read_text().split("\nSURF ")[2:]
    return sum(abs(float(line.split()[1])) for one in read for line in one.splitlines() if "DISZ" in line)


SCANNER = """
name = "Scanner"
[main_lens]
part = "AC050-008-A"
focal_plane = "25.3 mm"
[aperture]
diameter = "1.73 mm"
distance = "1 mm"
[[elements]]
kind = "mirror"
distance = "6.4 mm"
angle = "45 deg"
diameter = "8 mm"
[[elements]]
kind = "plate"
distance = "9.3 mm"
part = "sapphire 6 x 1 mm"
diameter = "6 mm"
[microlens_array]
pitch = "30 um"
focal_length = "92.5 um"
size = ["5.4 mm", "4.1 mm"]
[sensor]
part = "IMX335"
distance = "92.5 um"
[tube]
outer_diameter = "10 mm"
wall = "0.5 mm"
[environment]
temperature = "37 degC"
housing = "stainless steel"
"""


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("which", ["paper-singlet", "scanner", "scanner, cold", "scanner, warmed"])
def test_length_is_that_of_the_surfaces_that_are_exported(which, turned, tmp_path):
    """1e-9: digits of the file; the length is that at 20 degrees C, whatever the camera is used at."""
    design = roslf.load(which) if which == "paper-singlet" else roslf.loads(SCANNER)
    if "cold" in which:
        design = roslf.loads(SCANNER.replace("37 degC", "20 degC"))
    design = design.replace({"main_lens.reversed": turned})
    if "warmed" in which:
        design = design.at_temperature(10.0)
    assert length_of(design) == pytest.approx(as_exported(design.at_room, tmp_path), rel=1e-9)
    thin = design.main_lens.kind.thin_twin(design).at_room
    assert length_of(thin) == pytest.approx(float(Camera.of(thin).tip) + thin.d_1 + thin.d_2, rel=1e-12)


def test_builds_at_a_temperature_and_of_another_lens_have_their_own_length():
    """Numbers of many builds against the design itself, warmed: the same law, 1e-7 for the housing's own terms."""
    design = roslf.loads(SCANNER)
    moved = Camera.of(design).replace({"environment.temperature": [10.0, 37.0]})
    told = QUANTITIES["total_length_mm"](moved)
    assert told.tolist() == pytest.approx([length_of(design.at_temperature(at)) for at in (10.0, 37.0)], rel=1e-7)
