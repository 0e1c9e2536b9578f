"""A design as other programs take it: surfaces in a row, from the focal plane to the sensor, and files of them.

Straight: misalignments are left out. The scene's medium, elements, stops, main lens, substrate and cover are there, and
one microlens, on the axis, as a paraxial surface with the array's pitch as its aperture.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bore.export import SequenceRow, lens_surfaces
from ..bore.opening import ClearAperture
from ..errors import InputError, Problem
from ..lenses.glass import AIR, Glass
from ..lenses.manufacture import abbe_number
from ..lenses.prescription import Prescription, Surface, first_order

if TYPE_CHECKING:
    from .design import Design

SCHOTT = "SCHOTT glass catalogue"
"""Source of glasses that other programs know by these names, as it begins."""
D_LINE = 587.5618e-6


def sequence_of(design: Design) -> tuple[SequenceRow, ...]:
    """Every surface of a design, the focal plane first, the sensor last.

    Raises
    ------
    InputError
        A gradient-index rod, or an objective with a mapping: no surface stands for those.
    """
    front, rear = design.main_lens.kind.planes(design.wavelength)
    body = design.main_lens.kind.rows(design.f, design.D)
    design = design.with_own_stop
    medium = design.object_space.medium
    widest = max(design.D, *(float(stop.part.outline.width) for stop in design.openings))
    rows = [SequenceRow("focal plane", front - design.d_f, Surface(0.0, widest, glass=medium)), *body]
    for stop in design.openings:
        opening, is_fap = stop.part.outline, stop.part is design.aperture
        plane = Surface(0.0, float(opening.reach))
        rows.append(SequenceRow(stop.name, front - stop.near, plane, is_stop=is_fap, opening=opening))
    farthest = max(design.elements, key=lambda element: element.distance, default=None)
    for place, name, element, near, _ in design.in_bore:
        semi = (element.diameter or widest) / 2
        try:
            rows += element.rows(name, front - near, semi)
        except ValueError as what:
            message = f"{what} has no surfaces that other programs take; drop it, or give it by a prescription"
            raise InputError((Problem(place, message),)) from None
        if element is farthest and medium != AIR and not element.seals:
            rows.append(SequenceRow("end of the medium", rows[-1].z, Surface(0.0, semi)))
    end = front - (farthest.distance if farthest else 0.0)
    lens = body[0].z if design.d_3 < 0 and not design.main_lens.kind.images_stops else math.inf
    return _ordered([*rows, *_behind(design, rear)], medium, end, lens)


def _behind(design: Design, rear: float) -> Iterator[SequenceRow]:
    """The microlens, the sensor and the glass about them."""
    at, end, half = rear + design.d_1, rear + design.d_1 + design.d_2, max(design.sensor_size)
    yield SequenceRow("microlens", at, Surface(0.0, design.d / 2), float(design.f_ml))
    for plate in design.plates:
        yield from plate.part.rows(plate.name, rear - plate.near, half)
    yield SequenceRow("sensor", end, Surface(0.0, half))


def _ordered(rows: list[SequenceRow], medium: Glass, end: float, lens: float) -> tuple[SequenceRow, ...]:
    """Rows in the order of light, with the gaps between them; a stop in a liquid is filled with it.

    A FAP that is seen behind a real lens, whose first face stands at `lens` [mm], is met before that face, in the air
    that the lens looks into: light goes on to it and back.
    """
    rows = sorted(rows, key=lambda row: (lens, 0) if row.is_stop and row.z > lens else (row.z, 1))
    gaps = [after.z - before.z for before, after in pairwise(rows)]
    done = []
    for row, gap in zip(rows, [*gaps, 0.0], strict=True):
        wet = medium if row.opening is not None and row.z < end - 1e-12 else row.surface.glass
        done.append(replace(row, surface=replace(row.surface, thickness=gap, glass=wet)))
    return tuple(done)


def lens_rows(lens: Prescription) -> tuple[SequenceRow, ...]:
    """A lens alone, between an object far away and its focal plane."""
    wavelength = lens.wavelength or D_LINE
    image = first_order(lens, wavelength)
    rows = lens_surfaces("", lens, 0.0)
    last = replace(rows[-1].surface, thickness=image.back_focal_length)
    widest = 2 * max(surface.semi_diameter for surface in lens.surfaces)
    ends = Surface(0.0, widest, float("inf")), Surface(0.0, widest)
    rows = [replace(row, name=row.name.removeprefix(", ")) for row in (*rows[:-1], replace(rows[-1], surface=last))]
    rows[0] = replace(rows[0], is_stop=True)
    begin = SequenceRow("object", -float("inf"), ends[0])
    end = SequenceRow("image", lens.length + image.back_focal_length, ends[1])
    return (begin, *rows, end)


def zmx(rows: tuple[SequenceRow, ...], name: str, wavelength: float, temperature: float, wide: float) -> str:
    """A sequential .zmx file, in millimetres; `wide` is the half-width of the field, or 0 for the axis alone [mm]."""
    lines = ["VERS 140124 258 36214", "MODE SEQ", f"NAME {' '.join(name.split())}", "NOTE 0 roslf_design"]
    stop = next((row for row in rows if row.is_stop), rows[0])
    seen = replace(rows[0].surface, semi_diameter=max(rows[0].surface.semi_diameter, wide))  # fields lie on it
    rows = (replace(rows[0], surface=seen), *rows[1:])
    far = seen.thickness == float("inf")
    lines += ["UNIT MM X W X CM MR CPMM", f"ENPD {2 * stop.surface.semi_diameter!r}" if far else "FLOA"]
    lines += [f"ENVD {temperature!r} 1 0", "GFAC 0 0", "GCAT SCHOTT MISC"]
    heights = (0.0, wide) if wide else (0.0,)
    lines += [f"FTYP {0 if far else 1} 0 {len(heights)} 1 0 0 0"]
    lines += [f"{key} {' '.join(repr(part) for part in parts)}" for key, parts in
              (("XFLN", (0.0,) * len(heights)), ("YFLN", heights))]  # fmt: skip
    lines += [f"WAVM 1 {1e3 * wavelength!r} 1", "PWAV 1"]
    for number, surface in enumerate(_zmx_surfaces(rows)):
        lines += [f"SURF {number}", *(f"  {line}" for line in surface)]
    return "\n".join(lines) + "\n"


def _zmx_surfaces(rows: tuple[SequenceRow, ...]) -> Iterator[list[str]]:
    """Every surface; mirrors and turned openings between breaks of the coordinates.

    Behind an odd number of mirrors all is reversed in z.
    """
    way = 1.0
    for row in rows:
        part = row.surface
        terms = tuple(way * term for term in part.asphere)
        if row.mirror is None:
            turn, gap = math.degrees(row.clip.turn), way * part.thickness
            turned = replace(part, curvature=way * part.curvature + 0.0, thickness=0.0 if turn else gap, asphere=terms)
            if turn:
                yield _zmx_break(f"{row.name}, turn", 5, turn)
            yield list(_zmx_surface(replace(row, surface=turned)))
            if turn:
                yield _zmx_break(f"{row.name}, turn back", 5, -turn, gap)
            continue
        angle, azimuth = (math.degrees(part) for part in row.mirror)
        yield _zmx_break(f"{row.name}, azimuth", 5, azimuth - 90)
        yield _zmx_break(f"{row.name}, tilt", 3, way * (angle - 90))
        flat = list(_zmx_surface(replace(row, surface=replace(part, thickness=0.0))))
        yield [*flat[:-2], "GLAS MIRROR 0 0 1.5 40", *flat[-2:]]
        yield _zmx_break(f"{row.name}, tilt back", 3, way * (angle - 90))
        way = -way
        yield _zmx_break(f"{row.name}, azimuth back", 5, 90 - azimuth, way * part.thickness)


def _zmx_break(name: str, parameter: int, degrees: float, thickness: float = 0.0) -> list[str]:
    return [
        "TYPE COORDBRK", 'CURV 0.0 0 0 0 0 ""', f"COMM {name}", f"PARM {parameter} {degrees!r}", f"DISZ {thickness!r}"
    ]  # fmt: skip


def _zmx_surface(row: SequenceRow) -> Iterator[str]:
    surface, ideal = row.surface, row.focal_length is not None
    kind = "PARAXIAL" if ideal else "EVENASPH" if any(surface.asphere) else "STANDARD"
    if row.is_stop:
        yield "STOP"
    yield f"TYPE {kind}"
    yield f'CURV {surface.curvature!r} 0 0 0 0 ""'
    if row.name:
        yield f"COMM {row.name}"
    if surface.conic:
        yield f"CONI {surface.conic!r}"
    if ideal:
        yield f"PARM 1 {row.focal_length!r}"
        yield "PARM 2 0"
    for term, value in enumerate(surface.asphere, 1):
        yield f"PARM {term} {value!r}"
    yield "DISZ INFINITY" if surface.thickness == float("inf") else f"DISZ {surface.thickness!r}"
    if surface.glass != AIR:
        yield _zmx_glass(surface.glass)
    yield f'DIAM {surface.semi_diameter!r} 1 0 0 1 ""'
    clip = row.clip
    yield f"CLAP 0 {clip.radius!r} 0" if clip.half is None else f"SQAP {clip.half[0]!r} {clip.half[1]!r} 0"


def _zmx_glass(glass: Glass) -> str:
    if glass.source.startswith(SCHOTT) and not glass.offset:
        return f"GLAS {glass.name} 0 0 {float(glass.index(D_LINE))!r} {abbe_number(glass) or 0.0!r} 0"
    return f"GLAS ___BLANK 1 0 {float(glass.index(D_LINE))!r} {abbe_number(glass) or 0.0!r} 0"


def optiland(rows: tuple[SequenceRow, ...], name: str, wavelength: float, wide: float) -> str:
    """A file of Optiland's, its own JSON; glasses as their index at the wavelength, which is the only one.

    `wide` is the half-width of the field [mm], or 0 for the axis alone.
    """
    if mirror := next((row for row in rows if row.mirror is not None), None):
        message = f"{mirror.name} folds the axis, and Optiland's file is written straight only; write a .zmx file"
        raise InputError((Problem("-o", message),), name)
    far = rows[0].surface.thickness == float("inf")
    stop = next((row for row in rows if row.is_stop), rows[0])
    fields = [{"x": 0.0, "y": y, "vx": 0.0, "vy": 0.0, "weight": 1.0} for y in ((0.0, wide) if wide else (0.0,))]
    begin = rows[1].z
    data = {
        "version": 1.0,
        "name": name,
        "aperture": {"type": "EPD" if far else "float_by_stop_size", "value": 2 * stop.surface.semi_diameter},
        "fields": {
            "fields": fields,
            "telecentric": False,
            "field_definition": {"field_type": "AngleField" if far else "ObjectHeightField"},
        },
        "wavelengths": {
            "wavelengths": [{"value": 1e3 * wavelength, "is_primary": True, "unit": "um", "weight": 1.0}],
            "polarization": "ignore",
        },
        "apodization": None,
        "pickups": [],
        "solves": {"solves": []},
        "surface_group": {"surfaces": [_optiland_surface(k, row, begin, wavelength) for k, row in enumerate(rows)]},
    }
    return json.dumps(data, indent=1) + "\n"


def _optiland_surface(number: int, row: SequenceRow, begin: float, wavelength: float) -> dict[str, Any]:
    surface = row.surface
    radius = 1 / surface.curvature if surface.curvature else float("inf")
    place = {"x": 0.0, "y": 0.0, "z": row.z - begin, "rx": 0.0, "ry": 0.0, "rz": 0.0, "reference_cs": None}
    geometry: dict[str, Any] = {"type": "Plane", "cs": place, "radius": radius}
    if surface.curvature and row.focal_length is None:
        geometry |= {"type": "StandardGeometry", "conic": surface.conic}
    if any(surface.asphere):
        terms = {"tol": 1e-12, "max_iter": 100, "coefficients": list(surface.asphere)}
        geometry |= {"type": "EvenAsphere", "conic": surface.conic, **terms}
    medium = {
        "type": "IdealMaterial",
        "propagation_model": {"class": "HomogeneousPropagation"},
        "index": float(surface.glass.index(wavelength)),
        "absorp": 0.0,
    }
    if number == 0:
        return {"type": "ObjectSurface", "geometry": geometry, "material_post": medium, "comment": row.name}
    model = {"type": "RefractiveReflectiveModel", "is_reflective": False, "coating": None, "bsdf": None}
    if row.focal_length is not None:
        model |= {"type": "ThinLensInteractionModel", "focal_length": row.focal_length}
    return {
        "type": "Surface",
        "thickness": surface.thickness,
        "geometry": geometry,
        "material_post": medium,
        "is_stop": row.is_stop,
        "aperture": _optiland_aperture(row.clip),
        "comment": row.name,
        "interaction_model": model,
    }


def _optiland_aperture(clip: ClearAperture) -> dict[str, Any]:
    if clip.half is None:
        return {"type": "RadialAperture", "r_max": clip.radius, "r_min": 0.0, "offset_x": 0.0, "offset_y": 0.0}
    if clip.turn:
        x, y = np.array(clip.corners, float).T.tolist()
        return {"type": "PolygonAperture", "x": x, "y": y}
    a, b = clip.half
    return {"type": "RectangularAperture", "x_min": -a, "x_max": a, "y_min": -b, "y_max": b}
