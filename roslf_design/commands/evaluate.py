"""`roslf evaluate`."""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter

from ..design import Design
from ..errors import refusal
from ..evaluation import evaluate as compute
from ..evaluation.evaluate import evaluation_accuracy
from ..evaluation.field_images import FieldImages
from ..evaluation.fields import FIELD_NAMES, MOST_FIELDS, Place, default_fields
from ..evaluation.required import required_distances
from ..evaluation.result import Evaluation, field_table, print_evaluation, print_short
from ..evaluation.specification import specification
from ..tables import csv_bytes
from ..theory.limits import as_design
from ..units import FARTHEST, read_quantity
from .terminal import (
    DesignName,
    Distances,
    Flat,
    Json,
    OptionalOutput,
    check_target,
    json_text,
    read_distances,
    say,
    write_file,
)


@dataclass(frozen=True)
class _Told:
    """Extent to which an evaluation is printed, and how the command ends."""

    everything: Annotated[bool, Parameter(name="--all", negative=())] = False
    """Print all of it: every verdict in full with its remedy, the tables, the effects. Default: a screen of first
    answers and verdicts in brief."""
    strict: Annotated[bool, Parameter(negative=())] = False
    """End with exit code 1 where the design misses something that its [required] asks for. Default: 0; a verdict is an
    answer, no error."""

    def exit_code(self, result: Evaluation) -> int:
        """Exit code after an answer."""
        return int(self.strict and not all(one.met for one in result.required))


BRIEFLY = _Told()


def evaluate(
    design: DesignName,
    /,
    *,
    field: Annotated[list[str] | None, Parameter(allow_leading_hyphen=True, negative=())] = None,
    at: Distances = None,
    temperature: Annotated[str | None, Parameter(allow_leading_hyphen=True, negative=())] = None,
    told: Annotated[_Told, Flat] = BRIEFLY,
    json: Json = False,
    output: OptionalOutput = None,
    accuracy: float | None = None,
) -> int:
    """Verdicts on a camera and its numbers: what it sees, how deep it measures, what is wrong, what would mend it.

    Parameters
    ----------
    field
        Place of a microlens on the array in mm, along x ("11.15") or "x,y", or "centre", "edge" or "corner" of what
        the sensor sees, whose image is reported; may be given several times. Default: these three.
    at
        Distance ahead of the tip, as "10mm", that the first lines report beside the focal plane; may be given several
        times. Default: those that [required] names.
    temperature
        Of the camera, as "37degC". Default: what the design's [environment] says, else 20 degC.
    output
        Write all numbers to this file instead, as .json, or as .csv for spreadsheets: a row for each, by its place in
        the JSON.
    accuracy
        What shares of light may be off by where parts are tilted and rays are counted, as 1e-4. Default: 0.002.
        Straight designs are exact.
    """
    if output is not None:
        check_target(output, (".json", ".csv"))
        if json:
            raise refusal("json", "prints what -o writes; give one of them")
    if field is not None and len(field) > MOST_FIELDS:
        raise refusal(
            "field", f"given {len(field)} times; give {MOST_FIELDS} fields at most, the others in another run"
        )
    began = time.perf_counter()
    loaded = as_design(design)
    fields = None if field is None else [parse_field(text, loaded) for text in field]
    if temperature is not None:
        loaded = loaded.at_temperature(_parse_temperature(temperature))
    distances = read_distances(at) if at else sorted(required_distances(loaded, FARTHEST["length"]))
    shown = FieldImages.of(loaded)
    result = compute(loaded, fields, accuracy, at=distances, shown=shown)
    ending = told.exit_code(result)
    statement = evaluation_accuracy(loaded, result, accuracy, time.perf_counter() - began)
    if json or output is not None:
        # Without an accuracy asked for, nothing that differs from run to run.
        sheet = {"specification": specification(loaded, distances, shown).to_dict()}
        data = result.to_dict() | sheet | {"accuracy": statement.to_dict(times=accuracy is not None)}
        if output is None:
            print(json_text(data))
            return ending
        as_table = output.suffix.lower() == ".csv"
        content = csv_bytes([("key", "value"), *rows(data)]) if as_table else f"{json_text(data)}\n".encode()
        write_file(output, content)
        say(output)
        return ending
    from rich.console import Console

    if told.everything:
        print_evaluation(result, Console(), shlex.quote(str(design)))
    else:
        print_short(result, Console(), [] if fields is None else [field_table(result)], design=shlex.quote(str(design)))
    if accuracy is not None:
        print(f"\n{statement.sentence()}")
    return ending


def rows(data: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Numbers and texts of nested values, each with its place, as "fields.0.kept_fraction"."""
    if isinstance(data, Mapping):
        items: Iterable[tuple[Any, Any]] = data.items()
    elif isinstance(data, list):
        items = enumerate(data)
    else:
        yield place, data
        return
    for key, inner in items:
        yield from rows(inner, f"{place}.{key}".lstrip("."))


def _parse_temperature(text: str) -> float:
    """Read "37degC" [degrees C]; refused where it is none."""
    try:
        return read_quantity(text, "temperature")
    except ValueError as error:
        raise refusal("temperature", str(error)) from None


def parse_field(text: str, design: Design) -> Place:
    """Read "11.15", "x,y" or "corner" as a position on the MLA [mm]; refused where it is none a camera can have."""
    if text in FIELD_NAMES:
        return default_fields(design)[FIELD_NAMES.index(text)]
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not all(abs(number) <= FARTHEST["length"] for number in numbers):
        raise refusal("field", f'cannot read "{text}"; write mm on the MLA, as "11.15" or "11.15,7.4", or corner')
    return numbers[0], numbers[1] if len(numbers) == 2 else 0.0
