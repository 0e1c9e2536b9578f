"""Cameras with real main lenses, made from a design, and the rays of one microlens through them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..design import Design, DesignError
from ..errors import InputError
from ..lenses.camera import LensCamera
from ..lenses.first_order import first_order
from ..lenses.lens_file import load_lens, shipped_names
from ..lenses.of_design import camera_of

Floats = NDArray[np.float64]

RAYS = 1024
"""Of one microlens, all over the FAP."""
EVERY = 16
"""Of so many rays one is traced with many digits."""
FIELD = 0.35
"""Field that the surrogate is fitted for, as a part of the array's width."""


def with_lens(design: Design, name: str) -> Design | None:
    """A design behind a shipped lens: lengths that go with the main lens's focal length scaled by it.

    Returns
    -------
    Design or None
        None where the lens does not suit the design (parts collide).
    """
    grow = first_order(load_lens(name), design.wavelength).focal_length / design.f
    array, sensor = design.microlens_array, design.sensor
    values = {
        "name": f"{design.name} behind {name}",
        "main_lens": {"prescription": name, "focal_plane": design.d_f * grow},
        "aperture": {"diameter": design.D_F * grow, "distance": design.d_3 * grow},
        "microlens_array": {
            "pitch": array.pitch, "focal_length": design.f_ml, "size": tuple(side * grow for side in array.size),
        },
        "sensor": {
            "distance": design.d_2, "pixel": sensor.pixel, "relay_magnification": sensor.relay_magnification,
            "size": tuple(side * grow for side in sensor.size),
        },
        "light": {"wavelength": design.wavelength},
    }  # fmt: skip
    try:
        made = Design.model_validate(values)
        camera_of(made)
    except (InputError, ValueError):
        return None
    return made


def lens_designs(design: Design) -> dict[str, Design]:
    """The design's own real lens, if it has a traceable one, then every shipped lens in its place."""
    found = {}
    if design.lens is not None and _plain(design):
        found[design.lens.name or "own lens"] = design
    thin = design.thin_twin
    for name in shipped_names():
        made = with_lens(thin, name.upper())
        if made is not None and name.upper() not in (key.upper() for key in found):
            found[name.upper()] = made
    return found


def _plain(design: Design) -> bool:
    """Centred, upright and without aspheric terms: what surrogate and reference are for."""
    lens = design.lens
    return lens is not None and design.aligned and lens.is_centred and not any(s.asphere for s in lens.surfaces)


def random_lens_design(design: Design, rng: np.random.Generator) -> Design:
    """A shipped lens behind another aperture, elsewhere."""
    names = shipped_names()
    while True:
        scale, share = float(rng.uniform(0.5, 1.3)), float(rng.uniform(0.5, 1.4))
        thin = design.thin_twin
        try:
            other = thin.replace({"aperture.diameter": thin.D_F * scale, "aperture.distance": thin.d_3 * share})
        except DesignError:
            continue
        made = with_lens(other, names[int(rng.integers(len(names)))].upper())
        if made is not None:
            return made


@lru_cache(maxsize=64)
def microlens_rays(design: Design, axis: tuple[float, float]) -> tuple[Floats, Floats]:
    """Image-side slopes (2, RAYS) of the rays from one microlens's centre that fill nine tenths of the FAP.

    By the thin twin's formulas: through the real lens they land a little elsewhere on the FAP; the same rays for every
    method.
    """
    k = np.arange(RAYS) + 0.5
    radius, turn = 0.45 * design.D_F * np.sqrt(k / RAYS), k * math.pi * (3 - math.sqrt(5))
    pupil = np.stack([radius * np.cos(turn), radius * np.sin(turn)])
    gap = 1 - design.d_3 / design.f
    place = np.array(axis)[:, None]
    slopes = (place * gap - pupil) / (design.d_1 * gap + design.d_3)
    return np.broadcast_to(place, slopes.shape).copy(), slopes


def exact_ends(camera: LensCamera, place: Floats, slope: Floats, digits: int) -> list[tuple[Any, Any]]:
    """Where rays cross the focal plane, by intersecting conics and Snell's law in vectors at many digits."""
    from .digits import many_digits

    mp = many_digits()
    lens = camera.lens
    glasses = [float(surface.glass.index(camera.wavelength)) for surface in lens.surfaces]
    found = []
    with mp.workdps(digits):
        for (x, y), (sx, sy) in zip(place.T.tolist(), slope.T.tolist(), strict=True):
            p = [mp.mpf(x), mp.mpf(y), mp.mpf(camera.mla)]
            d = [-mp.mpf(sx), -mp.mpf(sy), mp.mpf(-1)]
            d = _unit(d, mp)
            for number in range(len(lens.surfaces) - 1, -1, -1):
                surface, vertex = lens.surfaces[number], mp.mpf(lens.vertices[number])
                ahead = mp.mpf(glasses[number - 1]) if number else mp.mpf(1)
                p, normal = _meet(p, d, vertex, mp.mpf(surface.curvature), mp.mpf(surface.conic), mp)
                d = _bend(d, normal, mp.mpf(glasses[number]) / ahead, mp)
            step = (mp.mpf(camera.focal_plane) - p[2]) / d[2]
            found.append((p[0] + step * d[0], p[1] + step * d[1]))
    return found


def _unit(v: list[Any], mp: Any) -> list[Any]:
    size = mp.sqrt(sum(part * part for part in v))
    return [part / size for part in v]


def _meet(p: list[Any], d: list[Any], vertex: Any, c: Any, k: Any, mp: Any) -> tuple[list[Any], list[Any]]:
    """Point on a conic and its unit normal along +z: c (x^2 + y^2 + (1 + k) z^2) = 2 z."""
    x, y, z = p[0], p[1], p[2] - vertex
    a = c * (d[0] ** 2 + d[1] ** 2 + (1 + k) * d[2] ** 2)
    b = c * (x * d[0] + y * d[1] + (1 + k) * z * d[2]) - d[2]
    e = c * (x * x + y * y + (1 + k) * z * z) - 2 * z
    # The root near the vertex: e/(-b +- sqrt(b^2 - a e)), the sign that adds.
    root = mp.sqrt(b * b - a * e)
    step = e / (-b + root if b < 0 else -b - root)
    x, y, z = x + step * d[0], y + step * d[1], z + step * d[2]
    normal = _unit([-c * x, -c * y, 1 - c * (1 + k) * z], mp)
    return [x, y, z + vertex], normal


def _bend(d: list[Any], n: list[Any], ratio: Any, mp: Any) -> list[Any]:
    """Snell's law, `ratio` being index before over index after."""
    along = sum(a * b for a, b in zip(d, n, strict=True))
    if along < 0:
        n, along = [-part for part in n], -along
    after = mp.sqrt(1 - ratio**2 * (1 - along**2))
    return [ratio * a + (after - ratio * along) * b for a, b in zip(d, n, strict=True)]


def panels_of(design: Design) -> Iterator[tuple[str, Design, tuple[float, float]]]:
    """Name, camera and microlens of each panel."""
    for name, camera in lens_designs(design).items():
        yield name, camera, (0.25 * camera.microlens_array.size[0], 0.1 * camera.microlens_array.size[0])
