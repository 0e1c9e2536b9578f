"""Ray budgets: they add up, agree with exact areas, and do not depend on who counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.microlens.images import microlens_images
from roslf_design.rays import Array, Lens, Sensor, Status, Stop, System, ray_budget, trace_pupil
from roslf_design.rays.sampling import pupil_samples
from tests.rays.systems import PAPER, random_points, random_system


def total(budget):
    parts = (budget.main_lens, budget.untraceable, budget.off_sensor, budget.neighbours, budget.own_cell)
    return budget.stops.sum(axis=-1) + sum(parts)


def test_paper_system_at_the_field_edge():
    budget = ray_budget(PAPER, (11.15, 0.0))
    numbers = budget.as_dict()
    assert (numbers["fap"], numbers["main_lens"]) == (1.0, 1.0)
    assert "stops" not in numbers
    # A disc of 0.0630435 mm in a square of 0.0627261 mm: four segments lie outside.
    radius, half = 0.0630434782608696 / 2, 0.0627260869565217 / 2
    segment = radius**2 * np.arccos(half / radius) - half * np.sqrt(radius**2 - half**2)
    exact = 1 - 4 * segment / (np.pi * radius**2)
    assert round(exact, 4) == 0.9991
    assert abs(numbers["own_cell"] - exact) < numbers["standard_error"] < 1.5e-4
    assert numbers["rays"] == budget.rays == 65536


@given(st.integers(0, 10**6), st.booleans(), st.sampled_from([None, 0, 7]), st.integers(1, 400))
def test_every_ray_is_counted_once(seed, finite_microlens, sampling_seed, rays):
    rng = np.random.default_rng(seed)
    system = random_system(rng, stops=3)
    system = replace(system, sensor=replace(system.sensor, size=(20 * system.array.pitch, 10 * system.array.pitch)))
    _, c, _ = random_points(system, rng, 4)
    budget = ray_budget(system, c, rays=rays, finite_microlens=finite_microlens, seed=sampling_seed)
    np.testing.assert_array_equal(total(budget), rays)
    assert np.all(budget.stops[:, 0] == 0)
    np.testing.assert_array_equal(
        np.min([budget.past_stops.min(axis=-1), budget.past_main_lens], axis=0), budget.past_main_lens
    )
    np.testing.assert_array_equal(
        budget.past_main_lens, rays - budget.untraceable - budget.main_lens - budget.stops.sum(axis=-1)
    )


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize("finite_microlens", [False, True])
def test_compiled_and_numpy_count_alike(layout, finite_microlens):
    rng = np.random.default_rng(4)
    for tilted in (False, True):
        system = random_system(rng, stops=3, tilted=tilted)
        d = system.array.pitch
        lens = replace(system.lens, diameter=system.lens.diameter * rng.uniform(0.3, 1.5, (5, 1)))
        system = replace(system, lens=lens, array=replace(system.array, layout=layout))
        system = replace(system, sensor=replace(system.sensor, size=(15 * d, 12 * d)))
        _, c, _ = random_points(system, rng, 7)
        one, other = (
            ray_budget(system, c, rays=70_000, finite_microlens=finite_microlens, compiled=way) for way in (False, True)
        )
        assert one == other
        assert one.own_cell.shape == (5, 7)
        assert 0 < one.own_cell.sum() < one.own_cell.size * one.rays


def test_counts_agree_with_exact_areas():
    rng = np.random.default_rng(10)
    partly = 0
    for _ in range(60):
        system = random_system(rng, stops=3, tilted=False)
        system = replace(system, lens=replace(system.lens, decentre=(0.0, 0.0)))
        array = replace(system.array, decentre=(0.0, 0.0))
        system = replace(system, array=array, sensor=replace(system.sensor, decentre=(0.0, 0.0)))
        _, c, _ = random_points(system, rng, 5)
        budget = ray_budget(system, c, rays=4096)
        f, d_1 = system.lens.focal_length, array.distance
        images = microlens_images(
            c.T,
            [*(stop.diameter for stop in system.stops), system.lens.diameter],
            [*(stop.distance for stop in system.stops), 0.0],
            [*(stop.decentre for stop in system.stops), (0.0, 0.0)],
            focal_length=f,
            focal_plane=f * d_1 / (d_1 - f),
            mla_distance=d_1,
            sensor_distance=system.sensor.distance,
        )
        share = budget.fraction(budget.past_main_lens)
        assert np.all(np.abs(share.value - images.kept_fraction) < 3 * share.error)
        partly += np.sum((images.kept_fraction > 0.01) & (images.kept_fraction < 0.99))
    assert partly > 50


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
def test_own_cell_is_what_lies_nearest_to_the_chief_ray(layout):
    for rotation in (0.0, 0.4):
        array = replace(PAPER.array, layout=layout, rotation=rotation, decentre=(0.01, 0.02))
        system = System(Lens(100.0, 200.0), (Stop(5.0, 120.0),), array, Sensor(2.0))
        c = np.array([3.0, -2.0])
        step = [[1, 0], [0, 1]] if layout == "square" else [[1, 0], [0.5, np.sqrt(0.75)]]
        grid = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)])
        axes = c + array.pitch * grid @ np.array(step)
        chief = np.stack(trace_pupil(system, (0.0, 0.0), axes.T).sensor)
        pupil = pupil_samples(3000)[:2]
        rays = trace_pupil(system, pupil, (c[0], c[1]))
        landed = np.stack(rays.sensor)
        nearest = np.argmin(np.hypot(*(landed[:, :, None] - chief[:, None])), axis=1)
        own = (grid[nearest] == 0).all(axis=1)
        np.testing.assert_array_equal(rays.status == Status.KEPT, own)
        assert 0.2 < own.mean() < 0.9


@given(st.integers(0, 10**6), st.floats(1.0, 2.0))
def test_wider_openings_pass_no_fewer_rays(seed, growth):
    rng = np.random.default_rng(seed)
    system = random_system(rng, stops=2)
    _, c, _ = random_points(system, rng, 3)
    wider_stop = replace(system.stops[1], diameter=system.stops[1].diameter * growth)
    wider = replace(system, stops=(system.stops[0], wider_stop))
    wider_lens = replace(system, lens=replace(system.lens, diameter=system.lens.diameter * growth))
    before = ray_budget(system, c, rays=300)
    for other in (wider, wider_lens):
        after = ray_budget(other, c, rays=300)
        assert np.all(after.past_main_lens >= before.past_main_lens)
        assert np.all(after.own_cell >= before.own_cell)


def test_stops_take_in_the_order_of_light():
    # A rim in front of the pupil, one behind it, then the lens; each takes its own part of a field far off axis.
    front, behind = Stop(60.0, 200.0), Stop(30.0, 60.0)
    system = replace(PAPER, lens=Lens(100.0, 36.0), stops=(PAPER.stops[0], behind, front))
    fields = np.linspace(0, 40, 81)
    budget = ray_budget(system, (fields, 0.0), rays=2000)
    np.testing.assert_array_equal(np.broadcast_to(budget.order, (3,)), [2, 0, 1])
    past = budget.past_stops
    np.testing.assert_array_equal(past[:, 2], 2000 - budget.stops[:, 2])
    np.testing.assert_array_equal(past[:, 0], past[:, 2])
    np.testing.assert_array_equal(past[:, 1], past[:, 0] - budget.stops[:, 1])
    np.testing.assert_array_equal(budget.past_main_lens, past[:, 1] - budget.main_lens)
    assert budget.stops[:, 1].any()
    assert budget.stops[:, 2].any()
    numbers = budget.as_dict(40)
    assert numbers["stops"] == [past[40, 1] / 2000, past[40, 2] / 2000]


def test_light_past_the_sensors_edge_is_off_the_sensor():
    budget = ray_budget(replace(PAPER, stops=(Stop(2.9, 20.0),)), (np.array([0.0, 11.15]), 0.0), rays=500)
    np.testing.assert_array_equal(budget.off_sensor, [0, 500])
    np.testing.assert_array_equal(budget.own_cell, [500, 0])


def test_a_pupil_imaged_onto_the_array_is_all_untraceable():
    # Binary fractions: f = 64, d_1 = d_f = d_3 = 128.
    system = System(Lens(64.0, 50.0), (Stop(2.0, 128.0),), Array(128.0, 2.0, 0.0625), Sensor(2.0))
    for compiled in (False, True):
        budget = ray_budget(system, (1.0, 0.0), rays=50, compiled=compiled)
        assert budget.untraceable == 50
        assert budget.as_dict()["fap"] == 0.0


def test_error_is_never_nought_and_covers_repeats():
    sure = ray_budget(PAPER, (0.0, 0.0), rays=1000)
    assert sure.fraction(sure.past_main_lens).value == 1.0
    assert 0 < sure.fraction(sure.past_main_lens).error < 2e-3
    wide = replace(PAPER, stops=(Stop(4.0, 120.0),))
    repeats = [ray_budget(wide, (5.0, 1.0), rays=1000, seed=seed) for seed in range(24)]
    shares = np.array([b.fraction(b.own_cell).value for b in repeats])
    assert 0 < shares.std(ddof=1) < repeats[0].fraction(repeats[0].own_cell).error
    assert repeats[3] == ray_budget(wide, (5.0, 1.0), rays=1000, seed=3)
    assert repeats[3] != repeats[4]


def test_no_rays_is_an_error():
    with pytest.raises(ValueError, match="at least 1"):
        ray_budget(PAPER, (0.0, 0.0), rays=0)
