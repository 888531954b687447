"""Which slice to trace next, and when to stop.

Planners are frozen dataclasses with one pure function of an `Observation`, each in a file of its
name (``uniform``, `Uniform`); a user's own is named ``module:Class``, its numbers have ranges.
Lengths are fractions of the object's height. It rests on core arrays and ranges alone.
"""

from palpate.core.explore.planners.approaches import (
    TouchOffer as TouchOffer,
)
from palpate.core.explore.planners.coverage import (
    Span as Span,
    free_height as free_height,
    hermite as hermite,
    longest_first as longest_first,
    profile_of as profile_of,
    stack_slices as stack_slices,
    untouched_spans as untouched_spans,
    untraceable_height as untraceable_height,
)
from palpate.core.explore.planners.error_bound import (
    Estimate as Estimate,
    estimate_error as estimate_error,
)
from palpate.core.explore.planners.fuzzy import (
    Fuzzy as Fuzzy,
)
from palpate.core.explore.planners.learned import (
    TRAINED as TRAINED,
    Learned as Learned,
    LearnedSteps as LearnedSteps,
    StepNetwork as StepNetwork,
    network_inputs as network_inputs,
)
from palpate.core.explore.planners.predicted import (
    COVERING as COVERING,
    UNTOUCHED as UNTOUCHED,
    Predicted as Predicted,
    PredictedSettings as PredictedSettings,
)
from palpate.core.explore.planners.protocol import (
    ALL_REACHED as ALL_REACHED,
    MIN_FEATURE as MIN_FEATURE,
    PLANNER_NAMES as PLANNER_NAMES,
    Budget as Budget,
    Choice as Choice,
    Height as Height,
    Observation as Observation,
    ObservedSlice as ObservedSlice,
    Planner as Planner,
    SliceOutcome as SliceOutcome,
    SliceSettings as SliceSettings,
    Stop as Stop,
    Touch as Touch,
    Wait as Wait,
    WrongChoiceError as WrongChoiceError,
    check_choice as check_choice,
    exhausted_budget as exhausted_budget,
    first_and_last as first_and_last,
    make_planner as make_planner,
    planner_type as planner_type,
    settled_height as settled_height,
    slice_without_contour as slice_without_contour,
)
from palpate.core.explore.planners.surface import (
    DEFAULT_SURFACE as DEFAULT_SURFACE,
    ObservedSurface as ObservedSurface,
    OpenArea as OpenArea,
    Progress as Progress,
    SurfaceSettings as SurfaceSettings,
)
from palpate.core.explore.planners.thesis import (
    TEMPLATES as TEMPLATES,
    Thesis as Thesis,
    mean_profile_curvature as mean_profile_curvature,
    polyline_of as polyline_of,
)
from palpate.core.explore.planners.touches import (
    Touches as Touches,
    TouchPlannerSettings as TouchPlannerSettings,
    next_touch as next_touch,
)
from palpate.core.explore.planners.trial import (
    DEFAULT_TRIAL as DEFAULT_TRIAL,
    TUNED as TUNED,
    PlannerTrial as PlannerTrial,
    Radius as Radius,
    TrialSettings as TrialSettings,
    lost_slice as lost_slice,
    measure_side as measure_side,
    observation_of as observation_of,
    run_planner as run_planner,
)
from palpate.core.explore.planners.turning import (
    TurningSettings as TurningSettings,
    choose_turn as choose_turn,
)
from palpate.core.explore.planners.uniform import (
    Uniform as Uniform,
)
from palpate.core.explore.planners.verdict import (
    Criterion as Criterion,
    Findings as Findings,
    Limits as Limits,
    Verdict as Verdict,
    judge as judge,
)
