"""Which slice to trace next, and when to stop.

Planners are frozen dataclasses with one pure function of an `Observation`, one a file of the same
name (``uniform``, `Uniform`); add your own as ``module:Class``, its numbers with ranges. It rests
on core arrays and ranges alone, and touches nothing: lengths are shares of the object's height.
"""

from palpate.core.explore.planners.coverage import (
    Estimate,
    Span,
    estimate_error,
    free_height,
    longest_first,
    profile_of,
    untouched_spans,
    untraceable_height,
)
from palpate.core.explore.planners.fuzzy import Fuzzy
from palpate.core.explore.planners.predicted import COVERING, UNTOUCHED, Predicted
from palpate.core.explore.planners.protocol import (
    ALL_REACHED,
    END_SHARE,
    LEAST_FEATURE,
    PLANNER_NAMES,
    Budget,
    Choice,
    Height,
    Observation,
    ObservedSlice,
    Planner,
    SliceOutcome,
    Stop,
    Touch,
    Wait,
    WrongChoiceError,
    check_choice,
    exhausted_budget,
    first_and_last,
    make_planner,
    planner_type,
    settled_height,
    slice_without_contour,
)
from palpate.core.explore.planners.surface import ObservedSurface, OpenArea, Progress, TouchOffer
from palpate.core.explore.planners.thesis import TEMPLATES, Thesis, polyline_of
from palpate.core.explore.planners.touches import Touches, next_touch
from palpate.core.explore.planners.trial import (
    AROUND,
    EXTENT,
    MOST_CONTOURS_PLANNED,
    TUNED,
    PlannerTrial,
    Radius,
    lost_slice,
    measure_side,
    observation_of,
    run_planner,
)
from palpate.core.explore.planners.uniform import Uniform
from palpate.core.explore.planners.verdict import Criterion, Findings, Limits, Verdict, judge
