"""A smooth side surface through contours that correspond (lofting, or skinning).

And how far it can be trusted between them. The strengths of smoothing follow from
cross-validation; what may be tuned is when points are left out and when the parameter along the
axis is changed. It rests on `palpate.core.rebuild.contours` and on bases and modes of
`palpate.core.splines`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.loft.lofting import SAFE_MOST as SAFE_MOST
    from palpate.core.rebuild.loft.lofting import SAFE_RMS as SAFE_RMS
    from palpate.core.rebuild.loft.lofting import ContourLoft as ContourLoft
    from palpate.core.rebuild.loft.lofting import Uncertainty as Uncertainty
    from palpate.core.rebuild.loft.lofting import fit_contour_loft as fit_contour_loft
    from palpate.core.rebuild.loft.lofting import noise_of as noise_of
    from palpate.core.rebuild.loft.smoothing import bending_along as bending_along
    from palpate.core.rebuild.loft.smoothing import bending_around as bending_around
    from palpate.core.rebuild.loft.surfaces import ContourSurface as ContourSurface
    from palpate.core.rebuild.loft.surfaces import SidePatch as SidePatch
else:
    __getattr__, __dir__ = lazy(__name__)
