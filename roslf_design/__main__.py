"""`python -m roslf_design` is `roslf`."""

from .cli import run

run()
