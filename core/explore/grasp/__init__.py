"""Grasp by containment.

The first coarse knowledge of size, place and slicing axis, from few contacts of a closing hand.
A hand and its poses may be replaced, and so may the coarse model (any `FittedSuperquadric` will
do). It rests on shapes and touch; what comes out is an `ObjectFrame`, in which all else is told.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.explore.grasp.axes import end_face_axis, revolution_axis
    from palpate.core.explore.grasp.hand import SEARCH_HEIGHTS, Closing, Hand, brought_near
    from palpate.core.explore.grasp.hand import close_hand
    from palpate.core.explore.grasp.hand import next_pose, search_places, search_pose
    from palpate.core.explore.grasp.object_frame import MassProperties, ObjectFrame
    from palpate.core.explore.grasp.object_frame import fit_object_frame, mass_properties
else:
    __getattr__, __dir__ = lazy(__name__)
