"""What every way of fitting a closed curve gives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis
from palpate.core.splines.knots import CUBIC


class CurveFit(NamedTuple):
    """A closed cubic B-spline that was fitted to points."""

    control: Floats
    """(n, d)."""
    knots: Floats
    """(n + 7,), the domain from 0 to 1; the first 3 control points come again at the end."""
    parameters: Floats
    """(m,), those of the points, in turns."""
    condition: float
    """Condition number of the matrix from control points to points and bending."""
    effective: float
    """Degrees of freedom that were spent on each coordinate."""
    smoothing: float
    """Weight of the bending against the mean weight of the points."""


def closed_places(control: Floats, knots: Floats, turns: Floats, derivative: int = 0) -> Floats:
    """Points (k, d) of a closed cubic, or derivatives, at parameters (k,) from 0 to 1."""
    # About its middle, so that little is rounded where the curve is small and far away.
    middle = control.mean(axis=0)
    wound = np.vstack([control, control[:CUBIC]]) - middle
    values: Floats = Basis(knots, CUBIC).matrix(turns, derivative) @ wound
    return values if derivative else values + middle
