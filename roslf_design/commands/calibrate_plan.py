"""`roslf calibrate --plan`."""

from __future__ import annotations

import json as json_text
from typing import TYPE_CHECKING

from .calibrate_shared import print_blocks, read_board, read_quantity, read_sheet
from .progress import StatusLine

if TYPE_CHECKING:
    from ..calibration import Board, Captures
    from ..design import Design


def print_plan(
    design: str,
    board: str | None,
    boards: int | None,
    tilt: str | None,
    distance: str | None,
    distance_range: str | None,
    noise: float | None,
    f_sigma: str,
    distortion: int,
    seed: int,
    json: bool,
) -> None:
    """Expected errors of a calibration that is planned, on stdout.

    Raises
    ------
    CalibrationError, InputError
        The captures do not determine the camera, or an option cannot be read.
    """
    from ..calibration import CalibrationError, camera_of
    from ..calibration import plan as planned
    from ..calibration.planning import reason
    from ..calibration.section import plan_blocks, plan_to_dict
    from ..design import load

    loaded = load(design)
    captures = captures_for(
        loaded,
        board=read_board("4x5 6 mm" if board is None else board),
        boards=12 if boards is None else boards,
        tilt=read_quantity("--tilt", tilt or "20 deg", "angle"),
        distance=None if distance is None else read_quantity("--distance", distance, "length"),
        distance_range=None if distance_range is None else read_quantity("--range", distance_range, "length"),
        noise=0.06 if noise is None else noise,
    )
    with StatusLine("calibrate") as status:
        status.tell("planning")
        try:
            found = planned(camera_of(loaded), read_sheet(loaded, f_sigma), captures, distortion=distortion, seed=seed)
        except CalibrationError as error:
            why = reason(captures)
            if why in str(error) or "into the bore" in str(error):
                raise
            raise CalibrationError(f"{error}: {why}") from None
    notes = too_large(loaded, captures)
    if json:
        data = {**plan_to_dict(found, loaded.name, seed, distortion), "warnings": list(notes)}
        print(json_text.dumps(data, indent=1, allow_nan=False, ensure_ascii=False))
        return
    import math

    from rich.console import Console

    console = Console()
    b = captures.board
    console.print(f"[bold]Plan of a calibration of {loaded.name}[/bold]", highlight=False)
    console.print(
        f"{captures.boards} images of a {b.columns} x {b.rows} board of {b.cell:g} mm cells, tilted by up to"
        f" {math.degrees(captures.tilt):g} degrees, {captures.distance:.4g} ± {captures.distance_range / 2:.3g} mm"
        f" from the lens; corners to {captures.noise:g} pitches in {len(captures.view_grid())} views; f to {f_sigma}.",
        highlight=False,
        soft_wrap=True,
    )
    print_blocks(plan_blocks(found), console)
    for note in notes:
        console.print(f"Note: {note}.", highlight=False, soft_wrap=True)


def too_large(design: Design, captures: Captures) -> tuple[str, ...]:
    """A warning where the sensor cannot see the whole board at its nearest: a plan counts every corner as seen."""
    from ..calibration import camera_of

    board, camera = captures.board, camera_of(design)
    nearest = captures.distance - captures.distance_range / 2 - design.d_3
    field = sorted(size * nearest / camera.A for size in design.sensor_size)
    sides = sorted((board.columns * board.cell, board.rows * board.cell))
    if all(side <= seen for side, seen in zip(sides, field, strict=True)):
        return ()
    return (
        f"the board measures {sides[0]:.4g} x {sides[1]:.4g} mm, but the sensor sees only {field[0]:.3g} x"
        f" {field[1]:.3g} mm at its nearest, and the plan counts every corner as seen: choose a smaller --board",
    )


def captures_for(
    design: Design,
    *,
    board: Board,
    boards: int,
    tilt: float,
    distance: float | None,
    distance_range: float | None,
    noise: float,
) -> Captures:
    """What one means to capture with a design; distances not given lie about its focal plane.

    Parameters
    ----------
    design : Design
    board : Board
    boards : int
    tilt : float
        [rad]
    distance, distance_range : float, optional
        [mm]
    noise : float
        [pitches]

    Raises
    ------
    CalibrationError
        A number out of range.
    """
    import math

    from ..calibration import CalibrationError, Captures
    from ..theory.aperture import effective_image_distance

    if not 0 <= tilt < math.pi / 2:
        raise CalibrationError(f"boards cannot be tilted by {math.degrees(tilt):g} degrees; stay below 90")
    if distance_range is not None and distance_range < 0:
        raise CalibrationError(f"a range of distances is not negative, got {distance_range:g} mm")
    middle = design.d_f if distance is None else distance
    depth = middle - design.d_3
    image = design.D_F * design.d_2 / abs(float(effective_image_distance(design.f, design.d_f, design.d_3)))
    return Captures(
        board=board,
        boards=boards,
        distance=middle,
        distance_range=depth / 4 if distance_range is None else distance_range,
        tilt=tilt,
        offset=0.035 * max(depth, 0.0),
        noise=noise,
        # As far out as corners are followed: views at the pupil's rim are left out.
        reach=0.385 * min(design.d, image) / design.q,
    )
