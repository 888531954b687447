"""Hyperquadric: a sum of powers of linear forms, at most 1, optionally with dents; cast exactly.

Each term bounds the solid to a strip between two planes, so that a ray is searched only where it
lies in all strips, and there no power overflows. With g >= 1 a power |h|^g is convex along a ray:
its tangent lies below it, and its chord above. With g < 1 it is two concave branches that meet in a
cusp at h = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.shapes import ray_casting
from palpate.core.shapes.half_spaces import are_concurrent, deepest_point, polytope_box
from palpate.core.shapes.protocol import ImplicitShape, Mesh
from palpate.core.shapes.tessellations import icosphere, isosurface

MAX_TERMS = 24  # their planes have 17,000 common points, which are all tried
RANGE_TOLERANCE = 1e-13  # fraction of the solid's smallest extent
MIN_EXPONENT, MAX_EXPONENT = 0.1, 100.0
MIN_NORMAL, MAX_NORMAL = 1e-9, 1e9  # [1/m]
TINY = 1e-300  # added to a base, so that its negative powers are finite
MAX_FORM = 1e3  # larger linear forms are clipped, so that no power overflows


class Hyperquadric(ImplicitShape):
    """The points p = (x, y, z) with H(p) = sum |a x + b y + c z + d|^g + dents <= 1.

    `planes` (n, 4): a, b, c [1/m] and d of each term; 24 terms at most. `exponents` (n,): g of each
    term, 0.1 to 100. If none is below 1, a solid without dents is convex. `dents`: exponential
    terms. Raises ValueError if a number is not finite or out of range, the solid is unbounded in a
    direction, or it is empty. Exactly Fung, 1999, (2.28) to (2.30).
    """

    def __init__(self, planes: Floats, exponents: Floats, dents: tuple[Dent, ...] = ()):
        planes, exponents = checked_terms(planes, exponents)
        if len(planes) > MAX_TERMS:
            raise ValueError(f"planes must be at most {MAX_TERMS}, got {len(planes)}")
        lengths = np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        if np.linalg.matrix_rank(planes[:, :3] / lengths) < 3:
            raise ValueError(
                "planes must face in three independent directions, or the solid is unbounded; "
                f"got normals {planes[:, :3].tolist()}"
            )
        self._planes, self._exponents, self._dents = planes, exponents, dents
        # Bound of each linear form in the solid: swellings widen the strips.
        swelling = sum(max(-dent.depth, 0.0) for dent in dents)
        self._half: Floats = (1.0 + swelling) ** (1.0 / exponents)
        self._box = polytope_box(
            np.concatenate([planes[:, :3], -planes[:, :3]]),
            np.concatenate([self._half - planes[:, 3], self._half + planes[:, 3]]),
        )
        self._centre, least = deepest_point(
            lambda points: self.inside_out(points, np.zeros_like(points))[0], self._box, planes
        )
        if not least < 0.0:
            raise ValueError(
                "planes leave nothing inside: the sum of the terms is nowhere below 1, the "
                f"least that was found is {1.0 + least:.4g}; make a, b, c smaller"
            )
        if not self._has_radii and not len(self.mesh(0).faces):
            raise ValueError(
                "planes leave so little inside that a grid of 16 cells over the strips' common "
                f"part does not meet it: about {self._centre.tolist()} m; make a, b, c smaller"
            )

    @property
    def convex(self) -> bool:
        """Whether the solid is known to be convex."""
        return not self._dents and bool((self._exponents >= 1.0).all())

    def enclosure(self) -> Floats:
        """The box around the intersection of the strips: see `ImplicitShape.enclosure`."""
        return self._box

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """H less 1, and its slope: see `ImplicitShape.inside_out`. A cusp's slope is 0."""
        return self._beam(points, directions).level()

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        beam = self._beam(origins, direction[None])
        starts, ends = self._through_strips(beam)
        ends = np.minimum(ends, reach)

        def roots(met: Ints) -> Floats:
            return first_entries(beam.of(met), starts[met], ends[met], self._tolerance())

        return ray_casting.ranges_of(starts, ends, roots)

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Spans of parallel rays inside, (n, k, 2): see `CsgSolid.spans`."""
        if self.convex:
            return ray_casting.convex_spans(self, origins, direction)
        beam = self._beam(origins, direction[None])
        starts, ends = self._through_strips(beam)
        entering, leaving = (minorant(beam, outside) for outside in (True, False))
        return ray_casting.marched_spans(entering, leaving, starts, ends, self._tolerance())

    def mesh(self, level: int) -> Mesh:
        """Icosphere projected along radii if they meet the surface once, else `isosurface`."""
        if self._has_radii:
            return self._projected(level)
        return isosurface(self.inside_out, self._box, level)

    @property
    def _has_radii(self) -> bool:
        """Whether radii meet the surface once: all powers grow from the forms' common zero."""
        return self.convex or (not self._dents and are_concurrent(self._planes))

    def _projected(self, level: int) -> Mesh:
        directions, faces = icosphere(level)
        directions = directions * (0.5 * np.ptp(self._box, axis=0))
        if not self.convex:
            directions = _with_tips(directions, self._planes[:, :3])
        # From outside inwards, with a single root.
        far = self._through_strips(self._beam(self._centre[None], directions))[1]
        beam = self._beam(self._centre + far[:, None] * directions, -directions)
        entries = first_entries(beam, np.zeros(len(far)), far, RANGE_TOLERANCE)
        return Mesh(self._centre + (far - entries)[:, None] * directions, faces)

    def _tolerance(self) -> float:
        return RANGE_TOLERANCE * float(np.ptp(self._box, axis=0).min())

    def _beam(self, origins: Floats, directions: Floats) -> RayBundle:
        """Rays from origins (n, 3) in directions (n, 3), or in one, (1, 3)."""

        def forms(planes: Floats) -> tuple[Floats, Floats]:
            return planes[:, :3] @ origins.T + planes[:, 3:], planes[:, :3] @ directions.T

        kept = tuple((dent, *forms(dent.planes)) for dent in self._dents)
        return RayBundle(*forms(self._planes), self._exponents[:, None], kept)

    def _through_strips(self, beam: RayBundle) -> tuple[Floats, Floats]:
        min_rate = ray_casting.MIN_DIRECTION
        rate = np.where(np.abs(beam.rate) < min_rate, min_rate, beam.rate)
        middle = -beam.h / rate
        half = (1.0 + ray_casting.BOX_MARGIN) * self._half[:, None] / np.abs(rate)
        return np.maximum((middle - half).max(axis=0), 0.0), (middle + half).min(axis=0)


def first_entries(rays: RayBundle, starts: Floats, ends: Floats, tolerance: float) -> Floats:
    """First place (n,) of each ray at which it is inside, or `MISS`.

    Powers of 1 and more are convex along a ray, and the downward bend of a dent with powers of 2
    and more is bounded: these use `first_roots`, all others bounds over intervals.
    """
    dip = sum(dent.dip(rate) for dent, _, rate in rays.dents)
    if (rays.exponents < 1.0).any() or not math.isfinite(dip):
        return ray_casting.guaranteed_first_roots(minorant(rays, True), starts, ends, tolerance)

    def level(places: Floats, which: ray_casting.RaySelection) -> tuple[Floats, Floats]:
        return rays.of(which).at(places).level()

    return ray_casting.first_roots(level, starts, ends, tolerance, dip=dip)


def minorant(rays: RayBundle, outside: bool) -> ray_casting.MinorantFunction:
    """Lower bounds of H less 1, or of 1 less H."""
    line_of, sign = (line_below, 1.0) if outside else (line_above, -1.0)

    def floor(places: Floats, lengths: Floats, which: Ints) -> ray_casting.Minorant:
        now = rays.of(which).at(places)
        slope, drop = (part.sum(axis=0) for part in line_of(*now[:3], lengths))
        for dent, h, rate in now.dents:
            line = dent.line(h, rate, lengths, below=outside)
            slope, drop = slope + line.slope, drop + line.gap
        return ray_casting.Minorant(sign * now.level()[0], sign * slope, 0.0, lengths, drop)

    return floor


def line_below(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> LinearBound:
    """Steepest line that begins at a power and stays below it over the lengths (n,)."""
    convex = exponents >= 1.0
    tangent = power_slopes(h, rate, exponents)
    if convex.all():
        return LinearBound(tangent, np.zeros_like(tangent))
    # A branch lies above its chord. If it ends in a cusp, the only bound is 0.
    passed = ~convex & (lengths > _to_cusp(h, rate))
    chord = _chord(h, rate, exponents, lengths)
    slope = np.where(convex, tangent, np.where(passed, 0.0, chord))
    return LinearBound(slope, np.where(passed, powers(h, exponents), 0.0))


def line_above(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> LinearBound:
    """Flattest line that begins at a power, or above it, and stays above it over the lengths."""
    convex = exponents >= 1.0
    chord = _chord(h, rate, exponents, lengths)
    if convex.all():
        return LinearBound(chord, np.zeros_like(chord))
    rise = chord * lengths
    passed = ~convex & ((lengths > _to_cusp(h, rate)) | (h == 0.0))
    gap = np.where(passed, np.maximum(rise, 0.0), 0.0)
    branch = power_slopes(h, rate, exponents)
    slope = np.where(passed, np.where(rise > 0.0, 0.0, np.maximum(branch, chord)), branch)
    return LinearBound(np.where(convex, chord, slope), gap)


def _chord(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Floats:
    rise = powers(h + rate * lengths, exponents) - powers(h, exponents)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.where(lengths > 0.0, rise / lengths, power_slopes(h, rate, exponents))


def _with_tips(directions: Floats, normals: Floats, min_sine: float = 1e-9) -> Floats:
    """Directions, of which the nearest to each crease is moved onto it: the solid has tips there.

    `min_sine`: between two planes with a crease, over the largest sine.
    """
    first, second = np.triu_indices(len(normals), 1)
    creases = np.cross(normals[first], normals[second])
    length = np.linalg.norm(creases, axis=1)
    creases = creases[length > min_sine * length.max()]
    towards = creases / np.linalg.norm(creases, axis=1, keepdims=True)
    towards = np.concatenate([towards, -towards])
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    nearest: Ints = (directions / lengths @ towards.T).argmax(axis=0)
    moved = directions.copy()
    moved[nearest] = towards * lengths[nearest]
    return moved


class RayBundle(NamedTuple):
    """Rays, by the values of the linear forms at their origins."""

    h: Floats  # values of the terms' forms, (k, n)
    rate: Floats  # derivatives of the forms, (k, n) or (k, 1) [1/m]
    exponents: Floats  # (k, 1)
    dents: tuple[tuple[Dent, Floats, Floats], ...]  # with values and derivatives of their forms

    def of(self, which: ray_casting.RaySelection) -> RayBundle:
        """The selected rays."""
        dents = tuple((dent, h[:, which], _some(rate, which)) for dent, h, rate in self.dents)
        return RayBundle(self.h[:, which], _some(self.rate, which), self.exponents, dents)

    def at(self, places: Floats) -> RayBundle:
        """The same rays with origins moved to places (n,) along them."""
        dents = tuple((dent, h + rate * places, rate) for dent, h, rate in self.dents)
        return RayBundle(self.h + self.rate * places, self.rate, self.exponents, dents)

    def level(self) -> tuple[Floats, Floats]:
        """H less 1 and its slope at the rays' origins, (n,)."""
        value = powers(self.h, self.exponents).sum(axis=0) - 1.0
        slope = power_slopes(self.h, self.rate, self.exponents).sum(axis=0)
        for dent, h, rate in self.dents:
            more, steeper = dent.along(h, rate)
            value, slope = value + more, slope + steeper
        return value, slope


def _some(rate: Floats, which: ray_casting.RaySelection) -> Floats:
    return rate if rate.shape[1] == 1 else np.asarray(rate[:, which])


@dataclass(frozen=True, slots=True, eq=False)
class Dent:
    """A term a exp(-sum |a_k x + b_k y + c_k z + d_k|^g_k) of a hyperquadric.

    `depth`: a, positive for a dent, negative for a swelling. `planes` (n, 4): a_k, b_k, c_k [1/m]
    and d_k: the dent lies where all forms are small. `exponents` (n,): g_k, 0.1 to 100. Raises
    ValueError if a number is not finite, an exponent is out of range, there is no plane, or one has
    no normal. Fung, 1999, (2.30).
    """

    depth: float
    planes: Floats
    exponents: Floats

    def __post_init__(self) -> None:
        if not math.isfinite(self.depth):
            raise ValueError(f"depth must be finite, got {self.depth}")
        planes, exponents = checked_terms(self.planes, self.exponents)
        object.__setattr__(self, "planes", planes)
        object.__setattr__(self, "exponents", exponents)

    def along(self, h: Floats, rate: Floats) -> tuple[Floats, Floats]:
        """Value and slope (n,) from the planes' values and rates (k, n)."""
        exponents = self.exponents[:, None]
        value = self.depth * np.exp(-powers(h, exponents).sum(axis=0))
        return value, -value * power_slopes(h, rate, exponents).sum(axis=0)

    def line(self, h: Floats, rate: Floats, lengths: Floats, *, below: bool) -> LinearBound:
        """A line below or above the term over the lengths: see `line_below`, `line_above`."""
        values, slopes = self._ranges(h, rate, lengths)
        here, end = self.along(h, rate)[0], 0 if below else 1
        gap = here - values[end] if below else values[end] - here
        known = np.isfinite(slopes[end])
        return LinearBound(np.where(known, slopes[end], 0.0), np.where(known, 0.0, gap))

    def dip(self, rate: Floats) -> float:
        """Bound [1/m2] of the term's downward bend along rays; infinite without one.

        `rate` (k, n): derivatives of the planes' values along the rays. The second derivative is E
        (Q'^2 - Q'') with E = a exp(-Q). Each |h|^m exp(-|h|^g) is largest where |h|^g = m / g, and
        (sum q)^2 <= k sum q^2.
        """
        if (self.exponents < 2.0).any():
            return math.inf
        speed, g = np.abs(rate).max(axis=1), self.exponents
        if self.depth > 0.0:
            bends = g * (g - 1.0) * speed**2 * _most(g - 2.0, g)
        else:
            bends = len(g) * (g * speed) ** 2 * _most(2.0 * g - 2.0, g)
        return abs(self.depth) * float(bends.sum())

    def _ranges(self, h: Floats, rate: Floats, lengths: Floats) -> tuple[Floats, Floats]:
        """Least and largest value, and slope, over the lengths, (2, n) each."""
        exponents = self.exponents[:, None]
        least, most = range_of_powers(h, rate, exponents, lengths).sum(axis=1)
        factor = np.exp(-np.stack([most, least]))  # least and largest
        with np.errstate(invalid="ignore"):
            push = -self.depth * range_of_slopes(h, rate, exponents, lengths).sum(axis=1)
            low, high = push.min(axis=0), push.max(axis=0)
            slopes = np.stack(
                [low * np.where(low < 0.0, factor[1], factor[0]),
                 high * np.where(high > 0.0, factor[1], factor[0])]
            )  # fmt: skip
        return np.sort(self.depth * factor, axis=0), slopes


def checked_terms(planes: Floats, exponents: Floats) -> tuple[Floats, Floats]:
    """Planes (n, 4) and exponents (n,) of terms; raises ValueError if they are none."""
    planes = finite_array("planes", planes, (None, 4))
    if not len(planes):
        raise ValueError("planes must be at least one, got none")
    length = np.hypot(np.hypot(planes[:, 0], planes[:, 1]), planes[:, 2])
    bad = ~((length >= MIN_NORMAL) & (length <= MAX_NORMAL))
    if bad.any():
        raise ValueError(
            f"planes[{bad.argmax()}] must face somewhere: (a, b, c) must be {MIN_NORMAL:g} to "
            f"{MAX_NORMAL:g} 1/m long, got {length[bad][0]:g}"
        )
    exponents = finite_array("exponents", exponents, (len(planes),))
    if not ((exponents >= MIN_EXPONENT) & (exponents <= MAX_EXPONENT)).all():
        raise ValueError(
            f"exponents must lie between {MIN_EXPONENT:g} and {MAX_EXPONENT:g}, "
            f"got {exponents.tolist()}"
        )
    return planes, exponents


def _most(power: Floats, exponent: Floats) -> Floats:
    """Largest value of y^power exp(-y^exponent) for y >= 0."""
    share = power / exponent
    return share**share * np.exp(-share)  # 0^0 is 1


def range_of_powers(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Floats:
    """Least and largest power over the lengths, (2, k, n)."""
    first, last = powers(h, exponents), powers(h + rate * lengths, exponents)
    least = np.where(lengths >= _to_cusp(h, rate), 0.0, np.minimum(first, last))
    return np.stack([least, np.maximum(first, last)])


def powers(h: Floats, exponents: Floats) -> Floats:
    """Powers |h|^g, (k, n), of quantities (k, n) with exponents (k, 1)."""
    return np.minimum(np.abs(h), MAX_FORM) ** exponents


def range_of_slopes(h: Floats, rate: Floats, exponents: Floats, lengths: Floats) -> Floats:
    """Least and largest derivative of the powers over the lengths, (2, k, n), or infinite."""
    after = h + rate * lengths
    first, last = (power_slopes(place, rate, exponents) for place in (h, after))
    ends = np.sort(np.stack([first, last]), axis=0)
    cusp = (exponents < 1.0) & ((lengths >= _to_cusp(h, rate)) | (h == 0.0)) & (rate != 0.0)
    return np.stack([np.where(cusp, -np.inf, ends[0]), np.where(cusp, np.inf, ends[1])])


def power_slopes(h: Floats, rate: Floats, exponents: Floats) -> Floats:
    """Derivatives of the powers along rays, (k, n), from those of the quantities; 0 in a cusp."""
    size = np.minimum(np.abs(h), MAX_FORM)
    return exponents * (size + TINY) ** (exponents - 1.0) * (np.sign(h) * rate)


def _to_cusp(h: Floats, rate: Floats) -> Floats:
    """Distance to the zero of a form; infinite if it is not ahead."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.where(h * rate < 0.0, -h / rate, np.inf)


class LinearBound(NamedTuple):
    """A line below or above a function from a place on."""

    slope: Floats  # [1/m]
    gap: Floats  # between line and function at the place
