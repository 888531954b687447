"""Grasp by containment.

The first coarse knowledge of size, place and slicing axis, from few contacts of a closing hand.
A hand and its poses may be replaced, and so may the coarse model (any `FittedSuperquadric` will
do). It rests on shapes and touch; what comes out is an `ObjectFrame`, in which all else is told.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.explore.grasp.axes import end_face_axis as end_face_axis
    from palpate.core.explore.grasp.axes import revolution_axis as revolution_axis
    from palpate.core.explore.grasp.hand import Closing as Closing
    from palpate.core.explore.grasp.hand import Hand as Hand
    from palpate.core.explore.grasp.hand import brought_near as brought_near
    from palpate.core.explore.grasp.hand import close_hand as close_hand
    from palpate.core.explore.grasp.hand import next_pose as next_pose
    from palpate.core.explore.grasp.hand import search_places as search_places
    from palpate.core.explore.grasp.hand import search_pose as search_pose
    from palpate.core.explore.grasp.object_frame import MassProperties as MassProperties
    from palpate.core.explore.grasp.object_frame import ObjectFrame as ObjectFrame
    from palpate.core.explore.grasp.object_frame import fit_object_frame as fit_object_frame
    from palpate.core.explore.grasp.object_frame import mass_properties as mass_properties
else:
    __getattr__, __dir__ = lazy(__name__)
