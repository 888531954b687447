"""Contact features of a cone: vertex, edge, face and parabolic point, read off one touch.

Fearing, *Tactile sensing for shape interpretation*, 1990, quoted by Fung, 1999, section 1.4.3.1: a
linear straight homogeneous generalised cylinder has no others. A parabolic point is as good as a
meridian edge: the surface is straight along it. The pad's springs measure points of the object
itself: faces are planes through them by total least squares; edges and vertices are where these
intersect.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints, finite_array, not_negative, scaled_mad
from palpate.core.geometry import axes_across

FeatureGroup = Literal["V", "E", "F", "P"]  # vertex, edge, face, parabolic point
FeaturePlace = Literal["T", "B", "S", "M"]  # top, bottom, side, meridian
ENDS: dict[FeaturePlace | None, float] = {"T": 1.0, "B": -1.0}  # sign of its normal along the axis
ContactKind = Literal["smooth", "edge", "corner", "insufficient", "miss", "invalid"]
PLACES: dict[str, tuple[FeaturePlace, ...]] = {
    "V": ("T", "B"), "E": ("T", "B", "M"), "F": ("T", "B", "S"), "P": ("M",),
}  # fmt: skip
NORMALS = {"V": (0, 1, 2, 3), "E": (0, 2), "F": (1,), "P": (0, 1)}  # possible numbers of normals


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSettings:
    """When touched points are flat, curved, or on several faces."""

    n_sigmas: float = 3.0  # [standard deviations] of a curvature or distance that is not noise
    min_sagitta: float = 2e-3  # fraction of the patch's width; jets of planes may have less
    min_fold: float = math.radians(3.0)  # [rad] between faces; at a smaller angle they are one
    min_points: int = 4  # on each face
    min_share: float = 0.04  # of the points, on each face
    min_width: float = 1e-3  # of points on a plane, over their length
    n_azimuths: int = 12  # of the first splits of points into faces
    split_shares: tuple[float, ...] = (0.3, 0.5, 0.7)  # of the points, in the first splits by two
    max_steps: int = 30  # until no point changes its face


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Feature:
    """One contact feature, in the world frame."""

    group: FeatureGroup
    point: Floats  # touched point, (3,) [m]
    place: FeaturePlace | None = None  # on the cone; None if it is not known
    # Unit vector along an edge, or along the vanishing curvature of a parabolic point, (3,), of
    # either sign. None for vertices and faces.
    direction: Floats | None = None
    # Outward unit normals of the faces that meet there, (k, 3); none if they are not known.
    normals: Floats = field(default_factory=lambda: np.empty((0, 3)))
    curvature: float = 0.0  # [1/m] across the meridian of a parabolic point; convex is positive

    def __post_init__(self) -> None:
        """Raise ValueError for a feature that no cone has."""
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
    if not (np.abs(lengths - 1.0) <= 1e-6).all():  # rounding, which is removed
        raise ValueError(f"{name} must be of length 1, got {lengths.ravel().tolist()}")
    return np.asarray(vectors / lengths)


class ContactFeature(NamedTuple):
    """Classification of one touch."""

    feature: Feature | None  # of unknown place; None if it is not a feature of a cone
    reason: str  # of the classification, or of its failure
    misfit: float = 0.0  # [m] root mean square distance of the touched points from its planes


def feature_of_contact(
    kind: ContactKind,
    points: ArrayLike,
    normal: ArrayLike,
    *,
    principal: tuple[float, float] = (0.0, 0.0),
    principal_error: tuple[float, float] = (0.0, 0.0),
    principal_direction: ArrayLike = (0.0, 0.0, 0.0),
    noise: float = 0.0,
    settings: FeatureSettings = FeatureSettings(),
) -> ContactFeature:
    """The feature of a cone that was touched.

    `kind`: of the contact, by the curvature estimator. `points` (n, 3): surface under the touched
    taxels in the world frame [m]. `normal` (3,): outward unit normal at the middle of the contact.
    `principal`, `principal_error`: curvatures k1 >= k2 and their standard errors [1/m]; convex is
    positive. `principal_direction` (3,): unit tangent of k1. These three count only if `kind` is
    smooth. `noise`: standard deviation of one taxel [m]. Raises ValueError if arrays have other
    shapes or are not finite, or directions that count are not unit vectors.
    """
    if kind in ("insufficient", "miss", "invalid"):
        return ContactFeature(None, f"the touch is called {kind}")
    touched = finite_array("points", points, (None, 3))
    outward = _unit("normal", finite_array("normal", normal, (3,)))
    noise = not_negative("noise", noise, "m")
    spread = _spread(touched)
    if len(touched) < settings.min_points or not spread[1] > settings.min_width * spread[0]:
        return ContactFeature(None, "the touched points span no plane")
    if kind == "edge":
        return _edge(touched, outward, noise, settings)
    if kind == "corner":
        return _vertex(touched, outward, noise, settings)
    if kind != "smooth":
        raise ValueError(f"kind must be one of {get_args(ContactKind)}, got {kind!r}")
    n_sigmas = settings.n_sigmas
    min_sagitta = 4.0 * settings.min_sagitta * float(spread[0])
    sagitta = max(n_sigmas * noise / np.sqrt(len(touched)), min_sagitta)
    least = np.maximum(n_sigmas * np.array(principal_error), 0.5 * sagitta / spread[0] ** 2)
    bent = np.abs(principal) > least
    across = finite_array("principal_direction", principal_direction, (3,))
    return _smooth(touched, outward, across, principal, bent)


def _spread(points: Floats) -> Floats:
    """Standard deviations (3,) of points along their principal axes, largest first [m]."""
    squares = np.linalg.eigvalsh(np.cov(points.T, bias=True))[::-1]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _smooth(
    points: Floats, outward: Floats, across: Floats, principal: tuple[float, float], bent: Bools
) -> ContactFeature:
    """A face; or a parabolic point if it is bent along one principal direction only."""
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
    # The surface is fitted by a polynomial of fourth degree across the meridian, and of second
    # degree along it; with at most half as many coefficients as points.
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


def _edge(
    points: Floats, outward: Floats, noise: float, settings: FeatureSettings
) -> ContactFeature:
    """An edge where two planes meet."""
    planes = _fitted_planes(points, outward, 2, noise, settings)
    if planes is None:
        return ContactFeature(None, "the touched points do not lie on two faces")
    along = np.cross(*planes.normals)
    fold = float(np.arctan2(np.linalg.norm(along), planes.normals[0] @ planes.normals[1]))
    if fold < settings.min_fold:
        return ContactFeature(None, f"the faces meet at {np.degrees(fold):.2g} degrees: no edge")
    if planes.hollow:
        return ContactFeature(None, "the edge is hollow: a cone is convex")
    along = along / np.linalg.norm(along)
    place = _intersection(
        np.vstack([planes.normals, along]), [*planes.centres, points.mean(axis=0)]
    )
    edge = Feature(group="E", point=place, direction=along, normals=planes.normals)
    return ContactFeature(edge, "two faces meet", planes.misfit)


def _vertex(
    points: Floats, outward: Floats, noise: float, settings: FeatureSettings
) -> ContactFeature:
    """A vertex where three planes meet; or the highest point if there are fewer planes."""
    planes = _fitted_planes(points, outward, 3, noise, settings)
    min_determinant = np.sin(settings.min_fold) ** 2
    if planes and not planes.hollow and abs(np.linalg.det(planes.normals)) > min_determinant:
        place = _intersection(planes.normals, [*planes.centres])
        vertex = Feature(group="V", point=place, normals=planes.normals)
        return ContactFeature(vertex, "three faces meet", planes.misfit)
    highest = points[np.argmax(points @ outward)]
    return ContactFeature(Feature(group="V", point=highest), "the point that stands out farthest")


def _intersection(normals: Floats, centres: list[Floats]) -> Floats:
    """The point (3,) of three planes, relative to their middle, so that few digits are lost."""
    middle = np.mean(centres, axis=0)
    offsets = np.einsum("ij,ij->i", normals, np.array(centres) - middle)
    return np.asarray(middle + np.linalg.solve(normals, offsets))


class _Planes(NamedTuple):
    normals: Floats  # outward unit normals (k, 3)
    centres: Floats  # means of their points (k, 3) [m]
    misfit: float  # [m] root mean square distance of the points from the nearest plane
    hollow: bool  # whether points of one plane lie outside another


def _fitted_planes(
    points: Floats, outward: Floats, count: int, noise: float, settings: FeatureSettings
) -> _Planes | None:
    """The planes that fit best, from many first splits; None if the points of one are on a line."""
    min_points = max(settings.min_points, int(settings.min_share * len(points)))
    rounding = 1e-9 * 4.0 * float(_spread(points)[0])  # [m] no distance from a plane is smaller
    labels = _best_split(points, outward, count, min_points, rounding, settings)
    if labels is None:
        return None
    members = labels == np.arange(count)[:, None]
    spreads = (_spread(points[face]) for face in members)
    if any(spread[1] <= settings.min_width * spread[0] for spread in spreads):
        return None
    normals, centres = fit_planes(points, members, outward)
    distances = _distances(points, normals, centres)
    offsets = np.abs(distances[labels, np.arange(len(points))])
    n_sigmas = settings.n_sigmas
    limit = max(n_sigmas * noise, n_sigmas * scaled_mad(offsets), rounding)
    kept = members & (offsets <= limit)
    if (kept.sum(axis=1) >= min_points).all():
        normals, centres = fit_planes(points, kept, outward)
        distances = _distances(points, normals, centres)
    pairs = itertools.permutations(range(count), 2)
    standing = max(float(distances[i][kept[j]].mean()) for i, j in pairs)
    misfit = float(np.sqrt(np.mean(np.abs(distances).min(axis=0) ** 2)))
    return _Planes(normals, centres, misfit, standing > limit)


def _best_split(
    points: Floats,
    outward: Floats,
    count: int,
    min_points: int,
    rounding: float,
    settings: FeatureSettings,
) -> Ints | None:
    """Faces (n,) of the points with the least misfit; None if there is no split."""
    best: tuple[float, Ints] | None = None
    for split in _first_splits(points, outward, count, settings):
        settled = _converged(points, outward, split, count, min_points, settings.max_steps)
        if settled is not None and (best is None or settled[0] < best[0]):
            best = settled
            if settled[0] < rounding:
                break
    return None if best is None else best[1]


def _first_splits(
    points: Floats, outward: Floats, count: int, settings: FeatureSettings
) -> list[Ints]:
    """Faces (n,) of the points: halves at many azimuths and offsets, or thirds about the middle."""
    n_azimuths = settings.n_azimuths
    turns = np.arange(n_azimuths) * (np.pi if count == 2 else 2.0 * np.pi / 3.0) / n_azimuths
    if count == 2:
        plane = (points - points.mean(axis=0)) @ axes_across(outward).T
        along = [plane @ [np.cos(turn), np.sin(turn)] for turn in turns]
        splits = itertools.product(settings.split_shares, along)
        return [(places > np.quantile(places, q)).astype(np.int32) for q, places in splits]
    top = points[np.argsort(points @ outward)[-settings.min_points :]].mean(axis=0)
    x, y = ((points - top) @ axes_across(outward).T).T
    azimuths = np.mod(np.arctan2(y, x) - turns[:, None], 2.0 * np.pi)
    return [*((azimuths * count / (2.0 * np.pi)).astype(np.int32) % count)]


def _converged(
    points: Floats, outward: Floats, labels: Ints, count: int, min_points: int, max_steps: int
) -> tuple[float, Ints] | None:
    """Misfit and faces (n,) with each point on its nearest plane; None if a face is too small."""
    distances = np.zeros((count, len(points)))
    for _ in range(max_steps):
        members = labels == np.arange(count)[:, None]
        if (members.sum(axis=1) < min_points).any():
            return None
        distances = np.abs(_distances(points, *fit_planes(points, members, outward)))
        nearest = distances.argmin(axis=0).astype(np.int32)
        if np.array_equal(nearest, labels):
            break
        labels = nearest
    if (np.bincount(labels, minlength=count) < min_points).any():
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
    """Heights (k, n) of points over planes [m]."""
    return np.asarray(normals @ points.T - np.einsum("ij,ij->i", normals, centres)[:, None])
