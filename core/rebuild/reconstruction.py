"""From contacts to a closed solid: evidence, the side, its ends, the surface.

Of all that was touched the side is a radial spline between the heights that were touched all
around, as it was fitted; its ends are set onto it. Else the contours alone are lofted. A control
lattice is fitted to the side where the method asks for one, and does not change the surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import finite_array, positive
from palpate.core.geometry import area_centroids
from palpate.core.plugins import entry_points_of
from palpate.core.poses import Pose
from palpate.core.rebuild.coarse import coarse_solid
from palpate.core.rebuild.contours import (
    ContactPoints,
    checked_contacts,
    contacts_into_frame,
    contour_curves,
    into_frame,
    normals_as_points,
    slicing_pose,
    stack_points,
)
from palpate.core.rebuild.ends import (
    End,
    Shear,
    end_from_contacts,
    end_height,
    is_known_untouched,
    on_end,
    shear_between,
    with_relief,
)
from palpate.core.rebuild.evidence import Evidence, gather_curves
from palpate.core.rebuild.lattice import fit_lattice
from palpate.core.rebuild.lofted_sides import lofted_side
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.side import (
    Coverage,
    RadialSide,
    RadialSpline,
    Side,
    coverage_of,
    fit_axis_curve,
    fit_shifted_spline,
    fit_side_spline,
    looks_inward,
    radial_side,
    with_gaps_bridged,
    with_normals,
)
from palpate.core.rebuild.solid import LatticeSolid, Method, RebuildOptions
from palpate.core.rebuild.surface import close_surface, placed
from palpate.core.steps import Steps, no_steps

LEAST, WIDEST = 4, 64  # Control points of a lattice: the fewest each way, and the most across
TURNS = 160  # Places of a side's rim
NEAREST = 2e-3  # Of the height: a side comes no nearer to an end, where it may turn level
FEWEST = 200  # Points on the side: with fewer the contours alone say more
LEAST_SIDE = 0.05  # Least height of the side, as a share of the object's
MISFIT = 0.1  # Of the side's own uncertainty: what a lattice may leave it by


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

    Methods: "skin": a smooth surface through what was touched. "lattice": the same, and a
    control lattice that deforms a prism whose side then follows it, which can be edited and
    refined; of `size` control points across a
    section each way, from 4 to 64, and along the axis, from 4 to 512, as many as it takes if left
    out; put around the section of the superquadric that a `grasp` found, fitted to the contours if
    left out. "draft": a skin to decide by while there is more to touch, more often
    of half as many coefficients around. "thesis": the shell and core of Fung, 1999,
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
        grasp = replace(
            grasp, pose=(Pose.from_array(pose).inverse() @ Pose.from_array(grasp.pose)).array
        )
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
    return rebuilt(evidence, method, RebuildOptions(size, grasp, faithful), step)


def _is_size(size: tuple[int, int]) -> bool:
    whole = isinstance(size, tuple) and all(isinstance(count, int) for count in size)
    return whole and len(size) == 2 and min(size) >= LEAST and size[0] <= WIDEST >= size[1] // 8


def rebuilt(
    evidence: Evidence, method: Method, options: RebuildOptions, step: Steps = no_steps
) -> LatticeSolid:
    """The solid that evidence tells of, which can be made again from more of it."""
    if method == "coarse":
        return replace(coarse_solid(evidence), options=options)
    if method == "thesis":
        return replace(other_method(method)(evidence, options.faithful), options=options)
    shear: Shear | None = None
    side: Side | None = None
    if evidence.contacts is not None:
        touched = _radial(evidence, evidence.contacts, step, method == "draft")
        if touched is not None:
            side, ends, shear = touched
        else:
            with step("contours"):
                known = evidence.given, evidence.tops, None, evidence.noise, evidence.frame
                evidence = gather_curves(*known)._replace(contacts=evidence.contacts)
    if side is None:
        side, ends = lofted_side(evidence, step)
    surface = close_surface(side.patch, *(None if end.round else end for end in ends))
    lattice = None
    if method == "lattice":
        with step("lattice"):
            tolerance = MISFIT * side.uncertainty().rms
            lattice = fit_lattice(side.patch, tolerance, size=options.size, grasp=options.grasp)
    return LatticeSolid(
        surface=placed(surface, evidence.frame, shear),
        method=method,
        evidence=evidence,
        options=options,
        side=side,
        ends=ends,
        shear=shear,
        lattice=lattice,
    )


def other_method(name: str) -> Callable[[Evidence, bool], LatticeSolid]:
    """A method of a room that may have been left out; ValueError if it was."""
    point = entry_points_of("palpate.rebuild_methods").get(name)
    if point is None:
        raise ValueError(f"the method {name!r} is not installed")
    made: Callable[[Evidence, bool], LatticeSolid] = point.load()
    return made


def _radial(
    evidence: Evidence, contacts: ContactPoints, step: Steps, draft: bool
) -> tuple[RadialSide, tuple[End, End], Shear | None] | None:
    """The side of all contact points over the heights that were touched, its ends, their shear.

    None where the contours tell more alone: where sections are not star-shaped about the axis, or
    hardly anything was touched, or not all around. A draft has fewer coefficients around, where
    these do about as well, and no condition number.
    """
    slices, bottom, top = evidence.slices, evidence.bottom, evidence.top
    levels = np.column_stack([area_centroids(slices.fine), slices.heights])
    axis_curve = fit_axis_curve(levels[:, 2], levels[:, :2])
    normals = contacts.normals is not None  # Surer than curves, which noise may turn back
    starlike = not looks_inward(contacts, axis_curve) if normals else slices.star.all()
    if not starlike or len(contacts.points) < FEWEST:
        return None
    shear = None
    if normals:
        shear = shear_between(contacts, levels[:, :2].mean(axis=0), (bottom, top))
    if shear is not None:
        # Other ends were touched by taxels, which say where they are in the straight space.
        bottom = bottom if is_known_untouched(contacts, -1.0, bottom) else None
        top = top if is_known_untouched(contacts, 1.0, top) else None
        contacts, levels = shear.levelled_contacts(contacts), shear.levelled(levels)
        axis_curve = fit_axis_curve(levels[:, 2], levels[:, :2])
    # All contact points lie between them, but for what seems to lie beyond an end that is known
    # from elsewhere, as a platform is.
    first, last = (float(height) for height in levels[[0, -1], 2])
    low = _reached(contacts, first, -1.0, bottom)
    high = _reached(contacts, last, 1.0, top)
    with step("radial spline"):
        contacts = with_normals(contacts, axis_curve, low, high)
        plain = fit_side_spline(contacts, axis_curve, low, high, draft)
        seen = coverage_of(plain.rows.heights, plain.rows.places[:, 1])
        if len(plain.rows.heights) < FEWEST or seen is None:
            return None
        spline, pose = fit_shifted_spline(contacts, with_gaps_bridged(contacts, plain), step)
    with step("ends"):
        bottom = end_height(contacts, first, -1.0, pose, bottom)
        top = end_height(contacts, last, 1.0, pose, top)
        bottom = None if bottom is None else min(bottom, first)
        top = None if top is None else max(top, last)
        reach, stretched = _reach(spline, seen, (first, last), (bottom, top))
        spacing = (last - first) / max(len(levels) - 1, 1)
        below = _end(contacts, spline, reach, bottom, pose, spacing)
        above = _end(contacts, spline, reach[::-1], top, pose, spacing)
    with step("bound"):
        side = radial_side(spline, seen, pose, reach, stretched, draft)
    return side, (below, above), shear


def _reached(contacts: ContactPoints, last: float, way: float, end: float | None) -> float:
    heights = [way * last] if end is None else [way * last, way * end]
    if end is None or on_end(contacts, last, way).any():
        heights.append(float((way * contacts.points[:, 2]).max()))
    return way * max(heights)


def _reach(
    spline: RadialSpline,
    seen: Coverage,
    levels: tuple[float, float],
    ends: tuple[float | None, float | None],
) -> tuple[tuple[float, float], bool]:
    """Heights between which the spline is the side, m, and whether that is more than was touched.

    By the lowest and the highest contour's level, and heights of ends that were touched, m.
    """
    bottom = spline.low if ends[0] is None else ends[0]
    top = spline.high if ends[1] is None else ends[1]
    low, high = min(seen.low, levels[0]), max(seen.high, levels[1])
    extent = top - bottom
    low, high = max(low, bottom + NEAREST * extent), min(high, top - NEAREST * extent)
    missing = max(0.5 * (LEAST_SIDE * extent - (high - low)), 0.0)
    reach = max(low - missing, 0.5 * (low + bottom)), min(high + missing, 0.5 * (high + top))
    return reach, missing > 0.0


def _end(
    contacts: ContactPoints,
    spline: RadialSpline,
    reach: tuple[float, float],  # Heights from this end's rim to the other's, m
    height: float | None,  # At which it was touched, m
    pose: float | None,
    spacing: float,  # Of the contours, m
) -> End:
    """How a side goes on; where nobody touched it, it may do so as far as contours are apart."""
    turns, noise = np.arange(TURNS) / TURNS, float(np.hypot(spline.sigma, pose or 0.0))
    rim, inwards = reach[0], reach[1] - reach[0]
    end = end_from_contacts(contacts, spline, turns, rim, inwards, height, noise)
    if end.kind == "fan":
        return replace(end, uncovered=spacing)
    return with_relief(end, contacts, spline.rings(np.array([rim]), turns)[0], pose)
