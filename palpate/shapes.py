"""Shapes that rays can be cast at: see docs/shapes.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.core.shapes import Polyhedron as Polyhedron
    from palpate.core.shapes import Superquadric as Superquadric
    from palpate.core.shapes import area_samples as area_samples
    from palpate.core.shapes import sampled_surface as sampled_surface
    from palpate.core.shapes import superquadric_volume as superquadric_volume
else:
    __getattr__, __dir__ = lazy(__name__)
