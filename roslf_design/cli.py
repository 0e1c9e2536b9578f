"""`roslf`: finds the command, runs it, turns errors into one line each and an exit code.

Exit codes: 0 done, 1 the run failed, 2 the input is wrong. Commands are named by text and imported only when called,
so that `roslf --help` stays quick.
"""

from __future__ import annotations

import difflib
import errno
import gc
import io
import os
import re
import signal
import sys
import threading
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from ._version import __version__
from .errors import InputError, cause, one_line

if TYPE_CHECKING:
    from importlib.abc import Loader

    from cyclopts import App
else:
    Loader = object  # importlib.abc brings importlib.resources with it

NAMES = (errno.ENAMETOOLONG, errno.ELOOP)
"""Errors of the system for names that no file can have, wherever one is first looked for."""
LISTED = 40
"""Faults that are told one by one."""
PATIENCE = 2.0
"""Seconds of a command for want of machine code from which on it says what would save them."""
SELDOM_USED = frozenset(
    {
        *("numpy.f2py", "numpy.ma", "numpy.testing", "numpy._core._add_newdocs", "numpy._core._add_newdocs_scalars"),
        *("ctypes", "importlib.metadata._adapters", "json", "secrets", "shutil", "tempfile", "yaml", "zipfile"),
        "scipy.special",  # of scipy.ndimage
    }
)
"""Modules that numpy, scipy, numba and pydantic import, slow ones, and commands use seldom or never."""
YOUNG = 20_000
"""Objects made before Python looks for cycles that nothing holds any more."""


class _Command(NamedTuple):
    """Command's summary and example in `--help`."""

    summary: str
    example: str


COMMANDS = {
    "evaluate": _Command(
        "Verdicts on a camera and its numbers: what it sees, how deep it measures, what is wrong, what would mend it.",
        "roslf evaluate rigid-scope --at 10mm",
    ),
    "render": _Command(
        "The raw light-field image that the sensor would record, with only the physics it needs.",
        "roslf render designs/paper.toml --preview -o white.tif",
    ),
    "depth": _Command(
        "Depth that a camera measures, and its errors: of a scene, simulated, beside the truth; or in a picture taken.",
        "roslf depth designs/paper.toml --region 2240,1480,120,120 -o out/depth",
    ),
    "report": _Command(
        "A report on a design, a study or a story: one self-contained HTML page, and a PDF.",
        "roslf report designs/paper.toml -o reports/paper",
    ),
    "datasheet": _Command(
        "The page an engineer signs: the camera in the terms of ISO 8600, each line with its tolerance.",
        "roslf datasheet designs/paper.toml -o paper.pdf",
    ),
    "sweep": _Command(
        "Any quantities over one or two lengths of a design: a picture, or a table.",
        'roslf sweep paper --set "aperture.distance=0..150 mm" --quantity fill_factor,sigma_z_mm',
    ),
    "tolerance": _Command(
        "A tolerance study: yield, sensitivities, Monte Carlo, inverse tolerances, adjustments.",
        "roslf tolerance studies/tolerance-paper/study.toml -o out/tolerance-paper --workers 2",
    ),
    "optimize": _Command(
        "Find the design: from a bore and what must be seen, or what stands in the way.",
        "roslf optimize studies/optimize-rigid-scope/study.toml -o out/rigid-scope",
    ),
    "calibrate": _Command(
        "Lengths of the built camera from pictures of a checkerboard, with their uncertainty; or plan the capture.",
        'roslf calibrate captures --design designs/paper.toml --board "4x5 6 mm" -o out/calibration',
    ),
    "bench": _Command(
        "The camera that was built: a bench's protocol and targets to print, and what its captures are worth.",
        "roslf bench paper -o out/bench",
    ),
    "decode": _Command(
        "From a raw image, or decoded views, to pictures: views, refocus stack, epipolar-plane image.",
        "roslf decode raw.tif --white white.tif --design designs/paper.toml -o out/decoded",
    ),
    "catalogue": _Command(
        "Lenses, microlens arrays, sensors and windows that can be bought, with where their figures come from.",
        'roslf catalogue --kind lenses --where "focal_length<=100 mm"',
    ),
    "export": _Command(
        "A camera, or a lens, as a file of another program: .zmx, or Optiland's .json.",
        "roslf export designs/paper-singlet.toml -o out/paper-singlet.zmx",
    ),
    "accuracy": _Command(
        "How far numbers can be trusted, and what accuracy costs in time.",
        "roslf accuracy designs/paper.toml --accuracy 1e-4 -o reports/accuracy",
    ),
    "explore": _Command(
        "Interactive explorer: sliders, live pictures and verdicts in the browser, served from this machine.",
        "roslf explore designs/paper.toml",
    ),
    "quantities": _Command("Every number of a camera by its name, with its unit and what it is.", "roslf quantities"),
    "keys": _Command(
        "Every key that a file may hold: what it takes, its default, what it means.", "roslf keys main_lens"
    ),
    "presets": _Command("The designs that ship, and where their files are.", "roslf presets"),
    "warm": _Command(
        "Compile once, on a new machine, what commands would compile when each is first run.", "roslf warm"
    ),
}
"""Each command: a function in the module of that name in `commands`, imported only when called."""

GROUPS = frozenset({"accuracy", "bench"})
"""Commands that have commands of their own: an App instead of a function, which brings its own example."""


def build_app() -> App:
    """The command-line application, its commands not yet imported."""
    from cyclopts import App  # within, as what Ctrl-C does while it is imported is told by `main`

    app = App(
        name="roslf",
        help="Design and tolerance explorer for light-field cameras that look out of a bore.",
        help_epilogue=f"Example: {COMMANDS['evaluate'].example}",
        version=__version__,
        suppress_keyboard_interrupt=False,
        help_format="markdown",
    )
    for name, command in COMMANDS.items():
        example = {} if name in GROUPS else {"help_epilogue": f"Example: {command.example}"}
        app.command(f"roslf_design.commands.{name}:{name}", name=name, help=command.summary, **example)
    return app


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code, after one line on stderr for each thing wrong."""
    try:
        result = _run(sys.argv[1:] if arguments is None else arguments)
        sys.stdout.flush()
    except InputError as error:
        return _complain(str(error.in_shell()), 2)
    except BrokenPipeError:
        # The reader (head, less) has what it wanted; keep the interpreter from complaining when it flushes.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # rich has done the same, and calls it a failure
            return 0
        raise
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        if error.errno in NAMES:
            return _complain(f"{place}{error.strerror}; give another name", 2)
        return _complain(f"{place}{error.strerror or error}", 1)
    except (ArithmeticError, MemoryError) as error:
        return _complain(cause(error), 1)
    except KeyboardInterrupt:
        return _complain("stopped", 130)
    return result if isinstance(result, int) else 0


def _run(arguments: list[str]) -> Any:
    from cyclopts.exceptions import CycloptsError, MissingArgumentError

    try:
        command, bound, _ = build_app().parse_args(_signed(arguments), exit_on_error=False, print_error=False)
        if not gc.isenabled():
            gc.freeze()
            gc.enable()
        return command(*bound.args, **bound.kwargs)
    except CycloptsError as error:
        options = getattr(getattr(error, "argument", None), "hint", None)
        if refused := getattr(options, "refused", None):  # a job's options, which tell every fault
            raise refused(error.__cause__) from None
        more, asked = getattr(error, "unused_tokens", None), " ".join(["roslf", *(error.command_chain or ())])
        wrong = f"{more[0]!r} is one argument too many." if more else " ".join(str(error).split())
        if more and not error.command_chain and (near := difflib.get_close_matches(more[0], COMMANDS, 1)):
            wrong = f"{more[0]!r} is no command; did you mean {near[0]}?"
        if isinstance(error, MissingArgumentError) and error.argument:
            missing = "needs a value" if error.keyword else "is missing"
            chain = " ".join(error.command_chain or ())
            shown = f", as in: {COMMANDS[chain].example}" if chain in COMMANDS else ""
            wrong = f"{error.argument.name} {missing}{shown}."
        return _complain(f"{wrong} See `{asked} --help`.", 2)
    except UnicodeEncodeError as error:
        if error.encoding != "utf-8":
            raise
        return _complain(f'"{error.object}" is no UTF-8 text; write it again', 2)


def _signed(arguments: list[str]) -> list[str]:
    """Arguments with values below 0, as "-3mm", bound to their options, which then tell what is wrong with them."""
    bound: list[str] = []
    for argument in arguments:
        if re.match(r"-\.?\d", argument) and bound and re.fullmatch(r"--[a-z][a-z-]*", bound[-1]):
            bound[-1] += f"={argument}"
        else:
            bound.append(argument)
    return bound


def _complain(message: str, code: int) -> int:
    lines = message.splitlines()
    for line in lines[:LISTED]:
        print(f"roslf: {one_line(line)}", file=sys.stderr)
    if len(lines) > LISTED:
        print(f"roslf: and {len(lines) - LISTED} more faults", file=sys.stderr)
    return code


def _advise(is_warm: bool) -> None:
    """Say where a command was slow for want of machine code, and somebody watches."""
    jit = sys.modules.get("roslf_design._jit")
    if jit is not None and not is_warm and sys.stderr.isatty() and (seconds := jit.cold_seconds()) > PATIENCE:
        advice = "`roslf warm` compiles all of it, once on a machine, in two minutes of a free one"
        print(f"roslf: {seconds:.0f} s of this were for code that is not compiled yet; {advice}", file=sys.stderr)


class _Later(Loader):
    """Loader of a module that is executed when somebody asks for what is in it.

    Whichever thread asks: importlib's own shows others half a module, before Python 3.12.
    """

    def __init__(self, loader: Loader) -> None:
        self.loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Make a module as its own loader does."""
        return self.loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Wait with it."""
        lock, names, begun = threading.RLock(), vars(module), False
        names["__loader__"] = self.loader

        def asked(name: str) -> Any:
            nonlocal begun
            with lock:
                if not begun:
                    begun = True
                    self.loader.exec_module(module)
            if name in names:
                return names[name]
            if names["__getattr__"] is not asked:
                return names["__getattr__"](name)
            raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")

        names["__getattr__"] = asked


class _Lazily:
    """Finder of modules that are executed when somebody asks for what is in them."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Find one that is seldom used, and none else."""
        spec = PathFinder.find_spec(name, path, target) if name in SELDOM_USED else None
        if spec is not None and spec.loader is not None:
            spec.loader = _Later(spec.loader)
        return spec


def run() -> None:
    """Entry point of the `roslf` script."""
    sys.meta_path.insert(0, _Lazily)
    gc.set_threshold(YOUNG)
    gc.disable()  # until the command's modules are imported: all that imports make stays
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small products wait longer for threads than they take
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # it would read what all installed packages are
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal, or a file's name, may not know every letter
    code = main()
    _advise(sys.argv[1:2] == ["warm"])
    # Ctrl-C while the interpreter ends would print a traceback.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.freeze()  # the process ends: what is left is not looked through for cycles once more
    sys.exit(code)
