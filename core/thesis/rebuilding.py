"""From contours to a solid as Fung, 1999, chapter 4 and appendix, does it.

Contours are put into the cube from -1 to 1 (4.2, steps 1 to 3), and their points matched with the
model's azimuths (step 5). The solid is a deformed lattice with a superquadric's surface in it,
whose s, t, u are had by inverting its points, or, as in 4.3, by a spline through known ones.
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

# Of the model: the program's, whatever the object. Its surface keeps close to the lattice's faces,
# where the shell is; a rounder one would be drawn inwards.
EXPONENTS = (0.15, 0.15)
LEAST_SIDE = splines.CUBIC + 1
PROGRAM_CAP = 0.01  # Beyond the end rows, in whatever unit the contours are
FINE = 8  # Chords for each point of a contour, by which rays meet the curve through them
LEAST_POINTS = 4  # Different points of a contour, the fewest of which a curve is fitted
SAME = 1e-12  # Of the size: a last point nearer to the first one is the first one again
LEAST_ROWS, LEAST_COLUMNS = 2, 3


def rebuild_thesis(
    contours: Sequence[ArrayLike] | Floats,
    *,
    exponents: tuple[float, float] | None = None,
    layer: tuple[int, int] = (5, 5),
    faithful: bool = False,
) -> ThesisSolid:
    """The solid of the thesis's shell and core.

    `contours` (m, n, 3): at least 2 level contours with as many points each, m: see
    `stack_contours`. `exponents`: e1 and e2 of the original model, from 0.02 to 2; 0.15 both if
    left out. `layer`: control points of a layer along s and t, at least 4. `faithful`: as the
    program in the appendix has it, in place of what is right: see below. Raises ValueError if
    the contours, the exponents or the layer cannot be used. The program's ways that ``faithful``
    keeps, in the normalised cube of 4.2:

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

    Corrected are: the middle (of the area) and the match; level rows up to the poles, which close
    the solid; the inversion axis by axis; periodic polygons, a lattice that does not mirror, a core
    inside its shell; and the parameters, which are the model's own. What stays is the heuristic
    itself: contours are taken for control layers, which a spline does not pass, and the closed
    polygon is read with four clamped sides.
    """
    stack = stack_contours(contours)
    if len(layer) != 2 or min(layer) < LEAST_SIDE:
        raise ValueError(
            f"layer must be two numbers of points, at least {LEAST_SIDE} each, got {layer}"
        )
    chosen = finite_array("exponents", EXPONENTS if exponents is None else exponents, (2,))
    model = Superquadric(np.ones(3), chosen)
    count = stack.points.shape[1]
    layers, one_to_one, flat, meeting = (_by_number if faithful else _by_azimuth)(stack, layer)
    control = np.empty((*layer, len(stack.heights), 3))
    control[..., :2] = np.stack([one.control for one in layers], axis=2)
    control[..., 2] = stack.heights
    undeformed = _undeformed(control.shape[:3])
    azimuths = np.append(ray_azimuths(count), np.pi)
    steps = np.linspace(-1.0, 1.0, len(stack.heights))
    if faithful:
        points = latitude_points(model, np.arctan(steps), azimuths)
        parameters = triples_of(undeformed, points, invert_thesis)
    else:
        parameters = triples_of(undeformed, level_points(model, steps, azimuths))
    # Over the contours' box: parameters are the same in it as in the cube.
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
        cap=PROGRAM_CAP if faithful else None,
        order=stack.order,
        health=ThesisHealth(one_to_one, flat, meeting, *_cores(layers)),
    )


def stack_contours(contours: Sequence[ArrayLike] | Floats) -> ContourStack:
    """Sort contours by height and put them into the cube from -1 to 1.

    At least 2 level ones with as many points each, 4 or more, the first again at the end of all or
    of none. A height is the mean of its points'. Raises ValueError if there are too few contours or
    points, some are not finite, or the contours have no extent along x, y or z.
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
    """Azimuths (count,) of so many rays: even ones from -pi on, rad."""
    return np.pi * (2.0 * np.arange(count) / count - 1.0)


def match_contour(points: Floats, azimuths: Floats) -> ContourMatch:
    """Where rays from the middle of a contour meet the closed curve through its points (n, 2).

    The middle is that of the area: the mean of the points, as printed, lies where they are dense.
    Where a ray meets the curve not just once, the azimuth is made monotone, or is the length.
    """
    curve = splines.fit_closed_curve(points)
    count = FINE * len(points)
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
    """Points (a, b, 3) of a model of semi-axes 1, at heights (a,) and azimuths (b,), rad."""
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
        np.array([one.core_scale for one in layers]),
        np.array([one.moved for one in layers]),
        np.array(outside, np.int32),
        np.array([one.gap for one in layers]),
    )


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
    box: splines.Parallelepiped  # Around the contours, m: the cube from -1 to 1 stands for it
    order: Ints  # (m,): which of the given contours each is


class ThesisHealth(NamedTuple):
    """What should be known of a solid before it is used; one entry for each contour, upwards."""

    one_to_one: Bools  # (m,): each ray from the contour's middle met it once; true by number
    degenerate: Bools  # (m,): the contour encloses nothing; matched by number: it is a point
    self_intersecting: Bools  # (m,): the contour meets itself
    core_scales: Floats  # (m,): sides of the layer's core over those of the box around its shell
    cores_moved: Bools  # (m,): the core is not in the middle of that box
    cores_outside: Ints  # (m,): control points of the core that lie outside their shell
    gaps: Floats  # (m,): how far open the curve is that gave the shell, over its mean width


@readable
@dataclass(frozen=True, slots=True, eq=False)
class ThesisSolid:
    """A superquadric's surface, deformed by a control lattice.

    Given over eta, from 0 at the bottom to 1 at the top, and nu, from 0 to 1 once around.
    """

    lattice: splines.Lattice  # Over the contours' box, m; a layer of control points a contour
    # s, t, u (m, n, 3) of the model's points that were matched with the contours': upwards, then
    # around from azimuth -pi, the first again at the end.
    parameters: Floats
    triples: ModelTriples | TripleSpline  # Parameters of the whole surface
    # How far beyond its first and last row the surface is closed by a point, m; None if it ends in
    # points of its own.
    cap: float | None
    order: Ints  # (m,): which of the given contours each layer is
    health: ThesisHealth

    @property
    def figures(self) -> dict[str, float]:
        """How good its fit is: contours and core points, and the widest gap between layers [m]."""
        fit = self.health
        return {
            "unmatched_contours": float((~fit.one_to_one).sum()),
            "degenerate_contours": float(fit.degenerate.sum()),
            "cores_moved": float(fit.cores_moved.sum()),
            "core_points_outside": float(fit.cores_outside.sum()),
            "widest_gap": float(fit.gaps.max()),
        }

    def surface(self, eta: Floats, nu: Floats) -> Floats:
        """Points of the surface on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3), m.

        Raises ValueError if a number is not finite or outside 0 to 1.
        """
        eta, nu = (_unit(name, places) for name, places in (("eta", eta), ("nu", nu)))
        triples = self.triples.at(eta, nu)
        return self.lattice.volume.at(triples.reshape(-1, 3)).reshape(triples.shape)

    def mesh(self, rows: int, columns: int) -> Mesh:
        """Closed mesh of so many rows and columns of points, with a point at either end.

        Raises ValueError if there are not at least 2 rows and 3 columns. The triangles are turned
        round where the lattice mirrors. Where it folds, the mesh may meet itself.
        """
        if rows < LEAST_ROWS or columns < LEAST_COLUMNS:
            raise ValueError(
                f"a mesh must have at least {LEAST_ROWS} rows and {LEAST_COLUMNS} columns, "
                f"got {rows} and {columns}"
            )
        nu = np.arange(columns) / columns
        if self.cap is None:
            surface = self.surface(np.linspace(0.0, 1.0, rows + 2), nu)
            bottom, rings, top = surface[0, 0], surface[1:-1], surface[-1, 0]
        else:
            rings = self.surface(np.linspace(0.0, 1.0, rows), nu)
            beyond = np.array([0.0, 0.0, self.cap])
            bottom, top = rings[0].mean(axis=0) - beyond, rings[-1].mean(axis=0) + beyond
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
    """Parameters of the model's surface, each by inverting the model's own point.

    Eta goes from 0 at the lower pole to 1 at the upper one, nu once around from azimuth -pi.
    """

    model: Superquadric  # With semi-axes of 1
    volume: splines.SplineVolume  # The undeformed lattice over the cube from -1 to 1

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3)."""
        points = latitude_points(self.model, np.pi * (eta - 0.5), np.pi * (2.0 * nu - 1.0))
        return triples_of(self.volume, points)


def latitude_points(model: Superquadric, latitudes: Floats, azimuths: Floats) -> Floats:
    """Points (a, b, 3) of a model at latitudes (a,) and azimuths (b,), rad: (2.4), (2.5)."""
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

    bases: tuple[splines.Basis, splines.Basis]  # Along eta and nu, both over [0, 1]
    control: Floats  # (m, n, 3)
    sites: tuple[Floats, Floats]  # eta (m,) and nu (n,) of the triples that it passes
    condition: float  # Condition number of the interpolation

    def at(self, eta: Floats, nu: Floats) -> Floats:
        """Parameters s, t, u on a grid (a,), (b,) of numbers from 0 to 1: (a, b, 3).

        Clipped to 0 and 1, which the spline overshoots where the model has edges. Raises ValueError
        if a number is not finite, or outside 0 to 1 by more than rounding.
        """
        return np.clip(splines.evaluate_grid(self.bases, self.control, (eta, nu)), 0.0, 1.0)


def interpolated_parameters(parameters: Floats) -> TripleSpline:
    """The spline surface through a grid of parameter triples: (4.17) to (4.21).

    `parameters` (m, n, 3): upwards and around, the first again at the end; ValueError if there are
    not 2 rows and 4 columns, or neighbours are the same throughout. Cubic, of a lower degree where
    there are fewer than 4 rows. Sites by square roots of the chords (4.18), averaged over all rows
    that have a length; knots by (4.19), from its first site. The seam is passed, not smoothly.
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
    found = splines.interpolate_grid(bases, sites, parameters)
    return TripleSpline(bases, found.control, sites, found.condition)


def _sites(name: str, parameters: Floats) -> Floats:
    """Centripetal parameters (m,) of a grid (m, n, 3) along its first axis, the mean of all."""
    chords = np.sqrt(np.linalg.norm(np.diff(parameters, axis=0), axis=2))
    ways = np.vstack([np.zeros(chords.shape[1]), np.cumsum(chords, axis=0)])
    long = ways[-1] > 0.0
    sites = (ways[:, long] / ways[-1, long]).mean(axis=1) if long.any() else np.zeros(len(ways))
    if not (np.diff(sites) > 0.0).all():
        raise ValueError(f"parameters must differ between neighbouring {name}")
    sites[-1] = 1.0
    return sites
