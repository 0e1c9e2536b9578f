"""Two or three designs side by side: their verdicts, every number with differences marked, and their drawings."""

from __future__ import annotations

from collections.abc import Sequence

from ...camera import Camera
from ...design import Design
from ...evaluation import evaluate
from ...evaluation.result import Evaluation, effects_table, fact_tables, field_table
from ...progress import CountedProgress, silent
from ...theory.colours import PIXEL_FILTERS
from ...theory.quantities import quantity_named, window_note
from ...words import length, listed, number
from ..blocks import Figure, Report, Section, Table
from ..lens_words import lens_words
from .curves import depth_comparison
from .figures import PLACES
from .microlens import microlens_images
from .pages import making, misalignments, parameter_rows, verdicts
from .rays import ray_diagrams

DIFFERENT, SAME, ABSENT = "≠", "", "-"
LETTERS = "ABC"
"""Letters that designs go by; as many as fit beside each other."""


def comparison_title(designs: Sequence[Design]) -> str:
    """Title of a comparison: its designs by their letters."""
    return ", ".join(f"{letter}: {design.name}" for letter, design in zip("ABC", designs, strict=False))


def comparison_report(
    designs: Sequence[Design],
    *,
    command: str = "",
    stamp: tuple[str, ...] = (),
    accuracy: float | None = None,
    progress: CountedProgress = silent,
) -> Report:
    """Compare two or three designs, called A, B, C in their order; the rest as for `design_report`.

    Raises
    ------
    ValueError
        Fewer than two designs, or more than three.
    """
    if not 2 <= len(designs) <= len(LETTERS):
        raise ValueError(f"{len(designs)} designs cannot be compared side by side; give two or three")
    progress("evaluating")
    results = [evaluate(design, accuracy=accuracy) for design in designs]
    named = dict(zip(LETTERS, designs, strict=False))
    progress("figures")
    rays, images, depth = _figures(named, results)
    tables = (_parameters(designs), *_numbers(results), *_fields(results), _effects(results))
    sections = (
        Section("Verdicts", tuple(verdicts(r, f"{letter}: ") for letter, r in zip(named, results, strict=True))),
        Section("What differs", tables),
        Section("Rays", rays),
        Section("Microlens images", (images,)),
        Section("Depth", (depth,)),
        making(command, (), stamp),
    )
    return Report(comparison_title(designs), "Designs side by side; ≠ marks what differs.", sections)


def _figures(named: dict[str, Design], results: Sequence[Evaluation]) -> tuple[tuple[Figure, ...], Figure, Figure]:
    """Each design's rays, the microlens image of each at its sensor's corner, depth, expected, of all."""
    caption = "Each design in a scale of its own, its ends larger below. Dashed orange rays end at what blocks them."
    rays = tuple(
        Figure.of(f"rays-{letter}", f"{letter}: {design.name}", caption, ray_diagrams(design))
        for letter, design in named.items()
    )
    caption = (
        "Ray-optics images on their pixels. A full disc sees the whole pupil; a cat's eye has lost what the dashed "
        "discs cut away. Images as wide as the green cell use every pixel once."
    )
    corners = {
        letter: (design, result.fields[-1].x_ml_mm)
        for (letter, design), result in zip(named.items(), results, strict=True)
    }
    title = "Microlens images at the sensor's corner"
    images = Figure.of("images", title, caption, microlens_images(corners)[0])
    caption = (
        "Depth, expected, one standard deviation, lengths as drawn, of each design over its working range and the "
        "distances that it requires something at; thin, depth noise: what photons and read noise alone leave, or a "
        "disparity error as given; dots mark "
        "the focal planes. The lower curve resolves depth better there."
    )
    windows = {letter: float(quantity_named("depth_window_mm")(Camera.of(one))) for letter, one in named.items()}
    if window_note(["u_z_mm"], lambda: [*windows.values()]):
        each = listed([f"{letter} {number(window, 3)} mm" for letter, window in windows.items()])
        caption += f" One depth comes from windows of unlike size on the object, at the focal planes {each}: choose "
        caption += "depth.window so that it is alike."
    return rays, images, Figure.of("depth", "Depth, expected", caption, depth_comparison(named))


def _parameters(designs: Sequence[Design]) -> Table:
    columns = []
    for design in designs:
        mla = design.microlens_array
        column = {f"{name}, {symbol}" if symbol else name: value for symbol, name, value, _ in parameter_rows(design)}
        column |= {
            "array": f"{mla.layout}, {mla.lens_shape} lenses",
            "pixels": "{} x {}".format(*design.pixels),
            "colour filters": PIXEL_FILTERS[design.sensor.colours].name,
            "main lens": lens_words(design.main_lens.kind).title,
            "further stops": str(len(design.stops)),
        }
        for k in range(max(len(each.stops) for each in designs)):
            stop = design.stops[k] if k < len(design.stops) else None
            name = f"{stop.name}, " if stop and stop.name else ""
            words = design.all_stops[k + 1].outline.words if stop else ""
            column[f"stop {k + 1}"] = f"{name}{words} at {length(stop.distance)}" if stop else ABSENT
        moved = [f"{part} {pose}" for part, pose in misalignments(design)]
        columns.append(column | {"misalignments": "; ".join(moved) or "none"})
    return _side_by_side("Parameters", columns)


def _numbers(results: Sequence[Evaluation]) -> list[Table]:
    """The evaluations' tables; a real lens has more rows than an ideal one."""
    groups = [{t.title: {row[0]: row[1] for row in t.rows} for t in fact_tables(result)} for result in results]
    titles = dict.fromkeys(title for group in groups for title in group)
    return [_side_by_side(title, [group.get(title, {}) for group in groups]) for title in titles]


def _fields(results: Sequence[Evaluation]) -> list[Table]:
    return [
        _side_by_side(
            f"Microlens image at the {place}",
            [dict(zip(table.headings, table.rows[i], strict=True)) for table in map(field_table, results)],
        )
        for i, place in enumerate(PLACES)
    ]


def _effects(results: Sequence[Evaluation]) -> Table:
    """Every effect's size, and whether the plan has it on."""
    columns = [{row[0]: f"{row[1]}, {row[3]}" for row in effects_table(result).rows} for result in results]
    return _side_by_side("Effects for a white scene, and whether a simulation must have them on", columns)


def _side_by_side(title: str, columns: Sequence[dict[str, str]]) -> Table:
    """Values by name, one column a design, with a sign before every row that differs; the others step back."""
    names = dict.fromkeys(name for column in columns for name in column)
    rows = [(name, *(column.get(name, ABSENT) for column in columns)) for name in names]
    same = [len(set(row[1:])) == 1 for row in rows]
    return Table(
        tuple((SAME if equal else DIFFERENT, *row) for equal, row in zip(same, rows, strict=True)),
        "ll" + "d" * len(columns),
        ("", "", *LETTERS[: len(columns)]),
        title,
        faint=tuple(index for index, equal in enumerate(same) if equal),
        widths=(1.5, 18, *([13] * len(columns))),
    )
