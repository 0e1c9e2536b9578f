"""A quick stand-in for the report, in a file of its own: a run's process reads little else."""

from roslf_design.design import dumps, load
from roslf_design.errors import refusal


def made_of(design, tell):
    """A design's file for its report; of the paper's none."""
    if design == load("paper"):
        raise refusal("report", "not the design")
    return dumps(design).encode()
