"""Methods of rays: kept fraction, area, centroid and pixels of one microlens image, rays of a real lens, depths.

Gauss panels integrate discs cut by boxes slice by slice. A slice at x runs from the highest lower edge to the lowest
upper edge of all curves there. Between the places where another curve takes over its length is smooth but for square
roots at the ends, which ``x = middle - half cos(pi u)`` removes: Gauss's rule in u then converges exponentially.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from roslf_design.camera import Camera
from roslf_design.shapes.coverage import coverage_image
from roslf_design.shapes.discs import intersect
from roslf_design.theory.light_field import depth_sigma
from roslf_design.traced.camera import camera_of

from .jobs import LENS, SIGMA_DISPARITY, Job, microlens_rays

Floats = NDArray[np.float64]

Kind = Literal["exact", "panels", "adaptive", "grid", "random", "sobol", "series", "fft", "huygens", "first order"]

BLOCK = 2_000_000
"""Samples held at a time."""
INSIDE = 0.6826894921370859
"""Share of a normal distribution within one standard deviation."""


@dataclass(frozen=True)
class Method:
    """One way to compute a quantity."""

    name: str
    quantity: str
    kind: Kind
    levels: tuple[int, ...]
    """Efforts, rising: samples, nodes, subpixels; (0,) where there is nothing to choose."""
    compute: Callable[[Job, int, int], Floats] = field(repr=False)
    """Result for a job, a level and a seed."""
    work: Callable[[Job, int], float] = field(repr=False)
    """Evaluations, which time is proportional to beyond a fixed part."""
    does: str = ""
    """One line for the table of methods."""
    tested_on: Callable[[Job], bool] = field(default=lambda job: True, repr=False)
    """Whether it can compute a job at all."""

    @property
    def random(self) -> bool:
        """Whether the result depends on the seed."""
        return self.kind in ("random", "sobol")


# --- points and slices ------------------------------------------------------------------------------------------------


def random_points(kind: Kind, count: int, seed: int) -> Floats:
    """Points in the unit square, shape (count, 2): independent, or scrambled Sobol."""
    if kind == "random":
        return np.random.default_rng(seed).random((count, 2))
    from scipy.stats.qmc import Sobol

    return np.asarray(Sobol(2, seed=seed).random(count))


def grid_points(count: int) -> Floats:
    """Centres of count x count squares, shape (count^2, 2)."""
    at = (np.arange(count) + 0.5) / count
    return np.stack([np.tile(at, count), np.repeat(at, count)], -1)


def inside(centres: Floats, radii: Floats, x: Floats, y: Floats) -> NDArray[np.bool_]:
    """Whether points lie in all discs."""
    kept = np.ones(np.broadcast_shapes(x.shape, y.shape), np.bool_)
    for (cx, cy), r in zip(centres, radii, strict=True):
        kept &= (x - cx) ** 2 + (y - cy) ** 2 <= r * r
    return kept


def covered_pixels(centres: Floats, radii: Floats, columns: int, rows: int, pixel: float = 1.0) -> Floats:
    """Share of each pixel, shape (rows, columns), that discs have in common; counted from pixel (0, 0)'s corner."""
    middle = (columns * pixel / 2, rows * pixel / 2)
    return np.asarray(
        coverage_image(
            np.zeros(2), centres, radii, pixel=pixel, size=(columns, rows), sensor_centre=middle, dtype=np.float64
        )
    )


@lru_cache(maxsize=64)
def gauss(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss's rule on [0, 1], weights right to some 1e-14 of themselves.

    numpy's lose two more digits at the ends, where 1 - x^2 cancels. Here Newton's method on ``P_n(cos t)`` finds the
    angle whose cosine a node is, from which both follow without a difference.
    """
    t = math.pi * (np.arange(count, 0, -1) - 0.25) / (count + 0.5)
    for _ in range(6):
        x = np.cos(t)
        before, here = np.ones_like(x), x
        for k in range(2, count + 1):
            before, here = here, ((2 * k - 1) * x * here - (k - 1) * before) / k
        slope = -count * (before - x * here) / np.sin(t)
        t = t - here / slope
    return np.cos(0.5 * t) ** 2, 1 / slope**2


@lru_cache(maxsize=64)
def panel_rule(count: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Gauss's rule, and the places and weights of the panels' map, from 0 to 2 in units of half a panel."""
    u, w = gauss(count)
    return u, w, 1 - np.cos(math.pi * u), math.pi * np.sin(math.pi * u) * w


def crossings(a: Floats, r: float, b: Floats, R: float) -> list[Floats]:
    """Points where two circles cross."""
    apart = b - a
    square = float(apart @ apart)
    t = 0.5 * (1 + (r - R) * (r + R) / square) if square else 0.0
    root = r * r / square - t * t if square else -1.0
    if root < 0:
        return []
    return [a + t * apart + side * math.sqrt(root) * apart[::-1] * [1, -1] for side in (-1, 1)]


def breaks(centres: Floats, radii: Floats, low: Floats, high: Floats) -> Floats:
    """Where slices change their curves, sorted, shape (P, B); the first and last are the ends (equal if empty)."""
    start = np.maximum(low[:, 0], np.max(centres[:, 0] - radii))
    end = np.maximum(np.minimum(high[:, 0], np.min(centres[:, 0] + radii)), start)
    places = [start, end]
    for (x, y), r in zip(centres, radii, strict=True):
        for edge in (low[:, 1], high[:, 1]):
            off = edge - y
            half = np.sqrt(np.maximum((r - off) * (r + off), 0.0))
            places += [x - half, x + half]
        places += [np.full(len(low), x)]
    for i, j in combinations(range(len(radii)), 2):
        places += [np.full(len(low), at[0]) for at in crossings(centres[i], radii[i], centres[j], radii[j])]
    return np.sort(np.clip(np.stack(places, -1), start[:, None], end[:, None]), -1)


def chords(centres: Floats, radii: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Lower and upper end of the discs' common part at each x."""
    bottom, top = np.full(x.shape, -np.inf), np.full(x.shape, np.inf)
    for (cx, cy), r in zip(centres, radii, strict=True):
        off = x - cx
        half = np.sqrt(np.maximum((r - off) * (r + off), 0.0))
        bottom, top = np.maximum(bottom, cy - half), np.minimum(top, cy + half)
    return bottom, top


def slice_moments(
    centres: Floats, radii: Floats, low: Floats, high: Floats, nodes: int,
    texture: Callable[[Floats, Floats], Floats] | None = None,
) -> Floats:  # fmt: skip
    """Integrals of 1, x and y over the common part of discs in each of P boxes; of a texture instead where given.

    Parameters
    ----------
    centres, radii : ndarray
        Shapes (K, 2) and (K,).
    low, high : ndarray
        Corners of the boxes, shape (P, 2).
    nodes : int
        Of each panel (and, for textures, of each slice).
    texture : callable, optional

    Returns
    -------
    ndarray
        Shape (P, 3); (P,) for a texture.
    """
    edges = breaks(centres, radii, low, high)
    # Most curves do not change within most boxes: only panels of some width are integrated.
    box, panel = np.nonzero(edges[:, 1:] > edges[:, :-1])
    start, half = edges[box, panel], 0.5 * (edges[box, panel + 1] - edges[box, panel])
    u, w, ramp, slope = panel_rule(nodes)
    x, weight = start[:, None] + half[:, None] * ramp, half[:, None] * slope
    bottom, top = chords(centres, radii, x)
    bottom, top = np.maximum(bottom, low[box, 1, None]), np.minimum(top, high[box, 1, None])
    length = np.maximum(top - bottom, 0.0)
    if texture is None:
        area = weight * length
        parts = (area, area * x, area * 0.5 * (top + bottom))
        return np.stack([np.bincount(box, part.sum(1), len(low)) for part in parts], -1)
    y = bottom[..., None] + length[..., None] * u
    light = weight * length * (texture(x[..., None], y) @ w)
    return np.bincount(box, light.sum(1), len(low)).astype(float)


# --- kept fraction, centroid, area ------------------------------------------------------------------------------------


def _from_moments(job: Job, area: float, x: float, y: float) -> Floats:
    """The quantity from integrals of 1, x and y."""
    if job.quantity == "kept fraction":
        return np.array([area / (math.pi * job.radius**2)])
    if job.quantity == "area":
        return np.array([area])
    return np.array([x / area, y / area]) if area > 0 else job.discs[0][0].copy()


def _closed(job: Job, level: int, seed: int) -> Floats:
    shape = intersect(*job.discs)
    if job.quantity == "centroid":
        return np.asarray(shape.centroid)
    return np.array([shape.kept_fraction if job.quantity == "kept fraction" else shape.area])


def _shape_panels(job: Job, nodes: int, seed: int) -> Floats:
    centres, radii = job.discs
    low, high = centres[:1] - radii[0], centres[:1] + radii[0]
    return _from_moments(job, *(float(v) for v in slice_moments(centres, radii, low, high, nodes)[0]))


def _adaptive(job: Job, digits: int, seed: int) -> Floats:
    """Slices by scipy's adaptive rule, told nothing of where curves change."""
    from scipy.integrate import quad_vec

    centres, radii = job.discs
    start, end = float(np.max(centres[:, 0] - radii)), float(np.min(centres[:, 0] + radii))
    if end <= start:
        return _from_moments(job, 0.0, 0.0, 0.0)

    def slices(x: float) -> Floats:
        bottom, top = (float(v) for v in chords(centres, radii, np.asarray(x)))
        length = max(top - bottom, 0.0)
        return np.array([length, x * length, 0.5 * (top + bottom) * length])

    scale = math.pi * job.radius**2
    moments, _ = quad_vec(slices, start, end, epsabs=scale * 10.0**-digits, epsrel=0.0, norm="max", limit=2000)
    return _from_moments(job, *(float(v) for v in moments))


def _shape_points(kind: Kind, job: Job, count: int, seed: int) -> Floats:
    """Points in the square around the pupil's image."""
    centres, radii = job.discs
    unit = grid_points(count) if kind == "grid" else random_points(kind, count, seed)
    x, y = (centres[0] + radii[0] * (2 * unit - 1)).T
    kept = inside(centres, radii, x, y)
    if job.quantity == "kept fraction":
        # Over the points in the pupil's own disc: what is whole comes out as 1.
        whole = int(inside(centres[:1], radii[:1], x, y).sum())
        return np.array([int(kept.sum()) / whole if whole else 0.0])
    cell = 4 * job.radius**2 / len(unit)
    return _from_moments(job, cell * int(kept.sum()), cell * float(x[kept].sum()), cell * float(y[kept].sum()))


def _powers(base: int, first: int, last: int) -> tuple[int, ...]:
    return tuple(base**k for k in range(first, last + 1))


def one(job: Job, level: int) -> float:
    """Work of what has no level."""
    return 1.0


def _shape_methods() -> Iterator[Method]:
    for q in ("kept fraction", "centroid", "area"):
        yield Method("closed form", q, "exact", (0,), _closed, one, "arcs and triangles in stable form")
        nodes = (1, 2, 3, 4, 6, 8, 12, 16, 24)
        yield Method("Gauss panels", q, "panels", nodes, _shape_panels, lambda job, n: n, "slices, n nodes a panel")
        digits = (1, 2, 4, 6, 8, 10, 12)
        yield Method("adaptive quadrature", q, "adaptive", digits, _adaptive, lambda job, n: 2.0**n, "to 10^-n")
        count = partial(_shape_points, "grid")
        yield Method("grid", q, "grid", _powers(2, 2, 10), count, lambda job, n: n * n, "n x n points")
        count = partial(_shape_points, "random")
        yield Method("Monte Carlo", q, "random", _powers(4, 2, 10), count, lambda job, n: n, "n random points")
        count = partial(_shape_points, "sobol")
        yield Method("scrambled Sobol", q, "sobol", _powers(4, 2, 9), count, lambda job, n: n, "n evenly spread points")


# --- pixels, white and of a sinusoid ----------------------------------------------------------------------------------


def pixel_image(job: Job, level: int = 0, seed: int = 0) -> Floats:
    """Exact coverage of the patch's pixels, row by row."""
    centres, radii = job.discs
    corner, width = job.box
    return covered_pixels(centres - corner, radii, width, width).ravel()


def _pixel_panels(job: Job, nodes: int, seed: int) -> Floats:
    if job.quantity == "pixel image":
        return slice_moments(*job.discs, *job.cells, nodes)[:, 0]
    return slice_moments(*job.discs, *job.cells, nodes, job.texture)


def _pixel_points(kind: Kind, job: Job, count: int, seed: int) -> Floats:
    """The same points in every pixel; random ones anew in each."""
    low, _ = job.cells
    rng = np.random.default_rng(seed)
    unit = grid_points(count) if kind == "grid" else random_points(kind, count, seed) if kind == "sobol" else None
    each = count * count if kind == "grid" else count
    step = max(1, BLOCK // each)
    pixels = np.empty(len(low))
    for first in range(0, len(low), step):
        part = low[first : first + step]
        points = rng.random((len(part), each, 2)) if unit is None else unit
        x, y = part[:, :1] + points[..., 0], part[:, 1:] + points[..., 1]
        kept = inside(*job.discs, x, y)
        light = kept if job.quantity == "pixel image" else kept * job.texture(x, y)
        pixels[first : first + step] = light.mean(-1)
    return pixels


def _per_pixel(power: int, job: Job, n: int) -> float:
    return float(job.pixels * n**power)


def _pixel_methods() -> Iterator[Method]:
    per = [partial(_per_pixel, power) for power in range(3)]
    does = "Green's theorem pixel by pixel"
    yield Method("exact arc-pixel area", "pixel image", "exact", (0,), pixel_image, per[0], does)
    for q, inner in (("pixel image", 1), ("textured image", 2)):
        nodes, does = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32), "slices of each pixel, n nodes a panel"
        yield Method("Gauss panels", q, "panels", nodes, _pixel_panels, per[inner], does)
        count = partial(_pixel_points, "grid")
        yield Method("grid", q, "grid", _powers(2, 0, 7), count, per[2], "n x n points in each pixel")
        count = partial(_pixel_points, "random")
        yield Method("Monte Carlo", q, "random", _powers(4, 1, 7), count, per[1], "n random points in each pixel")
        count, does = partial(_pixel_points, "sobol"), "n evenly spread points in each pixel"
        yield Method("scrambled Sobol", q, "sobol", _powers(4, 1, 7), count, per[1], does)


# --- rays through a real main lens: where they meet the focal plane ---------------------------------------------------


def _traced(job: Job, level: int, seed: int) -> Floats:
    camera = camera_of(job.design)
    place, slope = microlens_rays(job.design, job.axis)
    ends = camera.lens.through(place, slope, camera.wavelength, start=camera.array.z, end=camera.focal_plane)
    return np.asarray(ends.height.T.ravel())


def thin_rays(job: Job, level: int = 0, seed: int = 0) -> Floats:
    """Ends of the rays through the lens's thin-lens model: its principal planes and focal length alone."""
    design = job.design
    place, slope = microlens_rays(design, job.axis)
    height = place - slope * design.d_1
    return np.asarray((height - (slope + height / design.f) * design.d_f).T.ravel())


def _surfaces(job: Job, level: int) -> float:
    assert job.design.lens is not None
    return float(len(job.design.lens.surfaces))


def _lens_methods() -> Iterator[Method]:
    yield Method("exact trace", LENS, "exact", (0,), _traced, _surfaces, "Snell's law at every surface")
    yield Method("thin lens", LENS, "first order", (0,), thin_rays, one, "focal length and principal planes")


# --- depths: how a disparity's error becomes a depth's ----------------------------------------------------------------


def _depth_range(job: Job, level: int, seed: int) -> Floats:
    """Depth falls with disparity, so that the range's ends are those of the disparity."""
    inverse, sigma = job.inverse_depth
    # (1/(v - s) - 1/(v + s))/2 without the difference.
    return np.array([sigma / ((inverse - sigma) * (inverse + sigma))])


def _depth_sigma(job: Job, level: int, seed: int) -> Floats:
    return np.array([float(depth_sigma(Camera.of(job.design), job.depth, SIGMA_DISPARITY))])


def _measured_depths(kind: Kind, job: Job, count: int, seed: int) -> Floats:
    """Quantiles of simulated measurements."""
    inverse, sigma = job.inverse_depth
    if kind == "random":
        normal = np.random.default_rng(seed).standard_normal(count)
    else:
        from scipy.special import ndtri
        from scipy.stats.qmc import Sobol

        normal = ndtri(np.clip(Sobol(1, seed=seed).random(count)[:, 0], 2.0**-40, 1 - 2.0**-40))
    ends = np.quantile(inverse + sigma * normal, [0.5 * (1 + INSIDE), 0.5 * (1 - INSIDE)])
    return np.array([0.5 * (1 / ends[1] - 1 / ends[0])])


def _depth_methods() -> Iterator[Method]:
    yield Method("closed form", "depth", "exact", (0,), _depth_range, one, "ends of the disparity's range")
    yield Method("first order", "depth", "first order", (0,), _depth_sigma, one, "Z_F^2 d H sigma/(D_F d_1)")
    counts, work = _powers(4, 3, 10), lambda job, n: float(n)
    count = partial(_measured_depths, "random")
    yield Method("Monte Carlo", "depth", "random", counts, count, work, "n simulated measurements")
    count = partial(_measured_depths, "sobol")
    yield Method("scrambled Sobol", "depth", "sobol", counts, count, work, "n evenly spread ones")


METHODS = (*_shape_methods(), *_pixel_methods(), *_lens_methods(), *_depth_methods())
"""Methods without waves."""
