"""The side surface: through contours that correspond (a loft), and as a radial spline.

The loft is smoothed by cross-validation, and tells how far it can be trusted between contours. The
radial spline is fitted to every touched taxel at once, with a shift of each touch where poses err;
its numbers of spans and coefficients and strengths of bending may be tuned: they were set together
on the shipped scenes. Both rest on `palpate.core.rebuild.contours` and on `palpate.core.splines`.
"""

from palpate.core.rebuild.side.equations import AxisCurve, fit_axis_curve, looks_inward
from palpate.core.rebuild.side.lofting import ContourLoft, Uncertainty, fit_contour_loft, noise_of
from palpate.core.rebuild.side.radial import (
    POSE_LEFT,
    Coverage,
    RadialFit,
    RadialSpline,
    bridged,
    coverage_of,
    fit_draft,
    fit_radial_spline,
    radial_fit,
    with_normals,
)
from palpate.core.rebuild.side.shifts import fit_shifted_spline
from palpate.core.rebuild.side.surfaces import ContourSurface, SidePatch
