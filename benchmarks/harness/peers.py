"""Peers in virtual environments of their own, with pinned versions; none is a dependency of the project."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PIP = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--prefer-binary")
PATIENCE = 900.0
"""Longest time an installation may take [s]."""


@dataclass(frozen=True)
class Peer:
    """A program to compare with."""

    key: str
    title: str
    """With its version."""
    licence: str
    packages: tuple[str, ...]
    module: str
    """What is imported to see that it works."""
    loose: tuple[str, ...] = ()
    """Packages installed first, without what they say they need."""
    pythons: tuple[str, ...] = ()
    """Versions that it takes, best first, where not the one at hand ("3.10")."""
    note: str = ""


PEERS = (
    Peer("optiland", "Optiland 0.6.3", "MIT", ("optiland==0.6.3",), "optiland.optic"),
    Peer("batoid", "batoid 0.9.0", "BSD-2", ("batoid==0.9.0",), "batoid"),
    Peer("plenoptisign", "PlenoptiSign 1.1.3", "GPL-3", ("plenoptisign==1.1.3",), "plenoptisign"),
    Peer(
        "plenopticam",
        "PlenoptiCam 0.9.3",
        "GPL-3",
        (
            *("numpy==1.23.5", "scipy==1.10.1", "scikit-image==0.19.3", "colour-science==0.4.4"),
            *("colour-demosaicing==0.2.2", "color-matcher==0.4.0", "color-space-converter==0.1.4", "depthy==0.3.0"),
            *("imageio==2.31.6", "Pillow==9.5.0", "tifffile==2022.4.8", "docutils<0.24", "requests"),
        ),
        "plenopticam.lfp_calibrator",
        loose=("plenopticam==0.9.3",),
        pythons=("3.10", "3.9", "3.8"),
        note="its own list of needs asks for pyinstaller 4.10, which is no longer to be had; installed without it. "
        "scikit-image 0.19.3 has no build for Python 3.11, so an older one is used",
    ),
    Peer(
        "here",
        "roslf_design",
        "MIT",
        (str(REPOSITORY),),
        "roslf_design",
        note="as a user installs it, to be weighed beside the others",
    ),
)


@dataclass(frozen=True)
class Installed:
    """A peer as it is on this machine."""

    peer: Peer
    python: Path | None
    """None where it cannot be used."""
    reason: str = ""
    """Why not."""
    seconds: float = 0.0
    """That making it took, when it was made."""
    mib: float = 0.0
    """Size of its packages and all they need."""

    def to_dict(self) -> dict[str, object]:
        """For JSON, without paths."""
        return {
            "key": self.peer.key,
            "title": self.peer.title,
            "licence": self.peer.licence,
            "packages": [name for name in (*self.peer.loose, *self.peer.packages) if "/" not in name],
            "installed": self.python is not None,
            "reason": self.reason,
            "install_seconds": round(self.seconds, 1),
            "size_mib": round(self.mib, 1),
            "note": self.peer.note,
        }


def cache_folder() -> Path:
    """Where environments are kept: `ROSLF_BENCH_CACHE`, or roslf-bench in the user's cache folder."""
    named = os.environ.get("ROSLF_BENCH_CACHE")
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(named) if named else base / "roslf-bench"


def install(peer: Peer, folder: Path | None = None) -> Installed:
    """Make a peer's environment where there is none yet; what fails is told, not raised."""
    home = (folder or cache_folder()) / peer.key
    python = home / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    stamp = home / "installed.json"
    wanted = {**asdict(peer), "base": sys.version}
    if peer.key == "here":
        wanted["needs"] = (REPOSITORY / "pyproject.toml").read_text()
    found = interpreter(peer.pythons)
    if found is None:
        return Installed(peer, None, f"no Python {' or '.join(peer.pythons)} on this machine; {peer.note}")
    start = time.perf_counter()
    try:
        if not _same(stamp, wanted):
            _make(peer, found, home, python)
            stored = {"peer": wanted, "seconds": time.perf_counter() - start}
            stamp.write_text(json.dumps(stored, default=str))
        elif peer.key == "here":  # what it needs is there; the project itself may have changed
            _run([str(python), *PIP, "--no-deps", "--force-reinstall", *peer.packages])
    except subprocess.CalledProcessError as error:
        return Installed(peer, None, _why(error.stderr))
    except (OSError, subprocess.TimeoutExpired) as error:
        return Installed(peer, None, str(error)[:300])
    return Installed(peer, python, "", float(json.loads(stamp.read_text())["seconds"]), _weight(home))


def _same(stamp: Path, wanted: dict[str, object]) -> bool:
    """Whether the environment is complete and of the same pins."""
    if not stamp.exists():
        return False
    stored = json.loads(stamp.read_text()).get("peer")
    return bool(stored == json.loads(json.dumps(wanted, default=str)))


def interpreter(versions: tuple[str, ...]) -> str | None:
    """A Python of one of these versions that starts (none given: the one running); also those that pyenv keeps."""
    if not versions:
        return sys.executable
    for version in versions:
        kept = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
        for name in (shutil.which(f"python{version}"), *map(str, kept)):
            if name and subprocess.run([name, "-c", "import venv"], capture_output=True, check=False).returncode == 0:
                return name
    return None


def _make(peer: Peer, base: str, home: Path, python: Path) -> None:
    shutil.rmtree(home, ignore_errors=True)
    home.parent.mkdir(parents=True, exist_ok=True)
    _run([base, "-m", "venv", str(home)])
    pip = [str(python), *PIP]
    if peer.loose:
        _run([*pip, "--no-deps", *peer.loose])
    pins = ["-c", str(REPOSITORY / "constraints.txt")] if peer.key == "here" else []
    _run([*pip, *pins, *peer.packages])
    _run([str(python), "-c", f"import {peer.module}"])


def _run(words: list[str]) -> None:
    subprocess.run(words, check=True, capture_output=True, text=True, timeout=PATIENCE)


def _why(told: str) -> str:
    """The telling line of what pip or Python wrote."""
    lines = [line.strip() for line in told.splitlines() if line.strip() and "WARNING" not in line]
    errors = [line for line in lines if "error" in line.lower()]
    told = (errors or lines or ["it failed without a word"])[-1]
    return told.replace(str(REPOSITORY), ".").replace(str(Path.home()), "~")[:300]


def _weight(home: Path) -> float:
    """Size of all packages but pip and setuptools, byte code left out, as every first run makes its own [MiB]."""
    total = 0
    for packages in home.glob("lib/python*/site-packages"):
        for file in packages.rglob("*"):
            top = file.relative_to(packages).parts[0].split("-")[0]
            if top not in ("pip", "setuptools", "pkg_resources", "_distutils_hack") and file.suffix != ".pyc":
                total += file.lstat().st_size if file.is_file() else 0
    return total / 2**20
