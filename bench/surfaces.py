"""Touches with known truth: random surfaces of each kind, and walks over quadrics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core import touch
from palpate.core.arrays import Bools, Floats

MM = 1e-3
# From points x, y to the height over the pad and the number of the face.
PadSurface = Callable[[Floats, Floats], tuple[Floats, Floats]]
Vector = tuple[float, float, float]
WALKED_PAD = touch.Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)


@dataclass(frozen=True, slots=True, kw_only=True)
class KindSettings:
    """When taxels count as touched, and which kind a touch has."""

    min_compression: float = 50e-6  # [m] of a touched taxel
    min_compression_sigmas: float = 5.0  # the same, in standard deviations of a taxel
    min_face_taxels: int = 8  # touched taxels of a face that counts
    min_taxels: int = 12  # touched taxels of a touch; with fewer its kind is `insufficient`
    # [pitch] root mean square spread of a face's taxels across their longest direction; the taxels
    # of a narrower face lie on a line and do not determine a plane.
    min_face_width: float = 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkSettings:
    """A walk over a quadric."""

    n_touches: int = 12  # of a walk
    step: float = 3e-3  # [m] between touches: four fifths of the pad overlap
    depth: float = 1.5e-3  # [m] of a touch
    min_compression: float = 50e-6  # [m] of a touched taxel
    tilt: float = 0.05  # [rad] standard deviation of the pad's tilt from the surface
    first_compared: int = 3  # index of the first touch whose fused curvature is compared


DEFAULT_KINDS = KindSettings()
DEFAULT_WALK = WalkSettings()


class KnownTouch(NamedTuple):
    """A touch whose kind is known."""

    kind: touch.PatchKind
    pad: touch.Pad
    height: Floats  # Surface over the plane of the pad's face (rows, cols) [m]
    touched: Bools  # (rows, cols)
    noise: float  # Standard deviation of a taxel [m]


def draw_touch(
    rng: np.random.Generator, name: str, settings: KindSettings = DEFAULT_KINDS
) -> KnownTouch | None:
    """One random touch of a surface by its name in `SURFACES`; None for a borderline case.

    By default a face counts if it has 8 touched taxels that are not on a line; a face with fewer,
    but some, makes a borderline case. Fewer than 12 touched taxels are insufficient.
    """
    dome = 0.0 if rng.random() < 0.5 else 1.0 / rng.uniform(12 * MM, 25 * MM)
    pad = touch.Pad(rows=16, cols=16, pitch=MM, thickness=3 * MM, dome=dome, saturation=0.8)
    x, y = pad.grid()
    surface, face = SURFACES[name](rng)(x, y)
    noise = 10.0 ** rng.uniform(-6.0, math.log10(20e-6))
    depth = rng.uniform(1.0 * MM, 2.2 * MM)
    if name == "grazing":
        depth = rng.uniform(0.02 * MM, 0.15 * MM)
    over = surface + pad.sag()
    gap = np.inf if name == "nothing" else float(over.min()) + depth
    compression = np.maximum(gap - over, 0.0) if np.isfinite(gap) else np.zeros_like(over)
    compression = compression + noise * rng.normal(size=over.shape)
    touched = compression > max(settings.min_compression, settings.min_compression_sigmas * noise)
    kind = _kind(pad, face, touched, settings)
    return kind and KnownTouch(kind, pad, pad.surface(compression, touched), touched, noise)


def _kind(
    pad: touch.Pad, face: Floats, touched: Bools, settings: KindSettings
) -> touch.PatchKind | None:
    if not touched.any():
        return "miss"
    if touched.sum() < settings.min_taxels:
        return "insufficient"
    faces = [int(number) for number in np.unique(face[touched])]
    if not all(_counts(pad, touched & (face == number), settings) for number in faces):
        return None
    kinds: tuple[touch.PatchKind, ...] = ("smooth", "edge", "corner")
    return kinds[min(len(faces), len(kinds)) - 1]


def _counts(pad: touch.Pad, own: Bools, settings: KindSettings) -> bool:
    """Whether a face with these taxels counts."""
    if own.sum() < settings.min_face_taxels:
        return False
    offsets = np.column_stack([axis[own] - axis[own].mean() for axis in pad.grid()])
    spreads = np.linalg.svd(offsets, compute_uv=False)
    return bool(spreads[1] >= settings.min_face_width * pad.pitch * math.sqrt(len(offsets)))


class FusionScore(NamedTuple):
    """Errors of the principal curvatures over many walks."""

    single: float  # Root mean square error of one touch [1/m]
    fused: float  # The same after fusion with the touches before it
    surprise: float  # Mean normalised squared innovation; 3 if the stated errors are true


def score_fusion(
    name: str, noise: float, n_walks: int, seed: int = 0, settings: WalkSettings = DEFAULT_WALK
) -> FusionScore:
    """Errors of single and of fused touches over several walks on one of the `WALKS`.

    `noise`: standard deviation of a taxel [m]. `seed`: of noise and tilt.
    """
    rng = np.random.default_rng(seed)
    errors, surprises = [], []
    for _ in range(n_walks):
        fused = None
        for number, (local, truth) in enumerate(_touches(rng, *WALKS[name], noise, settings)):
            fused = touch.begin_fusion(local) if fused is None else touch.fuse(fused, local)
            if number < settings.first_compared:
                continue
            true = np.array([truth.k1, truth.k2])
            alone = touch.principal_curvatures(local.shape)
            errors.append([np.array(alone[:2]) - true, np.array(fused.principal[:2]) - true])
            surprises.append(fused.surprise)
    single, both = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
    return FusionScore(float(single), float(both), float(np.mean(surprises)))


def _touches(
    rng: np.random.Generator,
    inverse_squares: Vector,
    start: Vector,
    noise: float,
    settings: WalkSettings,
) -> Iterator[tuple[touch.LocalCurvature, touch.PrincipalCurvatures]]:
    """Touches along a walk, and the true curvature at each."""
    matrix = np.diag(inverse_squares)
    point = np.array(start) / math.sqrt(float(np.array(start) @ matrix @ start))
    for _ in range(settings.n_touches):
        axes = _tilted_axes(rng, -matrix @ point, settings.tilt)
        height = _height(matrix, point, axes)
        advance = float(height.min()) + settings.depth
        compression = advance - height
        touched = compression > settings.min_compression
        compression = compression + noise * rng.normal(size=height.shape)
        surface = np.where(touched, -compression, 0.0)
        patch = touch.fit_patch(WALKED_PAD, surface, touched, axes[:, 0], noise)
        if patch.shape is not None and patch.shape_covariance is not None:
            tangents, normal = patch.shape.tangents @ axes.T, axes @ patch.shape.normal
            shape = touch.ShapeOperator(tangents, normal, patch.shape.parts)
            place = point + axes @ (patch.place + np.array([0.0, 0.0, advance]))
            yield touch.LocalCurvature(place, shape, patch.shape_covariance), _truth(matrix, place)
        along = np.cross([0.0, 0.0, 1.0], matrix @ point)
        point = point + settings.step * along / np.linalg.norm(along)
        point = point / math.sqrt(float(point @ matrix @ point))


def _tilted_axes(rng: np.random.Generator, into: Floats, tilt: float) -> Floats:
    """Axes (columns) of a pad with a random tilt from the surface and a random rotation."""
    into = _unit(_unit(into) + tilt * rng.normal(size=3))
    x = _unit(np.cross(into, rng.normal(size=3)))
    return np.column_stack([x, np.cross(into, x), into])


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


def _height(matrix: Floats, point: Floats, axes: Floats) -> Floats:
    """Height of the surface over a pad's plane through a point, (rows, cols) [m]."""
    x, y = WALKED_PAD.grid()
    place = point + x[..., None] * axes[:, 0] + y[..., None] * axes[:, 1]
    into = axes[:, 2]
    a = float(into @ matrix @ into)
    b = place @ matrix @ into
    c = np.einsum("rci,ij,rcj->rc", place, matrix, place) - 1.0
    # This form of the root is on the near side, and finite also where a is 0 (cylinders).
    height: Floats = c / (-b + np.sqrt(np.maximum(b * b - a * c, 0.0)))
    return height


def _truth(matrix: Floats, place: Floats) -> touch.PrincipalCurvatures:
    """Principal curvatures of the quadric at a place on it or near it."""
    gradient = matrix @ place
    size = float(np.linalg.norm(gradient))
    normal = gradient / size
    frame = np.linalg.svd(normal[None])[2][1:]
    k = frame @ matrix @ frame.T / size
    parts = (float(k[0, 0]), float(k[0, 1]), float(k[1, 1]))
    return touch.principal_curvatures(touch.ShapeOperator(frame, normal, parts))


def _quadric(matrix: Floats, top: Floats) -> PadSurface:
    """The near side of p' matrix p = 1, moved so that `top` (2,) is the centre of the pad."""

    def surface(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        across = np.stack([x - top[0], y - top[1]])
        flat = np.einsum("irc,ij,jrc->rc", across, matrix[:2, :2], across)
        half = np.einsum("i,irc->rc", matrix[:2, 2], across)
        inside = half**2 - matrix[2, 2] * (flat - 1.0)
        root = np.sqrt(np.maximum(inside, 0.0))
        height = (-half - root) / matrix[2, 2]
        return np.where(inside > 0.0, height, np.inf), np.zeros_like(x)

    return surface


def _ball(rng: np.random.Generator) -> PadSurface:
    radius = 10.0 ** rng.uniform(-2.1, -1.0)  # 8 to 100 mm
    return _quadric(np.eye(3) / radius**2, 0.15 * radius * rng.uniform(-1, 1, 2))


def _ellipsoid(rng: np.random.Generator) -> PadSurface:
    turn, axes = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(15 * MM, 40 * MM, 3)
    return _quadric(turn @ np.diag(axes**-2) @ turn.T, np.zeros(2))


def _cylinder(rng: np.random.Generator) -> PadSurface:
    lean, turn = math.radians(rng.uniform(-20, 20)), rng.uniform(0, math.pi)
    radius = 10.0 ** rng.uniform(-2.1, -1.0)
    axis = [math.cos(lean) * math.cos(turn), math.cos(lean) * math.sin(turn), math.sin(lean)]
    matrix = (np.eye(3) - np.outer(axis, axis)) / radius**2
    return _quadric(matrix, 0.1 * radius * rng.uniform(-1, 1, 2))


def _saddle(rng: np.random.Generator) -> PadSurface:
    half = 0.5 * rng.uniform(-1, 1, 3) / (25 * MM)
    slope = rng.uniform(-0.2, 0.2, 2)

    def surface(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        bent = half[0] * x * x + 2.0 * half[1] * x * y + half[2] * y * y
        return bent + slope[0] * x + slope[1] * y, np.zeros_like(x)

    return surface


def _plane(rng: np.random.Generator) -> PadSurface:
    return _faces(rng.uniform(-0.12, 0.12, (1, 2)), np.zeros(2), 1.0, 0.0)


def _edge(rng: np.random.Generator, convex: float, rounding: float) -> PadSurface:
    """Two faces whose normals turn by 25 to 120 degrees at the edge."""
    half = math.radians(rng.uniform(25.0, 120.0 if convex > 0 else 70.0)) / 2.0
    lean = math.radians(rng.uniform(-1.0, 1.0)) * min(25.0, 80.0 - math.degrees(half))
    tilt = rng.uniform(-0.15, 0.15)
    slopes = np.array([[math.tan(lean + half), tilt], [math.tan(lean - half), tilt]])
    return _spun_faces(rng, slopes, 4 * MM, convex, rounding)


def _corner(rng: np.random.Generator, convex: float) -> PadSurface:
    """Three faces whose directions of steepest descent are 90 to 150 degrees apart."""
    first, second = np.radians(rng.uniform(90.0, 150.0, 2))
    turns = np.array([0.0, first, first + second])
    if first + second < math.radians(210.0):  # so that the three surround the tip
        turns[2] = math.radians(240.0)
    steep = rng.uniform(0.2, 0.9 if convex > 0 else 0.5, 3)
    slopes = np.column_stack([steep * np.cos(turns), steep * np.sin(turns)])
    return _spun_faces(rng, slopes, 3 * MM, convex)


def _pyramid(rng: np.random.Generator) -> PadSurface:
    """Four faces, as of a hipped roof."""
    steep = rng.uniform(0.3, 0.8, 4)
    turns = math.pi / 2 * np.arange(4) + np.radians(rng.uniform(-10.0, 10.0, 4))
    slopes = np.column_stack([steep * np.cos(turns), steep * np.sin(turns)])
    return _spun_faces(rng, slopes, 2 * MM)


def _faces(slopes: Floats, place: Floats, convex: float, rounding: float) -> PadSurface:
    """The upper or lower envelope of planes through one point, rounded with a radius."""
    turn = float(np.ptp(slopes, axis=0) @ np.ptp(slopes, axis=0)) if len(slopes) == 2 else 0.0
    blend = 0.25 * rounding * turn  # of a smooth maximum whose crest has that radius

    def surface(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        away = np.stack([x - place[0], y - place[1]])
        planes = convex * np.einsum("ki,irc->krc", slopes, away)
        face = planes.argmax(axis=0).astype(float)
        top = planes.max(axis=0)
        if blend > 0.0:
            top = top + blend * np.log(np.exp((planes - top) / blend).sum(axis=0))
        return convex * top, face

    return surface


def _spun_faces(
    rng: np.random.Generator,
    slopes: Floats,
    spread: float,
    convex: float = 1.0,
    rounding: float = 0.0,
) -> PadSurface:
    """Randomly rotated faces, through a point at most `spread` off the centre along each axis."""
    turn = rng.uniform(0.0, 2.0 * math.pi)
    c, s = math.cos(turn), math.sin(turn)
    spun = slopes @ np.array([[c, s], [-s, c]])
    return _faces(spun, rng.uniform(-spread, spread, 2), convex, rounding)


def _step(rng: np.random.Generator) -> PadSurface:
    rise, turn = rng.uniform(0.2 * MM, 0.8 * MM), rng.uniform(0.0, 2.0 * math.pi)
    slope, place = rng.uniform(-0.08, 0.08, 2), rng.uniform(-4 * MM, 4 * MM)

    def surface(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        beyond = (x * math.cos(turn) + y * math.sin(turn) > place).astype(float)
        return slope[0] * x + slope[1] * y + rise * beyond, beyond

    return surface


def _rim(rng: np.random.Generator) -> PadSurface:
    """The rim between the flat end of a cylinder and its side."""
    radius, lean = rng.uniform(15 * MM, 50 * MM), math.radians(rng.uniform(25.0, 65.0))
    turn, place = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(-3 * MM, 3 * MM, 2)
    c, s = math.cos(turn), math.sin(turn)

    def surface(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        dx, dy = x - place[0], y - place[1]
        along, across = c * dx + s * dy, c * dy - s * dx
        end = along / math.tan(lean)
        inside = np.maximum(radius**2 - across**2, 0.0)
        side = (radius - np.sqrt(inside)) / math.cos(lean) - along * math.tan(lean)
        return np.maximum(end, side), (side > end).astype(float)

    return surface


SURFACES: Mapping[str, Callable[[np.random.Generator], PadSurface]] = {
    "ball": _ball,
    "ellipsoid": _ellipsoid,
    "cylinder": _cylinder,
    "saddle": _saddle,
    "plane": _plane,
    "edge": lambda rng: _edge(rng, 1.0, 0.0),
    "rounded edge": lambda rng: _edge(rng, 1.0, rng.uniform(0.0, 1.0 * MM)),
    "groove": lambda rng: _edge(rng, -1.0, 0.0),
    "step": _step,
    "rim": _rim,
    "corner": lambda rng: _corner(rng, 1.0),
    "pit": lambda rng: _corner(rng, -1.0),
    "pyramid": _pyramid,
    "grazing": lambda rng: SURFACES[("ball", "edge", "corner")[rng.integers(3)]](rng),
    "nothing": _plane,
}
# Quadrics x'Mx = 1 with principal axes along x, y, z: the diagonal of M [1/m^2], and the direction
# from the centre in which a walk around the z axis starts. The last walk passes the end of a long
# ellipsoid, where curvature grows fivefold and falls again within the width of two pads.
WALKS: Mapping[str, tuple[Vector, Vector]] = {
    "sphere": ((0.03**-2, 0.03**-2, 0.03**-2), (1.0, 0.0, 0.0)),
    "cylinder": ((0.025**-2, 0.025**-2, 0.0), (1.0, 0.0, 0.0)),
    "ellipsoid": ((0.05**-2, 0.04**-2, 0.03**-2), (0.3, 1.0, 0.1)),
    "saddle": ((0.03**-2, 0.03**-2, -(0.05**-2)), (1.0, 0.0, 0.0)),
    "sharp end": ((0.045**-2, 0.02**-2, 0.03**-2), (0.5, 0.9, 0.0)),
}
