"""Where to touch next.

What an exploration has found so far, as one value, from which planners are told. The rooms below
grasp an object, trace its slices, plan them and probe its ends; all are pure functions of values,
so that a recorded run can be explored again. It rests on core touch, shapes and geometry.
"""

from palpate.core.explore.free_space import (
    TOUCHED as TOUCHED,
    VOXEL as VOXEL,
    Longs as Longs,
    SpaceMap as SpaceMap,
    empty_map as empty_map,
    spanned_places as spanned_places,
    swept_places as swept_places,
)
from palpate.core.explore.survey import (
    APART as APART,
    FEATURE_SHARE as FEATURE_SHARE,
    Demand as Demand,
    ModelUncertainty as ModelUncertainty,
    Survey as Survey,
    TracedContour as TracedContour,
    next_finished as next_finished,
    widened as widened,
)
