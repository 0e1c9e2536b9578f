"""`roslf calibrate`, and its plan."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from pydantic import Field

from ..calibration.frames import CalibrationError
from ..calibration.options import CalibrateOptions, PlanOptions, PoseOptions, SheetOptions, calibration_plan, plan_cover
from ..calibration.outcome import calibrated
from ..calibration.planning import smaller_board, too_large
from ..calibration.posterior import sample_size_for
from ..calibration.result import Outcome
from ..calibration.written import CALIBRATED, calibration_files
from ..errors import Problem, refusal
from ..json_data import plain
from ..reporting.blocks import Report
from ..reporting.calibrate import pages
from ..reporting.printers import page_files
from ..reporting.story import known_before
from ..theory.limits import as_design
from ..units import Angle, Distance, Length
from .refused import refused
from .results import picture_files, print_titled
from .terminal import (
    Flag,
    Flat,
    Json,
    OptionalOutput,
    Repeated,
    StatusLine,
    Unread,
    check_options,
    json_text,
    listed,
    parse_sigmas,
    say,
    status_and_bars,
    typed,
    write_files,
)

LIKE = {"design": "paper", "board": '"4x5 6 mm"', "output": "out/calibration"}
"""Options that a calibration needs, each with an example."""


class _Options(CalibrateOptions):
    """Options but those that the shell has another form for."""

    design: str | None = None
    """The design that the camera was built to: a file or a preset. Gives f, pixel and microlens pitch."""
    sigma: Annotated[dict[str, str | float], Unread] = Field(default_factory=dict)
    posterior: Annotated[bool, Unread] = True

    def plan(self, poses: PoseOptions) -> PlanOptions:
        """Plan of captures; without a board, of one that suits the field."""
        known = {name: value for name, value in dict(self).items() if name in SheetOptions.model_fields}
        return PlanOptions.of(**known, **dict(poses))


def _as_planned(name: str) -> Any:
    field = PoseOptions.model_fields[name]
    return Field(field.default, description=field.description)


class PlannedPoses(PoseOptions):
    """Options whose quantities are text in the shell."""

    tilt: Annotated[Angle, Parameter(metavar="STR")] = _as_planned("tilt")
    distance: Annotated[Length | None, Parameter(metavar="STR")] = _as_planned("distance")
    range: Annotated[Distance | None, Parameter(metavar="STR")] = _as_planned("range")
    at: Annotated[tuple[Length, ...], Parameter(metavar="STR", negative=())] = _as_planned("at")

    def idle(self) -> dict[str, str]:
        """Faults of options that are given where nothing is planned."""
        return dict.fromkeys(self.model_fields_set, "goes with --plan only; leave it out")


OPTIONS, POSES = _Options(), PlannedPoses()


def calibrate(
    folder: Path | None = None,
    /,
    *,
    output: OptionalOutput = None,
    json: Json = False,
    options: Annotated[_Options, Flat] = OPTIONS,
    sigma: Repeated = None,
    no_posterior: Flag = False,
    plan: str | None = None,
    poses: Annotated[PlannedPoses, Parameter(name="*", group="With --plan", show_default=False)] = POSES,
) -> None:
    """H, d_3 and the rest from images of a checkerboard, and how sure they are; or, with --plan, how sure they will be.

    Example: roslf calibrate captures/monday --design designs/paper.toml --board "4x5 6 mm" -o out/monday

    Example: roslf calibrate --plan paper --boards 12 --tilt "20 deg"

    Parameters
    ----------
    folder
        Raw images: white.tif (or white_1.tif, white_2.tif, ...), perhaps dark.tif, and images of the board by any other
        name; .tif, .png, .npy or packed .mono12p.
    output
        Folder for calibration.json, calibrated.toml, figures and index.html.
    sigma
        Standard deviation of a number of what stands before the lens or about the array, as
        "elements.1.thickness=0.02 mm", "elements.0.index=0.001", "object_space.index=0.1 %" or
        "sensor.cover.thickness=20 um"; may be given several times. Elements count from 0, as in tolerance studies.
    no_posterior
        Leave the sampling out; intervals are then those of the Fisher matrix (Laplace's approximation).
    plan
        Instead of a folder: a design whose calibration is to be planned, before anyone captures an image; or a
        tolerance study of one, whose tolerances are then known before, in place of default ones.
    """
    design, given = options.design, {"design": options.design, "board": options.board, "output": output}
    wrong: dict[str, str] = {}
    if plan is not None:
        idle = {"design": design, "output": output, "distances": options.distances, "use_in": options.use_in}
        wrong = {key: "has no place beside --plan; leave it out" for key, value in idle.items() if value is not None}
    elif folder is not None:
        wrong = {key: f"is missing; such as --{key} {LIKE[key]}" for key, value in given.items() if value is None}
        wrong |= poses.idle()
    if options.accuracy is not None and (plan is not None or no_posterior):
        beside = "--plan" if plan is not None else "--no-posterior"
        wrong["accuracy"] = f"is the posterior's, and has no place beside {beside}; drop one"
    faults = [Problem(f"--{key.replace('_', '-')}", message) for key, message in wrong.items()]
    if plan is None and folder is None:
        faults.append(Problem("FOLDER", "name the folder of captured images, or plan them with --plan DESIGN"))
    elif plan is not None and folder is not None:
        faults.append(Problem("FOLDER", "has no place beside --plan; leave it out"))
    check_options(options.seed, output, *faults)
    options = options.model_copy(update={"sigma": parse_sigmas(sigma), "posterior": not no_posterior})
    if plan is not None:
        _print_plan(plan, options.plan(poses), options.distortion, json)
        return
    assert folder is not None
    assert design is not None
    assert output is not None
    sample_size_for(options.accuracy)
    sheet = as_design(design)
    check_options(folder=output, title=f"Calibration of {sheet.name}")
    began = time.perf_counter()
    try:
        with status_and_bars("calibrate") as tell:
            result = calibrated(folder, sheet, options, tell)
    except CalibrationError as error:
        raise refused(error, folder, output) from None
    typed_options = options.model_dump(exclude={"sigma", "posterior"})
    command = typed("calibrate", folder, output=output, **typed_options, sigma=sigma, no_posterior=no_posterior)
    _write_outcome(result, output, command, json, time.perf_counter() - began)


def _write_outcome(result: Outcome, output: Path, command: str, json: bool, seconds: float) -> None:
    """Write what came out into a folder, and print its answers or its JSON object."""
    report, files = write_calibration(result, output, command)
    if json:
        print(json_text(result.to_dict() | {"accuracy": result.accuracy.to_dict() | {"seconds": seconds}}))
        return
    print_titled(report.title, [block for section in report.sections[:2] for block in section.blocks])
    say(f"\nWritten to {output}: {', '.join(listed(files))}\n{seconds:.1f} s")


def write_calibration(result: Outcome, output: Path, command: str) -> tuple[Report, dict[str, bytes]]:
    """Write the folder of a calibration; its page and all its files."""
    files, fault = calibration_files(result, json_text)
    if fault:
        say(f"roslf: no {CALIBRATED}, the values make no design: {fault}", error=True)
    pictures = pages.calibration_pictures(result)
    drawings = {name: picture.svg(name=f"calibration-{name}") for name, picture in pictures.items()}
    report = pages.calibration_report(result, drawings, command)
    files |= picture_files(pictures, drawings) | page_files(report)
    write_files(output, files)
    return report, files


def _print_plan(design: str, asked: PlanOptions, distortion: int | None, json: bool) -> None:
    """Expected errors of a calibration that is planned, on stdout; refused where captures do not determine a camera."""
    loaded, build, whose, focused = known_before(Path(design), asked.seed)
    with StatusLine("calibrate") as status:
        status.tell("planning")
        plan = calibration_plan(loaded, asked, distortion)
    if isinstance(plan, str):
        raise refusal("plan", plan)
    if json:
        large = too_large(loaded, plan.captures)
        notes = [f"{large}: {smaller_board(loaded, plan.captures)}"] if large else []
        told: dict[str, Any] = {"warnings": notes}
        for key, tolerances in (("depth_expected", None), ("depth_with_tolerances", build)):
            places = (None, *asked.at)
            depth, *there = (pages.planned_depth(loaded, plan, asked, tolerances, z).to_dict() for z in places)
            told[key] = plain(depth)
            told[f"{key}_at"] = [{"at_mm": z, **plain(one)} for z, one in zip(asked.at, there, strict=True)]
        told |= {"cover": plain(plan_cover(loaded, plan.captures, asked))}
        print(json_text({**plan.to_dict(loaded.name, asked.seed), **told}))
        return
    blocks = pages.plan_blocks(loaded, plan, asked, build, whose, focused)
    print_titled(f"Plan of a calibration of {loaded.name}, {whose} known before", blocks)
