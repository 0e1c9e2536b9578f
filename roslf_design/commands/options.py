"""What is wrong with options that several commands have; each command raises its faults all at once."""

from __future__ import annotations

from pathlib import Path

from ..errors import Problem


def seed_faults(seed: int | None) -> list[Problem]:
    """A seed below 0."""
    low = seed is not None and seed < 0
    return [Problem("--seed", f"{seed} is negative; give a whole number from 0")] if low else []


def folder_faults(folder: Path) -> list[Problem]:
    """A place that cannot become a folder, as a file is in the way."""
    blocked = next((place for place in (folder, *folder.parents) if place.exists() and not place.is_dir()), None)
    return [] if blocked is None else [Problem("-o", f"{blocked} is a file, not a folder; name another place")]
