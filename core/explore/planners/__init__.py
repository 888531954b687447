"""Which slice to trace next, and when to stop.

Planners are frozen dataclasses with one pure function of an `Observation`, one a file of the same
name (``uniform``, `Uniform`); add your own as ``module:Class``, its numbers with ranges. It rests
on core arrays and ranges alone, and touches nothing: lengths are shares of the object's height.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.explore.planners.coverage import Span as Span
    from palpate.core.explore.planners.coverage import free_height as free_height
    from palpate.core.explore.planners.coverage import longest_first as longest_first
    from palpate.core.explore.planners.coverage import profile_of as profile_of
    from palpate.core.explore.planners.coverage import untouched_spans as untouched_spans
    from palpate.core.explore.planners.coverage import untraceable_height as untraceable_height
    from palpate.core.explore.planners.estimate import Estimate as Estimate
    from palpate.core.explore.planners.estimate import estimate_error as estimate_error
    from palpate.core.explore.planners.fuzzy import Fuzzy as Fuzzy
    from palpate.core.explore.planners.predicted import COVERING as COVERING
    from palpate.core.explore.planners.predicted import UNTOUCHED as UNTOUCHED
    from palpate.core.explore.planners.predicted import Predicted as Predicted
    from palpate.core.explore.planners.protocol import END_SHARE as END_SHARE
    from palpate.core.explore.planners.protocol import LEAST_FEATURE as LEAST_FEATURE
    from palpate.core.explore.planners.protocol import PLANNER_NAMES as PLANNER_NAMES
    from palpate.core.explore.planners.protocol import Budget as Budget
    from palpate.core.explore.planners.protocol import Choice as Choice
    from palpate.core.explore.planners.protocol import Height as Height
    from palpate.core.explore.planners.protocol import Observation as Observation
    from palpate.core.explore.planners.protocol import ObservedSlice as ObservedSlice
    from palpate.core.explore.planners.protocol import Planner as Planner
    from palpate.core.explore.planners.protocol import SliceOutcome as SliceOutcome
    from palpate.core.explore.planners.protocol import Stop as Stop
    from palpate.core.explore.planners.protocol import Touch as Touch
    from palpate.core.explore.planners.protocol import Wait as Wait
    from palpate.core.explore.planners.protocol import WrongChoiceError as WrongChoiceError
    from palpate.core.explore.planners.protocol import check_choice as check_choice
    from palpate.core.explore.planners.protocol import exhausted_budget as exhausted_budget
    from palpate.core.explore.planners.protocol import first_and_last as first_and_last
    from palpate.core.explore.planners.protocol import make_planner as make_planner
    from palpate.core.explore.planners.protocol import planner_type as planner_type
    from palpate.core.explore.planners.protocol import settled_height as settled_height
    from palpate.core.explore.planners.protocol import (
        slice_without_contour as slice_without_contour,
    )
    from palpate.core.explore.planners.surface import ObservedSurface as ObservedSurface
    from palpate.core.explore.planners.surface import OpenArea as OpenArea
    from palpate.core.explore.planners.surface import TouchOffer as TouchOffer
    from palpate.core.explore.planners.thesis import TEMPLATES as TEMPLATES
    from palpate.core.explore.planners.thesis import Thesis as Thesis
    from palpate.core.explore.planners.touches import Touches as Touches
    from palpate.core.explore.planners.touches import next_touch as next_touch
    from palpate.core.explore.planners.trial import AROUND as AROUND
    from palpate.core.explore.planners.trial import EXTENT as EXTENT
    from palpate.core.explore.planners.trial import HELD_OUT as HELD_OUT
    from palpate.core.explore.planners.trial import MOST_CONTOURS_PLANNED as MOST_CONTOURS_PLANNED
    from palpate.core.explore.planners.trial import TUNED as TUNED
    from palpate.core.explore.planners.trial import PlannerTrial as PlannerTrial
    from palpate.core.explore.planners.trial import Radius as Radius
    from palpate.core.explore.planners.trial import lost_slice as lost_slice
    from palpate.core.explore.planners.trial import measure_side as measure_side
    from palpate.core.explore.planners.trial import observation_of as observation_of
    from palpate.core.explore.planners.trial import run_planner as run_planner
    from palpate.core.explore.planners.uniform import Uniform as Uniform
else:
    __getattr__, __dir__ = lazy(__name__)
