"""What was touched, put in order.

Contact points, contours as closed curves, the stack of slices, what is wrong with them, which
places correspond. Thresholds for outliers and for contours that neighbours contradict may be
tuned: they are in standard deviations, or shares of a perimeter or radius. It rests on plane
geometry and closed curves of `palpate.core.splines`; nothing here knows of surfaces.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.contours.contacts import ContactPoints as ContactPoints
    from palpate.core.rebuild.contours.contacts import checked_contacts as checked_contacts
    from palpate.core.rebuild.contours.contacts import contact_points_of as contact_points_of
    from palpate.core.rebuild.contours.contacts import contacts_into_frame as contacts_into_frame
    from palpate.core.rebuild.contours.contacts import into_frame as into_frame
    from palpate.core.rebuild.contours.contacts import normals_as_points as normals_as_points
    from palpate.core.rebuild.contours.contacts import slicing_pose as slicing_pose
    from palpate.core.rebuild.contours.contacts import stack_points as stack_points
    from palpate.core.rebuild.contours.contacts import taxel_pitch as taxel_pitch
    from palpate.core.rebuild.contours.curves import CUBIC_GAIN as CUBIC_GAIN
    from palpate.core.rebuild.contours.curves import ContourCurve as ContourCurve
    from palpate.core.rebuild.contours.curves import DroppedContour as DroppedContour
    from palpate.core.rebuild.contours.curves import (
        are_nearly_star_shaped as are_nearly_star_shaped,
    )
    from palpate.core.rebuild.contours.curves import are_star_shaped as are_star_shaped
    from palpate.core.rebuild.contours.curves import contour_curves as contour_curves
    from palpate.core.rebuild.contours.curves import drop_reasons as drop_reasons
    from palpate.core.rebuild.contours.curves import quadric_terms as quadric_terms
    from palpate.core.rebuild.contours.curves import refitted_curve as refitted_curve
    from palpate.core.rebuild.contours.outliers import FeatureCandidate as FeatureCandidate
    from palpate.core.rebuild.contours.outliers import (
        inconsistent_contours as inconsistent_contours,
    )
    from palpate.core.rebuild.contours.outliers import look_like_features as look_like_features
    from palpate.core.rebuild.contours.outliers import neighbour_misfits as neighbour_misfits
    from palpate.core.rebuild.contours.outliers import neighbour_weights as neighbour_weights
    from palpate.core.rebuild.contours.outliers import point_outliers as point_outliers
    from palpate.core.rebuild.contours.slices import Correspondence as Correspondence
    from palpate.core.rebuild.contours.slices import Slices as Slices
    from palpate.core.rebuild.contours.slices import match_slices as match_slices
    from palpate.core.rebuild.contours.slices import restack as restack
    from palpate.core.rebuild.contours.slices import stack_curves as stack_curves
else:
    __getattr__, __dir__ = lazy(__name__)
