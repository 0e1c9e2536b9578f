"""A FAP behind the main lens, as the scene sees it, and the stop behind an ideal lens that makes it.

Oracles: rays traced here through lens and stop, numbers that others published, and the two ways to say the same.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import roslf_design as roslf
from roslf_design.calibration.model import CalibrationError
from roslf_design.calibration.planning import Captures
from roslf_design.camera import Camera
from roslf_design.depth.geometry import depth_of
from roslf_design.design import Design, DesignError, dumps, loads
from roslf_design.design.sequence import sequence_of
from roslf_design.reporting.design.pages import design_report
from roslf_design.theory.quantities import QUANTITIES
from tests.laws import DEAR
from tests.reporting.made import few_builds

F193 = Path(__file__).parents[2] / "studies/instruments/hahne-f193.toml"


def behind(t: float, diameter: float, f: float = 50.0, **others: object) -> Design:
    """Camera with a stop behind its ideal lens."""
    paper = roslf.load("paper")
    changes = {"main_lens.focal_length": f, "main_lens.focal_plane": 8 * f, "main_lens.diameter": 0.6 * f}
    stop = {"aperture.distance": None, "aperture.behind": t, "aperture.diameter": diameter}
    return paper.replace(changes | stop | others)


def sharp_edge(f: float, d_f: float, wide: float, t: float, diameter: float) -> float:
    """Largest height in focus of which all rays through the stop's edge pass the lens, traced and halved down to."""
    edge = diameter / 2 * np.array([-1.0, 1.0])
    d_1 = 1 / (1 / f - 1 / d_f)

    def clear(x: float) -> bool:
        image = -x * d_1 / d_f  # rays behind the lens run to the object's image
        at_lens = (edge - image * t / d_1) / (1 - t / d_1)
        return bool((np.abs(at_lens) <= wide / 2).all())

    low, high = 0.0, 1e4
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if clear(middle) else (low, middle)
    return low


@given(st.floats(0.05, 0.9), st.floats(0.05, 0.4))
def test_undistorted_field_is_what_rays_through_lens_and_stop_leave(share: float, wide: float) -> None:
    design = behind(share * 50.0, wide * 50.0 * (1 - share))
    traced = sharp_edge(50.0, 400.0, 30.0, design.aperture.behind, design.D_F)
    assert QUANTITIES["undistorted_field_mm"](Camera.of(design)) == pytest.approx(traced, rel=1e-9, abs=1e-9)


def test_field_of_a_pupil_at_minus_60() -> None:
    design = roslf.load("paper").replace(f=50.0, d_f=400.0, D=30.0, D_F=20.0, d_3=-60.0)
    assert QUANTITIES["undistorted_field_mm"](Camera.of(design)) == pytest.approx(145 / 3, rel=1e-13)


@given(st.floats(0.02, 0.95), st.floats(1.0, 8.0), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
@DEAR
def test_stop_and_pupil_it_is_seen_as_are_one_camera(share: float, wide: float, e: float, lens: float) -> None:
    own = behind(50.0 * share, wide, **{"aperture.decentre": (e, 0.0), "main_lens.decentre": (0.0, lens)})
    seen = own.with_seen_pupil
    again = seen.with_own_stop
    assert seen.d_3 == pytest.approx(-50 * share / (1 - share), rel=1e-13)
    assert again.aperture.behind == pytest.approx(own.aperture.behind, rel=1e-12)
    assert pytest.approx(own.D_F, rel=1e-12) == again.D_F
    np.testing.assert_allclose(again.aperture.decentre, own.aperture.decentre, atol=1e-12)
    for name in ("fill_factor", "undistorted_field_mm", "non_distortion_room_mm", "view_baseline_mm", "sigma_z_mm"):
        here, there = (float(QUANTITIES[name](Camera.of(design))) for design in (own, seen))
        # Rooms are differences of lengths of some 30 mm, some ulp of which remain.
        assert here == pytest.approx(there, rel=1e-9, abs=1e-11), name


def test_images_are_what_the_stop_passes_of_traced_rays() -> None:
    """A microlens at the corner, cut by the lens's rim: every ray from the sensor is followed to lens and stop."""
    cut = {"aperture.decentre": (0.3, -0.2), "main_lens.diameter": 24.0}
    design = behind(27.0, 9.0, **cut)
    c = Camera.of(design)
    x, y = 6.4, 4.8
    field = roslf.evaluate(design, [(x, y)]).fields[0]
    d_1, d_2 = float(c.seen.d_1), float(c.seen.d_2)
    side, n = 1.02 * float(c.seen.D_F) * d_1 / float(c.seen.A) * d_2 / d_1, 1500
    points = (np.arange(n) + 0.5) / n * side - side / 2
    middle = np.array(c.chief_point(x, y))
    u, v = np.meshgrid(middle[0] + points, middle[1] + points)
    slope = (u - x) / d_2, (v - y) / d_2
    lens = [at - s * d_1 for at, s in zip((x, y), slope, strict=True)]
    stop = [at + s * 27.0 - e for at, s, e in zip(lens, slope, (0.3, -0.2), strict=True)]
    through = np.hypot(*stop) <= 4.5
    both = through & (np.hypot(*lens) <= 12.0)
    assert 0.2 < both.sum() / through.sum() < 0.98
    assert field.kept_fraction == pytest.approx(both.sum() / through.sum(), abs=2e-3)  # 1500^2 cells across the disc
    middle = np.array([u[both].mean() - x, v[both].mean() - y])
    np.testing.assert_allclose(field.centroid_mm, middle, atol=2e-4 * side)


def test_moving_the_stop_moves_the_pupil_as_the_lens_images_it() -> None:
    design = behind(20.0, 5.0)
    builds = Camera.of(design, {"aperture.behind": np.array([20.0, 20.1]), "f": np.array([50.0, 50.5])})
    np.testing.assert_allclose(builds.seen.d_3, [-20 * 50 / 30, -20.1 * 50.5 / 30.4], rtol=1e-13)
    np.testing.assert_allclose(builds.seen.D_F, [5 * 50 / 30, 5 * 50.5 / 30.4], rtol=1e-13)
    np.testing.assert_array_equal(builds.ruler.d_3, [-20.0, -20.1])
    assert design.replace(d_3=-21.0).aperture.behind == 21.0


def test_telecentric_towards_the_scene_and_beyond() -> None:
    """A stop in the rear focal plane, and behind it: every quantity goes through, as far as it is finite."""
    near, at, past = (behind(t, 3.0, **{"main_lens.diameter": 45.0}) for t in (50 * (1 - 1e-7), 50.0, 50 * (1 + 1e-7)))
    for name in ("fill_factor", "sigma_z_mm", "vergence_at_mla_per_mm"):
        values = [float(QUANTITIES[name](Camera.of(design))) for design in (near, at, past)]
        assert values[1] == pytest.approx(values[0], rel=1e-5)
        assert values[1] == pytest.approx(values[2], rel=1e-5)


@pytest.mark.parametrize("t", [50.0, 54.0])
def test_what_needs_a_seen_pupil_says_so_where_the_scene_sees_none(t: float) -> None:
    design = behind(t, 0.6)
    with pytest.raises(DesignError, match=r"aperture.behind: 5. mm is not within the focal length f = 50 mm"):
        _ = design.with_seen_pupil
    with pytest.raises(CalibrationError, match="the scene sees the FAP at"):
        Captures.for_design(design)


def test_reports_leave_out_the_plane_of_pupils_where_the_scene_sees_none(monkeypatch: pytest.MonkeyPatch) -> None:
    few_builds(monkeypatch)
    names = [figure.name for figure in design_report(behind(50.0, 0.6)).figures]
    assert {"rays", "depth"} <= set(names)
    assert "plane" not in names


def test_files_say_the_stop_as_it_was_written() -> None:
    design = behind(12.0, 4.0)
    text = dumps(design)
    assert 'behind = "12 mm"' in text
    assert "distance" not in text.partition("[aperture]")[2].partition("[")[0]
    assert loads(text) == design


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"aperture.behind": 60.0}, "not between the main lens and the microlens array"),
        ({"aperture.behind": -3.0}, "greater than zero"),
        ({"aperture.behind": 12.0, "aperture.distance": 5.0}, "drop one of them"),
        ({"aperture.behind": None}, "Field required|is missing"),
        (
            {"main_lens.prescription": "LA1050-A", "main_lens.focal_length": None, "main_lens.diameter": None},
            "real lens",
        ),
    ],
)
def test_places_that_no_stop_can_have(changes: dict[str, object], words: str) -> None:
    with pytest.raises(DesignError, match=words):
        behind(12.0, 4.0).replace(changes)


def test_plane_parallel_glass_ahead_leaves_a_stop_behind_alone() -> None:
    glass = {"elements": [{"kind": "plate", "distance": 20.0, "thickness": 3.0, "material": "sapphire"}]}
    own = behind(27.0, 9.0).replace(glass)
    here, there = (roslf.evaluate(design) for design in (own, own.with_seen_pupil))
    for one, other in zip(here.effects, there.effects, strict=True):
        assert one.estimate == pytest.approx(other.estimate, rel=1e-6, abs=1e-9), one.name


def test_exported_sequences_meet_the_stop_behind_the_lens() -> None:
    rows = sequence_of(behind(12.0, 4.0).with_seen_pupil)
    assert [row.name for row in rows] == ["focal plane", "main lens", "FAP", "microlens", "sensor"]
    assert rows[1].surface.thickness == pytest.approx(12.0)
    real = roslf.load("paper-singlet").replace(d_3=-60.0, D_F=10.0)
    rows = sequence_of(real)
    assert [row.name for row in rows][:3] == ["focal plane", "FAP", "main lens, surface 1"]
    assert rows[1].surface.thickness == pytest.approx(-rows[1].z)  # to a virtual plane and back


def test_published_plenoptic_camera_refocuses_where_its_authors_say() -> None:
    """PlenoptiSign's unit test of the camera of Hahne et al. (2016), lens f193: six digits are given.

    It counts from the array: d_1 and the distance of the principal planes (-65.5563 mm) come on top.
    """
    design = roslf.load(F193)
    c = Camera.of(design)
    baseline = float(QUANTITIES["view_baseline_mm"](c))
    assert 6 * baseline == pytest.approx(3.7956, abs=5e-5)
    distance = float(depth_of(c, np.asarray(float(c.seen.D_F) / baseline)))  # one microlens a view
    assert distance + float(c.seen.d_1) - 65.5563 == pytest.approx(962.7459, abs=2e-3)
    assert math.isfinite(roslf.evaluate(design).f_number.fill_factor)


@pytest.mark.parametrize("window", [False, True])
def test_builds_on_both_sides_of_the_lens_are_each_as_alone(window: bool) -> None:
    """A FAP at the lens, missed by more than its distance."""
    glass = {"elements": [{"kind": "plate", "distance": 20.0, "thickness": 3.0, "material": "sapphire"}]}
    design = roslf.load("paper").replace(d_3=0.1).replace(glass if window else {})
    places = np.array([-0.2, -1e-9, 0.0, 0.1, 0.4])
    builds = Camera.of(design, {"d_3": places})
    assert builds.valid.all()
    for name in ("fill_factor", "undistorted_field_mm", "non_distortion_room_mm", "sigma_z_mm", "total_length_mm"):
        together = np.broadcast_to(QUANTITIES[name](builds), places.shape)
        alone = [float(QUANTITIES[name](Camera.of(design.replace(d_3=float(place))))) for place in places]
        # Disparity errors are interpolated in series that builds share.
        np.testing.assert_allclose(together, alone, rtol=1e-10, atol=1e-12, err_msg=name)
