"""Chief rays through elements against Snell's law written out ray by ray, which shares no code with the package."""

import json
import math

import mpmath as mp
import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.calibration.frames import CalibrationError
from roslf_design.calibration.space import SceneSide
from roslf_design.camera import Camera
from roslf_design.theory.chief_rays import chief_rays
from roslf_design.theory.light import sensor_field
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from tests.commands.test_cli import run

pytestmark = pytest.mark.usefixtures("without_views")

mp.mp.dps = 30
PAPER = roslf.load("paper")


class Bore:
    """A design as numbers; rays in space from a microlens outwards, bent face by face."""

    def __init__(self, design):
        wave = design.wavelength
        self.d_1, self.f, self.d_f = design.d_1, design.f, design.d_f
        self.fap, self.aside = design.aperture.distance, design.aperture.decentre
        self.lens = design.main_lens.decentre
        self.medium = float(design.object_space.medium.index(wave))
        self.elements = sorted(design.elements, key=lambda element: element.distance)
        self.index = [float(e.material.index(wave)) if e.kind in ("plate", "prism") else None for e in self.elements]
        self.tip = max(self.fap, *(e.distance + e.length for e in self.elements))

    def outwards(self, at, height):
        """Point and direction of a ray at the FAP and in front of all, from a microlens through a point of the lens."""
        way = [(h - a) / self.d_1 for h, a in zip(height, at, strict=True)]  # towards the scene, per mm
        point = [h + o for h, o in zip(height, self.lens, strict=True)]
        slope = [w - h / self.f for w, h in zip(way, height, strict=True)]
        z, index, at_fap = 0.0, 1.0, None
        for number, (element, glass) in enumerate(zip(self.elements, self.index, strict=True)):
            last = number == len(self.elements) - 1
            if at_fap is None and element.distance >= self.fap:
                at_fap = [p + s * (self.fap - z) for p, s in zip(point, slope, strict=True)]
            point = [p + s * (element.distance - z) for p, s in zip(point, slope, strict=True)]
            z, beyond = element.distance, self.medium if last else 1.0
            if glass is None:
                off = element.decentre
                slope = [s - (p - o) / element.focal_length for p, s, o in zip(point, slope, off, strict=True)]
                # An ideal lens before a liquid ends at a window of no thickness; slopes times index are its own.
                slope = [s / beyond for s in slope]
            else:
                slope = self.bent(slope, index, glass)
                point = [p + s * element.thickness for p, s in zip(point, slope, strict=True)]
                z += element.thickness
                slope = self.bent(slope, glass, beyond)
            index = beyond
        if at_fap is None:
            at_fap = [p + s * (self.fap - z) for p, s in zip(point, slope, strict=True)]
        return at_fap, [p - s * z for p, s in zip(point, slope, strict=True)], slope

    @staticmethod
    def bent(slope, before, behind):
        """Slopes behind a flat face."""
        steep = mp.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
        sines = [s / steep * before / behind for s in slope]
        rest = mp.sqrt(1 - sines[0] ** 2 - sines[1] ** 2)
        return [s / rest for s in sines]

    def chief(self, x, y):
        """Place at z = 0 and slope of the ray through the FAP's middle, by Newton's method in both directions."""

        def miss(u, v):
            at_fap, *_ = self.outwards((mp.mpf(x), mp.mpf(y)), (u, v))
            return [a - b for a, b in zip(at_fap, self.aside, strict=True)]

        u, v = mp.findroot(miss, (mp.mpf(0), mp.mpf(0)), tol=1e-40, maxsteps=60)
        return self.outwards((mp.mpf(x), mp.mpf(y)), (u, v))[1:]

    def on_plane(self, x, y, ahead):
        """Where it meets a plane in front of the bore."""
        point, slope = self.chief(x, y)
        return [float(p + s * (self.tip + ahead)) for p, s in zip(point, slope, strict=True)]

    def angle(self, one, other):
        """Between two chief rays [degrees]."""
        ways = []
        for place in (one, other):
            _, slope = self.chief(*place)
            ways.append(np.array([*map(float, slope), 1.0]))
        return math.degrees(math.atan2(np.linalg.norm(np.cross(*ways)), np.dot(*ways)))


def skewed():
    """Two plates and a lens off the axis, the FAP between them, oil before the last: nothing is symmetric."""
    plate = {"kind": "plate", "distance": 20.0, "thickness": 9.0, "material": {"index": 1.6}}
    lens = {"kind": "lens", "distance": 31.0, "focal_length": 45.0, "decentre": (0.4, -0.3)}
    window = {"kind": "plate", "distance": 52.0, "thickness": 3.0, "material": {"index": 1.77}}
    seen = {"elements": [plate, lens, window], "object_space.medium": {"index": 1.45}, "aperture.distance": 40.0}
    aside = {"aperture.decentre": (0.3, 0.2), "main_lens.decentre": (-0.2, 0.1), "sensor.decentre": (1.0, -0.5)}
    return PAPER.replace({**seen, **aside, "microlens_array.distance": 190.0})


def immersed():
    """The paper's bench with its FAP in the water before a thick window."""
    window = {"kind": "plate", "distance": 60.0, "thickness": 30.0, "material": "sapphire"}
    wet = {"elements": [window], "object_space.medium": "water", "aperture.distance": 110.0}
    return PAPER.replace({**wet, "sensor.size": (40.0, 30.0), "microlens_array.size": (42.0, 32.0)})


DESIGNS = {
    "cystoscope": roslf.load("cystoscope"),
    "arthroscope": roslf.load("arthroscope"),
    "skewed": skewed(),
    "immersed": immersed(),
}


def field_of(design):
    """Left, right, lower and upper end of what the sensor sees."""
    (x0, y0), (x1, y1) = (tuple(map(float, end)) for end in sensor_field(Camera.of(design)))
    return x0, x1, y0, y1


@pytest.mark.parametrize("name", DESIGNS)
def test_every_angle_and_length_of_a_sheet_comes_from_the_same_rays(name):
    design = DESIGNS[name]
    bore, sheet, (x0, x1, y0, y1) = Bore(design), roslf.specification(design), field_of(design)
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    across = ((x0, y), (x1, y)), ((x, y0), (x, y1)), ((x0, y0), (x1, y1)), ((x0, y1), (x1, y0))
    angles = [bore.angle(*pair) for pair in across]
    pupil, *tips = sheet.field_of_view_deg
    assert (pupil.width, pupil.height, pupil.diagonal) == pytest.approx((*angles[:2], max(angles[2:])), rel=1e-9)
    for tip, seen in zip(tips, sheet.object_field, strict=True):
        met = [[np.array(bore.on_plane(*place, seen.at_mm)) for place in pair] for pair in across]
        spans = [float(np.hypot(*(a - b))) for a, b in met]
        assert (seen.width_mm, seen.height_mm) == pytest.approx(spans[:2], rel=1e-9)
        assert seen.diagonal_mm == pytest.approx(max(spans[2:]), rel=1e-9)
        views = [[np.array([*place, seen.at_mm]) for place in pair] for pair in met]
        under = [math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), a @ b)) for a, b in views]
        assert (tip.width, tip.height, tip.diagonal) == pytest.approx((*under[:2], max(under[2:])), rel=1e-9)
    for point in sheet.field:
        place = MicrolensImages(Camera.of(design), [point.x_ml_mm]).microlens[:2]
        at = [float(np.squeeze(part)) for part in place]
        assert point.x0_mm == pytest.approx(math.hypot(*bore.on_plane(*at, sheet.working_distance_mm)), rel=1e-9)
        away, small = math.hypot(*at), 1e-4
        way = np.array(at) / away if away > 1e-9 else np.array([1.0, 0.0])
        scales = []
        for turn in (way, np.array([-way[1], way[0]])):
            ends = [bore.on_plane(*(at + sign * small * turn), sheet.working_distance_mm) for sign in (1, -1)]
            scales.append(math.hypot(*np.subtract(*ends)) / (2 * small))
        axial = sheet.object_field[1].object_sample_mm / design.d
        assert point.local_magnification == pytest.approx(1 / scales[0], rel=1e-7)
        assert point.distortion_percent == pytest.approx(100 * (axial / scales[1] - 1), abs=1e-5)
        for row in sheet.resolution:
            if row.x_ml_mm == point.x_ml_mm:
                assert row.x0_mm == pytest.approx(math.hypot(*bore.on_plane(*at, row.at_mm)), rel=1e-9, abs=1e-12)


def test_the_cystoscope_in_water_is_one_camera_on_all_its_page(capsys):
    """48.07 and 56.32 degrees from the tip go with 47.41 and 55.57 from the entrance pupil, and 22.31 mm."""
    sheet = json.loads(run(capsys, "evaluate", "cystoscope", "--json")[1])
    lines = sheet["specification"]
    pupil, _, tip, _ = lines["field_of_view_deg"]
    assert [round(pupil[part], 2) for part in ("width", "diagonal")] == [47.41, 55.57]
    assert [round(tip[part], 2) for part in ("width", "diagonal")] == [48.07, 56.32]
    assert round(lines["object_field"][1]["width_mm"], 2) == 22.31
    assert round(sheet["non_distortion"]["field_half_width_mm"], 3) == 11.154
    assert round(24.2059 / lines["object_field"][1]["width_mm"], 3) == 1.085


@pytest.mark.parametrize("name", DESIGNS)
def test_quantities_of_that_name_are_half_the_sheets(name):
    """In evaluate, sweeps, tolerances and goals; of many builds what each alone has."""
    design, bore = DESIGNS[name], Bore(DESIGNS[name])
    camera, (x0, x1, y0, y1) = Camera.of(design), field_of(design)
    y, focus = (y0 + y1) / 2, design.d_f - bore.tip
    width = math.hypot(*np.subtract(*(bore.on_plane(x, y, focus) for x in (x0, x1))))
    assert float(QUANTITIES["field_half_width_mm"](camera)) == pytest.approx(width / 2, rel=1e-9)
    assert roslf.evaluate(design).non_distortion.field_half_width_mm == pytest.approx(width / 2, rel=1e-9)
    half = bore.angle((x0, y), (x1, y)) / 2
    assert float(QUANTITIES["field_half_angle_deg"](camera)) == pytest.approx(half, rel=1e-9)
    moved = {"object_space.index": camera["object_space.index"] * np.array([1.0, 1.02, 0.97]),
             "aperture.decentre.0": camera["aperture.decentre.0"] + np.array([0.0, 0.02, -0.05])}  # fmt: skip
    many = camera.replace(moved)
    for quantity in ("field_half_width_mm", "field_half_diagonal_mm", "tip_field_of_view_deg", "undistorted_field_mm"):
        values = QUANTITIES[quantity](many)
        alone = [float(QUANTITIES[quantity](many.build(k))) for k in range(3)]
        np.testing.assert_allclose(values, alone, rtol=1e-10)
        assert len(set(alone)) == 3
    grid = camera.replace({place: value[:, None] for place, value in moved.items()})
    assert QUANTITIES["field_half_width_mm"](grid.replace({"sensor.size.0": np.array([2.0, 1.0])})).shape == (3, 2)


def test_chief_rays_of_builds_are_each_its_own_wherever_their_stops_stand():
    """Between which elements a build's stop stands, or behind the lens, is no other build's affair."""
    design = DESIGNS["cystoscope"]
    stands, places = [62.84, 1.0, 30.0, 81.5], ((1.0, 0.5), (-1.7, 1.2))
    for order in (slice(None), slice(None, None, -1)):
        many, (x, y) = Camera.of(design, {"d_3": stands[order]}), np.array(places).T[..., None]
        met = np.stack(chief_rays(many, (x, y)).on_plane(design.d_f))
        bores = [Bore(design.replace({"aperture.distance": d_3})) for d_3 in stands[order]]
        alone = [[bore.on_plane(*at, design.d_f - bore.tip) for bore in bores] for at in places]
        np.testing.assert_allclose(met.transpose(1, 2, 0), alone, rtol=1e-9)
    for name in ("cystoscope", "arthroscope"):
        camera = Camera.of(DESIGNS[name])
        inside = [part.start + part.length / 2 for part in camera.in_bore]
        many = camera.replace({"aperture.distance": [camera["aperture.distance"], -5.0, *inside]})
        for quantity in ("field_half_width_mm", "view_baseline_mm", "inverse_aperture_constant"):
            alone = [float(QUANTITIES[quantity](many.build(k))) for k in range(len(inside) + 2)]
            np.testing.assert_allclose(QUANTITIES[quantity](many), alone, rtol=1e-10)


@pytest.mark.parametrize("name", ["cystoscope", "arthroscope"])
def test_a_build_that_is_none_and_a_stop_past_elements_leave_the_other_builds_their_faces(name):
    """Of a search's point that is no number, and of a second stop on one side of elements and FAP or on the other."""
    design = DESIGNS[name]
    stop = {"diameter": design.aperture.diameter * 1.5, "distance": design.aperture.distance / 2}
    camera = Camera.of(design.replace({"stops": [stop]}))
    behind = [part.start + part.length + 0.01 for part in camera.in_bore]
    for place, values in (
        ("aperture.distance", [np.nan, camera["aperture.distance"], np.nan]),
        ("aperture.distance", [np.nan, np.nan]),
        ("stops.0.distance", [stop["distance"], *behind]),
        ("stops.0.distance", [*behind[::-1], stop["distance"]]),
    ):
        many = camera.replace({place: np.array(values)})
        for quantity in ("field_of_view_deg", "undistorted_field_mm", "direction_of_view_deg"):
            alone = [float(QUANTITIES[quantity](camera.replace({place: x}))) if x == x else np.nan for x in values]
            with np.errstate(invalid="ignore"):  # as searches have it
                np.testing.assert_allclose(QUANTITIES[quantity](many), alone, rtol=1e-10)


def test_in_air_nothing_is_traced_and_nothing_moves():
    """Half widths are the sensor's times d_f/d_1, whatever they are worked out by."""
    for name in ("paper", "rigid-scope", "ear-speculum"):
        design = roslf.load(name)
        camera = Camera.of(design)
        half = float(sensor_field(camera).half[0]) * design.d_f / design.d_1
        assert float(QUANTITIES["field_half_width_mm"](camera)) == pytest.approx(half, rel=1e-14)
        sheet = roslf.specification(design)
        assert sheet.object_field[1].width_mm == pytest.approx(2 * half, rel=1e-12)
        assert all(point.distortion_percent == 0 for point in sheet.field)


def test_rays_through_a_rod_are_those_of_its_ray_equation():
    """The needle's, whose FAP stands before all of it: Runge-Kutta along the ray, in mpmath, on its own."""
    design = roslf.load("grin-needle")
    x0, x1, *_ = field_of(design)
    focus = float(roslf.specification(design).working_distance_mm)

    def through_rod(rod, x, slope, beyond):
        """Height and slope behind a rod of n = n_0 (1 - g^2 r^2/2), by the optical direction along its axis."""
        n_0, g = rod.index, rod.gradient
        steep = math.hypot(1, slope)
        sine = slope / steep  # times 1, the air's index
        index = n_0 * (1 - g * g * x * x / 2)
        forward = math.sqrt(index * index - sine * sine)

        def rate(state):
            x, p = state
            n = n_0 * (1 - g * g * x * x / 2)
            return np.array([p / forward, -n * n_0 * g * g * x / forward])

        state, steps = np.array([x, sine]), 1000
        h = rod.thickness / steps
        for _ in range(steps):
            a = rate(state)
            b = rate(state + h / 2 * a)
            c = rate(state + h / 2 * b)
            d = rate(state + h * c)
            state = state + h / 6 * (a + 2 * b + 2 * c + d)
        sine = state[1] / beyond
        return state[0], sine / math.sqrt(1 - sine * sine)

    def met(at):
        d_1, f, fap = design.d_1, design.f, design.aperture.distance
        # From the microlens through the middle of the FAP, nothing but the lens between.
        height = at * (fap / d_1) / (1 + fap / d_1 - fap / f)
        slope = (height - at) / d_1 - height / f
        assert height + slope * fap == pytest.approx(0, abs=1e-12)
        z, x = 0.0, height
        saline = float(design.object_space.medium.index(design.wavelength))
        for number, element in enumerate(design.elements):
            x, z = x + slope * (element.distance - z), element.distance
            if element.kind == "lens":
                slope -= x / element.focal_length
            else:
                x, slope = through_rod(element, x, slope, saline if number == 2 else 1.0)
                z += element.thickness
        return x + slope * (z + focus - z), slope

    (low, slope), (high, other) = met(x0), met(x1)
    sheet = roslf.specification(design)
    assert sheet.object_field[1].width_mm == pytest.approx(abs(high - low), rel=1e-8)
    told = math.degrees(abs(math.atan(slope) - math.atan(other)))
    assert sheet.field_of_view_deg[0].width == pytest.approx(told, rel=1e-8)
    assert round(told, 2) == 20.99


def test_a_tilted_window_bends_rays_as_its_own_faces_do():
    """A plate turned by 12 degrees, in vectors; the first order keeps the ray's direction and gets its shift wrong."""
    turn = math.radians(12.0)
    window = {"kind": "plate", "distance": 150.0, "thickness": 8.0, "material": {"index": 1.7}, "tilt": (0.0, turn)}
    design = PAPER.replace({"elements": [window], "object_space.medium": "water"})
    camera, water = Camera.of(design), float(design.object_space.medium.index(design.wavelength))
    normal = np.array([math.sin(turn), 0.0, math.cos(turn)])
    for x, y in ((6.0, 0.0), (-8.0, 5.0), (0.0, 0.0)):
        d_1, f, fap = design.d_1, design.f, design.aperture.distance
        at = np.array([x, y])
        height = at * (fap / d_1) / (1 + fap / d_1 - fap / f)
        slope = (height - at) / d_1 - height / f
        point, way = np.array([*height, 0.0]), np.array([*slope, -1.0])
        way /= np.linalg.norm(way)
        back = np.array([0.0, 0.0, -150.0])
        for vertex, ratio in ((back, 1 / 1.7), (back - 8 * normal, 1.7 / water)):
            point = point + way * (((vertex - point) @ normal) / (way @ normal))
            cosine = -(way @ normal)
            way = ratio * way + (ratio * cosine - math.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal
        rays = chief_rays(camera, (x, y))
        met = point + way * ((-design.d_f - point[2]) / way[2])
        assert np.array(rays.on_plane(design.d_f)) == pytest.approx(met[:2], abs=1e-10)
        assert rays.directions == pytest.approx(way * [1, 1, -1], abs=1e-12)


@pytest.mark.parametrize("medium", ["air", "water"])
def test_telecentric_object_space_has_parallel_chief_rays_and_no_warnings(medium):
    """The FAP in the objective's focus: the scene sees it at infinity, all planes as large, none sharp to infinity."""
    lens = {"kind": "lens", "distance": 150.0, "focal_length": 40.0}
    window = {"kind": "plate", "distance": 152.0, "thickness": 2.0, "material": "N-BK7"}
    seen = {"elements": [lens, window], "object_space.medium": medium, "aperture.distance": 110.0}
    design = PAPER.replace({**seen, "microlens_array.distance": 130.0})
    sheet, told = roslf.specification(design), roslf.evaluate(design)
    assert sheet.field_of_view_deg[0].diagonal == pytest.approx(0, abs=1e-12)
    x0, x1, *_ = field_of(design)
    low, high = (Bore(design).on_plane(x, 0.0, 10.0)[0] for x in (x0, x1))
    assert [field.width_mm for field in sheet.object_field] == pytest.approx([abs(high - low)] * 3, rel=1e-12)
    assert told.non_distortion.field_half_width_mm == pytest.approx(abs(high - low) / 2, rel=1e-12)
    assert sheet.hyperfocal_mm is None
    assert sheet.view_hyperfocal_mm is None
    with pytest.raises(CalibrationError, match="telecentric object space"):
        SceneSide.of(design)
    swept = roslf.sweep(design, {"aperture.distance": [105.0, 110.0, 115.0]}, ["hyperfocal_mm", "field_half_angle_deg"])
    assert swept.valid.all()
    assert swept.values["field_half_angle_deg"][1] == pytest.approx(0, abs=1e-12)
