"""Whether a touched surface is smooth, or an edge or a corner, which have no curvature."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.jet_fit import JetFit
from palpate.core.touch.pad import Pad
from palpate.core.touch.pieces import Faces, bent_deviation, fit_faces, slopes_of_cells

Shape = Literal["smooth", "edge", "corner"]

QUIET = 0.008
"""In pitches: what a quartic leaves over on a ball of eight pitches pressed deeply. Less than
this beyond the noise needs no second look."""
UNEXPLAINED = 0.03
"""In pitches: what a quartic leaves over on a ball of five. More than this beyond the noise is
not smooth, whatever it is: a step has no faces that differ in slope."""
SHARPEST = 0.5
"""In 1 / pitches: what curves within two pitches is an edge to this array, however well a
polynomial passes through the few taxels that touch it."""
PIECES_WIN = 0.5
"""Flat faces that leave less than this share of what the jet leaves are what is there."""
THIRD_PAYS = 0.4
"""A third and fourth face are there if they leave less than this share of what two leave, flat
or curved. Two curved ones are the rim of a cylinder: an edge."""
THREE_WAYS = 0.1
"""Slope by which the faces of a corner must lean off any one line. The strip of a rounded edge
lies on the line between the two others."""
SURE = 4.0
"""Standard deviations by which noise alone may lift the deviation of a fit."""


def judge(
    pad: Pad, height: Floats, touched: Bools, fit: JetFit, sharpness: float, noise: float
) -> Shape:
    """What the surface is that a jet was fitted to.

    Parameters
    ----------
    pad, height, touched
        The touch.
    fit : JetFit
        Its jet, of at least the second degree.
    sharpness : float
        The larger of the principal curvatures' sizes, 1/m.
    noise : float
        Standard deviation of one taxel, m.

    Notes
    -----
    The jet is believed where it leaves no more than noise. Where it does leave more, flat
    faces are tried in its place.
    """
    freedom = max(len(fit.misfit) - fit.jet.coefficients.size, 1)
    by_noise = noise * (1.0 + SURE / math.sqrt(2.0 * freedom))
    sharp = sharpness * pad.pitch > SHARPEST
    explained = math.hypot(by_noise, QUIET * pad.pitch)
    if not sharp and fit.deviation <= explained:
        return "smooth"
    unexplained = fit.deviation > math.hypot(by_noise, UNEXPLAINED * pad.pitch)
    cells = slopes_of_cells(pad, height, touched)
    two = fit_faces(pad, height, touched, cells, 2)
    if two is not None and two.deviation < min(explained, PIECES_WIN * fit.deviation):
        return "edge"  # two flat faces are all there is: the costlier models need not be tried
    three = fit_faces(pad, height, touched, cells, 3)
    if two is None or three is None:
        return "edge" if sharp or unexplained else "smooth"
    wins = min(two.deviation, three.deviation) < PIECES_WIN * fit.deviation
    if not (sharp or wins or unexplained):
        return "smooth"
    left = min(two.deviation, bent_deviation(pad, height, touched, two))
    for more in (three, fit_faces(pad, height, touched, cells, 4)):
        if more is not None and more.deviation < THIRD_PAYS * left:
            return "corner" if _off_line(more) > THREE_WAYS else "edge"
    return "edge"


def _off_line(faces: Faces) -> float:
    """How far the faces' slopes are from lying on a line."""
    centred = faces.slopes - faces.slopes.mean(axis=0)
    across = np.linalg.svd(centred, full_matrices=False)[2][1]
    return float(np.ptp(centred @ across))
