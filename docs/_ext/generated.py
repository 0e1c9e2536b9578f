"""Parts of the documentation that the code writes: key tables, commands, catalogue of effects, API pages, figures."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from figures import FIGURES
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from tables import code, keys_table, markdown, plain, results_table

HERE = Path(__file__).resolve().parent.parent

PACKAGES = {
    "roslf_design": "the names most work begins with",
    "roslf_design.theory": "closed forms, Eqs. 1-12 and beyond, on numbers and arrays",
    "roslf_design.design": "designs, units, files, batches",
    "roslf_design.rays": "backward and forward rays with their fates; ray budgets",
    "roslf_design.shapes": "shapes of microlens images, exact pixel coverage",
    "roslf_design.lenses": "real main lenses: prescriptions, exact trace",
    "roslf_design.effects": "sizes of effects, and the plan that switches them",
    "roslf_design.scenes": "what is looked at",
    "roslf_design.imaging": "raw light-field images",
    "roslf_design.evaluation": "everything that `roslf evaluate` says",
    "roslf_design.tolerancing": "Monte Carlo, sensitivities, yield",
    "roslf_design.optimization": "problems, solvers, conflicts, parts",
    "roslf_design.calibration": "from raw images to lengths with intervals",
    "roslf_design.accuracy": "what numbers can be trusted to, and at what cost",
    "roslf_design.reporting": "content, figures, HTML and PDF",
}


def design_file() -> str:
    """Every table of a design file."""
    from roslf_design.design import Design, Light, MainLens, MicrolensArray, Sensor, Stop

    lens = {
        "prescription": PRESCRIPTION,
        "diameter": "D, clear aperture. With a prescription it may be left out, and is then the lens's own; a smaller "
        "one is a stop at the lens.",
        "tilt": TILT,
    }
    whole = {
        "main_lens": "Table `[main_lens]`.",
        "aperture": "Table `[aperture]`: the flexible angular plane (FAP), the system's entrance pupil.",
        "stops": "Tables `[[stops]]`: further rims of a real bore.",
        "microlens_array": "Table `[microlens_array]`.",
        "sensor": "Table `[sensor]`.",
        "light": "Table `[light]`.",
    }
    tables = (
        ("the file", Design, whole),
        ("[main_lens]", MainLens, lens),
        ("[aperture]", Stop, {"tilt": TILT}),
        (
            "[[stops]]",
            Stop,
            {"diameter": "Of the rim [mm].", "distance": "In front of the main lens [mm].", "tilt": TILT},
        ),
        ("[microlens_array]", MicrolensArray, {"tilt": TILT}),
        ("[sensor]", Sensor, {"tilt": TILT}),
        ("[light]", Light, {}),
    )
    return "\n".join(
        f"### {code(head) if '[' in head else 'The file'}\n\n{keys_table(model, own)}" for head, model, own in tables
    )


TILT = "Of the part's normal from z: by the first about x, then by the second about y [rad]."
PRESCRIPTION = (
    'A real lens: the name of one that ships (`"LA1050-A"`), a lens file (`.toml` or `.zmx`, relative to the design '
    "file), or the lens as a table with a lens file's keys. Left out: the ideal thin lens."
)


def scene_file() -> str:
    """Every table of a scene file."""
    from roslf_design.scenes.objects import OBJECTS, TEXTURES
    from roslf_design.scenes.scene import Scene, SceneLight

    own = {"objects": "Tables `[[objects]]`, each with its `kind`; at least one.", "light": "Table `[light]`."}
    parts = [f"### The file\n\n{keys_table(Scene, own)}", f"### `[light]`\n\n{keys_table(SceneLight)}"]
    parts += [f'### `[[objects]]`, kind "{n}"\n\n{_about(m)}\n\n{keys_table(m)}' for n, m in OBJECTS.items()]
    parts += [f'### `texture`, kind "{name}"\n\n{_about(m)}\n\n{keys_table(m)}' for name, m in TEXTURES.items()]
    return "\n".join(parts)


def _about(kind: type) -> str:
    return plain(" ".join((kind.__doc__ or "").split()))


def tolerance_study() -> str:
    """Every table of a tolerance study, and its metrics."""
    from roslf_design.tolerancing.metrics import METRICS
    from roslf_design.tolerancing.study import Compensate, Group, MetricGoal, Perturb, Study

    own: dict[type, dict[str, str]] = {
        Study: {
            "name": "Of the study.",
            "distribution": "Of builds inside their tolerance, where a line does not say.",
            "truncate": 'Of "normal": the tolerance in sigmas.',
            "trials": "How many builds.",
            "seed": "The same seed gives the same bytes.",
            "sampling": "How trials are drawn: independently, or by a scrambled Sobol sequence.",
            "perturb": "Tables `[[perturb]]`.",
            "groups": "Tables `[[groups]]`.",
            "goals": "Tables `[[goals]]`; at least one.",
            "compensators": "Tables `[[compensators]]`.",
            "quantiles": "Of each metric, to be told.",
            "fields": 'Microlens positions on the array: `"centre"`, `"edge"`, `"corner"`, or `["2 mm", "0 mm"]`.',
        },
        Perturb: {"distribution": "Instead of the study's."},
        Group: {"name": "As `[[perturb]]` calls it."},
        MetricGoal: {"metric": "One of the metrics below.", "min": "In the unit of the metric's name."},
        Compensate: {"place": 'A place of the design, or `"calibration"` of the decoder.'},
    }
    heads = ("The file", Study), ("`[[perturb]]`", Perturb), ("`[[groups]]`", Group), ("`[[goals]]`", MetricGoal)
    parts = [
        f"### {head}\n\n{plain(_first(kind))}\n\n{keys_table(kind, own[kind])}"
        for head, kind in (*heads, ("`[[compensators]]`", Compensate))
    ]
    rows = [
        (code(m.name), m.unit, "camera" if m.local is None else "each field", plain(m.words)) for m in METRICS.values()
    ]
    return "\n".join([*parts, "### Metrics\n\n" + markdown(("metric", "unit", "one for", "meaning"), rows)])


def _first(kind: type) -> str:
    return " ".join((kind.__doc__ or "").split("\n\n")[0].split())


def optimise_study() -> str:
    """Every table of an optimise study, and its quantities."""
    from roslf_design.optimization import study as tables
    from roslf_design.theory.quantities import QUANTITIES

    limits = {"min": "Text with a unit for lengths, else a number.", "max": "The same.", "quantity": QUANTITY}
    own: dict[str, tuple[type, dict[str, str]]] = {
        "The file": (
            tables.StudyTable,
            {
                "name": "Of the study.",
                "question": "What it asks, for the report.",
                "design": "Design file, relative to the study, or a preset: what does not vary, and where to start.",
                "wavelength": "Instead of the design's.",
                "seed": "The same seed gives the same bytes.",
                "order": "All goals at once by their weights, or one after the other.",
                "variables": "Table `[variables]`: a symbol or dotted place to its bounds.",
                "constraints": "Tables `[[constraints]]`.",
                "goals": "Tables `[[goals]]`; at least one.",
                "bore": "Table `[bore]`.",
                "solver": "Table `[solver]`.",
                "pareto": "Table `[pareto]`.",
                "catalogue": "Table `[catalogue]`.",
                "robust": "Table `[robust]`.",
            },
        ),
        "`[variables]`, each": (tables.VariableTable, {"min": "Lower bound.", "max": "Upper bound."}),
        "`[[constraints]]`": (tables.ConstraintTable, limits),
        "`[[goals]]`": (
            tables.GoalTable,
            {
                "quantity": QUANTITY,
                "direction": '`"min"` or `"max"`; needed.',
                "at": "Ahead of the bore's tip.",
                "weight": "Against the other goals.",
            },
        ),
        "`[bore]`": (tables.BoreTable, {"tube": "Table `[bore.tube]`.", "stops": "Tables `[[bore.stops]]`."}),
        "`[bore.tube]`": (
            tables.TubeTable,
            {"diameter": "Inner.", "length": "Of the tube.", "distance": "Of its near end from the main lens."},
        ),
        "`[[bore.stops]]`": (tables.StopTable, {"diameter": "Of the rim.", "distance": "From the main lens."}),
        "`[solver]`": (
            tables.SolverTable,
            {
                "starts": "Searches, from Sobol points.",
                "evaluations": "At most, of each search.",
                "seconds": "At most, of the whole.",
                "isres": "Whether ISRES looks as well.",
            },
        ),
        "`[pareto]`": (tables.ParetoTable, {}),
        "`[catalogue]`": (
            tables.CatalogueTable,
            {"kinds": "Which parts are chosen.", "keep": "How many of the best combinations are told."},
        ),
        "`[robust]`": (
            tables.RobustTable,
            {
                "quantile": 'Of "quantile".',
                "wanted_yield": 'Of "quantile".',
                "trials": "Builds that the search sees.",
                "perturb": "Tables `[[robust.perturb]]`; at least one.",
            },
        ),
        "`[[robust.perturb]]`": (
            tables.PerturbTable,
            {
                "place": "Symbols or dotted places.",
                "tolerance": 'Half-width: "5 um", "0.2 %".',
                "distribution": "Of builds inside their tolerance.",
                "truncate": 'Of "normal": the tolerance in sigmas.',
            },
        ),
    }
    parts = [f"### {head}\n\n{plain(_first(kind))}\n\n{keys_table(kind, told)}" for head, (kind, told) in own.items()]
    rows = [
        (code(q.name), q.unit, {"never": "", "optional": "may", "needed": "must"}[q.at], plain(q.words))
        for q in QUANTITIES.values()
        if q.of is not None
    ]
    return "\n".join([*parts, "### Quantities\n\n" + markdown(("quantity", "unit", "has `at`", "meaning"), rows)])


QUANTITY = "One of the quantities below."


def evaluation_json() -> str:
    """The JSON of `roslf evaluate`."""
    from roslf_design.evaluation import Evaluation

    return results_table(Evaluation, JSON)


JSON = {
    "microlens_image.diameter_px": "The same in pixels.",
    "fields[].ray_budget.fap": "Past the FAP: all of those that fill it.",
    "fields[].ray_budget.main_lens": "Of these, past the main lens.",
    "depth.disparity_pitches_per_mm": "Disparity between the FAP's rims per depth [microlens pitches/mm].",
    "depth.sigma_z_mm": "Standard deviation of depth that a disparity error of sigma_disparity_pitches makes.",
    "diffraction.airy_radius_px": "1.22 lambda d_2/d, on the sensor.",
    "effects[].name": "One of those under Effects.",
    "effects[].estimate": "Its size here.",
    "effects[].unit": "px on the sensor, pitch on the array, intensity as a share of full scale.",
    "effects[].budget": "Below this it may be left out.",
    "effects[].on": "Whether a rendering has it on.",
    "effects[].reason": "In words, with the numbers.",
    "verdicts[].name": "f_number_matched, field_undistorted, views_resolved; with a real lens thin_lens_holds.",
    "verdicts[].ok": "Whether the answer is yes.",
    "warnings": "What is no error but must not go unsaid; empty as a rule.",
    "real_lens.focal_length_mm": "At the design's wavelength.",
    "real_lens.back_focal_length_mm": "Last vertex to the image-side focus.",
    "real_lens.fields[].widening_percent": "The same as a percentage.",
    "real_lens.fields[].sagittal_focus_pitches": "The same across it.",
    "real_lens.left_out": "What the trace does not hold.",
}


def effects() -> str:
    """Every effect."""
    from roslf_design.effects import EFFECTS

    rows = []
    for effect in EFFECTS:
        home = importlib.import_module(effect.estimate.__module__)
        about = (effect.estimate.__doc__ or home.__doc__ or "").strip().split("\n\n")[0]
        switch = "always" if effect.always else "by its size"
        rows.append((f"{plain(effect.title)} {code(effect.name)}", effect.unit, switch, plain(" ".join(about.split()))))
    return markdown(("effect", "unit", "drawn", "size"), rows)


def grades() -> str:
    """The grades that ship."""
    from roslf_design.tolerancing.places import load_grades

    found = load_grades()
    rows = [(code(line.place), *line.tolerances, plain(line.provenance)) for line in found.lines]
    meanings = "\n".join(f"- {n}: {m}" for n, m in zip(found.names, found.meanings, strict=True))
    return f"{meanings}\n\n{markdown(('place', *found.names, 'where from'), rows)}"


def presets() -> str:
    """The designs that ship."""
    import roslf_design as roslf

    rows = [(code(n), plain(roslf.load(n).name), plain(roslf.load(n).source)) for n in roslf.preset_names()]
    return markdown(("preset", "what it is", "source"), rows)


def errors() -> str:
    """What readers say of typical faults, from the readers themselves."""
    import roslf_design as roslf

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
    from roslf_design.cli import COMMANDS, build_app

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


def story_file() -> str:
    """Every table of a story."""
    from roslf_design.reporting.story import CalibrationPart, Opening, Part

    own: dict[type, dict[str, str]] = {
        Opening: {"title": "Of the report.", "question": "What it asks."},
        Part: {
            "optimize": "A study of `roslf optimize`, relative to the story.",
            "tolerance": "A study of `roslf tolerance`, relative to the story.",
            "calibration": "Table of what one means to capture; `{}` chooses all of it to suit the design.",
            "take": 'Of an optimisation: which of its designs goes on, "best", "robust", or "parts-01" and so on.',
        },
        CalibrationPart: {"seed": "Of random poses."},
    }
    heads = (("`[story]`", Opening), ("`[[parts]]`, one study each", Part), ("`calibration`", CalibrationPart))
    return "\n".join(f"### {head}\n\n{keys_table(kind, own[kind])}" for head, kind in heads)


PARTS: dict[str, Callable[[], str]] = {
    "design-file": design_file,
    "scene-file": scene_file,
    "tolerance-study": tolerance_study,
    "optimise-study": optimise_study,
    "story-file": story_file,
    "evaluation-json": evaluation_json,
    "effects": effects,
    "grades": grades,
    "presets": presets,
    "errors": errors,
    "commands": commands,
}
"""Files of `_generated`, each by the function that writes it."""


def api_pages() -> Iterator[tuple[str, str]]:
    """One page a package: its docstring, then its modules."""
    rows = []
    for name, about in PACKAGES.items():
        package = importlib.import_module(name)
        rows.append(f"* - :doc:`{name}`\n  - {about}")
        yield f"{name}.rst", _api_page(package)
    listed = "\n".join("   " + line for row in rows for line in row.splitlines())
    toctree = "\n".join(f"   {name}" for name in PACKAGES)
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
    modules = [] if name == "roslf_design" else list(_modules(package))
    listed = [f":py:obj:`{item} <{home}>`" for item, home in public.items() if home]
    if listed:
        page += [f"**Names:** {', '.join(listed)}", ""]
    if name in WHOLE or not public:
        for module in modules:
            short = module.removeprefix(name + ".")
            page += [short, "-" * len(short), "", f".. automodule:: {module}"]
            page += [f"   :members: {', '.join(_own(module))}", ""]
        return "\n".join(page)
    if name == "roslf_design":
        return "\n".join(page)
    for module in sorted({home.rpartition(".")[0] for home in public.values() if home.startswith(name + ".")}):
        short = module.removeprefix(name + ".")
        items = [home.rpartition(".")[2] for home in public.values() if home.rpartition(".")[0] == module]
        page += [short, "-" * len(short), "", f".. automodule:: {module}", f"   :members: {', '.join(items)}", ""]
    return "\n".join(page)


WHOLE = ("roslf_design.theory", "roslf_design.design")
"""Packages whose modules are shown whole though the package lists names."""


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
    for name, make in PARTS.items():
        write(generated / f"{name}.md", make())
    for name, text in api_pages():
        write(api / name, text)
    for name, draw in FIGURES.items():
        write(generated / f"{name}.svg", draw())


def write(path: Path, text: str) -> None:
    """Write a file unless it already says so."""
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def setup(app: Sphinx) -> dict[str, Any]:
    """Before Sphinx looks for pages."""
    app.connect("builder-inited", write_all)
    return {"parallel_read_safe": True}
