"""Ends of a solid beyond its first and last contours.

Profile families and the choice among them, heights and middles of touched ends, sheared ends, and
reliefs of faces. A new family goes into `profiles`, and into the tables of `closing`. It rests on
contact points and on the radial spline.
"""

from palpate.core.rebuild.ends.closing import (
    ClosingSettings as ClosingSettings,
    End as End,
    close_ends as close_ends,
)
from palpate.core.rebuild.ends.planes import (
    EndPlaneSettings as EndPlaneSettings,
    Shear as Shear,
    is_known_untouched as is_known_untouched,
    levelled as levelled,
    shear_between as shear_between,
)
from palpate.core.rebuild.ends.profiles import (
    ProfileCurve as ProfileCurve,
    Relief as Relief,
    StraightCurve as StraightCurve,
    profile_curves as profile_curves,
)
from palpate.core.rebuild.ends.relief import (
    ReliefSettings as ReliefSettings,
    end_fractions as end_fractions,
    with_relief as with_relief,
)
from palpate.core.rebuild.ends.touched import (
    EndHeightSettings as EndHeightSettings,
    TouchedEndSettings as TouchedEndSettings,
    end_from_contacts as end_from_contacts,
    end_height as end_height,
    on_end as on_end,
)
