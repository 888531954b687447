"""What the planner node remembers.

And what closings of the hand and probes of the ends add to it. To be tuned: number of contacts
and grips, spacing of the search, nearness of an end, on top of `phases`. Rests on
`palpate.core.explore`, which holds every rule; used by the planner node alone.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.nodes.planning.budget import Allowance, allowance, fits_contour, shortest_grasp
    from palpate.nodes.planning.knowledge import observed_surface, plan_done
    from palpate.nodes.planning.phases import State, Task, contour_goal, contour_limit
    from palpate.nodes.planning.phases import fitted_superquadric, grasp_goal, model_goal
    from palpate.nodes.planning.phases import next_touch, probe_goal
    from palpate.nodes.planning.phases import traced_of, with_coarse, with_contacts, with_probe
    from palpate.nodes.planning.phases import with_single
else:
    __getattr__, __dir__ = lazy(__name__)
