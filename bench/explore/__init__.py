"""Explorations.

`harness` makes one in this process and keeps what it published; a measurement is a loop over
objects around it. A Gaussian process explores by greatest variance with the same finger. It rests
on launch (a scene file is planned as a user's is) and on bench.objects.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.bench.explore.gp_explorer import Explorer, GuardedFinger
    from palpate.bench.explore.harness import NOISES, NOISY, Demand, Explored, InProcessLoop
    from palpate.bench.explore.harness import LoopNode, MessageCollector, Noise, compose_scene
    from palpate.bench.explore.harness import explore_object, percent_of, touching_nodes
    from palpate.bench.explore.harness import write_scene
else:
    __getattr__, __dir__ = lazy(__name__)
