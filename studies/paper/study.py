"""Every number of the paper, computed again: what agrees, what does not, and why.

Run: python studies/paper/study.py
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.theory import exit_pupil, f_number, light, light_field, vignetting

RAW_WIDTH = 4600
"""Pixels across the raw images that the paper shows."""
PRINTED_PIXEL = 3.2
"""Pixel pitch that the paper gives for its sensor [um]."""


class Row(NamedTuple):
    """One number of the paper beside ours."""

    quantity: str
    """What it is, with the paper's symbol."""
    paper: str
    """As printed there; empty where the paper gives none."""
    value: float
    """Ours, in the unit of `unit`."""
    unit: str
    reason: str
    """Why they differ, or what follows."""
    misread: bool = False
    """Whether the number is right but what the paper says of it is not."""

    @property
    def verdict(self) -> str:
        """Whether ours, rounded to the printed digits, is what is printed; or right and misread; or new."""
        if not self.paper:
            return "not given"
        if f"{self.value:.{_digits(self.paper)}f}" != self.paper:
            return "disagrees"
        return "misread" if self.misread else "agrees"

    @property
    def ours(self) -> str:
        """Ours, a few digits beyond the printed ones."""
        return f"{self.value:.{_digits(self.paper) + 3}f}" if self.paper else f"{self.value:.6g}"


def rows() -> list[Row]:
    """Every number of the paper, in the paper's order.

    Returns
    -------
    list of Row
    """
    return [*_matching(), *_field(), *_raw_image(), *_calibration(), *_diffraction()]


def bench() -> Camera:
    """The paper's bench."""
    return Camera.of(roslf.load("paper"))


def _matching() -> Iterator[Row]:
    camera, mismatched = bench(), Camera.of(roslf.load("paper-mismatched"))
    left, right = float(f_number.microlens_f_number(camera)), float(f_number.pupil_f_number(camera))
    shorter = 1 - float(exit_pupil.microlens_image_pitch(camera) / camera.d)
    yield Row("microlens f-number d_2/d (Eq. 8, left)", "31.75", left, "", "")
    yield Row(
        "pupil f-number d_1/(D_F H) (Eq. 8, right)",
        "31.72",
        right,
        "",
        f"equal to {100 * (left / right - 1):.2f} %: matched by the approximate rule",
    )
    yield Row(
        "image fill by the exact rule (Eq. 7)",
        "",
        float(f_number.fill_factor(camera)),
        "",
        f"the image pitch d (1 + d_2/L) is {100 * shorter:.1f} % below d: images overlap by "
        f"{float(f_number.mismatch_px(camera)):.3f} px",
    )
    yield Row(
        "main-lens f-number d_1/D (Eq. 9, right)",
        "2.76",
        float(f_number.main_lens_f_number(camera)),
        "",
        "the traditional rule calls the same system mismatched",
    )
    yield Row(
        "pupil f-number with d_3 = 20 mm (Eq. 8, right)",
        "45.52",
        float(f_number.pupil_f_number(mismatched)),
        "",
        "",
    )


def _field() -> Iterator[Row]:
    camera = bench()
    half = float(camera.array_size[0] / 2 * camera.seen.inverse_m)
    corner = math.hypot(half, half)
    reach = vignetting.field_limit(camera).radius
    inside = corner <= reach
    yield Row(
        "non-distortion bound |X_0| (Eq. 6)",
        "44.5",
        reach,
        "mm",
        "a half-field: a radius about the axis",
    )
    yield Row(
        "field of view of the array",
        "57.5",
        2 * half,
        "mm",
        f"a full field; set against the bound it must be halved: half width {half:.2f} mm, corner {corner:.2f} mm, "
        + ("inside the bound. Thin-lens vignetting distorts nothing there; " if inside else "beyond the bound. ")
        + "what the paper saw at the edge needs another effect",
        misread=inside,
    )


def _raw_image() -> Iterator[Row]:
    camera = bench()
    width = float(camera.sensor_size[0])
    diameter = 1e3 * float(exit_pupil.microlens_image_diameter(camera))
    effective = 1e3 * width / RAW_WIDTH
    yield Row(
        "pixel pitch q of the raw image",
        f"{PRINTED_PIXEL}",
        effective,
        "um",
        f"{width} mm over {RAW_WIDTH} px: the raw image was resampled, and this is its effective pixel",
    )
    yield Row(
        "microlens image across",
        "13",
        diameter / effective,
        "px",
        f"with the effective pixel; {PRINTED_PIXEL} um would make it {diameter / PRINTED_PIXEL:.1f} px",
    )


def _calibration() -> Iterator[Row]:
    f, reach, m = 100.0, 91.09, 0.42
    lengths = light_field.back_substitute(f, reach, m)
    given = "from A = 91.09 mm and m = 0.42 (Table 2) with f = 100 mm"
    yield Row("calibrated d_1", "142.00", float(lengths.mla_distance), "mm", given)
    yield Row("calibrated d_f", "338.10", float(lengths.focal_plane_distance), "mm", given)
    yield Row("calibrated H", "1.56", float(lengths.aperture_constant), "", given)
    yield Row(
        "calibrated d_3",
        "121.21",
        float(lengths.pupil_distance),
        "mm",
        f"{given}; moves by 1 + 1/m = {1 + 1 / m:.1f} mm per mm of f, which the calibration does not determine",
    )
    yield Row(
        "m of Table 2",
        "0.42",
        float(lengths.mla_distance / lengths.focal_plane_distance),
        "",
        f"is d_1/d_f; the table labels it d_1/f, which is {float(lengths.mla_distance) / f:.2f}",
        misread=True,
    )


def _diffraction() -> Iterator[Row]:
    camera = bench()
    airy = float(light.airy_radius(camera))
    yield Row("Airy radius on the sensor, 550 nm", "", 1e3 * airy, "um", f"{airy / camera.q:.2f} effective pixels")
    yield Row(
        "Fresnel number of a microlens",
        "",
        float(light.fresnel_number(camera)),
        "",
        "about 1: a microlens image is no shadow of the pupil; ray optics alone misstates it",
    )
    yield Row(
        "independent views per axis, 4 N_F",
        "",
        float(light.independent_views(camera)),
        "",
        f"not the {float(light.geometric_views(camera)):.0f} pixels across an image",
    )


def _digits(printed: str) -> int:
    return len(printed.partition(".")[2])


COLOURS = {"agrees": "green", "disagrees": "red", "misread": "yellow", "not given": "dim"}


def main() -> None:
    """Print the table."""
    table = Table(title="The paper's numbers, computed again", box=box.SIMPLE_HEAD)
    table.add_column("quantity", max_width=34)
    table.add_column("paper", justify="right", no_wrap=True)
    table.add_column("ours", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("reason")
    computed = rows()
    for row in computed:
        colour = COLOURS[row.verdict]
        printed = f"{row.paper} {row.unit}".strip() if row.paper else "-"
        table.add_row(
            row.quantity, printed, f"{row.ours} {row.unit}".strip(), f"[{colour}]{row.verdict}[/]", row.reason
        )
    console = Console()
    if not console.is_terminal:
        console.width = 120
    console.print(table)
    counts = {verdict: sum(row.verdict == verdict for row in computed) for verdict in COLOURS}
    console.print(", ".join(f"{count} {verdict}" for verdict, count in counts.items()))


if __name__ == "__main__":
    main()
