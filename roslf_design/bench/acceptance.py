"""Acceptance of a camera: what was measured of it beside its data sheet, and whether that lies in tolerance.

Verdicts are those of ISO 14253-1 (JCGM 106): a value is in tolerance where all of it +-U lies inside, out where all of
it lies outside, else undecided. A line without a tolerance is reported. Nothing is judged that depends on a picture
with a fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, NamedTuple

import numpy as np

from .._arrays import Array
from ..calibration.decoding import Decoder, LightField
from ..calibration.frames import CalibrationError, Capture
from ..calibration.options import CalibrateOptions
from ..calibration.outcome import calibrated, white_image
from ..calibration.refocusing import CameraDistances
from ..calibration.result import Outcome
from ..calibration.written import FILE, calibrated_camera, read_numbers
from ..camera import Camera
from ..depth.from_files import CaptureOptions, captured
from ..design import PATHS, Design
from ..errors import InputError, refusal
from ..evaluation.required import required_depth
from ..evaluation.resolved import resolved
from ..evaluation.specification import Specification, specification
from ..evaluation.stations import ASKED
from ..json_data import plain
from ..progress import CountedProgress, silent
from ..tables import BriefValue
from ..theory.chief_rays import chief_rays
from ..theory.depth_budget import COVERAGE, DepthBudget, depth_budget
from ..theory.depth_of_field import Kind
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from ..theory.quantities import QUANTITIES
from ..tolerancing.study import tolerance_plan
from ..tolerancing.trials import lengths_built
from ..toml_files import read_toml
from ..traced.fields import IdealImages
from ..words import number
from .captures import Bench, BenchCapture
from .check import BenchCheck, checked
from .edge import EdgeResponse, edges_in_view, edges_refocused, limit_of
from .field import FieldAngles, Rings, RingView
from .flatness import SphereSpacing, SurfaceFit
from .targets import LINE

Verdict = Literal["in tolerance", "out", "undecided", "reported"]
PLACED = 2e-3
"""Standard uncertainty of a target's distance, of itself, where nobody says otherwise."""
PRINTED = 1e-3
"""Standard uncertainty of a printed target's size, of itself: a scale bar read to a tenth of a millimetre in 100."""
STRAY_SPAN = 6.0
"""Range that holds all normal errors but three in a thousand [standard deviations]."""
LEAST_POINTS, TEXTURED = 50, 2.0
"""Microlenses with a depth that a wall takes, and their standard errors at most, over the middle one: beyond, a window
sees too little texture to count."""
FIELD, RESOLUTION, DEPTH, CAMERA, SENSOR = (
    "Field of view (ISO 8600-3, method B)", "Resolution (ISO 12233, e-SFR)", "Depth (VDI/VDE 2634-2)", "Camera",
    "Sensor",
)  # fmt: skip
RESULT = "result"
"""Folder of a calibration beside its images."""


def guarded(value: float, expanded: float, limits: tuple[float, float] | None) -> Verdict:
    """Verdict on a value with its expanded uncertainty; infinite limits bound nothing."""
    if limits is None:
        return "reported"
    low, high = limits
    if low <= value - expanded and value + expanded <= high:
        return "in tolerance"
    return "out" if value + expanded < low or value - expanded > high else "undecided"


@dataclass(frozen=True)
class AcceptanceLine:
    """One measured figure beside the data sheet's."""

    subject: str
    name: str
    unit: str
    value: float
    expanded: float
    """U, k = 2."""
    expected: float | None = None
    """Data sheet's line."""
    limits: tuple[float, float] | None = None
    remark: str = ""
    claimed: float | None = None
    """Expanded uncertainty that the camera itself reports with the figure, where `expanded` is the test's."""

    @property
    def verdict(self) -> Verdict:
        """Whether it lies in tolerance."""
        return guarded(self.value, self.expanded, self.limits)

    def to_dict(self) -> dict[str, Any]:
        """As JSON's types; limits that bound nothing are None."""
        limits = self.limits and [limit if math.isfinite(limit) else None for limit in self.limits]
        return asdict(self) | {"limits": limits, "verdict": self.verdict, "k": COVERAGE}


@dataclass(frozen=True)
class Acceptance(BriefValue):
    """All figures of a camera, and what stood in the way of others."""

    design: str
    lines: tuple[AcceptanceLine, ...]
    faults: tuple[str, ...]
    """Faults of pictures, each with the picture's name."""
    left_out: tuple[str, ...]
    """Figures that are missing, and why."""

    def count(self, verdict: Verdict) -> int:
        """Number of lines with a verdict."""
        return sum(line.verdict == verdict for line in self.lines)

    def to_dict(self) -> dict[str, Any]:
        """As JSON's types."""
        verdicts: tuple[Verdict, ...] = ("in tolerance", "out", "undecided", "reported")
        return {
            "schema": "roslf.acceptance/1",
            "design": self.design,
            "faults": list(self.faults),
            "lines": plain([line.to_dict() for line in self.lines]),
            "verdicts": {verdict: self.count(verdict) for verdict in verdicts},
            "left_out": list(self.left_out),
        }


class Frames(NamedTuple):
    """Mean white image and mean dark frame of a camera, and what its images are decoded with."""

    white: Path
    dark: Path | None
    capture: Capture
    decoder: Decoder

    @classmethod
    def of(cls, folder: Path, design: Design, progress: CountedProgress = silent) -> Frames:
        """Frames of a calibration's images; the means are written beside them.

        Raises
        ------
        CalibrationError
            No white image, or one without microlens images.
        """
        import tifffile

        plain, capture, centres = white_image(folder, design, progress)
        white, dark = folder / "mean-white.tif", None if plain.dark is None else folder / "mean-dark.tif"
        tifffile.imwrite(white, plain.white)
        if dark is not None:
            tifffile.imwrite(dark, plain.dark)
        shape = capture.white.shape
        decoder = Decoder.of(centres.lattice, shape, white=capture.white, dark=capture.dark)
        return cls(white, dark, capture, decoder)

    def field(self, path: Path) -> LightField:
        """Light field of an image of the same camera."""
        return self.decoder(self.capture.board(path))


@dataclass(frozen=True, eq=False)
class _Measuring:
    """A bench folder that is measured against its design's data sheet."""

    bench: Bench
    check: BenchCheck
    calibration: Path
    """Folder that roslf calibrate wrote."""
    frames: Frames
    build: LengthCovariance | None = None
    """Covariance of lengths by a tolerance study; without one lines have no tolerance."""
    placed: float = PLACED
    """Standard uncertainty of targets' distances, of themselves."""

    @cached_property
    def camera(self) -> Camera:
        """Camera as designed; e-SFR counts contrast against that of coarse detail, which a veil takes alike."""
        return Camera.of(self.bench.design.replace({"light.veil": 0.0}).thin_twin)

    @cached_property
    def numbers(self) -> Mapping[str, Any]:
        """Table of calibration.json."""
        return read_numbers(self.calibration)

    @cached_property
    def _calibrated(self) -> tuple[Camera, CalibratedLengths]:
        design, lengths = calibrated_camera(self.calibration)
        return Camera.of(design.thin_twin), lengths

    @cached_property
    def sheet(self) -> Specification:
        """Data sheet, with lines at the distances of edges."""
        at = sorted({ahead for _, ahead in self.good("edge")})
        return specification(self.bench.design.replace({"light.veil": 0.0}), at)

    def good(self, kind: Literal["edge", "wall", "spheres", "field"]) -> Iterator[tuple[BenchCapture, float]]:
        """Captures without a fault, and their distances ahead of the tip [mm]."""
        for capture in self.bench.of_kind(kind):
            if capture.path.name not in self.check.faulty:
                yield capture, float(capture.ahead or 0.0)

    def about(self, expected: float | None, compute: Callable[[Camera], Any]) -> tuple[float, float] | None:
        """Limits about the data sheet's line: two standard deviations over builds; None where no study gives any."""
        if expected is None or self.build is None or self.bench.design.main_lens.kind.faults:
            return None
        tolerance = COVERAGE * float(self.build.carried(self.camera, compute))
        return (expected - tolerance, expected + tolerance) if math.isfinite(tolerance) else None

    def scale(self, ahead: float) -> tuple[float, float]:
        """Span of a microlens pitch at a distance [mm], as calibrated, and its relative standard uncertainty."""
        camera, lengths = self._calibrated
        span = QUANTITIES["object_sample_mm"]
        at, step = float(span(camera, ahead)), 1e-3 * ahead
        slope = (float(span(camera, ahead + step)) - at) / step
        known = float(lengths.covariance.carried(camera, lambda builds: span(builds, ahead)))
        return at, math.hypot(known, slope * self.placed * ahead) / at

    def budget(self, ahead: float) -> DepthBudget:
        """Expected uncertainty of depth by the data sheet, of the calibrated camera."""
        camera = Camera.of(self.bench.design)
        return depth_budget(camera, ahead, build=self.build, calibration=self._calibrated[1])

    def depth_error(self, ahead: float) -> tuple[float, str]:
        """Error of depth that is in tolerance, U as required where the design requires one [mm]; and why, in words."""
        expected, required = float(self.budget(ahead).expanded_mm), required_depth(self.bench.design, ahead)
        words = f"depth, expected, U = {number(expected, 2)} mm"
        if required is None:
            return expected, words
        return required, f"as required, U = {number(required, 2)} mm; {words}"


def accepted(
    bench: Bench,
    calibration: Path,
    write: Callable[[Outcome], object],
    build: LengthCovariance | None = None,
    placed: float = PLACED,
    progress: CountedProgress = silent,
) -> Acceptance:
    """Acceptance of a camera by the captures of its bench, beside its data sheet.

    Parameters
    ----------
    calibration : Path
        Folder of a calibration; where it holds none, `write` puts that of the sound images there, without posterior.
    write : callable
    build : LengthCovariance, optional
        Covariance of lengths by a tolerance study; without one lines have no tolerance.
    placed : float
        Standard uncertainty of targets' distances, of themselves.
    progress : callable

    Raises
    ------
    InputError
        A calibration or captures that cannot be read, or a share that is none.
    CalibrationError
        Images without a fault that do not determine the camera.
    """
    if not 0 < placed < 1:
        raise refusal("placed", f"{placed:g} is no share of a distance; give 0.002 (0.2 %)")
    check, design = checked(bench, progress), bench.design

    def nothing(why: str) -> Acceptance:
        return Acceptance(design.name, (), check.faults, (f"everything: {' '.join(why.split())}",))

    given = (calibration / FILE).is_file()
    if given:
        resting = {one.name for one in check.images if one.kind in ("white", "dark")}
        resting.update(read_numbers(calibration).get("images_used", ()))
        if spoilt := sorted(check.faulty & resting):
            return nothing(f"the calibration depends on {', '.join(spoilt)}; calibrate again without")
    with TemporaryDirectory() as place:
        sound = Path(place)
        for path in bench.calibration.glob("*.*"):
            if path.is_file() and path.name not in check.faulty:
                (sound / path.name).symlink_to(path.resolve())
        try:
            if not given:
                options = CalibrateOptions(board=bench.setup.board.board.text, posterior=False)
                write(calibrated(sound, design, options, progress))
            measuring = _Measuring(bench, check, calibration, Frames.of(sound, design, progress), build, placed)
            told: list[AcceptanceLine | str] = []
            for done, step in enumerate(_STEPS):
                progress("measuring", done, len(_STEPS))
                told += step(measuring)
        except CalibrationError as error:
            if not check.faults:
                raise
            return nothing(str(error))
    progress("measuring", len(_STEPS), len(_STEPS))
    lines = tuple(one for one in told if not isinstance(one, str))
    return Acceptance(design.name, lines, check.faults, tuple(one for one in told if isinstance(one, str)))


def built_lengths(study: Path) -> LengthCovariance:
    """Covariance of a camera's lengths over the builds of a tolerance study; errors as of `tolerance_plan`."""
    return lengths_built(tolerance_plan(read_toml(study, str(study)), None, study.parent, str(study))[0])


Told = Iterator[AcceptanceLine | str]
"""Lines, and in their place sentences on why there are none."""


def _field_lines(m: _Measuring) -> Told:
    views: list[RingView] = []
    for capture, ahead in m.good("field"):
        try:
            views.append(_rings(m, capture, ahead))
        except (CalibrationError, InputError) as error:
            yield f"{capture.path.name}: {error}"
    views.sort(key=lambda view: view.ahead)
    if len(views) < 2 or views[-1].ahead <= 1.05 * views[0].ahead:
        yield "field of view: takes rings at two distances"
        return
    near, far = views[0], views[-1]
    angles: FieldAngles = FieldAngles.of(near, far, (m.placed * near.ahead, m.placed * far.ahead), PRINTED)
    pupil = m.sheet.field_of_view_deg[0]
    for k, (way, part) in enumerate((("width", "width_"), ("height", "height_"), ("diagonal", ""))):
        expected = float(getattr(pupil, way))
        limits = m.about(expected, QUANTITIES[f"field_of_view_{part}deg"])
        remark = f"rings at {number(near.ahead, 4)} and {number(far.ahead, 4)} mm"
        value, sigma = float(angles.degrees[k]), float(angles.sigma[k])
        yield AcceptanceLine(FIELD, way, "deg", value, COVERAGE * sigma, expected, limits, remark)
    behind, sigma = angles.pupil_behind_tip, angles.pupil_sigma
    yield AcceptanceLine(FIELD, "entrance pupil behind the tip", "mm", behind, COVERAGE * sigma)


def _rings(m: _Measuring, capture: BenchCapture, ahead: float) -> RingView:
    field, lattice = m.frames.field(capture.path), m.frames.decoder.lattice
    rows, columns = m.frames.decoder.shape
    corners = np.array([[x, y] for x in (-0.5, columns - 0.5) for y in (-0.5, rows - 0.5)])
    i, j = lattice.indices(corners).T
    step = float(field.v[1] - field.v[0])
    u, v = (i, j) if field.hexagonal is None else (i + 0.5 * j, step * j)
    # Of an array that is turned a little, means of both corners of a side; no farther than there is light.
    lit = field.view_weight() > 0
    light = np.array([[axis[some].min() - step / 2, axis[some].max() + step / 2] for axis, some in (
        (field.u, lit.any(axis=0)), (field.v, lit.any(axis=1)))])  # fmt: skip
    sensor = np.array([np.sort(u).reshape(2, 2).mean(axis=1), np.sort(v).reshape(2, 2).mean(axis=1)])
    short = np.abs(light - sensor) > 1.5
    ends = np.where(short, light, sensor)
    span = partial(QUANTITIES["object_sample_mm"], m.camera)
    sample, growth = float(span(ahead)), (float(span(1.01 * ahead)) - float(span(ahead))) / (0.01 * ahead)
    rings = Rings.of(m.bench.setup.field.printed_radii, LINE)
    return RingView.of(field.view(), lit, (field.u, field.v), ends, rings, ahead, sample, sample / growth)


def _resolution_lines(m: _Measuring) -> Told:
    distances = CameraDistances(m._calibrated[0])
    for capture, ahead in m.good("edge"):
        field = None
        looks: tuple[tuple[Kind, str], ...] = (("view", "a view"), ("refocused", "refocused"))
        for kind, words in looks:
            try:
                field = field or m.frames.field(capture.path)
                slope = distances.slope(float(m.camera.tip) + ahead)
                responses = edges_in_view(field, slope) if kind == "view" else edges_refocused(field, slope)
            except (CalibrationError, InputError) as error:
                yield f"resolution, {words}, {capture.path.name}: {error}"
                continue
            yield from _limits(m, responses, kind, words, ahead)


def _limits(m: _Measuring, responses: Sequence[EdgeResponse], kind: Kind, words: str, ahead: float) -> Told:
    """Frequencies of half and a tenth of the contrast."""
    axis = m.sheet.field[0].x_ml_mm
    row = next(r for r in m.sheet.resolution if r.image == kind and r.at_mm == ahead and r.x_ml_mm == axis)
    span, uncertain = m.scale(ahead)
    for level, expected in ((0.5, row.mtf50_lp_per_mm), (0.1, row.mtf10_lp_per_mm)):
        value, sigma = limit_of(responses, level)
        name = f"MTF {100 * level:g} %, {words}, {number(ahead, 4)} mm"
        if not math.isfinite(value):
            yield f"{name}: contrast does not fall so far"
            continue
        about = m.about(expected, partial(_resolved, axis, ahead, kind, level))
        limits = about and (about[0], math.inf)
        expanded = COVERAGE * value / span * math.hypot(sigma / value, uncertain)
        remark = f"{len(responses)} edge{'s' * (len(responses) > 1)}; the print's own blur is in it"
        yield AcceptanceLine(RESOLUTION, name, "lp/mm", value / span, expanded, expected, limits, remark)


def _resolved(axis: tuple[float, float], ahead: float, kind: Kind, level: float, builds: Camera) -> Array:
    rows = [resolved(IdealImages(builds.build(k), [axis]), 0, (ASKED, ahead), kind) for k in range(builds.shape[0])]
    return np.array([(r.mtf50_lp_per_mm if level == 0.5 else r.mtf10_lp_per_mm) or math.nan for r in rows])


def _depth_lines(m: _Measuring) -> Told:
    ways: tuple[tuple[Literal["wall", "spheres"], Callable[..., Told]], ...]
    ways = ("wall", _wall_lines), ("spheres", _sphere_lines)
    for kind, lines in ways:
        for capture, ahead in m.good(kind):
            at = f"{kind} at {number(ahead, 4)} mm"
            options = CaptureOptions(white=m.frames.white, dark=m.frames.dark, calibration=m.calibration)
            try:
                run = captured(capture.path, options).first
            except (CalibrationError, InputError) as error:
                yield f"depth, {at}: {error}"
                continue
            textured = run.measured & (run.noise_sigma <= TEXTURED * np.median(run.noise_sigma[run.measured]))
            z, camera = run.depth[textured], m._calibrated[0]
            x, y = chief_rays(camera, (run.x_ml[textured][:, 0], run.x_ml[textured][:, 1])).on_plane(z)
            points = np.stack([x, y, z - float(camera.tip)], axis=-1)
            common = 0.0 if run.calibration_sigma is None else float(np.nanmedian(run.calibration_sigma))
            window = float(run.disparities.window**2)
            yield from lines(m, ahead, at, points, run.noise_sigma[textured], window, common)


def _wall_lines(
    m: _Measuring, ahead: float, at: str, points: Array, sigma: Array, window: float, common: float
) -> Told:
    """Figures of a wall, by points (n, 3) from the tip [mm] and their standard errors, common ones apart."""
    on = (np.abs(points[:, :2]) < 0.45 * m.bench.setup.wall.printed_side).all(axis=1)
    if on.sum() < LEAST_POINTS:
        yield f"depth, {at}: too few microlenses have a depth"
        return
    plane, (expanded, why) = SurfaceFit.plane(points[on], sigma[on], window), m.depth_error(ahead)
    own = math.sqrt(float(plane.covariance[0, 0]))
    yield AcceptanceLine(
        DEPTH, f"error of depth, {at}", "mm", float(plane.parameters[0]) - ahead,
        COVERAGE * math.hypot(own, m.placed * ahead), 0.0, (-expanded, expanded),
        f"limits: {why}", COVERAGE * math.hypot(own, common),
    )  # fmt: skip
    yield from _ranges(m, plane, "flatness error", "a plane", ahead, at)


def _ranges(m: _Measuring, fit: SurfaceFit, form: str, shape: str, ahead: float, at: str) -> Told:
    """Range and rms of points about a surface, beside what noise alone is expected to leave."""
    noise = float(m.budget(ahead).of_kind("precision"))
    words = f"expected: noise of the data sheet's texture, {number(noise, 2)} mm, without what a texture puts off"
    error, rms = COVERAGE * fit.error_sigma, COVERAGE * fit.rms_sigma
    yield AcceptanceLine(DEPTH, f"{form}, {at}", "mm", fit.error, error, STRAY_SPAN * noise, remark=words)
    yield AcceptanceLine(DEPTH, f"off {shape}, rms, {at}", "mm", fit.rms, rms, noise)


def _sphere_lines(
    m: _Measuring, ahead: float, at: str, points: Array, sigma: Array, window: float, common: float
) -> Told:
    """Figures of a pair of spheres; arguments as of `_wall_lines`."""
    target, (expanded, why) = m.bench.setup.spheres, m.depth_error(ahead)
    reach = math.sqrt(window) / 2 * m.scale(ahead)[0]
    pair = SphereSpacing.of(points, sigma, window, target.diameter, target.spacing, reach)
    if pair is None:
        yield f"depth, {at}: shows no two spheres of their size so far apart"
        return
    limits, claimed = (-expanded, expanded), COVERAGE * math.hypot(pair.sigma, common * target.spacing / ahead)
    yield AcceptanceLine(
        DEPTH, f"sphere-spacing error, {at}", "mm", pair.spacing - target.spacing,
        COVERAGE * pair.sigma, 0.0, limits, f"limits: {why}", claimed,
    )  # fmt: skip
    if pair.size is None:
        yield f"probing error, size, {at}: windows of depth are too wide or too noisy to tell these spheres' diameter"
    else:
        spread = COVERAGE * pair.size_sigma
        yield AcceptanceLine(DEPTH, f"probing error, size, {at}", "mm", pair.size, spread, 0.0, limits)
    if not pair.caps:
        yield f"probing error, form, {at}: no window of depth lies on a sphere alone"
        return
    worst = max(pair.caps, key=lambda cap: cap.error)
    yield from _ranges(m, worst, "probing error, form", "a sphere", ahead, at)


def _camera_lines(m: _Measuring) -> Told:
    numbers, design = m.numbers, m.bench.design
    found = numbers["quantities"] | numbers.get("ruler", {})
    designed = Camera.of(design.thin_twin)
    pupil, veil = numbers.get("pupil") or {}, numbers.get("veil")
    h, d_3 = found["H"], found["d_3"]
    rows: list[tuple[str, str, float, float, str, str]] = [
        ("H", "aperture_constant", h["estimate"], h["sigma"], "", ""),
        ("d_3", "", d_3["estimate"], d_3["sigma"], "mm", ""),
    ]
    if pupil.get("diameter_mm") is not None:
        of_rim = COVERAGE * (pupil.get("sigma_of_rim_mm") or 0.0)
        remark = f"D_F: {number(of_rim, 2)} mm of U (type B) is how its rim may darken" if of_rim else ""
        rows.append(("D_F", "", pupil["diameter_mm"], pupil["sigma_mm"], "mm", remark))
    else:
        yield "D_F: " + str(pupil.get("untold") or "the calibration does not tell it")
    for name, quantity, value, sigma, unit, remark in rows:
        compute: Callable[[Camera], Any] = QUANTITIES[quantity] if quantity else partial(_length, PATHS[name])
        expected = float(np.asarray(compute(designed)))
        limits = m.about(expected, compute)
        yield AcceptanceLine(CAMERA, name, unit, value, COVERAGE * sigma, expected, limits, remark)
    if veil is None:
        yield "veil: the white image does not tell it (it takes a dark frame)"
        return
    share, sigma = veil["share"], veil["sigma"]
    yield AcceptanceLine(CAMERA, "veil", "%", 100 * share, 100 * COVERAGE * sigma, 100 * design.light.veil)


def _length(place: str, camera: Camera) -> Any:
    return camera[place]


def _sensor_lines(m: _Measuring) -> Told:
    told = m.numbers.get("sensor")
    if told is None:
        yield "noise: the calibration does not tell the sensor's"
        return
    sensor = m.bench.design.sensor
    rows = (
        ("gain", "gain", "e/count", 1.0, None), ("read noise", "read_noise", "e", 1.0, sensor.read_noise),
        ("full well", "full_well", "e", 1.0, sensor.full_well), ("PRNU", "prnu", "%", 100.0, 100 * sensor.prnu),
    )  # fmt: skip
    for name, key, unit, factor, expected in rows:
        if (figure := told.get(key)) is None:
            continue
        called = ", ".join(filter(None, (name, figure.get("bound"))))
        value, spread = factor * figure["value"], factor * COVERAGE * figure["sigma"]
        yield AcceptanceLine(SENSOR, called, unit, value, spread, expected)
    for reason in told.get("untold", ()):
        yield f"noise: {reason}"


_STEPS = (_field_lines, _resolution_lines, _depth_lines, _camera_lines, _sensor_lines)
