"""Evaluate one design: verdicts, closed forms, microlens images over the field, effects."""

from .compute import default_fields, evaluate
from .result import Evaluation

__all__ = ["Evaluation", "default_fields", "evaluate"]
