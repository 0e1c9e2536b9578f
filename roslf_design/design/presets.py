"""The designs that ship."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


def _folder() -> Path:
    installed = _PACKAGE / "designs"
    return installed if installed.is_dir() else _PACKAGE.parent / "designs"


def preset_names() -> tuple[str, ...]:
    """Names of the designs that ship, the paper's first."""
    names = sorted(path.stem for path in _folder().glob("*.toml"))
    return tuple(sorted(names, key=lambda name: (not name.startswith("paper"), name)))


def preset_path(name: str) -> Path:
    """Where the design file of a preset lies.

    Raises
    ------
    KeyError
        No preset is called that.
    """
    path = _folder() / f"{name}.toml"
    if name not in preset_names():
        raise KeyError(f"no preset is called {name!r}; there are {', '.join(preset_names())}")
    return path
