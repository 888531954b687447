"""Where to touch next.

An `Exploration` is all that is known so far, as one value; `goals` derives the next goals from it.
The rooms below grasp an object, trace its slices, plan them and probe its ends; all are pure
functions of values, so that a recorded run can be replayed. It uses core touch and geometry.
"""

from palpate.core.explore.decision import goals as goals
from palpate.core.explore.exploration import (
    Exploration as Exploration,
    Finger as Finger,
    GoalSettings as GoalSettings,
    GraspSettings as GraspSettings,
    HandContacts as HandContacts,
    Lying as Lying,
    ModelStatus as ModelStatus,
    ProbedPoint as ProbedPoint,
    Result as Result,
    Setup as Setup,
    with_coarse as with_coarse,
    with_contacts as with_contacts,
    with_model as with_model,
    with_result as with_result,
    with_turned as with_turned,
)
from palpate.core.explore.free_space import (
    TOUCHED as TOUCHED,
    Longs as Longs,
    SpaceMap as SpaceMap,
    SweepSettings as SweepSettings,
    UntouchedPlaces as UntouchedPlaces,
    empty_map as empty_map,
    spanned_places as spanned_places,
    swept_places as swept_places,
    untouched_places as untouched_places,
)
from palpate.core.explore.placing import (
    KnownSurface as KnownSurface,
    Placement as Placement,
    PlacingSettings as PlacingSettings,
    place_object as place_object,
)
from palpate.core.explore.survey import (
    DEFAULT_SURVEY as DEFAULT_SURVEY,
    Demand as Demand,
    ModelUncertainty as ModelUncertainty,
    Survey as Survey,
    SurveySettings as SurveySettings,
    TracedContour as TracedContour,
    Underside as Underside,
    next_finished as next_finished,
    widened as widened,
)
from palpate.core.explore.tasks import (
    CloseHand as CloseHand,
    Done as Done,
    Goal as Goal,
    MakeModel as MakeModel,
    SingleTouch as SingleTouch,
    Task as Task,
    TouchEnd as TouchEnd,
    TraceSlice as TraceSlice,
    TurnObject as TurnObject,
)
