"""Planners of slices and touches, and what one of your own is made of: see docs/planning.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.explore.planners import PLANNER_NAMES as PLANNER_NAMES, TUNED as TUNED
    from palpate.core.explore.planners import Budget as Budget, Choice as Choice
    from palpate.core.explore.planners import Criterion as Criterion, Estimate as Estimate
    from palpate.core.explore.planners import Findings as Findings, Height as Height
    from palpate.core.explore.planners import Limits as Limits
    from palpate.core.explore.planners import Observation as Observation
    from palpate.core.explore.planners import ObservedSlice as ObservedSlice
    from palpate.core.explore.planners import ObservedSurface as ObservedSurface
    from palpate.core.explore.planners import PlannerTrial as PlannerTrial, Span as Span
    from palpate.core.explore.planners import Stop as Stop, Touch as Touch, TouchOffer as TouchOffer
    from palpate.core.explore.planners import Verdict as Verdict, Wait as Wait
    from palpate.core.explore.planners import estimate_error as estimate_error
    from palpate.core.explore.planners import exhausted_budget as exhausted_budget
    from palpate.core.explore.planners import first_and_last as first_and_last
    from palpate.core.explore.planners import free_height as free_height, judge as judge
    from palpate.core.explore.planners import longest_first as longest_first
    from palpate.core.explore.planners import lost_slice as lost_slice, make_planner as make_planner
    from palpate.core.explore.planners import observation_of as observation_of
    from palpate.core.explore.planners import run_planner as run_planner
    from palpate.core.explore.planners import untouched_spans as untouched_spans
else:
    __getattr__, __dir__ = lazy(__name__)
