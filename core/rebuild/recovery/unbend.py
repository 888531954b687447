"""Unbending of many solids' points at once, with what derivatives need of it.

A bend is given by its curvature times its direction, two numbers in which no bend is nothing
special. No form here divides by the curvature: `core.shapes.bend` has the same map for one solid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery.untaper import Triple

LEAST_CURVATURE = 1e-150
"""Below it, a bend is none: its square would underflow."""
LEAST_STRETCH = 1e-3
"""Nearer to the centre of curvature, as a share of the radius, slopes are taken as there."""


class Unbent(NamedTuple):
    """Places in the planes of the bends, straightened; (b, n) unless said otherwise."""

    curvature: Floats
    """(b, 1)."""
    towards: tuple[Floats, Floats]
    """Direction of the bend, (b, 1) each."""
    inwards: Floats
    across: Floats
    along: Floats
    stretch: Floats
    """Length of the fibre, as a share of the axis's."""
    cosine: Floats
    sine: Floats
    chord: Floats
    """sin(t) / t of the angle t by which the bend turned the place."""
    rise: Floats
    """(1 - cos(t)) / t^2."""
    lag: Floats
    """(t - sin(t)) / t^3."""


def unbend(bent: Triple, bend: Floats) -> Unbent:
    """Straighten places (b, n) of bends (b, 2), each curvature times direction."""
    x, y, z = bent
    k = np.hypot(bend[:, 0], bend[:, 1])[:, None]
    none = k < LEAST_CURVATURE
    safe = np.where(none, 1.0, k)
    cx = np.where(none, 1.0, bend[:, 0, None] / safe)
    cy = np.where(none, 0.0, bend[:, 1, None] / safe)
    inwards, across = x * cx + y * cy, y * cx - x * cy
    up, level = k * z, 1.0 - k * inwards
    stretch = np.maximum(np.hypot(up, level), LEAST_STRETCH)
    angle = np.arctan2(up, level)
    # Less digits are lost in 1 - cos and t - sin below by their series than by themselves.
    small = np.abs(angle) < 0.3
    safe_angle, square = np.where(small, 1.0, angle), angle * angle
    chord = np.sinc(angle / np.pi)
    half = np.sinc(angle / (2.0 * np.pi))
    series = 1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0))
    lag = np.where(small, series, (angle - np.sin(angle)) / safe_angle**3)
    return Unbent(
        k,
        (cx, cy),
        (2.0 * inwards - k * (inwards * inwards + z * z)) / (1.0 + stretch),
        across,
        np.where(none, z, angle / safe),
        stretch,
        level / stretch,
        up / stretch,
        chord,
        0.5 * half * half,
        lag,
    )


def straight_places(at: Unbent) -> Triple:
    """The straight places in the body's axes."""
    cx, cy = at.towards
    return at.inwards * cx - at.across * cy, at.inwards * cy + at.across * cx, at.along


def turned(at: Unbent, vector: Triple) -> Triple:
    """A vector of the body's axes in those of the bend."""
    cx, cy = at.towards
    return vector[0] * cx + vector[1] * cy, vector[1] * cx - vector[0] * cy, vector[2]


def turned_back(at: Unbent, vector: Triple) -> Triple:
    """A vector of the bend's axes in those of the body."""
    cx, cy = at.towards
    return vector[0] * cx - vector[1] * cy, vector[0] * cy + vector[1] * cx, vector[2]


def rate(at: Unbent, bent: Triple) -> Triple:
    """How straight places change, from how bent ones do; both in the bend's axes."""
    inwards, across, up = bent
    return (
        at.cosine * inwards - at.sine * up,
        across,
        (at.cosine * up + at.sine * inwards) / at.stretch,
    )


def slope(at: Unbent, by_straight: Triple) -> Triple:
    """Derivatives by the bent places, from those by the straight ones, in the bend's axes."""
    inwards, across, along = by_straight
    along = along / at.stretch
    return (
        inwards * at.cosine + along * at.sine,
        across,
        along * at.cosine - inwards * at.sine,
    )


def slope_of_both(at: Unbent, moving: Triple, by_place: Triple, by_rate: Triple) -> Triple:
    """Derivatives by the bent places, of what depends on straight places and rates `moving`."""
    inwards, across, up = slope(at, by_place)
    spin = at.curvature * (by_rate[2] * moving[0] / at.stretch**2 - by_rate[0] * moving[2])
    stretching = at.curvature * by_rate[2] * moving[2] / at.stretch
    return (
        inwards + spin * at.sine + stretching * at.cosine,
        across,
        up + spin * at.cosine - stretching * at.sine,
    )


def slope_by_bend(
    at: Unbent, bent: Triple, moving: Triple, by_place: Triple, by_rate: Triple
) -> tuple[Floats, Floats]:
    """Derivatives by the two numbers of the bend; `bent` is the rate before unbending.

    All in the bend's axes. The first is by the curvature, the second by the direction, divided
    by the curvature.
    """
    r, z, stretch, s, c = at.inwards, at.along, at.stretch, at.sine, at.cosine
    angle = at.curvature * z
    sag = z * angle * at.rise
    turn, stretching = z * at.chord / stretch, sag - r
    along_curvature = (
        -by_place[0] * z * z * at.rise
        + by_place[2] * z * (r - z * angle * at.lag) / stretch
        - by_rate[0] * stretch * moving[2] * turn
        + by_rate[2] * (moving[0] * turn - moving[2] * stretching) / stretch
    )
    chord = z * at.chord
    along_direction = (
        -by_place[0] * at.across * sag
        - by_place[1] * stretch * z * z * at.rise
        + by_place[2] * chord * at.across / stretch
        - by_rate[0] * (bent[1] * sag + s * moving[2] * at.across)
        - by_rate[1] * (bent[0] * sag + chord * bent[2])
        + by_rate[2]
        * (chord * bent[1] + (moving[2] * c + moving[0] * s / stretch) * at.across)
        / stretch
    )
    cx, cy = at.towards
    return (
        along_curvature * cx - along_direction * cy,
        along_curvature * cy + along_direction * cx,
    )
