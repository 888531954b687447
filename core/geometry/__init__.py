"""Plane and solid geometry on arrays.

Polygons, triangle meshes, nearest points, distances between surfaces.

A user may change how many samples a comparison of surfaces takes (`distances`) and how a rigid
alignment is searched for (`alignment`); everything else is exact but for rounding, and its
constants are tolerances of that. It rests on numpy, scipy's k-d tree, and the root of core; it
knows no solid, spline or touch.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.geometry.distances import SAMPLES as SAMPLES
    from palpate.core.geometry.distances import Alignment as Alignment
    from palpate.core.geometry.distances import PreparedSurface as PreparedSurface
    from palpate.core.geometry.distances import align as align
    from palpate.core.geometry.distances import compare_surfaces as compare_surfaces
    from palpate.core.geometry.distances import prepare_surface as prepare_surface
    from palpate.core.geometry.distances import sample_surface as sample_surface
    from palpate.core.geometry.meshes import are_outside as are_outside
    from palpate.core.geometry.meshes import areas_and_normals as areas_and_normals
    from palpate.core.geometry.meshes import close_rings as close_rings
    from palpate.core.geometry.meshes import facet_sag as facet_sag
    from palpate.core.geometry.meshes import is_closed as is_closed
    from palpate.core.geometry.meshes import is_inside_out as is_inside_out
    from palpate.core.geometry.meshes import join_rings as join_rings
    from palpate.core.geometry.meshes import linked_groups as linked_groups
    from palpate.core.geometry.meshes import signed_volume as signed_volume
    from palpate.core.geometry.meshes import solidity as solidity
    from palpate.core.geometry.meshes import triangle_corners as triangle_corners
    from palpate.core.geometry.nearest import Nearest as Nearest
    from palpate.core.geometry.nearest import NearestSearch as NearestSearch
    from palpate.core.geometry.nearest import nearest_points as nearest_points
    from palpate.core.geometry.nearest import nearest_search as nearest_search
    from palpate.core.geometry.nearest import point_tree as point_tree
    from palpate.core.geometry.nearest import self_intersection as self_intersection
    from palpate.core.geometry.polygons import area_centroid as area_centroid
    from palpate.core.geometry.polygons import area_centroids as area_centroids
    from palpate.core.geometry.polygons import azimuth_match as azimuth_match
    from palpate.core.geometry.polygons import edge_distance as edge_distance
    from palpate.core.geometry.polygons import inscribed_circle as inscribed_circle
    from palpate.core.geometry.polygons import kernel_point as kernel_point
    from palpate.core.geometry.polygons import self_intersects as self_intersects
    from palpate.core.geometry.polygons import signed_area as signed_area
    from palpate.core.geometry.polygons import turn_between as turn_between
    from palpate.core.geometry.polygons import winding_number as winding_number
else:
    __getattr__, __dir__ = lazy(__name__)
