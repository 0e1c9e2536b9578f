"""A real main lens behind an objective that maps angles otherwise than f tan."""

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import roslf_design as roslf
from roslf_design.fates import RayFate
from roslf_design.tolerancing.metrics import Question, builds_of
from roslf_design.traced.camera import camera_of, sensor_of_pupil, views
from roslf_design.traced.images import field_map, real_field
from tests.tolerancing.alone import apart

from ..camera.test_mapping import mp_ray, table
from .test_elements import by_hand

FIELDS = np.array([[0.0, 0.0], [3.0, 0.0], [-2.0, 1.5], [6.0, 0.0]])
WINDOW = {"kind": "plate", "distance": 170.0, "thickness": 1.0, "material": {"index": 1.77, "abbe": 72.0}}
MAPPINGS = {"f theta": "f theta", "f sin": "f sin", "a table": table("f sin", last=60.0, focal_length=5.0)}


def scope(mapping, *more, fap=158.0, **changes):
    """The singlet bench looking at the image that a fisheye of 5 mm makes, a field lens on it for a FAP behind."""
    lens = {"kind": "lens", "distance": 160.0, "focal_length": 5.0, "mapping": mapping}
    field_lens = {"kind": "lens", "distance": 154.0, "focal_length": 3.9}
    base = {
        "elements": [lens, *([field_lens] if fap < 160 else []), *more],
        "aperture.distance": fap,
        "aperture.diameter": 0.5,
    }
    plane = {"main_lens.focal_plane": 190.0 if fap < 160 else 400.0, "microlens_array.distance": None}
    return roslf.load("paper-singlet").replace({**base, **plane, **changes})


@pytest.mark.parametrize("name", ["f theta", "f sin"])
@pytest.mark.parametrize("more", [(), (WINDOW,)], ids=["in air", "behind a window"])
def test_rays_are_those_of_the_lens_and_then_of_the_law(name, more):
    """Sphere by sphere through the singlet, then mapped, then by Snell's law, at 40 digits."""
    design = scope(name, *more)
    camera = camera_of(design)
    with mp.workdps(40):
        for c in FIELDS[[1, 3]]:  # the oracle is of a meridian
            p = sensor_of_pupil(camera, c, camera.fap.centre + np.array([0.1, 0.0])).sensor
            there = views(camera, c, p)
            assert there.state == RayFate.KEPT
            height = by_hand(design, p, c, 0.0)
            slope = height - by_hand(design, p, c, 1.0)
            x, o = mp_ray(design, height[0], slope[0], design.d_f, name)
            assert there.slope[0] == pytest.approx(float(o), rel=1e-11, abs=1e-14)
            assert there.at(design.d_f - design.d_3)[0] == pytest.approx(float(x), rel=1e-11, abs=1e-10)


@pytest.mark.parametrize("mapping", MAPPINGS)
@pytest.mark.parametrize("fap", [158.0, 166.0])
def test_light_from_points_of_the_scene_goes_the_same_way_back(mapping, fap):
    """Behind the FAP the mapping is undone, before it aimed through."""
    camera = camera_of(scope(MAPPINGS[mapping], fap=fap))
    fields = FIELDS if fap < 160 else FIELDS / 3  # farther out the singlet images that FAP onto itself, f tan as well
    pupil = camera.fap.centre + np.array([[0.0, 0.0], [0.2, 0.1], [-0.1, 0.15], [0.0, -0.2]])
    back = sensor_of_pupil(camera, fields, pupil)
    assert back.ok.all()
    point = back.views.at(camera.fap.z - camera.focal_plane)
    there = np.stack([*point.T, np.full(len(point), camera.focal_plane)])
    slopes, comes = camera.aimed(camera.fap.lifted(pupil), there, camera.wavelength)
    assert comes.all()
    lens = camera.train(camera.wavelength).lens
    ends = {"start": camera.fap.z, "end": camera.array.z, "backward": False, "clip": True}
    landed = lens.through(tuple(pupil.T), tuple(slopes), **ends)
    assert np.all(landed.state == RayFate.KEPT)
    assert_allclose(landed.height.T, fields, rtol=0, atol=1e-9)  # aimed to 1e-11 mm, magnified


def test_distortion_is_the_lenss_own_and_the_field_the_mappings():
    """Near the axis nothing is added; farther out the mapping's barrel is not the singlet's fault."""
    straight, bent = (field_map(camera_of(scope(m)), FIELDS) for m in ("f tan", "f sin"))
    assert_allclose(bent.distortion, straight.distortion, atol=1e-9)
    wider = np.hypot(*bent.object_point[-1]) / np.hypot(*straight.object_point[-1])
    assert wider > 1.1


def test_beyond_the_end_of_the_mapping_images_are_dark():
    short = {**MAPPINGS["a table"], "angles": MAPPINGS["a table"]["angles"][:9]}
    short["heights"] = MAPPINGS["a table"]["heights"][:9]  # to 15 degrees
    design = scope(short)
    field = real_field(design, FIELDS)
    assert field.images.kept_fraction[0] == 1.0
    assert field.images.kept_fraction[-1] == 0.0
    camera = camera_of(design)
    p = sensor_of_pupil(camera, FIELDS[-1], camera.fap.centre).sensor
    assert camera.describe(int(views(camera, FIELDS[-1], p).state)) == "clipped at lens 1, mapping"
    told = roslf.evaluate(design).to_dict()
    assert told["real_lens"]["fields"][-1]["status"] == "dark"


@pytest.mark.parametrize("fap", [158.0, 166.0])
def test_builds_are_the_cameras_traced_one_at_a_time(fap):
    """Image centres, diameters and kept fractions; room that is the lens's, or the mapping's own end in its image."""
    short = {key: values[:9] for key, values in MAPPINGS["a table"].items()}  # to 15 degrees, 1.29 mm of 5
    design = scope(short, fap=fap, **{"aperture.diameter": 0.02})
    question = Question(design, ("centre_error_px", "image_diameter_px"), ((1.0, 0.0),), design.d_f)
    values = {"elements.0.focal_length": np.array([5.0, 5.01]), "main_lens.decentre.0": np.array([0.05, 0.0])}
    builds, valid = builds_of(question, values, 2)
    assert valid.all()
    check = apart(design, builds, values)
    assert check.centre_px < 1e-6
    assert check.diameter_share < 1e-6
    assert check.kept_fraction < 1e-6
    assert np.all((np.asarray(builds.clearance) > 0) & (np.asarray(builds.clearance) < 1.3))
