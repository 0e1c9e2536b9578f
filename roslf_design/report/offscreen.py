"""Whether 3D pictures can be made here, and making them where a crash does no harm: in a child process.

VTK without a working OpenGL does not raise: it ends the whole process. So the parent never touches it.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

PACKAGES = "libegl1 libgl1-mesa-dri"
"""Debian packages with which off-screen 3D works on a machine without a display."""
TIMEOUT = 25.0
"""Seconds after which a picture is given up."""
CHILD = ("-m", "roslf_design.report.model")
"""What the child runs: arguments of the interpreter."""
WINDOWS = {"egl": "vtkEGLRenderWindow", "osmesa": "vtkOSOpenGLRenderWindow"}
"""VTK's own name for each way to draw without a display."""


class NoPictureError(Exception):
    """A 3D picture that cannot be made here; the message says why and what helps."""


def backend(environment: Mapping[str, str]) -> str | None:
    """The way in which VTK could draw: "egl", "x", "osmesa", "native", or None where no library for it is there."""
    if sys.platform != "linux":
        return "native"
    if _loads("libEGL.so.1"):
        return "egl"
    if environment.get("DISPLAY") and _loads("libX11.so.6") and _loads("libGL.so.1"):
        return "x"
    return "osmesa" if _loads("libOSMesa.so.8") or _loads("libOSMesa.so") else None


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


class Rendering:
    """A picture being made by a child process; `result` waits for it.

    Parameters
    ----------
    text : str
        The child's standard input: a design as TOML.
    environment : mapping, optional
        Of the child; None is this process's own.

    Raises
    ------
    NoPictureError
        Where there is no library to draw with.
    """

    def __init__(self, text: str, environment: Mapping[str, str] | None = None) -> None:
        variables = dict(os.environ if environment is None else environment)
        way = backend(variables)
        if way is None:
            raise NoPictureError(f"no OpenGL library is installed; on Debian: apt-get install {PACKAGES}")
        if way in WINDOWS:
            variables["VTK_DEFAULT_OPENGL_WINDOW"] = WINDOWS[way]
        root = str(Path(__file__).resolve().parents[2])
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, [root, variables.get("PYTHONPATH", "")]))
        # A file, not a pipe: a child that never reads cannot hold up its parent.
        with tempfile.TemporaryFile() as file:
            file.write(text.encode())
            file.seek(0)
            self._child = subprocess.Popen(
                [sys.executable, *CHILD], stdin=file, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=variables
            )

    def result(self, timeout: float = TIMEOUT) -> bytes:
        """The picture as PNG bytes.

        Raises
        ------
        NoPictureError
            The child crashed, failed or took too long.
        """
        try:
            picture, complaint = self._child.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            self.cancel()
            raise NoPictureError(f"drawing took more than {timeout:g} s and was given up") from None
        if self._child.returncode == 0 and picture.startswith(b"\x89PNG"):
            return picture
        if self._child.returncode < 0:
            raise NoPictureError(f"OpenGL does not work here; on Debian: apt-get install {PACKAGES}")
        last = complaint.decode(errors="replace").strip().splitlines()[-1:] or ["no picture came"]
        raise NoPictureError(f"{last[0]}; on Debian this may help: apt-get install {PACKAGES}")

    def cancel(self) -> None:
        """End the child."""
        self._child.kill()
        self._child.communicate()
