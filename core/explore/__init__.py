"""Where to touch next.

What an exploration has found so far, as one value, from which planners are told. The rooms below
grasp an object, trace its slices, plan them and probe its ends; all are pure functions of
values, so that a recorded run can be explored again by another rule. It rests on core touch,
shapes and geometry.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.explore.free_space import TOUCHED as TOUCHED
    from palpate.core.explore.free_space import VOXEL as VOXEL
    from palpate.core.explore.free_space import Longs as Longs
    from palpate.core.explore.free_space import SpaceMap as SpaceMap
    from palpate.core.explore.free_space import empty_map as empty_map
    from palpate.core.explore.free_space import spanned_places as spanned_places
    from palpate.core.explore.free_space import swept_places as swept_places
    from palpate.core.explore.survey import APART as APART
    from palpate.core.explore.survey import FEATURE_SHARE as FEATURE_SHARE
    from palpate.core.explore.survey import Demand as Demand
    from palpate.core.explore.survey import ModelUncertainty as ModelUncertainty
    from palpate.core.explore.survey import Survey as Survey
    from palpate.core.explore.survey import TracedContour as TracedContour
    from palpate.core.explore.survey import next_finished as next_finished
    from palpate.core.explore.survey import widened as widened
else:
    __getattr__, __dir__ = lazy(__name__)
