"""Contact features of a cone: vertex, edge, face and parabolic point, read off one touch.

Fearing, *Tactile sensing for shape interpretation*, 1990, as told by Fung, 1999, section 1.4.3.1: a
linear straight homogeneous generalised cylinder has no others. A parabolic point is as good as a
meridian edge: the surface is straight along it. The pad's springs measure points of the object
itself: faces are planes through them by total least squares, edges and vertices their meets.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints, finite_array, not_negative, scaled_mad
from palpate.core.geometry import axes_across

FeatureGroup = Literal["V", "E", "F", "P"]  # Vertex, edge, face, parabolic point
FeaturePlace = Literal["T", "B", "S", "M"]  # Top, bottom, side, meridian
ENDS: dict[FeaturePlace | None, float] = {"T": 1.0, "B": -1.0}  # Which way each faces on the axis
ContactKind = Literal["smooth", "edge", "corner", "insufficient", "miss", "invalid"]
PLACES: dict[str, tuple[FeaturePlace, ...]] = {
    "V": ("T", "B"), "E": ("T", "B", "M"), "F": ("T", "B", "S"), "P": ("M",),
}  # fmt: skip
NORMALS = {"V": (0, 1, 2, 3), "E": (0, 2), "F": (1,), "P": (0, 1)}  # How many a feature may have
SIGNIFICANT = 3.0  # Standard deviations beyond which a curvature or a distance is none of noise
LEAST_FOLD = np.radians(3.0)  # Faces that meet at less are one
LEAST_POINTS = 4  # On each face: three make any plane
LEAST_WIDTH = 1e-3  # Of the patch: points that spread less beside their line make no plane


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Feature:
    """One contact feature, in the world frame."""

    group: FeatureGroup  # What it is
    point: Floats  # Where it was touched, (3,), m
    place: FeaturePlace | None = None  # Where on the cone it lies; None if that is not known
    # Unit vector along an edge, or along the vanishing curvature of a parabolic point, (3,); its
    # sign means nothing. None for vertices and faces
    direction: Floats | None = None
    # Outward unit normals of the faces that meet there, (k, 3); none if no face was told apart
    normals: Floats = field(default_factory=lambda: np.empty((0, 3)))
    curvature: float = 0.0  # Across the meridian of a parabolic point, 1/m; convex is positive

    def __post_init__(self) -> None:
        """Refuse what no cone has."""
        if self.group not in PLACES:
            raise ValueError(f"group must be V, E, F or P, got {self.group!r}")
        if self.place is not None and self.place not in PLACES[self.group]:
            allowed = ", ".join(PLACES[self.group])
            raise ValueError(f"place of {self.group} must be {allowed} or None, got {self.place!r}")
        object.__setattr__(self, "point", finite_array("point", self.point, (3,)))
        normals = finite_array("normals", self.normals, (None, 3))
        if len(normals) not in NORMALS[self.group]:
            raise ValueError(f"{self.group} has {NORMALS[self.group]} normals, got {len(normals)}")
        object.__setattr__(self, "normals", _unit("normals", normals))
        if (self.direction is None) != (self.group in "VF"):
            raise ValueError(f"direction must be given for E and P alone, group is {self.group}")
        if self.direction is not None:
            direction = finite_array("direction", self.direction, (3,))
            object.__setattr__(self, "direction", _unit("direction", direction))
        bend = self.curvature
        if not (bend > 0.0 if self.group == "P" else bend == 0.0):
            raise ValueError(f"curvature must be positive for P and 0 otherwise, got {bend} 1/m")

    @property
    def name(self) -> str:
        """Group and place as the tables write them: E_T, P_m, or E alone."""
        if self.place is None:
            return self.group
        return f"{self.group}_{'m' if self.place == 'M' else self.place}"


def _unit(name: str, vectors: Floats) -> Floats:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not (np.abs(lengths - 1.0) <= 1e-6).all():  # Less is rounding, and normalised
        raise ValueError(f"{name} must be of length 1, got {lengths.ravel().tolist()}")
    return np.asarray(vectors / lengths)


class ContactFeature(NamedTuple):
    """What one touch was read as."""

    feature: Feature | None  # Of unknown place; None if the touch met no feature of a cone
    reason: str  # How it was read, or why it was not
    misfit: float = 0.0  # Root mean square distance of the touched points from its planes, m


def feature_of_contact(
    kind: ContactKind,
    points: ArrayLike,
    normal: ArrayLike,
    *,
    principal: tuple[float, float] = (0.0, 0.0),
    principal_error: tuple[float, float] = (0.0, 0.0),
    principal_direction: ArrayLike = (0.0, 0.0, 0.0),
    noise: float = 0.0,
) -> ContactFeature:
    """The feature of a cone that one touch met.

    `kind`: verdict of the curvature estimator. `points` (n, 3): surface under the touched taxels,
    world frame, m. `normal` (3,): outward unit normal at the middle of the contact. `principal`:
    curvatures k1 >= k2 with their standard errors, 1/m, convex is positive. `principal_direction`
    (3,): unit tangent of k1. These three count only if `kind` is smooth. `noise`: standard
    deviation of one taxel, m. Raises ValueError if arrays have other shapes or are not finite, or
    the directions that count are no unit vectors.
    """
    if kind in ("insufficient", "miss", "invalid"):
        return ContactFeature(None, f"the touch is called {kind}")
    touched = finite_array("points", points, (None, 3))
    outward = _unit("normal", finite_array("normal", normal, (3,)))
    noise = not_negative("noise", noise, "m")
    spread = _spread(touched)
    if len(touched) < LEAST_POINTS or not spread[1] > LEAST_WIDTH * spread[0]:
        return ContactFeature(None, "the touched points span no plane")
    if kind == "edge":
        return _edge(touched, outward, noise)
    if kind == "corner":
        return _vertex(touched, outward, noise)
    if kind != "smooth":
        raise ValueError(f"kind must be one of {get_args(ContactKind)}, got {kind!r}")
    # A jet bends by 2e-3 of the patch's width on a plane's account
    sagitta = max(SIGNIFICANT * noise / np.sqrt(len(touched)), 4.0 * 2e-3 * float(spread[0]))
    least = np.maximum(SIGNIFICANT * np.array(principal_error), 0.5 * sagitta / spread[0] ** 2)
    bent = np.abs(principal) > least
    across = finite_array("principal_direction", principal_direction, (3,))
    return _smooth(touched, outward, across, principal, bent)


def _spread(points: Floats) -> Floats:
    """Standard deviations (3,) of points along their principal axes, largest first, m."""
    squares = np.linalg.eigvalsh(np.cov(points.T, bias=True))[::-1]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _smooth(
    points: Floats, outward: Floats, across: Floats, principal: tuple[float, float], bent: Bools
) -> ContactFeature:
    """A face, or a parabolic point if it is bent along its first principal direction alone."""
    if not bent.any():
        normal, centre = fit_planes(points, np.ones((1, len(points)), bool), outward)
        misfit = float(np.sqrt(np.mean(((points - centre[0]) @ normal[0]) ** 2)))
        face = Feature(group="F", point=centre[0], normals=normal)
        return ContactFeature(face, "flat both ways", misfit)
    k1, k2 = principal
    if bent.all():
        return ContactFeature(None, f"curved both ways, by {k1:.3g} and {k2:.3g} 1/m")
    bend = k1 if bent[0] else k2
    if bend < 0.0:
        return ContactFeature(None, f"concave, by {bend:.3g} 1/m: the section of a cone is convex")
    across = _unit("principal_direction", across)
    along = np.cross(outward, across)
    # Over the middle the surface is a polynomial of fourth degree where it bends, of second along;
    # of few points a simpler one, for twice as many as there are coefficients.
    middle = points.mean(axis=0)
    u, v, w = np.stack([across, along, outward]) @ (points - middle).T
    terms = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v, u**3, u**4])
    terms = terms[:, : len(points) // 2]
    place = middle + np.linalg.lstsq(terms, w, rcond=None)[0][0] * outward
    along = along / np.linalg.norm(along)
    parabolic = Feature(
        group="P", point=place, direction=along, normals=outward[None], curvature=bend
    )
    return ContactFeature(parabolic, "flat along one direction")


def _edge(points: Floats, outward: Floats, noise: float) -> ContactFeature:
    planes = _separated(points, outward, 2, noise)
    if planes is None:
        return ContactFeature(None, "the touched points do not lie on two faces")
    along = np.cross(*planes.normals)
    fold = float(np.arctan2(np.linalg.norm(along), planes.normals[0] @ planes.normals[1]))
    if fold < LEAST_FOLD:
        return ContactFeature(None, f"the faces meet at {np.degrees(fold):.2g} degrees: no edge")
    if planes.hollow:
        return ContactFeature(None, "the edge is hollow: a cone is convex")
    along = along / np.linalg.norm(along)
    place = _meeting(np.vstack([planes.normals, along]), [*planes.centres, points.mean(axis=0)])
    edge = Feature(group="E", point=place, direction=along, normals=planes.normals)
    return ContactFeature(edge, "two faces meet", planes.misfit)


def _vertex(points: Floats, outward: Floats, noise: float) -> ContactFeature:
    """Where three planes meet, or the point that stands out farthest if fewer can be told apart."""
    planes = _separated(points, outward, 3, noise)
    least = np.sin(LEAST_FOLD) ** 2
    if planes and not planes.hollow and abs(np.linalg.det(planes.normals)) > least:
        place = _meeting(planes.normals, [*planes.centres])
        vertex = Feature(group="V", point=place, normals=planes.normals)
        return ContactFeature(vertex, "three faces meet", planes.misfit)
    highest = points[np.argmax(points @ outward)]
    return ContactFeature(Feature(group="V", point=highest), "the point that stands out farthest")


def _meeting(normals: Floats, centres: list[Floats]) -> Floats:
    """The point (3,) of three planes; told from its middle, so that few digits are lost."""
    middle = np.mean(centres, axis=0)
    offsets = np.einsum("ij,ij->i", normals, np.array(centres) - middle)
    return np.asarray(middle + np.linalg.solve(normals, offsets))


class _Planes(NamedTuple):
    normals: Floats  # Outward unit normals (k, 3)
    centres: Floats  # Means of their points (k, 3), m
    misfit: float  # Root mean square distance of the points from the nearest plane, m
    hollow: bool  # Whether points of one lie outside another


def _separated(points: Floats, outward: Floats, count: int, noise: float) -> _Planes | None:
    """The planes that fit best, from many first splits; None if the points of one span none."""
    least = max(LEAST_POINTS, int(0.04 * len(points)))  # Points on each face, at least
    rounding = 1e-9 * 4.0 * float(_spread(points)[0])  # m: no distance from a plane is smaller
    best: tuple[float, Ints] | None = None
    for split in _first_splits(points, outward, count):
        settled = _settled(points, outward, split, count, least)
        if settled is not None and (best is None or settled[0] < best[0]):
            best = settled
            if settled[0] < rounding:
                break
    if best is None:
        return None
    members = best[1] == np.arange(count)[:, None]
    if any(one[1] <= LEAST_WIDTH * one[0] for one in (_spread(points[two]) for two in members)):
        return None
    normals, centres = fit_planes(points, members, outward)
    distances = _distances(points, normals, centres)
    off = np.abs(distances[best[1], np.arange(len(points))])
    limit = max(SIGNIFICANT * noise, SIGNIFICANT * scaled_mad(off), rounding)
    kept = members & (off <= limit)
    if (kept.sum(axis=1) >= least).all():
        normals, centres = fit_planes(points, kept, outward)
        distances = _distances(points, normals, centres)
    pairs = itertools.permutations(range(count), 2)
    standing = max(float(distances[i][kept[j]].mean()) for i, j in pairs)
    misfit = float(np.sqrt(np.mean(np.abs(distances).min(axis=0) ** 2)))
    return _Planes(normals, centres, misfit, standing > limit)


def _first_splits(points: Floats, outward: Floats, count: int) -> list[Ints]:
    """Faces (n,) of the points: halves at many azimuths and offsets, or thirds about the middle."""
    turns = np.arange(12) * (np.pi if count == 2 else 2.0 * np.pi / 3.0) / 12
    if count == 2:
        plane = (points - points.mean(axis=0)) @ axes_across(outward).T
        beside = [plane @ [np.cos(turn), np.sin(turn)] for turn in turns]
        splits = itertools.product((0.3, 0.5, 0.7), beside)  # Shares of the points beyond
        return [(one > np.quantile(one, share)).astype(np.int32) for share, one in splits]
    top = points[np.argsort(points @ outward)[-LEAST_POINTS:]].mean(axis=0)
    x, y = ((points - top) @ axes_across(outward).T).T
    azimuths = np.mod(np.arctan2(y, x) - turns[:, None], 2.0 * np.pi)
    return [*((azimuths * count / (2.0 * np.pi)).astype(np.int32) % count)]


def _settled(
    points: Floats, outward: Floats, labels: Ints, count: int, least: int
) -> tuple[float, Ints] | None:
    """Misfit and faces (n,) when each point has gone to its nearest plane; None if one dies out."""
    distances = np.zeros((count, len(points)))
    for _ in range(30):  # Until no point changes its face
        members = labels == np.arange(count)[:, None]
        if (members.sum(axis=1) < least).any():
            return None
        distances = np.abs(_distances(points, *fit_planes(points, members, outward)))
        again = distances.argmin(axis=0).astype(np.int32)
        if np.array_equal(again, labels):
            break
        labels = again
    if (np.bincount(labels, minlength=count) < least).any():
        return None
    return float(np.sqrt(np.mean(distances.min(axis=0) ** 2))), labels


def fit_planes(points: Floats, members: Bools, outward: Floats) -> tuple[Floats, Floats]:
    """Outward unit normals and centres (k, 3) of planes with `members` (k, n), by least squares."""
    shares = members / members.sum(axis=1, keepdims=True)
    centres = shares @ points
    centred = points - centres[:, None]
    spread = np.einsum("kn,kni,knj->kij", shares, centred, centred)
    normals = np.linalg.eigh(spread)[1][:, :, 0]
    return normals * np.where(normals @ outward < 0.0, -1.0, 1.0)[:, None], centres


def _distances(points: Floats, normals: Floats, centres: Floats) -> Floats:
    """Heights (k, n) of points over planes, m."""
    return np.asarray(normals @ points.T - np.einsum("ij,ij->i", normals, centres)[:, None])
