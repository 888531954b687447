"""What of a rebuilt solid a user should doubt, in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.slicing import into_frame
from palpate.core.rebuild.solid import Solid
from palpate.core.rebuild.surface.surface_mesh import SurfaceMesh
from palpate.launch.points_found import PointsFound

HUGE, TINY = 10.0, 1e-3
"""Sizes, m, beyond which the unit is doubted."""
SWINGS_OUT = 0.05
"""Share of the width by which the side leaves the contours, from which it is doubtful."""
UNKNOWN_END = 1e-3
"""Of the height: less that is not covered, or that a touched end is missed by, is not worth a
warning."""
FAR = 3.0
"""Times the widest step between contours by which an end lies beyond them: a guess."""
SHOWN = 4
"""Most contours that one sentence names."""

COUNTS: Mapping[str, tuple[str, str]] = {
    "outlying_points": (
        "1 single point sticks out and was left out",
        "{} single points stick out and were left out",
    ),
    "perhaps_features": (
        "1 of the dropped contours may be a neck or a rim that no other met",
        "{} of the dropped contours may be a neck or a rim that no other met",
    ),
    "refined_beyond": (
        "1 further point lies beyond the side and was not passed",
        "{} further points lie beyond the side and were not passed",
    ),
    "unmatched_contours": (
        "1 contour could not be matched to the model point by point",
        "{} contours could not be matched to the model point by point",
    ),
    "degenerate_contours": (
        "1 contour gave no layer of its own to the lattice",
        "{} contours gave no layer of their own to the lattice",
    ),
    "felt_unused": ("the single touches could not be used: the contours alone count",) * 2,
}
"""Figures of the health that say something if they are not 0, in words, for one and for more."""


def doubts_of(
    solid: Solid, mesh: SurfaceMesh, found: PointsFound, unit: str, crossings: int
) -> list[str]:
    """Sentences about everything that a user should doubt.

    Parameters
    ----------
    solid : Solid
        What was rebuilt, in m.
    mesh : SurfaceMesh
        Its triangles.
    found : PointsFound
        What it was rebuilt from.
    unit : str
        As which that was read.
    crossings : int
        Pairs of triangles that pass through each other.
    """
    said = _size(mesh.vertices, unit) + _contours(solid, found.places)
    health = solid.health()
    for name, (one, more) in COUNTS.items():
        if count := round(health.get(name, 0.0)):
            said.append(one if count == 1 else more.format(count))
    if folded := health.get("lattice_folded", 0.0):
        said.append(f"{folded:.2%} of the control lattice's inside is folded")
    if crossings:
        pairs = "1 pair" if crossings == 1 else f"{crossings} pairs"
        said.append(f"the surface passes through itself: {pairs} of triangles cross")
    if isinstance(solid.model, Recovery) and solid.model.doubts:
        said.append(f"the superquadric's fit is {', '.join(solid.model.doubts)}")
    if health.get("overshoot", 0.0) > SWINGS_OUT:
        said.append(
            f"between contours the side swings out by {health['overshoot']:.0%} of the width: "
            "contours close together are too unlike"
        )
    return said + _ends(solid, mesh.vertices)


def _size(vertices: Floats, unit: str) -> list[str]:
    size = float(np.ptp(vertices, axis=0).max())
    if TINY <= size <= HUGE:
        return []
    return [f"the solid is {size:.3g} m in size when read in {unit}: is the unit right?"]


def _contours(solid: Solid, places: Sequence[str]) -> list[str]:
    """What is odd about contours that were used, by their names in the file."""
    slices, suspects = solid.slices, solid.evidence.suspects
    marks = (
        (slices.tilted, ("is tilted or not level", "are tilted or not level")),
        (~slices.star, ("cannot be seen whole from its middle",) * 2),
        (slices.self_intersecting, ("meets itself", "meet themselves")),
    )
    said = []
    for marked, (one, more) in marks:
        rows = slices.rows[marked].tolist()
        if rows:
            said.append(f"{_names(places, rows)} {one if len(rows) == 1 else more}, yet used")
    if suspects:
        off = 1e3 * max(one.off for one in suspects)
        named = _names(places, [one.which for one in suspects])
        are = "is" if len(suspects) == 1 else "are"
        said.append(f"{named} {are} unlike the neighbours, by {off:.3g} mm at most, yet used")
    return said


def _names(places: Sequence[str], rows: Iterable[int]) -> str:
    named = [places[row] for row in rows]
    more = f" and {len(named) - SHOWN} more" if len(named) > SHOWN else ""
    return ", ".join(named[:SHOWN]) + more


def _ends(solid: Solid, vertices: Floats) -> list[str]:
    """Ends that nobody touched, that lie far off, and that the surface does not reach."""
    heights = into_frame(solid.frame, vertices)[:, 2]
    low, high = float(heights.min()), float(heights.max())
    axis = "z =" if solid.frame is None else "height"
    levels = solid.slices.heights
    least = UNKNOWN_END * (high - low)
    step = float(np.diff(levels).max()) if len(levels) > 1 else 0.0
    evidence, (below, above) = solid.evidence, solid.uncovered
    said = []
    for end, which, touched, made, rim, unknown in (
        ("bottom", "lowest", evidence.bottom, low, float(levels[0]), below),
        ("top", "highest", evidence.top, high, float(levels[-1]), above),
    ):
        side = "below" if end == "bottom" else "above"
        if unknown > least:
            said.append(
                f"{side} the {which} contour the object may go on by {1e3 * unknown:.3g} mm, "
                f"nobody touched its end: --{end} or --tops says where"
            )
        if touched is None:
            continue
        if abs(touched - made) > least:
            said.append(
                f"the {end} was touched at {axis} {1e3 * touched:.5g} mm, and the solid ends at "
                f"{1e3 * made:.5g} mm"
            )
        if step and abs(touched - rim) > FAR * step:
            said.append(
                f"the {end} lies {1e3 * abs(touched - rim):.3g} mm {side} the {which} contour, "
                f"where contours are at most {1e3 * step:.3g} mm apart: what is between is a guess"
            )
    return said
