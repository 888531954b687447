"""The side surface as a radial spline fitted to every touched taxel at once.

With a shift of each touch where poses err. The numbers of spans and coefficients and the
strengths of bending may be tuned: they were set together on the shipped scenes. It rests on
contact points in `palpate.core.rebuild.contours` and on the penalties of
`palpate.core.rebuild.loft`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.radial.equations import AxisCurve as AxisCurve
    from palpate.core.rebuild.radial.equations import fit_axis_curve as fit_axis_curve
    from palpate.core.rebuild.radial.equations import looks_inward as looks_inward
    from palpate.core.rebuild.radial.spline import POSE_LEFT as POSE_LEFT
    from palpate.core.rebuild.radial.spline import SECTORS as SECTORS
    from palpate.core.rebuild.radial.spline import Coverage as Coverage
    from palpate.core.rebuild.radial.spline import RadialFit as RadialFit
    from palpate.core.rebuild.radial.spline import RadialSpline as RadialSpline
    from palpate.core.rebuild.radial.spline import coverage_of as coverage_of
    from palpate.core.rebuild.radial.spline import fit_radial_spline as fit_radial_spline
    from palpate.core.rebuild.radial.spline import fit_shifted_spline as fit_shifted_spline
    from palpate.core.rebuild.radial.spline import pose_sigma as pose_sigma
    from palpate.core.rebuild.radial.spline import radial_fit as radial_fit
    from palpate.core.rebuild.radial.spline import with_normals as with_normals
else:
    __getattr__, __dir__ = lazy(__name__)
