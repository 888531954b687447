"""What was touched, put in order.

Contact points, contours as closed curves, the stack of slices, what is wrong with them, which
places correspond. Thresholds for outliers and for contours that neighbours contradict may be
tuned: they are in standard deviations, or shares of a perimeter or radius. It rests on plane
geometry and closed curves of `palpate.core.splines`; nothing here knows of surfaces.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.contours.contacts import ContactPoints, checked_contacts
    from palpate.core.rebuild.contours.contacts import contact_points_of, contacts_into_frame
    from palpate.core.rebuild.contours.contacts import into_frame, normals_as_points, slicing_pose
    from palpate.core.rebuild.contours.contacts import stack_points, taxel_pitch
    from palpate.core.rebuild.contours.curves import CUBIC_GAIN, ContourCurve, DroppedContour
    from palpate.core.rebuild.contours.curves import are_nearly_star_shaped, are_star_shaped
    from palpate.core.rebuild.contours.curves import contour_curves, drop_reasons, quadric_terms
    from palpate.core.rebuild.contours.curves import refitted_curve
    from palpate.core.rebuild.contours.ordering import order_points
    from palpate.core.rebuild.contours.outliers import FeatureCandidate, inconsistent_contours
    from palpate.core.rebuild.contours.outliers import look_like_features, neighbour_misfits
    from palpate.core.rebuild.contours.outliers import point_outliers
    from palpate.core.rebuild.contours.prediction import interpolation_errors, neighbour_weights
    from palpate.core.rebuild.contours.prediction import slid_grid
    from palpate.core.rebuild.contours.slices import Correspondence, Slices, match_slices, restack
    from palpate.core.rebuild.contours.slices import stack_curves
else:
    __getattr__, __dir__ = lazy(__name__)
