"""What every picture must be, and that each says what the theory and the engines say."""

import base64
import io
import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image

import roslf_design as roslf
from roslf_design import theory
from roslf_design.effects.field import half_sizes
from roslf_design.errors import InputError
from roslf_design.evaluation import default_fields
from roslf_design.evaluation.fields import field_discs
from roslf_design.explorer.patch import KEPT, white_patch
from roslf_design.explorer.pictures.depth import depth_precision
from roslf_design.explorer.pictures.effects import effects
from roslf_design.explorer.pictures.matching_plane import matching_plane
from roslf_design.explorer.pictures.meridional import meridional
from roslf_design.explorer.pictures.microlens import microlens_image, nearest_microlens
from roslf_design.explorer.pictures.mla_map import mla_map
from roslf_design.imaging.render import render
from roslf_design.microlens.discs import intersect

SVG = "{http://www.w3.org/2000/svg}"


def _designs():
    paper = roslf.load("paper")
    return {
        "paper": paper,
        "mismatched": roslf.load("paper-mismatched"),
        "rigid-scope": roslf.load("rigid-scope"),
        "ear": roslf.load("ear-speculum"),
        "dark": paper.replace(D=20.0, d_3=180.0),
        "real lens": roslf.load("paper-singlet"),
        "stops and decentres": paper.replace(
            {"stops": ({"diameter": 8.0, "distance": 60.0, "decentre": (0.5, -0.3)},
                       {"diameter": 20.0, "distance": 20.0}),
             "main_lens.decentre": (0.4, 0.1), "sensor.decentre": (0.2, 0.3), "microlens_array.rotation": 0.01}
        ),
        "hexagonal": paper.replace({"microlens_array.layout": "hexagonal", "microlens_array.lens_shape": "circular"}),
        "tilted": paper.replace({"main_lens.tilt": (0.01, 0.0)}),
        "at the lens": paper.replace(d_3=0.0),
        "nearly at the focal plane": paper.replace(d_3=349.0),
        "far": paper.replace(d_f=1e6),
        "all but at the focal plane": paper.replace(d_3=350 * (1 - 1e-10)),
        "a thousandfold overlap": paper.replace(D_F=40.0, d_2=30.0, d=0.02),
        "pixels by the million": paper.replace(q=1e-5),
    }  # fmt: skip


DESIGNS = _designs()
PICTURES = {
    "meridional": lambda d, t: meridional(d, t),
    "meridional-instrument": lambda d, t: meridional(d, t, (500, 260), whole=False),
    "microlens": lambda d, t: microlens_image(d, default_fields(d)[2], t),
    "microlens-waves": lambda d, t: microlens_image(d, default_fields(d)[0], t, diffraction=True, label="centre"),
    "mla-map": lambda d, t: mla_map(d, (0.3, -0.2), t),
    "matching-plane": lambda d, t: matching_plane(d, t),
    "depth": lambda d, t: depth_precision(d, t),
    "effects": lambda d, t: effects(roslf.evaluate(d.thin_twin).effects, t),
}


def _numbers(svg):
    for element in ET.fromstring(svg).iter():
        for key in ("x", "y", "x1", "x2", "y1", "y2", "cx", "cy", "r", "width", "height"):
            if key in element.attrib:
                yield float(element.attrib[key])
        if "d" in element.attrib:
            yield from (float(n) for n in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?|nan|inf", element.attrib["d"]))


def _find(svg, testid):
    return [e for e in ET.fromstring(svg).iter() if e.attrib.get("data-testid") == testid]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_of_every_design_is_sound(name, design, theme):
    svg = PICTURES[name](design, theme).svg
    root = ET.fromstring(svg)
    assert root.attrib["role"] == "img"
    assert root.attrib["data-testid"].startswith("picture-")
    label = root.find(f"{SVG}title")
    assert label.attrib["id"] == root.attrib["aria-labelledby"]
    assert label.text
    assert not re.search(r"\b(nan|inf)\b", " ".join(root.itertext()))
    assert all(math.isfinite(number) and abs(number) < 2e5 for number in _numbers(svg))
    sizes = [float(e.attrib["font-size"]) for e in root.iter(f"{SVG}text")]
    assert sizes
    assert min(sizes) >= 11
    ids = [e.attrib["id"] for e in root.iter() if "id" in e.attrib]
    prefix = root.attrib["data-testid"].removeprefix("picture-")
    assert len(ids) == len(set(ids))
    assert all(i.startswith(prefix) for i in ids)
    assert "http" not in svg.replace("http://www.w3.org/2000/svg", "")


@pytest.mark.parametrize("name", ["paper", "dark", "stops and decentres"])
def test_blocked_rays_end_at_an_element_and_others_at_the_sensor(name):
    design = DESIGNS[name]
    picture = meridional(design)
    planes = [-stop.distance for stop in design.all_stops] + [0.0]
    rays = [e.attrib["d"] for e in _find(picture.svg, "rays")[0].iter(f"{SVG}path") if "l7,7" not in e.attrib["d"]]
    ends = []
    for data in rays:
        for course in filter(None, data.split("M")):
            x, y = (float(n) for n in course.split()[-1].split(","))
            ends.append(picture.mapping.to_value(x, y)[0])
    at_sensor = [abs(z - design.d_1 - design.d_2) < 0.05 for z in ends]
    # Pixels are written to a hundredth, about 0.01 mm here.
    assert all(lit or min(abs(z - plane) for plane in planes) < 0.05 for z, lit in zip(ends, at_sensor, strict=True))
    assert any(at_sensor)
    assert not all(at_sensor)


@pytest.mark.parametrize("whole", [True, False])
def test_lengths_are_to_scale_and_dimensioned(whole):
    design = DESIGNS["paper"]
    picture = meridional(design, whole=whole)
    told = "".join("".join(e.itertext()) + "|" for e in ET.fromstring(picture.svg).iter(f"{SVG}text"))
    told = told.replace("\u200b", "")
    for text in ("d3 = 120 mm", "d1 = 140 mm", "d2 = 2 mm", "D = 50.8 mm", "DF = 2.9 mm"):
        assert text in told
    assert ("df = 350 mm" in told) == whole
    m = picture.mapping
    factor = (m.height / (m.y1 - m.y0)) / (m.width / (m.x1 - m.x0))
    assert f"heights ×{factor:.3g}" in told


def _colours(svg):
    (image,) = ET.fromstring(svg).iter(f"{SVG}image")
    data = base64.b64decode(image.attrib["href"].split(",")[1])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA")), image.attrib


def test_pixels_of_a_microlens_are_its_exact_coverage():
    design = DESIGNS["paper"]
    place = nearest_microlens(design, (5.0, -3.0))
    picture = microlens_image(design, place)
    colours, _ = _colours(picture.svg)
    shares = colours[..., 3] / 255 / 0.42
    exact = intersect(*field_discs(design, [place])).area[0] / design.q**2
    # Opacity has 107 steps for a pixel; rounding errors of 17 x 17 pixels add up to less than one pixel in 130.
    assert shares.sum() == pytest.approx(exact, abs=1.0)


def test_the_nearest_microlens_is_one_and_near():
    design = DESIGNS["paper"]
    x, y = nearest_microlens(design, (1.0, -2.0))
    assert (x / design.d) == pytest.approx(round(x / design.d))
    assert abs(x - 1) <= design.d / 2 + 1e-12
    assert abs(y + 2) <= design.d / 2 + 1e-12
    corner = default_fields(design)[2]
    inner = nearest_microlens(design, corner, inward=True)
    assert all(a <= b + 0.002 * design.d for a, b in zip(inner, corner, strict=True))
    assert all(b - a < 1.01 * design.d for a, b in zip(inner, corner, strict=True))


@pytest.mark.parametrize("name", ["paper", "mismatched", "rigid-scope", "ear", "dark"])
@pytest.mark.parametrize("corner", [False, True])
def test_the_quick_patch_is_the_rendered_image(name, corner):
    design = DESIGNS[name]
    side = 24
    width, height = design.pixels
    column, row = (width - side, height - side) if corner else (width // 2 - 12, height // 2 - 12)
    quick = white_patch(design, slice(column, column + side), slice(row, row + side)).values
    whole = render(design, region=(column, row, side, side), threads=1, overrides=KEPT).pixels
    # What `white_patch` promises: light of far microlenses is replaced by that of the other side.
    np.testing.assert_allclose(quick, whole, atol=1e-2)


def test_what_cannot_be_seen_is_told_instead():
    told = " ".join(
        ET.fromstring(PICTURES["microlens-waves"](DESIGNS["a thousandfold overlap"], "light").svg).itertext()
    )
    assert "too many images overlap for diffraction" in told or "pixels too small to draw" in told
    told = " ".join(ET.fromstring(PICTURES["microlens"](DESIGNS["pixels by the million"], "light").svg).itertext())
    assert "pixels too small to draw" in told


def test_a_dark_microlens_is_called_dark():
    design = DESIGNS["dark"]
    (told,) = _find(microlens_image(design, default_fields(design)[2]).svg, "microlens-kept")
    assert told.text == "dark"
    assert not _find(microlens_image(design, default_fields(design)[2]).svg, "microlens-outline")
    assert "dark" in _find(mla_map(design).svg, "mla-shares")[0].text
    assert _find(mla_map(DESIGNS["paper"]).svg, "mla-shares")[0].text.endswith("all whole")


def test_the_map_shades_what_the_engine_says():
    design = DESIGNS["dark"]
    picture = mla_map(design)
    colours, at = _colours(picture.svg)
    rows, columns = colours.shape[:2]
    left, top, width, height = (float(at[key]) for key in ("x", "y", "width", "height"))
    seen = {}
    rng = np.random.default_rng(1)
    for _ in range(60):
        i, j = rng.integers(rows), rng.integers(columns)
        place = picture.mapping.to_value(left + (j + 0.5) / columns * width, top + (i + 0.5) / rows * height)
        kept = float(intersect(*field_discs(design, [place])).kept_fraction[0])
        kind = "whole" if kept == 1 else "dark" if kept == 0 else "cut"
        seen.setdefault(kind, set()).add(tuple(colours[i, j]))
    assert len(seen["whole"]) == len(seen["dark"]) == 1
    assert not seen["whole"] & seen["dark"]
    assert not seen["cut"] & (seen["whole"] | seen["dark"])


def test_the_circle_of_eq_6_has_its_radius():
    design = DESIGNS["paper"]
    picture = mla_map(design)
    (circle,) = _find(picture.svg, "eq6-circle")
    r = float(circle.attrib["r"]) / picture.mapping.width * (picture.mapping.x1 - picture.mapping.x0)
    assert r == pytest.approx(17.7816666667, rel=1e-3)  # a hundredth of a pixel


def test_the_design_point_maps_to_the_design_and_axes_stay_when_told():
    design = DESIGNS["paper"]
    picture = matching_plane(design)
    (point,) = _find(picture.svg, "design-point")
    value = picture.mapping.to_value(float(point.attrib["cx"]), float(point.attrib["cy"]))
    assert value == pytest.approx((120.0, 2.9), rel=1e-3)  # a hundredth of a pixel
    limits = picture.mapping.x1, picture.mapping.y1
    moved = matching_plane(design.replace(d_3=30.0, D_F=4.0), limits=limits)
    assert moved.mapping == picture.mapping


def test_the_region_of_eq_6_ends_where_the_margin_vanishes():
    design = DESIGNS["paper"]
    picture = matching_plane(design)
    (region,) = _find(picture.svg, "eq6-region")
    corners = [tuple(map(float, c.split(","))) for c in region.attrib["d"].strip("MZ").split()]
    x0 = math.hypot(*half_sizes(design)) * design.d_f / design.d_1
    checked = 0
    for px, py in corners[:-2]:
        d_3, D_F = picture.mapping.to_value(px, py)
        if 0 < D_F < 0.98 * picture.mapping.y1:
            margin = theory.nondistortion_margin(design.D, D_F, d_3, design.d_f, x0)
            assert abs(float(margin)) < 2e-3 * design.D * design.d_f
            checked += 1
    assert checked


def test_bars_of_effects_are_as_long_as_their_shares():
    found = roslf.evaluate(DESIGNS["paper"]).effects
    svg = effects(found).svg
    bars = {e.name: float(_find(svg, f"effect-{e.name}")[0].attrib["width"]) for e in found if e.estimate}
    shares = {e.name: abs(e.estimate) / e.budget for e in found if e.estimate}
    names = sorted(shares, key=shares.get)
    lengths = [bars[name] for name in names]
    assert lengths == sorted(lengths)
    decade = (bars["pupil_geometry"] - bars["overlap"]) / math.log10(shares["pupil_geometry"] / shares["overlap"])
    assert bars["cos4"] - bars["overlap"] == pytest.approx(
        decade * math.log10(shares["cos4"] / shares["overlap"]), abs=0.03
    )


def test_reasons_are_told_where_there_is_room():
    found = roslf.evaluate(DESIGNS["paper"]).effects
    roomy, tight = (" ".join(ET.fromstring(effects(found, "light", (560, h)).svg).itertext()) for h in (640, 240))
    assert "blur width" in roomy
    assert "Of no size here: vignetting" in roomy
    assert "blur width" not in tight


def test_no_effect_at_all_is_said():
    assert "no effect has a size" in effects(()).svg


def test_an_array_smaller_than_a_microlens_is_refused_in_words():
    with pytest.raises(InputError, match="d: 900 mm is more than the microlens array is wide"):
        microlens_image(DESIGNS["paper"].replace(d=900.0), (0.0, 0.0))


@pytest.mark.parametrize("change", [{"q": 1e-9}, {"q": 900.0}, {"D_F": 1e5}, {"f_ml": 1e-9}, {"d_2": 1e5}, {"D": 1e-9}])
def test_extreme_numbers_are_drawn_or_told_within_little_memory(change):
    design = DESIGNS["paper"].replace(**change)
    for waves in (True, False):
        svg = microlens_image(design, default_fields(design)[2], diffraction=waves).svg
        assert len(svg) < 500_000
