"""Grasp by containment.

The first coarse knowledge of size, place and slicing axis, from few contacts of a closing hand.
A hand and its poses may be replaced, and so may the coarse model (any `FittedSuperquadric` will
do). It rests on shapes and touch; what comes out is an `ObjectFrame`, in which all else is told.
"""

from palpate.core.explore.grasp.axes import (
    end_face_axis as end_face_axis,
    revolution_axis as revolution_axis,
)
from palpate.core.explore.grasp.hand import (
    SEARCH_HEIGHTS as SEARCH_HEIGHTS,
    Closing as Closing,
    Hand as Hand,
    brought_near as brought_near,
    close_hand as close_hand,
    next_pose as next_pose,
    search_places as search_places,
    search_pose as search_pose,
)
from palpate.core.explore.grasp.object_frame import (
    MassProperties as MassProperties,
    ObjectFrame as ObjectFrame,
    fit_object_frame as fit_object_frame,
    mass_properties as mass_properties,
)
