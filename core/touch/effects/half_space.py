"""An elastic pad in place of a bed of springs: pressure here presses the face down there too."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pad import FaceModel, half_space_influence
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage

TOLERANCE = 1e-7  # Largest error of the face within the contact, over the deepest indentation
MOST_STEPS = 1000  # Thirty are usual at 16 by 16 taxels, a hundred at 32 by 32
EXPANSION = 1.9  # Of a projected step, over the largest stiffness of the scaled problem: below 2


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfSpace(Ranged):
    """The pad as an elastic half-space, touched without friction.

    Find ``p >= 0`` with ``u = K p``, ``u = g`` where ``p > 0`` and ``u >= g`` elsewhere: the rigid
    surface indents the face by ``g``, and the free face about the contact is drawn down. ``K`` is
    the displacement under uniformly loaded squares (Love, 1929; Johnson, *Contact mechanics*, 1985,
    3.3). On a sphere this is Hertz's contact, whose radius is 0.71 of that of a bed of springs. It
    replaces the springs' pressures, so it matters for forces, which then no longer tell the
    compression by (1.2), and for what is touched around a contact; the truth for a thin bonded pad
    lies between the two.
    """

    phase: ClassVar = Phase.PAD

    # Young's modulus: that of a soft silicone, an engineering value.
    modulus: Annotated[float, Range(1e4, 1e8, "N/m2")] = 0.5e6
    # Poisson's ratio: rubber keeps its volume.
    poisson: Annotated[float, Range(0.0, 0.5, "1")] = 0.49

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger.

        Its act raises `ArithmeticError` if the contact is not found within `MOST_STEPS`.
        """
        size = (finger.pad.rows, finger.pad.cols)
        kernel = half_space_influence(finger.pad)
        # No part of a matrix of positive numbers has a larger norm than its largest row sum.
        most = float(kernel.sum(axis=1).max())
        kernel /= most
        stiffness = math.pi * self.modulus / ((1.0 - self.poisson**2) * most)

        def apply(touch: SimulatedTouch, state: None) -> None:
            indentation = touch.indentation.ravel()
            near = np.flatnonzero(indentation > 0.0)  # Elsewhere it can only be too far from it
            if not near.size:
                return
            columns, deepest = kernel[near], float(indentation.max())
            pushed = _contact(columns[:, near], indentation[near] / deepest)
            pressure = np.zeros(indentation.size)
            pressure[near] = (deepest * stiffness) * pushed
            face = np.maximum(deepest * (pushed @ columns), indentation)
            touch.pressure, touch.compression = pressure.reshape(size), face.reshape(size)

        return Stage(apply, face=FaceModel("half_space"))


def _contact(kernel: Floats, wanted: Floats) -> Floats:
    """The x >= 0, (n,), with ``K x = wanted`` where x > 0 and ``K x >= wanted`` elsewhere.

    Conjugate gradients on the taxels that push; where one would pull, a projected gradient step;
    where the face is held off too little by those that do not push, a step that lets them. Each
    lowers the energy, so that it always converges: Dostal and Schoberl, *Minimizing quadratic
    functions subject to bound constraints*, 2005.
    """
    x: Floats = wanted / kernel.sum(axis=1)
    slope = kernel @ x - wanted
    free = direction = slope
    for _ in range(MOST_STEPS):
        held = np.where(x > 0.0, 0.0, np.minimum(slope, 0.0))
        worst = max(float(np.abs(free).max()), -float(held.min()))
        if worst <= TOLERANCE:
            return x
        release = held @ held > np.minimum(x / EXPANSION, free) @ free
        if release:
            direction = held
        image = kernel @ direction
        bend = float(direction @ image)
        step = float(slope @ direction) / bend
        falls = direction > 0.0
        longest = float((x[falls] / direction[falls]).min(initial=np.inf))
        if step < longest:
            x, slope = np.maximum(x - step * direction, 0.0), slope - step * image
            free = np.where(x > 0.0, slope, 0.0)
            direction = free if release else free - (float(free @ image) / bend) * direction
        else:
            x, slope = np.maximum(x - longest * direction, 0.0), slope - longest * image
            x = np.maximum(x - EXPANSION * np.where(x > 0.0, slope, 0.0), 0.0)
            slope = kernel @ x - wanted
            free = direction = np.where(x > 0.0, slope, 0.0)
    raise ArithmeticError(
        f"half_space found no contact within {MOST_STEPS} steps: the face is still off by "
        f"{worst:.3g} of the indentation; expected {TOLERANCE:g}"
    )
