"""Captures of a bench as a built camera would take them: rendered, with noise, PRNU, a veil and targets that lean."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from roslf_design.bench.captures import ACCEPTANCE, CALIBRATION, DESIGN, SETUP, Setup
from roslf_design.bench.targets import LINE, texture
from roslf_design.calibration.model import Board
from roslf_design.camera import Camera
from roslf_design.depth.pictures import SHIFTING
from roslf_design.design import Design, dumps
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.scenes import Scene, make_scene

PAPER, INK, ROOM = 0.9, 0.06, 0.4
"""Reflectances of paper and ink, and what stands behind a target."""
GAIN, BLACK, READ, PRNU, VEIL = 2.5, 60.0, 3.0, 0.008, 0.01
"""Electrons a count, black level [counts], read noise [electrons], PRNU, veil over a fully lit pixel."""
FULL, LEVEL = 4095, 0.7
"""Largest count, and the level of a fully lit pixel over it."""
BY_RAYS = 5e-6
"""Wavelength at which nothing is diffracted [mm]. An effect that the design has is never left out of a picture: what
measures it allows for it (without diffraction a wall of the rigid scope then lies 2.8 mm farther, without microlenses'
defocus 1.1 mm, without those that depth alone sees, `SHIFTING`, 0.4 mm nearer where it stands 0.8 mm off focus)."""
SAMPLING = RaySampling(least=32, most=96, tolerance=0.01)
FRAMES = 4
"""White images, and dark frames."""
LEANS, PLACED = math.radians(1.0), 1e-3
"""Standard deviations of a target's lean along each axis, and of its distance, of itself."""


@dataclass(frozen=True)
class Build:
    """One camera as built, and how it is rendered."""

    design: Design
    seed: int
    sampling: RaySampling = SAMPLING

    @classmethod
    def drawn(cls, design: Design, seed: int, **look: Any) -> Build:
        """Build with lengths that differ from the design's: d_3 by 1 %, d_1 by 0.2 %, D_F by 2 %, d_2 by 1 %."""
        rng = np.random.default_rng([seed, 1])
        off = {"d_3": 0.01, "d_1": 0.002, "D_F": 0.02}
        lengths = {name: getattr(design, name) * (1 + sigma * rng.normal()) for name, sigma in off.items()}
        return cls(design.replace({"name": f"{design.name}, build {seed}"}, **lengths), seed, **look)


@dataclass
class Bench:
    """A bench folder that is filled with a build's captures."""

    folder: Path
    setup: Setup
    build: Build
    rng: np.random.Generator = field(init=False)
    stood: dict[str, float] = field(default_factory=dict)
    """Distance of each target ahead of the tip, by its file [mm]: names tell it less well."""

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.build.seed, 2])
        width, height = self.build.design.pixels
        self.gains = 1 + PRNU * self.rng.standard_normal((height, width))
        self.tip = float(Camera.of(self.build.design).tip)

    def begun(self, nominal: Design) -> Bench:
        """With the design and the setup written."""
        for name in (CALIBRATION, ACCEPTANCE):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        (self.folder / DESIGN).write_text(dumps(nominal), encoding="utf-8")
        (self.folder / SETUP).write_text(self.setup.dumps(), encoding="utf-8")
        return self

    def exposed(self, light: NDArray[Any], times: float = 1.0) -> NDArray[np.uint16]:
        """Counts of one exposure."""
        electrons = times * (light + VEIL) * self.gains * LEVEL * FULL * GAIN
        noisy = self.rng.poisson(np.maximum(electrons, 0)) + READ * self.rng.standard_normal(light.shape)
        return np.clip(np.rint(noisy / GAIN + BLACK), 0, FULL).astype(np.uint16)

    def rendered(self, scene: Scene | None, **changed: Any) -> NDArray[np.float64]:
        """Light of each pixel, 1 where white paper fills it, by the build with a few values changed."""
        build = self.build
        design = build.design.replace(changed)
        picture = render(design, scene, sampling=build.sampling, overrides=SHIFTING, seed=build.seed)
        return np.asarray(picture.pixels, float)

    def save(self, name: str, counts: NDArray[np.uint16]) -> None:
        """Write one capture."""
        tifffile.imwrite(self.folder / name, counts)

    def even(self, times: float = 1.0) -> None:
        """White images and dark frames."""
        white = self.rendered(None)
        for k in range(1, FRAMES + 1):
            self.save(f"{CALIBRATION}/white_{k}.tif", self.exposed(white, times))
            self.save(f"{CALIBRATION}/dark_{k}.tif", self.exposed(np.zeros_like(white) - VEIL))

    def plane(self, picture: NDArray[Any], width: float, ahead: float, tilt: tuple[float, float], **more: Any) -> Scene:
        """A printed target that stands ahead of the tip."""
        file = self.folder / "printed.png"
        Image.fromarray(np.round(65535 * np.asarray(picture)).astype(np.uint16)).save(file)
        size = width, width * picture.shape[0] / picture.shape[1]
        # A file of the same name and size that is written within a clock's tick would be taken for the one before.
        named = file.with_name(f"printed-{self.rng.integers(2**60)}.png")
        file.rename(named)
        texture_ = {"kind": "image", "file": str(named), "width": width}
        plane = {"kind": "plane", "distance": self.tip + ahead, "tilt": tilt, "size": size, "texture": texture_, **more}
        return make_scene({"name": "target", "objects": [plane], "background": ROOM})

    def taken(self, name: str, picture: NDArray[Any], width: float, times: float = 1.0) -> None:
        """Capture of a printed target at the distance in its name, as well as a hand places it."""
        ahead = float(name.split("_")[1].removesuffix(".tif").removesuffix("mm"))
        ahead *= 1 + PLACED * self.rng.standard_normal()
        aside = 0.02 * ahead * self.rng.standard_normal(2)
        lean = tuple((LEANS * self.rng.standard_normal(2)).tolist())
        scene = self.plane(picture, width, ahead, lean, centre=tuple(aside.tolist()))
        self.stood[name] = ahead
        # By rays an edge's contrast is known; rendering takes diffraction within a microlens as incoherent, which moves
        # MTF 50 % of the rigid scope by 3 to 7 %.
        sharp = {"light.wavelength": BY_RAYS} if name.startswith("edge") else {}
        self.save(f"{ACCEPTANCE}/{name}", self.exposed(self.rendered(scene, **sharp), times))

    def boards(self) -> Iterator[str]:
        """Images of the board in the poses of bench.toml, one after the other."""
        board, cell = self.setup.board.board, self.setup.board.board.cell
        for pose in self.setup.poses:
            picture = board_picture(board, pose.turn)
            across = (math.hypot(board.columns + 2, board.rows + 2)) * cell
            tilt = pose.rotation[0], pose.rotation[1]
            scene = self.plane(picture, across, pose.ahead, tilt, centre=(pose.right, pose.up))
            self.save(f"{CALIBRATION}/{pose.file}", self.exposed(self.rendered(scene)))
            yield pose.file

    def spheres(self, name: str, ahead: float) -> None:
        """Capture of the pair before a wall."""
        target = self.setup.spheres
        here = self.tip + ahead * (1 + PLACED * self.rng.standard_normal())
        noise = {"kind": "noise", "finest": 2 * target.finest, "contrast": 0.12, "mean": 0.6}
        way = self.rng.normal(0, 0.05)
        balls = [
            {
                "kind": "sphere", "radius": target.diameter / 2, "distance": here,
                "centre": (side * math.cos(way) * target.spacing / 2, side * math.sin(way) * target.spacing / 2),
                "texture": {**noise, "seed": 5 + side},
            }
            for side in (-1, 1)
        ]  # fmt: skip
        wall = {"kind": "plane", "distance": here + 1.2 * target.diameter, "texture": {**noise, "seed": 9}}
        scene = make_scene({"name": "spheres", "objects": [*balls, wall]})
        self.save(f"{ACCEPTANCE}/{name}", self.exposed(self.rendered(scene)))


def _means(shade: Any, width: float, count: int, fine: int = 3) -> NDArray[np.float64]:
    """Picture of a function of places, `count` pixels wide, each the mean of fine x fine places."""
    at = ((np.arange(count * fine) + 0.5) / (count * fine) - 0.5) * width
    rows = [
        shade(at, at[k * fine : (k + 1) * fine, None]).reshape(fine, count, fine).mean((0, 2)) for k in range(count)
    ]
    return np.array(rows)


@cache
def board_picture(board: Board, turn: float) -> NDArray[np.float64]:
    """A checkerboard turned in its plane, white for a cell all round.

    Edges are as wide as a pixel: means of a few places would put corners off by a tenth of one.
    """
    count, across = 900, math.hypot(board.columns + 2, board.rows + 2) * board.cell
    x = ((np.arange(count) + 0.5) / count - 0.5) * across
    cos, sin = math.cos(turn), math.sin(turn)
    a = (cos * x + sin * x[:, None]) / board.cell + board.columns / 2
    b = (cos * x[:, None] - sin * x) / board.cell + board.rows / 2

    def side(place: NDArray[Any]) -> NDArray[np.float64]:
        """1 in even cells, -1 in odd ones, and between them on their edges."""
        line = np.rint(place)
        beside = np.clip(2 * (place - line) * board.cell * count / across, -1, 1)
        return np.asarray(np.where(line % 2 == 0, beside, -beside), float)

    on = (a > 0) & (a < board.columns) & (b > 0) & (b < board.rows)
    paper = (a > -1) & (a < board.columns + 1) & (b > -1) & (b < board.rows + 1)
    dark = on * (1 + side(a) * side(b)) / 2
    return np.asarray(np.where(paper, PAPER + (INK - PAPER) * dark, ROOM), float)


@cache
def edge_picture(setup: Setup) -> tuple[NDArray[np.float64], float]:
    """The slanted square on its page, and the page's width."""
    edge = setup.edge
    width, cos, sin = 2.2 * edge.printed_side, math.cos(edge.angle), math.sin(edge.angle)

    def shade(x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float64]:
        inside = np.maximum(np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)) < edge.printed_side / 2
        return np.where(inside, INK, PAPER)

    return _means(shade, width, 1400), width


@cache
def rings_picture(setup: Setup) -> tuple[NDArray[np.float64], float]:
    """The rings on their page, and its width."""
    radii = np.array(setup.field.printed_radii, float)
    lines = LINE * np.diff([0.0, *radii])
    width = 2.3 * float(radii[-1])

    def shade(x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float64]:
        radius = np.hypot(x, y)
        nearest = np.clip(np.searchsorted((radii[1:] + radii[:-1]) / 2, radius), 0, radii.size - 1)
        cross = (np.minimum(np.abs(x), np.abs(y)) < lines[0] / 2) & (np.maximum(np.abs(x), np.abs(y)) < radii[0] / 2)
        return np.where((np.abs(radius - radii[nearest]) < lines[nearest] / 2) | cross, INK, PAPER)

    return _means(shade, width, 2600, 2), width


@cache
def wall_picture(setup: Setup) -> tuple[NDArray[np.float64], float]:
    """The wall's texture, and its width."""
    wall = setup.wall
    dark = texture(wall.count, wall.octaves, np.random.default_rng(setup.seed))
    picture = np.kron(np.where(dark, INK, PAPER), np.ones((3, 3)))
    return np.asarray(picture, float), wall.scale * wall.count * wall.finest
