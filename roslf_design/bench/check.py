"""Worth of what has been captured so far: each image, faults by name, how sure H and d_3 are, what to take next."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..calibration.corners import cells_of, observe
from ..calibration.decoding import LightField
from ..calibration.frames import Array, CalibrationError, Image
from ..calibration.model import Board
from ..calibration.raw import full_scale, read_raw
from ..design import Design
from ..progress import CountedProgress, silent
from ..tables import BriefValue
from ..theory.focused import refuse_focused
from .boards import FoundBoards, NextPose, left_poses, sigma_of
from .captures import KINDS, Bench, BenchCapture, BoardPose, Kind
from .reference import Reference, leak

OVER, DIM = 0.002, 0.2
"""Share of saturated pixels from which an image is overexposed, and level of its brightest below which it is too dark.
"""
_BRIGHTEST = 0.995
_STEEP = math.radians(5.0)


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


@dataclass(frozen=True)
class BenchCheck(BriefValue):
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
        leaks = {other: leak(white, dark) for other, dark in frames["dark"].items()}
        darks = [frames["dark"][other] for other, fault in leaks.items() if not fault]
        try:
            reference = Reference.of(design, name, white, next(iter(darks), None))
        except CalibrationError as error:
            checks[name] = checks[name].blamed(f"no white image of this camera: {' '.join(str(error).split())}")
            continue
        for other, fault in leaks.items():
            checks[other] = checks[other].blamed(fault)
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
        first = NextPose(left_poses(bench, ())[0], None)
        return BenchCheck(tuple(checks.values()), None, 0.0, first, missing=tuple(missing))
    looked = FoundBoards.of(bench, observations, reference.middle)
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
    sums = sigma_of(shares), looked.noise, looked.best(sound), by_images
    return BenchCheck(tuple(checks.values()), *sums, tuple(missing))


def _read(capture: BenchCapture, design: Design) -> tuple[Image, ImageCheck]:
    """Pixels of an image, with its level."""
    path, kind = capture.path, capture.kind
    pixels, notes = read_raw(path)
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


def _fields(
    bench: Bench,
    reference: Reference | None,
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
        low, high = np.maximum(np.nanquantile(view, (0.05, 0.95)), 0.0)  # noise of the dark is no contrast
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
