"""Depth in pictures that a camera took: a raw image decoded, its noise, where to search; what came of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..calibration.decoding import LightField
from ..calibration.lattice import CentreLattice
from ..calibration.noise import MeasuredSensor
from ..calibration.raw import RawDecoded
from ..calibration.refocusing import sharp_disparities
from ..camera import Camera
from ..imaging.camera import Region
from ..json_data import plain
from ..progress import CountedProgress, shares, silent
from ..theory.exit_pupil import microlens_image_diameter
from ..theory.photometry import FILLED, dark_variance, electrons, veil_electrons
from .estimate import MANY_PIXELS, ROUGH, DisparityMap, PixelNoise, Start, estimate_disparity
from .geometry import ArrayGeometry, GridGeometry, ViewGeometry
from .measure import POINTS, Depths, Measurement, measure, sampled, search_about
from .pictures import lattice_of

Found = TypeVar("Found")
WHOLE = 0.75
"""Share of its rows with light from which a column of a hexagonal array made square is kept at the sides."""
FIRST_NOISE = 0.02
"""Noise of views to begin with, against their brightness, where it is not known."""
QUIET = 1e8
"""Electrons of views whose noise has nothing to do with light."""
MOST_ELECTRONS = 1e12
"""Largest number of electrons in a pixel that a file is believed to stand for."""
FEW_VIEWS = 4
"""Views along an axis that tell where to search, of views with little noise."""
WIDER, TWICE = 3, 1.0
"""Times that the search is widened where the scene goes on beyond it, and by how much of its width."""
BEYOND = 0.01
"""Share of the microlenses beyond one end of the search from which it is widened there."""
OFF = 1.2
"""Factor by which chi-square is off, and everywhere, from which noise is not as believed: 10 % of its deviation."""
SCATTERED = 0.5 * 2.58
"""Error of 99 of 100 pixels by rays, over the standard deviation by light, from which rays may be seen in a picture."""
FAINTEST = 1e-4
"""Least noise of such views, against their brightness: what rounding and interpolation leave."""


@dataclass(frozen=True)
class CaptureNoise:
    """Noise of a capture's samples, and where it is known from."""

    pixel: PixelNoise
    scale: float
    """Value of the samples that is white, 1, to `pixel`."""
    source: str
    """Source of the noise, in words."""
    measured: bool = False
    """True where views gave it themselves."""
    times: float = 1.0
    """Standard deviation against that first believed, where views say that it is another."""
    sampling: float = 0.0
    """Error that a rendered file states of 99 of 100 pixels by the rays that it took, 1 being a fully lit one."""

    @property
    def stated(self) -> PixelNoise:
        """Noise as first believed, before views said how large it is."""
        return self.pixel.times(1 / self.times)

    @property
    def by_sampling(self) -> bool:
        """True where noise is larger than believed, and rays of the file scatter half as much as light or more."""
        light = math.hypot(math.sqrt(self.stated.electrons), self.stated.read_noise) / self.stated.electrons
        return self.times > 1 and self.sampling > SCATTERED * light * self.scale


@dataclass(frozen=True, eq=False)
class MeasuredCapture(Measurement):
    """Depths in a picture that somebody took."""

    source: str
    """Name of the file or folder."""
    kind: str
    """"raw", "views" or "matlab"."""
    camera: str
    """Description of the camera: a design by its name; empty where there is none."""
    calibration: str
    """Folder whose lengths, and their errors, depths are computed with; empty where they are taken as exact."""
    noise: CaptureNoise
    truth: str = ""
    """File that the truth is from."""
    known_to: Mapping[str, float] = field(default_factory=dict)
    """Standard errors of lengths by their places, as somebody gave them [mm]; all others are taken as exact, but for
    those that a calibration gave."""
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of `roslf depth`."""
        first, flat, noise = self.first, self.first.flatness(), self.noise.pixel
        unit = first.geometry.unit
        summary = plain(self.summary())
        if unit == "px":
            keys = {key.replace("_mm", "_px") if key.endswith("_mm") else key: value for key, value in summary.items()}
            summary = {key: None for key in summary if key.endswith("_mm")} | keys
        return {
            "schema": "roslf.depth/1",
            "source": self.source,
            "kind": self.kind,
            "design": self.camera or None,
            "calibration": self.calibration or None,
            "known_to_mm": dict(self.known_to),
            "truth": self.truth or None,
            "unit": unit,
            "microlenses": [self.true.shape[1], self.true.shape[0]],
            "window": first.disparities.window,
            "searched_pitches": list(first.disparities.search),
            "tip_mm": first.geometry.tip if isinstance(first.geometry, ArrayGeometry) else None,
            "noise": {
                "electrons": noise.electrons,
                "read_noise": noise.read_noise,
                "from": self.noise.source,
                "times_believed": self.noise.times,
                "stated_electrons": self.noise.stated.electrons,
                "stated_read_noise": self.noise.stated.read_noise,
                "sampling_error": self.noise.sampling or None,
            },
            "summary": summary | {"unknown": self.unknown()},
            "plane": None if flat is None else {f"rms_{unit}": flat.rms, "inside_68": flat.inside_68},
            "sphere": None if self.sphere is None else self.sphere.to_dict(),
            "points": list(sampled(first, self.true, POINTS)),
            "warnings": list(self.warnings),
        }


def on_array(field: LightField, lattice: CentreLattice, camera: Camera, region: Region) -> LightField:
    """A decoded light field whose u and v count microlenses from the array's centre, as the design has it.

    Which microlens is in the middle is told by the design, to half a pitch: nothing in an image shows it.

    Parameters
    ----------
    field : LightField
        Decoded with `lattice`.
    lattice : CentreLattice
    camera : Camera
        As designed.
    region : Region
        Of its sensor that was decoded.
    """
    designed = lattice_of(camera, region)
    middle = np.rint(designed.indices([(region.columns - 1) / 2, (region.rows - 1) / 2]))
    i, j = middle - np.rint(lattice.indices(designed.nodes(*middle)))
    if field.hexagonal is None:
        return replace(field, u=field.u + i, v=field.v + j)
    along = i + 0.5 * j
    rows = field.hexagonal._replace(starts=field.hexagonal.starts + along)
    # Columns at the sides that only every other row reaches would take their neighbours' gradients with them.
    whole = np.flatnonzero((field.view_weight() > 0).mean(axis=0) > WHOLE)
    kept = slice(whole[0], whole[-1] + 1) if whole.size else slice(None)
    values, weight = (np.ascontiguousarray(samples[..., kept]) for samples in (field.values, field.weight))
    u, v = field.u[kept] + along, field.v + math.sqrt(3) / 2 * j
    return replace(field, values=values, weight=weight, u=u, v=v, hexagonal=rows)


def raw_noise(camera: Camera, raw: RawDecoded, field: LightField, sensor: MeasuredSensor | None = None) -> CaptureNoise:
    """Noise of a decoded raw image, by the `sensor` as it was calibrated, where that is known.

    Whole numbers are taken for the counts of the design's sensor, which saturates at the largest of its bits; where
    they are larger, of their type. Pictures of `roslf render` with an exposure say themselves how many electrons they
    stand for; others that are no counts are taken to be as bright, on average, as the design's light makes a scene.
    """
    level = _brightness(field)
    dark = math.sqrt(float(dark_variance(camera)))
    full_well = float(camera["sensor.full_well"])
    light, veil = _light_of(raw.notes), float(veil_electrons(camera))
    if light is not None:
        exposure, read = light
        noise = PixelNoise(exposure * level, read).on_veil(veil)
        said = "the exposure that the file was rendered with"
        return CaptureNoise(noise, level, said, sampling=_sampling_of(raw.notes))
    if sensor is not None and sensor.gain is not None:
        gain, well = sensor.gain.value, sensor.full_well
        if sensor.read_noise is not None:  # rounding is none of it
            dark = math.hypot(sensor.read_noise.value, gain * (raw.pixels.dtype.kind in "ui") / math.sqrt(12))
        full = math.inf if raw.full is None else gain * raw.full
        noise = PixelNoise(gain * level, dark, FILLED * (full if well is None or well.bound else well.value))
        return CaptureNoise(noise.on_veil(veil), level, f"the sensor as calibrated, {gain:.4g} electrons a count")
    if raw.pixels.dtype.kind in "ui" and raw.full is not None:
        said = f"the design's sensor, full at {raw.full:g} counts"
        noise = PixelNoise(full_well / raw.full * level, dark, full_well * FILLED).on_veil(veil)
        return CaptureNoise(noise, level, said)
    total = float(field.weight.sum(dtype=float))
    mean = float((field.values * field.weight).sum(dtype=float)) / max(total, 1e-30)
    count = float(electrons(camera)) * level / mean if mean > 0 else 1.0
    return CaptureNoise(PixelNoise(count, dark).on_veil(veil), level, "the design's light: the file has no counts")


def _light_of(notes: Mapping[str, Any]) -> tuple[float, float] | None:
    """Electrons of a fully lit pixel and read noise that a rendered picture tells of itself."""
    scene = notes.get("scene")
    light = scene.get("light") if isinstance(scene, dict) else None
    if not isinstance(light, dict):
        return None
    exposure, read = (light.get(key, 0.0) for key in ("exposure", "read_noise"))
    if not all(isinstance(value, (int, float)) and 0 <= value < MOST_ELECTRONS for value in (exposure, read)):
        return None
    return (float(exposure), float(read)) if exposure > 0 else None


def _sampling_of(notes: Mapping[str, Any]) -> float:
    """Error that a rendered picture states of 99 of 100 pixels, where it took rays; 0 where it says nothing."""
    told = notes.get("accuracy")
    if notes.get("method") != "rays" or not isinstance(told, dict):
        return 0.0
    stated = [told.get(key) for key in ("measured_error", "sampling_error")]
    return next((float(error) for error in stated if isinstance(error, (int, float)) and 0 < error < math.inf), 0.0)


def _brightness(field: LightField) -> float:
    """Median of the samples with light; 0 where there are none."""
    every = 1 + math.isqrt(field.values.size // 100_000)
    part = np.s_[..., ::every, ::every]
    lit = field.values[part][field.weight[part] > 0]
    return float(np.median(lit)) if lit.size else 0.0


def searched(field: LightField, across: float, views: int = 7) -> tuple[float, float]:
    """Disparities over the pupil at which some part of a light field is sharp, and a little more.

    Parameters
    ----------
    field : LightField
    across : float
        Samples of the views from rim to rim of the pupil.
    views : int
        As many along an axis are looked at.
    """
    if views == FEW_VIEWS and min(field.values.shape[2:]) >= MANY_PIXELS:
        field = _halved(field, views)
    sharp = sharp_disparities(field, views=views) * (across / field.pitch)
    return search_about(float(sharp.min()), float(sharp.max()))


def _halved(field: LightField, views: int) -> LightField:
    """Some views along each axis, of half as many pixels along each side: means of four, lit where all of them are."""
    every = math.ceil(max(len(field.s), len(field.t)) / views)
    t, s = (slice(axis.size // 2 % every, None, every) for axis in (field.t, field.s))
    rows, columns = (2 * (size // 2) for size in field.values.shape[2:])
    corners = [(t, s, slice(b, rows, 2), slice(a, columns, 2)) for b in (0, 1) for a in (0, 1)]
    values = np.float32(0.25) * reduce(np.add, [field.values[corner] for corner in corners])
    weight = reduce(np.minimum, [field.weight[corner] for corner in corners])
    v, u = ((axis[:size:2] + axis[1:size:2]) / 2 for axis, size in ((field.v, rows), (field.u, columns)))
    return LightField(values, weight, field.s[s], field.t[t], u, v, field.pitch)


def image_width(camera: Camera) -> float:
    """Diameter of a microlens image [px]."""
    return abs(float(microlens_image_diameter(camera) / camera.q))


def _looked_wide(
    look: Callable[..., Found], outside: Callable[[Found], tuple[float, float]], field: LightField,
    search: tuple[float, float], fixed: bool, progress: CountedProgress, what: str,
) -> Found:  # fmt: skip
    """Finding of `look` between two disparities, and further out as long as much of the scene lies beyond.

    `outside` tells the shares below and above. Where somebody named the two, `fixed`, they stay. Each look is a step
    of `progress`, called `what`.
    """
    found = look(search=search, progress=shares(progress, what))
    farthest = 0.5 * max(field.values.shape[2:]) * abs(float(field.u[1] - field.u[0]))
    for _ in range(0 if fixed else WIDER):
        low, high = search
        below, above = (share > BEYOND for share in outside(found))
        width = TWICE * (high - low)
        wider = max(low - width * below, -farthest), min(high + width * above, farthest)
        if wider == search or not wider[0] < wider[1]:
            break
        search, found = wider, look(search=wider, progress=shares(progress, f"{what}, in a wider search"))
    return found


def _noise_factor(estimate: DisparityMap) -> float:
    """Standard deviation of noise over that believed, as views differ; 1 where it is off in some places only.

    What occlusion and reflections add is confined to them; noise is everywhere.
    """
    some = estimate.chi2[estimate.chi2 > 0]
    if not some.size:
        return 1.0
    least, middle, most = (float(value) for value in np.quantile(some, (0.25, 0.5, 0.75)))
    return math.sqrt(middle) if least > OFF or most < 1 / OFF else 1.0


def measured_with_noise(
    geometry: ViewGeometry, field: LightField, noise: CaptureNoise, search: tuple[float, float], fixed: bool,
    begun: Start | None = None, progress: CountedProgress = silent,
) -> tuple[Depths, CaptureNoise]:  # fmt: skip
    """Depths of a light field and its noise, once more where views differ otherwise than that says, everywhere."""
    look = partial(measure, geometry, field, viewing=geometry.viewing(field))
    what = "measuring depth"

    def wide(search: tuple[float, float], noise: CaptureNoise, what: str) -> Depths:
        each = partial(look, noise.pixel)
        return _looked_wide(each, lambda run: run.disparities.outside, field, search, fixed, progress, what)

    if noise.measured:
        run = look(noise.pixel, search=search, begun=begun, progress=shares(progress, what))
        if (alike := run.disparities.alike) > 1.05:
            said = f"alike in neighbouring pixels, so that errors are {math.sqrt(alike):.2g} times as large"
            noise = replace(noise, source=f"{noise.source}, {said}")
        return run, noise
    run = wide(search, noise, what)
    # Where the noise is far off, few samples were used with their right weights: the second time tells it better.
    for _ in range(2):
        times = _noise_factor(run.disparities)
        if times == 1.0:
            break
        noise = replace(noise, pixel=noise.pixel.times(times), times=noise.times * times)
        run = wide(run.disparities.search, noise, f"{what} again, with the noise found")
    return run, noise


def measured_noise(
    geometry: ViewGeometry, field: LightField, search: tuple[float, float], fixed: bool = True,
    progress: CountedProgress = silent,
) -> tuple[CaptureNoise, DisparityMap, LightField]:  # fmt: skip
    """Noise of views that nobody knows the sensor of, what is left between them once they lie on each other; so how.

    The views come with it as they are measured, white being 1.
    """
    level = _brightness(field) or 1.0
    field = scaled(field, level)
    found = _roughly(geometry, field, search, fixed, progress)
    some = found.chi2[found.chi2 > 0]
    noise = max(FIRST_NOISE * math.sqrt(float(np.median(some))) if some.size else FIRST_NOISE, FAINTEST)
    said = f"what is left between views: {100 * noise:.2g} % of their brightness"
    pixel = PixelNoise(QUIET, QUIET * noise, measured=True)
    return CaptureNoise(pixel, level, said, True), found, field


def _roughly(
    geometry: ViewGeometry, field: LightField, search: tuple[float, float], fixed: bool = True,
    progress: CountedProgress = silent,
) -> DisparityMap:  # fmt: skip
    """Disparities of views by a guess of their noise and two corrections, as good as noise and order need them."""
    views = geometry.viewing(field).prepared(field)
    estimate = partial(
        estimate_disparity, views.field, views.pupil, PixelNoise(QUIET, QUIET * FIRST_NOISE), aside=views.aside,
        window=geometry.window,
    )  # fmt: skip
    look, what = partial(estimate, passes=0), "searching"
    found = _looked_wide(look, lambda one: one.outside, field, search, fixed, progress, what)
    measuring = shares(progress, "measuring noise")
    return estimate(search=found.search, begun=found.begun, passes=ROUGH, progress=measuring)


def disagreement(field: LightField, across: int) -> float:
    """Variance by which views of a small light field differ along their best disparities, in units of its own."""
    level = _brightness(field)
    if not level > 0:
        return 0.0
    some = _roughly(GridGeometry(across), scaled(field, level), searched(field, float(across), FEW_VIEWS)).chi2
    return float(np.median(some[some > 0])) if (some > 0).any() else 0.0


def with_errors_of(
    run: Depths, field: LightField, noise: PixelNoise, search: tuple[float, float], known_to: Mapping[str, float]
) -> Depths:
    """Depths whose calibration's error counts lengths known to some standard error, to first order.

    Each is moved by its own, and depth measured again: the FAP's diameter, say, tells how much of a sample's light is
    its neighbours'.

    Parameters
    ----------
    run : Depths
        Of an `ArrayGeometry`.
    field, noise, search
        What `measure` made it of.
    known_to : dict
        Standard errors [mm] by the lengths' places.
    """
    from scipy import ndimage

    assert isinstance(run.geometry, ArrayGeometry)
    around = 3 * run.disparities.window
    own = np.zeros(run.depth.shape) if run.calibration_sigma is None else run.calibration_sigma
    variance = own**2
    for place, sigma in known_to.items():
        moved = run.geometry.design.replace({place: float(run.geometry.camera[place]) + sigma})
        change = measure(replace(run.geometry, design=moved), field, noise, search=search).depth - run.depth
        known = np.isfinite(change)
        # A mean over neighbours: texture makes single changes scatter.
        square, count = (
            ndimage.uniform_filter(part, around, mode="constant")
            for part in (np.where(known, change, 0.0) ** 2, known.astype(float))
        )
        variance = variance + np.divide(square, count, out=np.zeros_like(square), where=count > 1e-9)
    return replace(run, calibration_sigma=np.where(run.measured, np.sqrt(variance), np.nan))


def scaled(field: LightField, level: float) -> LightField:
    """Light field with its values divided by `level`."""
    gain = np.float32(1 / (level or 1.0))
    rows = field.hexagonal
    rows = rows if rows is None else rows._replace(values=rows.values * gain)
    return replace(field, values=field.values * gain, hexagonal=rows)


def truth_of(geometry: GridGeometry, disparity: NDArray[np.floating]) -> NDArray[np.float64]:
    """Depths of a map of disparities from view to view [px], as benchmarks have them; NaN where it has none."""
    return geometry.depth(np.where(np.isfinite(disparity), disparity, np.nan) * geometry.across)
