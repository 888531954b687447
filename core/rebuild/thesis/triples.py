"""Parameter triples between those that are known, by a spline: Fung, 1999, section 4.3."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.basis import Basis
from palpate.core.splines.collocation import interpolate
from palpate.core.splines.knots import CUBIC, averaged_knots
from palpate.core.splines.tensor import evaluate_grid


@dataclass(frozen=True, slots=True, eq=False)
class TripleSpline:
    """A surface in the space of the parameters s, t, u: (4.17)."""

    bases: tuple[Basis, Basis]
    """Along eta and nu, both over [0, 1]."""
    control: Floats
    """(m, n, 3)."""
    sites: tuple[Floats, Floats]
    """eta (m,) and nu (n,) of the triples that it passes."""
    condition: float
    """Condition number of the interpolation."""

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3).

        Clipped to 0 and 1, which the spline overshoots where the model has edges.

        Raises
        ------
        ValueError
            If a number is not finite, or outside 0 to 1 by more than rounding.
        """
        clipped: Floats = np.clip(evaluate_grid(self.bases, self.control, (eta, nu)), 0.0, 1.0)
        return clipped


def interpolated_parameters(parameters: Floats) -> TripleSpline:
    """The spline surface through a grid of parameter triples: (4.17) to (4.21).

    Parameters
    ----------
    parameters : (m, n, 3) array
        s, t, u; m at least 2 from the bottom to the top, n at least 4 around, the first again
        at the end. A row may be one point, as at a pole.

    Raises
    ------
    ValueError
        If the shape is another, a number is not finite, or neighbouring rows or columns are
        the same throughout.

    Notes
    -----
    Cubic, of a lower degree where there are fewer than 4 rows. Sites by square roots of the
    chords (4.18), averaged over all rows that have a length; knots by (4.19), with the sum
    from its first site. The seam is passed, but not smoothly. Where the model is known its own
    points say more: `ModelTriples`.
    """
    parameters = finite_array("parameters", parameters, (None, None, 3))
    rows, columns = parameters.shape[:2]
    if rows < 2 or columns <= CUBIC:
        raise ValueError(
            f"parameters must have at least 2 rows and {CUBIC + 1} columns, got {rows}, {columns}"
        )
    sites = _sites("rows", parameters), _sites("columns", parameters.transpose(1, 0, 2))
    along, around = (min(CUBIC, len(places) - 1) for places in sites)
    bases = (
        Basis(averaged_knots(sites[0], along), along),
        Basis(averaged_knots(sites[1], around), around),
    )
    found = interpolate(bases, sites, parameters)
    return TripleSpline(bases, found.control, sites, found.condition)


def _sites(name: str, parameters: Floats) -> Floats:
    """Centripetal parameters (m,) of a grid (m, n, 3) along its first axis, the mean of all."""
    chords = np.sqrt(np.linalg.norm(np.diff(parameters, axis=0), axis=2))
    ways = np.vstack([np.zeros(chords.shape[1]), np.cumsum(chords, axis=0)])
    long = ways[-1] > 0.0
    sites = (ways[:, long] / ways[-1, long]).mean(axis=1) if long.any() else np.zeros(len(ways))
    if not (np.diff(sites) > 0.0).all():
        raise ValueError(f"parameters must differ between neighbouring {name}")
    sites[-1] = 1.0
    return sites
