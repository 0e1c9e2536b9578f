"""A link that brings a state back: the design and what of it is looked at, packed into the address."""

from __future__ import annotations

import base64
import binascii
import json
import zlib
from dataclasses import asdict, dataclass
from typing import Any, cast

from ..design import Design, DesignError, dumps, loads
from .fields import CONJUGATE
from .places import Place, read_place
from .state import Follower, State, start

VERSION = "1"
LIMIT = 200_000
"""Largest unpacked link [bytes]: one from elsewhere must not fill the memory."""

TABS = {
    "camera": "Camera",
    "depth": "Depth",
    "tolerance": "Tolerance",
    "optimise": "Optimise",
    "space": "3D",
}
"""Views of the explorer with their labels, first the one it opens with."""


WHOLE: dict[str, bool | None] = {"auto": None, "object": True, "instrument": False}
"""What the meridional section shows: what suits, from the object plane on, or from the outermost stop on."""


@dataclass(frozen=True)
class Look:
    """What of a design is looked at; not part of what undo takes back."""

    tab: str = "camera"
    place: Place = "centre"
    """The microlens whose image is shown."""
    diffraction: bool = True
    pixels: bool = True
    whole: str = "auto"
    """How much the meridional section shows, a key of `WHOLE`."""


class LinkError(ValueError):
    """A link that cannot be read; says why."""


def encode(state: State, look: Look) -> str:
    """Text of letters, digits, - and _ that `decode` turns into an equal design, follower and look."""
    content = {"design": dumps(state.design), "follows": state.follows, "look": asdict(look)}
    if state.reference != state.design:
        content["reference"] = dumps(state.reference)
    packed = zlib.compress(json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode(), 9)
    return VERSION + base64.urlsafe_b64encode(packed).decode().rstrip("=")


def decode(text: str) -> tuple[State, Look]:
    """What `encode` packed.

    Raises
    ------
    LinkError
        Cut off, changed, of another version, or holding no design.
    """
    if not text.startswith(VERSION):
        raise LinkError("the link is not one of this version of the explorer; make it again there")
    try:
        content = json.loads(_unpacked(text[len(VERSION) :]))
        state = start(_design(content["design"]), _follower(content["follows"]))
        if "reference" in content:
            state = State(state.design, _design(content["reference"]), state.follows)
        return state, _look(content["look"])
    except DesignError as error:
        raise LinkError(f"the link's design cannot be used: {error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise LinkError("the link is cut off or changed; copy it again, whole") from None


def _unpacked(text: str) -> bytes:
    try:
        packed = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
        reader = zlib.decompressobj()
        content = reader.decompress(packed, LIMIT)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(str(error)) from None
    if reader.unconsumed_tail or not reader.eof:
        raise ValueError("cut off, or too large")
    return content


def _design(text: Any) -> Design:
    return loads(str(text), "link")


def _follower(text: Any) -> Follower:
    if text not in CONJUGATE:
        raise ValueError(f"{text!r} does not follow")
    return cast("Follower", text)


def _look(data: Any) -> Look:
    place, tab, whole = data["place"], data["tab"], data["whole"]
    if tab not in TABS or whole not in WHOLE:
        raise ValueError(f"no view {tab!r} or {whole!r}")
    return Look(tab, read_place(place), bool(data["diffraction"]), bool(data["pixels"]), whole)
