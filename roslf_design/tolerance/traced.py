"""Builds behind a real main lens: every build's own lens is traced, and the metrics rest on its rays.

The decoder believes in the nominal design as traced: a microlens's image centre is where the nominal lens puts it, a
slope means the depth that the nominal lens gives it at that field. Calibrated on a build, it adds what an affine
lattice and targets on the axis tell it of the build.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..lenses.aim import Aimed, Aims, Outlines, aimed, cut_shapes, outlines, spot_radii
from ..lenses.kernels import BLOCK
from .decoder import fractional
from .mount import Mounted, mounted
from .reference import Reference, epi_slopes, reference
from .thin import ThinBuilds

Array = NDArray[np.float64]

SPOT_RADII, SPOT_TURNS = 4, 12
"""Rays that an object point's light is taken by: rings of equal weight by Gauss's rule, and rays on each."""


class TracedBuilds(ThinBuilds):
    """Builds behind a real lens; `ThinBuilds` of their thin twins, with every metric of a field traced instead."""

    def __init__(
        self,
        mount: Mounted,
        known: Reference,
        design: Design,
        fields: Sequence[tuple[float, float]],
        object_distance: float,
        calibrated: bool,
    ) -> None:
        super().__init__(mount.camera, design, fields, object_distance, calibrated)
        self.mount, self.known = mount, known
        self.trials = len(mount.camera.valid)
        self.half = np.broadcast_to(np.asarray(mount.camera.d) / 2, (self.trials,)).copy()

    @classmethod
    def of(
        cls,
        design: Design,
        values: Mapping[str, Array],
        trials: int,
        fields: Sequence[tuple[float, float]],
        object_distance: float,
        calibrated: bool,
    ) -> TracedBuilds:
        """Builds with numbers (trials,) at the places missed."""
        known = reference(design, tuple(fields), object_distance)
        return cls(mounted(design, values, trials), known, design, fields, object_distance, calibrated)

    def _aimed(self, wanted: Aims, rays: int) -> Aimed:
        """Rays of every field of every build, (trials * fields, rays) with the fields running fastest."""
        fields = len(wanted.base) // rays
        together = next(count for count in range(fields, 0, -1) if fields % count == 0 and count * rays <= BLOCK)
        groups = fields // together
        trial = np.repeat(np.arange(self.trials), groups)
        begin = np.tile(np.arange(groups) * together * rays, self.trials)
        found = aimed(self.mount.lens, self.mount.planes, self.half, wanted, trial, begin, together * rays)
        count = self.trials * fields
        return Aimed(*(part.reshape(count, rays, *part.shape[2:]) for part in found))

    def _grid(self, column: Array) -> Array:
        """From (trials * fields, ...) to (fields, trials, ...)."""
        return np.swapaxes(column.reshape(self.trials, -1, *column.shape[1:]), 0, 1)

    @property
    def rim(self) -> Aimed:
        """Rays of the FAP's rim."""
        return self._once("rim", lambda: self._aimed(self.known.rim, len(self.known.rim.base) // len(self.fields)))  # type: ignore[no-any-return]

    @property
    def outline(self) -> Outlines:
        """Images as if nothing cut them."""
        return self._once("outline", lambda: outlines(self.rim))  # type: ignore[no-any-return]

    @property
    def chief(self) -> Array:
        """Images of the FAP's centre [mm], (fields, trials, 2)."""
        return self._once("chief", lambda: self._grid(self._aimed(self.known.chief, 1).landed[:, 0]))  # type: ignore[no-any-return]

    def _image_diameter_mm(self) -> Any:
        return self._grid(2 * np.sqrt(self.outline.shape[:, 0] / np.pi))

    def _image_pitch_mm(self) -> Any:
        found = self._grid(self._aimed(self.known.neighbours, 4).landed)
        across, along = found[..., 1, :] - found[..., 0, :], found[..., 3, :] - found[..., 2, :]
        return np.sqrt(np.abs(across[..., 0] * along[..., 1] - across[..., 1] * along[..., 0]))

    def _non_distortion_room_mm(self) -> Any:
        lens, rims = self.mount.lens, self.mount.planes.rims
        count = lens.media.shape[1] - 1
        semi = np.sqrt(lens.table.reshape(self.trials, count, -1)[:, :, 5])
        radii = np.concatenate([semi, rims[:, 1:, 12]], axis=1)
        peaks = self._grid(self.outline.peaks)
        return np.min(radii * (1 - np.sqrt(peaks)), axis=-1) + 0 * self._image_diameter_mm()

    def _centre_shift_px(self) -> Any:
        """Against the straight line from the middle of the image-side principal plane, which Eq. 4 takes."""
        plane, lens = self.mount.planes.array, self.mount.lens
        lens_at = np.stack(
            [plane[:, k] + self.x * plane[:, 3 + k] + self.y * plane[:, 6 + k] for k in range(3)], axis=-1
        )
        middle = np.zeros((self.trials, 3))
        middle[:, 2] = lens.rear_principal
        run = lens_at - middle
        there = _crossing(lens_at, run / run[..., 2:], self.mount.planes.sensor)
        cos, sin = self.known.azimuth
        x, y = np.moveaxis(there - self.chief, -1, 0)
        return (x * cos + y * sin) / self.camera.q

    def _shapes(self) -> tuple[Array, Array, Array]:
        rim, found = self.rim, self.outline
        shape, share = found.shape.copy(), np.ones(len(found.shape))
        cut = np.flatnonzero(np.any(~(found.peaks <= 1), axis=1))
        if len(cut):
            fields = len(self.fields)
            rays = len(self.known.inner.base) // fields
            trial, field = cut // fields, cut % fields
            inner = aimed(self.mount.lens, self.mount.planes, self.half, self.known.inner, trial, field * rays, rays)
            shape[cut], share[cut] = cut_shapes(
                Aimed(*(part[cut] for part in rim)), inner, Outlines(*(part[cut] for part in found))
            )
        folded = np.tile(self.known.folded, self.trials)
        shape[folded], share[folded] = np.nan, np.nan
        xx, xy, yy = shape[:, 3], shape[:, 4], shape[:, 5]
        major = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
        ratio = np.where(share > 0, np.sqrt(np.maximum(xx * yy - xy * xy, 0.0)) / major, np.nan)
        return self._grid(shape[:, 0]), self._grid(share), self._grid(ratio)

    def _believed(self, x: Any, y: Any) -> Array:
        """Image centres that the decoder believes in [px] for places of the array [mm], (fields, trials, ...)."""
        scale = self.design.d / np.asarray(self.camera.d)
        found = self.known.centres.at(x * scale, y * scale) / self.design.q
        if not self.calibrated:
            return found
        rows = self._once("lattice", self._lattice)
        return np.asarray(found + rows[0] + (x * scale)[..., None] * rows[1] + (y * scale)[..., None] * rows[2])

    def _lattice(self) -> Array:
        """What an affine calibration adds to the nominal centres, (3, trials, 2): at the middle, per mm in x, in y."""
        seen = self._grid(self._aimed(self.known.ends, 1).landed[:, 0]) / np.asarray(self.camera.q)[..., None]
        scale = self.design.d / np.asarray(self.camera.d)
        reach = self.known.reach
        x, y = reach * np.array([[1.0], [-1.0], [0.0], [0.0]]), reach * np.array([[0.0], [0.0], [1.0], [-1.0]])
        off = seen - self.known.end_centres.at(x * scale, y * scale) / self.design.q
        width = 2 * reach * np.broadcast_to(scale, (self.trials,))[:, None]
        return np.stack([(off[0] + off[1]) / 2, (off[0] - off[1]) / width, (off[2] - off[3]) / width])

    def _centre_error(self) -> tuple[Any, Any]:
        x, y = (np.broadcast_to(part, (len(self.fields), self.trials)) for part in (self.x, self.y))
        off = self.chief / np.asarray(self.camera.q)[..., None] - self._believed(x, y)
        return off[..., 0], off[..., 1]

    def _depth_error_mm(self) -> Any:
        known = self.known
        slope = self._slopes(known.points, known.azimuth, self._believed)
        if self.calibrated:
            axis = (np.ones((1, 1)), np.zeros((1, 1)))
            seen = [self._slopes(point[None], axis, self._near_axis) for point in known.axis_points]
            depth = fractional(slope, seen, known.depths)
            slope = np.asarray(fractional(depth, known.depths, tuple(float(value) for value in known.axis_slopes)))
        depths = known.depths
        return fractional(slope, tuple(known.slopes.T[:, :, None]), depths) - self.object_distance

    def _near_axis(self, x: Any, y: Any) -> Array:
        scale = self.design.d / np.asarray(self.camera.d)
        rows = self._once("lattice", self._lattice)
        found = self.known.axis_centres.at(x * scale, y * scale) / self.design.q
        return np.asarray(found + rows[0] + (x * scale)[..., None] * rows[1] + (y * scale)[..., None] * rows[2])

    def _slopes(self, points: Array, azimuth: tuple[Array, Array], centre: Any) -> Array:
        """Slopes between the rays through the FAP's ends [microlenses per pixel], (points, trials)."""
        return epi_slopes(self.mount, points, azimuth, centre)

    def _blur_pitches(self) -> Any:
        mount = self.mount
        nodes, weights = np.polynomial.legendre.leggauss(SPOT_RADII)
        radius, turn = np.sqrt(0.5 + 0.5 * nodes), 2 * np.pi * np.arange(SPOT_TURNS) / SPOT_TURNS
        pupil = np.stack([np.outer(radius, np.cos(turn)).ravel(), np.outer(radius, np.sin(turn)).ravel()], axis=-1)
        weight = np.repeat(weights / 2, SPOT_TURNS) / SPOT_TURNS
        planes, points = mount.planes, self.known.points
        return spot_radii(mount.lens, planes.array, planes.rims, mount.world, points, pupil, weight).T / self.camera.d


def _crossing(point: Array, slope: Array, plane: Array) -> Array:
    """Where lines (fields, trials, 3) cross planes (trials, 12), in their own coordinates, (fields, trials, 2)."""
    off = point - plane[:, :3]
    lean, ahead = np.sum(slope * plane[:, 9:], axis=-1), np.sum(off * plane[:, 9:], axis=-1)
    hit = off - slope * (ahead / lean)[..., None]
    return np.stack([np.sum(hit * plane[:, 3:6], axis=-1), np.sum(hit * plane[:, 6:9], axis=-1)], axis=-1)
