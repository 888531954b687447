"""A solid of any shape as a planner of single touches knows it, and what touches are worth.

It knows the triangles of the solid and the error that is expected at each vertex. Places of it are
drawn by area. The platform is a pedestal, as wide as the convex hull of what stands on it:
beside it the finger reaches lower, and touches what faces down. A touch is worth the squared
errors, times area, of the places that it would meet or come near to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.explore.planners.approaches import (
    APPROACHES,
    MAX_RANGE,
    MAX_ROUNDING,
    TouchOffer,
    touch_offers,
)
from palpate.core.explore.planners.hollows import (
    HOLLOWS,
    least_concavity,
    pad_gaps,
    pad_width,
)
from palpate.core.explore.planners.verdict import Findings
from palpate.core.geometry import areas_and_normals, axes_across, point_tree, sample_surface
from palpate.core.poses import Pose
from palpate.core.shapes import Mesh, TriangleShape
from palpate.core.touch import Pad
from palpate.reprs import readable


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceSettings:
    """At which places of a surface errors are counted, and what kind of place each is."""

    n_places: int = 4000  # drawn by area
    pedestal_grid: float = 4.0e-3  # [m] between places on the pedestal's top: far less than a pad
    standing_height: float = 1.0e-3  # [m] over the platform: what lies lower stands on it
    max_downward: float = -0.7  # upward part of the normals of what faces down
    n_openings: int = 8  # whose middles are published
    min_mean_normal: float = 0.3  # resultant length; below it normals have no common direction
    opening_depth: float = 3.0e-3  # [m] from a place that a pad spanned, up to which it is open
    min_opening: float = 1.5e-3  # [m] from every touch: nearer places are no opening
    touched_area: float = 1.0e-4  # [m^2] that one touch covers


@dataclass(frozen=True, slots=True, kw_only=True)
class HiddenSettings:
    """The error that a place may hide: a slope, times the distance from the nearest touch."""

    unknown_slope: float = 0.5  # of places that no finger came near to
    crease_slope: float = 0.3  # of creases that hold the pad off
    # Of an opening, over half its width, walls included: that of a hole four times as deep as wide.
    # Where the solid is thinner than that, the hole goes through it and is no deeper.
    opening_slope: float = 16.0
    tilt: float = math.radians(40.0)  # [rad] of directions about the normal in which a hole may go
    lateral: float = 3.0e-3  # [m] of the far side from such a direction, with what was drawn of it
    min_room: float = 0.8  # fraction of the tolerance that the rest must leave to touchable places


PLACES = PlaceSettings()
HIDDEN = HiddenSettings()


class Progress(NamedTuple):
    """What was known of a solid with so many touches."""

    touches: int
    bound: float  # Of the error where touches can come, m
    open: float  # Share of the surface that lies far from every touch, and can be reached


@readable
@dataclass(frozen=True, eq=False)
class ObservedSurface:
    """A solid as a planner knows it; world frame, m."""

    mesh: Mesh  # Closed, turned outwards
    errors: Floats  # Expected at each vertex, (n,)
    bounds: Floats  # Below which they are in 95 of 100 runs, (n,)
    distances: Floats  # Of each vertex from what was touched, (n,)
    pad: Pad  # What touches
    platform: float | None  # Height on which the object stands
    reach: float  # Of the finger, sideways from the axis and up from the platform
    refused: Floats  # Where touches in vain were aimed at before, (j, 3)
    aimed: Floats  # Where single touches were aimed at before, (i, 3)
    # Places in the solid at which a pad touched nothing but what is beside them, (k, 3)
    openings: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    missing: float = 0.0  # Error of the whole that comes of touched parts which it lacks, m
    touches: int = 0  # That were made
    earlier: tuple[Progress, ...] = ()  # What was known before, of the same method
    unknown_distance: float = 10.0e-3  # From every touch, beyond which a place is unknown
    pose: Pose | None = None  # From how it lay at first, if it was turned over

    def __post_init__(self) -> None:
        count = len(finite_array("mesh.vertices", self.mesh.vertices, (None, 3)))
        for name in ("errors", "bounds", "distances"):
            finite_array(name, getattr(self, name), (count,))

    @cached_property
    def places(self) -> SurfacePlaces:
        """Places drawn by area, and what is known there."""
        return _places(self)

    @cached_property
    def offers(self) -> tuple[TouchOffer, ...]:
        """Touches that can be made where errors are largest."""
        return tuple(touch_offers(self))

    @cached_property
    def squares(self) -> Floats:
        """Squared errors at the places, (n,); 0 where nobody can touch, or did in vain.

        Without known errors, distances from what was touched stand for them. An opening counts with
        the error that it may hide until `n_opening_aims` touches were aimed at it, including the
        one that found it: most turn out to be places where the solid is a little too large.
        """
        places, near = self.places, 0.5 * APPROACHES.known_radius * pad_width(self.pad)
        squares = np.square(places.errors if places.errors.any() else places.distances)
        opened = np.square(HIDDEN.opening_slope * places.distances)
        squares = np.where(places.spanned, np.maximum(opened, np.square(places.bounds)), squares)
        if self.pose is not None:  # what it stood on at first can be touched now
            hidden = np.square(HIDDEN.unknown_slope * places.distances)
            squares = np.where(places.flat, np.maximum(squares, hidden), squares)
        if len(self.refused):
            squares[point_tree(self.refused).query(places.points)[0] < near] = 0.0
        if len(self.aimed) and places.spanned.any():
            middles = places.points[_middles(places, places.spanned)]
            aims = point_tree(self.aimed).query_ball_point(middles, 2.0 * near, return_length=True)
            tried = np.asarray(aims) >= HOLLOWS.n_opening_aims
            squares[places.spanned & tried[point_tree(middles).query(places.points)[1]]] = 0.0
        return np.where(places.standing, 0.0, squares)

    @cached_property
    def open_area(self) -> OpenArea:
        """What lies far from every touch, the underside apart."""
        places = self.places
        far = self.away & ~places.under
        known = np.count_nonzero(~places.under)
        middles = _middles(places, far)
        return OpenArea(
            float(far.sum()) / max(int(known), 1),
            2.0 * float(places.distances[middles].max(initial=0.0)),
            places.points[middles],
            np.array([_outward(places, middle) for middle in middles]).reshape(-1, 3),
            float(places.under.mean()),
            float(far.sum()) / PLACES.n_places * self.area / PLACES.touched_area,
        )

    @cached_property
    def findings(self) -> Findings:
        """What is known of it, for a verdict."""
        places = self.places
        return Findings(
            error_bound=self.rms_bound_95,
            underside_share=float(places.flat.mean()),
            crease_error=self.bound_of(self.creased),
            crease_share=float(self.creased.mean()),
            unknown_share=self.open_area.share,
            unentered_hole=self.unentered_hole,
        )

    @cached_property
    def unentered_hole(self) -> float:
        """Width of the widest hole that a pad spanned and nothing entered, m; 0 without one."""
        return 2.0 * float(self.places.distances[self.places.spanned | self.pits].max(initial=0.0))

    @cached_property
    def area(self) -> float:
        """Of the whole surface, m^2."""
        return float(areas_and_normals(self.mesh.vertices[self.mesh.faces])[0].sum())

    @cached_property
    def rms_bound_95(self) -> float:
        """Below which the root mean square error is in 95 of 100 runs, m.

        Of what the object stands on nothing is known: it may be hollow, and no number bounds it.
        """
        return math.hypot(self.bound_of(~self.places.flat), self.missing)

    @cached_property
    def progress(self) -> tuple[Progress, ...]:
        """What was known before, and now."""
        none = np.zeros((0, 3))
        now = Progress(self.touches, self.touchable_bound(none), self.reachable(none))
        return (*self.earlier, now)

    def touchable_bound(self, tried: Floats) -> float:
        """The same over what was touched or can be, without what the open area may hide, m."""
        return self.bound_of(self._touchable(tried))

    def touchable_limit(self, tried: Floats, tolerance: float) -> float:
        """What that may be for the whole to be within a tolerance, m; at most the tolerance.

        The tolerance itself where the rest leaves so little of it that touches are in vain.
        """
        touchable = self._touchable(tried)
        counted = ~self.places.flat
        rest = float((np.square(self.bounds_there) * ~touchable)[counted].mean())
        room, share = tolerance**2 - rest, float(touchable[counted].mean())
        if room < HIDDEN.min_room**2 * share * tolerance**2:
            return tolerance
        return min(math.sqrt(room / share), tolerance) if share else tolerance

    def _touchable(self, tried: Floats) -> Bools:
        untouchable = self.places.standing | self.creased
        return np.asarray(~untouchable & (~self.away | self.met(tried)))

    def bound_of(self, chosen: Bools) -> float:
        """The same of some of the places (n,), m; 0 if there are none."""
        squares = np.square(self.bounds_there[chosen])
        return float(np.sqrt(squares.mean())) if len(squares) else 0.0

    @cached_property
    def neighbours(self) -> Ints:
        """Numbers of places, so few that a pad's worth of them are `n_neighbours`."""
        in_reach = 2.0 * math.pi * (0.5 * pad_width(self.pad)) ** 2 * PLACES.n_places / self.area
        return np.arange(
            0, PLACES.n_places, max(round(in_reach / HOLLOWS.n_neighbours), 1), dtype=np.int32
        )

    @cached_property
    def creased(self) -> Bools:
        """At which places what is beside them holds a pad off, however it leans, (n,)."""
        places = self.places
        creased = ~places.flat & (places.distances > HOLLOWS.min_gap)
        if creased.any():
            there = places.points[creased], places.normals[creased]
            beside = places.points[self.neighbours]
            gaps = pad_gaps(self.pad, beside, *there, enough=HOLLOWS.min_gap)
            creased[creased] = gaps > HOLLOWS.min_gap
        return creased

    @cached_property
    def bounds_there(self) -> Floats:
        """Bounds of 95 % of the errors at the places, and of what creases may hide, (n,), m."""
        hidden = np.where(self.creased, HIDDEN.crease_slope, 0.0) * self.places.distances
        return np.maximum(self.places.bounds, np.maximum(hidden, self.hole_errors))

    @cached_property
    def hole_errors(self) -> Floats:
        """What holes may hide in openings and pits, (n,), m; 0 elsewhere.

        The root mean square of the distances of a hole's walls from the surface that closes it,
        over the area of that: of a hole of radius r through a thickness t it is at most
        (t^3 / (6 r) + t^2 / 4)^(1/2), a blind one included.
        """
        places, errors = self.places, np.zeros(PLACES.n_places)
        opened = np.flatnonzero(places.spanned | self.pits).astype(np.int32)
        radii = np.maximum(places.distances[opened], np.finfo(float).tiny)
        depths = _thickness(places, opened)
        through = np.sqrt(depths**3 / (6.0 * radii) + 0.25 * depths**2)
        errors[opened] = np.minimum(HIDDEN.opening_slope * radii, through)
        return errors

    @cached_property
    def pits(self) -> Bools:
        """Which places of creases are concave all around, (n,): a hole may go on below them."""
        places = self.places
        pits = self.creased & (places.distances > HOLLOWS.min_pit_distance)
        if pits.any():
            beside = places.points[self.neighbours], places.normals[self.neighbours]
            there = places.points[pits], places.normals[pits]
            concavity = least_concavity(*beside, *there, 0.5 * pad_width(self.pad))
            pits[pits] = concavity > 1.0 / HOLLOWS.max_pit_radius
        return pits

    @cached_property
    def pedestal(self) -> Floats:
        """Places (k, 3) all over the top of the pedestal: the hull of where the object stands."""
        standing = self.places.points[self.places.standing]
        if len(standing) < 3 or self.platform is None:
            return standing
        try:
            planes = scipy.spatial.ConvexHull(standing[:, :2]).equations
        except scipy.spatial.QhullError:  # it stands on a line
            return standing
        sides = zip(standing.min(axis=0)[:2], standing.max(axis=0)[:2], strict=True)
        x, y = np.meshgrid(*(np.arange(low, high, PLACES.pedestal_grid) for low, high in sides))
        grid = np.column_stack([x.ravel(), y.ravel()])
        grid = grid[(grid @ planes[:, :2].T + planes[:, 2] <= 0.0).all(axis=1)]
        top = np.column_stack([grid, np.full(len(grid), self.platform)])
        return np.concatenate([standing, top])

    @cached_property
    def shape(self) -> TriangleShape:
        """The solid, ready for rays."""
        return TriangleShape(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def hidden(self) -> float:
        """What the open area may hide of which slices know nothing, over the whole surface, m."""
        hidden = np.maximum(HIDDEN.unknown_slope * self.places.distances, self.hole_errors)
        hides = self.away & ~self.places.under & ~self.reached
        return float(np.sqrt((np.square(hidden) * hides).mean()))

    @cached_property
    def away(self) -> Bools:
        """Which places are unknown: far from every touch, or spanned, (n,)."""
        return (self.places.distances > self.unknown_distance) | self.places.spanned

    def reachable(self, tried: Floats) -> float:
        """Share of the surface that lies far from every touch and that a touch can reach."""
        known = max(int(np.count_nonzero(~self.places.under)), 1)
        return float((self.met(tried) & self.away).sum()) / known

    def met(self, tried: Floats) -> Bools:
        """Places that touches can meet which have not been tried since, (n,)."""
        return np.asarray(self.reached & (self.left(tried) > 0.0), np.bool_)

    @cached_property
    def reached(self) -> Bools:
        """Places that the offers meet, (n,)."""
        met = np.zeros(PLACES.n_places, np.bool_)
        for offer in self.offers:
            met[offer.places] = True
        return np.asarray(met & (self.squares > 0.0), np.bool_)

    def is_inside(self, place: Floats) -> bool:
        """Whether a place (3,) lies within the solid."""
        return bool(
            np.isneginf(self.shape.cast(place[None], np.array([0.0, 0.0, 1.0]), MAX_RANGE))[0]
        )

    def left(self, tried: Floats) -> Floats:
        """The same, 0 where touches were aimed at since, (k, 3)."""
        squares = self.squares.copy()
        for offer in self.offers if len(tried) else ():
            if np.abs(tried - offer.target).max(axis=1).min() <= MAX_ROUNDING:
                squares[offer.places] = 0.0
        return squares


class OpenArea(NamedTuple):
    """What lies so far from every touch that nobody knows what is there."""

    share: float  # Of the surface, the underside apart
    width: float  # Of the largest opening, m; 0 if there is none
    places: (
        Floats  # Middles of the largest, (k, 3), m, the largest first; `PLACES.n_openings` at most
    )
    normals: Floats  # Outward there, (k, 3)
    under: float  # Share of the surface on which the object stands
    touches: float  # That it would take, if all of it can be reached


class SurfacePlaces(NamedTuple):
    """Places of a surface that each stand for the same area."""

    points: Floats  # (n, 3), m
    normals: Floats  # Outward, (n, 3)
    errors: Floats  # (n,), m
    bounds: Floats  # Their bounds of 95 %, (n,), m
    distances: Floats  # From what was touched, (n,), m
    standing: Bools  # Whether the object stands on it, (n,): nobody can touch it there
    flat: Bools  # Whether it stood on it at first, (n,), and nothing touched it since
    # Whether it stands there and was never turned over, or this faces down so near to that, (n,),
    # that the pedestal is in the way of most touches.
    under: Bools
    spanned: Bools  # Whether it lies in an opening that pads spanned, (n,): it may be deep


def _middles(places: SurfacePlaces, far: Bools) -> Ints:
    """Numbers of the places in the middle of openings, the widest first, none within another."""
    distances, middles = np.where(far, places.distances, 0.0), list[int]()
    while len(middles) < PLACES.n_openings and distances.max() > 0.0:
        most = int(distances.argmax())
        middles.append(most)
        beside = np.linalg.norm(places.points - places.points[most], axis=1)
        distances[beside < 2.0 * places.distances[most]] = 0.0
    return np.array(middles, np.int32)


def _outward(places: SurfacePlaces, number: int) -> Floats:
    """Mean outward normal (3,) of the opening about a place; off the middle where they cancel."""
    away = np.linalg.norm(places.points - places.points[number], axis=1)
    mean = places.normals[away < 0.5 * places.distances[number]].mean(axis=0)
    if np.linalg.norm(mean) < PLACES.min_mean_normal:  # what nothing was touched of may be folded
        mean = places.points[number] - places.points.mean(axis=0)
    return np.asarray(mean / max(float(np.linalg.norm(mean)), np.finfo(float).tiny))


def _places(surface: ObservedSurface) -> SurfacePlaces:
    corners = surface.mesh.vertices[surface.mesh.faces]
    points, faces = sample_surface(corners, PLACES.n_places, np.random.default_rng(len(corners)))
    normals = areas_and_normals(corners)[1][faces]
    standing = flat = under = np.zeros(PLACES.n_places, np.bool_)
    errors, bounds, distances = (
        values[surface.mesh.faces[faces]].mean(axis=1)
        for values in (surface.errors, surface.bounds, surface.distances)
    )
    if surface.platform is not None:
        heights = points[:, 2] - surface.platform
        flat = standing = _stands(heights)
    if surface.platform is not None and surface.pose is None:
        under = standing | _hangs_over(points, standing, 0.5 * pad_width(surface.pad)) & (
            (heights < APPROACHES.finger_length) & (normals[:, 2] < PLACES.max_downward)
        )
    elif surface.platform is not None and surface.pose is not None:
        at_first = surface.pose.to_local(points)[:, 2] - surface.platform
        flat = _stands(at_first) & (distances > APPROACHES.known_radius * pad_width(surface.pad))
    spanned = np.zeros(PLACES.n_places, np.bool_)
    if len(surface.openings):
        near = point_tree(surface.openings).query(points)[0] < PLACES.opening_depth
        spanned = near & (distances > PLACES.min_opening) & ~flat
    errors_there = errors, bounds, distances
    return SurfacePlaces(points, normals, *errors_there, standing, flat, under, spanned)


def _thickness(places: SurfacePlaces, numbers: Ints) -> Floats:
    """How thick (k,) the solid is below some of the places, m: most, in five directions inwards.

    Infinite where no far side was drawn in one of them.
    """
    thickness = np.zeros(len(numbers))
    for row, number in enumerate(numbers):
        inward = -places.normals[number]
        aside = axes_across(inward[None])[0]
        leaning = math.sin(HIDDEN.tilt) * np.concatenate([aside, -aside])
        away = places.points - places.points[number]
        for direction in (inward, *(math.cos(HIDDEN.tilt) * inward + leaning)):
            depths = away @ direction
            lateral = np.linalg.norm(away - depths[:, None] * direction, axis=1)
            far = (lateral < HIDDEN.lateral) & (depths > 0.0) & (places.normals @ direction > 0.0)
            depth = float(depths[far].min(initial=np.inf)) + HIDDEN.lateral
            thickness[row] = max(thickness[row], depth)
    return thickness


def _stands(heights: Floats) -> Bools:
    """At which places (n,) an object stands, by their heights over the platform [m].

    It stands somewhere: what is lowest of a solid that is said to end higher is not understood.
    """
    return np.asarray(heights < PLACES.standing_height + max(float(heights.min()), 0.0))


def _hangs_over(points: Floats, standing: Bools, width: float) -> Bools:
    """Which of the points (n, 3) lie within this width, m, aside of those that stand."""
    if not standing.any():
        return standing
    return np.asarray(point_tree(points[standing, :2]).query(points[:, :2])[0] < width)
