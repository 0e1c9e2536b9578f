"""Parts of the documentation that the code writes: key tables, commands, quantities, effects, API pages, figures."""

from __future__ import annotations

import importlib
import pkgutil
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from figures import FIGURES
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.display import status_iterator
from tables import code, keys_table, markdown, plain, results_table

import roslf_design as roslf
from roslf_design.cli import COMMANDS, build_app
from roslf_design.effects import EFFECTS
from roslf_design.reporting.keys import FILES
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerancing.metrics import METRICS
from roslf_design.tolerancing.places import load_grades
from studies.instruments.gallery import misses, summary, written

HERE = Path(__file__).resolve().parent.parent

KEYS = tomllib.loads((HERE / "_ext" / "keys.toml").read_text())
"""What to say of keys that the code leaves undescribed."""


def file(name: str, about: bool = True) -> Callable[[], str]:
    """Every table of a file: with `about`, what its model says of itself above its keys."""

    def made() -> str:
        parts = (
            f"### {one.heading}\n\n{plain(one.about) if about else ''}\n\n{keys_table(one)}" for one in FILES[name]
        )
        return "\n".join(parts)

    return made


def quantities() -> str:
    """Every number that studies know: as a metric of tolerances, as a goal or limit of an optimisation, as both."""
    goals = {"never": "yes", "optional": "yes, also `at`", "needed": "needs `at`"}
    metrics = {id(quantity) for quantity in METRICS.values()}
    every = {id(quantity): quantity for quantity in (*QUANTITIES.values(), *METRICS.values())}
    rows = []
    for key, q in every.items():
        metric = "" if key not in metrics else "camera" if q.local is None else "each field"
        rows.append((code(q.name), q.unit, metric, goals[q.at] if q.of else "", q.equation, plain(q.words)))
    return markdown(("quantity", "unit", "metric of", "goal", "paper", "meaning"), rows)


def evaluation_json() -> str:
    """The JSON of `roslf evaluate`."""
    return results_table(roslf.evaluate("rigid-scope"), KEYS["evaluation"])


def effects() -> str:
    """Every effect."""
    rows = []
    for effect in EFFECTS:
        about = (effect.estimate.__doc__ or "").strip().split("\n\n")[0]
        switch = "always" if effect.always else "by its size"
        rows.append((f"{plain(effect.title)} {code(effect.name)}", effect.unit, switch, plain(" ".join(about.split()))))
    return markdown(("effect", "unit", "drawn", "size"), rows)


def grades() -> str:
    """The grades that ship."""
    found = load_grades()
    rows = [(code(line.place), *line.tolerances, plain(line.provenance)) for line in found.lines]
    meanings = "\n".join(f"- {n}: {m}" for n, m in zip(found.names, found.meanings, strict=True))
    return f"{meanings}\n\n{markdown(('place', *found.names, 'where from'), rows)}"


def presets() -> str:
    """The designs that ship."""
    rows = [(code(n), plain(roslf.load(n).name), plain(roslf.load(n).source)) for n in roslf.preset_names()]
    return markdown(("preset", "what it is", "source"), rows)


def errors() -> str:
    """What readers say of typical faults, from the readers themselves."""
    text = roslf.dumps(roslf.load("paper"))
    changes = (
        ("a number without a unit", 'diameter = "50.8 mm"', "diameter = 50.8"),
        ("an unknown unit", 'diameter = "50.8 mm"', 'diameter = "50.8 mn"'),
        ("an angle for a length", 'diameter = "50.8 mm"', 'diameter = "2 mrad"'),
        ("a size of zero", 'diameter = "50.8 mm"', 'diameter = "0 mm"'),
        ("a key that is not known", "focal_plane", "focal_plain"),
        ("a key that is missing", 'pixel = "4.847826 um"\n', ""),
        ("lengths f, d_f and d_1 that contradict each other", 'focal_plane = "350 mm"', 'focal_plane = "300 mm"'),
        ("a focal plane within f", 'focal_plane = "350 mm"', 'focal_plane = "90 mm"'),
        ("the object inside the bore", 'distance = "120 mm"', 'distance = "400 mm"'),
        ("a word that is not known", "[sensor]", 'layout = "round"\n\n[sensor]'),
        ("text that is no TOML", "[sensor]", "[sensor"),
    )
    found = []
    for what, old, new in changes:
        if old not in text:
            raise ValueError(f"the example of {what} no longer fits: no {old!r} in the file")
        changed = text.replace("\n[light]", "") if what.startswith("a word") else text
        try:
            roslf.loads(changed.replace(old, new, 1), origin="my.toml")
        except roslf.DesignError as error:
            found.append((what, str(error)))
        else:
            raise ValueError(f"{what} is not refused")
    return "\n".join(f"**{what[0].upper()}{what[1:]}**\n\n```text\n{said}\n```\n" for what, said in found)


def commands() -> str:
    """The command line's own help."""
    app = build_app()
    parts = []
    for name in sorted(COMMANDS):
        text = app[name].generate_docs(
            output_format="markdown", recursive=True, heading_level=2, usage_name=f"roslf {name}"
        )
        text = re.sub(r"^## Table of Contents\n.*?(?=^\*\*|^#)", "", text, flags=re.M | re.S)
        text = re.sub(r"^\*\*Commands\*\*:\n\n(\* .*\n)+", "", text, flags=re.M)
        text = "\n".join(_headed(name, line) for line in text.splitlines())
        text = re.sub(r"^roslf (\S+ \S+) -m \w+ ", r"roslf \1 ", text, flags=re.M)
        example = f"\nExample:\n\n```sh\n{COMMANDS[name].example}\n```\n"
        head, _, rest = text.partition("\n### ")
        parts.append(head.rstrip() + "\n" + example + ("\n### " + rest if rest else ""))
    return "\n".join(parts)


def _headed(name: str, line: str) -> str:
    """A heading with the whole of its command; other lines as they are."""
    found = re.fullmatch(r"(#+) (?:roslf )?(.+)", line)
    if found is None:
        return line
    words = found[2].split()
    whole = ["roslf", *(words if words[:1] == [name] else [name, *words])]
    return f"{found[1]} {code(' '.join(whole))}"


def instruments() -> str:
    """The gallery, a line for each instrument."""
    rows = written()
    heads, lines = summary(rows)
    beyond = "\n".join(f"- {plain(item)}" for item in misses(rows).items)
    table = markdown(heads, [tuple(map(plain, line)) for line in lines])
    return f"{table}\n\nThose beyond a factor of two:\n\n{beyond}\n"


PARTS: dict[str, Callable[[], str]] = {
    "design-file": file("design", about=False),
    "scene-file": file("scene"),
    "tolerance-study": file("tolerance"),
    "optimise-study": file("optimize"),
    "story-file": file("story", about=False),
    "catalogue-file": file("catalogue"),
    "bench-file": file("bench"),
    "distances-file": file("distances"),
    "lens-file": file("lens"),
    "quantities": quantities,
    "evaluation-json": evaluation_json,
    "effects": effects,
    "grades": grades,
    "presets": presets,
    "errors": errors,
    "commands": commands,
    "instruments": instruments,
}
"""Files of `_generated`, each by the function that writes it."""

INSIDE = ("commands", "explorer")
"""Packages that have pages of their own, or none: nobody imports them."""
WHOLE = ("roslf_design.theory", "roslf_design.design", "roslf_design.camera")
"""Packages whose modules are shown whole though the package lists names."""


def packages() -> list[str]:
    """The package itself, then its rooms."""
    rooms = (i.name for i in pkgutil.iter_modules(roslf.__path__) if i.ispkg and i.name not in INSIDE)
    return ["roslf_design", *(f"roslf_design.{room}" for room in rooms)]


def api_pages() -> Iterator[tuple[str, str]]:
    """One page a package: its docstring, then its modules."""
    rows = []
    for name in packages():
        package = importlib.import_module(name)
        about = (package.__doc__ or "").strip().split("\n\n")[0].replace("\n", " ")
        rows.append(f"* - :doc:`{name}`\n  - {about}")
        yield f"{name}.rst", _api_page(package)
    listed = "\n".join("   " + line for row in rows for line in row.splitlines())
    toctree = "\n".join(f"   {name}" for name in packages())
    yield (
        "index.rst",
        "API\n===\n\nEach package with its public modules, from their docstrings. Names that a package lists at its "
        "top are for use; all else may change.\n\n.. list-table::\n   :widths: 35 65\n\n"
        f"{listed}\n\n.. toctree::\n   :hidden:\n\n{toctree}\n",
    )


def _api_page(package: ModuleType) -> str:
    name = package.__name__
    page = [name, "=" * len(name), "", f".. automodule:: {name}", "   :no-members:", ""]
    public = {item: _home(package, item) for item in getattr(package, "__all__", ())}
    listed = [f":py:obj:`{item} <{home}>`" for item, home in public.items() if home]
    if listed:
        page += [f"**Names:** {', '.join(listed)}", ""]
    if name == "roslf_design":
        return "\n".join(page)
    if name in WHOLE or not public:
        shown = {module: _own(module) for module in _modules(package)}
    else:
        homes = sorted(home for home in public.values() if home.startswith(name + "."))
        shown = {}
        for home in homes:
            shown.setdefault(home.rpartition(".")[0], []).append(home.rpartition(".")[2])
    for module, items in shown.items():
        short = module.removeprefix(name + ".")
        page += [short, "-" * len(short), "", f".. automodule:: {module}", f"   :members: {', '.join(items)}", ""]
    return "\n".join(page)


def _home(package: ModuleType, item: str) -> str:
    """Full name of where something is written; that of the package for plain values, "" for the version."""
    module = getattr(getattr(package, item), "__module__", None)
    if isinstance(module, str) and module.startswith("roslf_design"):
        return f"{module}.{item}"
    for candidate in (package.__name__, *_modules(package)):
        if ("", item) in ModuleAnalyzer.for_module(candidate).find_attr_docs():
            return f"{candidate}.{item}"
    return ""


def _own(module: str) -> list[str]:
    """Public names that a module itself defines, in the order of its text."""
    loaded = importlib.import_module(module)
    analyzer = ModuleAnalyzer.for_module(module)
    analyzer.analyze()
    values = {name for owner, name in analyzer.attr_docs if not owner}
    order = sorted(analyzer.tagorder, key=analyzer.tagorder.__getitem__)
    own = [n for n in order if "." not in n and not n.startswith("_")]
    return [n for n in own if n in values or getattr(getattr(loaded, n, None), "__module__", None) == module]


def _modules(package: ModuleType) -> Iterator[str]:
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        short = info.name.removeprefix(package.__name__ + ".")
        hidden = any(part.startswith("_") for part in short.split("."))
        if not hidden and "kernel" not in short and package.__name__ != "roslf_design":
            yield info.name


def write_all(app: Sphinx) -> None:
    """Write what has changed, and nothing else: an unchanged page is then not built again."""
    generated, api = HERE / "_generated", HERE / "api"
    for name, make in _shown(app, "writing tables... ", PARTS):
        write(generated / f"{name}.md", make())
    for name, text in api_pages():
        write(api / name, text)
    for name, draw in _shown(app, "drawing figures... ", FIGURES):
        write(generated / f"{name}.svg", draw().svg_file().decode())


def _shown(app: Sphinx, what: str, makers: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Names with what makes them, one after the other, with how far that is."""
    return status_iterator(makers.items(), what, "brown", len(makers), app.verbosity, lambda item: item[0])


def write(path: Path, text: str) -> None:
    """Write a file unless it already says so."""
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def setup(app: Sphinx) -> dict[str, Any]:
    """Before Sphinx looks for pages."""
    app.connect("builder-inited", write_all)
    return {"parallel_read_safe": True}
