"""What one tab does: requests of the page in, the page's values out. Holds the tab's history; draws what is seen."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from ..design import Design, DesignError, load, loads, preset_names
from ..errors import InputError
from ..evaluation import Evaluation, evaluate
from . import state as states
from .drawing import DRAWINGS, Seen, Size, fitting
from .fields import BY_SYMBOL, reach, value_at
from .fixes import Fix, proposals
from .history import History, record, redo, undo
from .jobs import Progress
from .later import Later
from .link import TABS, WHOLE, LinkError, Look, decode
from .pictures.axes import Picture
from .pictures.theme import ThemeName
from .places import on_array, place_on_mla, read_place
from .runs import KINDS, Kind, Options, Run, begin, forms, kind_of, told
from .space import Space
from .state import State
from .view import controls, glance, header, looked_at, proposed, verdicts

TICK = 0.25
"""How often a run is asked how far it is [s]."""

TRACING = {
    "name": "tracing",
    "level": "wait",
    "word": "not yet known",
    "title": "real lens",
    "margin": "tracing ...",
    "text": "The verdicts are those of the thin twin; rays are being traced through the real lens.",
    "plain": "tracing rays through the real lens",
    "remedy": "",
}
"""Stands among the lights until the lens has been traced."""

MOST_TEXT = 1_000_000
"""Largest design file that is taken [characters]."""


class Session:
    """The state of one tab, and the requests that change it.

    Parameters
    ----------
    design : Design
        What it opens with, unless the address brings a state of its own.
    """

    requests = (
        *("opened", "restore", "slide", "write", "follow", "undo", "redo", "preset", "load_text", "load_path", "fix"),
        *("dismiss", "show_tab", "choose", "point", "let_go", "nudge", "switch", "resize", "set_theme", "space_again"),
        *("show_whole", "start_run", "cancel_run", "take_optimum"),
    )
    """Methods that the page may call."""

    def __init__(self, design: Design) -> None:
        self._history = History(states.start(design))
        self._look = Look()
        self._theme: ThemeName = "light"
        self._sizes: dict[str, Size] = {name: drawing.size for name, drawing in DRAWINGS.items()}
        self._opened = False
        self._limits: tuple[float, float] | None = None
        self._traced: tuple[Design, Evaluation] | None = None
        self._runs: dict[Kind, Run | None] = dict.fromkeys(KINDS)
        self._wrong: dict[Kind, str] = dict.fromkeys(KINDS, "")
        self._space = Space()
        self._proposed: tuple[Design, tuple[Fix, ...]] | None = None
        self._later = Later(lambda: self.on_news())
        self._last = Seen(design.thin_twin, self._look)
        self._drawn: dict[str, tuple[Any, Picture | None]] = {}
        self._children: set[asyncio.subprocess.Process] = set()
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

    def page(self) -> dict[str, Any]:
        """Values of the whole page; pictures only of the view that is shown, once the page is there."""
        shown = [name for name, drawing in DRAWINGS.items() if self._opened and drawing.tab == self._look.tab]
        return {
            **({} if self._opened else {_key(name): "" for name in DRAWINGS}),
            **{_key(name): self._draw(name) for name in shown},
            **header(self._history),
            **controls(self.state),
            **looked_at(self.state, self._look),
            "glance": glance(self._seen().evaluation) if self._opened else [],
            "lights": self._lights() if self._opened else [],
            "fixes": self._fixes() if self._opened else [],
            "space": self._in_space(),
            **{f"{kind}_run": told(self._runs[kind], self.design, self._wrong[kind]) for kind in KINDS},
            "forms": forms(self.design),
            "presets": list(preset_names()),
            "tabs": [{"key": key, "label": label} for key, label in TABS.items()],
            "theme": self._theme,
        }

    def picture(self, name: str, theme: ThemeName) -> str | None:
        """A picture as a file of its own; None where there is none of that name."""
        drawing = DRAWINGS.get(name)
        if drawing is None:
            return None
        inputs = drawing.inputs(self._seen())
        return None if inputs is None else drawing.make(inputs, theme, self._sizes[name]).svg

    def close(self) -> None:
        """End all that runs for this tab."""
        self._later.cancel()
        for run in self._runs.values():
            if run is not None:
                run.job.cancel()
        for process in self._children:
            with contextlib.suppress(ProcessLookupError):
                process.kill()

    @contextlib.contextmanager
    def owning(self, process: asyncio.subprocess.Process) -> Iterator[None]:
        """Let a process end with the tab."""
        self._children.add(process)
        try:
            yield
        finally:
            self._children.discard(process)
            if process.returncode is None:
                process.kill()

    # Requests: what the page may ask.

    def restore(self, link: str) -> None:
        """Take the state that a link brings."""
        try:
            state, self._look = decode(link)
        except LinkError as error:
            self._tell(str(error))
        else:
            self._go(state)

    def opened(self, link: str, theme: str, sizes: dict[str, Sequence[float]]) -> None:
        """The page is there: take the state that its address brings, and its theme and room."""
        self._opened = True
        self.set_theme(theme)
        self.resize(sizes)
        if link:
            self.restore(link)

    def slide(self, symbol: str, place: float, gesture: str) -> None:
        """Move a slider; all of one gesture is one step back."""
        field = BY_SYMBOL[symbol]
        value = value_at(field, float(place), reach(field, self.state.reference, self.design))
        self._go(states.set_value(self.state, symbol, value), gesture)

    def write(self, symbol: str, text: str) -> None:
        """Type into a number field."""
        self._go(states.edit(self.state, symbol, str(text)))

    def follow(self, symbol: str) -> None:
        """Choose which of f, d_1, d_f follows."""
        self._go(states.follow(self.state, symbol))

    def undo(self) -> None:
        """One step back."""
        self._history = undo(self._history)

    def redo(self) -> None:
        """One step forward again."""
        self._history = redo(self._history)

    def preset(self, name: str) -> None:
        """Load a design that ships."""
        if name in preset_names():
            self._load(lambda: load(name))

    def load_text(self, name: str, text: str) -> None:
        """Load a design file that the browser read."""
        if len(text) > MOST_TEXT:
            self._tell(f"{name}: is too large for a design file")
        else:
            self._load(lambda: loads(text, name))

    def load_path(self, path: str) -> None:
        """Load a design file of the machine that the explorer runs on."""
        self._load(lambda: load(path.strip()))

    def fix(self, key: str) -> None:
        """Change what a proposal says."""
        chosen = next((fix for fix in self._propose() if fix.key == key), None)
        if chosen is None or chosen.why_not:
            return
        try:
            self._go(states.change(self.state, chosen.changes))
        except DesignError as error:
            self._tell(f"{chosen.label}: {error}")

    def dismiss(self) -> None:
        """Take note of the message."""
        self._tell("")

    def show_tab(self, tab: str) -> None:
        """Turn to another tab of the page."""
        if tab in TABS:
            self._look = replace(self._look, tab=tab)

    def choose(self, place: Any) -> None:
        """Look at another microlens."""
        self._look = replace(self._look, place=read_place(place))

    def point(self, picture: str, x: float, y: float, gesture: str) -> None:
        """Click or drag in a picture, at a place in its own pixels."""
        drawn = self._drawn.get(picture, (None, None))[1]
        if drawn is None or drawn.mapping is None:
            return
        if picture == "mla-map":
            self._look = replace(self._look, place=on_array(self.design, *drawn.mapping.to_value(float(x), float(y))))
        elif picture == "matching-plane":
            # Axes that follow the design would run away under the pointer.
            self._limits = (drawn.mapping.x1, drawn.mapping.y1)
            self._move_pupil(*drawn.mapping.to_value(float(x), float(y)), gesture)

    def let_go(self) -> None:
        """A drag in a picture has ended."""
        self._limits = None

    def nudge(self, picture: str, right: float, up: float) -> None:
        """Arrow keys in a picture: by a microlens, or by a hundredth of what the axes show."""
        drawn = self._drawn.get(picture, (None, None))[1]
        if drawn is None or drawn.mapping is None:
            return
        if picture == "mla-map":
            x, y = place_on_mla(self.design, self._look.place)
            step = self.design.d
            self._look = replace(self._look, place=on_array(self.design, x + step * right, y + step * up))
        elif picture == "matching-plane":
            across, high = (drawn.mapping.x1 / 100, drawn.mapping.y1 / 100)
            self._move_pupil(self.design.d_3 + across * right, self.design.D_F + high * up, "")

    def show_whole(self, whole: str) -> None:
        """How much the meridional section shows: the object plane too, the instrument alone, or what suits."""
        if whole in WHOLE:
            self._look = replace(self._look, whole=whole)

    def switch(self, what: str, on: bool) -> None:
        """Diffraction or pixels, on or off."""
        if what == "diffraction":
            self._look = replace(self._look, diffraction=bool(on))
        elif what == "pixels":
            self._look = replace(self._look, pixels=bool(on))

    def resize(self, sizes: dict[str, Sequence[float]]) -> None:
        """Take note of how much room the pictures have [px]."""
        for name in sizes.keys() & DRAWINGS.keys():
            self._sizes[name] = fitting(sizes[name], self._sizes[name])

    def space_again(self) -> None:
        """The browser missed a change of the 3D scene: send it whole."""
        self._space.forget()

    def start_run(self, kind: str, options: Options) -> None:
        """Start a tolerance or optimisation run in the background; one that runs already is ended."""
        chosen = kind_of(kind)
        self.cancel_run(kind)
        try:
            self._runs[chosen], self._wrong[chosen] = begin(chosen, self.design, options), ""
        except InputError as error:
            self._wrong[chosen] = str(error)
        else:
            self._later.do("runs", self._look_after_runs, None, TICK)

    def cancel_run(self, kind: str) -> None:
        """End a run."""
        run = self._runs[kind_of(kind)]
        if run is not None:
            run.job.cancel()

    def take_optimum(self) -> None:
        """Go on with the design that was found."""
        run = self._runs["optimise"]
        if run is not None and run.result is not None and run.result.design is not None:
            found = run.result.design
            self._go(replace(self.state, design=found, faults=(), message=""))

    def set_theme(self, theme: str) -> None:
        """Light or dark."""
        self._theme = "dark" if theme == "dark" else "light"

    # How they do it.

    def _lights(self) -> list[dict[str, str]]:
        """Verdicts of the thin twin at once; those of the real lens once it has been traced."""
        if self.design.main_lens.prescription is None:
            return verdicts(self._seen().evaluation)
        if self._traced is not None and self._traced[0] == self.design:
            return verdicts(self._traced[1])
        self._later.do("trace", self._trace, self.design)
        return [*verdicts(self._seen().evaluation), TRACING]

    def _trace(self) -> None:
        # In the loop, not in a thread: compiled kernels may not be entered by two threads at once.
        self._traced = (self.design, evaluate(self.design))

    def _fixes(self) -> list[dict[str, str]]:
        """What would mend the design; with nothing promised while it is still being changed."""
        if self._proposed is not None and self._proposed[0] == self.design:
            return proposed(self._proposed[1])
        self._later.do("fixes", self._propose, self.design)
        return [
            {**fix, "outcome": "", "why_not": ""}
            for fix in proposed(() if self._proposed is None else self._proposed[1])
        ]

    def _propose(self) -> tuple[Fix, ...]:
        fixes = proposals(self.design)
        self._proposed = (self.design, fixes)
        return fixes

    def _look_after_runs(self) -> None:
        if any(run is not None and isinstance(run.job.poll(), Progress) for run in self._runs.values()):
            self._later.do("runs", self._look_after_runs, None, TICK)

    def _in_space(self) -> dict[str, Any]:
        shown = self._opened and self._look.tab == "space"
        return self._space.parcel(self.design.thin_twin, self._theme) if shown else self._space.sent

    def _seen(self) -> Seen:
        design = self.design.thin_twin
        fresh = Seen(design, self._look, self._limits, self._found("tolerance"), self._found("optimise"))
        if fresh != self._last:
            if self._last.design == design and "evaluation" in vars(self._last):
                vars(fresh)["evaluation"] = self._last.evaluation
            self._last = fresh
        return self._last

    def _found(self, kind: Kind) -> Any:
        run = self._runs[kind]
        return None if run is None else run.result

    def _move_pupil(self, distance: float, diameter: float, gesture: str) -> None:
        ends = {symbol: reach(BY_SYMBOL[symbol], self.design, self.design) for symbol in ("d_3", "D_F")}
        distance = min(max(distance, 0.0), ends["d_3"][1])
        diameter = max(diameter, 1e-3)
        with contextlib.suppress(DesignError):
            moved = states.change(self.state, {"d_3": round(distance, 4), "D_F": round(diameter, 4)})
            self._go(moved, gesture)

    def _go(self, state: State, gesture: str = "") -> None:
        self._history = record(self._history, state, gesture)

    def _tell(self, message: str) -> None:
        self._go(replace(self.state, message=message))

    def _load(self, read: Callable[[], Design]) -> None:
        try:
            self._go(states.start(read()))
        except DesignError as error:
            self._tell(str(error))

    def _draw(self, name: str) -> str:
        """The picture as it was drawn last where nothing about it has changed, or where it cannot be drawn."""
        drawing = DRAWINGS[name]
        inputs = drawing.inputs(self._seen())
        if inputs is None:
            return ""
        wanted = (inputs, self._theme, self._sizes[name])
        before, picture = self._drawn.get(name, (None, None))
        if wanted != before:
            try:
                picture = drawing.make(*wanted)
            except (ValueError, ArithmeticError, MemoryError) as error:
                # Some designs that can be written down cannot be drawn: a pitch wider than the array.
                self._tell(f"{drawing.label} cannot be drawn: {error}")
            self._drawn[name] = (wanted, picture)
        return "" if picture is None else picture.svg


def _key(picture: str) -> str:
    return f"picture_{picture.replace('-', '_')}"
