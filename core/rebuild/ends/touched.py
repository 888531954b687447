"""Ends that were touched: their heights, edges and middles.

The height of a dome, which falls away from its highest touch, is the top of one quadric through all
taxels with a shift of each touch. Between the last row and an end, distances from the axis are
divided by that of the row at their azimuth: touches on any side of an oval or a box measure one
edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.geometry import area_centroid, area_centroids
from palpate.core.rebuild.contours import ContactPoints, quadric_terms
from palpate.core.rebuild.ends.closing import ClosingSettings, End, close_rows
from palpate.core.rebuild.ends.planes import EndContactSettings, end_contacts_of
from palpate.core.rebuild.ends.profiles import EdgeSamples
from palpate.core.rebuild.side import RadialSpline


@dataclass(frozen=True, slots=True, kw_only=True)
class EndHeightSettings:
    """How the height of an end is estimated from its touches."""

    contacts: EndContactSettings = field(default_factory=EndContactSettings)
    max_level_angle: float = math.radians(0.5)  # [rad] largest slope of the plane of a level touch
    min_touches: int = 3  # on a level face or a dome, to determine its height
    max_sigmas: float = 3.0  # pose errors below the higher touches' mean; lower ones are left out
    max_level_sigmas: float = 4.0  # the same of level touches, which are all of one height
    min_dome_normal: float = 0.995  # axial component of the normals that belong to a dome
    max_dome_depth: float = 0.01  # fraction of the extent, below the farthest taxel of a dome
    taxel_error_ratio: float = 0.1  # error of a taxel or of the quadric over a pose's error


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeSampleSettings:
    """When touches between the last row and an end show the shape of its edge."""

    n_bins: int = 12  # heights between the row and the end at which radii are averaged
    n_sectors: int = 12  # parts of a turn in which touches are counted
    min_sectors: int = 4  # sectors touched at a height; fewer may be a feature of one side
    min_radial_normal: float = 0.2  # radial component of a normal; level faces have no radius
    min_mean_normal: float = 0.4  # least mean of these; a face that leans over has no edge
    min_height: float = 0.6  # fraction of the height to the end, below which all edges are alike
    # Fraction of the height to the end. Beyond it contacts lie on the end: a row of taxels across a
    # sharp edge has normals between both sides, as on a rounding.
    max_height: float = 0.95
    n_azimuths: int = 192  # at which the last row is evaluated


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchedEndSettings:
    """How the side is closed by an end; tuned on the shipped scenes with 5 and 9 contours."""

    n_rows: int = 14  # rows of the side that determine the profile of the end
    rows_height: float = 0.15  # fraction of the side's height, over which they lie
    max_lean: float = 0.15  # of the row's radius: farther off the axis, edges are sampled again
    middle_weight: float = 2.0  # [contacts] of the prior that the middle is on the rows' axis
    n_iterations: int = 4  # fits of the middle, with azimuths about the one before
    max_center_offset: float = 1.0  # of the row's radius; a middle beyond it is rejected
    edge: EdgeSampleSettings = EdgeSampleSettings()
    closing: ClosingSettings = field(default_factory=ClosingSettings)


def end_height(
    contacts: ContactPoints,
    last: float,
    sign: float,
    pose: float | None,
    known_height: float | None,
    settings: EndHeightSettings = EndHeightSettings(),
) -> float | None:
    """Height of an end [m], estimated from its contacts; `known_height` if it was not touched.

    Each touch is off by the error of its pose, and the highest of many by the largest error: those
    that may be of one height are averaged, from the highest on. Contacts count beyond the `last`
    contour [m]. `sign` is 1 for the upper end and -1 for the lower one; `pose` is the standard
    deviation of a touch's height [m], None without noise; `known_height` is the height at which the
    end was touched by other means [m].
    """
    on = on_end(contacts, last, sign)
    if not on.any():
        return known_height
    tolerance = settings.max_sigmas * (pose or 0.0)
    level, tilted = _touched_heights(contacts, on, sign, settings)
    height = _highest_mean(np.concatenate([level, tilted]), tolerance)
    # Level touches alone count if no other touch lies over them.
    if len(level) >= settings.min_touches and height <= float(level.max()) + tolerance:
        height = _highest_mean(level, settings.max_level_sigmas * (pose or 0.0))
    elif pose is not None:
        dome = dome_height(contacts, on, sign, settings)
        height = height if dome is None else dome
    farthest = float((sign * contacts.points[on, 2]).max())
    if known_height is None or sign * known_height <= farthest:
        return sign * height
    # Without noise the farthest is true; with noise the mean, if both may be of one height.
    is_same = pose is not None and sign * known_height - height <= tolerance
    return sign * (height if is_same else max(height, sign * known_height))


def _touched_heights(
    contacts: ContactPoints, on: Bools, sign: float, settings: EndHeightSettings
) -> tuple[Floats, Floats]:
    """Outward heights [m] of level touches of an end, and of tilted ones, by taxels `on` it (n,).

    A level touch is as high as its mean, a tilted one as its highest taxel.
    """
    heights = np.full(int(contacts.touch.max()) + 1, -np.inf)
    np.maximum.at(heights, contacts.touch[on], sign * contacts.points[on, 2])
    end_contacts = [
        contact
        for contact in end_contacts_of(contacts, sign, settings.contacts)
        if contact.kind != "edge" and np.isfinite(heights[contact.touch])
    ]
    is_level = [contact.is_level(settings.max_level_angle) for contact in end_contacts]
    pairs = list(zip(end_contacts, is_level, strict=True))
    level = [sign * float(contact.center[2]) for contact, flag in pairs if flag]
    tilted = [float(heights[contact.touch]) for contact, flag in pairs if not flag]
    if not end_contacts:
        return np.zeros(0), heights[np.isfinite(heights)]
    return np.array(level), np.array(tilted)


def _highest_mean(heights: Floats, tolerance: float) -> float:
    """Mean of the highest, down to the first that lies more than `tolerance` below their mean."""
    falling = np.sort(heights)[::-1]
    means = np.cumsum(falling) / np.arange(1, len(falling) + 1)
    below = np.flatnonzero(falling[1:] < means[:-1] - tolerance)
    return float(means[below[0] if len(below) else -1])


def dome_height(
    contacts: ContactPoints, on: Bools, sign: float, settings: EndHeightSettings
) -> float | None:
    """Outward height of a dome [m], by taxels `on` its end (n,); None if few touches lie on it."""
    assert contacts.normals is not None
    heights = sign * contacts.points[:, 2]
    depth = settings.max_dome_depth * float(np.ptp(heights))
    is_axial = sign * contacts.normals[:, 2] > settings.min_dome_normal
    used = on & is_axial & (heights > heights[on].max() - depth)
    touches, touch = np.unique(contacts.touch[used], return_inverse=True)
    if len(touches) < settings.min_touches:
        return None
    places = contacts.points[used, :2]
    middle = places.mean(axis=0)
    scale = max(float(np.abs(places - middle).max()), np.finfo(float).tiny)
    quadric = quadric_terms(*((places - middle) / scale).T)
    shifts = np.eye(len(touches))
    prior = [np.zeros((len(touches), 6)), settings.taxel_error_ratio * shifts]
    rows = np.block([[quadric, shifts[touch]], prior])
    right = np.concatenate([heights[used], np.zeros(len(touches))])
    solution = np.linalg.lstsq(rows, right, rcond=None)[0]
    return float((quadric @ solution[:6]).max())


def on_end(
    contacts: ContactPoints, last: float, sign: float, min_axial_normal: float = 0.9
) -> Bools:
    """Mask (n,) of the taxels on an end, beyond the last contour at a height [m].

    `sign` is 1 for the upper end and -1 for the lower one; the axial component of their normals is
    at least `min_axial_normal`. Without normals no taxel lies on an end.
    """
    if contacts.normals is None:
        return np.zeros(len(contacts.points), np.bool_)
    is_beyond = sign * (contacts.points[:, 2] - last) > 0.0
    return np.asarray((sign * contacts.normals[:, 2] > min_axial_normal) & is_beyond)


def end_from_contacts(
    contacts: ContactPoints,
    spline: RadialSpline,
    turns: Floats,
    rim: float,
    inwards: float,
    end: float | None,
    noise: float,
    settings: TouchedEndSettings = TouchedEndSettings(),
) -> End:
    """End of a side, a radial spline, beyond its first or last row, at `turns` (k,).

    The row lies at the height `rim`, and the other end of the side at `rim + inwards`; the end was
    touched at the height `end`, None if it was not; `noise` is the standard deviation of a point of
    a row. All are in [m].
    """
    steps = settings.rows_height * inwards * np.arange(settings.n_rows) / (settings.n_rows - 1)
    heights = np.sort(rim + steps)
    grid = spline.rings(heights, turns)
    row = grid[0 if inwards > 0.0 else -1]
    radius = float(np.sqrt(np.mean(np.sum((row - area_centroid(row)) ** 2, axis=1))))

    def closed(lean: Floats) -> End:
        samples = None
        if end is not None:
            samples = edge_samples(contacts, spline, rim, end, radius, lean, settings.edge)
        upper, closing = inwards < 0.0, settings.closing
        rough = close_rows(heights, grid, end, noise, samples, upper=upper, settings=closing)
        return with_touched_middle(rough, row, contacts, settings)

    centred = heights - heights.mean()
    slope = centred @ area_centroids(grid) / float(centred @ centred)  # of the rows' axis
    ahead = slope * (0.0 if end is None else end - rim)
    first = closed(ahead)
    lean = first.middle - area_centroid(row)
    is_on_axis = float(np.hypot(*(lean - ahead))) < settings.max_lean * radius
    # An end that leans away from the rows' axis is sampled again, about its own middle.
    return first if end is None or is_on_axis else closed(lean)


def edge_samples(
    contacts: ContactPoints,
    spline: RadialSpline,
    rim: float,
    end: float,
    radius: float,
    lean: Floats,
    settings: EdgeSampleSettings = EdgeSampleSettings(),
) -> EdgeSamples | None:
    """Mean radii between the last row and the end; None where too little was touched.

    From contacts as measured: shifts that fit the smooth side hide the edge. `rim` and `end` are
    heights, `radius` is the row's mean one, `lean` (2,) the offset of the end's middle, all in [m].
    """
    assert contacts.normals is not None
    sign, height = (1.0 if end > rim else -1.0), abs(end - rim)
    depth = sign * (contacts.points[:, 2] - rim)
    axis = spline.axis_curve.at(contacts.points[:, 2])
    away = contacts.points[:, :2] - axis - np.clip(depth / height, 0.0, 1.0)[:, None] * lean
    distance = np.maximum(np.linalg.norm(away, axis=1), np.finfo(float).tiny)
    facing = np.einsum("ni,ni->n", contacts.normals[:, :2], away) / distance
    used = (depth > 0.0) & (depth < settings.max_height * height)
    used &= facing > settings.min_radial_normal
    away, distance, depth, facing = away[used], distance[used], depth[used], facing[used]
    turns = np.mod(np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi), 1.0)
    azimuths = np.arange(settings.n_azimuths) / settings.n_azimuths
    row = np.sqrt(spline.squared(np.array([rim]), azimuths)[0])
    ratios = distance / np.interp(turns, azimuths, row, period=1.0)
    n_bins = settings.n_bins
    bins = np.minimum((depth / height * n_bins).astype(int), n_bins - 1)
    touched = np.zeros((n_bins, settings.n_sectors), np.bool_)
    touched[bins, (turns * settings.n_sectors).astype(int)] = True
    enough = touched.sum(axis=1) >= settings.min_sectors
    if not enough[int(settings.min_height * n_bins) :].any():
        return None
    sums = np.bincount(bins, facing, n_bins)[enough]
    weights = sums / np.bincount(bins, minlength=n_bins)[enough]
    if weights.mean() < settings.min_mean_normal:
        return None
    depths, means = (
        np.bincount(bins, values * facing, n_bins)[enough] / sums for values in (depth, ratios)
    )
    return EdgeSamples(sign * rim + depths, radius * means, weights)


def with_touched_middle(
    end: End, row: Floats, contacts: ContactPoints, settings: TouchedEndSettings
) -> End:
    """The end about the middle that fits its contacts, beyond a last row (k, 2) [m]."""
    assert contacts.normals is not None
    gap = end.height - end.rim
    if not abs(gap) > 0.0:
        return end
    fractions = (contacts.points[:, 2] - end.rim) / gap
    used = (fractions > 0.0) & (fractions <= 1.0)
    if not used.any():
        return end
    points, normals, fractions = (
        contacts.points[used, :2],
        contacts.normals[used, :2],
        fractions[used],
    )
    centre, ratios = area_centroid(row), end.profile.radius_ratios(fractions)
    away = row - centre
    turns, radii = np.arctan2(away[:, 1], away[:, 0]), np.hypot(*away.T)
    order = np.argsort(turns)
    before = end.middle - centre
    rows = fractions[:, None] * normals
    weight, lean = settings.middle_weight, before
    for _ in range(settings.n_iterations):
        from_axis = points - centre - fractions[:, None] * lean
        length = np.maximum(np.hypot(*from_axis.T), np.finfo(float).tiny)
        azimuth = np.arctan2(from_axis[:, 1], from_axis[:, 0])
        radius = np.interp(azimuth, turns[order], radii[order], period=2.0 * np.pi)
        section = (ratios * radius / length)[:, None] * from_axis
        off = np.einsum("nd,nd->n", normals, points - centre - section)
        lean = np.linalg.solve(rows.T @ rows + weight * np.eye(2), rows.T @ off + weight * before)
    limit = max(settings.max_center_offset * float(radii.mean()), float(np.hypot(*before)))
    return replace(end, middle=centre + lean) if float(np.hypot(*lean)) <= limit else end
