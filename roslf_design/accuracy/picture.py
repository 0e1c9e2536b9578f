"""Pictures to an accuracy: which effects may be left out, how many samples a pixel takes, and what came of it.

An accuracy is what 99 of 100 pixels may be off by, 1 being a fully lit pixel. Half of it is for effects left out, half
for the method. What samples miss is measured on the picture's own scene before it is made, on small patches, each
number of samples against a finer one of another seed; and once more, on other patches, for the picture as it was made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..design import Design
from ..effects import Budget, Plan, plan
from ..effects.plan import EFFECTS
from ..effects.waves import LONGEST_GRATING, SHORTEST_GRATING, incoherent_texture_miss
from ..errors import InputError, refusal
from ..imaging.camera import planned_camera
from ..imaging.lens_rays import LENS_EFFECTS
from ..imaging.render import AROUND, RawImage, method_of, render
from ..imaging.sampling import MOST_RAYS, mean_light
from ..imaging.trace import TOGETHER, RaySampling
from ..imaging.transfer import halo
from ..imaging.white import neighbour_interference
from ..scenes import Scene
from ..theory.light import object_sample
from ..theory.transfer import MicrolensTransfer
from ..words import percent
from .statement import Accuracy, check_accuracy

Floats = NDArray[np.float64]
Patch = tuple[int, int, int, int]

OF = "99 of 100 pixels"
UNIT = "% of a fully lit one"
SHARE = 0.99
OF_NORMAL = 2.58
"""Standard deviations of a normal law that such a share is within."""
BELOW_NOISE = 1 / 3
"""Scatter of rays over the noise drawn in the same picture, at most, of rays that follow that."""

ROUNDING = {"coverage": 3e-7, "harmonics": 3e-6}
"""Rounding errors of exact methods: pixels, and the series' sums, are single precision."""
CONVOLVED = 2e-3
"""Error of convolution: frequencies folded back (1e-3), and far tails that come from the tile's other side."""
FAINT = 2e-3
"""Least share of a point's light in its far tails that is gone after."""

RAYS = (4, 8, 16, 32, 64, 128, 256, 1024, 4096)
"""Rays per pixel tried."""
SIDES = (4, 6, 8, 12, 16, 24)
"""Samples along a pixel's side tried, behind a real main lens."""
FINER = 2
"""Times as many samples for what they are held against."""
PATCH, PATCHES = 20, 6
"""Pixels across a patch, and how many there are."""
WIDE, FEW = 48, 2
"""Pixels across a patch, and number of patches, with diffraction: each patch then takes wide margins."""
SAFETY = 1.25
"""Errors of other patches scatter."""
CHEAP, CHEAPER = 1e8, 0.5
"""Rays that measuring may take: so many, or that part of the picture's own."""


@dataclass(frozen=True)
class _Settled:
    """Settings with which a picture is to be made."""

    budget: Budget
    plan: Plan
    sampling: RaySampling
    expected_error: float
    method: str


def settle(
    design: Design,
    scene: Scene,
    accuracy: float,
    overrides: Iterable[str] = (),
    *,
    seed: int = 0,
    region: Patch | None = None,
    progress: Callable[[str], None] = lambda what: None,
) -> _Settled:
    """Choose effects and samples for an accuracy.

    Parameters
    ----------
    accuracy : float
        What 99 of 100 pixels may be off by.
    overrides : iterable of str
        Effects switched by hand; those left out by hand do not count as errors.
    seed : int
        Of the picture.
    region : (column, row, columns, rows), optional
        Of the sensor; None is all of it.
    progress : callable
        Told what is being tried.

    Raises
    ------
    InputError
        No accuracy, or one that is out of reach for this scene; a scene that the design cannot see.
    """
    check_accuracy(accuracy, 1e-6, "pixels are single precision")
    wanted = tuple(overrides)
    scene.check(design)
    share, budget, chosen = accuracy / 2, Budget(accuracy / 2, accuracy / 2, accuracy / 2), None
    while chosen is None or (left_out(chosen) > accuracy / 2 and share > 0):
        budget = Budget(share, share, share)
        chosen = plan(design, scene, budget, wanted)
        share = share / 4 if share > 1e-12 else 0.0
    job = _Job(design, scene, chosen, budget, seed, region)
    floor = job.floor
    if not job.ladder:
        _reachable(accuracy, floor, job.method)
        return _Settled(budget, chosen, RaySampling(seed=seed), floor, job.method)
    _reachable(accuracy, 2 * floor, f"{job.method} with diffraction" if job.convolved else job.method)
    best, least = None, math.inf
    for rung in job.ladder:
        for sampling in rung:
            progress(f"trying {_effort(sampling)}")
            # Diffraction smooths: left out, errors told are upper bounds, and cost no margins.
            error, cost = job.error(sampling, job.patches(0, wide := job.rays(sampling) <= CHEAP), sharp=not wide)
            least = min(least, SAFETY * error + floor)
            if SAFETY * error + floor <= accuracy and (best is None or cost < best[0]):
                best = (cost, sampling, SAFETY * error + floor)
        if best is not None:
            return _Settled(budget, chosen, best[1], best[2], f"{job.method}, {_effort(best[1])}")
    raise _out_of_reach(accuracy, least, f"{job.method}, {_effort(job.ladder[-1][-1])}")


def stated(image: RawImage, settled: _Settled | None, accuracy: float | None, budget: Budget) -> Accuracy:
    """Accuracy of a picture, measured on it where one was asked for.

    Parameters
    ----------
    settled : Settled, optional
        How it was made; None where by budgets alone.
    accuracy : float, optional
        That was asked for.
    budget : Budget
        It was made by.
    """
    budget = budget if settled is None else settled.budget
    job = _Job(image.design, image.scene, image.plan, budget, image.seed, image.region, image.method)
    if settled is None:
        method, unit, sampled = image.method, UNIT, 2 * max(budget.of("intensity"), 1e-4) if job.ladder else None
        if image.sampling.below_noise and image.sampling.most < MOST_RAYS:
            full, light = image.scene.light.exposure or 1.0, image.scene.light
            mean = mean_light(image.scene.seen_by(image.design), Camera.of(image.design.thin_twin), image.region)
            noise = math.hypot(math.sqrt(full * mean), light.read_noise) / full
            unit, sampled = f"{UNIT}, noise apart", OF_NORMAL * BELOW_NOISE * noise
            method = f"{image.method}, which scatter by less than {percent(BELOW_NOISE)} of the noise drawn"
        expected = job.floor + (sampled or 0.0)
        return Accuracy(OF, unit, method, expected, seconds=image.seconds, model=job.model, sampling=sampled)
    measured, by = None, ""
    if job.ladder and job.rays(settled.sampling) <= max(CHEAP, CHEAPER * image.rays):
        measured, _ = job.error(settled.sampling, job.patches(1, True))
        by = "other patches again, with finer samples and another seed"
    return Accuracy(OF, UNIT, settled.method, settled.expected_error, measured, by, accuracy, image.seconds, job.model)


def left_out(chosen: Plan) -> float:
    """Sum of the sizes of effects that a plan leaves out by itself.

    A displacement by a part of a pixel (or pitch) moves that part of a pixel's light at most.
    """
    return sum(abs(line.estimate) for line in chosen if not line.on and "by hand" not in line.reason)


def _effort(sampling: RaySampling) -> str:
    if sampling.side:
        return f"{sampling.side} x {sampling.side} samples a pixel"
    if sampling.least == sampling.most:
        return f"{sampling.most} rays a pixel"
    return f"{sampling.least} to {sampling.most} rays a pixel"


class _Job:
    """A picture whose patches can be rendered in any way."""

    def __init__(
        self, design: Design, scene: Scene, chosen: Plan, budget: Budget, seed: int, region: Sequence[int] | None,
        method: str = "",
    ) -> None:  # fmt: skip
        self.design, self.scene, self.plan, self.budget, self.seed = design, scene, chosen, budget, seed
        width, height = design.pixels
        self.region = tuple(region) if region is not None else (0, 0, width, height)
        self.camera = planned_camera(design, chosen)
        self.transfer = MicrolensTransfer.of(self.camera, chosen, scene.light.wavelengths)
        self.method = method or method_of(design, scene, chosen)
        spread = chosen.on("microlens_diffraction") or chosen.on("microlens_defocus")
        self.convolved = spread and self.method in ("rays", "convolution")
        faulty = any(chosen.on(name) for name in LENS_EFFECTS)
        self.real = self.method == "rays" and faulty

    @property
    def ladder(self) -> tuple[tuple[RaySampling, ...], ...]:
        """Ways to sample, cheapest first; those of one rung are tried together."""
        if self.method != "rays":
            return ()
        if self.real:
            return tuple((RaySampling(side=side, seed=self.seed),) for side in SIDES)
        rungs = []
        for rays in RAYS:
            fixed = RaySampling(rays, rays, 0.0, self.seed, together=TOGETHER if self.convolved else 1)
            spread = RaySampling(max(32, rays // 16), rays, self.budget.of("intensity") / 2, self.seed)
            rungs.append((spread, fixed) if rays >= 256 and not self.convolved else (fixed,))
        return tuple(rungs)

    @property
    def floor(self) -> float:
        """Error that stays however finely pixels are sampled."""
        known = left_out(self.plan) + ROUNDING.get(self.method, 0.0)
        return known + (CONVOLVED if self.convolved else 0.0) + (FAINT if self.scene.points else 0.0)

    @property
    def model(self) -> str:
        """Model error that no number of samples gets past, in words."""
        if self.scene.white is not None and self.plan.on("microlens_diffraction"):
            most = neighbour_interference(self.camera, self.transfer)
            return (
                f"interference of neighbouring microlenses, left out, changes pixels by up to {most:.2g} of full scale"
            )
        period = self.scene.brief(self.design).smallest_period
        if not self.convolved or math.isinf(period):
            return ""
        camera = Camera.of(self.design.thin_twin)
        pitches = min(max(period / float(object_sample(camera)), SHORTEST_GRATING), LONGEST_GRATING)
        miss = incoherent_texture_miss(camera, pitches)
        return (
            f"light within a microlens counts as incoherent, which misses up to {100 * miss:.2g} % rms of a "
            f"full-contrast grating of {pitches:.2g} microlens pitches"
        )

    def rays(self, sampling: RaySampling) -> float:
        """Rays that measuring the error takes."""
        per = sampling.side**2 or sampling.most
        area, count = float(PATCH**2), PATCHES
        if self.convolved:
            wide = WIDE + 2 * halo(self.transfer, float(self.camera.q), self.budget.of("intensity"))
            area, count = WIDE**2 + AROUND * (wide**2 - WIDE**2), FEW
        return float(count * area * per * (1 + FINER * (2 if sampling.side else 1)))

    def patches(self, which: int, whole: bool) -> list[Patch]:
        """Small regions: the centre, and others anywhere; not the same for another `which`.

        `whole`: as they are in the picture, diffraction and all.
        """
        column, row, columns, rows = self.region
        side, count = (WIDE, FEW) if whole and self.convolved else (PATCH, PATCHES)
        size = min(side, columns), min(side, rows)
        rng = np.random.default_rng([self.seed, which, 77])
        shares = np.concatenate([[[0.5, 0.5]] if which == 0 else rng.random((1, 2)), rng.random((count - 1, 2))])
        return [
            (column + int(x * (columns - size[0])), row + int(y * (rows - size[1])), *size) for x, y in shares.tolist()
        ]

    def error(self, sampling: RaySampling, patches: Sequence[Patch], *, sharp: bool = False) -> tuple[float, float]:
        """Difference of most pixels from finer samples of another seed, and their cost, in rays a pixel.

        `sharp` leaves diffraction out, which would only smooth what sampling leaves, at the cost of wide margins.
        """
        finer = replace(
            sampling, least=FINER * sampling.least, most=FINER * sampling.most, seed=sampling.seed + 1,
            tolerance=sampling.tolerance / math.sqrt(FINER), side=2 * sampling.side,
        )  # fmt: skip
        off = ["-noise"] + (["-microlens_diffraction", "-microlens_defocus"] if sharp and self.convolved else [])
        free = {effect.name for effect in EFFECTS if not effect.always and effect.available(self.design)}
        forced = [f"{'+' if line.on else '-'}{line.name}" for line in self.plan if line.name in free]
        chosen = plan(self.design, self.scene, self.budget, [*forced, *off])
        differences, rays = [], 0.0
        for patch in patches:
            pair = [
                render(self.design, self.scene, effects=chosen, budget=self.budget, region=patch, sampling=way,
                       seed=self.seed)
                for way in (sampling, finer)
            ]  # fmt: skip
            differences.append(np.abs(pair[0].pixels.astype(float) - pair[1].pixels).ravel())
            rays += pair[0].rays / pair[0].pixels.size
        return float(np.quantile(np.concatenate(differences), SHARE)), rays / len(patches)


def _reachable(accuracy: float, expected: float, method: str) -> None:
    if expected > accuracy:
        raise _out_of_reach(accuracy, expected, method)


def _out_of_reach(accuracy: float, expected: float, method: str) -> InputError:
    best = float(f"{1.05 * expected:.1e}")
    message = f"{accuracy:g} is out of reach for this scene: {method} comes to about {expected:.2g}; ask for {best:g}"
    return refusal("accuracy", message)
