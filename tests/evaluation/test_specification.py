"""The data sheet's lines against rays through every face of 16 random cameras with elements."""

import csv
import json
import math
import re
from dataclasses import asdict

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.evaluation.specification import specification
from roslf_design.theory.light import sensor_field
from roslf_design.theory.object_space import ObjectSpaceFaces
from roslf_design.theory.photometry import response
from roslf_design.theory.stop_images import MicrolensImages
from tests.commands.test_cli import run
from tests.reporting.made import views_as_refocused

PAPER = roslf.load("paper")
SMALL = {
    "sensor.size": (0.5, 0.3),
    "main_lens.diameter": 20.0,
    "aperture.diameter": 0.6,
    "microlens_array.focal_length": 2.0,
}
"""A field of hundredths of a radian, where exact rays are first order to 1e-3."""


def cameras(count, seed=18):
    """Windows, prisms, objectives and liquid in any order, the FAP among them, some of it decentred."""
    rng = np.random.default_rng(seed)
    made = []
    while len(made) < count:
        place, elements, gaps = float(rng.uniform(5, 20)), [], []
        for _ in range(int(rng.integers(1, 4))):
            gaps.append(place)
            if rng.random() < 0.6:
                thick, index = float(rng.uniform(0.3, 6)), float(rng.uniform(1.35, 1.85))
                kind = {"kind": "plate", "thickness": thick, "material": {"index": index}, "diameter": 15.0}
            else:
                thick = 0.0
                focal = float(rng.uniform(60, 300) * rng.choice([-1, 1]))
                kind = {"kind": "lens", "focal_length": focal, "diameter": 15.0}
            elements.append({**kind, "distance": place})
            place += thick + float(rng.uniform(2, 15))
        fap = float(rng.choice([*gaps, place])) - float(rng.uniform(0.2, 0.8))
        aside = (float(rng.normal(0, 0.05)), float(rng.normal(0, 0.05)))
        try:
            design = PAPER.replace({"aperture.distance": 2.0}).replace(
                {
                    **SMALL,
                    "elements": elements,
                    "object_space.medium": {"index": float(rng.uniform(1, 1.4))},
                    "aperture.distance": fap,
                    "aperture.decentre": aside,
                    "main_lens.focal_plane": place + float(rng.uniform(60, 300)),
                }
            )
        except roslf.DesignError:
            continue
        if Camera.of(design).valid and float(Camera.of(design).seen.gap) > 0:
            made.append(design)
    return made


class Traced:
    """Exact rays out of one camera: through an array point and a place of the FAP, by Newton's steps."""

    def __init__(self, design):
        self.camera = Camera.of(design)
        self.faces = ObjectSpaceFaces.of(self.camera, clip=False)
        self.fap = design.aperture.distance

    def rays(self, at, aim):
        """Heights and slopes outside of rays from array points (2, N) to places (2, N) on the FAP, with a ruler."""
        c, at, aim = self.camera, np.asarray(at, float), np.asarray(aim, float)
        d_1, f = float(c.d_1), float(c.f)

        def shot(slope):
            height = at - slope * d_1
            return self.faces.rays_at([self.fap], tuple(height), tuple(slope + height / f))

        def on_fap(slope):
            near = next(iter(shot(slope)))
            return near.height - near.slope * self.fap

        slope = np.zeros_like(at)
        rate = (on_fap(slope + 1e-4) - on_fap(slope)) / 1e-4
        for _ in range(4):
            slope = slope - (on_fap(slope) - aim) / rate
        assert np.abs(on_fap(slope) - aim).max() < 1e-9
        *_, out = shot(slope)
        assert (out.status == 0).all()
        return out


@pytest.fixture(scope="module")
def sheets():
    """Cameras, their exact rays and their lines; what single views resolve is not looked at, and most of the work."""
    with pytest.MonkeyPatch.context() as patch:
        views_as_refocused(patch)
        return [(design, Traced(design), specification(design)) for design in cameras(16)]


def unit(slope):
    """Directions away from the bore."""
    ways = np.stack([-slope[0], -slope[1], np.ones_like(slope[0])])
    return ways / np.linalg.norm(ways, axis=0)


def degrees(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a.T, b.T), axis=1), (a * b).sum(0)))


def test_every_line_is_what_exact_rays_say(sheets):
    for design, traced, sheet in sheets:
        camera, decentre = traced.camera, np.array(design.aperture.decentre)[:, None]
        (x0, y0), (x1, y1) = (tuple(map(float, end)) for end in sensor_field(camera))
        xm, ym = (x0 + x1) / 2, (y0 + y1) / 2
        ends = np.array([[x0, x1, xm, xm, x0, x1, x0, x1, xm], [ym, ym, y0, y1, y0, y1, y1, y0, ym]])
        out = traced.rays(ends, np.broadcast_to(decentre, ends.shape))
        ways, tip = unit(out.slope), float(camera.tip)
        angles = degrees(ways[:, 0:8:2], ways[:, 1:8:2])
        told = sheet.field_of_view_deg[0]
        assert told.from_ == "entrance pupil"
        np.testing.assert_allclose([told.width, told.height], angles[:2], rtol=1e-3)
        assert told.diagonal == pytest.approx(angles[2:].max(), rel=1e-3)
        axis = degrees(ways[:, 8:], np.array([[0.0], [0.0], [1.0]]))[0]
        assert sheet.direction_of_view_deg == pytest.approx(axis, abs=1e-3)
        for told, field in zip(sheet.field_of_view_deg[1:], sheet.object_field, strict=True):
            assert told.at_mm == field.at_mm
            met = out.height - out.slope * (tip + field.at_mm)
            seen = np.stack([met[0], met[1], np.full(9, field.at_mm)])
            angles = degrees(seen[:, 0:8:2], seen[:, 1:8:2])
            np.testing.assert_allclose([told.width, told.height], angles[:2], rtol=1e-3)
            assert told.diagonal == pytest.approx(angles[2:].max(), rel=1e-3)
            spans = np.linalg.norm(met[:, 1:8:2] - met[:, 0:8:2], axis=0)
            np.testing.assert_allclose([field.width_mm, field.height_mm, field.diagonal_mm], spans[:3], rtol=1e-3)
            scale = spans[0] / (x1 - x0)
            assert field.magnification == pytest.approx(1 / scale, rel=1e-3)
            assert field.object_sample_mm == pytest.approx(scale * design.d, rel=1e-3)
            for row in sheet.resolution:
                if row.at_mm == field.at_mm:
                    assert row.fold_lp_per_mm == pytest.approx(0.5 / (scale * design.d), rel=1e-3)
        corner = max(sheet.field, key=lambda point: point.x0_mm)
        chief = traced.rays(np.array(corner.x_ml_mm)[:, None], decentre)
        met = chief.height - chief.slope * (tip + sheet.working_distance_mm)
        assert corner.x0_mm == pytest.approx(math.hypot(*met[:, 0]), rel=1e-3)
        assert corner.angle_deg == pytest.approx(
            degrees(unit(chief.slope), np.array([[0.0], [0.0], [1.0]]))[0], rel=1e-3
        )
        away, small = math.hypot(*corner.x_ml_mm), 0.01
        way = np.array(corner.x_ml_mm) / away
        points = np.array([away * way + small * np.array([-way[1], way[0]]) * sign for sign in (1, -1)]).T
        beside = traced.rays(points, np.broadcast_to(decentre, points.shape))
        met = beside.height - beside.slope * (tip + sheet.working_distance_mm)
        axial, here = sheet.object_field[1].object_sample_mm / design.d, math.hypot(*(met[:, 0] - met[:, 1]))
        assert corner.distortion_percent == pytest.approx(100 * (2 * small * axial / here - 1), abs=1e-6)
        assert corner.relative_illumination == pytest.approx(1.0, abs=0.01)
        parts = [20.0, 0.6 + 2 * math.hypot(*design.aperture.decentre), *(15.0 for _ in design.elements)]
        parts += [math.hypot(*design.microlens_array.size), math.hypot(*design.sensor.size)]
        assert sorted(part.diameter_mm for part in sheet.parts) == pytest.approx(sorted(parts))
        assert sheet.outer_diameter_mm == pytest.approx(max(parts))
        assert sheet.length_mm == pytest.approx(tip + design.d_1 + design.d_2)
        assert sheet.pixels == design.pixels
        assert sheet.views_across * design.q == pytest.approx(
            design.d_2 * 2 * float(camera.fap.radius) / float(camera.seen.A)
        )


def test_the_depth_of_field_ends_where_rays_a_pitch_apart_meet(sheets):
    """From points half a pitch off the axis through opposite rims of the FAP, to where both meet the chief ray."""
    for design, traced, sheet in sheets:
        decentre, radius, half = np.array(design.aperture.decentre), design.D_F / 2, design.d / 2
        tip = float(traced.camera.tip)
        for end in sheet.depth_of_field_mm.refocused:
            if not 0 < end < math.inf:
                continue
            gaps = []
            for sign in (-1, 1):
                at = np.array([[half, -half], [0.0, 0.0]])
                aim = decentre[:, None] + np.array([[sign * radius, -sign * radius], [0.0, 0.0]])
                out = traced.rays(at, aim)
                met = out.height[0] - out.slope[0] * (tip + end)
                gaps.append(abs(met[0] - met[1]))
            # One of the two pairs meets there, to what spherical aberration leaves of the field's size.
            assert min(gaps) < 2e-3 * max(gaps)


def test_focused_at_the_hyperfocal_distance_rays_a_pitch_apart_run_on_side_by_side(sheets):
    """Through opposite rims of the FAP, of a view through those of what its pixel sees; focused nearer they cross."""
    seen = {"hyperfocal_mm": 0, "view_hyperfocal_mm": 0}
    for design, traced, sheet in sheets:
        decentre, half = np.array(design.aperture.decentre), design.d / 2
        for name in seen:
            told = getattr(sheet, name)
            if told is None:
                continue
            focused = Traced(design.replace({"main_lens.focal_plane": told + float(traced.camera.tip)}))
            camera, radius = focused.camera, design.D_F / 2
            if name.startswith("view"):
                blurred = float(camera.q + camera.wavelength * camera.d_2 / camera.d)
                radius = min(radius, blurred * float(camera.seen.A / camera.d_2) * float(camera.fap.scale) / 2)
            turned = []
            for sign in (-1, 1):
                aim = decentre[:, None] + np.array([[sign * radius, -sign * radius], [0.0, 0.0]])
                out = focused.rays(np.array([[half, -half], [0.0, 0.0]]), aim)
                turned.append(abs(float(np.diff(out.slope[0])[0])))
            # Of the two pairs one stays parallel, to what spherical aberration leaves of the other's angle.
            assert min(turned) < 2e-3 * max(turned), name
            seen[name] += 1
    assert min(seen.values()) > 8


@pytest.mark.parametrize("mapping", ["f theta", "f sin", "2f tan(theta/2)"])
@pytest.mark.parametrize("fap", [2.0, 12.0])
def test_lines_behind_an_objective_with_a_mapping(mapping, fap):
    """One objective before or behind the FAP: field, its ends on three planes, distortion and scale by exact rays."""
    lens = {"kind": "lens", "distance": 5.0, "focal_length": 60.0, "mapping": mapping}
    wide = {"microlens_array.size": (60.0, 40.0), "sensor.size": (60.0, 40.0), "main_lens.diameter": 80.0}
    seen = {"elements": [lens], "aperture.distance": fap, "main_lens.focal_plane": 60.0}
    design = PAPER.replace({**wide, **seen})
    traced, sheet = Traced(design), specification(design)
    (x0, y0), (x1, y1) = (tuple(map(float, end)) for end in sensor_field(traced.camera))
    ends = np.array([[x0, x1, 0, 0, x0, x1], [0, 0, y0, y1, y0, y1]])
    out, tip = traced.rays(ends, np.zeros_like(ends)), float(traced.camera.tip)
    angles = degrees(unit(out.slope[:, ::2]), unit(out.slope[:, 1::2]))
    told = sheet.field_of_view_deg[0]
    np.testing.assert_allclose([told.width, told.height, told.diagonal], angles, rtol=1e-6)
    assert angles[2] > 20  # where mappings differ by percents
    for field in sheet.object_field:
        met = out.height - out.slope * (tip + field.at_mm)
        spans = np.linalg.norm(met[:, 1::2] - met[:, ::2], axis=0)
        np.testing.assert_allclose([field.width_mm, field.height_mm, field.diagonal_mm], spans, rtol=1e-6)
    for point in sheet.field:
        x, y = point.x_ml_mm
        away, small = math.hypot(x, y), 1e-3
        way = np.array([x, y]) / away if away else np.array([1.0, 0.0])
        radii = np.array([small, away + small, away - small, away or small])
        chief = traced.rays(way[:, None] * radii, np.zeros((2, 4)))
        on_object = way @ (chief.height - chief.slope * (tip + sheet.working_distance_mm))
        assert point.local_magnification == pytest.approx(2 * small / abs(on_object[1] - on_object[2]), rel=1e-5)
        drawn = 100 * (radii[3] / abs(on_object[3]) * abs(on_object[0]) / small - 1)
        assert point.distortion_percent == pytest.approx(drawn, abs=1e-4)
        assert point.x0_mm == pytest.approx(abs(on_object[3]) if away else 0.0, rel=1e-6)


def test_json_has_the_keys_of_the_contract(capsys):
    code, out, _ = run(capsys, "evaluate", "paper", "--json")
    sheet = json.loads(out)["specification"]
    assert code == 0
    keys = "field_of_view_deg direction_of_view_deg working_range_mm resolution depth_of_field_mm distortion "
    keys += "relative_illumination outer_diameter_mm length_mm"
    assert set(keys.split()) <= sheet.keys()
    assert {"from", "width", "height", "diagonal", "at_mm"} == sheet["field_of_view_deg"][0].keys()
    assert {"at_mm", "x0_mm", "mtf50_lp_per_mm", "mtf10_lp_per_mm"} <= sheet["resolution"][0].keys()
    assert {"view", "refocused"} <= sheet["depth_of_field_mm"].keys()


def test_every_number_as_a_row_of_csv(tmp_path, capsys):
    for name in ("e.csv", "e.json"):
        assert run(capsys, "evaluate", "paper", "-o", tmp_path / name)[0] == 0
    told = json.loads((tmp_path / "e.json").read_text())
    rows = list(csv.reader((tmp_path / "e.csv").read_text().splitlines()))
    assert rows[0] == ["key", "value"]
    for key, value in rows[1:]:
        at = told
        for part in key.split("."):
            at = at[int(part) if isinstance(at, list) else part]
        assert value == ("" if at is None else str(at)), key
    assert dict(rows)["fields.1.kept_fraction"]
    for arguments, words in ((("-o", "e.txt"), ".json or .csv"), (("--json", "-o", "e.csv"), "give one of them")):
        code, _, err = run(capsys, "evaluate", "paper", *arguments)
        assert (code, err.count("\n")) == (2, 1)
        assert words in err


@pytest.mark.parametrize("focal_plane", [25.0, 8.0])
def test_lines_of_one_sheet_agree_and_depths_are_those_of_evaluate(focal_plane):
    """A scope whose views are sharp to infinity, and one whose far end lies beyond twice the focal plane.

    The working range of the first ends where depth is of little use, not at infinity.
    """
    design = roslf.load("rigid-scope").replace({"main_lens.focal_plane": focal_plane})
    sheet, told = roslf.specification(design), roslf.evaluate(design)
    (near, far), focus = sheet.working_range_mm, sheet.working_distance_mm
    ends = [("near end", near), ("focal plane", focus)]
    ends.append(("twice the focus", 2 * focus) if focal_plane == 25 else ("far end", far))
    assert 2 * focus < far < math.inf
    assert sheet.depth_of_field_mm.view == (near, math.inf if focal_plane == 25 else far)
    assert [(field.plane, field.at_mm) for field in sheet.object_field] == ends
    spreads = sheet.depth_precision.spreads
    assert [(row.plane, row.at_mm) for row in spreads] == [*ends, ends[1], ends[1]]
    # Images that are worked out side by side may round in another last digit.
    assert spreads[1].sigma_z_mm == pytest.approx(told.depth.sigma_z_mm, rel=1e-14)
    assert [row.sigma_z_mm for row in spreads[3:]] == pytest.approx([f.sigma_z_mm for f in told.fields[1:]], rel=1e-14)
    assert spreads[0].sigma_z_mm < spreads[1].sigma_z_mm < spreads[2].sigma_z_mm
    one, other = (asdict(each.assumes) for each in (sheet.depth_precision, told.depth))
    assert one.pop("sigma_disparity_pitches") == pytest.approx(other.pop("sigma_disparity_pitches"), rel=1e-14)
    assert one == other
    for row in sheet.resolution:
        assert row.usable_lp_per_mm == min(row.mtf50_lp_per_mm, row.fold_lp_per_mm)
        assert row.limited_by == ("contrast" if row.mtf50_lp_per_mm < row.fold_lp_per_mm else "sampling")


def test_a_field_without_light_and_a_plane_without_end():
    dark = PAPER.replace({"stops": [{"diameter": 4.0, "distance": 40.0}]})
    sheet = specification(dark)
    assert sheet.to_dict()["resolution"][2]["mtf50_lp_per_mm"] is None
    assert sheet.relative_illumination == 0
    far = specification(roslf.load("cystoscope"))
    assert far.to_dict()["depth_of_field_mm"]["refocused"][1] is None


def test_slanting_rays_at_the_sensor_are_told_with_what_they_lose():
    """From the far rim of the corner's microlens image to the middle of its microlens."""
    design = roslf.load("rigid-scope").replace({"sensor.acceptance": math.radians(10.0)})
    camera = Camera.of(design)
    images = MicrolensImages(camera, sensor_field(camera).corners[:1])
    centre, radius = images.openings.centres[0, 0, 0], images.openings.radii[0, 0, 0]
    steepest = math.degrees(math.atan((math.hypot(*centre) + radius) / design.d_2))
    assert float(roslf.quantity("sensor_angle_deg")(camera)) == pytest.approx(steepest, rel=1e-9)
    (told,) = [text for text in roslf.evaluate(design).warnings if "rays meet the sensor" in text]
    assert f"{steepest:.3g} degrees" in told
    assert f"{100 * (1 - 0.5 ** (steepest / 10) ** 2):.3g} %" in told
    # The whole image's loss, point by point over its disc.
    u, v = np.meshgrid(*2 * [np.linspace(-1, 1, 201)])
    points = np.hypot(math.hypot(*centre) + radius * u, radius * v)[np.hypot(u, v) < 1]
    kept = (0.5 ** (np.degrees(np.arctan(points / design.d_2)) / 10) ** 2).mean()
    lost = float(re.search(r"image ([\d.]+) % is lost", told)[1]) / 100
    assert 1 - lost == pytest.approx(kept, abs=1e-3)  # three digits told
    # The chief rays' lean takes it, and what the words say mends it: a pupil at infinity leaves what the middle loses.
    assert "it is the lean of chief rays" in told
    straight = Camera.of(design.replace(d_3=design.f))
    assert float(response(straight, sensor_field(straight).radius)) == pytest.approx(float(response(straight, 0.0)))
    assert float(response(straight, 0.0)) > 0.9 > 0.1 > float(response(camera, sensor_field(camera).radius))
    at_infinity = design.replace({"d_3": design.f, "sensor.acceptance": math.radians(2.0)})
    (told,) = [text for text in roslf.evaluate(at_infinity).warnings if "rays meet the sensor" in text]
    assert "slower microlenses narrow and no exit pupil does" in told
    wide = roslf.load("paper").replace({"sensor.acceptance": math.radians(80.0)})
    assert not any("rays meet the sensor" in text for text in roslf.evaluate(wide).warnings)
    with pytest.raises(roslf.DesignError, match="between 0 and 90 degrees"):
        design.replace({"sensor.acceptance": 0.0})
