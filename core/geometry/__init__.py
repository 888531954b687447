"""Plane and solid geometry on arrays.

Polygons, triangle meshes, nearest points, distances between surfaces.

Tunable are the number of samples of a comparison of surfaces and the search of a rigid alignment
(`distances`); all else is exact up to rounding tolerances. It depends on numpy, scipy's k-d tree,
and the modules directly in core, but on no solid, spline or touch.
"""

from palpate.core.geometry.crossings import (
    CrossingSettings as CrossingSettings,
    SelfIntersection as SelfIntersection,
    self_intersection as self_intersection,
)
from palpate.core.geometry.distances import (
    DEFAULT_SAMPLING as DEFAULT_SAMPLING,
    Alignment as Alignment,
    AlignmentSettings as AlignmentSettings,
    PreparedSurface as PreparedSurface,
    align as align,
    compare_surfaces as compare_surfaces,
    prepare_surface as prepare_surface,
    sample_surface as sample_surface,
)
from palpate.core.geometry.meshes import (
    DEFAULT_MESH as DEFAULT_MESH,
    are_outside as are_outside,
    areas_and_normals as areas_and_normals,
    axes_across as axes_across,
    close_rings as close_rings,
    corner_normals as corner_normals,
    face_edges as face_edges,
    facet_sag as facet_sag,
    has_paired_edges as has_paired_edges,
    is_closed as is_closed,
    is_inside_out as is_inside_out,
    join_rings as join_rings,
    linked_groups as linked_groups,
    normals_at as normals_at,
    signed_volume as signed_volume,
    solidity as solidity,
    triangle_corners as triangle_corners,
)
from palpate.core.geometry.nearest import (
    Nearest as Nearest,
    NearestSearch as NearestSearch,
    are_slivers as are_slivers,
    nearest_points as nearest_points,
    nearest_search as nearest_search,
    point_tree as point_tree,
)
from palpate.core.geometry.polygons import (
    area_centroid as area_centroid,
    area_centroids as area_centroids,
    azimuth_match as azimuth_match,
    edge_distance as edge_distance,
    inscribed_circle as inscribed_circle,
    is_simple_ring as is_simple_ring,
    kernel_point as kernel_point,
    self_intersects as self_intersects,
    signed_area as signed_area,
    turn_between as turn_between,
    winding_number as winding_number,
)
from palpate.core.geometry.resting import (
    Rest as Rest,
    RestingSolid as RestingSolid,
    centre_of_mass as centre_of_mass,
    rotation_between as rotation_between,
)
