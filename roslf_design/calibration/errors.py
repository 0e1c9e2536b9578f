"""Errors of the calibration: images or boards that cannot answer what they are asked."""

from __future__ import annotations

import importlib
from types import ModuleType


class CalibrationError(ValueError):
    """The images, boards or priors given cannot determine what was asked; the message says why and what to change."""


class MissingExtraError(ImportError):
    """An optional library is absent; the message says how to install it."""


def optional_module(name: str, purpose: str) -> ModuleType:
    """Import an optional library by name.

    Raises
    ------
    MissingExtraError
        If it is not installed: names the library, its purpose and the extra that brings it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError(
            f"{purpose} needs the Python library {name!r}: install it with `pip install 'roslf_design[calibrate]'`"
        ) from error
