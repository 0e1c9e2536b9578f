"""Physical effects: how large each is for a design and scene, which of them a rendering calls for."""

from .effect import WHITE, Effect, Estimate, SceneBrief, Subject
from .plan import EFFECTS, Budget, Plan, PlanError, PlannedEffect, plan

__all__ = [
    "EFFECTS",
    "WHITE",
    "Budget",
    "Effect",
    "Estimate",
    "Plan",
    "PlanError",
    "PlannedEffect",
    "SceneBrief",
    "Subject",
    "plan",
]
