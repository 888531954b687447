"""How a solid goes on beyond its first and last contours.

Profile families and their choice, what touches say of an end, reliefs of faces, sheared ends.
Families may be added in `profiles` and offered in `closing`; thresholds are shares of a radius or
deviations. It rests on contact points and the radial spline, told where slices are level.
"""

from palpate.core.rebuild.ends.closing import (
    End as End,
    close_ends as close_ends,
)
from palpate.core.rebuild.ends.profiles import (
    ProfileCurve as ProfileCurve,
    Relief as Relief,
    StraightCurve as StraightCurve,
    profile_curves as profile_curves,
)
from palpate.core.rebuild.ends.relief import (
    end_ways as end_ways,
    with_relief as with_relief,
)
from palpate.core.rebuild.ends.touched import (
    Shear as Shear,
    end_from_contacts as end_from_contacts,
    levelled as levelled,
    on_end as on_end,
    only_given as only_given,
    shear_between as shear_between,
    touched_end as touched_end,
)
