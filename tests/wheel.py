"""Whether what is published works: sdist and wheel built, the wheel installed outside the checkout, six commands run.

Run again: ``make wheel``. The wheel is made of the sdist, which so has all that it needs.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

from roslf_design import __version__

ROOT = Path(__file__).parents[1]
COMMANDS = (
    "presets",
    "evaluate paper --json",
    "sweep paper --set d_3=0..150mm --quantity fill_factor,sigma_z_mm -o sweep.csv",
    "render paper --region 2000,1300,120,100 -o white.tif",
    "calibrate --plan paper --json",
    "report cystoscope -o cystoscope --pdf",
)
WRITTEN = ("sweep.csv", "white.tif", "cystoscope/index.html", "cystoscope/report.pdf")


def run(*words: str | Path, cwd: Path = ROOT) -> str:
    """What a program prints; ends all with its words where it fails."""
    print("+", *words, flush=True)
    done = subprocess.run([str(word) for word in words], cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{done.stdout}{done.stderr}tests/wheel.py: {words[0]} ended with {done.returncode}")
    return done.stdout


def main() -> None:
    """Build, install elsewhere, run, compare with the checkout's answer."""
    dist = ROOT / "dist"
    run(sys.executable, "-m", "build", "--outdir", dist)
    (wheel,) = dist.glob(f"roslf_design-{__version__}-*.whl")
    with tempfile.TemporaryDirectory(prefix="roslf-wheel-") as folder:
        place = Path(folder)
        venv.create(place / "env", with_pip=True)
        python, roslf = place / "env/bin/python", place / "env/bin/roslf"
        quiet = ("--quiet", "--disable-pip-version-check", "-c", ROOT / "constraints.txt")
        run(python, "-m", "pip", "install", *quiet, wheel, cwd=place)
        if (version := run(roslf, "--version", cwd=place).strip()) != __version__:
            sys.exit(f"tests/wheel.py: the wheel says version {version}, the checkout {__version__}")
        said = {command: run(roslf, *command.split(), cwd=place) for command in COMMANDS}
        if missing := [name for name in WRITTEN if not (place / name).stat().st_size]:
            sys.exit(f"tests/wheel.py: nothing in {', '.join(missing)}")
    ours = run(Path(sys.executable).parent / "roslf", *COMMANDS[1].split())
    if json.loads(said[COMMANDS[1]]) != json.loads(ours):
        sys.exit(f"tests/wheel.py: roslf {COMMANDS[1]} says other numbers than the checkout")
    print(f"{wheel.name}: installed, {len(COMMANDS)} commands run, the checkout's numbers")


if __name__ == "__main__":
    main()
