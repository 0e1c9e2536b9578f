"""How exact a study behind a real lens is: some of its builds traced once more, each as a design of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..lenses.images import real_images
from ..lenses.of_design import camera_of, microlenses
from .mount import as_built
from .plan import Plan
from .traced import TracedBuilds

Array = NDArray[np.float64]

BUILDS = 4
"""Of the study's own, its first."""
POINTS = 768
"""Of an oracle's boundary: where rims cut an image, its own area is then right to 4e-5."""

METHOD = (
    "Exact rays through every build's own lens, aimed at the FAP; images integrated by Fourier series along the FAP's "
    "rim, and by polynomials of the fifth degree where rims cut them."
)


@dataclass(frozen=True)
class TraceCheck:
    """Largest differences between the study's metrics and builds traced one at a time, over all its fields."""

    builds: int
    """How many were compared; images undefined in a study are left out."""
    centre_px: float
    """Of image centres [px]."""
    diameter: float
    """Of image diameters, as a share."""
    kept_fraction: float
    """Of the parts of the FAP that are seen."""

    def __str__(self) -> str:
        return (
            f"{METHOD} {self.builds} builds traced one at a time differ by up to {self.centre_px:.1g} px in image "
            f"centres, {self.diameter:.1g} of image diameters and {self.kept_fraction:.1g} in kept fractions"
        )

    def to_dict(self) -> dict[str, Any]:
        """For the JSON object."""
        return {
            "method": METHOD,
            "builds_compared": self.builds,
            "largest_difference": {
                "image_centre_px": self.centre_px,
                "image_diameter_share": self.diameter,
                "kept_fraction": self.kept_fraction,
            },
        }


def check_traced(plan: Plan) -> TraceCheck | None:
    """Trace the first builds of a plan one at a time; None where its main lens is ideal."""
    question = plan.question
    design, fields = question.design, question.fields
    if design.lens is None:
        return None
    deviations = plan.draws.deviations(plan.draws.uniforms(0, plan.chunk)[:, :BUILDS])
    values = plan.draws.values(deviations)
    count = deviations.shape[1]
    centre, diameter, kept, compared = 0.0, 0.0, 0.0, 0
    with np.errstate(all="ignore"):
        found = TracedBuilds.of(design, values, count, fields, question.object_distance, False)
        chief, sizes, shares = found.chief, found.value("image_diameter_mm"), found.value("kept_fraction")
    for trial in range(count):
        try:
            one = as_built(design, {place: float(numbers[trial]) for place, numbers in values.items()})
            images = real_images(camera_of(one), microlenses(one, fields), points=POINTS)
        except InputError:
            continue  # no camera; the study says so too
        compared += 1
        there = microlenses(one, fields) + images.chief - np.subtract(one.sensor.decentre, one.main_lens.decentre)
        centre = max(centre, _largest(there - chief[:, trial]) / one.q)
        diameter = max(diameter, _largest(images.diameter / sizes[:, trial] - 1))
        kept = max(kept, _largest(images.kept_fraction - shares[:, trial]))
    return TraceCheck(compared, centre, diameter, kept)


def _largest(off: Array) -> float:
    return float(np.max(np.abs(off[np.isfinite(off)]), initial=0.0))
