"""The learned planner: steps by a small neural network, as section 6.1 of the thesis asks for.

The network maps curvature, its change and the tolerance to the longest step after which the side
between two slices was accurate enough, on drawn objects. `palpate.bench.step_training` draws the
objects, trains the network, and prints the numbers below. The planner searches as the thesis does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.protocol import Choice, Observation
from palpate.core.explore.planners.thesis import step_search
from palpate.core.plugins import Range, Ranged


class StepNetwork(NamedTuple):
    """A network with one hidden layer of hyperbolic tangents."""

    inward: Floats  # (3, m) from the three inputs
    offset: Floats  # (m,)
    outward: Floats  # (m,)
    bias: float
    min_step: float = 0.02  # fraction of the object's height
    max_step: float = 0.4  # fraction of the object's height

    def steps(self, curvatures: Floats, changes: Floats, tolerances: Floats) -> Floats:
        """Steps (n,) over the height.

        `curvatures` (n,): mean absolute curvatures along the height, times the height. `changes`
        (n,): their differences from the slice before. `tolerances` (n,): over the height.
        """
        inputs = network_inputs(curvatures, changes, tolerances)
        hidden = np.tanh(inputs @ self.inward + self.offset)
        share = 1.0 / (1.0 + np.exp(-(hidden @ self.outward + self.bias)))
        return np.asarray(self.min_step * (self.max_step / self.min_step) ** share)


def network_inputs(curvatures: Floats, changes: Floats, tolerances: Floats) -> Floats:
    """Inputs of the network (n, 3), of the order of 1; arguments as of `StepNetwork.steps`."""
    return np.column_stack([np.log1p(curvatures), np.log1p(changes), np.log10(tolerances) + 3.0])


TRAINED = StepNetwork(
    inward=np.array([
        [0.258, -0.255, -0.733, -0.208, 0.28, 0.277],
        [-0.281, 0.274, 1.618, 0.289, -0.278, -0.272],
        [-0.327, 0.34, 0.409, 0.485, -0.313, -0.29],
    ]),
    offset=np.array([-0.054, 0.041, -0.336, -0.124, -0.082, -0.105]),
    outward=np.array([-0.706, 0.69, -0.986, 0.77, -0.702, -0.698]),
    bias=0.529,
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Learned(Ranged):
    """Steps by the network; `scale` makes all of them longer or shorter."""

    scale: Annotated[float, Range(0.1, 2.0, "1")] = 1.0  # of all steps
    # A contour shorter than this fraction of the height ends the search.
    perimeter: Annotated[float, Range(0.0, 1.0, "1")] = 0.1

    def next(self, observation: Observation) -> Choice:
        """The next slice of the search, or that it has ended."""
        tolerance = observation.tolerance / observation.extent
        return step_search(observation, LearnedSteps(tolerance, self.scale), self.perimeter)


class LearnedSteps(NamedTuple):
    """The step rule for one tolerance."""

    tolerance: float  # over the height
    scale: float

    def first(self, curvature: float) -> float:
        """Step from half height, over the height: as if nothing had changed."""
        return self.later(curvature, 0.0, 0)

    def later(self, curvature: float, change: float, count: int) -> float:
        """Any other step, over the height."""
        inputs = (np.array([value]) for value in (curvature, change, self.tolerance))
        return self.scale * float(TRAINED.steps(*inputs)[0])
