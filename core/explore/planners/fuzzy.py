"""The fuzzy planner: nine rules in words, as the thesis' section 6.1 wishes for.

A curvature is somewhat small and somewhat medium, and so is its change; each rule counts as far as
both of its words are true, and the step is the mean of what the rules say.
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
BEND = (1.0, 4.0, 10.0)  # Mean curvature times height at which each word is wholly true
CHANGE = (0.5, 2.0, 6.0)  # Of its change
STEP: Mapping[str, float] = {"wide": 0.25, "fair": 0.16, "short": 0.1, "tiny": 0.05}  # Of height
RULES: Mapping[tuple[str, str], str] = {
    # curvature, change: step
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

    scale: Annotated[float, Range(0.1, 2.0, "1")] = 1.0  # Of all steps
    # A contour shorter than this share of the height ends the search.
    perimeter: Annotated[float, Range(0.0, 1.0, "1")] = 0.1

    def next(self, observation: Observation) -> Choice:
        """The next slice of the search, or that it has ended."""
        return step_search(observation, self, self.perimeter)

    def first(self, bend: float) -> float:
        """Step from half height, over the height: as if nothing had changed."""
        return self.later(bend, 0.0, 0)

    def later(self, bend: float, change: float, count: int) -> float:
        """Any other step, over the height."""
        bends, changes = truths(bend, BEND), truths(change, CHANGE)
        weights = {rule: min(bends[rule[0]], changes[rule[1]]) for rule in RULES}
        steps = sum(weight * STEP[RULES[rule]] for rule, weight in weights.items())
        return self.scale * steps / sum(weights.values())


def truths(value: float, peaks: tuple[float, float, float]) -> dict[str, float]:
    """How true each word is of a value, from 0 to 1; they add up to 1."""
    hats = [float(np.interp(value, peaks, hat)) for hat in np.eye(len(peaks))]
    return dict(zip(WORDS, hats, strict=True))
