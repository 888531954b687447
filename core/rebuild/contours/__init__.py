"""What was touched, put in order.

Contact points, contours as closed curves, the stack of slices, what is wrong with them, which
places correspond. Thresholds for outliers and for contours that neighbours contradict may be
tuned: they are in standard deviations, or shares of a perimeter or radius. It rests on plane
geometry and closed curves of `palpate.core.splines`; nothing here knows of surfaces.
"""

from palpate.core.rebuild.contours.contacts import (
    ContactPoints,
    checked_contacts,
    contacts_into_frame,
    into_frame,
    normals_as_points,
    slicing_pose,
    stack_points,
    taxel_pitch,
)
from palpate.core.rebuild.contours.curves import (
    CUBIC_GAIN,
    ContourCurve,
    DroppedContour,
    are_nearly_star_shaped,
    are_star_shaped,
    contour_curves,
    drop_reasons,
    quadric_terms,
    refitted_curve,
)
from palpate.core.rebuild.contours.ordering import order_points
from palpate.core.rebuild.contours.outliers import (
    FeatureCandidate,
    inconsistent_contours,
    look_like_features,
    neighbour_misfits,
    point_outliers,
)
from palpate.core.rebuild.contours.prediction import (
    interpolation_errors,
    neighbour_weights,
    slid_grid,
)
from palpate.core.rebuild.contours.slices import (
    Correspondence,
    Slices,
    match_slices,
    restack,
    stack_curves,
)
