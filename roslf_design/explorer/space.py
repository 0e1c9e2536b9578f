"""The 3D view: what of the scene the browser does not have yet."""

from __future__ import annotations

from typing import Any

from ..design import Design
from .pictures.theme import ThemeName
from .scene3d import Scene3D, changed, scene


class Space:
    """Remembers what was sent, and sends what has changed since; each parcel says which one it builds on."""

    def __init__(self) -> None:
        self._seen: tuple[Design, ThemeName] | None = None
        self._scene: Scene3D | None = None
        self._serial = 0
        self.sent: dict[str, Any] = {}
        """The last parcel."""

    def parcel(self, design: Design, theme: ThemeName) -> dict[str, Any]:
        """The meshes that have changed, None for those that are gone; the last parcel where nothing has.

        Parameters
        ----------
        design : Design
        theme : {"light", "dark"}
        """
        if self._seen == (design, theme):
            return self.sent
        now = scene(design, theme)
        before, since = ({}, 0) if self._scene is None else (self._scene.meshes, self._serial)
        meshes = {name: mesh and mesh._asdict() for name, mesh in changed(before, now.meshes).items()}
        self._serial += 1
        self._seen, self._scene = (design, theme), now
        self.sent = {
            "serial": self._serial,
            "since": since,
            "meshes": meshes,
            "camera": now.camera,
            "ground": now.ground,
        }
        return self.sent

    def forget(self) -> None:
        """Send everything next time."""
        self._seen = self._scene = None
