"""What a TOML file is, from the keys in it: a design, a study of one of two kinds, or a story."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from ..errors import InputError, Problem
from .errors import DesignError

Kind = Literal["design", "story", "optimize", "tolerance"]
MARKS: Mapping[Kind, tuple[str, ...]] = {
    "story": ("story",),
    "design": ("main_lens", "microlens_array", "sensor"),
    "optimize": ("variables",),
    "tolerance": ("grade", "perturb"),
}
"""Keys that tell what a file is."""
CALLED: Mapping[Kind, tuple[str, str]] = {
    "story": ("a story", "roslf report"),
    "design": ("a design", "roslf evaluate"),
    "optimize": ("an optimisation study", "roslf optimize"),
    "tolerance": ("a tolerance study", "roslf tolerance"),
}
"""What a kind is called, and the command that takes it."""


def kind_of(data: Mapping[str, Any], origin: str) -> Kind:
    """What a file is.

    Raises
    ------
    InputError
        None of the keys looked for is there.
    """
    for kind, keys in MARKS.items():
        if any(key in data for key in keys):
            return kind
    words = {
        "design": "[main_lens], [microlens_array] or [sensor] (a design)",
        "optimize": "[variables] (an optimisation study)",
        "tolerance": "grade or [[perturb]] (a tolerance study)",
        "story": "[story] (a story)",
    }
    looked = ", ".join(words[kind] for kind in ("design", "optimize", "tolerance", "story"))
    held = f"; it has {', '.join(map(str, list(data)[:6]))}" if data else "; it is empty"
    raise InputError((Problem("", f"is neither a design nor a study: none of {looked} is in it{held}"),), origin)


def expect_kind(data: Mapping[str, Any], wanted: Kind, origin: str) -> None:
    """Refuse a file that is plainly of another kind, instead of listing all the keys that it has not.

    Raises
    ------
    InputError
        (DesignError where a design is wanted.) Says what the file is and which command takes it.
    """
    found = next((kind for kind, keys in MARKS.items() if any(key in data for key in keys)), wanted)
    if found != wanted and not any(key in data for key in MARKS[wanted]):
        called, command = CALLED[found]
        refusal = DesignError if wanted == "design" else InputError
        raise refusal((Problem("", f"is {called}, not {CALLED[wanted][0]}; {command} takes it"),), origin)
