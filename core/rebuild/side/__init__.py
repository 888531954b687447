"""The side surface: through contours that correspond (a loft), and as a radial spline.

The loft is smoothed by cross-validation, and tells how far it can be trusted between contours. The
radial spline is fitted to every touched taxel at once, with a shift of each touch where poses err;
its numbers of spans and coefficients and strengths of bending may be tuned: they were set together
on the shipped scenes. Both rest on `palpate.core.rebuild.contours` and on `palpate.core.splines`.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.side.equations import AxisCurve as AxisCurve
    from palpate.core.rebuild.side.equations import fit_axis_curve as fit_axis_curve
    from palpate.core.rebuild.side.equations import looks_inward as looks_inward
    from palpate.core.rebuild.side.lofting import ContourLoft as ContourLoft
    from palpate.core.rebuild.side.lofting import Uncertainty as Uncertainty
    from palpate.core.rebuild.side.lofting import fit_contour_loft as fit_contour_loft
    from palpate.core.rebuild.side.lofting import noise_of as noise_of
    from palpate.core.rebuild.side.radial import POSE_LEFT as POSE_LEFT
    from palpate.core.rebuild.side.radial import Coverage as Coverage
    from palpate.core.rebuild.side.radial import RadialFit as RadialFit
    from palpate.core.rebuild.side.radial import RadialSpline as RadialSpline
    from palpate.core.rebuild.side.radial import bridged as bridged
    from palpate.core.rebuild.side.radial import coverage_of as coverage_of
    from palpate.core.rebuild.side.radial import fit_draft as fit_draft
    from palpate.core.rebuild.side.radial import fit_radial_spline as fit_radial_spline
    from palpate.core.rebuild.side.radial import radial_fit as radial_fit
    from palpate.core.rebuild.side.radial import with_normals as with_normals
    from palpate.core.rebuild.side.shifts import fit_shifted_spline as fit_shifted_spline
    from palpate.core.rebuild.side.surfaces import ContourSurface as ContourSurface
    from palpate.core.rebuild.side.surfaces import SidePatch as SidePatch
else:
    __getattr__, __dir__ = lazy(__name__)
