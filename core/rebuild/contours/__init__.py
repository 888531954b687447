"""Contact points and contours: closed curves, stacks of slices, outliers, correspondence.

Thresholds are fields of settings classes: standard deviations, or fractions of a perimeter or
radius. The package uses plane geometry and the closed curves of `palpate.core.splines`, and no
surfaces.
"""

from palpate.core.rebuild.contours.contacts import (
    ContactPoints as ContactPoints,
    checked_contacts as checked_contacts,
    contacts_into_frame as contacts_into_frame,
    into_frame as into_frame,
    normals_as_points as normals_as_points,
    slicing_pose as slicing_pose,
    stack_points as stack_points,
    taxel_pitch as taxel_pitch,
)
from palpate.core.rebuild.contours.curves import (
    CUBIC_GAIN as CUBIC_GAIN,
    ContourCurve as ContourCurve,
    DroppedContour as DroppedContour,
    are_nearly_star_shaped as are_nearly_star_shaped,
    are_star_shaped as are_star_shaped,
    contour_curves as contour_curves,
    drop_reasons as drop_reasons,
    quadric_terms as quadric_terms,
    refitted_curve as refitted_curve,
)
from palpate.core.rebuild.contours.neighbours import (
    FeatureCandidate as FeatureCandidate,
    inconsistent_contours as inconsistent_contours,
    interpolation_errors as interpolation_errors,
    may_be_features as may_be_features,
    neighbour_misfits as neighbour_misfits,
    neighbour_weights as neighbour_weights,
    slide_along_curves as slide_along_curves,
)
from palpate.core.rebuild.contours.ordering import (
    order_points as order_points,
)
from palpate.core.rebuild.contours.outliers import (
    point_outliers as point_outliers,
)
from palpate.core.rebuild.contours.slices import (
    Correspondence as Correspondence,
    Slices as Slices,
    match_slices as match_slices,
    restack as restack,
    stack_curves as stack_curves,
)
