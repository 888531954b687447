"""Plane and solid geometry, and distances between surfaces: see docs/distances.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.geometry import compare_surfaces as compare_surfaces
    from palpate.core.geometry import prepare_surface as prepare_surface
else:
    __getattr__, __dir__ = lazy(__name__)
