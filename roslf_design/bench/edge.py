"""Spatial frequency response of a slanted edge (e-SFR, ISO 12233), in a view or over views refocused to the edge.

Samples lie at distances x from the edge, all microlenses and views together: the oversampled edge profile is a cubic
spline through them, and its derivative, whose Fourier transform is known, the line spread. No picture is resampled:
a refocused one adds up samples where they lie. The edge's angle and, over views, its slope in the epipolar-plane image
are fitted with the profile. Errors follow from what is left, each microlens's samples together: pixels that are
interpolated, or brighter than others, err alike in all of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.interpolate import BSpline

from .._arrays import Array
from ..calibration.decoding import TAPS, LightField, read_between
from ..calibration.frames import CalibrationError
from .clusters import clustered_covariance

KNOT = 0.25
"""Step of the profile's knots [pitches]: four times oversampled, as ISO 12233 has it."""
LEAST_REACH, MOST_REACH, WIDTHS = 5.0, 24.0, 3.0
"""Reach of the profile to either side of the edge [pitches], and in widths of the line spread."""
ALONG, LEAST_HALF, CORNER = 40.0, 4.0, 1.5
"""Most and least half lengths of the stretch along an edge that counts, and what its corners take of it [pitches]."""
NEARLY, CLOSE = math.radians(25), 3.0
"""Angle to an edge's normal within which gradients are the edge's, and distance from it [pitches]."""
ROUNDS = 6
FEWEST, LEAST_STEP, LEAST_FILLED = 100, 5.0, 0.75
"""Samples that a profile takes at least, the step over its standard error from which an edge is one, and the share of
the profile's knots that samples must lie at: an edge has to be slanted."""
PLACES = 200
"""Microlenses whose places between pixels are looked at, about."""
LEAST_LEFT = 0.1
"""Contrast that reading leaves at least where it is allowed for."""
HIGHEST = 2.0
"""Largest frequency looked at [cycles per pitch]."""

Frequency = tuple[float, float]
"""Frequency at which the contrast has fallen to a level, and its standard error; NaN where it never does."""


@dataclass(frozen=True, eq=False)
class EdgeResponse:
    """Response of an edge, against its normal."""

    places: Array
    """Middles of the profile's steps [pitches], shape (n,)."""
    steps: Array
    """Growth of the profile's spline there, shape (n,)."""
    covariance: Array
    """Covariance of the steps, (n, n)."""
    angle: float
    """Angle of the edge's normal to the rows of microlenses [rad]."""
    slope: float
    """Du/Ds of the edge [pitches per px]; of one view as its distance has it."""
    between: Array | None = None
    """Shares of a pixel that samples lie beyond pixels, along the array's rows and square to them, (2, n)."""

    def transfer(self, frequency: Array) -> tuple[Array, Array]:
        """Contrast at frequencies [cycles per pitch] against that of coarse detail, and its standard error."""
        nu = np.atleast_1d(np.asarray(frequency, float))
        waves = np.exp(-2j * math.pi * nu[:, None] * self.places) * np.sinc(nu * KNOT)[:, None] ** 3
        height, light = self.steps.sum(), waves @ self.steps
        size = np.abs(light)
        turned = (light.conj() / np.maximum(size, 1e-30))[:, None] * waves
        rates = turned.real / height - np.sign(height) * (size / height**2)[:, None]
        along, across = (((part @ self.covariance) * part).sum(-1).clip(0) for part in (rates, turned.imag / height))
        # Noise across the mean's phase lengthens it, whichever way it goes.
        read = self._read(nu)
        return np.sqrt(np.maximum((size / height) ** 2 - across, 0.0)) / read, np.sqrt(along) / read

    def _read(self, nu: Array) -> Array:
        """Contrast that reading between pixels leaves: of an edge out of focus pixels show other places."""
        if self.between is None:
            return np.ones(nu.shape)
        along, down = nu * self.slope * math.cos(self.angle), nu * self.slope * math.sin(self.angle)
        left = np.abs(read_between(along, self.between[0]) * read_between(down, self.between[1]))
        return np.maximum(left, LEAST_LEFT)


class _Samples(NamedTuple):
    """Samples about an edge, shape (n,) each."""

    u: Array
    v: Array
    s: Array
    t: Array
    values: Array
    weight: Array
    microlens: Array
    """Number of the microlens that each is from."""

    @classmethod
    def of(cls, field: LightField, views: tuple[NDArray[np.intp], NDArray[np.intp]]) -> _Samples:
        """Samples of some views, of `views` along t and s, that have light."""
        part = np.ix_(*views, np.arange(len(field.v)), np.arange(len(field.u)))
        values, weight = field.values[part].astype(float), field.weight[part].astype(float)
        axes = np.broadcast_arrays(
            field.t[views[0], None, None, None], field.s[views[1], None, None], field.v[:, None], field.u,
            np.arange(len(field.v) * len(field.u)).reshape(len(field.v), -1),
        )  # fmt: skip
        lit = weight > 0
        t, s, v, u, number = (axis[lit] for axis in axes)
        return cls(u, v, s, t, values[lit], weight[lit], number)

    def some(self, chosen: NDArray[np.bool_]) -> _Samples:
        """Samples chosen."""
        return _Samples(*(axis[chosen] for axis in self))


class _Line(NamedTuple):
    """Edge as the middle view shows it, roughly."""

    angle: float
    """Angle of its normal, towards what is brighter [rad]."""
    away: float
    """Distance from u = v = 0 along the normal [pitches]."""
    middle: float
    """Middle of the stretch that shows it, along the edge [pitches]."""
    half: float
    """Half of that stretch's length."""

    @property
    def foot(self) -> tuple[float, float]:
        """Place (u, v) of its middle [pitches]."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return self.away * cos - self.middle * sin, self.away * sin + self.middle * cos


def edges_in_view(field: LightField, slope: float = 0.0) -> tuple[EdgeResponse, ...]:
    """Responses of the middle view's edges, up to four of a square.

    Parameters
    ----------
    slope : float
        Du/Ds that the edges' distance should have [pitches per px].

    Raises
    ------
    CalibrationError
        It shows none.
    """
    middle = np.array([np.abs(field.t).argmin()]), np.array([np.abs(field.s).argmin()])
    samples = _Samples.of(field, middle)
    return _each(field, lambda line: _fitted(samples, line, slope, refocus=False))


def edges_refocused(field: LightField, slope: float) -> tuple[EdgeResponse, ...]:
    """Responses of edges over views, refocused to each of them; those of light from one microlens alone.

    Nearer to the next microlens's image samples are interpolated from its pixels too: its light, a pitch aside, is no
    blur of the camera's.

    Parameters
    ----------
    slope : float
        Du/Ds to begin with [pitches per px], that the edges' distance should have.

    Raises
    ------
    CalibrationError
        It shows none.
    """
    t, s = (np.flatnonzero(np.abs(axis) <= max(field.pitch / 2 - TAPS, 0.0)) for axis in (field.t, field.s))
    samples = _Samples.of(field, (t, s))
    return _each(field, lambda line: _fitted(samples, line, slope, refocus=True))


def limit_of(responses: Sequence[EdgeResponse], level: float) -> Frequency:
    """Lowest frequency at which contrast has fallen to a level, the mean of edges by their errors.

    Where they differ by more than those, the error is as large as they differ (Birge). Contrasts are averaged, not
    their limits: noise lets each fall too soon, and to seem the surer. The limit's error is half the stretch in which
    the contrast falls by two standard errors about the level, or the part before it where noise hides the rest.
    """
    nu = np.linspace(0.0, HIGHEST, 801)
    contrasts, sigmas = np.swapaxes([response.transfer(nu) for response in responses], 0, 1)
    weight = 1 / np.maximum(sigmas, 1e-9) ** 2
    contrast = (weight * contrasts).sum(axis=0) / weight.sum(axis=0)
    apart = (weight * (contrasts - contrast) ** 2).sum(axis=0) / max(len(responses) - 1, 1)
    sigma = np.sqrt(np.maximum(1.0, apart) / weight.sum(axis=0))

    def first(level: float) -> float:
        below = np.flatnonzero(contrast < level)
        if not below.size:
            return math.nan
        k = max(int(below[0]), 1)
        return float(nu[k] - (nu[1] - nu[0]) * (level - contrast[k]) / (contrast[k - 1] - contrast[k]))

    value = first(level)
    error = float(np.interp(value, nu, sigma))
    low, high = first(level + error), first(level - error)
    return value, value - low if math.isnan(high) else (high - low) / 2


def _each(field: LightField, fit: Callable[[_Line], EdgeResponse | None]) -> tuple[EdgeResponse, ...]:
    edges = tuple(response for line in _lines(field) if (response := fit(line)) is not None)
    if not edges:
        raise CalibrationError("shows no edge")
    if field.between is None:
        return edges
    between = field.between.reshape(2, -1)
    return tuple(replace(edge, between=between[:, :: 1 + between.shape[1] // PLACES]) for edge in edges)


def _lines(field: LightField) -> Iterator[_Line]:
    """Edges by the middle view's gradients: the strongest, and those at right angles to it that are nearly so."""
    view, lit = field.view().astype(float), field.view_weight() > 0
    u, v = np.meshgrid(field.u, field.v)
    du, dv = (float(axis[1] - axis[0]) for axis in (field.u, field.v))
    down, across = np.gradient(view, dv, du)
    inner = ndimage.binary_erosion(lit, iterations=2)
    power = np.where(inner, across**2 + down**2, 0.0)
    strong = power > 0.25 * float(np.quantile(power[inner], 0.98)) if inner.any() else inner
    if strong.sum() < 2:
        return
    ways, power = np.arctan2(down, across)[strong], power[strong]
    count, _ = np.histogram(ways, 36, (-math.pi, math.pi), weights=power)
    first = (ndimage.uniform_filter1d(count, 3, mode="wrap").argmax() + 0.5) * math.pi / 18 - math.pi
    place = np.stack([u[strong], v[strong]])
    shares: list[float] = []
    for turn in range(4):
        off = np.angle(np.exp(1j * (ways - first - turn * math.pi / 2)))
        near = np.abs(off) < NEARLY
        shares.append(float(power[near].sum()))
        if near.sum() < 4 or shares[-1] < 0.3 * shares[0]:
            continue
        angle = float(first + turn * math.pi / 2 + power[near] @ off[near] / shares[-1])
        for _ in range(2):
            away = math.cos(angle) * place[0] + math.sin(angle) * place[1]
            along = math.cos(angle) * place[1] - math.sin(angle) * place[0]
            heights, ends = np.histogram(
                away[near], np.arange(away.min() - 1, away.max() + 2, 1.0), weights=power[near]
            )
            top = ndimage.uniform_filter1d(heights, 3, mode="constant").argmax()
            on = near & (np.abs(away - ends[top] - 0.5) < CLOSE)
            fall = np.polyfit(along[on], away[on], 1, w=np.sqrt(power[on])) if on.sum() > 3 else np.zeros(2)
            angle -= math.atan(float(fall[0]))
        low, high = np.quantile(along[on], (0.05, 0.95))
        half = min(float(high - low) / 2 - CORNER, ALONG)
        if half > LEAST_HALF:
            yield _Line(angle, float(power[on] @ away[on] / power[on].sum()), float(low + high) / 2, half)


def _fitted(samples: _Samples, line: _Line, slope: float, refocus: bool) -> EdgeResponse | None:
    """Profile, angle and slope by Gauss-Newton steps, the profile's reach by its width; None where there is no edge."""
    u_0, v_0 = line.foot
    reach, turn, profile = LEAST_REACH, 0.0, None
    for round_ in range(ROUNDS):
        cos, sin = math.cos(line.angle + turn), math.sin(line.angle + turn)
        x, y = samples.u - slope * samples.s - u_0, samples.v - slope * samples.t - v_0
        across, along = cos * x + sin * y, cos * y - sin * x
        there = np.abs(along) < line.half
        chosen = there & (np.abs(across) < reach)
        if chosen.sum() < FEWEST:
            return None
        here = samples.some(chosen)
        profile = _Profile.of(across[chosen], along[chosen], cos * here.s + sin * here.t if refocus else None, here)
        turn, slope = turn + profile.turned, slope - profile.shifted
        if round_ == 1:
            share = np.maximum.accumulate(np.cumsum(profile.steps) / profile.steps.sum())
            low, high = np.interp([0.1, 0.9], share, profile.places)
            most = min(MOST_REACH, line.half + CORNER)  # as far as a square's middle
            reach = max(LEAST_REACH, min(WIDTHS * float(high - low), most))
    assert profile is not None
    places = across[chosen]
    if np.unique(np.floor(places / KNOT)).size < LEAST_FILLED * np.ptp(places) / KNOT:
        return None  # along the rows, as a sheet's own border: nothing is known between its samples
    covariance = profile.covariance(here.microlens)
    if not profile.steps.sum() > LEAST_STEP * math.sqrt(max(float(covariance.sum()), 0.0)):
        return None
    return EdgeResponse(profile.places, profile.steps, covariance, line.angle + turn, slope)


class _Profile(NamedTuple):
    """Profile of an edge, and by how much the angle and the slope that it was taken with are off."""

    places: Array
    steps: Array
    turned: float
    shifted: float
    columns: sparse.csr_matrix
    """Rates of samples with the profile, then angle and slope."""
    inverse: Array
    weight: Array
    left: Array
    """Residuals times weights."""
    differ: Array
    """Rates of the steps with the profile."""

    @classmethod
    def of(cls, across: Array, along: Array, view: Array | None, samples: _Samples) -> _Profile:
        """Steps of the spline through samples, and by how much angle and slope are off.

        To first order a turned normal moves samples by their place along the edge, a slope that is off by their view's:
        both are fitted as multiples of the profile's own derivative.
        """
        first, last = math.floor(across.min() / KNOT), math.ceil(across.max() / KNOT)
        count = last - first + 3
        knots = KNOT * np.arange(first - 3, last + 4)
        # Flat at both ends, where little would hold its outermost parts.
        flat = np.clip(np.arange(count), 2, count - 3) - 2
        ends = sparse.csc_matrix((np.ones(count), (np.arange(count), flat)))
        basis = (BSpline.design_matrix(across, knots, 3) @ ends).tocsc()
        values, weight = samples.values, samples.weight
        plain = _solved(basis, weight, values)[0]
        rate = BSpline(knots, ends @ plain, 3).derivative()(across)
        moves = [rate * along] if view is None else [rate * along, rate * view]
        whole = sparse.hstack([basis, sparse.csc_matrix(np.stack(moves, -1))]).tocsc()
        found, inverse = _solved(whole, weight, values)
        differ, inner = np.diff(np.eye(count), axis=0) @ ends.toarray(), count - 4
        turned, shifted = found[inner], 0.0 if view is None else found[inner + 1]
        left = weight * (values - whole @ found)
        places, steps = knots[1:count] + 1.5 * KNOT, differ @ found[:inner]
        return cls(places, steps, float(turned), float(shifted), whole.tocsr(), inverse, weight, left, differ)

    def covariance(self, microlens: Array) -> Array:
        """Covariance of the steps; samples of a microlens err alike."""
        columns, (_, group) = self.columns, np.unique(microlens, return_inverse=True)
        scores = sparse.csr_matrix((self.left, (group, np.arange(group.size)))) @ columns
        parts = (columns[k : k + 20_000] for k in range(0, group.size, 20_000))
        drawn = np.concatenate([np.asarray(part.multiply(part @ self.inverse).sum(axis=1)).ravel() for part in parts])
        leverage = np.bincount(group, self.weight * drawn)
        inner = self.differ.shape[1]
        covariance = clustered_covariance(self.inverse, scores.toarray(), leverage)[:inner, :inner]
        return np.asarray(self.differ @ covariance @ self.differ.T)


def _solved(columns: sparse.csc_matrix, weight: Array, values: Array) -> tuple[Array, Array]:
    """Weighted least squares and the inverse of its normal matrix; columns without samples count nothing."""
    weighted = sparse.diags(weight) @ columns
    normal = (columns.T @ weighted).toarray()
    inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    return inverse @ (weighted.T @ values), inverse
