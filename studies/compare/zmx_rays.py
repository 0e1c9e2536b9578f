"""Rays through a sequential .zmx file by Snell's law, with as many digits as wanted: the referee between programs.

It reads the text of the file by itself and shares nothing with the package; refractive indices are handed in, as a .zmx
file has only the names of glasses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from mpmath import mp, mpf

DIGITS = 40
KINDS = ("STANDARD", "EVENASPH", "PARAXIAL")


class Face(NamedTuple):
    """Surface of a file."""

    name: str
    kind: str
    curvature: float
    """[1/mm]."""
    conic: float
    parameters: dict[int, float]
    thickness: float
    """To the next one [mm]; infinite behind an object far away."""
    glass: str
    semi_diameter: float
    """[mm]."""
    stop: bool

    @property
    def focal_length(self) -> float | None:
        """Focal length of an ideal thin lens [mm]; None is a real surface."""
        return self.parameters[1] if self.kind == "PARAXIAL" else None

    @property
    def terms(self) -> tuple[float, ...]:
        """Coefficients of r^2, r^4, ..."""
        if self.kind != "EVENASPH":
            return ()
        return tuple(self.parameters.get(k, 0.0) for k in range(1, max(self.parameters, default=0) + 1))


def faces(text: str) -> list[Face]:
    """Surfaces of a file, the object first.

    Raises
    ------
    ValueError
        A kind of surface that is not known here.
    """
    found = []
    for part in text.split("\nSURF ")[1:]:
        lines = [words for line in part.splitlines()[1:] if (words := line.split(None, 1))]
        one = {words[0]: words[-1] for words in lines}
        if one["TYPE"].strip() not in KINDS:
            raise ValueError(f"{one['TYPE']} is not known")
        numbers = [words[1].split() for words in lines if words[0] == "PARM"]
        far = one["DISZ"].strip() == "INFINITY"
        found.append(Face(
            one.get("COMM", ""), one["TYPE"].strip(), float(one["CURV"].split()[0]), float(one.get("CONI", "0")),
            {int(k): float(value) for k, value in numbers}, float("inf") if far else float(one["DISZ"]),
            one.get("GLAS", ""), float(one["DIAM"].split()[0]), "STOP" in one,
        ))  # fmt: skip
    return found


def _sag(face: Face, square: Any) -> tuple[Any, Any]:
    """Height of a surface over its vertex plane and d/d(r^2) of it."""
    c = mpf(face.curvature)
    root = mp.sqrt(1 - (1 + mpf(face.conic)) * c * c * square)
    height, slope = c * square / (1 + root), c / (2 * root)
    for power, term in enumerate(face.terms, 1):
        height += mpf(term) * square**power
        slope += power * mpf(term) * square ** (power - 1)
    return height, slope


def trace(
    row: Sequence[Face], indices: Sequence[float], start: Sequence[float], way: Sequence[float], before: float
) -> list[tuple[Any, Any]]:
    """Points (x, y) where a ray meets every surface, its start on the first one included [mm].

    Parameters
    ----------
    row : sequence of Face
    indices : sequence of float
        Behind each surface.
    start, way : sequence of float
        Point (x, y) on the object's plane [mm], and direction (dx, dy, dz).
    before : float
        Distance of that plane from surface 1 where the file has it far away [mm].
    """
    with mp.workdps(DIGITS):
        x, y, z = mpf(start[0]), mpf(start[1]), mpf(0)
        dx, dy, dz = map(mpf, way)
        size = mp.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx / size, dy / size, dz / size
        points, index = [(x, y)], mpf(indices[0])
        gap = row[0].thickness
        z -= mpf(before) if gap == float("inf") else mpf(gap)
        for face, after in zip(row[1:], indices[1:], strict=True):
            along = -z / dz
            for _ in range(50):
                px, py = x + along * dx, y + along * dy
                height, slope = _sag(face, px * px + py * py)
                step = (z + along * dz - height) / (dz - 2 * slope * (px * dx + py * dy))
                along -= step
                if abs(step) < mpf(10) ** (5 - DIGITS):
                    break
            x, y, z = x + along * dx, y + along * dy, z + along * dz
            points.append((x, y))
            if face.focal_length is not None:
                sx, sy = dx / dz - x / mpf(face.focal_length), dy / dz - y / mpf(face.focal_length)
                dz = 1 / mp.sqrt(1 + sx * sx + sy * sy)
                dx, dy = sx * dz, sy * dz
            elif mpf(after) != index:
                slope = _sag(face, x * x + y * y)[1]
                nx, ny, nz = -2 * slope * x, -2 * slope * y, mpf(1)
                size = mp.sqrt(nx * nx + ny * ny + 1)
                nx, ny, nz = nx / size, ny / size, nz / size
                ratio = index / mpf(after)
                cosine = dx * nx + dy * ny + dz * nz
                bend = mp.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine
                dx, dy, dz = ratio * dx + bend * nx, ratio * dy + bend * ny, ratio * dz + bend * nz
            index = mpf(after)
            z -= mpf(face.thickness)
        return points
