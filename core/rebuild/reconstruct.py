"""From touches to a closed solid, by one of four methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.frames import compose, inverse
from palpate.core.rebuild.coarse import coarse_patch, fit_coarse
from palpate.core.rebuild.contour_solid import ContourSolid, close_contours, close_felt
from palpate.core.rebuild.evidence import Evidence, gather, gather_loops
from palpate.core.rebuild.felt.contour_normals import normals_as_points
from palpate.core.rebuild.felt.felt_points import FeltPoints, checked, stack_points
from palpate.core.rebuild.felt.felt_rows import felt_rows
from palpate.core.rebuild.lattice.lattice_solid import lattice_of
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.slices.dropped import reasons
from palpate.core.rebuild.slicing import felt_into_frame, slicing_pose
from palpate.core.rebuild.solid import Method, Solid
from palpate.core.rebuild.surface.surface import closed_surface, placed
from palpate.core.rebuild.thesis.rebuild import rebuild_thesis
from palpate.core.rebuild.thesis.surface import thesis_patches

LEAST, WIDEST = 4, 64
"""Control points of a lattice: the fewest each way, and the most across."""


def reconstruct(
    contours: Sequence[ArrayLike],
    normals: Sequence[ArrayLike] | None = None,
    patches: FeltPoints | None = None,
    tops: ArrayLike | None = None,
    method: Method = "lattice",
    *,
    frame: ArrayLike | None = None,
    heights: ArrayLike | None = None,
    noise: float | None = None,
    size: tuple[int, int] | None = None,
    grasp: Recovery | None = None,
    faithful: bool = False,
) -> Solid:
    """Rebuild a solid from what was felt of it.

    Parameters
    ----------
    contours : sequence of (n, 3) arrays, or of (n, 2) arrays with `heights`
        Closed curves around the z axis of the slicing frame, in any order, each begun anywhere,
        in either direction, of any number of points and in any unit: at least 2, or 1 with `tops`
        at both ends. Rows that are not finite are left out, and single points that stick out.
    normals : sequence of (n, 3) arrays, optional
        Outward normals at the contours' points, of any length.
    patches : FeltPoints, optional
        Everything that touched, as points with the numbers of their touches.
    tops : (k, 3) array, optional
        Where single touches found the ends: those above the middle of the contours, along the
        slicing axis, the upper one, those below it the lower one. An end that nobody touched is
        closed where the contours say where, else level on the last contour; see
        `Solid.uncovered`.
    method : {"lattice", "skin", "thesis", "coarse"}
        "skin": a smooth surface through what was felt. "lattice": the same as a control lattice
        that deforms a prism, which can be edited and refined. "thesis": the shell and core of
        Fung, 1999, 4.4, to compare with. "coarse": a superquadric, tapered and bent.
    frame : (7,) array, optional
        Pose of the slicing frame in the world: position, then a unit quaternion x, y, z, w. All
        that is given here is given in the world, and the solid answers in the world; heights
        count along the frame's z axis. The world's own frame if left out.
    heights : (m,) array, optional
        Of plane contours; without `frame`.
    noise : float, optional
        Standard deviation of a coordinate; estimated if left out.
    size : pair of int, optional
        With the method "lattice": control points across a section each way, and along the axis,
        from 4 to 64 and from 4 to 512; as many as it takes if left out.
    grasp : Recovery, optional
        With the method "lattice": the superquadric that a grasp found, whose section the lattice
        is put around; fitted to the contours if left out.
    faithful : bool
        With the method "thesis", as the program in its appendix has it, faults and all: see
        `rebuild_thesis`. The contours must then have as many points each.

    Returns
    -------
    Solid

    Raises
    ------
    ValueError
        If no contour can be used, or one alone without `tops` above and below it, or an
        argument has no use: the sentence says why.

    Notes
    -----
    Fung, 1999, 4.2 and 4.4, with a smoothed skin through the contours in place of the shell and
    core.
    """
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {', '.join(get_args(Method))}, got {method!r}")
    if noise is not None:
        positive("noise", float(finite_array("noise", noise, ())), "in the unit of the contours")
    if method != "lattice" and not (size is None and grasp is None):
        raise ValueError(f"size and grasp must be left out with the method {method!r}")
    if size is not None:
        _check_lattice(size)
    if faithful and method != "thesis":
        raise ValueError(f"faithful goes with the method 'thesis' alone, got {method!r}")
    pose = slicing_pose(frame)
    if grasp is not None and pose is not None:
        grasp = replace(grasp, pose=compose(inverse(pose), grasp.pose))
    felt = _felt(contours, normals, patches, heights, pose)
    evidence = gather(contours, tops, felt=felt, heights=heights, noise=noise, frame=pose)
    return Again(method, size, grasp, faithful)(evidence)


def _check_lattice(size: tuple[int, int]) -> None:
    whole = isinstance(size, tuple) and all(isinstance(count, int) for count in size)
    if not (whole and len(size) == 2 and min(size) >= LEAST and size[0] <= WIDEST >= size[1] // 8):
        raise ValueError(
            f"size must be two whole numbers, from {LEAST} to {WIDEST} across and to {8 * WIDEST} "
            f"along, got {size}"
        )


def _felt(
    contours: Sequence[ArrayLike],
    normals: Sequence[ArrayLike] | None,
    patches: FeltPoints | None,
    heights: ArrayLike | None,
    frame: Floats | None,
) -> FeltPoints | None:
    """Everything that was felt but the contours themselves, seen from the frame."""
    parts = [] if patches is None else [felt_into_frame(frame, checked(patches))]
    if normals is not None:
        parts.append(normals_as_points(contours, normals, heights, frame))
    return stack_points(parts) if parts else None


@dataclass(frozen=True, slots=True)
class Again:
    """How a solid is rebuilt: a value, so that a solid can be kept in a file."""

    method: Method
    size: tuple[int, int] | None
    grasp: Recovery | None
    faithful: bool

    def __call__(self, evidence: Evidence) -> Solid:
        """The solid that evidence tells of, which can be made again from more of it."""
        if self.method == "coarse":
            solid = _coarse(evidence)
        elif self.method == "thesis":
            solid = _thesis(evidence, self.faithful)
        else:
            solid = self._from_skin(evidence)
        slant = None if solid.closed is None else solid.closed.slant
        return replace(solid, surface=placed(solid.surface, evidence.frame, slant), again=self)

    def _from_skin(self, evidence: Evidence) -> Solid:
        evidence, closed = _close(evidence)
        surface, lattice = closed.surface, None
        if self.method == "lattice":
            surface, lattice = lattice_of(closed, self.size, self.grasp)
        return Solid(
            surface=surface,
            method=self.method,
            evidence=evidence,
            closed=closed,
            lattice=lattice,
        )


def _coarse(evidence: Evidence) -> Solid:
    slices = evidence.slices
    points = [
        np.column_stack([points, np.full(len(points), height)])
        for points, height in zip(slices.points, slices.heights, strict=True)
    ]
    found = fit_coarse(np.concatenate(points), evidence.noise)
    if not found.fitted:
        raise ValueError(f"contours must determine a superquadric, got {found.doubts[0]}")
    surface = closed_surface((coarse_patch(found),))
    return Solid(surface=surface, method="coarse", evidence=evidence, model=found)


def _thesis(evidence: Evidence, faithful: bool) -> Solid:
    slices = evidence.slices
    count = evidence.correspondence.grid.shape[1]
    turns = np.arange(count) / count
    rings = slices.points if faithful else [curve.at(turns) for curve in slices.curves]
    contours = [
        np.column_stack([ring, np.full(len(ring), height)])
        for ring, height in zip(rings, slices.heights, strict=True)
    ]
    found = rebuild_thesis(contours, faithful=faithful)
    surface = closed_surface(thesis_patches(found))
    return Solid(surface=surface, method="thesis", evidence=evidence, model=found)


def _close(evidence: Evidence) -> tuple[Evidence, ContourSolid]:
    """The skin and its ends: of all that was felt where that can be, else of the contours."""
    if evidence.felt is None:
        return evidence, _close_contours(evidence)
    rows = felt_rows(evidence.slices, evidence.felt, evidence.bottom, evidence.top)
    if rows is not None:
        return evidence, close_felt(rows)
    alone = gather_loops(evidence.given, evidence.tops, None, evidence.noise, evidence.frame)
    return alone._replace(felt=evidence.felt), _close_contours(alone)


def _close_contours(evidence: Evidence) -> ContourSolid:
    slices = evidence.slices
    touched = evidence.bottom is not None and evidence.top is not None
    if len(slices.heights) < 2 and not touched:
        why = f" ({reasons(slices.dropped)})" if slices.dropped else ""
        raise ValueError(
            "contours must leave at least 2 to rebuild from, or 1 with tops that touched both "
            f"ends, got 1{why}"
        )
    return close_contours(
        slices.heights,
        evidence.correspondence.grid,
        bottom=evidence.bottom,
        top=evidence.top,
        noise=evidence.noise,
    )
