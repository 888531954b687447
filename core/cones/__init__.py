"""Cones from a few touches: R. S. Fearing's recovery of axis and apex from contact features.

A touch is classified as a vertex, an edge, a face or a parabolic point; tables state which of them
suffice, and which places on a cone they may have. The tables are data, thresholds are fields of
settings classes, and the equations follow from geometry alone. The package uses core arrays.
"""

from palpate.core.cones.features import (
    ContactFeature as ContactFeature,
    Feature as Feature,
    FeatureGroup as FeatureGroup,
    FeaturePlace as FeaturePlace,
    FeatureSettings as FeatureSettings,
    feature_of_contact as feature_of_contact,
)
from palpate.core.cones.interpretation import (
    Interpretation as Interpretation,
    InterpretationSettings as InterpretationSettings,
    interpretations as interpretations,
)
from palpate.core.cones.solving import (
    ConeOrientation as ConeOrientation,
    ConeOrigin as ConeOrigin,
    InsufficientFeaturesError as InsufficientFeaturesError,
    ScaledRadius as ScaledRadius,
    SolvingSettings as SolvingSettings,
    residual_sigma as residual_sigma,
    scaled_radii as scaled_radii,
    solve_orientation as solve_orientation,
    solve_origin as solve_origin,
)
from palpate.core.cones.tables import (
    TableRow as TableRow,
    row_of as row_of,
)
