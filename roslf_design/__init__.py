"""Optical design and tolerance explorer for light-field cameras that look through a restricted object space.

>>> import roslf_design as roslf
>>> design = roslf.load("paper")
>>> result = roslf.evaluate(design)

- Designs: `load`, `loads`, `save`, `dumps`, `preset_names`, `Design.replace`.
- What one sees: `evaluate`, `specification`; of many: `evaluate_many`, `sweep`, `Camera` with `quantity`.
- Studies: `optimize`, `tolerance`. Pictures: `render` of a `Scene`, `decode`, `measure_depth`, `capture_depth`.
- The built camera: `calibrate`, `bench_check`, `bench_report`. To hand on: `datasheet`, `report`,
  `render_html`, `render_pdf`.

What takes long is told to `progress=`, by all in the same way; `ProgressLine` shows it.

What is wrong with an input is an `InputError`, of a design a `DesignError`; both are `ValueError`.

Names below are imported when first used (SPEC 1), so that `import roslf_design` costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader as lazy

from ._version import __version__

if TYPE_CHECKING:
    from .api import (
        bench_check,
        bench_report,
        calibrate,
        capture_depth,
        datasheet,
        decode,
        measure_depth,
        optimize,
        quantity,
        render,
        report,
        tolerance,
    )
    from .camera import Camera
    from .commands.progress_line import ProgressLine
    from .design import Design, DesignError, dumps, load, loads, preset_names, save
    from .errors import InputError
    from .evaluation import Evaluation, evaluate
    from .evaluation.many import evaluate_many
    from .evaluation.specification import Specification, specification
    from .evaluation.sweep import Sweep, sweep
    from .reporting.printers import render_html, render_pdf
    from .scenes import Scene
    from .theory.quantities import QUANTITIES
    from .theory.quantity import Quantity
    from .theory.quantity_table import QuantityTable

__all__ = [
    "QUANTITIES",
    "Camera",
    "Design",
    "DesignError",
    "Evaluation",
    "InputError",
    "ProgressLine",
    "Quantity",
    "QuantityTable",
    "Scene",
    "Specification",
    "Sweep",
    "__version__",
    "bench_check",
    "bench_report",
    "calibrate",
    "capture_depth",
    "datasheet",
    "decode",
    "dumps",
    "evaluate",
    "evaluate_many",
    "load",
    "loads",
    "measure_depth",
    "optimize",
    "preset_names",
    "quantity",
    "render",
    "render_html",
    "render_pdf",
    "report",
    "save",
    "specification",
    "sweep",
    "tolerance",
]

__getattr__, __dir__, _ = lazy.attach(
    __name__,
    submod_attrs={
        "api": [
            "bench_check",
            "bench_report",
            "calibrate",
            "capture_depth",
            "datasheet",
            "decode",
            "measure_depth",
            "optimize",
            "quantity",
            "render",
            "report",
            "tolerance",
        ],
        "camera": ["Camera"],
        "commands.progress_line": ["ProgressLine"],
        "design": ["Design", "DesignError", "dumps", "load", "loads", "preset_names", "save"],
        "errors": ["InputError"],
        "evaluation": ["Evaluation", "evaluate"],
        "evaluation.many": ["evaluate_many"],
        "evaluation.specification": ["Specification", "specification"],
        "evaluation.sweep": ["Sweep", "sweep"],
        "reporting.printers": ["render_html", "render_pdf"],
        "scenes": ["Scene"],
        "theory.quantities": ["QUANTITIES"],
        "theory.quantity": ["Quantity"],
        "theory.quantity_table": ["QuantityTable"],
    },
)
