"""What studies found of a design, to stand in its report beside what closed forms and rays say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from .blocks import Section, Statement
from .calibrated import Calibrated, calibrated_section, calibrated_statement

if TYPE_CHECKING:
    from ..calibration.planning import CapturePlan as Plan
    from ..design import Design
    from ..optimize.run import Result
    from ..tolerance.result import StudyResult


@dataclass(frozen=True, eq=False)
class Evidence:
    """What there is; None where nothing of the kind was done."""

    optimisation: Result | None = None
    tolerances: StudyResult | None = None
    calibration: Plan | Calibrated | str | None = None
    """A plan, what was calibrated, or why there is no plan."""
    f_known: str = "1 %"
    """How well the plan takes f to be known."""

    def statements(self) -> Iterator[Statement]:
        """The answers of each, for the summary."""
        if self.optimisation is not None:
            from ..optimize.section import statements

            first = next(iter(statements(self.optimisation)))
            yield replace(first, text=f"Optimisation: {first.text[:1].lower()}{first.text[1:]}")
        if self.tolerances is not None:
            yield yield_statement(self.tolerances)
        if isinstance(self.calibration, Calibrated):
            yield calibrated_statement(self.calibration)
        elif self.calibration is not None and not isinstance(self.calibration, str):
            from .calibration_plans import plan_statement

            yield plan_statement(self.calibration)

    def sections(self, design: Design) -> Iterator[Section]:
        """A section of each."""
        if self.optimisation is not None:
            from ..optimize.section import optimize_section
            from .sheets import history_sheet

            told = optimize_section(self.optimisation)
            history = [history_sheet(self.optimisation.answer)] if self.optimisation.answer.feasible else []
            yield Section("Optimisation", (*told.blocks, *history), "optimisation")
        if self.tolerances is not None:
            from ..tolerance.section import tolerance_section

            yield Section("Tolerances and yield", tolerance_section(self.tolerances).blocks, "tolerances")
        if isinstance(self.calibration, Calibrated):
            yield calibrated_section(design, self.calibration)
        elif self.calibration is not None:
            from .calibration_plans import calibration_section, no_plan

            plan = self.calibration
            yield no_plan(plan) if isinstance(plan, str) else calibration_section(design, plan, self.f_known)

    @property
    def seeds(self) -> tuple[str, ...]:
        """Of everything that chance had a part in."""
        found = []
        if self.optimisation is not None:
            found.append(f"Seed of the optimisation's starts: {self.optimisation.study.settings.seed}.")
        if self.tolerances is not None:
            plan = self.tolerances.plan
            found.append(f"Seed of the {plan.trials} builds: {plan.draws.seed}.")
        return tuple(found)


def yield_statement(result: StudyResult) -> Statement:
    """A study's yield as an answer, with what would mend it."""
    from ..tolerance.section import headline

    value, target = result.final.result.value, result.study.yield_target
    text = f"{headline(result)}; wanted {100 * target:.4g} % ({result.plan.name})."
    if value >= target:
        return Statement("good", text)
    if result.scale_for_target is None:
        return Statement("bad", text, "No tolerance is tight enough: change the nominal design or the limits.")
    factor = result.scale_for_target[0]
    return Statement("bad", text, f"Tighten all tolerances to {factor:.3g} of what they are, or the worst few.")
