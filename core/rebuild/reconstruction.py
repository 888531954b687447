"""From contacts to a closed solid, by one of five methods: lattice, skin, draft, thesis, coarse.

The last two stand at the end: one superquadric, tapered and bent where its points ask for it
(Schwarz's criterion, 1978), and the solid of `palpate.core.thesis` as a closed surface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.geometry import signed_area
from palpate.core.poses import compose_poses, inverse_pose, split_pose
from palpate.core.rebuild.closed_sides import (
    ContourSolid,
    close_contours,
    close_radial,
    lattice_of,
    radial_rows,
)
from palpate.core.rebuild.contours import (
    ContactPoints,
    checked_contacts,
    contacts_into_frame,
    contour_curves,
    drop_reasons,
    into_frame,
    normals_as_points,
    slicing_pose,
    stack_points,
)
from palpate.core.rebuild.ends import StraightCurve
from palpate.core.rebuild.evidence import Evidence, gather_curves
from palpate.core.rebuild.lattice import LatticeFit
from palpate.core.rebuild.recovery import Recovery, recover
from palpate.core.rebuild.solid import LatticeSolid, Method
from palpate.core.rebuild.surface import (
    EndPatch,
    Patch,
    SampledPatch,
    Surface,
    closed_surface,
    placed,
    sampled_patch,
)
from palpate.core.shapes import Superquadric, Taper, regular_points
from palpate.core.steps import Steps, no_steps
from palpate.core.thesis import ThesisSolid, rebuild_thesis

LEAST, WIDEST = 4, 64  # Control points of a lattice: the fewest each way, and the most across
MOST_POINTS = 600  # More are thinned out: a superquadric has 15 parameters
WARPS = ((False, False), (True, False), (True, True))  # Neither tapered nor bent, tapered, both
USELESS = frozenset({"folded", "not converged"})  # Warnings of fits that are a last resort


def reconstruct(
    contours: Sequence[ArrayLike],
    normals: Sequence[ArrayLike] | None = None,
    patches: ContactPoints | None = None,
    tops: ArrayLike | None = None,
    method: Method = "lattice",
    *,
    frame: ArrayLike | None = None,
    heights: ArrayLike | None = None,
    noise: float | None = None,
    size: tuple[int, int] | None = None,
    grasp: Recovery | None = None,
    faithful: bool = False,
    step: Steps = no_steps,
) -> LatticeSolid:
    """Rebuild a solid from what was touched of it.

    `contours` are closed curves around the z axis of the slicing frame, (n, 3) each, or (n, 2) with
    their `heights` (m,) and no `frame`: at least 2, or 1 with `tops` at both ends; in any order,
    each begun anywhere, in either direction, of any number of points and in any unit. Rows that are
    not finite are left out, and single points that stick out. `normals` (n, 3) at their points are
    outward, of any length. `patches` are everything that touched, as points with the numbers of
    their touches. `tops` (k, 3) are where single touches found the ends: those above the middle of
    the contours, along the slicing axis, the upper one, those below it the lower one. An end that
    nobody touched is closed where the contours say where, else level on the last contour; see
    `LatticeSolid.uncovered`.

    Methods: "skin": a smooth surface through what was touched. "lattice": the same as a control
    lattice that deforms a prism, which can be edited and refined; of `size` control points across a
    section each way, from 4 to 64, and along the axis, from 4 to 512, as many as it takes if left
    out; put around the section of the superquadric that a `grasp` found, fitted to the contours if
    left out. "draft": a skin to decide by while there is more to touch, of half as many
    coefficients around where these do about as well. "thesis": the shell and core of Fung, 1999,
    4.4, to compare with; `faithful`: as the program in its appendix has it, faults and all, of
    contours with as many points each (`rebuild_thesis`). "coarse": a superquadric, tapered, bent.

    `frame` (7,) is the pose of the slicing frame in the world: position, then a unit quaternion x,
    y, z, w; the world's own if left out. All that is given here is given in the world, and the
    solid answers in the world; heights count along the frame's z axis. `noise` is the standard
    deviation of a coordinate; estimated if left out. `step` is called with the name of each step,
    and open while it lasts. Raises ValueError if no contour can be used, or one alone without
    `tops` above and below it, or an argument has no use: the sentence says why. Fung, 1999, 4.2 and
    4.4, with a smoothed skin through the contours in place of the shell and core.
    """
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {', '.join(get_args(Method))}, got {method!r}")
    if noise is not None:
        positive("noise", float(finite_array("noise", noise, ())), "in the unit of the contours")
    if method != "lattice" and not (size is None and grasp is None):
        raise ValueError(f"size and grasp must be left out with the method {method!r}")
    if size is not None and not _is_size(size):
        raise ValueError(
            f"size must be two whole numbers, from {LEAST} to {WIDEST} across and to {8 * WIDEST} "
            f"along, got {size}"
        )
    if faithful and method != "thesis":
        raise ValueError(f"faithful goes with the method 'thesis' alone, got {method!r}")
    pose = slicing_pose(frame)
    if grasp is not None and pose is not None:
        grasp = replace(grasp, pose=compose_poses(inverse_pose(pose), grasp.pose))
    with step("contours"):
        # Everything that was touched but the contours themselves, seen from the frame.
        parts = [] if patches is None else [contacts_into_frame(pose, checked_contacts(patches))]
        if normals is not None:
            parts.append(normals_as_points(contours, normals, heights, pose))
        contacts = stack_points(parts) if parts else None
        touched = None
        if tops is not None and not (isinstance(tops, list | tuple) and not tops):
            touched = into_frame(pose, finite_array("tops", tops, (None, 3)))
        curves = contour_curves(contours, heights, 0, pose)
        evidence = gather_curves(curves, touched, contacts, noise, pose)
    return Rebuilder(method, size, grasp, faithful)(evidence, step)


def _is_size(size: tuple[int, int]) -> bool:
    whole = isinstance(size, tuple) and all(isinstance(count, int) for count in size)
    return whole and len(size) == 2 and min(size) >= LEAST and size[0] <= WIDEST >= size[1] // 8


@dataclass(frozen=True, slots=True)
class Rebuilder:
    """How a solid is rebuilt: a value, so that a solid can be kept in a file."""

    method: Method
    size: tuple[int, int] | None
    grasp: Recovery | None
    faithful: bool

    def __call__(self, evidence: Evidence, step: Steps = no_steps) -> LatticeSolid:
        """The solid that evidence tells of, which can be made again from more of it."""
        if self.method == "coarse":
            points = np.concatenate(_raised(evidence.slices.points, evidence.slices.heights))
            found = fit_coarse(points, evidence.noise)
            if not found.fitted:
                raise ValueError(f"contours must determine a superquadric, got {found.warnings[0]}")
            surface = closed_surface((coarse_patch(found),))
            solid = LatticeSolid(surface=surface, method="coarse", evidence=evidence, model=found)
        elif self.method == "thesis":
            solid = _thesis(evidence, self.faithful)
        else:
            evidence, closed = _close(evidence, step, self.method == "draft")
            made: tuple[Surface, LatticeFit | None] = closed.surface, None
            if self.method == "lattice":
                with step("lattice"):
                    made = lattice_of(closed, self.size, self.grasp)
            solid = LatticeSolid(
                surface=made[0],
                method=self.method,
                evidence=evidence,
                closed=closed,
                lattice=made[1],
            )
        shear = None if solid.closed is None else solid.closed.shear
        return replace(solid, surface=placed(solid.surface, evidence.frame, shear), rebuilder=self)


def coarse_patch(recovery: Recovery) -> SampledPatch:
    """Its surface, from the lower end of its own axis to the upper one."""
    base = Superquadric(recovery.size, recovery.exponents)
    taper = Taper(float(recovery.taper[0]), float(recovery.taper[1]), float(recovery.size[2]))
    position, axes = split_pose(recovery.pose)

    def grid(v: Floats, turns: Floats) -> Floats:
        eta, omega = np.meshgrid(np.pi * (v - 0.5), np.pi * (2.0 * turns - 1.0), indexing="ij")
        points = regular_points(base, eta.ravel(), omega.ravel()).points
        points = recovery.bend(taper(points)) @ axes.T + position
        return points.reshape(*eta.shape, 3)

    return sampled_patch(grid)


def _thesis(evidence: Evidence, faithful: bool) -> LatticeSolid:
    slices = evidence.slices
    count = evidence.correspondence.grid.shape[1]
    turns = np.arange(count) / count
    rings = slices.points if faithful else [curve.at(turns) for curve in slices.curves]
    found = rebuild_thesis(_raised(rings, slices.heights), faithful=faithful)
    surface = closed_surface(thesis_patches(found))
    return LatticeSolid(surface=surface, method="thesis", evidence=evidence, model=found)


def _raised(rings: Sequence[Floats], heights: Floats) -> list[Floats]:
    """Rings (n, 2) at their heights, (n, 3) each."""
    pairs = zip(rings, heights, strict=True)
    return [np.column_stack([ring, np.full(len(ring), height)]) for ring, height in pairs]


def thesis_patches(solid: ThesisSolid) -> tuple[Patch, ...]:
    """Its surface, upwards and counter-clockwise; the points that close it there are cones here."""
    middle = solid.surface(np.array([0.5]), np.linspace(0.0, 1.0, 65))[0, :-1]
    mirrored = signed_area(middle[:, :2]) < 0.0

    def grid(v: Floats, turns: Floats) -> Floats:
        return solid.surface(v, 1.0 - turns if mirrored else turns)

    side = sampled_patch(grid)
    if solid.cap is None:
        return (side,)
    turns = np.arange(side.control.shape[1]) / side.control.shape[1]
    tips = []
    for v, way in ((0.0, -1.0), (1.0, 1.0)):
        ring = side.at(np.full(len(turns), v), turns)
        tips.append((ring.mean(axis=0) + np.array([0.0, 0.0, way * solid.cap]), way))
    cone = StraightCurve((0.0, 1.0), (0.0, 0.0))  # towards the tip, which stands for its middle
    below, above = (EndPatch(side, cone, tip, tip, way > 0.0) for tip, way in tips)
    return below, side, above


def _close(evidence: Evidence, step: Steps, draft: bool) -> tuple[Evidence, ContourSolid]:
    """The loft and its ends: of all that was touched where that can be, else of the contours."""
    if evidence.contacts is None:
        return evidence, _close_contours(evidence, step)
    ends = evidence.bottom, evidence.top
    rows = radial_rows(evidence.slices, evidence.contacts, *ends, step, draft)
    if rows is not None:
        with step("loft"):
            return evidence, close_radial(rows)
    with step("contours"):
        alone = gather_curves(evidence.given, evidence.tops, None, evidence.noise, evidence.frame)
    return alone._replace(contacts=evidence.contacts), _close_contours(alone, step)


def _close_contours(evidence: Evidence, step: Steps) -> ContourSolid:
    slices = evidence.slices
    touched = evidence.bottom is not None and evidence.top is not None
    if len(slices.heights) < 2 and not touched:
        why = f" ({drop_reasons(slices.dropped)})" if slices.dropped else ""
        raise ValueError(
            "contours must leave at least 2 to rebuild from, or 1 with tops that touched both "
            f"ends, got 1{why}"
        )
    ends = {"bottom": evidence.bottom, "top": evidence.top}
    grid = evidence.correspondence.grid
    return close_contours(slices.heights, grid, **ends, noise=evidence.noise, step=step)


def fit_coarse(points: ArrayLike, noise: float | None = None) -> Recovery:
    """The superquadric that explains points (n, 3) on it best for its number of parameters.

    Contacts of a hand, or points of contours; `noise` is the standard deviation of a coordinate, if
    it is known: what is less explains nothing. Tapered and bent where that pays; of points too few,
    or all in a plane, an ellipsoid in their extents, which says so in its warnings. Raises
    ValueError if points are not finite, or the noise not positive. Fung, 1999, 3.2.2, step 1, with
    pose, taper, bend and free exponents; Schwarz, *Estimating the dimension of a model*, 1978.
    """
    places = finite_array("points", points, (None, 3))
    if noise is not None:
        positive("noise", noise, "in the unit of the points")
    if len(places) > MOST_POINTS:
        places = places[np.linspace(0, len(places) - 1, MOST_POINTS).round().astype(int)]
    count = len(places)

    def penalty(missed: float, parameters: int) -> float:
        """Schwarz's criterion: smaller is better."""
        return 2.0 * count * math.log(missed) + parameters * math.log(count)

    def information(fit: Recovery) -> float:
        rounding = max(np.finfo(float).eps * float(fit.size.max()), np.finfo(float).tiny)
        return penalty(max(math.hypot(fit.rms, noise or 0.0), rounding), len(fit.names))

    fits: list[Recovery] = []
    for taper, bend in WARPS:
        if noise is not None and (sound := _sound(fits)):
            best = min(map(information, sound))
            # As many parameters more as this would have pay for no fit, however well it does.
            if best <= penalty(noise, len(fits[-1].names) + 2):
                break
        fits.append(recover(places, taper=taper, bend=bend, noise=noise))
    sound = _sound(fits)
    fitted = [fit for fit in fits if fit.fitted]
    return min(sound, key=information) if sound else (fitted or fits)[0]


def _sound(fits: Sequence[Recovery]) -> list[Recovery]:
    return [fit for fit in fits if fit.fitted and not USELESS.intersection(fit.warnings)]
