"""How a solid goes on beyond its first and last contours.

Profile families and their choice, what touches say of an end, reliefs of faces, sheared ends.
Families may be added in `profiles` and offered in `closing`; thresholds are shares of a radius or
deviations. It rests on contact points and the radial spline, told where slices are level.
"""

from palpate.core.rebuild.ends.closing import End, close_ends
from palpate.core.rebuild.ends.profiles import ProfileCurve, Relief, StraightCurve, profile_curves
from palpate.core.rebuild.ends.relief import end_ways, with_relief
from palpate.core.rebuild.ends.touched import (
    Shear,
    end_from_contacts,
    levelled,
    on_end,
    only_given,
    shear_between,
    touched_end,
)
