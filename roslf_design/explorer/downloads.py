"""What can be taken away: the design, its report, and every picture."""

from __future__ import annotations

import asyncio
import re
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from ..commands.report import folder_name
from ..design import dumps
from ..design.write import write_atomically
from .session import Session


class Download(NamedTuple):
    """A file as the browser saves it."""

    name: str
    kind: str
    """Its media type."""
    content: bytes


class DownloadError(Exception):
    """A file that could not be made; says why."""


async def download(session: Session, name: str) -> Download | None:
    """The file that is asked for; None where there is no such thing.

    Parameters
    ----------
    session : Session
        Whose design.
    name : str
        ``design.toml``, ``report.html``, or a picture's name with ``.svg``.

    Raises
    ------
    DownloadError
        The report's own command failed.
    """
    stem = folder_name(session.design.name)
    if name == "design.toml":
        return Download(f"{stem}.toml", "application/toml", dumps(session.design).encode())
    if name == "report.html":
        return Download(f"{stem}-report.html", "text/html", await _report(session, stem))
    if match := re.fullmatch(r"([a-z-]+)\.svg", name):
        picture = session.picture(match[1], "light")
        return None if picture is None else Download(f"{stem}-{name}", "image/svg+xml", picture.encode())
    return None


async def _report(session: Session, stem: str) -> bytes:
    """The design report, made by the command that it names, in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="roslf-") as folder:
        write_atomically(Path(folder) / f"{stem}.toml", dumps(session.design).encode())
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "roslf_design", "report", f"{stem}.toml", "-o", "report"),
            cwd=folder,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
        )
        with session.owning(process):
            _, told = await process.communicate()
        if process.returncode:
            raise DownloadError(told.decode(errors="replace").strip() or "the report was stopped")
        return (Path(folder) / "report" / "index.html").read_bytes()
