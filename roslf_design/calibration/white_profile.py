"""Veil, effective pupil and profile of the microlens images in a white image.

Pixels of all microlenses are fitted together, each where it lies in its own cell: this samples the images far more
finely than pixels do. The model is `PupilImage`, its neighbours in it, times a gain of each microlens, on a veil that
is alike in all pixels. Standard errors have the scatter of whole microlenses; the part of the misfit that is as
symmetric as the images, as no other moves width and veil. Where the images show a pupil that is darker at its rim,
several laws of that fall are fitted: the width is their mean, weighted by how well each fits, and their spread is an
error of type B (GUM 4.3). Light that falls off within the last tenth before the rim looks like a narrower pupil.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ..camera import Camera
from ..design import Design
from ..theory.exit_pupil import microlens_image_pitch
from .centres import MicrolensCentres
from .frames import Array, ColourBalance, Frame
from .lattice import CentreLattice
from .pupil_image import PupilImage

Names = tuple[str, ...]
BOTH: Names = ("radius", "blur")
"""Values of `PupilImage` that are fitted."""
_MOST = 200_000
"""Pixels that are fitted; beyond, microlenses are left out evenly."""
_FEWEST = 12
"""Microlenses that scatter is told of."""
_FINE, _MOST_STEPS = 12, 512
"""Places a pixel at which the model is tabulated, or more, and most of them across a cell."""
_ROUNDS, _SETTLED = 30, 1e-4
"""Most steps of a fit, and the step [px] after which it has settled."""
_STRAIGHT = 0.95
"""Cosine above which two steps of a fit go one way; and their ratio, above which nothing is known of their sum."""
_UNLIKE = 0.01
"""Misfit that width and veil have to bear to be told apart [fully lit pixels, rms]: real images follow no model better.
"""
_UNTOLD = 0.03, 0.05
"""Standard errors of the width, against itself, and of the veil [fully lit pixels] that it may leave."""
_BOUNDS = {"radius": (0.1, 2.0), "blur": (0.0, 0.7), "dimmer": (-0.9, 0.9)}
"""Bounds of `PupilImage`'s values; of lengths in pitches."""
_PER_PLACE, _PLACES = 10, 3
"""Pixels that a place of the folded profile is the mean of, about, and most of its places a pixel."""
_OTHER = 0.03
"""Symmetric part of the misfit from which images are others than an evenly lit pupil's: real ones have up to 0.013."""
_EXACT = 2e-4
"""Misfit that tabulating the model leaves [fully lit pixels], and renderings: errors told allow for it."""
_OTHER_FALLS = 1.0, 4.0
"""Powers of the radius by which a pupil may darken towards its rim, beside the square."""
_ASTRAY = 4.0
"""Residuals of a microlens, against the median's, beyond which it is left out."""


@dataclass(frozen=True, eq=False)
class WhiteProfile:
    """Microlens images of a white image, and an evenly lit pupil's fitted to them; light in fully lit pixels."""

    image: PupilImage
    lattice: CentreLattice
    veil: float
    sigma: tuple[float, float]
    """Standard errors of the width, relative to itself, and of the veil."""
    of_rim: float
    """Part of the width's that the law leaves open by which the pupil darkens towards its rim."""
    untold: str
    """Reason why the image does not tell width and veil; empty where it does."""
    dark: bool
    """Whether the sensor's black level is known, and off."""
    full: float | None
    """The full well; None where nothing states it."""
    narrower: float | None
    """Width over the design's, both in pitches; None without a design."""
    nominal: float | None
    """Width of the design's pupil [mm]."""
    microlenses: int
    measured: Array
    """Light at ``(i, j)/n`` of a cell, the mean of all microlenses, shape (n, n)."""
    fitted: Array
    noise: float
    """Standard error of `measured`, rms."""
    symmetric: float
    """Rms of the part of the misfit that is as symmetric as the images, without noise."""

    @property
    def misfit(self) -> float:
        """Rms of `measured` less `fitted`, without noise."""
        return math.sqrt(max(float(np.square(self.measured - self.fitted).mean()) - self.noise**2, 0.0))

    @property
    def width(self) -> float:
        """Width of an image between the pupil's rims [px]."""
        return float(self.image.radius * self.image.shape.width / self.image.shape.reach)

    @property
    def dips(self) -> tuple[float, float]:
        """Darkest over brightest place of an image, measured and fitted."""
        measured, fitted = (float(part.min() / part.max()) for part in (self.measured, self.fitted))
        return measured, fitted

    @property
    def share(self) -> float:
        """Width of an image over the pitch."""
        return self.width / self.lattice.pitch

    @property
    def pupil(self) -> float | None:
        """Effective pupil's width [mm]."""
        return None if self.narrower is None or self.nominal is None else self.narrower * self.nominal

    def along(self, i: int, j: int) -> tuple[Array, Array, Array]:
        """Places from a microlens's middle towards (i, j) and back, over one period [px], light there and as fitted."""
        n = len(self.measured)
        k = np.arange(-(n // 2), n // 2 + 1)
        px = k / n * float(np.hypot(*(self.lattice.basis @ (i, j))))
        return px, self.measured[k * i % n, k * j % n], self.fitted[k * i % n, k * j % n]

    def to_dict(self) -> dict[str, Any]:
        """Object `white` of `decoding.json`; null is what cannot be told."""
        share = None if self.full is None else self.veil / self.full
        told = {
            "veil": share,
            "veil_sigma": None if self.full is None else self.sigma[1] / self.full,
            "veil_of_lit": self.veil,
            "veil_of_lit_sigma": self.sigma[1],
            "image_width_px": self.width,
            "image_width_sigma_px": self.width * self.sigma[0],
            "image_width_sigma_of_rim_px": self.width * self.of_rim,
            "effective_pupil_mm": self.pupil,
            "effective_pupil_sigma_mm": None if self.pupil is None else self.pupil * self.sigma[0],
            "blur_px": self.image.blur,
            "rim_darker": self.image.dimmer,
        }
        return {
            **(dict.fromkeys(told) if self.untold else told),
            "untold": self.untold or None,
            "pitch_px": list(self.lattice.pitches),
            "profile_rms": self.misfit,
            "profile_rms_symmetric": self.symmetric,
            "profile_noise": self.noise,
            "dip": dict(zip(("measured", "fitted"), self.dips, strict=True)),
            "microlenses": self.microlenses,
        }


class WhiteFrame(NamedTuple):
    """White image as its pixels have it."""

    pixels: Frame
    """Grey, dark frame off."""
    full: float | None
    """Value of a pixel whose well is full; None where nothing states it."""
    dark: bool = True
    """Whether the sensor's black level is known, and off."""

    def profile(
        self, centres: MicrolensCentres, design: Design | None, balance: ColourBalance | None = None
    ) -> WhiteProfile | None:
        """Fit its whole microlens images.

        Parameters
        ----------
        centres : MicrolensCentres
            Found in it.
        design : Design, optional
            Tells the pupil's shape and width and the microlenses' shape and focus. Without one it is a disc behind
            square microlenses, in hexagonal arrays round ones, in focus.
        balance : ColourBalance, optional
            Behind colour filters: pixels of the brightest colour alone are fitted.

        Returns
        -------
        WhiteProfile or None
            None where there are too few whole images, or nothing fits.
        """
        lattice = centres.lattice
        samples = ImageSamples.of(self.pixels, lattice, centres.centres[centres.used], balance)
        if samples.lenses < _FEWEST:
            return None
        shape = "square" if lattice.layout == "square" else "circular"
        start = PupilImage(0.45 * lattice.pitch, 0.1 * lattice.pitch, lattice.pitch, lattice.layout, shape)
        starts, designed = [start], None
        if design is not None:
            designed = PupilImage.designed(design, lattice)
            starts = [designed, replace(designed, radius=start.radius)]
        rough = ImageFit.best(samples, lattice, starts)
        each = np.sqrt(samples.mean(np.square(rough.residual)))
        like = each < _ASTRAY * np.median(each)
        samples = samples.some(like)
        fit = rough if like.all() else ImageFit.of(samples, lattice, rough.image)
        if designed is not None and not fit.separable:  # its blur has to be believed
            fit = ImageFit.of(samples, lattice, replace(designed, radius=fit.image.radius), ("radius",))
        if not fit.rms < 1:
            return None
        separable = fit.separable
        fit, variance, rim = fit.darkened()
        measured, fitted, noise, symmetric = fit.folded()
        sigma = float(np.sqrt(variance[1]) / fit.image.radius), float(np.sqrt(variance[0]))
        narrower = nominal = None
        if design is not None and designed is not None:
            c = Camera.of(design)
            pitches = lattice.pitch, abs(float(microlens_image_pitch(c) / c.q))
            own, its = (each.radius / pitch for each, pitch in zip((fit.image, designed), pitches, strict=True))
            narrower, nominal = own / its, float(c.fap.outline.width)
        full, untold = None if self.full is None else self.full / float(fit.gains.mean()), ""
        if not separable:
            untold = "images run into each other so far that a veil changes them as another width does"
        elif symmetric > _OTHER:
            untold = f"images differ by {100 * symmetric:.0f} % rms from those of an evenly lit pupil"
        return WhiteProfile(
            fit.image, lattice, fit.veil, sigma, rim / fit.image.radius, untold, self.dark, full, narrower, nominal,
            samples.lenses, measured, fitted, noise, symmetric,
        )  # fmt: skip


def _step(jacobian: Array, residual: Array) -> Array:
    """Gauss's and Newton's step."""
    return np.asarray(np.linalg.lstsq(jacobian.T @ jacobian, jacobian.T @ residual, rcond=1e-10)[0])


def _summed_up(move: Array, last: Array) -> tuple[Array, Array]:
    """Step to where steps end of which each is as much of the one before (Aitken), and what the next compares with.

    Where residuals are large, or laws of a rim alike, steps shrink by a fifth each.
    """
    length, before = float(np.linalg.norm(move)), float(np.linalg.norm(last))
    if before > 0 and float(move @ last) > _STRAIGHT * length * before and length < _STRAIGHT * before:
        return move / (1 - length / before), np.zeros_like(move)
    return move, move.copy()


class ImageSamples(NamedTuple):
    """Pixels in the cells of whole microlens images."""

    at: Array
    """Lattice coordinates from the microlens, shape (n, 2)."""
    lens: NDArray[np.intp]
    """Number of the microlens, shape (n,)."""
    value: Array
    lenses: int
    """Number of microlenses."""
    pixel: NDArray[np.intp]
    """Row and column of each, shape (2, n)."""

    @classmethod
    def of(
        cls, frame: Frame, lattice: CentreLattice, nodes: Array, balance: ColourBalance | None = None
    ) -> ImageSamples:
        """Pixels of some microlenses at `nodes` [px], evenly chosen; behind colour filters of the brightest colour."""
        nodes = nodes[:: max(1, math.ceil(len(nodes) * lattice.pitch**2 / _MOST))]
        reach = math.ceil(lattice.pitch)
        window = np.arange(-reach, reach + 1)
        left, top = np.rint(nodes).astype(int).T[..., None, None]
        column, row = np.broadcast_arrays(left + window, top + window[:, None])
        away = np.stack([column, row], -1) - nodes[:, None, None]
        normals, halves = lattice.cell()
        taken = (np.abs(away @ normals.T) <= halves).all(-1)
        taken &= (column >= 0) & (row >= 0) & (column < frame.shape[1]) & (row < frame.shape[0])
        if balance is not None:
            taken &= (balance.gains < 1.01 * balance.gains.min())[row % 2, column % 2]
        lens = np.broadcast_to(np.arange(len(nodes))[:, None, None], taken.shape)[taken]
        value = np.asarray(frame[row[taken], column[taken]], float)
        pixel = np.stack([row[taken], column[taken]])
        return cls(away[taken] @ np.linalg.inv(lattice.basis).T, lens, value, len(nodes), pixel)

    def some(self, kept: NDArray[np.bool_]) -> ImageSamples:
        """Some of the microlenses."""
        mine = kept[self.lens]
        number = np.cumsum(kept) - 1
        return ImageSamples(
            self.at[mine], number[self.lens[mine]], self.value[mine], int(kept.sum()), self.pixel[:, mine]
        )

    def mean(self, values: Array) -> Array:
        """Mean of values over each microlens."""
        return np.bincount(self.lens, values, self.lenses) / np.bincount(self.lens, minlength=self.lenses)

    def read(self, tables: Sequence[Array]) -> Array:
        """Values there of what is tabulated over a cell, a row of each table."""
        from scipy.ndimage import spline_filter

        return self._of([spline_filter(table, 3, mode="grid-wrap") for table in tables])

    def shown(self, images: Sequence[PupilImage], lattice: CentreLattice, steps: int) -> Array:
        """Light there of pupils' images, tabulated at so many places along a cell, a row of each image."""
        return self._of([image.splines_over_cell(lattice, steps) for image in images])

    def _of(self, splines: Sequence[Array]) -> Array:
        """Values there of periodic splines over a cell, by their coefficients."""
        values = np.empty((len(splines), len(self.at)))
        weights = np.pad(np.stack(splines), ((0, 0), (1, 2), (1, 2)), mode="wrap")
        _read.compiled(weights, np.ascontiguousarray(self.at), values)
        return values


@kernel()
def _read(weights: Array, at: Array, values: Array) -> None:
    """Values at lattice coordinates, shape (n, 2), of cubic splines over one cell; of their weights a few come twice.

    What scipy's `map_coordinates` has, in a third of the time.
    """
    steps = weights.shape[1] - 3
    for n in range(at.shape[0]):
        i, j = math.floor(at[n, 0] * steps), math.floor(at[n, 1] * steps)
        rows, columns = _spline_taps(at[n, 0] * steps - i), _spline_taps(at[n, 1] * steps - j)
        i, j = i % steps, j % steps
        for k in range(weights.shape[0]):
            total = 0.0
            for a in range(4):
                for b in range(4):
                    total += rows[a] * columns[b] * weights[k, i + a, j + b]
            values[k, n] = total


@kernel()
def _spline_taps(part: float) -> tuple[float, float, float, float]:
    """Weights of a cubic spline's coefficients 1 before, at, 1 and 2 after, for a place `part` of a step after one."""
    left = 1.0 - part
    at, after = ((3.0 * part - 6.0) * part * part + 4.0) / 6.0, ((3.0 * left - 6.0) * left * left + 4.0) / 6.0
    return left * left * left / 6.0, at, after, part * part * part / 6.0


@dataclass(frozen=True, eq=False)
class ImageFit:
    """Pupil's image, veil and gains fitted to pixels by least squares; veil, then `free`, are parameters."""

    samples: ImageSamples
    lattice: CentreLattice
    image: PupilImage
    veil: float
    free: Names
    settled: bool
    gains: Array
    """Values of fully lit pixels of each microlens."""
    residual: Array
    """Residual of each pixel [fully lit pixels]."""
    rates: Array
    """Rates at which it falls with each parameter, gains fitted anew; shape (n, parameters)."""

    @classmethod
    def of(cls, samples: ImageSamples, lattice: CentreLattice, start: PupilImage, free: Names = BOTH) -> ImageFit:
        """Fit from a start, by Gauss and Newton."""
        low, high = np.array([_BOUNDS[name] for name in free]).T * [1 if n == "dimmer" else lattice.pitch for n in free]
        values = np.clip([getattr(start, name) for name in free], low, high)
        steps = min(_MOST_STEPS, 16 * math.ceil(_FINE * lattice.pitch / 16))  # transforms of multiples are quick
        veil, settled, states, last = 0.0, False, set[tuple[float, ...]](), np.zeros(1 + len(free))
        for turn in range(_ROUNDS + 1):
            image = replace(start, **dict(zip(free, values.tolist(), strict=True)))
            moved = [replace(image, **{name: getattr(image, name) + 1e-3}) for name in free]
            light, *others = samples.shown([image, *moved], lattice, steps)
            rates = [(other - light) * 1e3 for other in others]
            mean = samples.mean(light + veil)
            gains = samples.mean(samples.value) / mean
            residual = samples.value / gains[samples.lens] - light - veil
            own = (light + veil) / mean[samples.lens]
            all_rates = np.ones(len(light)), *rates
            jacobian = np.stack([rate - own * samples.mean(rate)[samples.lens] for rate in all_rates]).T
            state = (*values.round(6).tolist(), round(veil, 6))
            if turn == _ROUNDS or settled or state in states:  # from bound to bound and back for ever
                break
            states.add(state)
            move = _step(jacobian, residual)
            stuck = np.append(False, (values <= low) & (move[1:] < 0))
            if stuck.any():  # images as sharp as pixels
                move[stuck], move[~stuck] = 0.0, _step(jacobian[:, ~stuck], residual)
            move, last = _summed_up(move, last)
            move[1:] = np.clip(move[1:], -0.2 * (high - low), 0.2 * (high - low))
            veil = min(max(veil + float(move[0]), -0.2), 5.0)
            after = np.clip(values + move[1:], low, high)
            settled = bool(max(np.abs(after - values).max(), abs(float(move[0]))) < _SETTLED)
            values = after
        inside = bool(((values > low) & (values < high) | (np.array(free) == "blur")).all())
        return cls(samples, lattice, image, veil, free, settled and inside, gains, residual, jacobian)

    @classmethod
    def best(
        cls, samples: ImageSamples, lattice: CentreLattice, starts: Sequence[PupilImage], free: Names = BOTH
    ) -> ImageFit:
        """Fit from that start from which a part of the microlenses is met best."""
        some = samples.some(np.arange(samples.lenses) % 8 == 0)
        first = min((cls.of(some, lattice, start, free) for start in starts), key=lambda fit: fit.rms)
        return cls.of(samples, lattice, first.image, free)

    @property
    def misfit(self) -> float:
        """Rms difference of the mean image from the fitted one, relative to its mean; without noise."""
        measured, fitted, noise, _ = self.folded()
        return math.sqrt(max(float(np.square(measured - fitted).mean()) - noise**2, 0.0)) / float(fitted.mean())

    @property
    def rms(self) -> float:
        """Rms residual."""
        return float(np.sqrt(np.mean(np.square(self.residual))))

    @property
    def _of_cell(self) -> Array:
        """Inverse of the information that one cell's pixels have, of errors of 1 over a width of the blur."""
        information = self.rates.T @ self.rates / self.samples.lenses
        return np.asarray(np.linalg.pinv(information, rcond=1e-12) * max(1.0, self.image.blur) ** 2)

    @property
    def separable(self) -> bool:
        """Whether veil and width stay told apart where images differ from the model as real ones do."""
        veil, radius = _UNLIKE * np.sqrt(np.diag(self._of_cell)[:2])
        return bool(self.settled and radius < _UNTOLD[0] * self.image.radius and veil < _UNTOLD[1])

    def variances(self, misfit: float) -> Array:
        """Variances of veil and radius: scatter of microlenses, and a misfit [rms] that all of them share."""
        samples, inverse = self.samples, np.linalg.pinv(self.rates.T @ self.rates, rcond=1e-12)
        each = np.stack([np.bincount(samples.lens, rate * self.residual, samples.lenses) for rate in self.rates.T], -1)
        scatter = inverse @ (each.T @ each) @ inverse * samples.lenses / (samples.lenses - 1)
        return np.diag(scatter + misfit**2 * self._of_cell)[:2].copy()

    def darkened(self) -> tuple[ImageFit, Array, float]:
        """Fit of a pupil that is darker at its rim if it shows to be; variances of veil and radius; the rim's error.

        Radius and veil of several laws are weighted by the squares of their misfits; their scatter counts.
        """

        def by_law(power: float) -> ImageFit:
            start = replace(self.image, power=power)
            return ImageFit.of(self.samples, self.lattice, start, (*self.free, "dimmer"))

        square = by_law(PupilImage.power)
        apart = np.array([square.veil - self.veil, square.image.radius - self.image.radius])
        by_chance = (square.variances(0.0) - self.variances(0.0)).clip(0.0)
        if not square.settled or (apart**2 <= 4 * by_chance).all():
            return self, self.variances(self._unlike), 0.0
        laws = [law for law in (square, *map(by_law, _OTHER_FALLS)) if law.settled]
        unlike = np.array([law._unlike for law in laws])
        weight = unlike**-2 / (unlike**-2).sum()
        values = np.array([[law.veil, law.image.radius] for law in laws])
        spread = weight @ np.square(values - weight @ values)
        variance = weight @ [law.variances(misfit) for law, misfit in zip(laws, unlike, strict=True)] + spread
        start = replace(laws[int(unlike.argmin())].image, radius=float(weight @ values[:, 1]))
        free = tuple(name for name in laws[0].free if name != "radius")
        return ImageFit.of(self.samples, self.lattice, start, free), variance, math.sqrt(spread[1])

    @property
    def _unlike(self) -> float:
        """Rms of the part of the misfit that all microlenses share and that moves width and veil."""
        return max(self.folded()[3], _EXACT)

    def folded(self) -> tuple[Array, Array, float, float]:
        """`measured`, `fitted`, `noise` and `symmetric` of `WhiteProfile`."""
        samples, pitch = self.samples, self.lattice.pitch
        n = int(min(_PLACES * pitch, math.sqrt(len(samples.lens) / _PER_PLACE)))
        cell = np.rint(samples.at * n).astype(int) % n @ [n, 1]
        count = np.maximum(np.bincount(cell, minlength=n * n), 1)
        mean, square = (np.bincount(cell, part, n * n) / count for part in (self.residual, np.square(self.residual)))
        off, error = mean.reshape(n, n), np.maximum(square - mean**2, 0.0) / np.maximum(count - 1, 1)
        fitted = self.image.over_cell(self.lattice, n) + self.veil
        back = -np.arange(n) % n
        alike = [off, off[back][:, back]]
        if self.lattice.layout == "square":
            alike += [off[back], off[:, back]]
        alike += [part.T for part in alike]
        noise = float(error.mean())
        symmetric = float(np.square(np.mean(alike, axis=0)).mean()) - noise / len(alike)
        return fitted + off, fitted, math.sqrt(noise), math.sqrt(max(symmetric, 0.0))
