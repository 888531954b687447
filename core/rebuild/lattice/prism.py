"""A control lattice around a prism, solved so that the prism's side becomes the skin.

The undeformed solid is an upright elliptic prism: the same section at every height, so that
the system of the control points is a Kronecker product of one along the height and one across
a section, and two small positive definite systems solve it whatever its size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from palpate.core.arrays import Floats
from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.frame import Frame, upright_frame
from palpate.core.splines.lattice import Lattice
from palpate.core.splines.volume import Volume

LAYERS, SIDE = 32, 9
"""Control points along the height, and across each way."""
ALONG, ACROSS = clamped_basis(LAYERS), clamped_basis(SIDE)
STIFFNESS = 1e-6
"""Weight of squared second differences, relative to the data's mean weight: enough to settle
the control points that a section's rim cannot see, and to keep most folds away."""
RIDGE = 1e-12


class PrismFit(NamedTuple):
    """A solved lattice."""

    lattice: Lattice
    """The lattice."""
    frame: Frame
    """Its undeformed box, which is the prism's."""
    half_extent: Floats
    """Semi-axes of the prism's section, (2,), m."""
    rms: float
    """Root mean square distance of the deformed side from the surface asked for, m."""
    condition: float
    """The larger condition number of the two systems, to 2 digits."""

    def side(self, heights: Floats, turns: Floats) -> Floats:
        """The deformed prism's side on a grid, (heights, turns, 3), m."""
        across = _section(turns)
        along = ALONG.matrix((heights - self.frame.corner[2]) / self.frame.edges[2, 2])
        control = self.lattice.control.reshape(SIDE * SIDE, LAYERS, 3)
        columns = (across @ control.reshape(SIDE * SIDE, -1)).reshape(len(turns), LAYERS, 3)
        rows = along @ columns.transpose(1, 0, 2).reshape(LAYERS, -1)
        return rows.reshape(len(heights), len(turns), 3)

    def folded_share(self, samples: int = 24) -> float:
        """Share of the prism's volume that the deformation turns inside out."""
        turns = np.arange(samples) / samples
        radii = np.sqrt((np.arange(6) + 0.5) / 6)
        rim = np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], axis=-1)
        across = (radii[:, None, None] * rim).reshape(-1, 2) * self.half_extent
        middle = self.frame.points(np.full(3, 0.5))[:2]
        heights = self.frame.corner[2] + self.frame.edges[2, 2] * np.linspace(0.02, 0.98, LAYERS)
        places = np.repeat(across + middle, len(heights), axis=0)
        points = np.column_stack([places, np.tile(heights, len(across))])
        return float((self.lattice.jacobian_determinant(points) <= 0.0).mean())


def fit_prism(heights: Floats, turns: Floats, surface: Floats) -> PrismFit:
    """Control lattice whose prism takes the shape of a given side surface.

    Parameters
    ----------
    heights : (m,) array
        Heights of the surface's rows, ascending, m.
    turns : (n,) array
        Azimuths of its columns about the axis, in turns.
    surface : (m, n, 2) array
        x and y of its points, m.

    Notes
    -----
    Solved for the displacement from the undeformed lattice, which is what Fung, 1999, (4.25)
    leaves undetermined: the raw system is singular, since a rim cannot see a whole section.
    """
    low = surface.min(axis=(0, 1))
    half_extent = 0.5 * (surface.max(axis=(0, 1)) - low)
    height = heights[-1] - heights[0]
    frame = upright_frame(np.array([*low, heights[0]]), np.array([*(2.0 * half_extent), height]))
    bases = (ACROSS, ACROSS, ALONG)
    along = ALONG.matrix((heights - heights[0]) / height).toarray()
    across = _section(turns)
    control = frame.greville_control(bases)
    prism = across @ control[:, :, 0, :2].reshape(-1, 2)
    offset = surface - prism
    by_layer, condition_along = _solve(along, _bend(LAYERS), offset.reshape(len(heights), -1))
    by_layer = by_layer.reshape(LAYERS, len(turns), 2).transpose(1, 0, 2)
    moved, condition_across = _solve(across, _bend_section(), by_layer.reshape(len(turns), -1))
    control[..., :2] += moved.reshape(SIDE, SIDE, LAYERS, 2)
    condition = float(f"{max(condition_along, condition_across):.2g}")
    lattice = Lattice(Volume(control, bases), frame)
    fit = PrismFit(lattice, frame, half_extent, 0.0, condition)
    misfit = fit.side(heights, turns)[..., :2] - surface
    return fit._replace(rms=float(np.sqrt(np.mean(np.sum(misfit**2, axis=-1)))))


def _section(turns: Floats) -> Floats:
    """Basis of a section at the rim's points, (turns, side * side)."""
    x = ACROSS.matrix(0.5 + 0.5 * np.cos(2 * np.pi * turns)).toarray()
    y = ACROSS.matrix(0.5 + 0.5 * np.sin(2 * np.pi * turns)).toarray()
    basis: Floats = (x[:, :, None] * y[:, None, :]).reshape(len(turns), SIDE * SIDE)
    return basis


def _solve(basis: Floats, bend: Floats, target: Floats) -> tuple[Floats, float]:
    """Penalised least squares by Cholesky, and the system's condition number.

    The ridge bounds the condition.
    """
    normal = basis.T @ basis
    scale = float(np.trace(normal)) / len(normal)
    system = normal + scale * (STIFFNESS * bend + RIDGE * np.eye(len(normal)))
    solution: Floats = cho_solve(cho_factor(system), basis.T @ target)
    values = np.linalg.eigvalsh(system)
    return solution, float(values[-1] / values[0])


def _bend(count: int) -> Floats:
    """Squared second differences of control points along a line."""
    rows = np.diff(np.eye(count), 2, axis=0)
    result: Floats = rows.T @ rows
    return result


def _bend_section() -> Floats:
    """Squared second differences of control points over a section, the mixed ones twice."""
    unit = np.eye(SIDE)
    slope = np.diff(unit, axis=0)
    twist = np.kron(slope, slope)
    result: Floats = np.kron(_bend(SIDE), unit) + np.kron(unit, _bend(SIDE)) + 2 * twist.T @ twist
    return result
