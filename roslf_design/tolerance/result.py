"""Everything a study found: frozen values, and the JSON object made of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..json_data import null_unless_finite
from .plan import Plan
from .precision import Precision
from .sensitivity import Allowed, Sensitivity
from .sobol import SobolIndices
from .study import Study
from .summary import Distribution, Variant
from .tally import Tally
from .yields import Yield

if TYPE_CHECKING:
    from .trace_check import TraceCheck

Array = NDArray[np.float64]

SCHEMA = "roslf.tolerance/1"
LINEAR = 0.1
"""|RSS / Monte Carlo - 1| above which a response counts as not linear."""


@dataclass(frozen=True)
class RssRow:
    """Root sum of squares beside Monte Carlo, as built."""

    label: str
    rss: float
    monte_carlo: float
    """Standard deviation; NaN where trials are undefined."""
    shift: float
    """Mean less nominal: 0 for a linear response."""

    @property
    def ratio(self) -> float:
        """Monte Carlo over RSS; infinite where only Monte Carlo scatters."""
        if self.rss > 0:
            return self.monte_carlo / self.rss
        return math.inf if self.monte_carlo > 0 else 1.0

    @property
    def linear(self) -> bool:
        """Whether the RSS figure may be used."""
        return abs(self.ratio - 1) <= LINEAR and abs(self.shift) <= LINEAR * max(self.rss, 1e-300)


@dataclass(frozen=True)
class GradeYield:
    """The study with another grade."""

    grade: str
    result: Yield


@dataclass(frozen=True)
class WorstTrial:
    """A trial that exceeds its limits most."""

    number: int
    score: float
    """How far, in units of what the limit allows: 1 is at the limit; infinite where something is undefined."""
    file: str
    """Its design file; empty where its numbers make no design."""


@dataclass(frozen=True)
class StudyResult:
    """Results of a study."""

    plan: Plan
    study: Study
    tally: Tally
    variants: tuple[Variant, ...]
    """As built; then, where anything is adjusted, after adjustment (last: what counts)."""
    sensitivity: Sensitivity
    rss: tuple[RssRow, ...]
    sobol: SobolIndices | None
    allowed: tuple[Allowed, ...]
    """Inverse sensitivity; empty where the nominal design misses a limit."""
    yield_curve: tuple[tuple[float, Yield], ...]
    scale_for_target: tuple[float, Yield] | None
    """Common factor on all tolerances that meets the wanted yield."""
    grades: tuple[GradeYield, ...]
    correlations: Array
    """Columns with perturbations, shape (C, P)."""
    worst: tuple[WorstTrial, ...]
    warnings: tuple[str, ...]
    precision: Precision | None = None
    """Standard errors of the run; None where nobody asked."""
    lens: TraceCheck | None = None
    """How a real main lens was traced, and how exactly; None where it is ideal."""

    @property
    def final(self) -> Variant:
        """The variant that counts."""
        return self.variants[-1]

    def to_dict(self) -> dict[str, Any]:
        """The JSON object; what is not finite is None."""
        plan = self.plan
        columns = [column.label for column in plan.columns]
        places = [p.place for p in plan.draws.perturbations]
        low, high = self.final.result.interval
        data = {
            "schema": SCHEMA,
            "study": plan.name,
            "design": plan.question.design.name,
            "digest": plan.digest(),
            "seed": plan.draws.seed,
            "sampling": plan.draws.sampling,
            "trials": plan.trials,
            "fields_mm": [list(field) for field in plan.question.fields],
            "object_distance_mm": plan.question.object_distance,
            "accuracy": None if self.precision is None else self.precision.to_dict(),
            "real_lens": None if self.lens is None else self.lens.to_dict(),
            "yield": {"value": self.final.result.value, "interval_95": [low, high], "of": self.final.name},
            "perturbations": [_perturbation(p) for p in plan.draws.perturbations],
            "groups": [{"group": name, "correlation": rho} for name, rho in plan.draws.correlations],
            "variants": [_variant(variant) for variant in self.variants],
            "sensitivity": {
                "columns": columns,
                "places": places,
                "derivative": self.sensitivity.derivatives.tolist(),
                "exact": self.sensitivity.exact.tolist(),
                "variants": [variant.name for variant in self.variants],
                "at_plus": self.sensitivity.plus.tolist(),
                "at_minus": self.sensitivity.minus.tolist(),
            },
            "rss": [
                {
                    "column": row.label,
                    "rss": row.rss,
                    "monte_carlo": row.monte_carlo,
                    "ratio": row.ratio,
                    "mean_shift": row.shift,
                    "linear": row.linear,
                }
                for row in self.rss
            ],
            "sobol": None if self.sobol is None else _sobol(self.sobol, columns),
            "inverse_sensitivity": [
                {"place": a.place, "tolerance": a.tolerance, "given": a.given, "limited_by": a.limited_by}
                for a in self.allowed
            ],
            "yield_curve": [{"scale": scale, **_yield(result)} for scale, result in self.yield_curve],
            "inverse_by_yield": None
            if self.scale_for_target is None
            else {
                "target": self.study.yield_target,
                "scale": self.scale_for_target[0],
                **_yield(self.scale_for_target[1]),
                "tolerances": {p.place: p.tolerance * self.scale_for_target[0] for p in plan.draws.perturbations},
            },
            "grades": [{"grade": grade.grade, **_yield(grade.result)} for grade in self.grades],
            "correlations": {"columns": columns, "places": places, "values": self.correlations.tolist()},
            "worst": [{"trial": w.number, "score": w.score, "file": w.file} for w in self.worst],
            "warnings": list(self.warnings),
        }
        finite: dict[str, Any] = null_unless_finite(data)
        return finite


def _perturbation(p: Any) -> dict[str, Any]:
    return {
        "place": p.place,
        "nominal": p.nominal,
        "tolerance": p.tolerance,
        "distribution": p.distribution,
        "sigma": p.sigma,
        "group": p.group,
        "opposed": p.opposed,
        "source": p.source,
    }


def _yield(result: Yield) -> dict[str, Any]:
    return {"yield": result.value, "interval_95": list(result.interval), "trials": result.trials}


def _variant(variant: Variant) -> dict[str, Any]:
    return {
        "name": variant.name,
        **_yield(variant.result),
        "limits": [
            {"column": limit.label, "min": limit.low, "max": limit.high, **_yield(limit.result)}
            for limit in variant.limits
        ],
        "distributions": [_distribution(column) for column in variant.distributions],
    }


def _distribution(column: Distribution) -> dict[str, Any]:
    return {
        "column": column.label,
        "nominal": column.nominal,
        "undefined_trials": column.undefined,
        "mean": column.mean,
        "standard_deviation": column.deviation,
        "least": column.low,
        "greatest": column.high,
        "quantiles": {f"{p:g}": q for p, q in zip(column.probabilities, column.quantiles, strict=True)},
        "histogram": {"cuts": list(column.cuts), "trials": list(column.histogram)},
    }


def _sobol(found: SobolIndices, columns: list[str]) -> dict[str, Any]:
    return {
        "columns": columns,
        "factors": list(found.factors),
        "evaluations": found.evaluations,
        "first": found.first.tolist(),
        "first_interval_95": found.first_interval.tolist(),
        "total": found.total.tolist(),
        "total_interval_95": found.total_interval.tolist(),
        "undefined_evaluations": found.undefined.tolist(),
    }
