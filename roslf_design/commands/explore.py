"""`roslf explore`."""

from __future__ import annotations

import asyncio
import webbrowser
from importlib.util import find_spec
from threading import Thread
from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError, Problem
from ..explorer.server import application, is_local, serve
from ..explorer.session import Session
from ..imaging.white import warm_up
from ..theory.limits import as_design
from .terminal import DesignName, say

PACKAGES = ("trame", "trame_client", "trame_server", "trame_vtk", "aiohttp")
"""Packages that the explorer needs beyond the rest of the library."""


def explore(
    design: DesignName = "paper",
    /,
    *,
    port: int | None = None,
    host: str = "127.0.0.1",
    browser: Annotated[bool, Parameter(negative="--no-browser")] = True,
) -> None:
    """Interactive explorer: sliders, live pictures and verdicts in the browser, served from this machine.

    Parameters
    ----------
    port
        Where to listen; 0 lets the system choose. Default: the first free one from 8517 on.
    host
        Address to listen on. The default is reached from this machine only.
    browser
        Whether to open the page in the browser.
    """
    _check_packages()
    loaded = as_design(design)

    def ready(address: str) -> None:
        print(f"The explorer is at {address} (Ctrl-C ends it)", flush=True)
        if not is_local(host):
            say(f"roslf: with --host {host} everyone who reaches this machine can use it", error=True)
        if browser:
            webbrowser.open(address)

    import numba  # noqa: F401  # two threads that import it at once see half of it

    # Beside the page's first pictures, which would else wait for compiled kernels one after the other; nothing is
    # computed there, so no two threads meet in a kernel.
    Thread(target=warm_up, daemon=True).start()
    asyncio.run(serve(application(lambda: Session(loaded), host), host, port, ready))


def _check_packages() -> None:
    """Tell what to install where the web app's packages are missing."""
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        names = " ".join(name.replace("_", "-") for name in missing)
        message = f"needs packages that are not installed; install them: pip install {names}"
        raise InputError((Problem("explore", message),))
