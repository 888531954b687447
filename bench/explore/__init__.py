"""Explorations.

Several fingers and other axes compared; a Gaussian process that explores by greatest variance with
the same finger. `harness` makes one exploration in
this process and keeps what it published; a measurement is a loop over objects around it. It rests
on launch (a scene file is planned as a user's is) and on bench.objects.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.bench.explore.gp_explorer import Explorer as Explorer
    from palpate.bench.explore.gp_explorer import GuardedFinger as GuardedFinger
    from palpate.bench.explore.harness import NOISES as NOISES
    from palpate.bench.explore.harness import NOISY as NOISY
    from palpate.bench.explore.harness import Demand as Demand
    from palpate.bench.explore.harness import Explored as Explored
    from palpate.bench.explore.harness import InProcessLoop as InProcessLoop
    from palpate.bench.explore.harness import LoopNode as LoopNode
    from palpate.bench.explore.harness import MessageCollector as MessageCollector
    from palpate.bench.explore.harness import Noise as Noise
    from palpate.bench.explore.harness import compose_scene as compose_scene
    from palpate.bench.explore.harness import explore_object as explore_object
    from palpate.bench.explore.harness import percent_of as percent_of
    from palpate.bench.explore.harness import touching_nodes as touching_nodes
    from palpate.bench.explore.harness import write_scene as write_scene
else:
    __getattr__, __dir__ = lazy(__name__)
