"""Grasp by containment.

The first coarse estimate of size, place and slicing axis, from few contacts of a closing hand. A
hand and its poses may be replaced, and so may the coarse model, which is any `FittedSuperquadric`.
The result is an `ObjectFrame`, in which the object is sliced. It rests on shapes and touch.
"""

from palpate.core.explore.grasp.axes import (
    end_face_axis as end_face_axis,
    revolution_axis as revolution_axis,
)
from palpate.core.explore.grasp.corrected_solid import (
    MassProperties as MassProperties,
    mass_properties as mass_properties,
)
from palpate.core.explore.grasp.hand import (
    Closing as Closing,
    Hand as Hand,
    HandSettings as HandSettings,
    brought_near as brought_near,
    close_hand as close_hand,
    next_pose as next_pose,
    search_places as search_places,
    search_pose as search_pose,
)
from palpate.core.explore.grasp.object_frame import (
    FrameSettings as FrameSettings,
    ObjectFrame as ObjectFrame,
    fit_object_frame as fit_object_frame,
)
