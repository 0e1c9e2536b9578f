"""Everything that `roslf evaluate` says of a design."""

from .evaluate import evaluate
from .fields import default_fields
from .result import Evaluation

__all__ = ["Evaluation", "default_fields", "evaluate"]
