"""The thesis's shell and core as a closed solid: the method "thesis" of `palpate.reconstruct`."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import signed_area
from palpate.core.rebuild import Evidence, LatticeSolid
from palpate.core.rebuild.ends import StraightCurve
from palpate.core.rebuild.surface import EndPatch, Patch, closed_surface, placed, sampled_patch
from palpate.core.thesis.rebuilding import ThesisSolid, rebuild_thesis


def thesis_solid(evidence: Evidence, faithful: bool) -> LatticeSolid:
    """Shell and core of contours: as printed if `faithful`, else as corrected."""
    slices = evidence.slices
    count = evidence.correspondence.grid.shape[1]
    turns = np.arange(count) / count
    rings = slices.points if faithful else [curve.at(turns) for curve in slices.curves]
    raised = [
        np.column_stack([ring, np.full(len(ring), height)])
        for ring, height in zip(rings, slices.heights, strict=True)
    ]
    solid = rebuild_thesis(raised, faithful=faithful)
    surface = placed(closed_surface(_patches(solid)), evidence.frame)
    return LatticeSolid(surface=surface, method="thesis", evidence=evidence, model=solid)


def _patches(solid: ThesisSolid) -> tuple[Patch, ...]:
    """The solid's surface, upwards and counter-clockwise; cones lead to its closing points."""
    middle = solid.surface(np.array([0.5]), np.linspace(0.0, 1.0, 65))[0, :-1]
    mirrored = signed_area(middle[:, :2]) < 0.0

    def grid(v: Floats, turns: Floats) -> Floats:
        return solid.surface(v, 1.0 - turns if mirrored else turns)

    side = sampled_patch(grid)
    if solid.cap is None:
        return (side,)
    turns = np.arange(side.control.shape[1]) / side.control.shape[1]
    tips = []
    for v, sign in ((0.0, -1.0), (1.0, 1.0)):
        ring = side.at(np.full(len(turns), v), turns)
        tips.append((ring.mean(axis=0) + np.array([0.0, 0.0, sign * solid.cap]), sign))
    cone = StraightCurve((0.0, 1.0), (0.0, 0.0))  # towards the tip
    below, above = (EndPatch(side, cone, tip, tip, sign > 0.0) for tip, sign in tips)
    return below, side, above
