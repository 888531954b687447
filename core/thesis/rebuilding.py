"""From contours to a solid, by Fung, 1999, chapter 4 and appendix.

Contours are scaled to the cube from -1 to 1 (4.2, steps 1 to 3), and their points matched with the
model's azimuths (step 5). The solid is a deformed lattice with a superquadric's surface in it,
whose s, t, u come from inverting its points, or, as in 4.3, from a spline through known ones.

The program in the appendix, which ``faithful`` follows in the normalised cube of 4.2:

- takes a contour's points by number, so that their start and direction matter, and does not
  resample them (step 5);
- has the model's rows at latitudes of up to 45 degrees, not level, and without its ends;
- inverts points by (4.8) to (4.16);
- has the polygons of clamped curves that do not close as shells (4.4.2), laid along the rim so
  that the lattice is a mirror image;
- searches for the core's ellipse by `searched_scale`, takes the box around it, and turns it by the
  quadrant of a vertex about the origin;
- lays a spline between known parameters, and clips it (4.3);
- closes the ends by points 0.01 beyond them, in the contours' unit.

Corrected are: the middle (of the area) and the match; level rows up to the poles, which close the
solid; the inversion axis by axis; periodic polygons, a lattice that does not mirror, a core inside
its shell; and the parameters, which are the model's own. The heuristic itself stays: contours serve
as control layers, which a spline does not pass, and the closed polygon has four clamped sides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core import geometry, splines
from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.shapes import Mesh, Superquadric, regular_points
from palpate.core.thesis.layers import (
    ThesisLayer,
    invert_thesis,
    make_layer,
    make_program_layer,
    rim_cells,
)
from palpate.reprs import readable

MIN_SIDE = splines.CUBIC + 1  # control points along a side of a layer
MIN_CONTOUR_POINTS = 4  # different points, to which a curve is fitted
MIN_ROWS, MIN_COLUMNS = 2, 3  # of a mesh


def rebuild_thesis(
    contours: Sequence[ArrayLike] | Floats,
    *,
    exponents: tuple[float, float] = (0.15, 0.15),
    layer: tuple[int, int] = (5, 5),
    faithful: bool = False,
    cap: float = 0.01,
) -> ThesisSolid:
    """The solid of the thesis's shell and core.

    `contours` (m, n, 3): at least 2 level contours with as many points each [m]: see
    `stack_contours`. `exponents`: e1 and e2 of the original model, from 0.02 to 2; by default the
    program's, with which the model's surface is close to the lattice's faces, where the shell is.
    `layer`: control points of a layer along s and t, at least 4. `faithful`: follow the program in
    the appendix, else the corrections: see the module. `cap`: distance of the closing points from
    the end rows in the contours' unit, if `faithful`. Raises ValueError if the contours, the
    exponents or the layer cannot be used.
    """
    stack = stack_contours(contours)
    if len(layer) != 2 or min(layer) < MIN_SIDE:
        raise ValueError(
            f"layer must be two numbers of points, at least {MIN_SIDE} each, got {layer}"
        )
    chosen = finite_array("exponents", exponents, (2,))
    model = Superquadric(np.ones(3), chosen)
    layers, one_to_one, flat, meeting = (_by_number if faithful else _by_azimuth)(stack, layer)
    control = np.empty((*layer, len(stack.heights), 3))
    control[..., :2] = np.stack([part.control for part in layers], axis=2)
    control[..., 2] = stack.heights
    undeformed = _undeformed(control.shape[:3])
    parameters = _model_parameters(model, undeformed, stack.points.shape[:2], faithful)
    # Parameters are the same in the contours' box as in the cube.
    deformed, before = (
        splines.SplineVolume(stack.box.points(0.5 * (places + 1.0)), undeformed.bases)
        for places in (control, undeformed.control)
    )
    return ThesisSolid(
        lattice=splines.Lattice(deformed, before),
        parameters=parameters,
        triples=(
            interpolated_parameters(parameters) if faithful else ModelTriples(model, undeformed)
        ),
        cap=cap if faithful else None,
        order=stack.order,
        health=ThesisHealth(one_to_one, flat, meeting, *_cores(layers)),
    )


def _model_parameters(
    model: Superquadric, undeformed: splines.SplineVolume, shape: tuple[int, ...], faithful: bool
) -> Floats:
    """Parameters (m, n + 1, 3) of the model's points that belong to (m, n) contour points."""
    steps, azimuths = np.linspace(-1.0, 1.0, shape[0]), np.append(ray_azimuths(shape[1]), np.pi)
    if not faithful:
        return triples_of(undeformed, level_points(model, steps, azimuths))
    points = latitude_points(model, np.arctan(steps), azimuths)
    return triples_of(undeformed, points, invert_thesis)


def stack_contours(
    contours: Sequence[ArrayLike] | Floats, max_seam_gap: float = 1e-12
) -> ContourStack:
    """Sort contours by height and scale them to the cube from -1 to 1.

    At least 2 level contours with as many points each, 4 or more; the first point is repeated at
    the end of all or of none, to `max_seam_gap` of the largest extent. A contour's height is the
    mean of its points'. Raises ValueError if there are too few contours or points, some are not
    finite, or the contours have no extent along x, y or z.
    """
    arrays = [np.asarray(contour, dtype=np.float64) for contour in contours]
    if len(arrays) < 2:
        raise ValueError(f"contours must be at least 2, got {len(arrays)}")
    counts = sorted({len(contour) if contour.ndim else 0 for contour in arrays})
    if len(counts) > 1:
        raise ValueError(f"contours must have as many points each, got {counts[0]} to {counts[-1]}")
    points = finite_array("contours", np.stack(arrays), (None, None, 3))
    heights = points[:, :, 2].mean(axis=1)
    low = np.append(points[:, :, :2].min(axis=(0, 1)), heights.min())
    extent = np.append(points[:, :, :2].max(axis=(0, 1)), heights.max()) - low
    if not (extent > 0.0).all():
        raise ValueError(f"contours must extend along x, y and z, got {extent.tolist()} m")
    gaps = np.abs(points[:, -1, :2] - points[:, 0, :2]).max(axis=1)
    if (gaps <= max_seam_gap * extent.max()).all():
        points = points[:, :-1]
    if points.shape[1] < MIN_CONTOUR_POINTS:
        raise ValueError(
            f"contours must have at least {MIN_CONTOUR_POINTS} different points, "
            f"got {points.shape[1]}"
        )
    order = np.argsort(heights, kind="stable").astype(np.int32)
    return ContourStack(
        points=2.0 * (points[order, :, :2] - low[:2]) / extent[:2] - 1.0,
        heights=2.0 * (heights[order] - low[2]) / extent[2] - 1.0,
        box=splines.upright_parallelepiped(low, extent),
        order=order,
    )


def _by_number(
    stack: ContourStack, sides: tuple[int, int]
) -> tuple[list[ThesisLayer], Bools, Bools, Bools]:
    flat = np.ptp(stack.points, axis=1).max(axis=1) == 0.0
    meeting = np.array([geometry.self_intersects(points) for points in stack.points]) & ~flat
    layers = [make_program_layer(points, sides) for points in stack.points]
    return layers, np.ones(len(flat), bool), flat, meeting


def _by_azimuth(
    stack: ContourStack, sides: tuple[int, int]
) -> tuple[list[ThesisLayer], Bools, Bools, Bools]:
    azimuths = ray_azimuths(stack.points.shape[1])
    matches = [match_contour(points, azimuths) for points in stack.points]
    one_to_one, degenerate, meeting = np.array([match[2:] for match in matches]).T
    return [make_layer(match.points, sides) for match in matches], one_to_one, degenerate, meeting


def ray_azimuths(count: int) -> Floats:
    """Azimuths (count,) of `count` rays, evenly from -pi on [rad]."""
    return np.pi * (2.0 * np.arange(count) / count - 1.0)


def match_contour(points: Floats, azimuths: Floats, n_chords: int = 8) -> ContourMatch:
    """Where rays from the middle of a contour meet the closed curve through its points (n, 2).

    The middle is that of the area; the mean of the points, as printed, lies where they are dense.
    Where a ray meets the curve more than once, the azimuth is made monotone, or replaced by the
    length. `n_chords`: of the curve, for each point.
    """
    curve = splines.fit_closed_curve(points)
    count = n_chords * len(points)
    polygon = curve.at(np.arange(count) / count)
    middle = geometry.area_centroid(polygon)
    match = geometry.azimuth_match(polygon, middle, azimuths)
    flags = curve.flags
    return ContourMatch(
        match.points, middle, match.one_to_one, flags.degenerate, flags.self_intersecting
    )


def _undeformed(counts: tuple[int, ...]) -> splines.SplineVolume:
    s, t, u = (splines.clamped_basis(count, min(splines.CUBIC, count - 1)) for count in counts)
    cube = splines.upright_parallelepiped(np.full(3, -1.0), np.full(3, 2.0))
    return splines.SplineVolume(cube.even_control((s.count, t.count, u.count)), (s, t, u))


def level_points(model: Superquadric, heights: Floats, azimuths: Floats) -> Floats:
    """Points (a, b, 3) of a model of semi-axes 1, at heights (a,) and azimuths (b,) [rad]."""
    around = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(len(azimuths))])
    outline = around[:, :2] / model.gauge(around)[:, None]
    power = 2.0 / float(model.exponents[0])
    width = (1.0 - np.minimum(np.abs(heights), 1.0) ** power) ** (1.0 / power)
    points = np.empty((len(heights), len(azimuths), 3))
    points[:, :, :2] = width[:, None, None] * outline
    points[:, :, 2] = heights[:, None]
    return points


def _cores(layers: list[ThesisLayer]) -> tuple[Floats, Bools, Ints, Floats]:
    outside = []
    for layer in layers:
        cells = rim_cells((layer.control.shape[0], layer.control.shape[1]))
        rim, core = layer.control[cells[:, 0], cells[:, 1]], layer.control[1:-1, 1:-1]
        outside.append(int((geometry.winding_number(rim, core.reshape(-1, 2)) == 0).sum()))
    return (
        np.array([layer.core_scale for layer in layers]),
        np.array([layer.moved for layer in layers]),
        np.array(outside, np.int32),
        np.array([layer.gap for layer in layers]),
    )


class ContourMatch(NamedTuple):
    """The points of a contour at some azimuths."""

    points: Floats  # (k, 2)
    middle: Floats  # (2,): origin of the rays
    one_to_one: bool  # whether each ray meets the contour once
    degenerate: bool  # whether the contour encloses no area
    self_intersecting: bool  # whether the curve meets itself


class ContourStack(NamedTuple):
    """Level contours from the bottom to the top, normalised."""

    points: Floats  # (m, n, 2), each point once; from -1 to 1
    heights: Floats  # (m,), from -1 to 1, not falling
    box: splines.Parallelepiped  # around the contours [m], scaled to the cube from -1 to 1
    order: Ints  # (m,): number of each among the unsorted contours


class ThesisHealth(NamedTuple):
    """Quality of a solid; one entry for each contour, upwards."""

    one_to_one: Bools  # (m,): whether each ray met the contour once; true if matched by number
    degenerate: Bools  # (m,): whether it encloses no area; if matched by number: is a point
    self_intersecting: Bools  # (m,): whether the contour meets itself
    core_scales: Floats  # (m,): sides of the layer's core over those of the box around its shell
    cores_moved: Bools  # (m,): whether the core is off the middle of that box
    cores_outside: Ints  # (m,): control points of the core that lie outside their shell
    gaps: Floats  # (m,): of the shell's curve, over its mean width


@readable
@dataclass(frozen=True, slots=True, eq=False)
class ThesisSolid:
    """A superquadric's surface, deformed by a control lattice.

    Its parameters are eta, from 0 at the bottom to 1 at the top, and nu, from 0 to 1 around.
    """

    lattice: splines.Lattice  # over the contours' box [m], one layer for each contour
    # s, t, u (m, n, 3) of the model's points that belong to the contours' points: upwards, then
    # around from azimuth -pi, the first repeated at the end.
    parameters: Floats
    triples: ModelTriples | TripleSpline  # parameters of the whole surface
    # [m] from the first and last row to the closing points; None if the surface ends in poles.
    cap: float | None
    order: Ints  # (m,): number of each layer's contour among the unsorted ones
    health: ThesisHealth

    @property
    def figures(self) -> dict[str, float]:
        """Counts of imperfect contours and cores, and the widest gap of a shell's curve."""
        fit = self.health
        return {
            "unmatched_contours": float((~fit.one_to_one).sum()),
            "degenerate_contours": float(fit.degenerate.sum()),
            "cores_moved": float(fit.cores_moved.sum()),
            "core_points_outside": float(fit.cores_outside.sum()),
            "widest_gap": float(fit.gaps.max()),
        }

    def surface(self, eta: Floats, nu: Floats) -> Floats:
        """Points of the surface on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3) [m].

        Raises ValueError if a number is not finite or outside 0 to 1.
        """
        eta, nu = (_unit(name, places) for name, places in (("eta", eta), ("nu", nu)))
        triples = self.triples.at(eta, nu)
        return self.lattice.volume.at(triples.reshape(-1, 3)).reshape(triples.shape)

    def mesh(self, rows: int, columns: int) -> Mesh:
        """Closed mesh of `rows` by `columns` points, with a point at either end.

        Raises ValueError if there are fewer than 2 rows or 3 columns. The triangles are reversed
        if the lattice mirrors. Where it folds, the mesh may meet itself.
        """
        if rows < MIN_ROWS or columns < MIN_COLUMNS:
            raise ValueError(
                f"a mesh must have at least {MIN_ROWS} rows and {MIN_COLUMNS} columns, "
                f"got {rows} and {columns}"
            )
        nu = np.arange(columns) / columns
        if self.cap is None:
            surface = self.surface(np.linspace(0.0, 1.0, rows + 2), nu)
            bottom, rings, top = surface[0, 0], surface[1:-1], surface[-1, 0]
        else:
            rings = self.surface(np.linspace(0.0, 1.0, rows), nu)
            cap = np.array([0.0, 0.0, self.cap])
            bottom, top = rings[0].mean(axis=0) - cap, rings[-1].mean(axis=0) + cap
        vertices, faces = geometry.close_rings(bottom, rings, top)
        if geometry.solidity(vertices, faces).volume < 0.0:
            faces = faces[:, ::-1]
        return Mesh(vertices, faces)


def _unit(name: str, places: Floats) -> Floats:
    checked = finite_array(name, places, (None,))
    if len(checked) and not 0.0 <= checked.min() <= checked.max() <= 1.0:
        raise ValueError(
            f"{name} must lie between 0 and 1, got {checked.min():g} to {checked.max():g}"
        )
    return checked


@dataclass(frozen=True, slots=True, eq=False)
class ModelTriples:
    """Parameters of the model's surface, by inversion of the model's points.

    Eta is 0 at the lower pole and 1 at the upper one; nu is 0 at azimuth -pi and 1 after a turn.
    """

    model: Superquadric  # with semi-axes of 1
    volume: splines.SplineVolume  # the undeformed lattice over the cube from -1 to 1

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3)."""
        points = latitude_points(self.model, np.pi * (eta - 0.5), np.pi * (2.0 * nu - 1.0))
        return triples_of(self.volume, points)


def latitude_points(model: Superquadric, latitudes: Floats, azimuths: Floats) -> Floats:
    """Points (a, b, 3) of a model at latitudes (a,) and azimuths (b,) [rad]: (2.4), (2.5)."""
    eta, omega = np.repeat(latitudes, len(azimuths)), np.tile(azimuths, len(latitudes))
    return regular_points(model, eta, omega).points.reshape(len(latitudes), len(azimuths), 3)


def triples_of(
    volume: splines.SplineVolume,
    points: Floats,
    invert: Callable[[splines.SplineVolume, Floats], splines.Inversion] = splines.invert_points,
) -> Floats:
    """Parameters (a, b, 3) of a grid of points (a, b, 3) in the undeformed lattice."""
    return invert(volume, points.reshape(-1, 3)).parameters.reshape(points.shape)


@dataclass(frozen=True, slots=True, eq=False)
class TripleSpline:
    """A surface in the space of the parameters s, t, u: (4.17)."""

    bases: tuple[splines.Basis, splines.Basis]  # along eta and nu, both over [0, 1]
    control: Floats  # (m, n, 3)
    sites: tuple[Floats, Floats]  # eta (m,) and nu (n,) of the interpolated triples
    condition: float  # condition number of the interpolation

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3).

        Clipped to 0 and 1, which the spline overshoots where the model has edges. Raises ValueError
        if a number is not finite, or outside 0 to 1 by more than rounding.
        """
        return np.clip(splines.evaluate_grid(self.bases, self.control, (eta, nu)), 0.0, 1.0)


def interpolated_parameters(parameters: Floats) -> TripleSpline:
    """The spline surface through a grid of parameter triples: (4.17) to (4.21).

    `parameters` (m, n, 3): upwards and around, the first repeated at the end. Cubic, of a lower
    degree if there are fewer than 4 rows. Sites by square roots of the chords (4.18), averaged over
    all rows that have a length; knots by (4.19), from its first site. The seam is not smooth.
    Raises ValueError if there are fewer than 2 rows or 4 columns, or neighbouring rows or columns
    are equal.
    """
    parameters = finite_array("parameters", parameters, (None, None, 3))
    rows, columns = parameters.shape[:2]
    if rows < 2 or columns <= splines.CUBIC:
        raise ValueError(
            f"parameters must have at least 2 rows and {splines.CUBIC + 1} columns, "
            f"got {rows}, {columns}"
        )
    sites = _sites("rows", parameters), _sites("columns", parameters.transpose(1, 0, 2))
    along, around = (min(splines.CUBIC, len(places) - 1) for places in sites)
    bases = (
        splines.Basis(splines.averaged_knots(sites[0], along), along),
        splines.Basis(splines.averaged_knots(sites[1], around), around),
    )
    fit = splines.interpolate_grid(bases, sites, parameters)
    return TripleSpline(bases, fit.control, sites, fit.condition)


def _sites(name: str, parameters: Floats) -> Floats:
    """Centripetal parameters (m,) of a grid (m, n, 3) along its first axis, the mean of all."""
    chords = np.sqrt(np.linalg.norm(np.diff(parameters, axis=0), axis=2))
    lengths = np.vstack([np.zeros(chords.shape[1]), np.cumsum(chords, axis=0)])
    lengths = lengths[:, lengths[-1] > 0.0]
    sites = (lengths / lengths[-1]).mean(axis=1) if lengths.size else np.zeros(len(lengths))
    if not (np.diff(sites) > 0.0).all():
        raise ValueError(f"parameters must differ between neighbouring {name}")
    sites[-1] = 1.0
    return sites
