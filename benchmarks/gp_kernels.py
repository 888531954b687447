"""Kernels of a Gaussian process that sees values and gradients.

A kernel is a function of the distance r. Between values it is k; between a value at x and a
gradient at y, -g (x - y); between two gradients, -(h d d' + g 1), where g is k' / r, h is
(k'' - g) / r^2 and d is x - y.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

TINY = 1e-12


class Parts(NamedTuple):
    """Of a kernel at distances, each of the distances' shape."""

    k: Floats
    g: Floats
    h: Floats


Kernel = Callable[[Floats], Parts]
"""Of distances."""


def matern(length: float) -> Kernel:
    """Matern, nu = 5/2, whose gradients have unit variance: of a distance, in its own unit."""

    def parts(r: Floats) -> Parts:
        s = np.sqrt(5.0) / length * r
        fall = np.exp(-s)
        scale = 0.6 * length**2
        return Parts(
            scale * (1.0 + s + s * s / 3.0) * fall, -(1.0 + s) * fall, 5.0 / length**2 * fall
        )

    return parts


def thin_plate(widest: float) -> Kernel:
    """Thin plate of Williams and Fitzgibbon, 2 r^3 - 3 R r^2 + R^3; gradients of unit variance.

    R is the largest distance between any two places.
    """

    def parts(r: Floats) -> Parts:
        scale = 1.0 / (6.0 * widest)
        k = 2.0 * r**3 - 3.0 * widest * r**2 + widest**3
        return Parts(scale * k, scale * 6.0 * (r - widest), scale * 6.0 / np.maximum(r, TINY))

    return parts


def block(kernel: Kernel, one: Floats, other: Floats, gradients: bool) -> Floats:
    """Covariance between places (n, 3) and (m, 3).

    Returns
    -------
    (4 n, 4 m) array, or (n, m) without gradients
        Of each place first the value and then the gradient.
    """
    away = one[:, None] - other[None]
    r = np.sqrt(np.einsum("nmi,nmi->nm", away, away))
    k, g, h = kernel(r)
    if not gradients:
        return k
    found = np.empty((len(one), 4, len(other), 4))
    found[:, 0, :, 0] = k
    toward = -g[..., None] * away
    found[:, 0, :, 1:] = toward
    found[:, 1:, :, 0] = -toward.transpose(0, 2, 1)
    for i in range(3):
        for j in range(3):
            found[:, 1 + i, :, 1 + j] = -h * away[..., i] * away[..., j] - (g if i == j else 0.0)
    return found.reshape(4 * len(one), 4 * len(other))
