"""Which slice to trace next, and when to stop.

Planners are frozen dataclasses with one pure function of an `Observation`, one a file of the same
name (``uniform``, `Uniform`); add your own as ``module:Class``, its numbers with ranges. It rests
on core arrays and ranges alone, and touches nothing: lengths are shares of the object's height.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.explore.planners.coverage import Estimate, Span, estimate_error, free_height
    from palpate.core.explore.planners.coverage import longest_first, profile_of, untouched_spans
    from palpate.core.explore.planners.coverage import untraceable_height
    from palpate.core.explore.planners.fuzzy import Fuzzy
    from palpate.core.explore.planners.predicted import COVERING, UNTOUCHED, Predicted
    from palpate.core.explore.planners.protocol import ALL_REACHED, END_SHARE, LEAST_FEATURE
    from palpate.core.explore.planners.protocol import PLANNER_NAMES
    from palpate.core.explore.planners.protocol import Budget, Choice, Height, Observation
    from palpate.core.explore.planners.protocol import ObservedSlice, Planner, SliceOutcome, Stop
    from palpate.core.explore.planners.protocol import Touch, Wait, WrongChoiceError, check_choice
    from palpate.core.explore.planners.protocol import exhausted_budget, first_and_last
    from palpate.core.explore.planners.protocol import make_planner, planner_type, settled_height
    from palpate.core.explore.planners.protocol import slice_without_contour
    from palpate.core.explore.planners.surface import ObservedSurface, OpenArea, Progress
    from palpate.core.explore.planners.surface import TouchOffer
    from palpate.core.explore.planners.thesis import TEMPLATES, Thesis, polyline_of
    from palpate.core.explore.planners.touches import Touches, next_touch
    from palpate.core.explore.planners.trial import AROUND, EXTENT, MOST_CONTOURS_PLANNED
    from palpate.core.explore.planners.trial import TUNED, PlannerTrial, Radius, lost_slice
    from palpate.core.explore.planners.trial import measure_side, observation_of, run_planner
    from palpate.core.explore.planners.uniform import Uniform
    from palpate.core.explore.planners.verdict import Criterion, Findings, Limits, Verdict, judge
else:
    __getattr__, __dir__ = lazy(__name__)
