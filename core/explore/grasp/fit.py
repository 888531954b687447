"""The coarse model of an object: a solid through its first contacts, and how well it fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.posed_superquadric import posed_superquadric
from palpate.core.shapes.protocol import Shape


class Fit(Protocol):
    """What the slicing frame asks of a coarse model."""

    @property
    def fitted(self) -> bool:
        """False if the contacts could not be fitted."""

    @property
    def doubts(self) -> Sequence[str]:
        """Why not to believe it."""

    @property
    def residuals(self) -> Floats:
        """Distance of each contact along the normal, (n,), m; negative inside."""

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, m."""

    def shape(self) -> Shape:
        """The solid where it stands."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CoarseFit:
    """A superquadric, tapered and bent, as somebody else has fitted it."""

    size: Floats
    """Semi-axes (3,), m."""
    exponents: Floats
    """e1 and e2, (2,)."""
    pose: Floats
    """(7,)."""
    taper: Floats
    """Widening of x and y at the top, (2,)."""
    bend: Bend
    """How it is bent."""
    residuals: Floats
    """Distance of each contact, (n,), m."""
    rms: float
    """Root mean square of those that count, m."""
    doubts: tuple[str, ...]
    """Why not to believe it."""

    @property
    def fitted(self) -> bool:
        """False if it is but an ellipsoid about the contacts."""
        return not any(doubt.endswith("points") for doubt in self.doubts)

    def shape(self) -> PosedShape:
        """The solid where it stands.

        Raises
        ------
        ValueError
            If it has no extent, or its bend folds it.
        """
        return posed_superquadric(self.size, self.exponents, self.pose, self.taper, self.bend)
