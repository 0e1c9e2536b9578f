import json
import os

import numpy as np
import pytest
from PIL import Image

from roslf_design.calibration.frames import read_image
from roslf_design.cli import main
from roslf_design.design import load
from roslf_design.errors import InputError
from roslf_design.imaging.files import write_image
from roslf_design.imaging.render import RawImage, render
from roslf_design.scenes import PictureTexture, Plane, Scene

tifffile = pytest.importorskip("tifffile")

PAPER = load("paper")
PIECE = (100, 200, 40, 30)
BOARD = """
name = "board"
[light]
exposure = 2000
[[objects]]
kind = "plane"
texture = { kind = "checkerboard", period = "3 mm" }
"""


@pytest.fixture(scope="module")
def image():
    return render(PAPER, region=PIECE)


def test_float_tiff_keeps_every_bit_and_says_how_it_was_made(image, tmp_path):
    beside = write_image(image, tmp_path / "raw.tif")
    with tifffile.TiffFile(tmp_path / "raw.tif") as file:
        np.testing.assert_array_equal(file.asarray(), image.pixels)
        inside = json.loads(file.pages[0].description)
    assert inside == json.loads(beside.read_text())
    assert inside["schema"] == "roslf.render/1"
    assert inside["region"] == {"column": 100, "row": 200, "columns": 40, "rows": 30}
    assert [line["name"] for line in inside["effects"]] == [line.name for line in image.plan]
    assert inside["design"]["name"] == PAPER.name


@pytest.mark.parametrize("depth", ["float", "16"])
@pytest.mark.parametrize("told", [{"glasses": {"shape": [3, 4]}}, {"shape": "square"}, {"name": '"shape":'}])
def test_a_tiff_whose_description_speaks_of_a_shape_is_read_by_others(image, tmp_path, monkeypatch, told, depth):
    monkeypatch.setattr(RawImage, "metadata", lambda _: dict(told))
    beside = write_image(image, tmp_path / "raw.tif", depth)
    assert tifffile.imread(tmp_path / "raw.tif").shape == image.pixels.shape
    assert read_image(tmp_path / "raw.tif").shape == image.pixels.shape
    with tifffile.TiffFile(tmp_path / "raw.tif") as file:
        assert json.loads(file.pages[0].description) == json.loads(beside.read_text())


@pytest.mark.parametrize("name", ["raw.tif", "raw.png"])
def test_sixteen_bits(image, tmp_path, name):
    beside = write_image(image, tmp_path / name, "16")
    if name.endswith("png"):
        with Image.open(tmp_path / name) as file:
            values, inside = np.asarray(file), json.loads(file.text["Description"])
    else:
        values, inside = tifffile.imread(tmp_path / name), {}
    scale = json.loads(beside.read_text())["full_scale"]
    assert values.dtype == np.uint16
    np.testing.assert_allclose(values / 65535 * scale, image.pixels, atol=scale / 65535)
    assert inside.get("full_scale", scale) == scale


def test_folders_of_pictures_are_not_told(tmp_path):
    Image.fromarray(np.full((4, 4), 128, np.uint8)).save(tmp_path / "grey.png")
    scene = Scene(objects=(Plane(texture=PictureTexture(file=str(tmp_path / "grey.png"), width=5.0)),))
    beside = write_image(render(PAPER, scene, region=(0, 0, 4, 4)), tmp_path / "raw.tif")
    assert str(tmp_path) not in beside.read_text()
    assert "grey.png" in beside.read_text()


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("raw.jpg", "end in .tif"),
        ("file/deep/raw.tif", "/file is a file, not a folder"),
        ("folder.tif", "is a folder"),
    ],
)
def test_places_that_cannot_be_written(image, tmp_path, name, part):
    (tmp_path / "folder.tif").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=part):
        write_image(image, tmp_path / name)


def test_folders_are_made(image, tmp_path):
    assert write_image(image, tmp_path / "out" / "today" / "raw.tif").parent == tmp_path / "out" / "today"
    assert (tmp_path / "out" / "today" / "raw.tif").is_file()


def test_full_disk_leaves_nothing_behind(image, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        write_image(image, tmp_path / "raw.tif")
    assert list(tmp_path.iterdir()) == []


def test_command_writes_image_json_and_preview(tmp_path, capsys, real_pngs):
    (tmp_path / "board.toml").write_text(BOARD)
    common = ["render", "paper", "--scene", str(tmp_path / "board.toml"), "--region", "2000,1500,24,16", "--seed", "4"]
    assert main([*common, "-o", str(tmp_path / "a.tif"), "--preview", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["method"] == "rays"
    assert main([*common, "-o", str(tmp_path / "b.tif")]) == 0
    assert "finite_microlens_aperture" in capsys.readouterr().out
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()
    assert (tmp_path / "a.json").exists()
    said = f"roslf: {tmp_path / 'b.tif'} was there and is written over"
    for seed, told_so in (("4", False), ("5", True)):  # the same image again, then another one
        assert main([*common[:-1], seed, "-o", str(tmp_path / "b.tif")]) == 0
        assert (said in capsys.readouterr().err) == told_so
    (tmp_path / "b.json").unlink()
    bench, tried = load("paper").name, (("rigid-scope", "a.tif"), ("paper", "a.tif"), ("paper", "b.tif"))
    for (design, name), held in zip(tried, (bench, bench, "something else"), strict=True):  # another scene, too
        assert main(["render", design, "-o", str(tmp_path / name)]) == 2
        assert f"{name} is of {held}" in capsys.readouterr().err
    with Image.open(tmp_path / "a-preview.png") as shown:
        assert shown.size[0] > 600


def test_scenes_without_a_name_are_told_apart_by_what_is_in_them(tmp_path, capsys):
    scene, image = tmp_path / "r.toml", tmp_path / "p.tif"
    plane = '[[objects]]\nkind = "plane"\ndistance = "310 mm"\ntexture = {kind = "checkerboard", period = "3 mm"}\n'
    asked = ["render", "paper", "--scene", str(scene), "--region", "2000,1300,8,8", "-o", str(image)]
    for old, new, code in (("", "", 0), ("", "", 0), ("3 mm", "4 mm", 2), ("checkerboard", "sinusoid", 2)):
        scene.write_text(plane.replace(old, new))
        assert main(asked) == code
    assert "p.tif is of Zhou 2023 bench system, a scene without a name, but another; delete" in capsys.readouterr().err
    told = json.loads(image.with_suffix(".json").read_text())["scene"]["objects"]
    assert (told[0]["kind"], told[0]["texture"]["kind"]) == ("plane", "checkerboard")


def test_command_prints_only_the_plan(tmp_path, capsys):
    assert (
        main(["render", "paper", "--plan-only", "--json", "--effects", "none,+cos4", "--budget-intensity", "2%"]) == 0
    )
    lines = json.loads(capsys.readouterr().out)["plans"][0]["effects"]
    assert {line["name"] for line in lines if line["on"]} == {"pupil_geometry", "pixel_integration", "cos4"}
    assert next(line for line in lines if line["name"] == "cos4")["budget"] == 0.02


def test_several_scenes_make_a_folder(tmp_path, capsys):
    for name in ("one", "two"):
        (tmp_path / f"{name}.toml").write_text('[[objects]]\nkind = "white"\n')
    scenes = ["--scene", str(tmp_path / "one.toml"), "--scene", str(tmp_path / "two.toml")]
    assert main(["render", "paper", *scenes, "--region", "0,0,8,8", "-o", str(tmp_path / "out")]) == 0
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["one.json", "one.tif", "two.json", "two.tif"]


@pytest.mark.parametrize("folder", ["out", "run.1"])
def test_one_scene_goes_into_a_folder_too(tmp_path, folder):
    """Where it is a folder, or ends in no suffix; the file in it is called after the scene."""
    (tmp_path / "run.1").mkdir()
    (tmp_path / "one.toml").write_text('[[objects]]\nkind = "white"\n')
    place = ["-o", str(tmp_path / folder), "--region", "0,0,8,8"]
    assert main(["render", "paper", "--scene", str(tmp_path / "one.toml"), *place]) == 0
    assert main(["render", "paper", *place]) == 0
    assert sorted(p.name for p in (tmp_path / folder).iterdir()) == ["one.json", "one.tif", "white.json", "white.tif"]


@pytest.mark.parametrize("command", ["render", "report", "tolerance", "optimize", "accuracy"])
def test_a_file_in_the_way_of_a_folder_is_told_in_one_way_before_any_work(command, tmp_path, capsys, root):
    (tmp_path / "file").touch()
    studies = {"tolerance": "tolerance-scope", "optimize": "optimize-rigid-scope"}
    given = str(root / "studies" / studies[command] / "study.toml") if command in studies else "paper"
    assert main([command, given, "-o", str(tmp_path / "file" / "out")]) == 2
    told = capsys.readouterr().err
    assert f"{tmp_path / 'file'} is a file, not a folder; name another place" in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--effects", "+cos5"], "did you mean 'cos4'"),
        (["--scene", "absent.toml"], "no such file"),
        (["--budget-px", "-1"], "--budget-px"),
        (["--budget-intensity", "some"], "--budget-intensity"),
        (["--region", "1,2,3"], "--region"),
        (["--region", "0,0,9999,5"], "within 4600 x 3080"),
        (["-o", "raw.jpg"], "end in .tif"),
        (["--seed", "-3", "--region", "0,0,4,4"], "seed"),
    ],
)
def test_bad_input_exits_with_two_and_one_line(arguments, part, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["render", "paper", *arguments]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert part in said[0]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ('distance = "90 mm"', "behind the bore's mouth"),
        ('distance = "5 mm"\nsize = ["20 mm", "20 mm"]\ntilt = ["0 mrad", "1 rad"]', "inside the main lens"),
        ('texture = { kind = "image", file = "no.png", width = "5 mm" }', "no.png: no such file"),
    ],
)
def test_scenes_that_cannot_be_seen_exit_with_two(line, part, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(f'[[objects]]\nkind = "plane"\n{line}\n')
    assert main(["render", "paper", "--scene", "s.toml"]) == 2
    assert part in capsys.readouterr().err


def test_zero_exposure_exits_with_two(tmp_path, capsys):
    (tmp_path / "s.toml").write_text('[light]\nexposure = 0\n[[objects]]\nkind = "white"\n')
    assert main(["render", "paper", "--scene", str(tmp_path / "s.toml")]) == 2
    assert "light.exposure" in capsys.readouterr().err
