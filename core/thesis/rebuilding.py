"""From contours to a solid as Fung, 1999, chapter 4 and appendix, does it.

Contours are put into the cube from -1 to 1 (4.2, steps 1 to 3), and their points matched with
the model's azimuths (step 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry import area_centroid, azimuth_match, self_intersects, winding_number
from palpate.core.shapes import Superquadric
from palpate.core.splines import (
    CUBIC,
    Lattice,
    Parallelepiped,
    SplineVolume,
    clamped_basis,
    fit_closed_curve,
    upright_parallelepiped,
)
from palpate.core.thesis.layers import ThesisLayer, make_layer, make_program_layer, rim_cells
from palpate.core.thesis.solid import (
    ModelTriples,
    ThesisHealth,
    ThesisSolid,
    interpolated_parameters,
    latitude_points,
    level_points,
    triples_of,
)
from palpate.core.thesis.spline_methods import invert_thesis

# Of the model: the program's, whatever the object. Its surface keeps close to the lattice's faces,
# where the shell is; a rounder one would be drawn inwards.
EXPONENTS = (0.15, 0.15)
LEAST_SIDE = CUBIC + 1
PROGRAM_CAP = 0.01  # Beyond the end rows, in whatever unit the contours are
FINE = 8  # Chords for each point of a contour, by which rays meet the curve through them
LEAST_POINTS = 4  # Different points of a contour, the fewest of which a curve is fitted
# Of the size: a last point that is nearer to the first one is the first one, given again.
SAME = 1e-12


class _Matched(NamedTuple):
    """Layers, and how their contours were matched."""

    layers: list[ThesisLayer]
    one_to_one: Bools
    degenerate: Bools
    self_intersecting: Bools


def rebuild_thesis(
    contours: Sequence[ArrayLike] | Floats,
    *,
    exponents: tuple[float, float] | None = None,
    layer: tuple[int, int] = (5, 5),
    faithful: bool = False,
) -> ThesisSolid:
    """The solid of the thesis's shell and core.

    Parameters
    ----------
    contours : (m, n, 3) array or sequence of m arrays (n, 3)
        At least 2 level contours with as many points each, m: see `stack_contours`.
    exponents : two numbers, optional
        e1 and e2 of the original model, from 0.02 to 2; 0.15 both if left out.
    layer : two integers
        Control points of a layer along s and t, at least 4.
    faithful : bool
        As the program in the appendix has it, in place of what is right: see the notes.

    Raises
    ------
    ValueError
        If the contours, the exponents or the layer cannot be used.

    Notes
    -----
    The program's ways that ``faithful`` keeps, in the normalised cube of 4.2:

    - a contour's points are taken by number, so that where they begin and which way they run
      matters, and are not resampled (step 5);
    - the model's rows lie at latitudes of up to 45 degrees, are not level, and leave out its ends;
    - points are inverted by (4.8) to (4.16);
    - the shell's polygons are those of clamped curves that do not close (4.4.2), laid along
      the rim so that the lattice is a mirror image;
    - the core's ellipse is searched for by `searched_scale`, the core is the box around it,
      and its direction depends on the quadrant of a vertex about the origin;
    - between known parameters a spline is laid, and clipped (4.3);
    - the ends are closed by points 0.01 beyond them, of whatever unit.

    Corrected are: the middle (of the area) and the match; level rows up to the poles, which
    close the solid; the inversion axis by axis; periodic polygons, a lattice that does not
    mirror, a core inside its shell; and the parameters, which are the model's own. What stays
    is the heuristic itself: contours are taken for control layers, which a spline does not
    pass, and the closed polygon is read with four clamped sides.
    """
    stack = stack_contours(contours)
    sides = _checked_sides(layer)
    chosen = finite_array("exponents", EXPONENTS if exponents is None else exponents, (2,))
    model = Superquadric(np.ones(3), chosen)
    count = stack.points.shape[1]
    matched = _by_number(stack, sides) if faithful else _by_azimuth(stack, sides)
    control = np.empty((*sides, len(stack.heights), 3))
    control[..., :2] = np.stack([one.control for one in matched.layers], axis=2)
    control[..., 2] = stack.heights
    undeformed = _undeformed(control.shape[:3])
    azimuths = np.append(ray_azimuths(count), np.pi)
    steps = np.linspace(-1.0, 1.0, len(stack.heights))
    if faithful:
        points = latitude_points(model, np.arctan(steps), azimuths)
        parameters = triples_of(undeformed, points, invert_thesis)
    else:
        parameters = triples_of(undeformed, level_points(model, steps, azimuths))
    return ThesisSolid(
        lattice=_lattice(control, undeformed, stack),
        parameters=parameters,
        triples=(
            interpolated_parameters(parameters) if faithful else ModelTriples(model, undeformed)
        ),
        cap=PROGRAM_CAP if faithful else None,
        order=stack.order,
        health=_health(matched, control),
    )


def stack_contours(contours: Sequence[ArrayLike] | Floats) -> ContourStack:
    """Sort contours by height and put them into the cube from -1 to 1.

    `contours` (m, n, 3): at least 2 level contours, in any order, m; each with at least 4 points
    around it, the first again at the end of all of them or of none. A contour's height is the mean
    of its points'. Raises ValueError if there are too few contours or points, not as many points in
    each, some are not finite, or the contours have no extent along x, y or z.
    """
    given = [np.asarray(contour, dtype=np.float64) for contour in contours]
    if len(given) < 2:
        raise ValueError(f"contours must be at least 2, got {len(given)}")
    counts = sorted({len(contour) if contour.ndim else 0 for contour in given})
    if len(counts) > 1:
        raise ValueError(f"contours must have as many points each, got {counts[0]} to {counts[-1]}")
    points = finite_array("contours", np.stack(given), (None, None, 3))
    heights = points[:, :, 2].mean(axis=1)
    low = np.append(points[:, :, :2].min(axis=(0, 1)), heights.min())
    extent = np.append(points[:, :, :2].max(axis=(0, 1)), heights.max()) - low
    if not (extent > 0.0).all():
        raise ValueError(f"contours must extend along x, y and z, got {extent.tolist()} m")
    gaps = np.abs(points[:, -1, :2] - points[:, 0, :2]).max(axis=1)
    if (gaps <= SAME * extent.max()).all():
        points = points[:, :-1]
    if points.shape[1] < LEAST_POINTS:
        raise ValueError(
            f"contours must have at least {LEAST_POINTS} different points, got {points.shape[1]}"
        )
    order = np.argsort(heights, kind="stable").astype(np.int32)
    return ContourStack(
        points=2.0 * (points[order, :, :2] - low[:2]) / extent[:2] - 1.0,
        heights=2.0 * (heights[order] - low[2]) / extent[2] - 1.0,
        box=upright_parallelepiped(low, extent),
        order=order,
    )


def _checked_sides(layer: tuple[int, int]) -> tuple[int, int]:
    if len(layer) != 2 or min(layer) < LEAST_SIDE:
        raise ValueError(
            f"layer must be two numbers of points, at least {LEAST_SIDE} each, got {layer}"
        )
    return layer


def _by_number(stack: ContourStack, sides: tuple[int, int]) -> _Matched:
    flat = np.ptp(stack.points, axis=1).max(axis=1) == 0.0
    return _Matched(
        [make_program_layer(points, sides) for points in stack.points],
        np.ones(len(flat), bool),
        flat,
        np.array([self_intersects(points) for points in stack.points]) & ~flat,
    )


def _by_azimuth(stack: ContourStack, sides: tuple[int, int]) -> _Matched:
    azimuths = ray_azimuths(stack.points.shape[1])
    matches = [match_contour(points, azimuths) for points in stack.points]
    return _Matched(
        [make_layer(match.points, sides) for match in matches],
        np.array([match.one_to_one for match in matches]),
        np.array([match.degenerate for match in matches]),
        np.array([match.self_intersecting for match in matches]),
    )


def ray_azimuths(count: int) -> Floats:
    """Azimuths (count,) of so many rays: even ones from -pi on, rad."""
    return np.pi * (2.0 * np.arange(count) / count - 1.0)


def match_contour(points: Floats, azimuths: Floats) -> ContourMatch:
    """Where rays from the middle of a contour meet the closed curve through its points.

    `points` (n, 2): around it, begun anywhere, in either direction. `azimuths` (k,): of the rays,
    rad.

    The middle is that of the area: the mean of the points, as printed, lies where they are
    dense. Where a ray meets the curve several times or not at all, the azimuth is made
    monotone, or gives way to the length.
    """
    curve = fit_closed_curve(points)
    count = FINE * len(points)
    polygon = curve.at(np.arange(count) / count)
    middle = area_centroid(polygon)
    match = azimuth_match(polygon, middle, azimuths)
    flags = curve.flags
    return ContourMatch(
        match.points, middle, match.one_to_one, flags.degenerate, flags.self_intersecting
    )


def _undeformed(counts: tuple[int, ...]) -> SplineVolume:
    """The lattice over the cube from -1 to 1, with control points at even steps: (2.19)."""
    s, t, u = (clamped_basis(count, min(CUBIC, count - 1)) for count in counts)
    cube = upright_parallelepiped(np.full(3, -1.0), np.full(3, 2.0))
    return SplineVolume(cube.even_control((s.count, t.count, u.count)), (s, t, u))


def _lattice(control: Floats, undeformed: SplineVolume, stack: ContourStack) -> Lattice:
    """The lattice over the contours' box: parameters are the same in it as in the cube."""
    deformed, before = (
        SplineVolume(stack.box.points(0.5 * (places + 1.0)), undeformed.bases)
        for places in (control, undeformed.control)
    )
    return Lattice(deformed, before)


def _health(matched: _Matched, control: Floats) -> ThesisHealth:
    cells = rim_cells((control.shape[0], control.shape[1]))
    outside = [
        int((winding_number(layer[cells[:, 0], cells[:, 1]], _core_of(layer)) == 0).sum())
        for layer in (one.control for one in matched.layers)
    ]
    return ThesisHealth(
        one_to_one=matched.one_to_one,
        degenerate=matched.degenerate,
        self_intersecting=matched.self_intersecting,
        core_scales=np.array([one.core_scale for one in matched.layers]),
        cores_moved=np.array([one.moved for one in matched.layers]),
        cores_outside=np.array(outside, np.int32),
        gaps=np.array([one.gap for one in matched.layers]),
    )


def _core_of(layer: Floats) -> Floats:
    return layer[1:-1, 1:-1].reshape(-1, 2)


class ContourMatch(NamedTuple):
    """Which points of a contour belong to given azimuths."""

    points: Floats  # (k, 2)
    middle: Floats  # (2,): from where the azimuths are taken
    one_to_one: bool  # Each ray from the middle meets the contour once
    degenerate: bool  # The contour encloses nothing
    self_intersecting: bool  # The curve meets itself


class ContourStack(NamedTuple):
    """Level contours from the bottom to the top, normalised."""

    points: Floats  # (m, n, 2), each point once; from -1 to 1
    heights: Floats  # (m,), from -1 to 1, not falling
    box: Parallelepiped  # The box around the contours, m, which the cube from -1 to 1 stands for
    order: Ints  # (m,): which of the given contours each is
