"""Where to touch next.

What an exploration has found so far, as one value, from which planners are told. The rooms below
grasp an object, trace its slices, plan them and probe its ends; all are pure functions of values,
so that a recorded run can be explored again. It rests on core touch, shapes and geometry.
"""

from palpate.core.explore.free_space import (
    TOUCHED,
    VOXEL,
    Longs,
    SpaceMap,
    empty_map,
    spanned_places,
    swept_places,
)
from palpate.core.explore.survey import (
    APART,
    FEATURE_SHARE,
    Demand,
    ModelUncertainty,
    Survey,
    TracedContour,
    next_finished,
    widened,
)
