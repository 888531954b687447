"""The objects of all measurements, with exact contours, slices or meshes as their truth.

Add an object at the end of its table; those that are held out must have no say in any number of
palpate. It rests on core.shapes and core.geometry, and a planner's trial on core.explore.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.bench.objects.contoured import HALF as HALF
    from palpate.bench.objects.contoured import REBUILT_SHAPES as REBUILT_SHAPES
    from palpate.bench.objects.contoured import ROUND_HEIGHT as ROUND_HEIGHT
    from palpate.bench.objects.contoured import ROUND_OBJECTS as ROUND_OBJECTS
    from palpate.bench.objects.contoured import SHAPE_HEIGHT as SHAPE_HEIGHT
    from palpate.bench.objects.contoured import WAVY as WAVY
    from palpate.bench.objects.contoured import ContouredShape as ContouredShape
    from palpate.bench.objects.contoured import MeshErrors as MeshErrors
    from palpate.bench.objects.contoured import RoundObject as RoundObject
    from palpate.bench.objects.contoured import TrueSurface as TrueSurface
    from palpate.bench.objects.contoured import radial_rings as radial_rings
    from palpate.bench.objects.contoured import truth_of as truth_of
    from palpate.bench.objects.contoured import truth_of_mesh as truth_of_mesh
    from palpate.bench.objects.touched import EXPLORED_HEIGHT as EXPLORED_HEIGHT
    from palpate.bench.objects.touched import EXPLORED_OBJECTS as EXPLORED_OBJECTS
    from palpate.bench.objects.touched import GRASPED_OBJECTS as GRASPED_OBJECTS
    from palpate.bench.objects.touched import TRACED_OBJECTS as TRACED_OBJECTS
    from palpate.bench.objects.touched import ExploreObject as ExploreObject
    from palpate.bench.objects.touched import TracedSolid as TracedSolid
    from palpate.bench.objects.touched import dented as dented
    from palpate.bench.objects.touched import drawn_object as drawn_object
    from palpate.bench.objects.touched import notched as notched
    from palpate.bench.objects.touched import wedged as wedged
else:
    __getattr__, __dir__ = lazy(__name__)
