"""A design's real lens, traced: where parts stand, what evaluate says of it, and the sizes of its effects."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roslf_design._jit import Kernel
from roslf_design.cli import main
from roslf_design.design import DesignError, dumps, load
from roslf_design.effects import Budget, PlanError, SceneBrief, plan
from roslf_design.effects.lens import lens_aberrations
from roslf_design.errors import InputError
from roslf_design.evaluation import evaluate
from roslf_design.fates import ImageFate
from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.prescription import Prescription, Surface
from roslf_design.traced.camera import camera_of
from roslf_design.traced.images import measured_bound, real_field, real_images
from tests.lenses.test_in_design import real
from tests.lenses.vector_rays import Rays, trace

from .test_images import mounted

FIELDS = [(0.0, 0.0), (6.0, 0.0), (11.15, 0.0), (8.0, -5.0)]


@pytest.mark.parametrize("turned", [False, True])
def test_distances_count_from_the_principal_planes(turned):
    design = real("AC508-100-A").replace({"main_lens.reversed": turned})
    camera = camera_of(design)
    ours = (camera.d_f, camera.d_3, camera.d_1, camera.d_2)
    assert ours == pytest.approx((350.0, 120.0, design.d_1, 2.0), rel=1e-13)
    other = mounted(design.lens, 2.9, focal_plane=350.0)
    assert_allclose(real_field(design, FIELDS).images.chief, real_images(other, FIELDS).chief, atol=1e-12)


def test_moving_the_lens_is_moving_everything_else():
    """The same camera, seen from the lens or from the bench."""
    design = real("LB1630-A")
    moved = {"main_lens.decentre": (0.3, -0.2)}
    others = {"aperture.decentre": (-0.3, 0.2), "microlens_array.decentre": (-0.3, 0.2)}
    one, two = (real_field(design.replace(change), FIELDS) for change in (moved, others))
    for name in ("shift", "widening", "lateral_colour", "rim_shift"):
        assert_allclose(getattr(one, name), getattr(two, name), atol=1e-11)
    assert_allclose(one.images.chief, two.images.chief, atol=1e-12)


def test_a_turned_array_sees_turned_fields():
    turned = real().replace({"microlens_array.rotation": math.pi / 2})
    straight = real_field(real(), [(0.0, 7.0)])
    assert_allclose(real_field(turned, [(7.0, 0.0)]).images.chief, straight.images.chief, atol=1e-12)


def test_a_ball_lens_may_turn_about_its_centre():
    glass = find_glass("N-BK7")
    ball = Prescription((Surface(1 / 60, 50.0, 120.0, glass), Surface(-1 / 60, 50.0)), "ball")
    straight = real().replace({"main_lens.prescription": ball, "main_lens.focal_plane": 400.0})
    tilted = straight.replace({"main_lens.tilt": (0.02, -0.03)})
    one, two = real_field(straight, FIELDS), real_field(tilted, FIELDS)
    assert_allclose(one.images.outline, two.images.outline, atol=1e-11)
    assert not np.allclose(
        real_field(real(), FIELDS).images.chief,
        real_field(real().replace({"main_lens.tilt": (0.02, -0.03)}), FIELDS).images.chief,
        atol=1e-4,
    )


def test_tilts_and_fields_mirror():
    one = real_field(real().replace({"main_lens.tilt": (0.0, 0.01)}), [(7.0, 2.0)])
    two = real_field(real().replace({"main_lens.tilt": (0.0, -0.01)}), [(-7.0, 2.0)])
    assert_allclose(one.images.chief * [-1, 1], two.images.chief, atol=1e-12)


def test_towards_the_axis_the_thin_lens_holds():
    """Departures fall with the cube of the field (shift) and its square (widening)."""
    design = real("AC254-100-A").replace(D_F=0.05)
    found = real_field(design, [(4.0, 0.0), (2.0, 0.0), (1.0, 0.0)])
    shift = np.abs(found.shift[:, 0])
    assert_allclose(shift[:-1] / shift[1:], 8.0, rtol=0.06)
    assert_allclose(found.widening[:-1] / found.widening[1:], 4.0, rtol=0.06)


def test_images_that_are_cut_or_folded_have_no_made_up_numbers():
    design = real("LA1050-A")
    found = evaluate(design, [0.0, 11.15, (11.15, 7.466)]).real_lens
    assert [field.status for field in found.fields] == ["full", "folded", "dark"]
    dark = found.fields[2]
    assert dark.chief_ray == "missed surface 1"
    assert (dark.centre_mm, dark.diameter_mm, dark.shift_px, dark.widening_percent, dark.blur_pitches) == (None,) * 5
    assert dark.kept_fraction == 0
    assert not found.undistorted_in_field


def verdict(result, name):
    return next(each for each in result.verdicts if each.name == name)


def test_the_field_s_verdict_is_the_traced_lens_s():
    """Behind the plano-convex lens Eq. 6 promises the whole sensor; the traced lens clips its corner."""
    turned = evaluate(real("LA1050-A", reversed="true"))
    assert turned.non_distortion.undistorted_in_field
    field = verdict(turned, "field_undistorted")
    assert not field.ok
    assert "12.94 mm on the MLA" in field.text
    assert "Eq. 6: 17.61 mm" in field.text
    assert "other way round" not in field.remedy  # it sees less so
    folded = verdict(evaluate(real("LA1050-A")), "field_undistorted")
    assert "folded over (a caustic of the pupil) at 11.1697, 0 mm" in folded.text
    assert folded.remedy.startswith("the other way round the lens sees whole images out to 12.94 mm")
    good = evaluate(real("LB1630-A"))
    assert verdict(good, "field_undistorted").ok
    assert not verdict(good, "thin_lens_holds").ok
    fine = evaluate(real("AC508-150-A"), [1.0])
    assert verdict(fine, "thin_lens_holds").ok
    x_ml = measured_bound(real("LB1630-A"))[1]
    just = evaluate(real("LB1630-A"), [x_ml * (1 - 1e-6), x_ml * (1 + 1e-6)]).real_lens
    assert [field.status for field in just.fields] == ["full", "clipped"]


def test_evaluate_prints_and_writes_the_traced_lens(tmp_path, capsys):
    path = tmp_path / "d.toml"
    path.write_text(dumps(real("LA1050-A").replace({"sensor.tilt": (0.01, 0.0)})))
    assert main(["evaluate", str(path), "--json", "--field", "11.15"]) == 0
    lens = json.loads(capsys.readouterr().out)["real_lens"]
    assert lens["lens"] == "LA1050-A"
    assert lens["fields"][0]["status"] == "folded"
    assert main(["evaluate", str(path), "--all"]) == 0
    out = capsys.readouterr().out
    assert "Microlens images through the real lens" in out
    assert "-0.0" not in out.split("real lens, against")[1].split("Effects")[0].replace("-0.0001", "")


def test_parts_that_collide_are_an_error_of_the_input():
    with pytest.raises(InputError, match=r"aperture.distance: lies .* inside the lens"):
        evaluate(real("AC508-100-A", reversed="true").replace(d_3=5.0))
    with pytest.raises(DesignError, match="no such file"):
        real().replace({"main_lens.prescription": "none.toml"})


def spun(vector, tilt, at):
    """Turned about x, then about y, about a place."""
    x, y, z = vector
    (sx, sy), (cx, cy) = np.sin(tilt), np.cos(tilt)
    y, z = y * cx - z * sx, y * sx + z * cx
    return np.array([x * cy + z * sy, y, z * cy - x * sy]) + at


def test_tilted_parts_are_traced_where_they_stand():
    """Outlines come from the tilted rim's own points, along rays from the tilted sensor through the tilted array."""
    tilts = {
        "aperture": (0.2, -0.1),
        "microlens_array": (0.01, 0.02),
        "sensor": (-0.03, 0.01),
        "main_lens": (0.004, 0.0),
    }
    design = (
        real()
        .replace({f"{part}.tilt": tilt for part, tilt in tilts.items()})
        .replace(
            {"aperture.decentre": (0.1, 0.2), "microlens_array.decentre": (0.3, 0.0), "sensor.decentre": (0.2, -0.1)}
        )
    )
    camera, axis = camera_of(design), np.array([6.0, 3.0])
    images = real_field(design, [axis]).images
    assert images.status[0] == 2
    lens = spun((*axis, 0.0), tilts["microlens_array"], [0.3, 0.0, camera.array.z])
    for angle, point in zip(2 * np.pi * np.arange(96) / 96, images.outline[0], strict=True):
        on_sensor = point + axis + [0.3, 0.0] - [0.2, -0.1]
        pixel = spun((*on_sensor, 0.0), tilts["sensor"], [0.2, -0.1, camera.detector.z])
        ray = trace(camera.lens, Rays.between(pixel, lens), 550e-6, backward=True)
        rim = spun((1.45 * np.cos(angle), 1.45 * np.sin(angle), 0.0), tilts["aperture"], [0.1, 0.2, camera.fap.z])
        assert_allclose(np.cross(rim - ray.position, ray.direction), 0, atol=2e-10)


def test_tilts_change_the_thin_limit_as_they_should():
    """Behind a lens so weak in aberration that it is thin, a tilted FAP's image has the thin lens's area."""
    design = real("AC508-150-A").replace({"aperture.tilt": (0.3, 0.0), "aperture.diameter": 0.5})
    thin = evaluate(design.thin_twin, [(0.5, 0.0)]).fields[0]
    area = float(real_field(design, [(0.5, 0.0)]).images.area[0])
    straight = real_field(design.replace({"aperture.tilt": (0.0, 0.0)}), [(0.5, 0.0)]).images.area[0]
    assert area == pytest.approx(thin.area_mm2, rel=2e-3)
    assert area < 0.97 * straight


def test_obliqueness_counts_behind_the_array_alone():
    """A traced lens conserves etendue: what cos^4 costs in front of it shows in the size of the microlens images."""
    design, edge = real(), 11.0
    brief = SceneBrief(field_radius=edge)
    line = plan(design, brief)["cos4"]
    steepest = np.max(np.hypot(*real_field(design, [(edge, 0.0)]).images.outline[0].T)) / design.d_2
    assert line.estimate == pytest.approx(1 - math.cos(math.atan(steepest)) ** 4, rel=1e-9)
    assert "by cos⁴ of the steepest ray behind the array" in line.reason
    assert line.estimate < 0.25 * plan(design.thin_twin, brief)["cos4"].estimate


TEXTURED = SceneBrief(smallest_period=2.0, hard_edges=True, wavelengths=(480e-6, 550e-6, 630e-6))


def test_the_chief_ray_of_a_dark_image_ends_where_it_is_cut():
    """By lens alone it was kept, beside an image of which 0 % is."""
    slit = {"stops": [{"diameter": 3.0, "distance": 100.0}]}
    field = real_field(load("paper-singlet").replace({"aperture.diameter": 1.0, **slit}), [(0.0, 0.0), (12.0, 0.0)])
    assert field.images.kept_fraction.tolist() == [1.0, 0.0]
    assert field.chief == ("kept", "clipped at stop 1")


def test_cut_images_are_no_distortion():
    """Vignetting counts what is cut off them; their whole diameter was told as if they stood somewhere else."""
    design, x_ml = load("paper-singlet"), 13.05
    field = real_field(design, [(share * x_ml, 0.0) for share in (0.8, 1.0)])
    assert field.images.status.tolist() == [ImageFate.FULL, ImageFate.CLIPPED]
    assert lens_aberrations(design, x_ml).displaced == pytest.approx(field.rim_shift[0])


def test_estimates_are_the_worst_over_the_field():
    design = real("LB1630-A")
    x_ml = 11.0
    dense = real_field(design, [(x, 0.0) for x in np.linspace(0, x_ml, 23)])
    found = lens_aberrations(design, x_ml)
    assert found.displaced == pytest.approx(np.max(dense.rim_shift), rel=0.02)
    assert found.spread == pytest.approx(np.max(dense.maps.spread), rel=0.02)
    cone = design.D_F * design.d_f / (design.d_f - design.d_3) / design.d_1
    foci = np.maximum(np.abs(dense.maps.tangential_focus), np.abs(dense.maps.sagittal_focus))
    assert found.curvature == pytest.approx(np.max(foci) * cone, rel=0.02)
    assert (found.cut, found.whole_to) == (0.0, x_ml)


def test_plan_of_real_and_ideal_lenses():
    textured = plan(real(), TEXTURED)
    for name in ("lens_aberrations", "lens_distortion", "field_curvature", "lens_colour"):
        assert textured.on(name)
        assert "LB1630-A" in textured[name].reason
        assert plan(real().thin_twin, TEXTURED)[name].reason == "not modelled: ideal lens"
    white = plan(real())
    assert white.on("lens_distortion")
    assert [white[name].estimate for name in ("lens_aberrations", "field_curvature", "lens_colour")] == [0, 0, 0]
    assert not plan(real(), overrides=["-lens_distortion"]).on("lens_distortion")
    assert plan(real(), overrides=["+lens_colour"]).on("lens_colour")
    with pytest.raises(PlanError, match="needs a traced main lens"):
        plan(real().thin_twin, overrides=["+lens_colour"])
    near = plan(real(), SceneBrief(field_radius=0.5), Budget(px=0.1))
    assert not near.on("lens_distortion")


def test_vignetting_by_the_traced_lens_counts():
    turned = real("LA1050-A", reversed="true")
    assert plan(turned.thin_twin)["vignetting"].estimate == 0
    line = plan(turned)["vignetting"]
    assert line.on
    assert "LA1050-A reversed, traced" in line.reason


def test_colour_is_what_the_foci_and_heights_of_the_colours_say():
    """An achromat's colours stay together; a singlet's part as f changes: lateral about x d_1 (df/f^2) d_3-ish."""
    single, double = (plan(real(name), TEXTURED)["lens_colour"].estimate for name in ("LB1630-A", "AC508-100-A"))
    assert single > 4 * double
    one = SceneBrief(smallest_period=2.0, wavelengths=(550e-6,))
    assert plan(real(), one)["lens_colour"].estimate == 0


def test_interpreted_and_compiled_a_camera_is_the_same_to_the_bit(monkeypatch):
    """Which of the two runs hangs on what is on disk, and must not show: whole images, and cut ones."""
    runs, asked = [], []

    def pays(_kernel, _seconds):
        asked.append(len(runs))
        return bool(runs)

    monkeypatch.setattr(Kernel, "pays", pays)
    runs.append(evaluate(load("paper-singlet")).to_dict())
    runs.append(evaluate(load("paper-singlet")).to_dict())
    assert runs[0] == runs[1]
    assert set(asked) == {0, 1}  # neither was remembered from the other
