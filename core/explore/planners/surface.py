"""A solid of any shape as a planner of single touches sees it, and what touches are worth.

The planner has the triangles of the solid and the expected error of each vertex. Places are drawn
from the surface, uniformly by area. The platform is a pedestal, as wide as the convex hull of what
stands on it: beside it the finger reaches lower, and touches surfaces that face down. A touch is
worth the sum of the squared errors of the places that it meets or comes near to.
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
    MAX_RANGE,
    MAX_ROUNDING,
    ApproachSettings,
    TouchOffer,
    touch_offers,
)
from palpate.core.explore.planners.hollows import (
    HollowSettings,
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

    n_places: int = 4000  # drawn from the whole surface, uniformly by area
    pedestal_grid: float = 4.0e-3  # [m] between places on the pedestal's top: far less than a pad
    standing_height: float = 1.0e-3  # [m] over the platform, below which the object stands on it
    max_downward: float = -0.7  # z part of a normal, below which a place faces down
    n_openings: int = 8  # widest openings, whose middles are published
    min_mean_normal: float = 0.3  # resultant length; below it normals have no common direction
    opening_depth: float = 3.0e-3  # [m] from a spanned place, up to which the surface is open
    min_opening: float = 1.5e-3  # [m] from every touch, from which on a place can be open
    touched_area: float = 1.0e-4  # [m^2] that one touch covers


@dataclass(frozen=True, slots=True, kw_only=True)
class HiddenSettings:
    """The error that a place may hide: a slope, times the distance from the nearest touch."""

    unknown_slope: float = 0.5  # error per distance, of places that no finger came near to
    crease_slope: float = 0.3  # error per distance, of creases that hold the pad off
    # Error per half width of an opening, walls included: of a hole four times as deep as wide.
    # Where the solid is thinner than that, the error is that of a hole through it.
    opening_slope: float = 16.0
    tilt: float = math.radians(40.0)  # [rad] to the inward normal, of directions of possible holes
    line_radius: float = 3.0e-3  # [m] about a line in such a direction; far places inside it count
    min_room: float = 0.8  # fraction of the tolerance that other places leave to touchable ones


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceSettings:
    """How a solid is seen: its places, what they may hide, and how they are touched."""

    places: PlaceSettings = PlaceSettings()
    hidden: HiddenSettings = HiddenSettings()
    hollows: HollowSettings = field(default=HollowSettings())
    approaches: ApproachSettings = field(default=ApproachSettings())


DEFAULT_SURFACE = SurfaceSettings()


class Progress(NamedTuple):
    """What was known of a solid after a number of touches."""

    touches: int
    bound: float  # [m] 95 % bound of the rms error of places that were or can be touched
    open: float  # share of the surface that lies far from every touch, and can be reached


@readable
@dataclass(frozen=True, eq=False)
class ObservedSurface:
    """A solid as a planner sees it; world frame."""

    mesh: Mesh  # closed, normals outwards [m]
    errors: Floats  # (n,) [m] expected at each vertex
    bounds: Floats  # (n,) [m] 95 % bounds of the errors
    distances: Floats  # (n,) [m] of each vertex from the nearest touched point
    pad: Pad  # of the finger
    platform: float | None  # [m] height on which the object stands
    reach: float  # [m] of the finger, sideways from the axis and up from the platform
    refused: Floats  # (j, 3) [m] targets of earlier touches that did not meet them
    aimed: Floats  # (i, 3) [m] targets of all earlier single touches
    # (k, 3) [m] places of the solid that a pad spanned: it touched only what is beside them
    openings: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    missing: float = 0.0  # [m] rms error of the whole, from touched parts that the solid lacks
    touches: int = 0  # made so far
    earlier: tuple[Progress, ...] = ()  # of earlier models by the same method
    unknown_distance: float = 10.0e-3  # [m] from every touch, beyond which a place is unknown
    pose: Pose | None = None  # relative to the first pose, if the object was turned over
    settings: SurfaceSettings = field(default=DEFAULT_SURFACE, repr=False)

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
        """Squared errors (n,) [m2] at the places; 0 where no touch is possible, or none met.

        Where no errors are known, distances from the touched points replace them. An opening has
        the error that it may hide until `n_opening_aims` touches were aimed at it, including the
        one that found it: at most openings the solid is only a little too large.
        """
        places, settings = self.places, self.settings
        near = 0.5 * settings.approaches.known_radius * pad_width(self.pad)
        squares = np.square(places.errors if places.errors.any() else places.distances)
        opened = np.square(settings.hidden.opening_slope * places.distances)
        squares = np.where(places.spanned, np.maximum(opened, np.square(places.bounds)), squares)
        if self.pose is not None:  # the first underside can be touched now
            hidden = np.square(settings.hidden.unknown_slope * places.distances)
            squares = np.where(places.flat, np.maximum(squares, hidden), squares)
        if len(self.refused):
            squares[point_tree(self.refused).query(places.points)[0] < near] = 0.0
        if len(self.aimed) and places.spanned.any():
            count = settings.places.n_openings
            middles = places.points[_middles(places, places.spanned, count)]
            aims = point_tree(self.aimed).query_ball_point(middles, 2.0 * near, return_length=True)
            tried = np.asarray(aims) >= settings.hollows.n_opening_aims
            squares[places.spanned & tried[point_tree(middles).query(places.points)[1]]] = 0.0
        return np.where(places.standing, 0.0, squares)

    @cached_property
    def open_area(self) -> OpenArea:
        """What lies far from every touch, except the underside."""
        places, settings = self.places, self.settings.places
        far = self.away & ~places.under
        known = np.count_nonzero(~places.under)
        middles = _middles(places, far, settings.n_openings)
        directions = [_outward(places, i, settings.min_mean_normal) for i in middles.tolist()]
        return OpenArea(
            float(far.sum()) / max(int(known), 1),
            2.0 * float(places.distances[middles].max(initial=0.0)),
            places.points[middles],
            np.array(directions).reshape(-1, 3),
            float(places.under.mean()),
            float(far.sum()) / settings.n_places * self.area / settings.touched_area,
        )

    @cached_property
    def findings(self) -> Findings:
        """What is known of the solid, for a verdict."""
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
        """Width of the widest hole that a pad spanned and no pad entered [m]; 0 without one."""
        return 2.0 * float(self.places.distances[self.places.spanned | self.pits].max(initial=0.0))

    @cached_property
    def area(self) -> float:
        """Area of the whole surface [m2]."""
        return float(areas_and_normals(self.mesh.vertices[self.mesh.faces])[0].sum())

    @cached_property
    def rms_bound_95(self) -> float:
        """The root mean square error is below this in 95 of 100 runs [m].

        The underside is left out: it may be hollow, and no number bounds its error.
        """
        return math.hypot(self.bound_of(~self.places.flat), self.missing)

    @cached_property
    def progress(self) -> tuple[Progress, ...]:
        """What was known after earlier models, and now."""
        none = np.zeros((0, 3))
        now = Progress(self.touches, self.touchable_bound(none), self.reachable(none))
        return (*self.earlier, now)

    def touchable_bound(self, tried: Floats) -> float:
        """95 % bound of the rms error of places that were touched, or can be [m]."""
        return self.bound_of(self._touchable(tried))

    def touchable_limit(self, tried: Floats, tolerance: float) -> float:
        """Largest `touchable_bound` with which the whole is within a tolerance [m]; at most that.

        Where all other places leave too little for it (`min_room`), it is the tolerance itself.
        """
        touchable = self._touchable(tried)
        counted = ~self.places.flat
        rest = float((np.square(self.bounds_there) * ~touchable)[counted].mean())
        room, share = tolerance**2 - rest, float(touchable[counted].mean())
        if room < self.settings.hidden.min_room**2 * share * tolerance**2:
            return tolerance
        return min(math.sqrt(room / share), tolerance) if share else tolerance

    def _touchable(self, tried: Floats) -> Bools:
        untouchable = self.places.standing | self.creased
        return np.asarray(~untouchable & (~self.away | self.met(tried)))

    def bound_of(self, chosen: Bools) -> float:
        """95 % bound of the rms error of chosen places (n,) [m]; 0 if there are none."""
        squares = np.square(self.bounds_there[chosen])
        return float(np.sqrt(squares.mean())) if len(squares) else 0.0

    @cached_property
    def neighbours(self) -> Ints:
        """Numbers of evenly chosen places, `n_neighbours` of them within reach of a pad."""
        count, wanted = self.settings.places.n_places, self.settings.hollows.n_neighbours
        in_reach = 2.0 * math.pi * (0.5 * pad_width(self.pad)) ** 2 * count / self.area
        return np.arange(0, count, max(round(in_reach / wanted), 1), dtype=np.int32)

    @cached_property
    def creased(self) -> Bools:
        """Mask (n,) of the places from which neighbours hold a pad off, in any lean."""
        places, settings = self.places, self.settings.hollows
        creased = ~places.flat & (places.distances > settings.min_gap)
        if creased.any():
            there = places.points[creased], places.normals[creased]
            beside = places.points[self.neighbours]
            gaps = pad_gaps(self.pad, beside, *there, settings.min_gap, settings)
            creased[creased] = gaps > settings.min_gap
        return creased

    @cached_property
    def bounds_there(self) -> Floats:
        """95 % bounds (n,) [m] of the errors at the places, and of creases and holes there."""
        hidden = np.where(self.creased, self.settings.hidden.crease_slope, 0.0)
        hidden = hidden * self.places.distances
        return np.maximum(self.places.bounds, np.maximum(hidden, self.hole_errors))

    @cached_property
    def hole_errors(self) -> Floats:
        """Error (n,) [m] that holes may hide in openings and pits; 0 elsewhere.

        It is the root mean square distance of a hole's walls from the surface that closes it, per
        area of that surface: of a hole of radius r through a thickness t it is at most
        (t^3 / (6 r) + t^2 / 4)^(1/2), a blind one included.
        """
        places, settings = self.places, self.settings.hidden
        errors = np.zeros(len(places.points))
        opened = np.flatnonzero(places.spanned | self.pits).astype(np.int32)
        radii = np.maximum(places.distances[opened], np.finfo(float).tiny)
        depths = _thickness(places, opened, settings)
        through = np.sqrt(depths**3 / (6.0 * radii) + 0.25 * depths**2)
        errors[opened] = np.minimum(settings.opening_slope * radii, through)
        return errors

    @cached_property
    def pits(self) -> Bools:
        """Mask (n,) of places in creases that are concave all around: holes may begin there."""
        places, settings = self.places, self.settings.hollows
        pits = self.creased & (places.distances > settings.min_pit_distance)
        if pits.any():
            beside = places.points[self.neighbours], places.normals[self.neighbours]
            there = places.points[pits], places.normals[pits]
            concavity = least_concavity(*beside, *there, 0.5 * pad_width(self.pad), settings)
            pits[pits] = concavity > 1.0 / settings.max_pit_radius
        return pits

    @cached_property
    def pedestal(self) -> Floats:
        """Places (k, 3) [m] on the pedestal's top: the convex hull of where the object stands."""
        standing = self.places.points[self.places.standing]
        if len(standing) < 3 or self.platform is None:
            return standing
        try:
            planes = scipy.spatial.ConvexHull(standing[:, :2]).equations
        except scipy.spatial.QhullError:  # it stands on a line
            return standing
        sides = zip(standing.min(axis=0)[:2], standing.max(axis=0)[:2], strict=True)
        step = self.settings.places.pedestal_grid
        x, y = np.meshgrid(*(np.arange(low, high, step) for low, high in sides))
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
        """Rms error of the whole [m] that unknown places beyond the reach of touches may hide."""
        hidden = self.settings.hidden.unknown_slope * self.places.distances
        hidden = np.maximum(hidden, self.hole_errors)
        hides = self.away & ~self.places.under & ~self.reached
        return float(np.sqrt((np.square(hidden) * hides).mean()))

    @cached_property
    def away(self) -> Bools:
        """Mask (n,) of the unknown places: far from every touch, or spanned by a pad."""
        return (self.places.distances > self.unknown_distance) | self.places.spanned

    def reachable(self, tried: Floats) -> float:
        """Share of the surface that lies far from every touch and that a touch can reach."""
        known = max(int(np.count_nonzero(~self.places.under)), 1)
        return float((self.met(tried) & self.away).sum()) / known

    def met(self, tried: Floats) -> Bools:
        """Mask (n,) of places that offers meet whose targets are not among those `tried`."""
        return np.asarray(self.reached & (self.left(tried) > 0.0), np.bool_)

    @cached_property
    def reached(self) -> Bools:
        """Mask (n,) of the places that the offers meet."""
        met = np.zeros(len(self.places.points), np.bool_)
        for offer in self.offers:
            met[offer.places] = True
        return np.asarray(met & (self.squares > 0.0), np.bool_)

    def is_inside(self, place: Floats) -> bool:
        """Whether a place (3,) [m] lies within the solid."""
        return bool(
            np.isneginf(self.shape.cast(place[None], np.array([0.0, 0.0, 1.0]), MAX_RANGE))[0]
        )

    def left(self, tried: Floats) -> Floats:
        """`squares`, with 0 at places of offers whose targets were `tried` since, (k, 3) [m]."""
        squares = self.squares.copy()
        for offer in self.offers if len(tried) else ():
            if np.abs(tried - offer.target).max(axis=1).min() <= MAX_ROUNDING:
                squares[offer.places] = 0.0
        return squares


class OpenArea(NamedTuple):
    """The part of the surface that lies far from every touch, or that a pad spanned."""

    share: float  # of the surface, underside left out
    width: float  # [m] of the largest opening; 0 if there is none
    places: Floats  # (k, 3) [m] middles of the largest, by size; at most `n_openings`
    normals: Floats  # (k, 3) outward normals there
    under: float  # share of the surface that is underside, as `SurfacePlaces.under`
    touches: float  # that would cover it, if all of it can be reached


class SurfacePlaces(NamedTuple):
    """Places of a surface that each stand for the same area."""

    points: Floats  # (n, 3) [m]
    normals: Floats  # (n, 3) outward
    errors: Floats  # (n,) [m] expected
    bounds: Floats  # (n,) [m] 95 % bounds of the errors
    distances: Floats  # (n,) [m] from the nearest touched point
    standing: Bools  # (n,) whether the object stands on the place now: it cannot be touched
    flat: Bools  # (n,) whether the object first stood on the place, and nothing touched it since
    # (n,) whether the object stands on the place, or the place faces down so near to the pedestal
    # that this is in the way of most touches; never of an object that was turned over.
    under: Bools
    spanned: Bools  # (n,) whether the place lies in an opening that pads spanned: it may be deep


def _middles(places: SurfacePlaces, far: Bools, count: int) -> Ints:
    """Numbers of the middles of at most `count` openings, the widest first, none in another."""
    distances, middles = np.where(far, places.distances, 0.0), list[int]()
    while len(middles) < count and distances.max() > 0.0:
        most = int(distances.argmax())
        middles.append(most)
        beside = np.linalg.norm(places.points - places.points[most], axis=1)
        distances[beside < 2.0 * places.distances[most]] = 0.0
    return np.array(middles, np.int32)


def _outward(places: SurfacePlaces, number: int, min_mean_normal: float) -> Floats:
    """Mean outward normal (3,) about a place; where normals cancel, away from the middle."""
    away = np.linalg.norm(places.points - places.points[number], axis=1)
    mean = places.normals[away < 0.5 * places.distances[number]].mean(axis=0)
    if np.linalg.norm(mean) < min_mean_normal:  # an untouched part may be folded
        mean = places.points[number] - places.points.mean(axis=0)
    return np.asarray(mean / max(float(np.linalg.norm(mean)), np.finfo(float).tiny))


def _places(surface: ObservedSurface) -> SurfacePlaces:
    settings, approaches = surface.settings.places, surface.settings.approaches
    corners = surface.mesh.vertices[surface.mesh.faces]
    points, faces = sample_surface(corners, settings.n_places, np.random.default_rng(len(corners)))
    normals = areas_and_normals(corners)[1][faces]
    standing = flat = under = np.zeros(len(points), np.bool_)
    errors, bounds, distances = (
        values[surface.mesh.faces[faces]].mean(axis=1)
        for values in (surface.errors, surface.bounds, surface.distances)
    )
    if surface.platform is not None:
        heights = points[:, 2] - surface.platform
        flat = standing = _stands(heights, settings.standing_height)
    if surface.platform is not None and surface.pose is None:
        under = standing | _hangs_over(points, standing, 0.5 * pad_width(surface.pad)) & (
            (heights < approaches.finger_length) & (normals[:, 2] < settings.max_downward)
        )
    elif surface.platform is not None and surface.pose is not None:
        at_first = surface.pose.to_local(points)[:, 2] - surface.platform
        flat = _stands(at_first, settings.standing_height)
        flat = flat & (distances > approaches.known_radius * pad_width(surface.pad))
    spanned = np.zeros(len(points), np.bool_)
    if len(surface.openings):
        near = point_tree(surface.openings).query(points)[0] < settings.opening_depth
        spanned = near & (distances > settings.min_opening) & ~flat
    errors_there = errors, bounds, distances
    return SurfacePlaces(points, normals, *errors_there, standing, flat, under, spanned)


def _thickness(places: SurfacePlaces, numbers: Ints, settings: HiddenSettings) -> Floats:
    """Thickness (k,) [m] of the solid below some places: the largest of five inward directions.

    It is infinite where one of these directions meets none of the drawn places.
    """
    thickness = np.zeros(len(numbers))
    for row, number in enumerate(numbers):
        inward = -places.normals[number]
        aside = axes_across(inward[None])[0]
        leaning = math.sin(settings.tilt) * np.concatenate([aside, -aside])
        away = places.points - places.points[number]
        for direction in (inward, *(math.cos(settings.tilt) * inward + leaning)):
            depths = away @ direction
            lateral = np.linalg.norm(away - depths[:, None] * direction, axis=1)
            near, faces = lateral < settings.line_radius, places.normals @ direction > 0.0
            depth = float(depths[near & faces & (depths > 0.0)].min(initial=np.inf))
            depth += settings.line_radius
            thickness[row] = max(thickness[row], depth)
    return thickness


def _stands(heights: Floats, standing_height: float) -> Bools:
    """Mask of the places (n,) on which an object stands, by their heights over the platform [m].

    Of a solid that ends above the platform, heights count from its lowest place.
    """
    return np.asarray(heights < standing_height + max(float(heights.min()), 0.0))


def _hangs_over(points: Floats, standing: Bools, width: float) -> Bools:
    """Mask (n,) of points (n, 3) [m] at most `width` [m] sideways from standing ones."""
    if not standing.any():
        return standing
    return np.asarray(point_tree(points[standing, :2]).query(points[:, :2])[0] < width)
