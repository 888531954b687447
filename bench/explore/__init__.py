"""Explorations.

Slices traced, grasps judged, planners counted, and whole runs held against error, cost and their
own word. `harness` makes one exploration in this process and keeps what was published; a
measurement is a loop over objects around it. It rests on launch (a scene file is written and
planned as a user's is) and on bench.objects.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.bench.explore.harness import NOISES as NOISES
    from palpate.bench.explore.harness import Demand as Demand
    from palpate.bench.explore.harness import Explored as Explored
    from palpate.bench.explore.harness import InProcessLoop as InProcessLoop
    from palpate.bench.explore.harness import LoopNode as LoopNode
    from palpate.bench.explore.harness import explore_scene as explore_scene
    from palpate.bench.explore.harness import path_length as path_length
    from palpate.bench.explore.harness import touching_nodes as touching_nodes
    from palpate.bench.explore.harness import write_scene as write_scene
else:
    __getattr__, __dir__ = lazy(__name__)
