"""Grasp by containment.

The first coarse knowledge of size, place and slicing axis, from few contacts of a closing hand.
A hand and its poses may be replaced, and so may the coarse model (any `FittedSuperquadric` will
do). It rests on shapes and touch; what comes out is an `ObjectFrame`, in which all else is told.
"""

from palpate.core.explore.grasp.axes import end_face_axis, revolution_axis
from palpate.core.explore.grasp.hand import (
    SEARCH_HEIGHTS,
    Closing,
    Hand,
    brought_near,
    close_hand,
    next_pose,
    search_places,
    search_pose,
)
from palpate.core.explore.grasp.object_frame import (
    MassProperties,
    ObjectFrame,
    fit_object_frame,
    mass_properties,
)
