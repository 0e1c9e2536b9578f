"""The page and pictures of an optimisation; loaded by whoever optimises."""

from __future__ import annotations

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach(
    __name__, submod_attrs={"pages": ["optimization_finding", "statements"], "run": ["run_optimisation"]}
)
