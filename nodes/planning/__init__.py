"""What the planner node remembers.

And what closings of the hand and probes of the ends add to it. To be tuned: number of contacts
and grips, spacing of the search, nearness of an end, on top of `phases`. Rests on
`palpate.core.explore`, which holds every rule; used by the planner node alone.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.nodes.planning.budget import Allowance as Allowance
    from palpate.nodes.planning.budget import allowance as allowance
    from palpate.nodes.planning.budget import fits_contour as fits_contour
    from palpate.nodes.planning.budget import shortest_grasp as shortest_grasp
    from palpate.nodes.planning.phases import State as State
    from palpate.nodes.planning.phases import Task as Task
    from palpate.nodes.planning.phases import contour_goal as contour_goal
    from palpate.nodes.planning.phases import contour_limit as contour_limit
    from palpate.nodes.planning.phases import grasp_goal as grasp_goal
    from palpate.nodes.planning.phases import model_goal as model_goal
    from palpate.nodes.planning.phases import next_touch as next_touch
    from palpate.nodes.planning.phases import probe_goal as probe_goal
    from palpate.nodes.planning.phases import touch_goal as touch_goal
    from palpate.nodes.planning.phases import traced_of as traced_of
    from palpate.nodes.planning.phases import with_coarse as with_coarse
    from palpate.nodes.planning.phases import with_contacts as with_contacts
    from palpate.nodes.planning.phases import with_probe as with_probe
    from palpate.nodes.planning.phases import with_single as with_single
else:
    __getattr__, __dir__ = lazy(__name__)
