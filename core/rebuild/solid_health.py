"""Figures by which one can tell how far a rebuilt solid is to be trusted, by name."""

from __future__ import annotations

from palpate.core.rebuild.contour_solid import ContourSolid
from palpate.core.rebuild.ends.ends import End
from palpate.core.rebuild.evidence import Evidence
from palpate.core.rebuild.lattice.lattice_fit import LatticeFit
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.surface.patches import EndPatch
from palpate.core.rebuild.surface.sampled_patch import SampledPatch
from palpate.core.rebuild.surface.surface import Surface
from palpate.core.rebuild.thesis.solid import ThesisSolid

Figures = dict[str, float]


def health_of(
    evidence: Evidence,
    closed: ContourSolid | None,
    lattice: LatticeFit | None,
    model: ThesisSolid | Recovery | None,
    surface: Surface,
) -> Figures:
    """All that is known of how a solid came about: see `Solid.health`."""
    found = evidence.health() | {"uncovered_below": 0.0, "uncovered_above": 0.0}
    if closed is not None:
        strays = found["outlying_points"]
        found |= _of_side(closed)
        found["outlying_points"] += strays
        if evidence.felt is not None:
            found |= _of_felt(closed)
    if lattice is not None:
        found |= _of_lattice(lattice)
    if isinstance(model, Recovery):
        found |= _of_recovery(model)
    if isinstance(model, ThesisSolid):
        found |= _of_thesis(model)
    return found | _of_ends(surface) | _of_samples(surface)


def _of_side(closed: ContourSolid) -> Figures:
    skin = closed.skin.health
    return {
        "uncovered_below": closed.bottom.uncovered,
        "uncovered_above": closed.top.uncovered,
        "unseen_below": closed.bottom.unseen,
        "unseen_above": closed.top.unseen,
        "apart_below": float(closed.bottom.apart),
        "apart_above": float(closed.top.apart),
        "slope_below": _slope(closed, closed.bottom),
        "slope_above": _slope(closed, closed.top),
        "outlying_points": float(skin.outlying),
        "sigma": skin.sigma,
        "degrees_of_freedom": skin.freedom,
        "condition": skin.condition,
        "swing": skin.swing,
        "paced": float(closed.skin.surface.latitude.pace is not None),
    }


def _slope(closed: ContourSolid, end: End) -> float:
    """How steep an end is."""
    return 0.0 if closed.slant is None else closed.slant.steepness(end.height)


def _of_ends(surface: Surface) -> Figures:
    """How much of the level ends lies on itself."""
    ends = [piece for piece in surface.pieces if isinstance(piece, EndPatch)]
    return {
        f"folded_{name}": sum(end.folded for end in ends if end.upper == upper)
        for name, upper in (("below", False), ("above", True))
    }


def _of_felt(closed: ContourSolid) -> Figures:
    felt = closed.felt
    if felt is None:
        return {"felt_unused": 1.0}
    return {
        "felt_unused": 0.0,
        **felt.figures,
        "sigma": felt.sigma,
        "condition": felt.condition,
    }


def _of_lattice(lattice: LatticeFit) -> Figures:
    health, refined = lattice.health, lattice.refinement
    found = {
        "lattice_rms": health.rms,
        "lattice_most": health.most,
        "lattice_condition": health.condition,
        "lattice_folded": health.folded,
    }
    if refined is not None:
        found |= {
            "refined_points": float(refined.points),
            "refined_beyond": float(refined.beyond),
            "refined_before": refined.before,
            "refined_after": refined.after,
            "refined_moved": refined.moved,
            "lattice_folded": refined.folded,
        }
    return found


def _of_recovery(model: Recovery) -> Figures:
    return {
        "rms": model.rms,
        "rank": float(model.rank),
        "condition": model.condition,
        "looseness": model.looseness,
        "uncovered_share": model.uncovered,
        "doubts": float(len(model.doubts)),
    }


def _of_thesis(model: ThesisSolid) -> Figures:
    health = model.health
    return {
        "unmatched_contours": float((~health.one_to_one).sum()),
        "degenerate_contours": float(health.degenerate.sum()),
        "cores_moved": float(health.cores_moved.sum()),
        "core_points_outside": float(health.cores_outside.sum()),
        "widest_gap": float(health.gaps.max()),
    }


def _of_samples(surface: Surface) -> Figures:
    """How far splines through samples of a surface may leave it."""
    misses = [piece.miss for piece in surface.pieces if isinstance(piece, SampledPatch)]
    return {"sampling": max(misses)} if misses else {}
