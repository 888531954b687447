"""Plane and solid geometry on arrays.

Polygons, triangle meshes, nearest points, distances between surfaces.

A user may change how many samples a comparison of surfaces takes (`distances`) and how a rigid
alignment is searched for (`alignment`); everything else is exact but for rounding, and its
constants are tolerances of that. It rests on numpy, scipy's k-d tree, and the root of core; it
knows no solid, spline or touch.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.geometry.crossings import (
        CrossingSettings,
        SelfIntersection,
        self_intersection,
    )
    from palpate.core.geometry.distances import SAMPLES, Alignment, PreparedSurface, align
    from palpate.core.geometry.distances import compare_surfaces, prepare_surface, sample_surface
    from palpate.core.geometry.meshes import SHARP, are_outside, areas_and_normals, close_rings
    from palpate.core.geometry.meshes import corner_normals, face_edges, facet_sag
    from palpate.core.geometry.meshes import has_paired_edges, is_closed
    from palpate.core.geometry.meshes import is_inside_out, join_rings, linked_groups, normals_at
    from palpate.core.geometry.meshes import signed_volume, solidity, triangle_corners
    from palpate.core.geometry.nearest import Nearest, NearestSearch, are_slivers, nearest_points
    from palpate.core.geometry.nearest import nearest_search, point_tree
    from palpate.core.geometry.polygons import area_centroid, area_centroids, azimuth_match
    from palpate.core.geometry.polygons import edge_distance, inscribed_circle, kernel_point
    from palpate.core.geometry.polygons import self_intersects, signed_area, turn_between
    from palpate.core.geometry.polygons import winding_number
else:
    __getattr__, __dir__ = lazy(__name__)
