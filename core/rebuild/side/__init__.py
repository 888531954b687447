"""The side surface: a radial spline of all that was touched, or a loft of contours alone.

The radial spline is fitted to every touched taxel at once, with a shift of each touch where poses
err, and is the surface itself; its numbers of spans and coefficients and strengths of bending may
be tuned: they were set together on the shipped scenes. Where nothing but contours is known, or
sections are not star-shaped, a loft goes through them, smoothed by cross-validation. Both are a
`Side`: a patch, and how far it can be trusted. They rest on `palpate.core.rebuild.contours` and on
`palpate.core.splines`.
"""

from palpate.core.rebuild.side.equations import (
    AxisCurve as AxisCurve,
    fit_axis_curve as fit_axis_curve,
    looks_inward as looks_inward,
)
from palpate.core.rebuild.side.lofting import (
    ContourLoft as ContourLoft,
    fit_contour_loft as fit_contour_loft,
    noise_of as noise_of,
)
from palpate.core.rebuild.side.radial import (
    POSE_LEFT as POSE_LEFT,
    RadialSpline as RadialSpline,
    bridged as bridged,
    fit_radial_spline as fit_radial_spline,
    fit_shifted_spline as fit_shifted_spline,
    fit_side_spline as fit_side_spline,
    with_normals as with_normals,
)
from palpate.core.rebuild.side.side import (
    Coverage as Coverage,
    RadialPatch as RadialPatch,
    RadialSide as RadialSide,
    Uncertainty as Uncertainty,
    coverage_of as coverage_of,
    radial_side as radial_side,
)
from palpate.core.rebuild.side.surfaces import (
    LoftPatch as LoftPatch,
)

Side = RadialSide | ContourLoft  # A patch, and how far it can be trusted
SidePatch = RadialPatch | LoftPatch  # A side from 0 at its lower end to 1 at its upper one
