"""An elastic pad in place of a bed of springs: pressure here presses the face down there too."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.ranges import Range, check_ranges
from palpate.core.touch.effect import Place, Stage
from palpate.core.touch.pad import Pad
from palpate.core.touch.touch import Finger, Touch

TOLERANCE = 1e-7
"""Largest error of the face within the contact, as a share of the deepest indentation."""
MOST_STEPS = 1000
"""Thirty are usual on smooth surfaces, a hundred on rough ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfSpace:
    """The pad as an elastic half-space, touched without friction.

    Find ``p >= 0`` with ``u = K p``, ``u = g`` where ``p > 0`` and ``u >= g`` elsewhere: the rigid
    surface indents the face by ``g``, and the free face about the contact is drawn down. ``K`` is
    the displacement under uniformly loaded squares (Love, 1929; Johnson, *Contact mechanics*,
    1985, 3.25), and the conjugate gradients are those of Polonsky and Keer, 1999. On a sphere
    this is Hertz's contact, whose radius is 0.71 of that of a bed of springs. It replaces the
    springs' pressures, so it matters for forces and for what is felt around a contact; the
    truth for a thin bonded pad lies between the two.
    """

    place: ClassVar = Place.PAD

    modulus: Annotated[float, Range(1e4, 1e8, "N/m2")] = 0.5e6
    """Young's modulus: that of a soft silicone, an engineering value."""
    poisson: Annotated[float, Range(0.0, 0.5, "1")] = 0.49
    """Poisson's ratio: rubber keeps its volume."""

    def __post_init__(self) -> None:
        check_ranges(self)

    def prepare(self, finger: Finger) -> Stage:
        """The stage for one finger.

        Its act raises `ArithmeticError` if the contact is not found within `MOST_STEPS`.
        """
        size = (finger.pad.rows, finger.pad.cols)
        compliance = (1.0 - self.poisson**2) / (math.pi * self.modulus)
        kernel = compliance * _displacements(finger.pad)

        def act(touch: Touch, state: None) -> None:
            indentation = touch.indentation.ravel()
            # Where the surface does not enter the face it can only be too far from it.
            near = np.flatnonzero(indentation > 0.0)
            pressure, face = np.zeros(indentation.size), np.zeros(indentation.size)
            if near.size:
                columns = kernel[near]
                found = _contact_pressure(columns[:, near], indentation[near])
                pressure[near] = found
                face = found @ columns
            touch.pressure = pressure.reshape(size)
            touch.compression = np.maximum(face, indentation).reshape(size)

        return Stage(act)


def _displacements(pad: Pad) -> Floats:
    """Displacement of each taxel's middle under unit pressure on another, (n, n), m, with
    ``(1 - nu^2) / (pi E)`` left out."""
    x = (np.arange(pad.cols) * pad.pitch)[None, :]
    y = (np.arange(pad.rows) * pad.pitch)[:, None]
    half = 0.5 * pad.pitch

    def corner(x: Floats, y: Floats) -> Floats:
        return x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y))

    table = corner(x + half, y + half) - corner(x - half, y + half)
    table += corner(x - half, y - half) - corner(x + half, y - half)
    row, col = np.divmod(np.arange(pad.rows * pad.cols), pad.cols)
    return table[np.abs(row[:, None] - row), np.abs(col[:, None] - col)]


def _contact_pressure(kernel: Floats, indentation: Floats) -> Floats:
    """Pressures (n,) of a contact, by conjugate gradients on the set that presses.

    Raises
    ------
    ArithmeticError
        If they have not converged.
    """
    allowed = TOLERANCE * float(indentation.max())
    pressure = indentation / kernel.sum(axis=1)
    direction, before, carried = np.zeros_like(pressure), 1.0, 0.0
    worst = math.inf
    for _ in range(MOST_STEPS):
        residual = kernel @ pressure - indentation
        pressing = pressure > 0.0
        inside = np.where(pressing, residual, 0.0)
        worst = max(float(np.abs(inside).max()), -float(residual.min()))
        if worst <= allowed:
            return pressure
        square = float(inside @ inside)
        direction = np.where(pressing, residual + (carried * square / before) * direction, 0.0)
        before, carried = square, 1.0
        step = float(inside @ direction) / float(direction @ (kernel @ direction))
        pressure = np.maximum(pressure - step * direction, 0.0)
        entering = (pressure == 0.0) & (residual < 0.0)
        if entering.any():  # the set has grown: begin anew with the steepest descent
            carried = 0.0
            pressure = np.where(entering, -step * residual, pressure)
    raise ArithmeticError(
        f"half_space found no contact within {MOST_STEPS} steps: the face is still "
        f"{worst:.3g} m off; expected {allowed:.3g} m"
    )


EFFECT = HalfSpace
