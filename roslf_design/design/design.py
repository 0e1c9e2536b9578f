"""A light-field camera that looks through a restricted object space, as one frozen value."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Any

from pydantic import ValidationError, model_validator
from pydantic_core import PydanticCustomError

from ..bore.chain import MEDIUM
from ..bore.conjugates import CONJUGATES, follower
from ..bore.part import TEMPERATURE, Part
from ..catalogue.entries import LENS_PRESCRIPTION, NAMED, left_to
from ..errors import InputError, Problem
from ..lenses.glass import AIR, ROOM
from ..tables import Table
from ..toml_files import nearest
from ..units import format_quantity
from .assembly import Assembly
from .check import DISTANCE, FOCAL, MISFIT, PLANE, DesignError, at, checked_places, cross_check, design_problems
from .check_bore import about_array, about_elements, about_names, about_shapes, about_sheet, about_stop_behind
from .environment import REFERENCE
from .growth import Growth, about_environment
from .parts import BEHIND, PATHS

SYMBOL = re.compile(r"[A-Za-z]_?[0-9A-Za-z]{0,2}")
"""Pattern of a symbol, known or not."""
LENS_PART = "main_lens.part"
FAP_SHAPE = ("aperture.shape", "aperture.sides")
"""Beginnings of places that say what shape and size the FAP has."""


class Design(Assembly):
    """A whole camera. Values in, values out: `replace` gives a new one.

    Any two of f, d_f and d_1 give the third. Where all three are given, f and d_1 are the hardware and d_f follows to
    the last bit, which keeps printed digits from contradicting each other.

    Raises
    ------
    DesignError
        From `replace`, `make` and the readers, with every fault at once.
    """

    @classmethod
    def _refused(cls, error: ValidationError, data: Mapping[str, Any]) -> DesignError:
        return DesignError(design_problems(error, data, Design, from_file=False))

    @model_validator(mode="after")
    def _parts_fit(self) -> Design:
        values = {place: at(self, place) for place in checked_places(opening.place for opening in self.openings)}
        chain = self.chain
        try:
            apparent = chain.apparent_values({**self.bore_numbers, **values})
        except InputError as error:  # a glass that is not known at the design's wavelength
            faults = tuple(Problem(PATHS["wavelength"], problem.message) for problem in error.problems)
            raise PydanticCustomError(MISFIT, "parts do not fit", {"problems": faults}) from None
        lens, turned = self.main_lens.kind, self.main_lens.reversed
        problems = cross_check(apparent, lens, turned=turned, bends=chain.bends, stated=values)
        if not chain.in_air or self.object_space.medium != AIR:
            problems += about_elements(self, problems)
        mapped = "" if problems else chain.mapped
        if mapped and chain.telecentric(self.bore_numbers, self.aperture.stands):
            message = (
                "the FAP stands in the focus of the objective, which then sees the scene from one angle only; move it, "
                f"or drop {mapped}"
            )
            problems += (Problem("aperture.distance", message),)
        problems += (*about_names(self), *about_array(self), *about_environment(self), *about_shapes(self))
        problems += () if problems else (*about_stop_behind(self), *about_sheet(self))
        if problems:
            raise PydanticCustomError(MISFIT, "parts do not fit", {"problems": problems})
        return self

    @classmethod
    def make(cls, data: Mapping[str, Any]) -> Design:
        """A design from nested values (the file's keys); bare numbers are mm and rad.

        Raises
        ------
        DesignError
            Every fault of `data`.
        """
        return build(data, from_file=False)

    def replace(self, changes: Mapping[str, Any] | None = None, /, **symbols: Any) -> Design:
        """A new design with some values changed.

        Parameters
        ----------
        changes : mapping, optional
            Dotted places, or the paper's symbols, to values, e.g. ``{"aperture.distance": 20.0, "D_F": 4.0}``; a part's
            name may stand for its number (``"elements.relay.distance"``). The diameter of a rectangular FAP is the
            wider of its extents along x and y: both sides grow alike.
        **symbols
            The same by the paper's symbols, e.g. ``d_3=20.0, D_F=4.0``.

        Returns
        -------
        Design
            Where f, d_f or d_1 changes, the one that follows is d_f if f or d_1 was changed (the hardware stays) and
            d_1 if d_f was (refocusing); of two that change, the third follows.

        Raises
        ------
        DesignError
            Unknown places, or values that do not make a design.
        """
        chain, places = self.chain, dict[str, Any]()
        for name, value in (changes or {}).items():
            if (place := chain.place_named(name)) in places:
                raise DesignError((Problem(place, f"is given as {chain.called(place)}, too; give it once"),))
            places[place] = value
        symbols = {name: places.pop(name) for name in [*places] if name in PATHS or SYMBOL.fullmatch(name)} | symbols
        wanted = _by_path(places, symbols)
        if "q" in symbols:
            wanted[PATHS["q"]] = symbols["q"] * self.sensor.relay_magnification
        for place in self.materials.keys() & wanted.keys():  # what is said of a glass is then its index alone
            part = place.removesuffix(".index")
            if TEMPERATURE in wanted:  # told at the temperature before
                glass, after = self.materials[place], wanted[TEMPERATURE]
                wanted[place] += float(glass.index(self.wavelength, after) - glass.index(self.wavelength))
            wanted.setdefault(f"{part}.{'medium' if place == MEDIUM else 'material'}", {"index": float(wanted[place])})
            del wanted[place]
        own, width = self.aperture.outline, wanted.get(PATHS["D_F"])
        if own.straight and isinstance(width, float | int) and not any(key.startswith(FAP_SHAPE) for key in wanted):
            sized = own.sized(float(wanted.pop(PATHS["D_F"])))
            wanted |= {f"aperture.{key}": float(size) for key, size in zip(sized.keys, sized.lengths, strict=True)}
        if self.aperture.behind is not None and PATHS["d_3"] in wanted and BEHIND not in wanted:
            wanted[BEHIND] = -wanted.pop(PATHS["d_3"])
        data = _mutable(self)
        for path in [path for path in wanted if path.endswith(".part") and wanted[path]]:
            if wanted[path] == at(self, path):
                del wanted[path]
                continue
            place = path.removesuffix(".part")
            kind, table = NAMED.get(re.sub(r"^elements\.\d+$", "elements", place)), at(data, place)
            if kind is not None and isinstance(table, dict) and table.get("kind", "plate") == "plate":
                _put(data, place, left_to(kind, table, wanted[path]))
        followed = _with_follower(self, wanted)
        if LENS_PART in wanted and FOCAL not in wanted:
            followed.pop(FOCAL, None)  # that of the lens before
        wanted = followed
        if wanted.get(FOCAL, ...) is None and self.main_lens.focal_length is not None:
            wanted.setdefault(LENS_PART, None)  # the lens that d_f and d_1 ask for is another
        for path, value in wanted.items():
            _put(data, path, value)
        return build(data, from_file=False)

    def unchecked(self, changes: Mapping[str, Any]) -> Design:
        """Design with numbers and names that may make none, for a file that says so when read; places that it has."""
        data = self
        for place, value in _with_follower(self, dict(changes)).items():
            data = _with(data, place.split("."), value)
        return data

    @property
    def with_own_stop(self) -> Design:
        """Design with the stop behind its ideal main lens of which a FAP behind that is the image; itself of others."""
        if self.aperture.behind is not None or self.d_3 >= 0 or not self.main_lens.kind.images_stops:
            return self
        shrunk = self.f / (self.f - self.d_3)
        return self._with_pupil(shrunk, {PATHS["d_3"]: None, BEHIND: -self.d_3 * shrunk})

    @property
    def with_seen_pupil(self) -> Design:
        """Design with the FAP that the scene sees in place of a stop behind the main lens; itself of others."""
        behind, f = self.aperture.behind, self.f
        if behind is None:
            return self
        if behind >= f:
            message = (
                f"{behind:g} mm is not within the focal length f = {f:g} mm: the scene sees no pupil nearer than the "
                "focal plane; move the stop closer to the lens"
            )
            raise DesignError((Problem(BEHIND, message),))
        grown = f / (f - behind)
        return self._with_pupil(grown, {BEHIND: None, PATHS["d_3"]: -behind * grown})

    def _with_pupil(self, grown: float, place: Mapping[str, Any]) -> Design:
        """Design with the aperture's image by the main lens, so much larger, at another place."""
        now, centre = self.aperture, self.main_lens.decentre
        made = now.outline.scaled(abs(grown))
        own = {f"aperture.{key}": float(size) for key, size in zip(made.keys, made.lengths, strict=True)}
        decentre = [c + (e - c) * grown for c, e in zip(centre, now.decentre, strict=True)]
        tilt = [math.atan(math.tan(angle) * grown) for angle in now.tilt]
        return self.replace({**own, "aperture.decentre": decentre, "aperture.tilt": tilt, **place})

    def at_temperature(self, temperature: float | str, *, ranging: bool = False) -> Design:
        """Design at another temperature [degrees C, or text], in a housing that does not grow where none is named.

        It is `ranging` no more, but at that temperature, unless its range is to stay.

        Raises
        ------
        DesignError
            A temperature that no camera meets, or that is beyond what is known of a material.
        """
        if self.environment is None:
            return self.replace({"environment": {"temperature": temperature}})
        changes: dict[str, Any] = {TEMPERATURE: temperature}
        if (ends := self.environment.range) is not None and not ranging:
            known = self.environment.calibrated_at
            changes |= {
                "environment.range": None,
                "environment.calibrated_at": sum(ends) / 2 if known is None else known,
            }
        return self.replace(changes)

    @property
    def at_room(self) -> Design:
        """Design as sizes of parts are stated, at 20 degrees C; itself where nothing is warm or a material unknown."""
        if self.environment is None or self.environment.temperature == ROOM:
            return self
        try:
            return self.at_temperature(ROOM, ranging=True)
        except InputError:
            return self

    @property
    def _table(self) -> Table:
        """Numbers by their symbols, with the places that `replace` takes."""
        known = [(symbol, float(f"{getattr(self, symbol):.7g}"), place) for symbol, place in PATHS.items()]
        rows = tuple((symbol, format_quantity(value, "length"), place) for symbol, value, place in known)
        return Table(rows, "ldl", ("symbol", "value", "place"), self.name, self.source)

    def __str__(self) -> str:
        return f"{self._table.text()}\n\n{self.source}; roslf.dumps(design) is all of it, as its file"

    def _repr_html_(self) -> str:
        return f"{self._table.html()}<p>{escape(self.source)}</p>"


def build(data: Mapping[str, Any], *, from_file: bool, origin: str = "", folder: str | Path | None = "") -> Design:
    """A design from nested values, or every fault of them in one `DesignError`.

    `folder` is that of the design file; None lets it open no lens file.
    """
    context = {"from_file": from_file, "folder": folder}
    try:
        return _settled(Design.model_validate(data, context=context))
    except ValidationError as error:
        raise DesignError(design_problems(error, data, Design, from_file=from_file, folder=folder), origin) from None


def _settled(design: Design) -> Design:
    """A design whose lengths, lenses and materials are those at its own temperature."""
    environment = design.environment
    if environment is None:
        return design
    before, after = environment.reference, environment.temperature
    drawn = _with_materials(design, before)
    if before == after:
        return drawn
    numbers = drawn.bore_numbers | {key: drawn[key] for key in CONJUGATES} | dict(_lengths(drawn))
    growth = Growth.of(drawn)
    assert growth is not None
    moved = growth.moved(numbers, before, after).items()
    changes: dict[str, Any] = {place: float(value) for place, value in moved if not place.endswith(".index")}
    changes |= {PLANE: None, REFERENCE: after}
    changes |= dict.fromkeys(drawn.main_lens.kind.follows)
    return _with_materials(_changed(drawn, changes), after)


def _with_materials(design: Design, temperature: float) -> Design:
    """Design with its lenses and materials at a temperature [degrees C]."""
    assert design.environment is not None
    barrel = design.environment.expansion
    glasses = (known for known in design.glasses if not known[0].endswith(".prescription"))
    changes: dict[str, Any] = {place: glass.at(temperature) for place, glass in glasses}
    changes |= {f"{part}.prescription": lens.warmed(temperature, barrel) for part, lens in design.prescriptions}
    changes = {place: value for place, value in changes.items() if value is not at(design, place)}
    return _changed(design, {**changes, TEMPERATURE: temperature}) if changes else design


def _changed(design: Design, changes: Mapping[str, Any]) -> Design:
    data = _mutable(design)
    for place, value in changes.items():
        _put(data, place, value)
    return Design.model_validate(data, context={"from_file": False, "folder": ""})


def _lengths(value: Any, place: str = "") -> Iterator[tuple[str, float]]:
    """Every number of a design's parts at its dotted place, the conjugates left out."""
    for key, inner in value if isinstance(value, Part) else enumerate(value):
        here = f"{place}.{key}" if place else str(key)
        if isinstance(inner, (Part, tuple)):
            yield from _lengths(inner, here)
        elif isinstance(inner, float) and here not in CONJUGATES:
            yield here, float(inner)


def _by_path(changes: Mapping[str, Any], symbols: Mapping[str, Any]) -> dict[str, Any]:
    unknown = sorted(set(symbols) - set(PATHS))
    if unknown:
        known = f"known are {', '.join(PATHS)}; other numbers go by their places, as 'tube.outer_diameter'"
        near = {n: known if SYMBOL.fullmatch(n) else nearest(n, PATHS, known, _own(n)) for n in unknown}
        raise DesignError(tuple(Problem(n, f"is not a symbol of a design; {near[n]}") for n in unknown))
    return {**changes, **{PATHS[symbol]: value for symbol, value in symbols.items()}}


def _own(key: str) -> dict[str, str]:
    """Symbols, with their places, of which a design file's key may be the name."""
    return {
        s: place for s, place in PATHS.items() if {*key.lower().split("_")} <= {*place.replace(".", "_").split("_")}
    }


def _with_follower(design: Design, wanted: dict[str, Any]) -> dict[str, Any]:
    """Changes that leave open that one of f, d_f and d_1 which follows from the two that are kept or changed.

    Another prescription is another lens than the one that was named.
    """
    if wanted.get(LENS_PRESCRIPTION, own := design.main_lens.prescription) != own:
        wanted = {LENS_PART: None, **wanted}
    changed = [key for key in wanted if key not in CONJUGATES or wanted[key] is not None]
    if FOCAL in design.main_lens.kind.follows and wanted.get(LENS_PRESCRIPTION, ...) is not None:
        # f is the lens's own: of d_f and d_1 the one that is not changed follows.
        open_ones = [key for key in (PLANE, DISTANCE) if key not in changed]
        return {**wanted, open_ones[0]: None} if len(open_ones) == 1 else wanted
    follows = follower(changed)
    return wanted if follows is None else {**{key: design[key] for key in CONJUGATES}, **wanted, follows: None}


def _put(data: dict[str, Any], path: str, value: Any) -> None:
    *parents, last = path.split(".")
    place: Any = data
    try:
        for key in parents:
            place = place[int(key) if isinstance(place, list) else key]
        place[int(last) if isinstance(place, list) else last] = value
    except (KeyError, IndexError, ValueError, TypeError):
        raise DesignError((Problem(path, "is not a place in this design"),)) from None


def _with(value: Any, keys: list[str], inner: Any) -> Any:
    """A part, or a tuple of them, with something else inside, unchecked; as it is where it has no such place."""
    if not keys:
        return inner
    key, *rest = keys
    if isinstance(value, tuple):
        return tuple(_with(one, rest, inner) if str(k) == key else one for k, one in enumerate(value))
    if isinstance(value, Part) and key in type(value).model_fields:
        return value.model_copy(update={key: _with(getattr(value, key), rest, inner)})
    return value


def _mutable(value: Any) -> Any:
    """Parts as tables and lists, what they hold (lenses, materials) as it is."""
    if isinstance(value, Part):
        return {key: _mutable(getattr(value, key)) for key in type(value).model_fields}
    return [_mutable(inner) for inner in value] if isinstance(value, (list, tuple)) else value
