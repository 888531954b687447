"""Plane and solid geometry, and distances between surfaces: see docs/distances.md."""

from palpate.core.geometry import (
    compare_surfaces as compare_surfaces,
    prepare_surface as prepare_surface,
)
