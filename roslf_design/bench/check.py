"""Worth of what has been captured so far: each image, faults by name, how sure H and d_3 are, what to take next."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..calibration.centres import find_centres
from ..calibration.corners import cells_of, observe
from ..calibration.decoding import Decoder, LightField
from ..calibration.fit import calibrate, corner_statistics, fit_at, fit_lines, shared_names, undetermined
from ..calibration.frames import (
    Array,
    CalibrationError,
    ColourBalance,
    Frame,
    Image,
    grey_frame,
    read_image_and_notes,
    same_size,
)
from ..calibration.lattice import CentreLattice
from ..calibration.model import Board, Intrinsics, Observations, Poses, project_boards, rotation_matrix
from ..calibration.options import SheetOptions, data_sheet
from ..calibration.planning import Captures, camera_of, pupil_of
from ..calibration.posterior import variance_shares
from ..calibration.raw import OTHER_CAMERA, full_scale
from ..calibration.result import image_pitch, undistorted_radius
from ..camera import Camera
from ..design import Design
from ..errors import InputError, Problem
from ..progress import CountedProgress, silent
from ..theory.colours import filters
from ..theory.focused import refuse_focused
from .captures import KINDS, Bench, BenchCapture, BoardPose, Kind
from .protocol import described, placed, planned_poses

OVER, DIM = 0.002, 0.2
"""Share of saturated pixels from which an image is overexposed, and level of its brightest below which it is too dark.
"""
_BRIGHTEST = 0.995
_LEAK = 0.01
"""Share of the white image in a dark frame that counts as light."""
_ODD, _OTHER = 0.05, 0.08
"""Share by which a board's cells may look smaller or larger than those of the other images, and than bench.toml says:
cameras are built to a few per cent of their design's magnification."""
_SLOPES = 0.15
"""Share that diffraction may take of views' slopes, and so of how far from focus a board looks."""
_STEEP = math.radians(5.0)
_MOVED = 0.03
"""Shift of centres at the image's edge that counts as one [px]."""
_SURE = 5.0
_MOST_LENSES = 20_000
_CORE = 0.3
"""Least light of a microlens whose centre is compared, over the brightest's."""


_Shares = dict[str, dict[str, float]]
"""For each length its standard deviation, and shares of its variance, as of `variance_shares`."""


@dataclass(frozen=True)
class ImageCheck:
    """One image's worth."""

    name: str
    kind: Kind
    saturated: float = 0.0
    """Share of saturated pixels."""
    level: float | None = None
    """Brightest pixels over full scale; None where nothing tells full scale."""
    contrast: float | None = None
    """Michelson contrast of the central view."""
    corners: tuple[int, int] | None = None
    """Corners seen in the central view, and of the whole board."""
    views: int = 0
    """Views in which the board was followed."""
    pose: BoardPose | None = None
    faults: tuple[str, ...] = ()

    def blamed(self, fault: str) -> ImageCheck:
        """Image with one more fault, if it is one."""
        return replace(self, faults=(*self.faults, fault)) if fault else self

    def to_dict(self) -> dict[str, Any]:
        """As JSON's types; lengths in mm, angles in degrees."""
        plain = {name: getattr(self, name) for name in ("name", "kind", "saturated", "level", "contrast", "views")}
        return plain | {
            "corners": self.corners and list(self.corners),
            "pose": self.pose and self.pose.to_dict(),
            "faults": list(self.faults),
        }


class NextPose(NamedTuple):
    """Pose that makes d_3 surest."""

    pose: BoardPose
    sigma: dict[str, float] | None
    """Standard deviations once it is taken; None where more are needed still."""

    def to_dict(self) -> dict[str, Any]:
        """As JSON's types."""
        return {"file": self.pose.file, **self.pose.to_dict(), "sigma": self.sigma}


@dataclass(frozen=True)
class BenchCheck:
    """Worth of all captures."""

    images: tuple[ImageCheck, ...]
    sigma: dict[str, float] | None
    """Standard deviations of H, d_3 and the rest by the images so far [mm or 1]; None where they determine none."""
    noise: float
    """Standard deviation of a corner's coordinate in a view [pitches]."""
    best: NextPose
    by_images: float = 0.0
    """Share of d_3's variance that more images could take down; the rest is the data sheet's and the board's."""
    missing: tuple[str, ...] = ()
    """Captures that the protocol asks for and that are not there."""

    @property
    def boards(self) -> tuple[ImageCheck, ...]:
        """Images in which the board was found, without a fault."""
        return tuple(one for one in self.images if one.pose is not None and not one.faults)

    @property
    def faults(self) -> tuple[str, ...]:
        """Faults of all images, each with its image's name."""
        return tuple(f"{one.name}: {fault}" for one in self.images for fault in one.faults)

    @property
    def faulty(self) -> frozenset[str]:
        """Names of images with a fault."""
        return frozenset(one.name for one in self.images if one.faults)

    @property
    def tilts(self) -> dict[str, int]:
        """Images of boards tilted by 5 degrees or more, by the sides that are nearer."""
        poses = [one.pose for one in self.boards if one.pose is not None]
        return {
            side: sum(pose.tilt * math.cos(pose.towards - k * math.pi / 2) >= _STEEP for pose in poses)
            for k, side in enumerate(("right", "top", "left", "bottom"))
        }

    def to_dict(self) -> dict[str, Any]:
        """As JSON's types."""
        return {
            "schema": "roslf.bench-check/1",
            "images": [one.to_dict() for one in self.images],
            "boards": len(self.boards),
            "corner_noise_pitches": self.noise,
            "sigma": self.sigma,
            "tilted_towards": self.tilts,
            "d_3_variance_by_images": self.by_images,
            "next": self.best.to_dict(),
            "missing": list(self.missing),
            "faults": list(self.faults),
        }


def checked(bench: Bench, progress: CountedProgress = silent) -> BenchCheck:
    """Worth of the captures in a bench folder.

    Raises
    ------
    InputError
        An image that cannot be read; a focused camera, whose views are none.
    """
    design = bench.design
    refuse_focused(design, "calibration of views")
    checks: dict[str, ImageCheck] = {}
    frames: dict[Kind, dict[str, Image]] = {"white": {}, "dark": {}}
    for capture in (*bench.of_kind("white"), *bench.of_kind("dark")):
        pixels, checks[capture.path.name] = _read(capture, design)
        frames[capture.kind][capture.path.name] = pixels
    reference = None
    for name, white in frames["white"].items():
        if checks[name].faults:
            continue
        for other, dark in frames["dark"].items():
            if not checks[other].faults:
                checks[other] = checks[other].blamed(_leak(white, dark))
        darks = [dark for other, dark in frames["dark"].items() if not checks[other].faults]
        try:
            reference = _Reference.of(design, name, white, next(iter(darks), None))
        except CalibrationError as error:
            checks[name] = checks[name].blamed(f"no white image of this camera: {' '.join(str(error).split())}")
            continue
        break
    if reference is not None:
        for name, white in frames["white"].items():
            if not checks[name].faults and name != reference.name:
                checks[name] = checks[name].blamed(reference.moved(white, name))
    views: dict[str, Array] = {}
    fields = _fields(bench, reference, checks, views, progress)
    board, observations = bench.setup.board.board, None
    with suppress(CalibrationError):  # none shows the board; each is told why below
        observations = observe(fields, board, lens_shape=design.microlens_array.lens_shape)
    for name in views:
        if not checks[name].faults and (observations is None or name not in observations.names):
            checks[name] = checks[name].blamed(_instead(views[name], board))
    missing: list[str] = [kind for kind in KINDS if kind != "board" and not bench.of_kind(kind)]
    captured = {Path(name).stem for name in checks}
    missing += [pose.file for pose in bench.setup.poses if Path(pose.file).stem not in captured]
    if observations is None or reference is None:
        first = NextPose(_left(bench, ())[0], None)
        return BenchCheck(tuple(checks.values()), None, 0.0, first, missing=tuple(missing))
    looked = _Boards.of(bench, observations, reference.middle)
    for k, name in enumerate(observations.names):
        found = np.isfinite(observations.uv[k, ..., 0])
        central = int(found[int(np.argmin(np.hypot(*observations.views.T)))].sum())
        checks[name] = replace(
            checks[name],
            pose=looked.described(k),
            corners=(central, len(board.points)),
            views=int((found.sum(axis=1) >= 4).sum()),
        )
        if not checks[name].faults:
            checks[name] = checks[name].blamed(looked.wrong_size(k))
    sound = [k for k, name in enumerate(observations.names) if not checks[name].faults]
    looked = looked.scattered(sound)
    shares = looked.shares(sound)
    by_images = 0.0 if shares is None else shares["d_3"]["images"]
    sums = _sigma(shares), looked.noise, looked.best(sound), by_images
    return BenchCheck(tuple(checks.values()), *sums, tuple(missing))


def _read(capture: BenchCapture, design: Design) -> tuple[Image, ImageCheck]:
    """Pixels of an image, with its level."""
    path, kind = capture.path, capture.kind
    try:
        pixels, notes = read_image_and_notes(path)
        grey_frame(pixels, None, "picture")
    except CalibrationError as error:
        said = str(error).removeprefix(f"{path.name} ")
        raise InputError((Problem("", said),), str(path)) from None
    full, fault = full_scale(pixels, notes, design.sensor.bits, None), ""
    if full is None:
        return pixels, ImageCheck(path.name, kind)
    level = float(np.quantile(pixels.ravel()[:: 1 + pixels.size // 10**6], _BRIGHTEST)) / full
    saturated = float(np.mean(pixels >= full))
    if kind != "dark" and saturated > OVER:
        fault = f"overexposed: {100 * saturated:.2g} % of its pixels reach full scale; expose less"
    elif kind != "dark" and level < DIM:
        fault = f"too dark: its brightest reach {100 * level:.2g} % of full scale; expose more"
    return pixels, ImageCheck(path.name, kind, saturated, level).blamed(fault)


def _leak(white: Image, dark: Image) -> str:
    """Fault of a dark frame in which the white image shows."""
    if white.shape != dark.shape:
        return "is of another size than the white image; use one camera setting"
    even = grey_frame(white)
    apart = even - even.mean(dtype=float)
    share = float((apart * grey_frame(dark)).mean(dtype=float) / max(np.square(apart).mean(dtype=float), 1e-30))
    return f"light in the dark frame: {100 * share:.2g} % of the white image's; put the cap on" if share > _LEAK else ""


@dataclass(frozen=True, eq=False)
class _Reference:
    """White image that all others are held against."""

    name: str
    even: Frame
    dark: Image | None
    balance: ColourBalance | None
    lattice: CentreLattice
    decoder: Decoder

    @classmethod
    def of(cls, design: Design, name: str, white: Image, dark: Image | None) -> _Reference:
        """Reference of a white image; `CalibrationError` where it is none of this camera."""
        balance = ColourBalance.of(white, dark) if filters(design.sensor.colours) else None
        if balance is not None:
            white, dark = balance(white, "white image"), None
        pitch, radius = image_pitch(design), undistorted_radius(design) or None
        layout = design.microlens_array.layout
        lattice = find_centres(white, dark, layout=layout, pitch=pitch, undistorted_radius=radius).lattice
        if abs(lattice.pitch / pitch - 1) > OTHER_CAMERA:
            raise CalibrationError(f"its microlens images stand {lattice.pitch:.4g} px apart, the design's {pitch:.4g}")
        decoder = Decoder.of(lattice, white.shape, white=white, dark=dark)
        return cls(name, grey_frame(white, dark, "white image"), dark, balance, lattice, decoder)

    def frame(self, pixels: Image, name: str) -> Image:
        """Pixels as the decoder takes them; `CalibrationError` where they are of another size."""
        same_size(name, pixels.shape, "white image", self.even.shape)
        return pixels if self.balance is None else self.balance(pixels, name)

    def moved(self, pixels: Image, name: str) -> str:
        """Fault of an image whose microlens images are not where the white image has them."""
        try:
            shift = shifted(self.even, grey_frame(self.frame(pixels, name), self.dark, name), self.lattice)
        except CalibrationError as error:
            return " ".join(str(error).split())
        return "" if shift is None or not shift.real else shift.words

    @property
    def middle(self) -> Array:
        """Middle of the array as decoded [pitches]."""
        i, j = self.lattice.indices((np.array(self.even.shape[::-1]) - 1) / 2)
        return np.array([i, j] if self.lattice.layout == "square" else [i + j / 2, math.sqrt(3) / 2 * j])


def _fields(
    bench: Bench,
    reference: _Reference | None,
    checks: dict[str, ImageCheck],
    views: dict[str, Array],
    progress: CountedProgress,
) -> Iterator[tuple[str, LightField]]:
    """Light fields of the boards, one at a time; `checks` get a line for every image, `views` the boards' views."""
    captures = [one for one in bench.captures if one.kind not in ("white", "dark")]
    for number, capture in enumerate(captures):
        progress("images", number, len(captures))
        name = capture.path.name
        pixels, check = _read(capture, bench.design)
        checks[name] = check
        if reference is None:
            continue
        try:
            light = reference.decoder(reference.frame(pixels, name))
        except CalibrationError as error:
            checks[name] = check if check.faults else check.blamed(" ".join(str(error).split()))
            continue
        view = np.where(light.view_weight() > 0, light.view(), np.nan)
        low, high = np.nanquantile(view, (0.05, 0.95))
        check = replace(check, contrast=float((high - low) / max(high + low, 1e-30)))
        checks[name] = check.blamed(reference.moved(pixels, name))
        if capture.kind == "board":
            views[name] = view
            yield name, light


def _instead(view: Array, board: Board) -> str:
    """Fault of an image without the board, with the board that it shows instead."""
    cells = cells_of(view)
    if cells is not None and sorted(cells) != sorted((board.columns, board.rows)):
        return f"wrong target: a board of {cells[0]} x {cells[1]} cells, bench.toml says {board.text}"
    return f"no board of {board.columns} x {board.rows} cells was found; check board, light and distance"


class Shift(NamedTuple):
    """How far microlens images lie from those of the white image."""

    offset: tuple[float, float]
    """In the middle [px]."""
    growth: float
    """Growth of the pitch, relative."""
    edge: float
    """Largest shift, at the image's edge [px]."""
    error: float
    """Standard deviation of that [px]."""

    @property
    def real(self) -> bool:
        """Whether it is one."""
        return self.edge > max(_MOVED, _SURE * self.error)

    @property
    def words(self) -> str:
        """Fault that it is."""
        return (
            f"refocused, or moved, since the white image: microlens images lie {self.edge:.2f} px off at the"
            f" edge (pitch {1e6 * self.growth:+.0f} ppm, middle {self.offset[0]:+.2f}, {self.offset[1]:+.2f} px);"
            " capture both anew"
        )


def shifted(white: Frame, frame: Frame, lattice: CentreLattice) -> Shift | None:
    """Shift of an image's microlens images against the white image's; None where too few are lit evenly.

    Each microlens's pixels are a multiple of the white image's and of its two slopes, whose shares are the shift.
    Scenes that are brighter on one side of a microlens image shift it as well, one way here, the other way there: the
    lattice's common shift and growth are fitted with what lies far off left out.
    """
    half = int(lattice.pitch // 2)
    nodes = lattice.nodes(*lattice.inside(white.shape).T)
    nodes = nodes[((nodes >= half + 2) & (nodes < np.array(white.shape[::-1]) - half - 3)).all(axis=1)]
    nodes = nodes[:: 1 + len(nodes) // _MOST_LENSES]
    at = np.rint(nodes).astype(int)
    side = np.arange(-half, half + 1)
    rows, columns = at[:, 1, None, None] + side[:, None], at[:, 0, None, None] + side
    slopes = [-np.asarray(np.gradient(white, axis=axis)) for axis in (1, 0)]
    parts = np.stack([part[rows, columns].reshape(len(at), -1) for part in (white, *slopes)], axis=-1)
    seen = frame[rows, columns].reshape(len(at), -1, 1).astype(float)
    across = np.swapaxes(parts, 1, 2).astype(float)
    normal = across @ parts + 1e-9 * np.eye(3) * np.trace(across @ parts, axis1=1, axis2=2)[:, None, None]
    shares = np.linalg.solve(normal, across @ seen)[..., 0]
    rest = np.square(seen - parts @ shares[..., None]).mean(axis=(1, 2)) / np.maximum(
        np.square(seen).mean(axis=(1, 2)), 1e-30
    )
    lit = (shares[:, 0] > _CORE * np.quantile(shares[:, 0], 0.9)) & (rest <= np.median(rest))
    if lit.sum() < 20:
        return None
    middle = (np.array(white.shape[::-1]) - 1) / 2
    away, off = (nodes - middle)[lit], shares[lit, 1:] / shares[lit, :1]
    matrix = np.zeros((len(off), 2, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = 1.0
    matrix[:, :, 2] = away
    near = np.ones(len(off), bool)
    for _ in range(5):
        design, target = matrix[near].reshape(-1, 3), off[near].ravel()
        best = np.linalg.lstsq(design, target, rcond=None)[0]
        gone = np.hypot(*(off - matrix @ best).T)
        near = gone < 3 * np.median(gone)
    spread = float(np.sqrt(np.square((off - matrix @ best)[near]).mean()))
    errors = spread * np.sqrt(np.diag(np.linalg.inv(matrix[near].reshape(-1, 3).T @ matrix[near].reshape(-1, 3))))
    reach = float(np.hypot(*middle))
    edge = float(np.hypot(best[0], best[1])) + abs(float(best[2])) * reach
    return Shift((float(best[0]), float(best[1])), float(best[2]), edge, float(np.hypot(errors[0], errors[2] * reach)))


@dataclass(frozen=True, eq=False)
class _Boards:
    """Boards that were found, by the design's camera."""

    bench: Bench
    observations: Observations
    camera: Intrinsics
    poses: Poses
    sizes: Array
    """Size of the cells, by parallax, over what bench.toml says, shape (b,)."""
    doubts: Array
    """Error that diffraction may make of it, shape (b,)."""
    noise: float

    @classmethod
    def of(cls, bench: Bench, observations: Observations, middle: Array) -> _Boards:
        """Poses by each board's own corners in the central view, from which parallax follows."""
        import cv2

        camera, lines = camera_of(bench.design), fit_lines(observations)
        pinhole = np.diag([camera.A / camera.d, camera.A / camera.d, 1.0])
        vectors, sizes, doubts = [], [], []
        for central, slope in zip(lines.central, lines.slope, strict=True):
            seen = np.isfinite(central[:, 0])
            points = np.ascontiguousarray(observations.points[seen])
            image = np.ascontiguousarray(middle - central[seen])
            pose = np.concatenate(cv2.solvePnP(points, image, pinhole, None)[1:]).ravel()
            vectors.append(pose)
            depth = points @ rotation_matrix(pose[:3])[2] + pose[5]
            by_parallax = camera.m - slope[seen] * camera.d / (camera.q * camera.A * camera.inverse_d_2)
            sizes.append(float(np.nanmean(camera.A / depth) / np.nanmean(by_parallax)))
            doubts.append(_SLOPES * abs(float(np.nanmean(by_parallax)) / camera.m - 1))
        noise = lines.sigma if lines.sigma > 0 else Captures().noise
        looks = np.array(sizes), np.array(doubts)
        return cls(bench, observations, camera, Poses.from_vector(np.array(vectors)), *looks, noise)

    def described(self, k: int) -> BoardPose:
        """Pose of a board, as of the protocol."""
        rotation, place = self.poses.rotation[k].tolist(), self.poses.translation[k].tolist()
        # Colours that leave half a turn open do so here.
        return described(rotation, place, self._ahead, self.observations.names[k])

    @property
    def _ahead(self) -> float:
        return float(Camera.of(self.bench.design).tip) - pupil_of(self.bench.design)

    def wrong_size(self, k: int) -> str:
        """Fault of a board whose cells are not as large as bench.toml says."""
        size, usual, doubt = float(self.sizes[k]), float(np.median(self.sizes)), float(self.doubts[k])
        cell = self.bench.setup.board.board.cell
        if abs(size - 1) > _OTHER + doubt or (len(self.sizes) > 2 and abs(size / usual - 1) > _ODD + doubt):
            return f"wrong target, or another focus: cells look {size * cell:.3g} mm wide, bench.toml says {cell:g} mm"
        return ""

    def scattered(self, sound: list[int]) -> _Boards:
        """Boards whose corners' noise is what the sound ones scatter by about the camera that fits them, if one does.

        Errors in neighbouring views go together: scatter about lines through the views promises too much.
        """
        design, names = self.bench.design, self.observations.names
        sheet = data_sheet(design, self.bench.setup.board.board, SheetOptions())
        part = replace(self.observations, uv=self.observations.uv[sound], names=tuple(names[k] for k in sound))
        try:
            fit = calibrate(part, sheet, distortion=design.main_lens.kind.radial, guess=self.camera.A).fit
        except CalibrationError:
            return self
        return replace(self, noise=self.noise * max(1.0, *fit.scales))

    def shares(self, sound: list[int], more: tuple[BoardPose, ...] = ()) -> _Shares | None:
        """Variances that sound boards, and more, would leave at the design's camera; None where something is open."""
        design, board = self.bench.design, self.bench.setup.board.board
        count = len(sound) + len(more)
        if count < 2:
            return None
        added = [placed(more, self._ahead).vector] if more else []
        poses = Poses.from_vector(np.concatenate([self.poses.vector[sound], *added]))
        views, points = self.observations.views, self.observations.points
        uv = np.array(project_boards(self.camera.vector(), poses.vector, points, views).values)
        uv[: len(sound)][~self.observations.seen[sound]] = np.nan
        corners = replace(self.observations, uv=uv, names=tuple(map(str, range(count))), missing=())
        statistics = corner_statistics(corners, fit_lines(corners), self.noise)
        fit = fit_at(statistics, self.camera, poses, shared_names(design.main_lens.kind.radial))
        if undetermined(fit.covariance, self.camera, count):
            return None
        return variance_shares(fit, data_sheet(design, board, SheetOptions()))

    def best(self, sound: list[int]) -> NextPose:
        """Pose that leaves d_3 surest, of those planned that are left, or of another round."""
        taken = [self.observations.names[k] for k in sound]
        after = [NextPose(pose, _sigma(self.shares(sound, (pose,)))) for pose in _left(self.bench, taken)]
        return min(after, key=lambda one: math.inf if one.sigma is None else one.sigma["d_3"])


def _sigma(shares: _Shares | None) -> dict[str, float] | None:
    return None if shares is None else {name: share["sigma"] for name, share in shares.items()}


def _left(bench: Bench, taken: Collection[str]) -> tuple[BoardPose, ...]:
    """Poses that are planned and not taken; where all are, those of another round."""
    stems = {Path(name).stem for name in taken}
    poses, round_ = bench.setup.poses, 0
    while not (left := tuple(pose for pose in poses if Path(pose.file).stem not in stems)):
        round_ += 1
        captures = Captures.for_design(bench.design, board=bench.setup.board.board, boards=len(bench.setup.poses) or 12)
        poses = planned_poses(bench.design, captures, bench.setup.seed, round_)
    return left
