"""Session of one tab: requests of the page in, the page's values out. Holds the tab's history; draws what is shown."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from typing import Annotated, Any, NamedTuple, TypeVar

from pydantic import FiniteFloat, ValidationError, validate_call

from ..design import Design, DesignError, dumps, preset_names
from ..design.files import WRITTEN
from ..drawing.picture import Picture, notice
from ..drawing.solid import BrowserMesh, changed
from ..drawing.theme import ThemeName
from ..errors import FAULTS, InputError, cause
from ..evaluation import Evaluation, evaluate
from ..reporting.design.instrument import scene
from ..theory.limits import as_design, design_of_text
from .fixes import Fix, proposals
from .forms import Options, forms
from .jobs import Failure, Later, ProcessJob, Progress
from .main_lens import explored_lens
from .report_run import file_stem, run_report
from .runs import KINDS, Run, summary
from .state import (
    BY_SYMBOL,
    CONTROLS,
    TABS,
    Choice,
    History,
    LinkError,
    Look,
    State,
    decode,
    key_of,
    on_array,
    place_on_mla,
    reach,
    value_at,
)
from .view import (
    DRAWINGS,
    PictureSource,
    Size,
    awaited,
    awaited_lights,
    controls,
    depth_known,
    depth_unknown,
    fitting,
    glance,
    header,
    looked_at,
    shown_lights,
    unknown,
    warmth,
)

Known = TypeVar("Known")
Symbol = Annotated[str, key_of(CONTROLS)]
Kind = Annotated[str, key_of(KINDS)]

PUPIL_STEP = 1e-3
"""Least diameter of a FAP that is dragged, and how close to the lens one behind it comes [mm]."""
TICK = 0.25
"""Interval at which a run is asked for its progress [s]."""

MOST_TEXT = 1_000_000
"""Largest design file that is taken [characters]."""


class _Download(NamedTuple):
    """A file as the browser saves it."""

    name: str
    kind: str
    """Media type of the file."""
    content: bytes


class DownloadError(Exception):
    """A file that could not be made; says why."""


class Session:
    """The state of one tab, and the requests that change it.

    Parameters
    ----------
    design : Design
        What it opens with, unless the address brings a state of its own.
    """

    requests = (
        *("opened", "restore", "slide", "write", "choose", "follow", "undo", "redo", "load_text", "load_path", "fix"),
        *("dismiss", "show", "look", "point", "let_go", "nudge", "resize", "set_theme", "space_again", "start_run"),
        *("cancel_run", "stop_run", "take_optimum"),
    )
    """Methods that the page may call, through `ask`."""
    of_the_page = frozenset({"resize"})
    """Requests after which all that is shown is still of the present design."""

    def __init__(self, design: Design) -> None:
        self._history = History(State.of(design))
        self._look = Look()
        self._theme: ThemeName = "light"
        self._sizes: dict[str, Size] = {name: drawing.size for name, drawing in DRAWINGS.items()}
        self._opened = False
        self._limits: tuple[float, float] | None = None
        self._runs: dict[str, Run] = {}
        self._wrong: dict[str, str] = {}
        self._space = _Space()
        self._evaluated = lru_cache(maxsize=2)(evaluate)
        self._known: dict[Callable[[Design], Any], tuple[Design, Any]] = {}
        self._later = Later(lambda: self.on_news())
        self._drawn: dict[str, tuple[Any, Picture | None, str]] = {}
        self._unsaid: list[tuple[Design, str]] = []
        self._reports: list[ProcessJob[bytes]] = []
        self.on_news: Callable[[], None] = lambda: None
        """Called when something is to be shown that nobody asked for."""

    @property
    def state(self) -> State:
        """The present state."""
        return self._history.present

    @property
    def design(self) -> Design:
        """The last good design."""
        return self.state.design

    @property
    def _jobs(self) -> list[ProcessJob[Any]]:
        return [*(run.job for run in self._runs.values()), *self._reports]

    def page(self) -> dict[str, Any]:
        """Values of the whole page."""
        return {key: value for part in self.parts() for key, value in part().items()}

    def parts(self) -> Iterator[Callable[[], dict[str, Any]]]:
        """Values of the page, part after part: what takes no time, then each picture, verdicts and 3D.

        Each part may be found in a thread, before the next is asked for. Pictures are those of the view that is shown,
        once the page is there.
        """
        shown = [name for name, drawing in DRAWINGS.items() if self._opened and drawing.tab == self._look.tab]
        first = {
            **header(self._history),
            **controls(self.state),
            **looked_at(self.state, self._look),
            **{f"{kind}_run": summary(self._runs.get(kind), self.design, self._wrong.get(kind, "")) for kind in KINDS},
            "reporting": next((s.words for job in self._reports if isinstance(s := job.poll(), Progress)), ""),
            "forms": forms(self.state),
            "presets": list(preset_names()),
            "tabs": [{"key": key, "label": label} for key, label in TABS.items()],
            "theme": self._theme,
        }
        if not self._opened:
            first |= dict.fromkeys(map(_key, DRAWINGS), "") | {
                "glance": [],
                "glance_of": "",
                "rays_of": "",
                "lights": awaited_lights(self.design),
                "awaited": awaited(self.design),
                "warmth": "",
                "fixes": [],
                "depth_known": {},
            }
            yield lambda: {**first, "space": self._space.sent}
            return
        yield lambda: first
        source = self._source()
        for name in shown:
            yield partial(self._picture, name, source)
        fixes, in_depth, in_space = self._fixes(), self._look.tab == "depth", self._look.tab == "space"
        yield lambda: {
            "glance": _tried(lambda: glance(source.evaluation), lambda why: []),
            "glance_of": _tried(lambda: source.lens_words("field and light traced"), lambda why: ""),
            "rays_of": _tried(lambda: source.lens_words("traced"), lambda why: ""),
            "awaited": _tried(lambda: awaited(self.design) if source.provisional else "", lambda why: ""),
            "lights": _tried(lambda: shown_lights(source), lambda why: [unknown("Verdicts", why)]),
            "fixes": fixes,
            "warmth": _tried(lambda: warmth(source.evaluation), lambda why: ""),
        }
        yield lambda: {"depth_known": _tried(lambda: depth_known(source), depth_unknown) if in_depth else {}}
        yield lambda: {"space": self._in_space() if in_space else self._space.sent}
        unsaid, self._unsaid = self._unsaid, []
        for design, words in reversed(unsaid):  # of an abandoned pass it may be another design
            if design == self.design.thin_twin:
                self._say(words)
        last = header(self._history)
        yield lambda: last

    def close(self) -> None:
        """End all that runs for this tab."""
        self._later.cancel()
        for job in self._jobs:
            job.cancel()

    async def download(self, name: str) -> _Download | None:
        """The file that is asked for; None where there is no such thing.

        Parameters
        ----------
        name : str
            ``design.toml``, ``report.html``, or a picture's name with ``.svg``.

        Raises
        ------
        DownloadError
            The report cannot be made, or the picture cannot be drawn.
        """
        try:
            return await self._made(name)
        except (*FAULTS, OSError) as error:
            raise DownloadError(cause(error)) from None

    async def _made(self, name: str) -> _Download | None:
        stem = file_stem(self.design)
        if name == "design.toml":
            return _Download(f"{stem}.toml", "application/toml", dumps(self.design, WRITTEN).encode())
        if name == "report.html":
            return _Download(f"{stem}-report.html", "text/html", await self._report())
        drawing = DRAWINGS.get(name.removesuffix(".svg"))
        inputs = drawing.inputs(self._source()) if drawing is not None and name.endswith(".svg") else None
        if drawing is None or inputs is None:
            return None
        picture = drawing.make(*inputs, self._sizes[name.removesuffix(".svg")])
        # On the page the card says so.
        twin = explored_lens(self.design).twin if drawing.tab in ("camera", "depth") else ""
        return _Download(f"{stem}{twin}-{name}", "image/svg+xml", picture.svg_file())

    async def _report(self) -> bytes:
        """Page of the design report, made in a process of its own that ends with the tab."""
        job = ProcessJob(run_report, self.design)
        self._reports.append(job)
        self._later.do("runs", self._look_after_runs, None, TICK, aside=False)
        while isinstance(state := job.poll(), Progress):
            await asyncio.sleep(TICK)
        self._reports.remove(job)
        if isinstance(state, Failure):
            raise DownloadError(state.message)
        return state.result

    def ask(self, name: str, *arguments: Any) -> None:
        """Do what the page asks, one of `requests`; arguments that its method does not take are told, not raised."""
        try:
            ASKED[name](self, *arguments)
        except ValidationError as error:
            place, what = ".".join(map(str, error.errors()[0]["loc"])), error.errors()[0]["msg"]
            self._say(f"the page asked for what cannot be ({name}, argument {place}: {what}); load it again")
        except FAULTS as error:
            self._say(f"That cannot be done: {cause(error)}")

    # Requests: what the page may ask.

    def opened(self, link: str, theme: str, sizes: dict[str, Any]) -> None:
        """The page is there: take the state that its address brings, and its theme and room."""
        self._opened = True
        self.set_theme(theme)
        self.resize(sizes)
        if link:
            self.restore(link)

    def restore(self, link: str) -> None:
        """Take the state that a link brings."""
        try:
            state, self._look = decode(link)
        except LinkError as error:
            self._say(str(error))
        else:
            self._go(state)

    def slide(self, symbol: Symbol, place: FiniteFloat, gesture: str) -> None:
        """Move a slider; all of one gesture is one step back."""
        field = CONTROLS[symbol]
        value = value_at(field, place, reach(field, self.state.reference, self.state.shown_by(symbol)))
        self._go(self.state.set(symbol, value), gesture)

    def write(self, symbol: Symbol, text: str) -> None:
        """Type into a number field."""
        self._go(self.state.edit(symbol, text))

    def choose(self, what: Choice, text: str) -> None:
        """Say what the scene lies in, or what window stands at the tip."""
        self._go(self.state.choose(what, text))

    def follow(self, symbol: str) -> None:
        """Choose which of f, d_1, d_f follows."""
        self._go(self.state.follow(symbol))

    def undo(self) -> None:
        """Undo one step."""
        self._history = self._history.undo()

    def redo(self) -> None:
        """Redo one step."""
        self._history = self._history.redo()

    def load_text(self, name: str, text: str) -> None:
        """Load a design file that the browser read."""
        if len(text) > MOST_TEXT:
            self._say(f"{name}: is too large for a design file")
        else:
            # Whoever wrote it named files of a machine that is not this one.
            self._load(lambda: design_of_text(text, name))

    def load_path(self, path: str) -> None:
        """Load a design that ships, by its name, or a file of the machine that the explorer runs on."""
        self._load(lambda: as_design(path.strip()))

    def fix(self, key: str) -> None:
        """Change what a proposal says."""
        chosen = next((fix for fix in _proposals(self.design) if fix.key == key), None)
        if chosen is None or chosen.why_not:
            return
        try:
            self._go(self.state.change(chosen.changes))
        except DesignError as error:
            self._say(f"{chosen.label}: {error}")

    def dismiss(self) -> None:
        """Take note of the message."""
        self._say("")

    def show(self, tab: str, sizes: dict[str, Any]) -> None:
        """Look at another view, whose pictures have so much room."""
        self.resize(sizes)
        self.look("tab", tab)

    def look(self, at: str, value: Any) -> None:
        """Look at something else: another value of a `Look`'s fields."""
        with contextlib.suppress(ValueError, TypeError):
            self._look = replace(self._look, **{at: value})

    def point(self, picture: str, x: FiniteFloat, y: FiniteFloat, gesture: str) -> None:
        """Click or drag in a picture, at a place in its own pixels."""
        drawn = self._drawn.get(picture, (None, None, ""))[1]
        if drawn is None:
            return
        if picture == "matching-plane":
            # Axes that follow the design would run away under the pointer.
            self._limits = (drawn.mapping.x.high, drawn.mapping.y.high)
        self._place(picture, *drawn.mapping.to_value(x, y), gesture)

    def let_go(self) -> None:
        """A drag in a picture has ended."""
        self._limits = None

    def nudge(self, picture: str, right: FiniteFloat, up: FiniteFloat) -> None:
        """Arrow keys in a picture: by a microlens, or by a hundredth of what the axes show."""
        drawn = self._drawn.get(picture, (None, None, ""))[1]
        if drawn is None:
            return
        design = self.design
        x, y = design.d_3, design.D_F
        across, high = drawn.mapping.x.high / 100, drawn.mapping.y.high / 100
        if picture == "mla-map":
            x, y = place_on_mla(design, self._look.place)
            across = high = design.d
        self._place(picture, x + across * right, y + high * up)

    def resize(self, sizes: dict[str, Any]) -> None:
        """Take note of how much room the pictures have [px]."""
        for name in sizes.keys() & DRAWINGS.keys():
            self._sizes[name] = fitting(sizes[name], self._sizes[name])

    def set_theme(self, theme: str) -> None:
        """Light or dark."""
        self._theme = "dark" if theme == "dark" else "light"

    def space_again(self) -> None:
        """The browser missed a change of the 3D scene: send it whole."""
        self._space.forget()

    def start_run(self, kind: Kind, options: Options) -> None:
        """Start a run in the background; one of the kind that runs already is ended."""
        self.cancel_run(kind)
        try:
            place = [repr(length) for length in self._source().place]
            asked = {**options, "follows": [self.state.follows], "place": place}
            self._runs[kind], self._wrong[kind] = Run.begin(kind, self.design, asked), ""
        except InputError as error:
            self._wrong[kind] = str(error)
        else:
            self._later.do("runs", self._look_after_runs, None, TICK, aside=False)

    def cancel_run(self, kind: Kind) -> None:
        """End a run."""
        if kind in self._runs:
            self._runs[kind].job.cancel()

    def stop_run(self, kind: Kind) -> None:
        """End a run with what is best so far."""
        if kind in self._runs:
            self._runs[kind].job.stop()

    def take_optimum(self) -> None:
        """Go on with the design that was found."""
        run = self._runs.get("optimise")
        if run is not None and run.result is not None and run.result.design is not None:
            self._go(self.state.take(run.result.design))

    # How they do it.

    def _source(self) -> PictureSource:
        design = self.design.thin_twin
        results = {kind: run.result for kind, run in self._runs.items() if run.result is not None}
        # Evaluation of the thin-lens model at once; that of the real lens once it has been traced.
        lens = explored_lens(self.design)
        traced = self._after_a_pause(_traced)[1] if lens.twin else None
        evaluation = partial(lens.evaluation, self.design, self._evaluated, traced)
        return PictureSource(design, self.design, evaluation, self._look, self._limits, results)

    def _fixes(self) -> list[dict[str, str]]:
        """Proposals to mend the design; without their outcome while it is still being changed."""
        fixes, settled = self._after_a_pause(_proposals)
        return [fix.page(settled is not None) for fix in settled or fixes or ()]

    def _after_a_pause(self, find: Callable[[Design], Known]) -> tuple[Known | None, Known | None]:
        """Latest result of a task that takes about a picture's time.

        Also that of the design once it has stood still.
        """
        design, (of, known) = self.design, self._known.get(find, (None, None))
        if of == design:
            return known, known
        self._later.do(find.__name__, lambda: self._known.update({find: (design, find(design))}), design)
        return known, None

    def _look_after_runs(self) -> None:
        if any(isinstance(job.poll(), Progress) for job in self._jobs):
            self._later.do("runs", self._look_after_runs, None, TICK, aside=False)

    def _in_space(self) -> dict[str, Any]:
        design, theme = self.design.thin_twin, self._theme
        try:
            return self._space.parcel(design, theme)
        except FAULTS as error:
            self._unsaid.append((design, f"The instrument in 3D cannot be drawn: {cause(error)}"))
            return self._space.clear(design, theme)

    def _picture(self, name: str, source: PictureSource) -> dict[str, str]:
        """The picture, as it was drawn last where nothing about it has changed; why not where it cannot be drawn."""
        drawing, look = DRAWINGS[name], (self._sizes[name], self._theme)
        before = self._drawn.get(name, (None, None, ""))[0]
        wanted: tuple[Any, ...] = (source.design, source.look, *look)
        try:
            inputs = drawing.inputs(source)
            if inputs is None:
                return {_key(name): ""}
            wanted = (*inputs, *look)
            if wanted != before:
                picture = drawing.make(*wanted[:-1])
                self._drawn[name] = (wanted, picture, picture.svg(look[1]))
        except FAULTS as error:
            if wanted != before:
                words = f"{drawing.label} cannot be drawn: {cause(error)}"
                self._unsaid.append((source.design, words))
                self._drawn[name] = (wanted, None, notice(name, words, look[0]).svg(look[1]))
        return {_key(name): self._drawn[name][2]}

    def _place(self, picture: str, x: float, y: float, gesture: str = "") -> None:
        """Look at a microlens, or move the pupil, to where a picture has it."""
        if picture == "mla-map":
            self._look = replace(self._look, place=on_array(self.design, x, y))
        elif picture == "matching-plane":
            seen, behind = self.design.with_seen_pupil, self.design.aperture.behind is not None
            nearest, farthest = reach(BY_SYMBOL["d_3"], seen, seen)
            x = min(max(x, nearest), -PUPIL_STEP if behind else farthest)
            own = seen.f / (seen.f - x) if behind else 1.0
            pupil = {"d_3": round(own * x, 4), "D_F": round(own * max(y, PUPIL_STEP), 4)}
            with contextlib.suppress(DesignError):
                self._go(self.state.change(pupil), gesture)

    def _go(self, state: State, gesture: str = "") -> None:
        self._history = self._history.record(state, gesture)

    def _say(self, message: str) -> None:
        self._go(replace(self.state, message=message))

    def _load(self, read: Callable[[], Design]) -> None:
        try:
            self._go(State.of(read()))
        except DesignError as error:
            self._say(str(error))


def _key(name: str) -> str:
    """Name of a drawing's value on the page."""
    return f"picture_{name.replace('-', '_')}"


def _tried(find: Callable[[], Known], otherwise: Callable[[str], Known]) -> Known:
    """Result of a task or, where it fails, a stand-in made from the cause: one fault leaves the rest of the page."""
    try:
        return find()
    except FAULTS as error:
        return otherwise(cause(error))


def _traced(design: Design) -> Evaluation | Exception:
    """Evaluation of a design, its lens traced where it is real; or why there is none."""
    try:
        return evaluate(design)
    except FAULTS as error:
        return error


def _proposals(design: Design) -> tuple[Fix, ...]:
    """Proposals to mend a design."""
    return _tried(lambda: proposals(design), lambda why: (Fix("none", "No proposals", why_not=why),))


ASKED = {name: validate_call(getattr(Session, name)) for name in Session.requests}
"""The requests by their names, with arguments checked: they come from outside."""


class _Space:
    """The 3D view: what of the scene the browser does not have yet; each parcel says which one it builds on."""

    def __init__(self) -> None:
        self._subject: tuple[Design, ThemeName] | None = None
        self._meshes: dict[str, BrowserMesh] = {}
        self._serial = 0
        self.sent: dict[str, Any] = {}
        """The last parcel."""

    def parcel(self, design: Design, theme: ThemeName) -> dict[str, Any]:
        """The meshes that have changed, None for those that are gone; the last parcel where nothing has."""
        if self._subject == (design, theme):
            return self.sent
        now = scene(design, theme)
        return self._send((design, theme), now.meshes, {"camera": now.camera, "ground": now.ground})

    def clear(self, design: Design, theme: ThemeName) -> dict[str, Any]:
        """Nothing, in the place of a scene that cannot be drawn."""
        known = self._subject == (design, theme) or not self.sent
        return self.sent if known else self._send((design, theme), {}, {})

    def _send(
        self, subject: tuple[Design, ThemeName], meshes: dict[str, BrowserMesh], view: dict[str, Any]
    ) -> dict[str, Any]:
        since = self._serial if self._subject is not None else 0
        parts = {name: mesh and mesh._asdict() for name, mesh in changed(self._meshes, meshes).items()}
        self._serial += 1
        self._subject, self._meshes = subject, meshes
        self.sent = {**self.sent, **view, "serial": self._serial, "since": since, "meshes": parts}
        return self.sent

    def forget(self) -> None:
        """Send everything next time."""
        self._subject, self._meshes = None, {}
