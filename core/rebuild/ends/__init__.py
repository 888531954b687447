"""How a solid goes on beyond its first and last contours.

Profile families and their choice, what touches say of an end, reliefs of faces, sheared ends.
Families may be added in `profiles` and offered in `closing`; thresholds are shares of a radius or
standard deviations. It rests on contact points and on the radial spline, and is told in the frame
in which slices are level.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.ends.closing import End as End
    from palpate.core.rebuild.ends.closing import close_ends as close_ends
    from palpate.core.rebuild.ends.profiles import ProfileCurve as ProfileCurve
    from palpate.core.rebuild.ends.profiles import Relief as Relief
    from palpate.core.rebuild.ends.profiles import StraightCurve as StraightCurve
    from palpate.core.rebuild.ends.profiles import profile_curves as profile_curves
    from palpate.core.rebuild.ends.relief import end_ways as end_ways
    from palpate.core.rebuild.ends.relief import with_relief as with_relief
    from palpate.core.rebuild.ends.touched import Shear as Shear
    from palpate.core.rebuild.ends.touched import end_from_contacts as end_from_contacts
    from palpate.core.rebuild.ends.touched import levelled as levelled
    from palpate.core.rebuild.ends.touched import on_end as on_end
    from palpate.core.rebuild.ends.touched import only_given as only_given
    from palpate.core.rebuild.ends.touched import shear_between as shear_between
    from palpate.core.rebuild.ends.touched import touched_end as touched_end
else:
    __getattr__, __dir__ = lazy(__name__)
