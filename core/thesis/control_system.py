"""The control points that pass given points: Fung, 1999, (4.23) to (4.26), as printed.

Points of a surface lie on the boundary of the parameter space, where most control points have no
influence: but for rounding the system is then singular, so that the thesis builds shell and core
instead. The solution states its condition number; where that leaves no digit it is refused.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core import splines
from palpate.core.arrays import finite_array

MIN_COUNT = splines.CUBIC + 1  # along an axis, for a cubic spline


class ControlSolution(NamedTuple):
    """Control points of a deformed lattice."""

    volume: splines.SplineVolume  # control points (l, m, n, 3) over clamped cubic bases
    condition: float  # condition number of the system
    rms: float  # root mean square distance from the points, in their unit


def solve_control_points(
    points: ArrayLike,
    parameters: ArrayLike,
    shape: tuple[int, int, int],
    *,
    max_condition: float = 1e12,
) -> ControlSolution:
    """Least squares of (4.25): a lattice of `shape` (l, m, n) through points (k, 3).

    `parameters` (k, 3): their triples (s, t, u), from 0 to 1. Raises ValueError if an argument has
    another form, there are fewer points than control points, or the condition number is above
    `max_condition`: at the default about four of sixteen digits are exact.
    """
    targets = finite_array("points", points, (None, 3))
    triples = finite_array("parameters", parameters, (len(targets), 3))
    if triples.min(initial=0.0) < 0.0 or triples.max(initial=0.0) > 1.0:
        raise ValueError("parameters must lie between 0 and 1")
    if len(shape) != 3 or min(shape) < MIN_COUNT:
        raise ValueError(f"shape must be three numbers of at least {MIN_COUNT}, got {shape}")
    unknowns = int(np.prod(shape))
    if len(targets) < unknowns:
        raise ValueError(
            f"there must be at least as many points as control points, {unknowns}, "
            f"got {len(targets)}"
        )
    s, t, u = (splines.clamped_basis(count) for count in shape)
    across, up, along = (
        basis.matrix(triples[:, axis]).toarray() for axis, basis in enumerate((s, t, u))
    )
    system = np.einsum("pi,pj,pk->pijk", across, up, along).reshape(len(targets), unknowns)
    left, sizes, right = np.linalg.svd(system, full_matrices=False)
    condition = float(sizes[0] / sizes[-1]) if sizes[-1] > 0.0 else float("inf")
    if condition > max_condition:
        raise ValueError(
            f"(4.25) has the condition number {condition:.0e} for {unknowns} control points, and "
            f"at most {max_condition:.0e} is solved: the points do not determine them; "
            "rebuild_thesis builds shell and core instead"
        )
    control = right.T @ ((left.T @ targets) / sizes[:, None])
    volume = splines.SplineVolume(control.reshape(*shape, 3), (s, t, u))
    residuals = volume.at(triples) - targets
    return ControlSolution(volume, condition, float(np.sqrt((residuals**2).sum(axis=1).mean())))
