"""Every metric of builds behind an ideal lens that belongs to a field, over fields and trials."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..microlens.discs import intersect
from ..microlens.ellipses import intersect_ellipses
from .camera import Camera
from .decoder import (
    Belief,
    Scene,
    believed_depth,
    calibrated_belief,
    chief_pixel,
    epi_slope_seen,
    landing,
    nominal_belief,
    scene_for,
)
from .pencils import Ellipse, chief_point, rim_image, room

Array = NDArray[np.float64]

DISC_RULE = ((0.0, 0.0, 0.25), *((np.sqrt(2 / 3), k * np.pi / 3, 0.125) for k in range(6)))
"""Radius, angle and weight of points that average polynomials up to the fifth degree over the unit disc exactly."""


class ThinBuilds:
    """Builds behind an ideal lens; what several metrics share is computed when first asked for.

    Parameters
    ----------
    camera : Camera
        The builds.
    design : Design
        The nominal design.
    fields : sequence of (x, y)
        Microlens positions on the array [mm].
    object_distance : float
        Z of the decoder's target [mm].
    calibrated : bool
        Whether the decoder was calibrated on each build.
    """

    def __init__(
        self,
        camera: Camera,
        design: Design,
        fields: Sequence[tuple[float, float]],
        object_distance: float,
        calibrated: bool,
    ) -> None:
        self.camera, self.design, self.calibrated = camera, design, calibrated
        self.fields, self.object_distance = np.array(fields, dtype=np.float64).reshape(-1, 2), object_distance
        self.x, self.y = self.fields[:, :1], self.fields[:, 1:]
        self.microlens = camera.microlens(self.x, self.y)
        self._kept: dict[str, Any] = {}

    def _once(self, key: str, make: Callable[[], Any]) -> Any:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def value(self, name: str) -> Any:
        """A metric, broadcasting to (fields, trials)."""
        return self._once(name, lambda: getattr(self, f"_{name}")())

    @property
    def image(self) -> Ellipse:
        """The FAP's image, as if nothing cut it."""
        rim = self.camera.rims[0]
        return self._once("image", lambda: rim_image(self.camera, rim, self.microlens).ellipse(rim.radius))  # type: ignore[no-any-return]

    @property
    def shapes(self) -> tuple[Array, Array, Array]:
        """Lit area [mm^2], kept fraction and axis ratio."""
        return self._once("shapes", self._shapes)  # type: ignore[no-any-return]

    @property
    def belief(self) -> Belief:
        """What the decoder assumes."""
        return self._once("belief", self._believe)  # type: ignore[no-any-return]

    @property
    def scene(self) -> Scene:
        """What it looks at."""
        return self._once("scene", lambda: scene_for(self.design, self.fields, self.object_distance))  # type: ignore[no-any-return]

    def _believe(self) -> Belief:
        design = self.design
        if not self.calibrated:
            return nominal_belief(design)
        reach = float(np.max(np.hypot(self.x, self.y))) or design.microlens_array.size[0] / 2
        return calibrated_belief(self.camera, design, reach, self.scene)

    def _image_diameter_mm(self) -> Any:
        return 2 * np.sqrt(np.sqrt(self.image.determinant))

    def _image_diameter_px(self) -> Any:
        return self.value("image_diameter_mm") / self.camera.q

    def _image_pitch_mm(self) -> Any:
        # Between the points half a pitch to either side: what mirrored builds share.
        camera, half = self.camera, self.camera.d / 2
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = (
            chief_point(camera, camera.microlens(self.x + a * half, self.y + b * half))
            for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1))
        )
        return np.sqrt(np.abs((x1 - x0) * (y3 - y2) - (y1 - y0) * (x3 - x2)))

    def _fill_factor(self) -> Any:
        return self.value("image_diameter_mm") / self.value("image_pitch_mm")

    def _mismatch_px(self) -> Any:
        return (self.value("image_diameter_mm") - self.value("image_pitch_mm")) / self.camera.q

    def _non_distortion_room_mm(self) -> Any:
        return room(self.camera, self.microlens)

    def _centre_shift_px(self) -> Any:
        camera = self.camera
        x0, y0 = chief_point(camera, self.microlens)
        x1, y1 = rim_image(camera, camera.rims[1], self.microlens).centre
        cos, sin = self.scene.azimuth
        return ((x1 - x0) * cos + (y1 - y0) * sin) / camera.q

    def _shapes(self) -> tuple[Array, Array, Array]:
        camera = self.camera
        images = [rim_image(camera, rim, self.microlens).ellipse(rim.radius) for rim in camera.rims]
        shape = (len(self.fields), len(camera.valid))
        centres = np.stack([_spread([image.x, image.y], shape) for image in images], axis=-2)
        centres -= centres[..., :1, :]
        if camera.tilted:
            matrices = np.stack([_spread([image.xx, image.xy, image.yy], shape) for image in images], axis=-2)
            found = intersect_ellipses(centres, matrices)
        else:
            radii = np.stack([np.broadcast_to(np.sqrt(image.xx), shape) for image in images], axis=-1)
            found = intersect(centres, radii)
        return found.area, found.kept_fraction, np.where(found.lit, found.axis_ratio, np.nan)

    def _image_area_mm2(self) -> Any:
        return self.shapes[0]

    def _kept_fraction(self) -> Any:
        return self.shapes[1]

    def _axis_ratio(self) -> Any:
        return self.shapes[2]

    def _centre_error(self) -> tuple[Any, Any]:
        camera = self.camera
        x, y = chief_pixel(camera, self.x, self.y)
        believed = self.belief.lattice.centre(self.x / camera.d, self.y / camera.d)
        return x - believed[0], y - believed[1]

    def _centre_error_x_px(self) -> Any:
        return self._once("centre_error", self._centre_error)[0]

    def _centre_error_y_px(self) -> Any:
        return self._once("centre_error", self._centre_error)[1]

    def _centre_error_px(self) -> Any:
        return np.hypot(*self._once("centre_error", self._centre_error))

    def _blur_pitches(self) -> Any:
        found = [landing(self.camera, self.scene, rho * np.cos(a), rho * np.sin(a)) for rho, a, _ in DISC_RULE]
        u, v = (np.stack([point[axis] + 0 * self.camera.valid for point in found]) for axis in (2, 3))
        weight = np.array([share for *_, share in DISC_RULE])[:, None, None]
        off = [part - np.sum(weight * part, axis=0) for part in (u, v)]
        return np.sqrt(np.sum(weight * (off[0] ** 2 + off[1] ** 2), axis=0))

    def _depth_error_mm(self) -> Any:
        slope = epi_slope_seen(self.camera, self.scene, self.belief.lattice)
        return believed_depth(self.belief, self.design, slope) - self.scene.distance


def _spread(values: Sequence[Any], shape: tuple[int, int]) -> Array:
    return np.stack([np.broadcast_to(value, shape) for value in values], axis=-1)
