"""Decoded light fields on disk: npz always, netCDF where xarray is there; whole files or none."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from .errors import CalibrationError
from .lightfield import LightField

_SCHEMA = "roslf.lightfield/1"


def save_light_field(path: str | Path, field: LightField, netcdf: bool | None = None) -> list[Path]:
    """Write a light field as ``<path>.npz`` and, where xarray is there, ``<path>.nc``.

    Parameters
    ----------
    path : str or Path
        Its suffix is replaced.
    field : LightField
    netcdf : bool, optional
        True demands the netCDF file, False leaves it out; not given, it is written where xarray is installed.

    Returns
    -------
    list of Path
        The files written. Each is moved into place only when complete.

    Raises
    ------
    MissingExtraError
        ``netcdf=True`` without xarray.
    OSError
        The folder cannot be written; no partial file is left.
    """
    base = Path(path)
    arrays = {name: getattr(field, name) for name in ("values", "weight", "s", "t", "u", "v")}

    def write_npz(target: Path) -> None:
        with target.open("wb") as stream:
            np.savez_compressed(
                stream, schema=_SCHEMA, pitch=field.pitch, rotation=field.rotation, allow_pickle=False, **arrays
            )

    written = [_whole(base.with_suffix(".npz"), write_npz)]
    if netcdf or (netcdf is None and find_spec("xarray") is not None):
        data = field.to_xarray()
        written.append(_whole(base.with_suffix(".nc"), lambda target: data.to_netcdf(target, engine="scipy")))
    return written


def load_light_field(path: str | Path) -> LightField:
    """Read a light field from its npz file.

    Raises
    ------
    CalibrationError
        The file is not one of `save_light_field`.
    """
    try:
        with np.load(Path(path), allow_pickle=False) as data:
            if str(data["schema"]) != _SCHEMA:
                raise CalibrationError(f"{path} is no light field of this version: its schema is {data['schema']}")
            arrays = {name: data[name] for name in ("values", "weight", "s", "t", "u", "v")}
            return LightField(**arrays, pitch=float(data["pitch"]), rotation=float(data["rotation"]))
    except (KeyError, ValueError, EOFError) as error:
        if isinstance(error, CalibrationError):
            raise
        raise CalibrationError(f"{path} is no light field file: {error}") from error


def _whole(path: Path, write: Callable[[Path], object]) -> Path:
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    os.close(handle)
    part = Path(name)
    try:
        write(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return path
