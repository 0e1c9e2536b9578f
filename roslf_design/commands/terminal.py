"""Terminal helpers of all commands: progress, files in a folder, faults of options."""

from __future__ import annotations

import html
import importlib.util
import io
import json
import math
import os
import re
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from .._jit import is_compiling
from ..design.files import in_the_way, write_atomically
from ..distances import check_distances
from ..drawing.typeset import PNG_MARK
from ..errors import OTHER_PLACE, Argument, InputError, Problem, printable, refusal
from ..seeds import check_seed
from ..words import about_time

Flag = Annotated[bool, Parameter(negative=())]
"""A switch that is off unless given."""
Json = Annotated[bool, Parameter(negative=(), help="Print JSON instead of tables.")]
DesignName = Annotated[str, Parameter(help="A design file, or the name of a preset (see `roslf presets`).")]
Output = Annotated[Path, Parameter(name=["--output", "-o"])]
OptionalOutput = Annotated[Path | None, Parameter(name=["--output", "-o"])]
Repeated = Annotated[list[str] | None, Parameter(negative=())]
"""Texts, of an option that may be given several times."""
Distances = Repeated
"""Lengths with their units, as "10mm"."""
Flat = Parameter(name="*")
"""For a job's options: each field is an option of the shell, its text its help."""
Unread = Parameter(parse=False)
"""For a field that the shell has another form for."""

PATIENCE = 2.0
"""Seconds before a bar appears: shorter work needs none."""
LOGGED = 30.0
"""Seconds between lines of progress in a log."""
COMPILING = "compiling, once on this machine"
"""Words where loops are compiled: nothing is counted then, and the next run does without."""
PAGE = "index.html"
"""Name of the page in a folder of results."""
MARKS = {
    ".csv": rb"\A.*(?:\nschema,.*)?",
    ".svg": rb'<svg [^>]*data-testid="(picture-[^"-]+)',
    ".png": re.escape(PNG_MARK),
    ".zmx": rb"\nNOTE 0 roslf_design\n",
}
"""Marks of files of ours, by their kinds."""


class _Log:
    """Progress where stderr is no terminal: a line now and then, with the time that the step under way has left.

    While it is open, also where a step tells nothing for long: that it goes on, and for how long it has.
    """

    def __init__(self) -> None:
        self._last = self._began = self._told = time.monotonic()
        self._first, self._step, self._over = 0.0, "", threading.Event()
        self._done, self._total = 0.0, 0.0

    def __enter__(self) -> _Log:
        if math.isfinite(LOGGED):
            threading.Thread(target=self._go_on, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()

    def _go_on(self) -> None:
        while not self._over.wait(max(1.0, LOGGED / 4)):
            now = time.monotonic()
            if self._step and now - self._last >= 2 * LOGGED:
                self._last = now
                say(f"{self._step}{self._how_far(now)}", error=True)

    def _how_far(self, now: float) -> str:
        """Share and time left of the step, by what it last told, if only that it goes on."""
        if is_compiling():
            return f" ... {COMPILING}; {about_time(now - self._began)} so far"
        if not self._first < self._done < self._total:
            return f" ... {about_time(now - self._began)} so far"
        seconds = (self._told - self._began) * (self._total - self._done) / (self._done - self._first)
        if seconds < now - self._told:  # what is under way takes longer than all before it lets expect
            return f": {self._done / self._total:.0%}, {about_time(now - self._began)} so far"
        return f": {self._done / self._total:.0%}, about {about_time(seconds - (now - self._told))} left"

    def tell(self, step: str, done: float = 0.0, total: float = 0.0) -> None:
        """Say it where the last line is long ago."""
        now = time.monotonic()
        if step != self._step:
            self._began, self._first = now, done
        self._step, self._done, self._total, self._told = step, done, total, now
        if now - self._last < LOGGED or (total and not self._first < done < total):
            return
        self._last = now
        say(f"{step}{self._how_far(now) if total else ' ...'}", error=True)


class StatusLine(ExitStack):
    """One line that tells what is being done, gone afterwards; in a log a line now and then.

    Parameters
    ----------
    command
        What the line begins with: the command's name.
    """

    def __init__(self, command: str) -> None:
        super().__init__()
        self._command = command
        self._log = None if sys.stderr.isatty() else self.enter_context(_Log())
        self.callback(self.clear)

    def tell(self, what: str) -> None:
        """Replace the line."""
        if self._log is None:
            print(f"\r\x1b[2K{self._command}: {printable(what)} ...", end="", file=sys.stderr, flush=True)
        else:
            self._log.tell(f"{self._command}: {what}")

    def clear(self) -> None:
        """Take the line away."""
        if self._log is None:
            print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


def tell_cost(seconds: float, why: str, is_compiled: bool = True) -> None:
    """Say beforehand how long a job takes that needs patience, where stderr is a terminal: on one processor, about."""
    if not sys.stderr.isatty():
        return
    if seconds > PATIENCE:
        say(f"about {about_time(seconds)}: {why}", error=True)
    if not is_compiled:
        say("and up to a minute before, once on this machine, while its loops are compiled (`roslf warm`)", error=True)


@contextmanager
def bar(name: str, total: float = 1.0, at_once: bool = False) -> Iterator[Callable[[float], None]]:
    """A bar, in a log lines, with the time that is left, given how much of `total` is done; counted where that is > 1.

    Yields
    ------
    callable
        Takes how much is done, from 0 to `total`.
    """
    if not sys.stderr.isatty():
        with _Log() as log:
            yield lambda done: log.tell(name, done, total)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, Task, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Left(TimeRemainingColumn):
        """Time that is left, or that it waits for loops to be compiled."""

        max_refresh = 0.0

        def render(self, task: Task) -> Text:
            return Text(COMPILING) if is_compiling() else super().render(task)

    counted = TextColumn("{task.completed:.0f} of {task.total:.0f}") if total > 1 else TaskProgressColumn()
    console = Console(stderr=True)
    named = TextColumn("{task.description}", markup=False)
    shown = Progress(named, BarColumn(), counted, Left(), console=console, transient=True)
    task = shown.add_task(printable(name), total=total)
    # Also before anything is told: what is compiled first tells nothing.
    patience = threading.Timer(PATIENCE, shown.start)
    patience.daemon = True
    if at_once or PATIENCE <= 0:
        shown.start()
    else:
        patience.start()
    try:
        yield lambda done: shown.update(task, completed=done)
    finally:
        patience.cancel()
        if patience.ident is not None:
            patience.join()
        shown.stop()


@contextmanager
def status_and_bars(command: str) -> Iterator[Callable[..., None]]:
    """A status line that gives way to a bar where things are counted.

    Yields
    ------
    callable
        Takes what is being done; of counted things also how many are done, and how many there are.
    """
    if not sys.stderr.isatty():
        with _Log() as log:
            yield lambda what, done=0.0, total=0.0: log.tell(f"{command}: {what}", done, total)
        return
    with ExitStack() as stack, StatusLine(command) as status:
        counting: dict[str, Callable[[float], None]] = {}

        def tell(what: str, done: float = 0.0, total: float = 0.0) -> None:
            if what not in counting:
                stack.close()
                counting.clear()
            if not total:
                status.tell(what)
                return
            if not counting:
                status.clear()
                counting[what] = stack.enter_context(bar(f"{command}: {what}", total, at_once=True))
            counting[what](done)

        yield tell


def say(*texts: object, error: bool = False) -> None:
    """Print lines on stdout, or stderr; what of a name would steer the terminal is spelled out."""
    for text in texts:
        print(printable(str(text), kept="\n"), file=sys.stderr if error else sys.stdout)


def listed(files: Iterable[str]) -> list[str]:
    """Names of files as they are printed; of tables their folder alone."""
    return list(dict.fromkeys(f"{name.split('/')[0]}/" if "/" in name else name for name in files))


def json_text(data: Any) -> str:
    """JSON as commands print and write it; what steers a terminal is spelled out, as JSON itself does below 0x20."""
    return spelled(json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False))


def spelled(text: str) -> str:
    """JSON with all that would steer a terminal spelled out, as JSON does it."""

    def safe(match: re.Match[str]) -> str:
        return match[0] if printable(match[0]) == match[0] else json.dumps(match[0])[1:-1]

    return re.sub("[^ -~\n]", safe, text)


def write_files(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Files into a folder, made if needed, each whole or not at all; returns what was written.

    Raises
    ------
    InputError
        A page is in the way, as `check_page` has it; nothing is written.
    """
    for name, content in files.items():
        if name.endswith((".html", ".pdf")) and (folder / name).is_file():
            check_page(folder / name, _page_title(content))
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        write_atomically(folder / name, content)
    return [folder / name for name in files]


def write_file(target: Path, content: bytes) -> None:
    """A file that a command makes alone: over an earlier one alike, which is said, never over anything else.

    Raises
    ------
    InputError
        A page as `write_files` refuses it; a file that is no earlier one, by how it begins.
    """
    held = target.read_bytes() if target.is_file() else b""
    if held and _beginning(held, target.suffix.lower()) != _beginning(content, target.suffix.lower()):
        check_owner(target, None, "")
    write_files(target.parent, {target.name: content})
    say_written_over(target, held)


def say_written_over(target: Path, held: bytes) -> None:
    """Say of a file just written that it held something else before; nothing where it held nothing, or the same."""
    say(*([] if held in (target.read_bytes(), b"") else [f"roslf: {target} was there and is written over"]), error=True)


def _beginning(content: bytes, kind: str) -> Any:
    """Mark that earlier and later files of a command share; of a table without a schema its headings alone."""
    if kind in MARKS:
        return re.findall(MARKS[kind], content[:9999])[:1]
    with suppress(ValueError, AttributeError, TypeError, RecursionError):
        if kind == ".json":
            data = json.loads(content)  # Optiland's has no schema
            return (data["schema"], data.get("design")) if "schema" in data else (*data, data.get("name"))
        if kind == ".parquet":
            return importlib.import_module("pyarrow.parquet").read_schema(io.BytesIO(content)).names
    return content[:4]


def _page_title(content: bytes) -> str | None:
    """Title of a page, HTML or PDF; None where it has none, or nothing reads it."""
    if not content.startswith(b"%PDF"):
        named = re.search(rb"<title>(.*?)</title>", content, re.DOTALL)
        return named and html.unescape(named[1].decode(errors="replace"))
    try:
        import pikepdf
    except ModuleNotFoundError:
        return None
    try:
        with pikepdf.open(io.BytesIO(content)) as document:
            return str(document.docinfo.get("/Title", "")) or None
    except pikepdf.PdfError:
        return None


def check_page(path: Path, title: str | None) -> None:
    """Refuse to write a page of a title over one of another, or over a PDF that was signed or marked since."""
    content = path.read_bytes() if path.is_file() else b""
    if content:
        check_owner(path, _page_title(content), title)
    if content.startswith(b"%PDF") and content.count(b"%%EOF") > 1:
        raise refusal("output", f"{path} was signed or marked since it was written; {OTHER_PLACE}")


def check_study(folder: Path, name: str, file: Path) -> None:
    """Refuse a folder with results of another study, or of another file that is still there, as of one copied."""
    results = folder / "results.json"
    held = own = f"{name} in {file}"  # where there is nothing, an older one that does not say its file, or that moved
    with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        data = json.loads(results.read_bytes())
        other = (folder / data["file"]).resolve()
        if data["study"] != name or not other.samefile(file):
            held = f"{data['study']} in {other}"
    check_owner(results, held, own)


def seen_from(folder: Path, file: Path) -> str:
    """Path of a file from a folder, as results in it name it."""
    return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()


def check_owner(path: Path, held: str | None, owner: str | None) -> None:
    """Refuse to write over a file that is of another than its owner, or of nobody known."""
    if held != owner:
        raise refusal("output", f"{path} is of {held or 'something else'}; {OTHER_PLACE}")


def typed(*words: object, **options: object) -> str:
    """A command as it is typed again; options that are None or off are left out, lists given once for each."""
    parts = ["roslf", *map(str, words)]
    for name, value in options.items():
        flag = "-o" if name == "output" else f"--{name.replace('_', '-')}"
        for one in value if isinstance(value, list) else [value]:
            if one is True:
                parts.append(flag)
            elif one is not None and one is not False:
                parts += [flag, f"{one:g}" if isinstance(one, float) else str(one)]
    return printable(shlex.join(parts))


def check_options(
    seed: int | None = None,
    folder: Path | None = None,
    *others: Problem,
    title: str = "",
    pages: Sequence[str] = (PAGE,),
) -> None:
    """Refuse, before any work, options that cannot be had; with the `title` of `pages`, a folder that has others'.

    Raises
    ------
    InputError
        A seed out of range, a place where no page can be written, what else is wrong: all reported.
    """
    faults = list(others)
    if seed is not None:
        try:
            check_seed(seed)
        except InputError as error:
            faults += error.problems
    if folder is not None and (blocked := in_the_way(folder / PAGE)):
        faults.append(Argument("output", blocked))
    if faults:
        raise InputError(tuple(faults))
    if folder is not None and title:
        for page in pages:
            check_page(folder / page, title)


def check_target(target: Path, kinds: Sequence[str] = ()) -> str:
    """Refuse a file that cannot be written, or is of none of `kinds`, if given; returns its kind, as ".csv"."""
    kind = target.suffix.lower()
    if kinds and kind not in kinds:
        ends = " or ".join(kinds) if len(kinds) == 2 else ", ".join(kinds)
        raise refusal("output", f"{target.name} is of no kind that is written here; end it in {ends}")
    if blocked := in_the_way(target):
        raise refusal("output", blocked)
    return kind


def check_typst(option: str) -> None:
    """Refuse an option that asks for a PDF where nothing sets one."""
    if importlib.util.find_spec("typst") is None:
        raise refusal(option, "a PDF needs the typst package; install it: pip install typst")


def parse_sigmas(texts: list[str] | None) -> dict[str, str]:
    """Read "place=sigma", any number of times; refused where one is not that, or a place stands twice."""
    sigmas: dict[str, str] = {}
    for text in texts or ():
        place, between, sigma = (part.strip() for part in text.partition("="))
        if not (place and between and sigma):
            raise refusal("sigma", f'cannot read "{text}"; write a place and its sigma, as "elements.0.thickness=5 um"')
        if place in sigmas:
            raise refusal("sigma", f"{place} is given twice; drop one")
        sigmas[place] = sigma
    return sigmas


def read_distances(texts: list[str] | None) -> tuple[float, ...]:
    """Distances ahead of the tip [mm] from their texts; refused where one is none."""
    return check_distances(texts or ())
