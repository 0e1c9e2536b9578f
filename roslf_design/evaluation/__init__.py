"""Everything that `roslf evaluate` says of a design."""

from .evaluate import evaluate
from .fields import default_fields
from .many import evaluate_many
from .result import Evaluation

__all__ = ["Evaluation", "default_fields", "evaluate", "evaluate_many"]
