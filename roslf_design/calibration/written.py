"""The folder that a calibration leaves: its calibration.json, checked, and the camera that was calibrated."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StrictBool, ValidationError, model_validator

from ..camera import Camera
from ..design import Design, DesignError, dumps
from ..design.files import WRITTEN
from ..errors import InputError, Problem, refusal
from ..input_files import read_json
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from ..theory.limits import as_design
from ..toml_files import problems_of
from .noise import MeasuredSensor

if TYPE_CHECKING:
    from .result import Outcome

FILE, CALIBRATED, SCHEMA = "calibration.json", "calibrated.toml", "roslf.calibration/"
REMEDY = "name the folder that roslf calibrate wrote"


class _LenientTable(BaseModel):
    """Base of what a calibration.json must hold for a report; it may hold more."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)


class _FoundQuantity(_LenientTable):
    """Estimate of one quantity in calibration.json, with its errors."""

    estimate: float
    unit: str
    sigma: Annotated[float, Field(ge=0)]
    interval_68: tuple[float, float]
    interval_95: tuple[float, float]
    variance_shares: dict[str, float]
    r_hat: float | None = None
    ess: float | None = None


class _FoundPosterior(_LenientTable):
    """How its sampling ended."""

    message: str


class _FoundMatrix(_LenientTable):
    """Symmetric matrix of lengths, without negative variances."""

    places: Annotated[tuple[str, ...], Field(min_length=1)]
    matrix: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _square(self) -> Self:
        count = len(self.places)
        if len(self.matrix) != count or any(len(row) != count for row in self.matrix):
            raise ValueError(f"matrix is not {count} x {count}")
        matrix = np.array(self.matrix)
        lengths = np.sqrt(np.maximum(np.diag(matrix), 0))
        unit = np.where(lengths > 0, lengths, 1)
        scaled = matrix / unit / unit[:, None]
        if (np.diag(matrix) < 0).any() or not np.allclose(scaled, scaled.T, atol=1e-6):
            raise ValueError("matrix is no covariance: not symmetric, or below 0 on its diagonal")
        if float(np.linalg.eigvalsh(scaled).min()) < -1e-6:
            raise ValueError("matrix is no covariance: it has a negative variance")
        return self

    @property
    def value(self) -> LengthCovariance:
        """Matrix with its places."""
        return LengthCovariance(self.places, np.array(self.matrix))


class _FoundInformation(_FoundMatrix):
    """Information that measurements alone give of lengths, and what the data sheet knows."""

    sheet_sigma: tuple[Annotated[float, Field(ge=0)] | None, ...]

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if len(self.sheet_sigma) != len(self.places):
            raise ValueError(f"sheet_sigma is not of {len(self.places)} places")
        return self


class _FoundCovariance(_FoundMatrix):
    """How sure its lengths are, together."""

    information: _FoundInformation | None = None
    """Information of measurements; None of an older calibration."""

    def lengths(self) -> CalibratedLengths:
        """Lengths as a value."""
        if (told := self.information) is None:
            return CalibratedLengths(self.value)
        sheet = np.array([np.inf if sigma is None else sigma for sigma in told.sheet_sigma])
        return CalibratedLengths(self.value, told.value, sheet)


class _FoundTable(_LenientTable):
    """A whole calibration.json."""

    schema_: Annotated[str, Field(alias="schema", pattern="^" + re.escape(SCHEMA))]
    design: str
    quantities: dict[str, _FoundQuantity]
    covariance: _FoundCovariance | None = None
    sensor: MeasuredSensor | None = None
    posterior: _FoundPosterior | None = None
    converged: StrictBool | None = None
    images_used: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _enough(self) -> _FoundTable:
        lacking = [name for name in ("H", "d_3") if name not in self.quantities]
        if lacking:
            raise ValueError(f"quantities lacks {', '.join(lacking)}")
        bare = [name for name, row in self.quantities.items() if None in (row.r_hat, row.ess)]
        if bare and self.posterior is not None:
            raise ValueError(f"quantities.{bare[0]} lacks r_hat or ess, of its posterior")
        return self


def calibration_files(outcome: Outcome, text: Callable[[Any], str] = json.dumps) -> tuple[dict[str, bytes], str]:
    """Files that a calibration leaves in its folder, JSON by `text`; and why no camera is among them, else empty."""
    files = {FILE: f"{text(outcome.to_dict())}\n".encode()}
    try:
        used = outcome.used_in
        files[CALIBRATED] = dumps(outcome.calibrated if used is None else used.design, WRITTEN).encode()
    except DesignError as error:
        return files, " ".join(str(error).split())
    return files, ""


def file_in(place: Path) -> Path:
    """The calibration.json of a folder, or what is named itself."""
    return place / FILE if place.is_dir() else place


def read_numbers(place: Path) -> Mapping[str, Any]:
    """Read the calibration.json of a folder, or one that is named itself.

    Raises
    ------
    InputError
        It is not there, or is something else.
    """
    file = file_in(place)
    try:
        data: Mapping[str, Any] = read_json(file, str(file), REMEDY)
        _FoundTable.model_validate_json(json.dumps(data), strict=True)  # no text that reads as a number: data stays
    except ValidationError as error:
        fault = problems_of(error, _FoundTable)[0]
        message = f"{file} is no calibration, or is damaged ({fault}); {REMEDY}"
        raise InputError((Problem("calibration", message),)) from None
    except InputError as error:
        raise InputError((Problem("calibration", str(error)),)) from None
    return data


def calibrated_sensor(place: Path) -> MeasuredSensor | None:
    """Sensor by a calibration's folder; None where its gain was not measured; errors as of `read_numbers`."""
    told = _FoundTable.model_validate(read_numbers(place)).sensor
    return told if told is not None and told.gain is not None and told.gain.value > 0 else None


def calibrated_design(place: Path) -> Design:
    """The camera of a calibration's folder, or of its calibration.json; errors as of `read_numbers`."""
    read_numbers(place)
    return as_design(file_in(place).with_name(CALIBRATED))


def calibrated_camera(place: Path, named: Design | None = None) -> tuple[Design, CalibratedLengths]:
    """The camera of a calibration's folder, or of its calibration.json, and how sure its lengths are.

    Raises
    ------
    InputError
        As of `read_numbers`; the camera of another design than the one `named`; an older calibration, which does
        not tell how its lengths err together; one whose files do not go together.
    """
    data = read_numbers(place)
    file = file_in(place).with_name(CALIBRATED)
    camera = as_design(file)

    if named is not None and named.name not in (data["design"], camera.name):
        raise refusal(
            "calibration", f'{place} is of "{data["design"]}", and the design is "{named.name}"; drop the wrong one'
        )
    together = data.get("covariance")
    if together is None:
        raise refusal(
            "calibration", f"{place} does not state how its lengths err together, as an older one; calibrate again"
        )
    known = Camera.of(camera).numbers
    if strange := [place for place in together["places"] if place not in known]:
        raise refusal("calibration", f"{strange[0]} is no length of {file}; calibrate again")
    return camera, _FoundCovariance.model_validate(together).lengths()
