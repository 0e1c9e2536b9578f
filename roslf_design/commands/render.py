"""`roslf render`."""

from __future__ import annotations

import json as json_module
import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from ..accuracy.picture import settle, stated
from ..camera import Camera
from ..design.files import in_the_way, write_atomically
from ..effects import Budget, Plan, plan
from ..errors import InputError, Problem, refusal
from ..imaging.camera import Region
from ..imaging.files import check_target, write_image
from ..imaging.render import render as compute
from ..imaging.render import sampling_of
from ..imaging.sampling import render_seconds
from ..options import Options
from ..reporting.design.microlens import preview as zooms
from ..scenes import WHITE_FIELD, load_scene
from ..tables import Table, print_table
from ..theory.limits import as_design
from .terminal import (
    DesignName,
    Flag,
    Flat,
    Json,
    OptionalOutput,
    StatusLine,
    bar,
    check_options,
    check_owner,
    json_text,
    say,
    say_written_over,
    tell_cost,
)


class _Options(Options):
    """Physics that is drawn, and where."""

    budget_px: str | None = None
    """Effects that move light by less than this many pixels are left out; so are displacements on the microlens array
    below the same number of pitches. Default: 0.1."""
    budget_intensity: str | None = None
    """Effects that change intensities by less are left out ("1%" or "0.01"); also how exact sampled pixels are.
    Default: 1%; of a scene that states an exposure, rays that scatter less than a third of its noise."""
    accuracy: float | None = None
    """Instead of both budgets: what 99 of 100 pixels may be off by, 1 being a fully lit one, as 0.01. As many rays are
    traced as that takes, tried beforehand on small patches, and the picture is checked on others."""
    effects: Annotated[list[str] | None, Parameter(allow_leading_hyphen=True, negative=())] = None
    """Overrides: all, none, +name, -name; may be given several times or with commas. The names stand in the plan."""
    region: str | None = None
    """Only a part of the sensor, as column,row,columns,rows in pixels."""
    seed: int = 0
    """For sampling and noise: the same seed gives the same bytes."""

    def budget(self) -> Budget:
        """Budget below which effects are left out; refused beside an accuracy, and where it is no number."""
        if self.accuracy is not None and (self.budget_px is not None or self.budget_intensity is not None):
            raise refusal("accuracy", "sets the budgets; drop --budget-px and --budget-intensity, or it")
        px = _number("budget_px", self.budget_px or "0.1")
        given = self.budget_intensity
        return Budget(px=px, intensity=None if given is None else _number("budget_intensity", given), pitch=px)

    def overrides(self) -> list[str]:
        """Effects by hand."""
        return [part.strip() for text in self.effects or [] for part in text.split(",") if part.strip()]


OPTIONS = _Options()
UNNAMED = "a scene without a name"


def render(
    design: DesignName,
    /,
    *,
    scene: Annotated[list[Path] | None, Parameter(negative=())] = None,
    output: OptionalOutput = None,
    options: Annotated[_Options, Flat] = OPTIONS,
    depth: Literal["float", "16"] = "float",
    preview: Flag = False,
    plan_only: Flag = False,
    json: Json = False,
) -> None:
    """The raw light-field image that the sensor would record, with only the physics that the scene calls for.

    Example: roslf render paper --scene board.toml -o raw.tif --preview

    Parameters
    ----------
    scene
        A scene file; none is a white field. Several scenes make a folder of images.
    output
        Where the image goes: .tif (float or 16 bits) or .png (16 bits), with a .json beside; or a folder, where it is
        called after its scene, or white, with .tif. Default: this folder; for several scenes the folder renders.
    depth
        Numbers in a TIFF: float, or 16 for 16-bit.
    preview
        Also write a picture with zooms at centre, edge and corner.
    plan_only
        Print which effects would be on, with sizes and reasons, and stop.
    """
    loaded = as_design(design)
    scenes = [load_scene(path) for path in scene or []] or [WHITE_FIELD]
    budget, overrides = options.budget(), options.overrides()
    accuracy, seed = options.accuracy, options.seed
    piece = None if options.region is None else parse_region(options.region)
    check_options(seed)
    targets = [] if plan_only else _targets(output, [path.stem for path in scene or []] or ["white"])
    for target, each in zip(targets, scenes, strict=False):  # none of a plan
        check_target(target)
        _check_owner(target, loaded.name, each.model_dump(mode="json", exclude_defaults=True))
        if preview and (blocked := in_the_way(_preview_of(target))):
            raise refusal("output", blocked)
    began = time.perf_counter()
    with StatusLine("render") as status:
        settled = [
            None
            if accuracy is None
            else settle(loaded, each, accuracy, overrides, seed=seed, region=piece, progress=status.tell)
            for each in scenes
        ]
    settling = (time.perf_counter() - began) / len(scenes)
    plans = [
        plan(loaded, each, budget, overrides) if way is None else way.plan
        for each, way in zip(scenes, settled, strict=True)
    ]
    if plan_only and json:
        rows = [{"scene": each.name, "effects": on.as_dicts()} for each, on in zip(scenes, plans, strict=True)]
        print(json_text({"schema": "roslf.plan/1", "plans": rows}))
    elif plan_only:
        for each, effects_on in zip(scenes, plans, strict=True):
            say(f"Effects for {each.name or 'the scene'}")
            _print_plan(effects_on)
    if plan_only:
        return
    for each, effects_on, way, target in zip(scenes, plans, settled, targets, strict=True):
        began = time.perf_counter() - settling
        part = Region.checked(Camera.of(loaded), piece).drawn()
        used, sampling = (
            (budget, sampling_of(loaded, each, effects_on, budget, part, seed))
            if way is None
            else (way.budget, way.sampling)
        )
        if sampling.below_noise:
            pixels, rays = part.columns * part.rows, sampling.most
            size = f"{pixels / 1e6:.2g} million pixels x {rays} rays, to stay below the noise of its exposure"
            seconds = render_seconds(loaded, pixels, rays)
            tell_cost(seconds, f"{size}; a smaller --region or --budget-intensity 1% makes it shorter")
        with bar(target.name) as tell:
            image = compute(
                loaded, each, effects=effects_on, budget=used, seed=seed, region=piece, sampling=sampling, progress=tell
            )
        statement = replace(stated(image, way, accuracy, budget), seconds=time.perf_counter() - began)
        image = replace(image, accuracy=statement.to_dict())
        held = target.read_bytes() if target.is_file() else b""
        written = [target, write_image(image, target, depth)]
        say_written_over(target, held)
        if preview:
            written.append(_preview_of(target))
            write_atomically(written[-1], zooms(image).to_png(110))
        if json:
            values = {**image.metadata(), "files": [str(path) for path in written], "seconds": image.seconds}
            print(json_text(values | {"accuracy": statement.to_dict(times=True)}))
            continue
        _print_plan(image.plan)
        height, width = image.pixels.shape
        traced = f", {image.rays / 1e6:.3g} million rays" if image.rays else ""
        print(f"\n{width} x {height} pixels by {image.method} in {image.seconds:.2f} s{traced}")
        say(statement.sentence(), *written)


def _number(option: str, text: str) -> float:
    share = text.strip().endswith("%")
    try:
        value = float(text.strip().removesuffix("%")) / (100 if share else 1)
    except ValueError:
        value = math.nan
    if not (value >= 0 and math.isfinite(value)):
        raise refusal(option, f'"{text}" is no budget; give a number that is not negative, as 0.1 or 1%')
    return value


def parse_region(text: str) -> tuple[int, int, int, int]:
    """Read "column,row,columns,rows"; refused where it is anything else."""
    try:
        column, row, columns, rows = (int(part) for part in text.split(","))
    except ValueError:
        message = f'cannot read "{text}"; write column,row,columns,rows, as 0,0,512,512'
        raise refusal("region", message) from None
    return column, row, columns, rows


def _targets(output: Path | None, names: list[str]) -> list[Path]:
    """Target file of each image; `output` is a folder where it is one already, or ends in no suffix."""
    one = len(names) == 1
    folder = output or Path("." if one else "renders")
    if folder.suffix and not folder.is_dir():
        if one:
            return [folder]
        raise InputError((Problem("", "several scenes make several images; name a folder with -o"),), str(folder))
    if len(set(names)) < len(names):
        raise refusal("scene", f"two scenes are called alike ({', '.join(names)}); rename a file")
    return [folder / f"{name}.tif" for name in names]


def _check_owner(target: Path, design: str, scene: Mapping[str, Any]) -> None:
    """Refuse to write an image over one of another design or scene, or over what no image lies beside."""
    if not target.exists():
        return
    own, held = f"{design}, {scene.get('name', UNNAMED)}", ""
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):
        data = json_module.loads(target.with_suffix(".json").read_bytes())
        held = f"{data['design']['name']}, {data['scene'].get('name', UNNAMED)}"
        held += ", but another" if held == own and "name" not in scene and data["scene"] != scene else ""
    check_owner(target, held, own)


def _preview_of(target: Path) -> Path:
    return target.with_name(f"{target.stem}-preview.png")


def _print_plan(lines: Plan) -> None:
    from rich.console import Console

    rows = tuple(
        (line.name, "on" if line.on else "-", f"{line.estimate:.3g} {line.unit}", f"{line.budget:g}", line.reason)
        for line in lines
    )
    print_table(Table(rows, "lllll", ("effect", "", "estimate", "budget", "why")), Console())
