"""`roslf render`."""

from __future__ import annotations

import json as json_text
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from .progress import bar

if TYPE_CHECKING:
    from ..effects import Plan
    from ..imaging.render import RawImage


def render(
    design: str,
    /,
    *,
    scene: Annotated[list[Path] | None, Parameter(negative=())] = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    budget_px: str = "0.1",
    budget_intensity: str = "1%",
    effects: Annotated[list[str] | None, Parameter(allow_leading_hyphen=True, negative=())] = None,
    region: str | None = None,
    depth: Literal["float", "16"] = "float",
    seed: int = 0,
    preview: Annotated[bool, Parameter(negative=())] = False,
    plan_only: Annotated[bool, Parameter(negative=())] = False,
    json: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """The raw light-field image that the sensor would record, with only the physics that the scene calls for.

    Example: roslf render paper --scene board.toml -o raw.tif --preview

    Parameters
    ----------
    design
        A design file, or the name of a preset (see `roslf presets`).
    scene
        A scene file; none is a white field. Several scenes make a folder of images.
    output
        Where the image goes: .tif (float or 16 bits) or .png (16 bits), with a .json beside; for several scenes a
        folder. Default: the scene's name, or white, with .tif.
    budget_px
        Effects that move light by less than this many pixels are left out; so are displacements on the microlens
        array below the same number of pitches.
    budget_intensity
        Effects that change intensities by less are left out ("1%" or "0.01"); also how exact sampled pixels are.
    effects
        Overrides: all, none, +name, -name; may be given several times or with commas. The names stand in the plan.
    region
        Only a part of the sensor, as column,row,columns,rows in pixels.
    depth
        Numbers in a TIFF: float, or 16 for 16-bit.
    seed
        For sampling and noise: the same seed gives the same bytes.
    preview
        Also write a picture with zooms at centre, edge and corner.
    plan_only
        Print which effects would be on, with sizes and reasons, and stop.
    json
        Print JSON instead of tables.
    """
    from ..design import load
    from ..effects import Budget, plan
    from ..imaging.files import check_target, write_image
    from ..scenes import WHITE_FIELD, load_scene

    loaded = load(design)
    scenes = [load_scene(path) for path in scene or []] or [WHITE_FIELD]
    budget = Budget(
        px=_number("--budget-px", budget_px),
        intensity=_number("--budget-intensity", budget_intensity),
        pitch=_number("--budget-px", budget_px),
    )
    overrides = [part.strip() for text in effects or [] for part in text.split(",") if part.strip()]
    plans = [plan(loaded, each, budget, overrides) for each in scenes]
    if plan_only:
        _show_plans(plans, [each.name for each in scenes], json)
        return
    names = [path.stem for path in scene or []] or ["white"]
    targets = _targets(output, names)
    for target in targets:
        check_target(target)
    piece = None if region is None else _region(region)

    from ..imaging.render import render as compute

    for each, effects_on, target in zip(scenes, plans, targets, strict=True):
        with bar(target.name) as tell:
            image = compute(loaded, each, effects=effects_on, budget=budget, seed=seed, region=piece, progress=tell)
        beside = write_image(image, target, depth)
        written = [target, beside]
        if preview:
            written.append(_preview(image, target))
        _show(image, written, json)


def _number(option: str, text: str) -> float:
    from ..errors import InputError, Problem

    share = text.strip().endswith("%")
    try:
        value = float(text.strip().removesuffix("%")) / (100 if share else 1)
    except ValueError:
        value = math.nan
    if not (value >= 0 and math.isfinite(value)):
        raise InputError((Problem(option, f'"{text}" is no budget; give a number that is not negative, as 0.1 or 1%'),))
    return value


def _region(text: str) -> tuple[int, int, int, int]:
    from ..errors import InputError, Problem

    try:
        column, row, columns, rows = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            (Problem("--region", f'cannot read "{text}"; write column,row,columns,rows, as 0,0,512,512'),)
        ) from None
    return column, row, columns, rows


def _targets(output: Path | None, names: list[str]) -> list[Path]:
    from ..errors import InputError, Problem

    if len(names) == 1:
        return [output or Path(f"{names[0]}.tif")]
    folder = output or Path("renders")
    if folder.suffix or folder.is_file():
        raise InputError((Problem("", "several scenes make several images; name a folder with -o"),), str(folder))
    if len(set(names)) < len(names):
        raise InputError((Problem("--scene", f"two scenes are called alike ({', '.join(names)}); rename a file"),))
    folder.mkdir(parents=True, exist_ok=True)
    return [folder / f"{name}.tif" for name in names]


def _preview(image: RawImage, target: Path) -> Path:
    import io

    from ..design.write import write_atomically
    from ..imaging.figures import draw_preview

    content = io.BytesIO()
    draw_preview(image).savefig(content, format="png", dpi=110, metadata={"Software": "roslf"})
    place = target.with_name(f"{target.stem}-preview.png")
    write_atomically(place, content.getvalue())
    return place


def _show_plans(plans: list[Plan], names: list[str], json: bool) -> None:
    if json:
        rows = [{"scene": name, "effects": lines.as_dicts()} for name, lines in zip(names, plans, strict=True)]
        print(json_text.dumps({"schema": "roslf.plan/1", "plans": rows}, indent=1, allow_nan=False, ensure_ascii=False))
        return
    for name, lines in zip(names, plans, strict=True):
        print(f"Effects for {name or 'the scene'}")
        _print_plan(lines)


def _show(image: RawImage, written: list[Path], json: bool) -> None:
    if json:
        values = {**image.metadata(), "files": [str(path) for path in written], "seconds": image.seconds}
        print(json_text.dumps(values, indent=1, allow_nan=False, ensure_ascii=False))
        return
    _print_plan(image.plan)
    rows, columns = image.pixels.shape
    traced = f", {image.rays / 1e6:.3g} million rays" if image.rays else ""
    print(f"\n{columns} x {rows} pixels by {image.method} in {image.seconds:.2f} s{traced}")
    for path in written:
        print(path)


def _print_plan(lines: Plan) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, header_style="bold", pad_edge=False)
    for heading in ("effect", "", "estimate", "budget"):
        table.add_column(heading, no_wrap=True)
    table.add_column("why")
    for line in lines:
        size = f"{line.estimate:.3g} {line.unit}"
        table.add_row(line.name, "on" if line.on else "-", size, f"{line.budget:g}", line.reason)
    Console().print(table)
