"""The engine's view of a camera: values that compare, broadcast, and come from designs; statuses and samples."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from roslf_design.design import DesignBatch, load
from roslf_design.rays import Array, Lens, Sensor, Status, Stop, System, describe, trace
from roslf_design.rays.frames import light_order, rotation
from roslf_design.rays.sampling import pupil_samples, recurrence, sunflower
from tests.rays.systems import PAPER, random_system


def test_values_survive_every_round_trip():
    batch = replace(PAPER, lens=Lens(np.array([99.0, 100.0]), 50.8))
    for system in (PAPER, batch):
        again = pickle.loads(pickle.dumps(system))
        assert again == system
        assert hash(again) == hash(system)
        assert system != replace(system, sensor=Sensor(2.5))
        assert system != object()
    named = {"System": System, "Lens": Lens, "Stop": Stop, "Array": Array, "Sensor": Sensor}
    assert eval(repr(PAPER), {"__builtins__": {}}, named) == PAPER
    assert replace(PAPER, lens=Lens(100.0, 50.8, (-0.0, 0.0))) == PAPER
    assert hash(replace(PAPER, lens=Lens(100.0, 50.8, (-0.0, 0.0)))) == hash(PAPER)


def test_paper_design():
    assert System.from_design(load("paper")) == replace(PAPER, sensor=Sensor(2.0, (22.3, 14.932)))


def test_every_number_of_a_design_arrives():
    design = load("paper").replace(
        {
            "main_lens.decentre": (0.1, 0.2),
            "main_lens.tilt": (0.01, 0.02),
            "aperture.decentre": (0.3, 0.4),
            "aperture.tilt": (0.03, 0.04),
            "stops": [{"diameter": 5.0, "distance": 60.0, "decentre": (0.5, 0.6), "tilt": (0.05, 0.06)}],
            "microlens_array.layout": "hexagonal",
            "microlens_array.lens_shape": "circular",
            "microlens_array.rotation": 0.07,
            "microlens_array.tilt": (0.08, 0.09),
            "microlens_array.decentre": (0.7, 0.8),
            "sensor.tilt": (0.10, 0.11),
            "sensor.decentre": (0.9, 1.0),
            "sensor.relay_magnification": 0.5,
        }
    )
    assert System.from_design(design) == System(
        Lens(100.0, 50.8, (0.1, 0.2), (0.01, 0.02)),
        (Stop(2.9, 120.0, (0.3, 0.4), (0.03, 0.04)), Stop(5.0, 60.0, (0.5, 0.6), (0.05, 0.06))),
        Array(140.0, 2.0, 0.063, "hexagonal", "circular", (0.7, 0.8), (0.08, 0.09), 0.07),
        Sensor(2.0, (44.6, 29.864), (0.9, 1.0), (0.10, 0.11)),
    )


def test_a_batch_of_designs_is_a_batch_of_systems():
    batch = DesignBatch(load("paper"), {"aperture.decentre.0": [0.0, 0.5, 1.0]}, d_3=[100.0, 120.0, 140.0])
    system = System.from_design(batch)
    assert system.shape == (3,)
    for i in range(3):
        assert system.trial(i) == System.from_design(batch[i])
    spread = trace(system.spread(2), np.zeros((2, 4, 5)), (1.0, 0.0))
    assert spread.status.shape == (3, 4, 5)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"stops": ()}, "stops: 0 given"),
        ({"stops": (Stop(1.0, 1.0),) * 241}, "stops: 241 given"),
        ({"lens": Lens(0.0, 50.0)}, r"lens\.focal_length"),
        ({"lens": Lens(100.0, np.array([1.0, -1.0]))}, r"lens\.diameter"),
        ({"stops": (Stop(1.0, 1.0), Stop(np.nan, 1.0))}, r"stops\.1\.diameter"),
        ({"array": Array(0.0, 2.0, 0.063)}, r"array\.distance"),
        ({"sensor": Sensor(-1.0)}, r"sensor\.distance"),
        ({"lens": Lens(np.ones(2), 1.0), "sensor": Sensor(np.ones(3))}, "do not broadcast"),
    ],
)
def test_what_is_no_camera_is_refused_by_name(parts, message):
    with pytest.raises(ValueError, match=message):
        replace(PAPER, **parts)


def test_tilt_turns_the_normal_about_x_then_about_the_fixed_y():
    quarter = np.pi / 2
    np.testing.assert_allclose(rotation((quarter, 0.0))[:, 2], [0, -1, 0], atol=1e-16)
    np.testing.assert_allclose(rotation((0.0, quarter))[:, 2], [1, 0, 0], atol=1e-16)
    np.testing.assert_allclose(rotation((quarter, quarter))[:, 2], [0, -1, 0], atol=1e-16)
    np.testing.assert_allclose(rotation((0.0, 0.0), quarter)[:, 0], [0, 1, 0], atol=1e-16)
    rng = np.random.default_rng(0)
    axes = rotation((rng.normal(size=(3, 1)), rng.normal(size=4)), rng.normal(size=(3, 4)))
    np.testing.assert_allclose(
        np.einsum("ki...,kj...->ij...", axes, axes),
        np.broadcast_to(np.eye(3)[..., None, None], (3, 3, 3, 4)),
        atol=1e-15,
    )


def test_light_meets_the_farthest_stop_first_and_the_pupil_first_among_equals():
    stops = tuple(Stop(1.0, z) for z in (50.0, np.array([60.0, 50.0]), 50.0, 70.0))
    np.testing.assert_array_equal(light_order(replace(PAPER, stops=stops)).T, [[3, 1, 0, 2], [3, 0, 1, 2]])


def test_statuses_read_as_words():
    names = [describe(code) for code in range(6)]
    assert names[:3] == ["kept", "clipped by main lens", "outside its microlens"]
    assert describe(Status.APERTURE) == "clipped by flexible angular plane"
    assert describe(np.uint8(18)) == "clipped by stop 2"
    assert len({*names, describe(16), describe(255)}) == 8
    for wrong in (6, 15, 256, -1):
        with pytest.raises(ValueError, match="not a ray status"):
            describe(wrong)


@pytest.mark.parametrize("seed", [None, 3])
@pytest.mark.parametrize("microlens", [None, "square", "circular"])
def test_samples_fill_the_pupil_and_the_microlens_evenly(seed, microlens):
    count = 4096
    samples = pupil_samples(count, microlens=microlens, seed=seed)
    assert samples.shape == (4, count)
    assert np.all(np.hypot(samples[0], samples[1]) < 1)
    lines = np.random.default_rng(1).uniform([0, -1], [2 * np.pi, 1], (50, 2))
    for angle, offset in lines:
        share = np.mean(samples[0] * np.cos(angle) + samples[1] * np.sin(angle) < offset)
        exact = (np.pi - np.arccos(offset) + offset * np.sqrt(1 - offset**2)) / np.pi
        # Random samples would stray by up to 1/(2 sqrt(N)); even ones stay well within.
        assert abs(share - exact) < 0.5 / np.sqrt(count)
    if microlens is None:
        assert not samples[2:].any()
    elif microlens == "square":
        assert np.all(np.abs(samples[2:]) <= 1)
        np.testing.assert_allclose((samples[2:] ** 2).mean(axis=1), 1 / 3, rtol=0.01)
    else:
        assert np.all(np.hypot(samples[2], samples[3]) <= 1)
        np.testing.assert_allclose((samples[2:] ** 2).mean(axis=1), 1 / 4, rtol=0.01)
    if microlens is not None:
        np.testing.assert_allclose(np.corrcoef(samples), np.eye(4), atol=0.02)


def test_recurrence_steps_by_the_generalised_golden_ratio():
    golden = (np.sqrt(5) - 1) / 2
    np.testing.assert_allclose(recurrence(3, 1)[0], (0.5 + golden * np.arange(1, 4)) % 1, rtol=1e-13)
    plastic = 1.32471795724474602596
    np.testing.assert_allclose(recurrence(1, 2, 0.0)[:, 0], [1 / plastic, 1 / plastic**2], rtol=1e-13)
    assert sunflower(1).shape == (2, 1)


def test_random_systems_of_the_tests_differ():
    rng = np.random.default_rng(0)
    assert random_system(rng) != random_system(rng)
