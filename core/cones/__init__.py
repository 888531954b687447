"""Cones from a few touches: R. S. Fearing's recovery of axis and apex from contact features.

A touch is read as a vertex, an edge, a face or a parabolic point; tables say which of them suffice,
and which places on a cone they may have. The tables are data, and the thresholds on top of each
chapter may be tuned; the equations follow from geometry alone. It rests on core arrays.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.cones.features import ContactFeature as ContactFeature
    from palpate.core.cones.features import Feature as Feature
    from palpate.core.cones.features import FeatureGroup as FeatureGroup
    from palpate.core.cones.features import FeaturePlace as FeaturePlace
    from palpate.core.cones.features import feature_of_contact as feature_of_contact
    from palpate.core.cones.interpretation import Interpretation as Interpretation
    from palpate.core.cones.interpretation import interpretations as interpretations
    from palpate.core.cones.solving import ConeOrientation as ConeOrientation
    from palpate.core.cones.solving import ConeOrigin as ConeOrigin
    from palpate.core.cones.solving import InsufficientFeaturesError as InsufficientFeaturesError
    from palpate.core.cones.solving import ScaledRadius as ScaledRadius
    from palpate.core.cones.solving import residual_sigma as residual_sigma
    from palpate.core.cones.solving import scaled_radii as scaled_radii
    from palpate.core.cones.solving import solve_orientation as solve_orientation
    from palpate.core.cones.solving import solve_origin as solve_origin
    from palpate.core.cones.tables import TableRow as TableRow
    from palpate.core.cones.tables import row_of as row_of
else:
    __getattr__, __dir__ = lazy(__name__)
