"""The solid that the thesis's way gives: a deformed lattice, and the model's surface in it.

The original model is a superquadric in the cube from -1 to 1. Its parameters s, t, u are had by
inverting its own points, or, as in 4.3, by a spline through known ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry import close_rings, solidity
from palpate.core.shapes import Mesh, Superquadric, regular_points
from palpate.core.splines import (
    CUBIC,
    Basis,
    Inversion,
    Lattice,
    SplineVolume,
    averaged_knots,
    evaluate_grid,
    interpolate_grid,
    invert_points,
)

LEAST_ROWS, LEAST_COLUMNS = 2, 3


class ParameterTriples(Protocol):
    """Parameters s, t, u all over the model's surface."""

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3)."""


class ThesisHealth(NamedTuple):
    """What should be known of a solid before it is used; one entry for each contour, upwards."""

    # (m,): each ray from the contour's middle met it once. Always true of contours that are matched
    # by number.
    one_to_one: Bools
    # (m,): the contour encloses nothing; of one that is matched by number: it is a point.
    degenerate: Bools
    self_intersecting: Bools  # (m,): the contour meets itself
    core_scales: Floats  # (m,): sides of the layer's core over those of the box around its shell
    cores_moved: Bools  # (m,): the core is not in the middle of that box
    cores_outside: Ints  # (m,): control points of the core that lie outside their shell
    gaps: Floats  # (m,): how far open the curve is that gave the shell, over its mean width


@dataclass(frozen=True, slots=True, eq=False)
class ThesisSolid:
    """A superquadric's surface, deformed by a control lattice.

    Its surface is given over eta, from 0 at the bottom to 1 at the top, and nu, from 0 to 1 once
    around.
    """

    # Over the box around the contours, m; a layer of control points for each contour.
    lattice: Lattice
    # s, t, u (m, n, 3) of the model's points that were matched with the contours': upwards, then
    # around from azimuth -pi, the first again at the end.
    parameters: Floats
    triples: ParameterTriples  # Parameters of the whole surface
    # How far beyond its first and last row the surface is closed by a point, m; None if it ends in
    # points of its own.
    cap: float | None
    order: Ints  # (m,): which of the given contours each layer is
    health: ThesisHealth

    def surface(self, eta: Floats, nu: Floats) -> Floats:
        """Points of the surface on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3), m.

        Raises ValueError if a number is not finite or outside 0 to 1.
        """
        eta, nu = (_unit(name, places) for name, places in (("eta", eta), ("nu", nu)))
        triples = self.triples.at(eta, nu)
        return self.lattice.volume.at(triples.reshape(-1, 3)).reshape(triples.shape)

    def mesh(self, rows: int, columns: int) -> Mesh:
        """Closed mesh of so many rows and columns of points, with a point at either end.

        Raises ValueError if there are not at least 2 rows and 3 columns.

        The triangles are turned round where the lattice mirrors. Where it folds, the mesh may
        meet itself.
        """
        if rows < LEAST_ROWS or columns < LEAST_COLUMNS:
            raise ValueError(
                f"a mesh must have at least {LEAST_ROWS} rows and {LEAST_COLUMNS} columns, "
                f"got {rows} and {columns}"
            )
        nu = np.arange(columns) / columns
        if self.cap is None:
            surface = self.surface(np.linspace(0.0, 1.0, rows + 2), nu)
            bottom, rings, top = surface[0, 0], surface[1:-1], surface[-1, 0]
        else:
            rings = self.surface(np.linspace(0.0, 1.0, rows), nu)
            beyond = np.array([0.0, 0.0, self.cap])
            bottom, top = rings[0].mean(axis=0) - beyond, rings[-1].mean(axis=0) + beyond
        vertices, faces = close_rings(bottom, rings, top)
        if solidity(vertices, faces).volume < 0.0:
            faces = faces[:, ::-1]
        return Mesh(vertices, faces)


def _unit(name: str, places: Floats) -> Floats:
    checked = finite_array(name, places, (None,))
    if len(checked) and not 0.0 <= checked.min() <= checked.max() <= 1.0:
        raise ValueError(
            f"{name} must lie between 0 and 1, got {checked.min():g} to {checked.max():g}"
        )
    return checked


@dataclass(frozen=True, slots=True, eq=False)
class ModelTriples:
    """Parameters of the model's surface, each by inverting the model's own point.

    Eta goes from 0 at the lower pole to 1 at the upper one, nu once around from azimuth -pi.
    """

    model: Superquadric  # With semi-axes of 1
    volume: SplineVolume  # The undeformed lattice over the cube from -1 to 1

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3)."""
        points = latitude_points(self.model, np.pi * (eta - 0.5), np.pi * (2.0 * nu - 1.0))
        return triples_of(self.volume, points)


def latitude_points(model: Superquadric, latitudes: Floats, azimuths: Floats) -> Floats:
    """Points (a, b, 3) of a model at latitudes (a,) and azimuths (b,), rad: (2.4), (2.5).

    A row is level only where the exponents are 1, or at latitude 0.
    """
    eta = np.repeat(latitudes, len(azimuths))
    omega = np.tile(azimuths, len(latitudes))
    return regular_points(model, eta, omega).points.reshape(len(latitudes), len(azimuths), 3)


def level_points(model: Superquadric, heights: Floats, azimuths: Floats) -> Floats:
    """Points (a, b, 3) of a model, with semi-axes of 1, at heights (a,) and azimuths (b,), rad.

    At heights of -1 and 1 a row is one point, the pole.
    """
    around = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(len(azimuths))])
    outline = around[:, :2] / model.gauge(around)[:, None]
    power = 2.0 / float(model.exponents[0])
    width = (1.0 - np.minimum(np.abs(heights), 1.0) ** power) ** (1.0 / power)
    points = np.empty((len(heights), len(azimuths), 3))
    points[:, :, :2] = width[:, None, None] * outline
    points[:, :, 2] = heights[:, None]
    return points


def triples_of(
    volume: SplineVolume,
    points: Floats,
    invert: Callable[[SplineVolume, Floats], Inversion] = invert_points,
) -> Floats:
    """Parameters (a, b, 3) of a grid of points (a, b, 3) in the undeformed lattice."""
    found = invert(volume, points.reshape(-1, 3))
    return found.parameters.reshape(points.shape)


@dataclass(frozen=True, slots=True, eq=False)
class TripleSpline:
    """A surface in the space of the parameters s, t, u: (4.17)."""

    bases: tuple[Basis, Basis]  # Along eta and nu, both over [0, 1]
    control: Floats  # (m, n, 3)
    sites: tuple[Floats, Floats]  # eta (m,) and nu (n,) of the triples that it passes
    condition: float  # Condition number of the interpolation

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3).

        Clipped to 0 and 1, which the spline overshoots where the model has edges.

        Raises ValueError if a number is not finite, or outside 0 to 1 by more than rounding.
        """
        return np.clip(evaluate_grid(self.bases, self.control, (eta, nu)), 0.0, 1.0)


def interpolated_parameters(parameters: Floats) -> TripleSpline:
    """The spline surface through a grid of parameter triples: (4.17) to (4.21).

    `parameters` (m, n, 3): s, t, u; m at least 2 from the bottom to the top, n at least 4 around,
    the first again at the end. A row may be one point, as at a pole. Raises ValueError if the shape
    is another, a number is not finite, or neighbouring rows or columns are the same throughout.

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
    found = interpolate_grid(bases, sites, parameters)
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
