"""The fuzzy planner: nine rules in words, as section 6.1 of the thesis asks for.

A curvature may be somewhat small and somewhat medium, and so may its change. Each rule weighs as
much as the less true of its two words, and the step is the weighted mean of the rules' steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from palpate.core.explore.planners.protocol import Choice, Observation
from palpate.core.explore.planners.thesis import step_search
from palpate.core.plugins import Range, Ranged

WORDS = ("small", "medium", "large")


@dataclass(frozen=True, slots=True, kw_only=True)
class FuzzySettings:
    """What the words of the rules mean."""

    # Where "small", "medium" and "large" are wholly true of the mean curvature times the height.
    curvatures: tuple[float, float, float] = (1.0, 4.0, 10.0)
    changes: tuple[float, float, float] = (0.5, 2.0, 6.0)  # the same of its change
    # [height of the object] steps of the rules
    wide: float = 0.25
    fair: float = 0.16
    short: float = 0.1
    tiny: float = 0.05


RULES: Mapping[tuple[str, str], str] = {
    # curvature, change: name of the step
    ("small", "small"): "wide",
    ("small", "medium"): "fair",
    ("small", "large"): "short",
    ("medium", "small"): "fair",
    ("medium", "medium"): "short",
    ("medium", "large"): "tiny",
    ("large", "small"): "short",
    ("large", "medium"): "short",
    ("large", "large"): "tiny",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Fuzzy(Ranged):
    """Steps by the rules; `scale` makes all of them longer or shorter."""

    scale: Annotated[float, Range(0.1, 2.0, "1")] = 1.0  # of all steps
    # A contour shorter than this fraction of the height ends the search.
    perimeter: Annotated[float, Range(0.0, 1.0, "1")] = 0.1

    def next(self, observation: Observation) -> Choice:
        """The next slice of the search, or that it has ended."""
        return step_search(observation, self, self.perimeter)

    def first(self, curvature: float) -> float:
        """Step from half height, over the height: as if nothing had changed."""
        return self.later(curvature, 0.0, 0)

    def later(self, curvature: float, change: float, count: int) -> float:
        """Any other step, over the height."""
        settings = FuzzySettings()
        of_curvature = truths(curvature, settings.curvatures)
        of_change = truths(change, settings.changes)
        weights = {rule: min(of_curvature[rule[0]], of_change[rule[1]]) for rule in RULES}
        steps = sum(weight * getattr(settings, RULES[rule]) for rule, weight in weights.items())
        return self.scale * float(steps) / sum(weights.values())


def truths(value: float, peaks: tuple[float, float, float]) -> dict[str, float]:
    """How true each word is of a value, from 0 to 1; their sum is 1."""
    hats = [float(np.interp(value, peaks, hat)) for hat in np.eye(len(peaks))]
    return dict(zip(WORDS, hats, strict=True))
