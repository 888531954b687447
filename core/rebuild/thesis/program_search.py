"""The search for the largest ellipse as the thesis's program has it: buildgrid.m and isint.m.

Kept for comparison, as printed. It takes the edges of a polygon for infinite lines, looks at the
first few of them, loses a sign on the way, and moves on to places that it has not tested.
`inscribed_ellipse.ellipse_scale` has the answer.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats

MOST_STEPS = 50
TOLERANCE = 1e-6
"""Of the scale, and its least value."""


def searched_scale(polygon: Floats, middle: Floats, semi_axes: Floats, edges: int) -> float:
    """Factor of an ellipse's semi-axes that the program finds.

    Parameters
    ----------
    polygon : (n, 2) array
        Closed.
    middle, semi_axes : (2,) arrays
        Of the ellipse.
    edges : int
        How many of the polygon's edges are tested.

    Notes
    -----
    Table 4.2 asks at each step whether two ellipses meet an edge. Meeting a line is monotone
    in the scale, so that one number for each edge answers every such question.
    """
    least_met = _least_met(polygon, middle, semi_axes, edges)
    fibonacci = [1.0, 1.0]
    while len(fibonacci) < MOST_STEPS:
        fibonacci.append(fibonacci[-1] + fibonacci[-2])
    low, high = TOLERANCE, 1.0
    for count in range(1, MOST_STEPS - 1):
        if high - low <= TOLERANCE:
            break
        meets = least_met <= low, least_met <= high
        last = fibonacci[MOST_STEPS - count]
        first = low + fibonacci[MOST_STEPS - count - 2] / last * (high - low)
        second = low + fibonacci[MOST_STEPS - count - 1] / last * (high - low)
        if all(meets):
            high = first
        elif meets[1]:
            low, high = first, second
        else:
            low = second
    return 0.5 * (low + high)


def _least_met(polygon: Floats, middle: Floats, semi_axes: Floats, edges: int) -> float:
    """Scale from which on the ellipse meets one of the lines that the program makes of edges."""
    x, y = polygon[:edges].T
    dx, dy = (np.roll(polygon, -1, axis=0) - polygon)[:edges].T
    # The line is dy x - dx y + c = 0: without the minus it is another one.
    constant = dy * middle[0] + dx * middle[1] + (y * dx - x * dy)
    width = np.hypot(dy * semi_axes[0], dx * semi_axes[1])
    scales = np.divide(np.abs(constant), width, out=np.full(len(x), np.inf), where=width > 0.0)
    return float(scales.min())
