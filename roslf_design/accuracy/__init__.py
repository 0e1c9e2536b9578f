"""How far every number can be trusted: what each method costs and errs, the choice among them, and the statement.

What measures the table, walks the hard cases and draws the diagrams is the study `studies/accuracy`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach(
    __name__,
    submod_attrs={
        "statement": ["Accuracy", "check_accuracy"],
        "table": ["QUANTITIES", "AccuracyTable", "Choice", "choose", "current_table", "ranked", "shipped_table"],
    },
)
