"""Plane and solid geometry on arrays.

Polygons, triangle meshes, nearest points, distances between surfaces.

A user may change how many samples a comparison of surfaces takes (`distances`) and how a rigid
alignment is searched for (`alignment`); everything else is exact but for rounding, and its
constants are tolerances of that. It rests on numpy, scipy's k-d tree, and the root of core; it
knows no solid, spline or touch.
"""

from palpate.core.geometry.crossings import (
    CrossingSettings,
    SelfIntersection,
    self_intersection,
)
from palpate.core.geometry.distances import (
    SAMPLES,
    Alignment,
    PreparedSurface,
    align,
    compare_surfaces,
    prepare_surface,
    sample_surface,
)
from palpate.core.geometry.meshes import (
    SHARP,
    are_outside,
    areas_and_normals,
    close_rings,
    corner_normals,
    face_edges,
    facet_sag,
    has_paired_edges,
    is_closed,
    is_inside_out,
    join_rings,
    linked_groups,
    normals_at,
    signed_volume,
    solidity,
    triangle_corners,
)
from palpate.core.geometry.nearest import (
    Nearest,
    NearestSearch,
    are_slivers,
    nearest_points,
    nearest_search,
    point_tree,
)
from palpate.core.geometry.polygons import (
    area_centroid,
    area_centroids,
    azimuth_match,
    edge_distance,
    inscribed_circle,
    kernel_point,
    self_intersects,
    signed_area,
    turn_between,
    winding_number,
)
