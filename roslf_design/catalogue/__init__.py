"""The catalogue: parts that can be bought, found by conditions, and named by designs."""

from .conditions import parse_condition, read_condition
from .entries import KINDS, Catalogue, Entry, Kind, load_catalogue, rows

__all__ = [
    "KINDS",
    "Catalogue",
    "Entry",
    "Kind",
    "load_catalogue",
    "parse_condition",
    "read_condition",
    "rows",
]
