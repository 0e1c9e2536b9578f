"""Pictures that depth is simulated with: what they show, what their rays scatter, and how far they are told to be."""

import numpy as np
import pytest

from roslf_design.camera import Camera
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import Framed, PictureOptions, Unexposed, Work, default_scene
from roslf_design.design import load, preset_names
from roslf_design.imaging import sampling, trace
from roslf_design.imaging.camera import Region
from roslf_design.imaging.sampling import rays_for
from roslf_design.reporting.depth.pages import ENOUGH
from roslf_design.scenes import Scene
from roslf_design.theory.photometry import electrons
from roslf_design.theory.quantities import QUANTITIES

PAPER = load("paper")
PART = (2264, 1504, 40, 40)


def pictures(design, seeds, rays, part=PART):
    """Pictures of the default scene by rays of several seeds, shape (seed, row, column), and the white one."""
    scene = default_scene(design)
    framed = Framed.of(design, scene, Region(*part))
    each = [Unexposed.of(design, scene, framed, seed=seed, rays=rays) for seed in seeds]
    return np.stack([one.scene.pixels for one in each]), each[0].white.pixels


def inner(picture):
    """Without the margin, which is not lit by all that lights it."""
    edge = (picture.shape[-1] - PART[2]) // 2
    return picture[..., edge:-edge, edge:-edge]


def test_rays_that_tell_only_what_differs_from_white_show_the_same_with_less_scatter(monkeypatch):
    told, white = pictures(PAPER, (1, 2, 3), 32)
    monkeypatch.setattr(Scene, "brightness", property(lambda scene: 0.0))
    all_of_it, _ = pictures(PAPER, (4,), 128)
    plain, _ = pictures(PAPER, (1, 2, 3), 32)
    told, plain, all_of_it = (inner(values) for values in (told, plain, all_of_it))
    level = float(all_of_it.mean() / inner(white).mean())
    shot = level / np.sqrt(float(electrons(Camera.of(PAPER))))
    # Light from beyond 96 pixels, 0.2 % of all, is taken as even by rays and as it is by the white picture.
    assert np.sqrt(((told.mean(0) - all_of_it) ** 2).mean()) < 0.002 * level
    assert np.sqrt(told.var(0, ddof=1).mean()) < 0.15 * shot
    assert told.var(0, ddof=1).mean() < plain.var(0, ddof=1).mean() / 4


@pytest.mark.usefixtures("near_light")
def test_rays_spread_evenly_over_blocks_scatter_less_and_are_not_beside(monkeypatch):
    design, part = load("ear-speculum"), (1204, 900, 32, 32)
    together, _ = pictures(design, range(4), 32, part)
    monkeypatch.setattr(sampling, "TOGETHER", 1)
    alone, _ = pictures(design, range(4), 32, part)
    # Their variances are a quarter; of four seeds and hundreds of independent pixels a half is far from chance.
    assert together.var(0, ddof=1).mean() < alone.var(0, ddof=1).mean() / 2
    assert abs((together - alone).mean()) < 0.1 * alone.std(0, ddof=1).mean()


@pytest.mark.parametrize("inside", [(3, 4, 5, 6), (0, 0, 9, 12), (2, 3, 0, 4), (0, 5, 9, 2)])
def test_what_is_around_a_part_is_all_else_once(inside):
    region, part = Region(0, 0, 9, 12), Region(*inside)
    counts = np.zeros((12, 9), int)
    for one in region.around(part):
        if one.rows > 0 and one.columns > 0:
            counts[one.row : one.row + one.rows, one.column : one.column + one.columns] += 1
    expected = np.ones((12, 9), int)
    if part.columns > 0:
        expected[part.row : part.row + part.rows, part.column : part.column + part.columns] = 0
    assert (counts == expected).all()


@pytest.mark.parametrize("name", [name for name in preset_names() if name != "mismatched-borescope"])
def test_the_default_part_holds_windows_enough_to_judge_by_and_costs_little(name):
    # Of the one left out, images overlap twofold: nothing is known there, however many windows are looked at.
    design = load(name)
    camera, part, window = Camera.of(design.thin_twin), PictureOptions().part(design), design.depth.window
    pitch = abs(float(QUANTITIES["image_pitch_mm"](camera) / camera.q))
    columns, rows = (int(size / pitch) - window + 1 for size in (part.columns, part.rows))
    assert columns * rows / window**2 >= ENOUGH
    # What is rendered around it counts: views behind a real lens look half a dozen microlenses past it.
    wide = Framed.of(design, None, part).wide
    assert wide.columns * wide.rows * rays_for(camera) < 5e7


@pytest.mark.usefixtures("few_rays")
def test_a_simulation_tells_how_far_it_is_in_every_phase_and_ends_at_all_of_it():
    told = []
    options = PictureOptions(region=(2240, 1480, 100, 100), exposures=2)
    simulate(PAPER, options=options, progress=lambda what, share: told.append((what, share)))
    assert {what for what, _ in told} == {"white", "picture", "depth"}
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    assert max(np.diff([0.0, *shares])) < 0.35
    for what in ("picture", "depth"):
        assert len({share for one, share in told if one == what}) > 3


def test_work_is_known_beforehand():
    one = Work.of(PAPER, PictureOptions(region=(2240, 1480, 100, 100)))
    more = Work.of(PAPER, PictureOptions(region=(2240, 1480, 200, 200), exposures=3, rays=64))
    assert more.seconds > 2 * one.seconds
    assert str(more) == "0.077 million pixels x 64 rays, 3 exposures"
    assert one.rays >= trace.FEWEST


def test_images_that_stops_cut_get_the_rays_of_gaps():
    """Rays scatter at a cut as at the rim of an image beside a gap: no neighbour shows what they miss."""
    camera = Camera.of(PAPER.replace({"main_lens.diameter": 20.0}))
    middle, side = Region(2200, 1440, 200, 200), Region(200, 1440, 200, 200)
    assert rays_for(camera, side) > rays_for(camera, middle) == rays_for(camera)


def test_rays_behind_a_lens_scatter_less_than_light_where_images_are_sharper_than_pixels():
    """Diffraction of half a pixel spreads nothing over others: of a quarter of the samples a wall was 6 % at odds."""
    sizes = {"microlens_array.size": (0.8, 0.8), "sensor.size": (0.7, 0.7), "aperture.diameter": 2.7}
    design = load("paper-singlet").replace({
        "main_lens.prescription": "AC050-008-A", "main_lens.reversed": False, "main_lens.diameter": None,
        "main_lens.focal_plane": 57.0, "aperture.distance": 1.8, "microlens_array.pitch": 0.03,
        "microlens_array.focal_length": 0.0925, "sensor.distance": 0.0925, "sensor.pixel": 0.00345, **sizes,
    })  # fmt: skip
    camera, (width, height) = Camera.of(design.thin_twin), design.pixels
    part = (width // 2 - 20, height // 2 - 20, 40, 40)
    (some,), white = pictures(design, (1,), rays_for(camera), part)
    (many,), _ = pictures(design, (1,), 8 * rays_for(camera), part)
    scatter = float(np.sqrt((inner(some - many) ** 2).mean()) / inner(many).mean() * inner(white).mean())
    assert scatter < 0.2 / np.sqrt(float(electrons(camera)))
