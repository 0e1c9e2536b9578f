"""Keys of JSON objects that the pages about them describe."""

import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parents[2] / "docs/reference/other-json.md"


def sections() -> dict[str, set[str]]:
    """Words in backticks of each schema's section."""
    parts = PAGE.read_text().split("\n## ")[1:]
    return {
        schema: set(re.findall(r"`(\w+)`", body)) for body in parts for schema in re.findall(r"roslf\.[a-z-]+/1", body)
    }


def undescribed(data: dict[str, Any], names: Collection[str] = ()) -> set[str]:
    """Keys of an object, and of what it holds, that its section does not describe.

    Parameters
    ----------
    data
        Object with its schema.
    names
        Keys of objects whose own keys are names of things, such as images: those need no description.
    """
    described = sections()[data["schema"]] | {"schema"}

    def missing(value: Any, named: bool = False) -> set[str]:
        if isinstance(value, list):
            return set().union(*map(missing, value))
        if not isinstance(value, dict):
            return set()
        own = set() if named else value.keys() - described
        return own.union(*(missing(inner, key in names) for key, inner in value.items()))

    return missing(data)
