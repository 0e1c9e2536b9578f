import numpy as np
import pytest
from PIL import Image

from roslf_design.design import load
from roslf_design.design.parts import MicrolensArray
from roslf_design.errors import InputError
from roslf_design.imaging.render import render
from roslf_design.imaging.surfaces import encode, met
from roslf_design.scenes import (
    Checkerboard,
    Noise,
    PictureTexture,
    Plane,
    Points,
    Scene,
    SceneError,
    SceneLight,
    Sinusoid,
    Sphere,
    Tube,
    load_scene,
    make_scene,
)
from roslf_design.scenes.objects import depths
from roslf_design.scenes.scene import chief_ray_limits
from roslf_design.toml_files import parse_toml

PAPER = load("paper")

FULL = """
name = "bench"
background = 0.1

[light]
wavelengths = ["450 nm", "550 nm"]
exposure = 8000
read_noise = 2.5

[[objects]]
kind = "plane"
distance = "35 cm"
tilt = ["100 mrad", "0 mrad"]
texture = { kind = "checkerboard", period = "4 mm", low = 0.2 }

[[objects]]
kind = "sphere"
distance = "300 mm"
radius = "5 mm"
texture = { kind = "sinusoid", period = "1 mm" }

[[objects]]
kind = "points"
positions = [["1 mm", "-2 mm", "300 mm"]]

[[objects]]
kind = "tube"
start = "200 mm"
end = "400 mm"
radius = "20 mm"

[[objects]]
kind = "white"
"""


def faults(text):
    with pytest.raises(SceneError) as error:
        make_scene(parse_toml(text, "s.toml", refusal=SceneError), from_file=True, origin="s.toml")
    return str(error.value).splitlines()


def test_reads_every_kind():
    scene = make_scene(parse_toml(FULL, ""), from_file=True)
    assert [thing.kind for thing in scene.objects] == ["plane", "sphere", "points", "tube", "white"]
    assert scene.objects[0].distance == 350.0
    assert scene.objects[0].texture == Checkerboard(period=4.0, low=0.2)
    assert scene.light.wavelengths == (450e-6, 550e-6)
    assert scene.objects[2].positions == ((1.0, -2.0, 300.0),)


def test_every_fault_at_once_with_place_and_remedy():
    text = """
    backgruond = 1
    [light]
    exposure = 0
    wavelengths = ["550"]
    [[objects]]
    kind = "plain"
    [[objects]]
    kind = "plane"
    distance = 350
    texture = { kind = "checkerbord", period = "1 mm" }
    [[objects]]
    kind = "sphere"
    distance = "300 mm"
    raduis = "3 mm"
    [[objects]]
    kind = "tube"
    start = "300 mm"
    end = "200 mm"
    radius = "5 mm"
    """
    lines = faults(text)
    wanted = [
        ("light.exposure", "greater than zero"),
        ("light.wavelengths.0", "has no unit"),
        ("objects.0.kind", "did you mean 'plane'"),
        ("objects.1.distance", "350 mm"),
        ("objects.1.texture.kind", "did you mean 'checkerboard'"),
        ("objects.2.radius", "is missing"),
        ("objects.2.raduis", "did you mean 'radius'"),
        ("objects.3", "far end comes second"),
        ("backgruond", "did you mean 'background'"),
    ]
    for key, part in wanted:
        assert any(line.startswith(f"s.toml: {key}: ") and part in line for line in lines), (key, lines)
    assert len(lines) == len(wanted)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "objects: is missing"),
        ("objects = 3", "[[objects]]"),
        ("objects = [3]", "objects.0: must be a table"),
        ("[[objects]]\ndistance = '1 mm'", "objects.0.kind: is missing"),
        ("[[objects]\n", "is not valid TOML"),
        ("light = 3\n[[objects]]\nkind='white'", "light: must be a table"),
    ],
)
def test_faults_of_the_whole(text, part):
    assert part in faults(text)[0]


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(SceneError, match="no such file"):
        load_scene(tmp_path / "none.toml")
    with pytest.raises(SceneError, match="is a folder"):
        load_scene(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b"name = '\xe9'")
    with pytest.raises(SceneError, match="UTF-8"):
        load_scene(tmp_path / "latin.toml")


def test_pictures_are_found_beside_the_scene(tmp_path):
    ramp = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20
    Image.fromarray(ramp).save(tmp_path / "ramp.png")
    (tmp_path / "s.toml").write_text(
        '[[objects]]\nkind = "plane"\ntexture = {kind = "image", file = "ramp.png", width = "8 mm"}\n'
    )
    scene = load_scene(tmp_path / "s.toml")
    assert isinstance(scene.objects[0].texture, PictureTexture)
    assert scene.brief(PAPER).smallest_period == 4.0
    surfaces = encode(scene, 350.0)
    # pixel centres of a picture 4 x 3 pixels of 2 mm, its middle on the origin
    for u, v, level in [(-3.0, -2.0, 0), (3.0, 2.0, 220), (-2.0, -2.0, 10)]:
        assert met(surfaces, 0.0, np.array([[u, v, 0.0, 0.0]]))[1] == pytest.approx(level / 255, rel=1e-6)


def test_unreadable_pictures_are_named(tmp_path):
    (tmp_path / "text.png").write_text("no picture")
    for name, fault in (("text.png", "cannot be read as an image"), ("absent.png", "no such file")):
        scene = Scene(objects=(Plane(texture=PictureTexture(file=str(tmp_path / name), width=5.0)),))
        with pytest.raises(SceneError, match=rf"objects\.0\.texture\.file: .*{name}: {fault}"):
            scene.brief(PAPER)


@pytest.mark.parametrize(
    ("thing", "part"),
    [
        (Plane(distance=100.0), "behind the bore's mouth at 120 mm"),
        (Points(positions=((0.0, 0.0, 120.0),)), "behind the bore's mouth"),
        (Tube(start=50.0, end=300.0, radius=10.0), "Z = 50 mm, behind the bore's mouth"),
        (Plane(distance=5.0, size=(20.0, 20.0), tilt=(0.0, 1.0)), "inside the main lens"),
        (Plane(distance=300.0, tilt=(1.5, 0.0)), "runs out of sight"),
    ],
)
def test_objects_where_the_camera_cannot_see_them(thing, part):
    with pytest.raises(SceneError) as error:
        Scene(objects=(thing,)).brief(PAPER)
    assert part in str(error.value)


def test_briefs():
    assert Scene().brief(PAPER).white
    assert Scene().brief(PAPER).distances is None
    plane = Scene(objects=(Plane(texture=Sinusoid(period=3.0)),)).brief(PAPER)
    assert (plane.smallest_period, plane.hard_edges, plane.distances) == (3.0, False, None)
    points = Scene(objects=(Points(positions=((0.0, 0.0, 300.0), (0.0, 0.0, 400.0))),)).brief(PAPER)
    assert (points.smallest_period, points.hard_edges, points.distances) == (0.0, True, (300.0, 400.0))


def test_depths_of_a_tilted_plane_bound_what_the_chief_rays_meet():
    plane = Plane(distance=350.0, tilt=(0.2, -0.3), texture=Sinusoid(period=3.0))
    nearest, farthest = Scene(objects=(plane,)).brief(PAPER).distances
    normal = np.array([np.sin(-0.3) * np.cos(0.2), -np.sin(0.2), np.cos(0.2) * np.cos(-0.3)])
    x_ml, y_ml = np.meshgrid(np.linspace(-11.15, 11.15, 41), np.linspace(-7.466, 7.466, 41))
    # chief rays: from the FAP's centre at z = -120 towards the in-focus point at z = -350
    along = np.stack([-x_ml * 2.5, -y_ml * 2.5, np.full_like(x_ml, -230.0)])
    start = np.array([0.0, 0.0, -120.0])
    t = normal @ (np.array([0, 0, -350.0]) - start) / np.tensordot(normal, along, 1)
    distances = -(start[2] + t * along[2])
    assert nearest <= distances.min() <= distances.max() <= farthest
    assert farthest < 1.2 * distances.max()


@pytest.mark.parametrize("contrast", [0.1, 0.2, 0.3])
def test_share_of_a_texture_that_is_black(contrast):
    noise = Noise(finest=1.0, contrast=contrast, seed=3)
    assert noise.black == pytest.approx((noise.load() == 0).mean(), abs=1e-3)


def test_values_that_make_no_scene_are_told_in_one_line_each_however_they_are_given():
    for data, told in (
        ({"nmae": "x"}, "nmae: is not a known key; did you mean 'name'?"),
        ({"light": {"exposur": 1.0}}, "light.exposur: is not a known key; did you mean 'exposure'?"),
        ({"background": "dark"}, "background: must be a finite number without a unit, got 'dark'"),
    ):
        for make in (lambda data: Scene(**data), lambda data: make_scene({"objects": [{"kind": "white"}], **data})):
            with pytest.raises(SceneError) as error:
                make(data)
            assert str(error.value) == told
    for part, key in ((Plane, "distance"), (SceneLight, "exposure"), (MicrolensArray, "pitch")):
        with pytest.raises(InputError, match=rf"{key}x: is not a known key; did you mean '{key}'\?"):
            part(**{key: 1.0, f"{key}x": 1.0})


@pytest.mark.parametrize(
    "own", [{}, {"centre": (3.0, -4.0)}, {"distance": 330.0, "radius": -25.0}, {"distance": -50.0}]
)
def test_depths_of_a_hollow_sphere_are_those_that_rays_of_the_field_find(own):
    cup = Sphere(**({"distance": 150.0, "radius": -220.0 - 200 * (own.get("distance", 0) < 0)} | own))
    slope, height = chief_ray_limits(PAPER)
    near, far = sorted(depths(cup, PAPER.d_f, slope, height))
    turns = np.linspace(0, 2 * np.pi, 721)[:, None]
    share = np.linspace(0, 1, 201)
    ways = np.stack([np.cos(turns) * share, np.sin(turns) * share], -1).reshape(-1, 2)
    met_at, _ = met(encode(Scene(objects=(cup,)), PAPER.d_f), 0.0, np.hstack([height * ways, -slope * ways]))
    some = met_at[np.isfinite(met_at)]
    if cup.radius < -25.0:
        assert some.size == met_at.size
        assert some.min() == pytest.approx(near, abs=2e-3)  # half a step of 1/720 turn from the farthest ray
    else:  # smaller than the field: some ray less steep than the steepest grazes it, where it is known to no better
        assert 0 <= some.min() - near < slope * 25.0 + np.sqrt(2 * 25.0 * 0.25)
    assert near < some.max() <= far == cup.distance - cup.radius


def test_chief_rays_of_the_field_go_through_the_middle_of_the_fap():
    """Of a wall that is tilted as far as the steepest of them allows, all is in sight."""
    slope, height = chief_ray_limits(PAPER)
    assert slope * PAPER.d_3 + height == pytest.approx(0, abs=1e-12)
    wall = Plane(tilt=(0.0, 0.99 * np.arctan(1 / slope)))
    near, far = sorted(depths(wall, PAPER.d_f, slope, height))
    rise = np.tan(wall.tilt[1])
    for z, side in ((near, -1), (far, 1)):  # on the wall, and on the ray
        assert z == pytest.approx(PAPER.d_f + side * rise * slope * (z - PAPER.d_3), rel=1e-9)


def test_a_hollow_sphere_is_seen_at_its_far_side_and_one_behind_the_camera_is_refused():
    drum = Scene(objects=({"kind": "sphere", "distance": 3.0, "radius": -12.0, "measured_from": "tip"},))
    ray = np.array([[0.0, 0.0, 0.0, 0.0]])
    (seen,), _ = met(encode(drum.seen_by(PAPER), PAPER.d_f), 120.0, ray)
    assert seen == pytest.approx(120.0 + 3.0 + 12.0)
    sphere = '[[objects]]\nkind = "sphere"\ndistance = "{}"\nradius = "{}"'
    for distance, radius, words in (
        ("300 mm", "0 mm", "radius 0 mm is none"),
        ("-1 mm", "12 mm", "behind the camera; move it farther out, or give a hollow one"),
        ("-13 mm", "-12 mm", "behind the camera; move it farther out"),
    ):
        (line,) = faults(sphere.format(distance, radius))
        assert line.startswith("s.toml: objects.0")
        assert words in line


def test_distances_ahead_of_the_tip_are_those_from_the_lens_less_the_bore():
    text = FULL.replace('kind = "white"', 'kind = "plane"')
    scene = make_scene(parse_toml(text, ""), from_file=True)
    ahead = text
    for length, from_tip in (("35 cm", "23 cm"), ("300 mm", "180 mm"), ("200 mm", "80 mm"), ("400 mm", "280 mm")):
        ahead = ahead.replace(f'"{length}"', f'"{from_tip}"')  # the tip of the paper's camera lies at 120 mm
    for kind in ("plane", "sphere", "points", "tube"):
        ahead = ahead.replace(f'kind = "{kind}"', f'kind = "{kind}"\nmeasured_from = "tip"', 1)
    placed = make_scene(parse_toml(ahead, ""), from_file=True)
    assert placed.objects != scene.objects
    assert placed.seen_by(PAPER) == scene
    assert placed.brief(PAPER) == scene.brief(PAPER)
    with pytest.raises(SceneError, match="behind the bore's mouth at 120 mm"):
        Scene(objects=(Tube(start=80.0, end=300.0, radius=10.0),)).brief(PAPER)
    Scene(objects=(Tube(start=80.0, end=300.0, radius=10.0, measured_from="tip"),)).brief(PAPER)


def test_a_zero_of_distances_that_is_none_or_measures_none_is_refused():
    (line,) = faults('[[objects]]\nkind = "sphere"\ndistance = "9 mm"\nradius = "1 mm"\nmeasured_from = "tipp"')
    assert line.startswith("s.toml: objects.0.measured_from: ")
    assert "'tip'" in line
    (line,) = faults('[[objects]]\nkind = "plane"\nmeasured_from = "tip"')
    assert "measures no distance; give one, or leave it out" in line


def test_pictures_of_a_scene_ahead_of_the_tip_are_the_same_and_hold_it_as_given():
    ball = {"kind": "sphere", "radius": 10.0, "texture": {"kind": "checkerboard", "period": 4.0}}
    scenes = [make_scene({"objects": [ball | own]}) for own in (
        {"distance": 340.0}, {"distance": 220.0, "measured_from": "tip"})]  # fmt: skip
    lens, tip = (render(PAPER, scene, region=(2290, 1530, 16, 16)) for scene in scenes)
    assert lens.pixels.tobytes() == tip.pixels.tobytes()
    assert tip.metadata()["scene"]["objects"][0]["measured_from"] == "tip"
    assert tip.metadata()["scene"]["objects"][0]["distance"] == "220 mm"
