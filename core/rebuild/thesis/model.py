"""The original model: a superquadric in the cube from -1 to 1, and its parameters s, t, u."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.parametric import regular
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.splines.invert import Method, invert
from palpate.core.splines.volume import Volume


@dataclass(frozen=True, slots=True, eq=False)
class ModelTriples:
    """Parameters of the model's surface, each by inverting the model's own point.

    Eta goes from 0 at the lower pole to 1 at the upper one, nu once around from azimuth -pi.
    """

    model: Superquadric
    """With semi-axes of 1."""
    volume: Volume
    """The undeformed lattice over the cube from -1 to 1."""

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3)."""
        points = latitude_points(self.model, np.pi * (eta - 0.5), np.pi * (2.0 * nu - 1.0))
        return triples_of(self.volume, points, "auto")


def latitude_points(model: Superquadric, latitudes: Floats, azimuths: Floats) -> Floats:
    """Points (a, b, 3) of a model at latitudes (a,) and azimuths (b,), rad: (2.4), (2.5).

    A row is level only where the exponents are 1, or at latitude 0.
    """
    eta = np.repeat(latitudes, len(azimuths))
    omega = np.tile(azimuths, len(latitudes))
    return regular(model, eta, omega).points.reshape(len(latitudes), len(azimuths), 3)


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


def triples_of(volume: Volume, points: Floats, method: Method) -> Floats:
    """Parameters (a, b, 3) of a grid of points (a, b, 3) in the undeformed lattice."""
    found = invert(volume, points.reshape(-1, 3), method=method)
    return found.parameters.reshape(points.shape)
