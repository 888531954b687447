"""From contacts to a closed solid: evidence, the side, its ends, the surface.

If there are enough contacts, the side is a radial spline that is fitted to them, between the
heights that were touched all around; the ends close it. Else the contours alone are lofted. The
method "lattice" fits a control lattice to the side, which does not change the surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, positive
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

MIN_LATTICE_SIZE, MAX_LATTICE_SIZE = 4, 64  # control points each way, and across


@dataclass(frozen=True, slots=True, kw_only=True)
class RebuildSettings:
    """When contacts determine the side, where it ends, and how closely a lattice follows it."""

    min_points: int = 200  # on the side; with fewer contacts the contours alone are lofted
    min_end_distance: float = 2e-3  # fraction of the height; nearer to an end a side may be level
    min_side_height: float = 0.05  # fraction of the height between the ends
    n_rim_turns: int = 160  # places of the side's rim that its ends are set onto
    lattice_misfit: float = 0.1  # fraction of the uncertainty of the side


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
    their `heights` (m,) and no `frame`. There are at least 2, or 1 with `tops` at both ends; in any
    order, with any start, direction, number of points and unit. Rows that are not finite are left
    out, and single outliers. `normals` (n, 3) at their points are outward, of any length. `patches`
    are all contact points with the numbers of their touches. `tops` (k, 3) are points where single
    touches found the ends: the upper end above the middle of the contours along the slicing axis,
    the lower end below. An untouched end is closed as the contours suggest, else level on the last
    contour; see `LatticeSolid.uncovered`.

    Methods: "skin": a smooth surface through what was touched. "lattice": the same surface, and a
    control lattice that deforms a prism into it, which can be edited and refined. Its `size` is the
    number of control points across a section each way, from 4 to 64, and along the axis, from 4 to
    512; as many as are needed if left out. The prism has the section of the superquadric that a
    `grasp` found, or of one fitted to the contours. "draft": a faster skin to plan further touches
    with, often of half as many coefficients around. "thesis": the shell and core of Fung, 1999,
    4.4, for comparison; `faithful`: with the faults of the program in its appendix, of contours
    with as many points each (`rebuild_thesis`). "coarse": a superquadric, tapered and bent.

    `frame` (7,) is the pose of the slicing frame in the world: position, then a unit quaternion x,
    y, z, w; the world frame if left out. All arguments are in the world frame, and so are the
    results of the solid; heights are along the z axis of the frame. `noise` is the standard
    deviation of a coordinate; estimated if left out. `step` is a context manager that is called
    with the name of each step. Raises ValueError if no contour can be used, or only one without
    `tops` above and below it, or an argument has no use with the method. Fung, 1999, 4.2 and 4.4,
    with a smoothed skin through the contours in place of the shell and core.
    """
    _check_options(method, noise, size, grasp, faithful)
    pose = slicing_pose(frame)
    if grasp is not None and pose is not None:
        grasp = replace(
            grasp, pose=(Pose.from_array(pose).inverse() @ Pose.from_array(grasp.pose)).array
        )
    with step("contours"):
        # Contacts in the slicing frame, those of the contours' normals among them.
        parts = [] if patches is None else [contacts_into_frame(pose, checked_contacts(patches))]
        if normals is not None:
            parts.append(normals_as_points(contours, normals, heights, pose))
        contacts = stack_points(parts) if parts else None
        end_touches = None
        if tops is not None and not (isinstance(tops, list | tuple) and not tops):
            end_touches = into_frame(pose, finite_array("tops", tops, (None, 3)))
        curves = contour_curves(contours, heights, 0, pose)
        evidence = gather_curves(curves, end_touches, contacts, noise, pose)
    return rebuild_from_evidence(evidence, method, RebuildOptions(size, grasp, faithful), step)


def _check_options(
    method: Method,
    noise: float | None,
    size: tuple[int, int] | None,
    grasp: Recovery | None,
    faithful: bool,
) -> None:
    """Raise ValueError if an option of `reconstruct` is invalid, or has no use with the method."""
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {', '.join(get_args(Method))}, got {method!r}")
    if noise is not None:
        positive("noise", float(finite_array("noise", noise, ())), "in the unit of the contours")
    if method != "lattice" and not (size is None and grasp is None):
        raise ValueError(f"size and grasp must be left out with the method {method!r}")
    if size is not None and not _is_size(size):
        raise ValueError(
            f"size must be two whole numbers, from {MIN_LATTICE_SIZE} to {MAX_LATTICE_SIZE} across "
            f"and to {8 * MAX_LATTICE_SIZE} along, got {size}"
        )
    if faithful and method != "thesis":
        raise ValueError(f"faithful goes with the method 'thesis' alone, got {method!r}")


def _is_size(size: tuple[int, int]) -> bool:
    """Whether this is the size of a lattice, across and along."""
    whole = isinstance(size, tuple) and all(isinstance(count, int) for count in size)
    if not whole or len(size) != 2:
        return False
    return min(size) >= MIN_LATTICE_SIZE and size[0] <= MAX_LATTICE_SIZE >= size[1] // 8


def rebuild_from_evidence(
    evidence: Evidence,
    method: Method,
    options: RebuildOptions,
    step: Steps = no_steps,
    settings: RebuildSettings = RebuildSettings(),
) -> LatticeSolid:
    """The solid of all evidence; `LatticeSolid.update` calls it again with more evidence."""
    if method == "coarse":
        return replace(coarse_solid(evidence), options=options)
    if method == "thesis":
        return replace(plugin_method(method)(evidence, options.faithful), options=options)
    shear: Shear | None = None
    side: Side | None = None
    if evidence.contacts is not None:
        touched = _radial(evidence, evidence.contacts, step, method == "draft", settings)
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
            tolerance = settings.lattice_misfit * side.uncertainty().rms
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


def plugin_method(name: str) -> Callable[[Evidence, bool], LatticeSolid]:
    """A method that another package provides by an entry point; ValueError if none does."""
    point = entry_points_of("palpate.rebuild_methods").get(name)
    if point is None:
        raise ValueError(f"the method {name!r} is not installed")
    method: Callable[[Evidence, bool], LatticeSolid] = point.load()
    return method


def _radial(
    evidence: Evidence, contacts: ContactPoints, step: Steps, draft: bool, settings: RebuildSettings
) -> tuple[RadialSide, tuple[End, End], Shear | None] | None:
    """A radial side fitted to contact points over the heights they cover, its ends, their shear.

    None where the contours alone give a better side: where sections are not star-shaped about the
    axis, contacts are few, or do not go all around. A draft has fewer coefficients around, if these
    fit about as well, and no condition number.
    """
    levels = np.column_stack([area_centroids(evidence.slices.fine), evidence.slices.heights])
    axis_curve = fit_axis_curve(levels[:, 2], levels[:, :2])
    # Noise may turn curves back, so that normals are the better test.
    is_star = bool(evidence.slices.star.all())
    if contacts.normals is not None:
        is_star = not looks_inward(contacts, axis_curve)
    if not is_star or len(contacts.points) < settings.min_points:
        return None
    contacts, levels, (bottom, top), shear = _with_level_ends(evidence, contacts, levels)
    if shear is not None:
        axis_curve = fit_axis_curve(levels[:, 2], levels[:, :2])
    first, last = (float(height) for height in levels[[0, -1], 2])
    # All contacts lie between these, except those beyond an end that is known, as a platform is.
    low, high = _reached(contacts, first, -1.0, bottom), _reached(contacts, last, 1.0, top)
    with step("radial spline"):
        contacts = with_normals(contacts, axis_curve, low, high)
        plain = fit_side_spline(contacts, axis_curve, low, high, draft)
        seen = coverage_of(plain.rows.heights, plain.rows.places[:, 1])
        if len(plain.rows.heights) < settings.min_points or seen is None:
            return None
        spline, pose = fit_shifted_spline(contacts, with_gaps_bridged(contacts, plain), step)
    with step("ends"):
        bottom = end_height(contacts, first, -1.0, pose, bottom)
        top = end_height(contacts, last, 1.0, pose, top)
        bottom = None if bottom is None else min(bottom, first)
        top = None if top is None else max(top, last)
        reach, stretched = _side_heights(spline, seen, (first, last), (bottom, top), settings)
        spacing, n_turns = (last - first) / max(len(levels) - 1, 1), settings.n_rim_turns
        below = _end(contacts, spline, reach, bottom, pose, spacing, n_turns)
        above = _end(contacts, spline, reach[::-1], top, pose, spacing, n_turns)
    with step("bound"):
        side = radial_side(spline, seen, pose, reach, stretched, draft)
    return side, (below, above), shear


def _with_level_ends(
    evidence: Evidence, contacts: ContactPoints, levels: Floats
) -> tuple[ContactPoints, Floats, tuple[float | None, float | None], Shear | None]:
    """Contacts, middles of contours (m, 3) and ends, sheared so that both ends are level.

    The shear is None, and nothing moves, unless contacts with normals show that ends slope.
    """
    bottom, top, shear = evidence.bottom, evidence.top, None
    if contacts.normals is not None:
        shear = shear_between(contacts, levels[:, :2].mean(axis=0), (bottom, top))
    if shear is not None:
        # Ends with contacts are found again in the sheared space.
        bottom = bottom if is_known_untouched(contacts, -1.0, bottom) else None
        top = top if is_known_untouched(contacts, 1.0, top) else None
        contacts, levels = shear.levelled_contacts(contacts), shear.levelled(levels)
    return contacts, levels, (bottom, top), shear


def _reached(contacts: ContactPoints, last: float, direction: float, end: float | None) -> float:
    """Largest height [m] in a direction, 1 or -1, of the last contour, contacts and known end."""
    heights = [direction * last] if end is None else [direction * last, direction * end]
    if end is None or on_end(contacts, last, direction).any():
        heights.append(float((direction * contacts.points[:, 2]).max()))
    return direction * max(heights)


def _side_heights(
    spline: RadialSpline,
    seen: Coverage,
    levels: tuple[float, float],
    ends: tuple[float | None, float | None],
    settings: RebuildSettings,
) -> tuple[tuple[float, float], bool]:
    """Heights [m] between which the spline is the side, and whether that exceeds what was touched.

    From the heights [m] of the lowest and the highest contour, and of ends that were touched.
    """
    bottom = spline.low if ends[0] is None else ends[0]
    top = spline.high if ends[1] is None else ends[1]
    low, high = min(seen.low, levels[0]), max(seen.high, levels[1])
    extent = top - bottom
    margin = settings.min_end_distance * extent
    low, high = max(low, bottom + margin), min(high, top - margin)
    missing = max(0.5 * (settings.min_side_height * extent - (high - low)), 0.0)
    reach = max(low - missing, 0.5 * (low + bottom)), min(high + missing, 0.5 * (high + top))
    return reach, missing > 0.0


def _end(
    contacts: ContactPoints,
    spline: RadialSpline,
    reach: tuple[float, float],  # heights of this end's rim and of the other one [m]
    height: float | None,  # at which the end was touched [m]
    pose: float | None,
    spacing: float,  # of the contours [m]
    n_turns: int,
) -> End:
    """The end of a side; an untouched end may extend as far as contours are apart."""
    turns, noise = np.arange(n_turns) / n_turns, float(np.hypot(spline.sigma, pose or 0.0))
    rim, inwards = reach[0], reach[1] - reach[0]
    end = end_from_contacts(contacts, spline, turns, rim, inwards, height, noise)
    if end.kind == "fan":
        return replace(end, uncovered=spacing)
    return with_relief(end, contacts, spline.rings(np.array([rim]), turns)[0], pose)
