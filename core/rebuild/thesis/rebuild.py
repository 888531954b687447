"""From contours to a solid as Fung, 1999, chapter 4 and appendix, does it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, finite_array
from palpate.core.plane.crossings import crosses_itself
from palpate.core.plane.winding import winding_number
from palpate.core.rebuild.thesis.contours import Stack, stack_contours
from palpate.core.rebuild.thesis.layer import Layer, make_layer, rim_cells
from palpate.core.rebuild.thesis.match import match_contour, ray_azimuths
from palpate.core.rebuild.thesis.model import (
    ModelTriples,
    latitude_points,
    level_points,
    triples_of,
)
from palpate.core.rebuild.thesis.program_layer import make_program_layer
from palpate.core.rebuild.thesis.solid import ThesisHealth, ThesisSolid
from palpate.core.rebuild.thesis.triples import interpolated_parameters
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.frame import upright_frame
from palpate.core.splines.knots import CUBIC
from palpate.core.splines.lattice import Lattice
from palpate.core.splines.volume import Volume

EXPONENTS = (0.15, 0.15)
"""Of the model: the program's, whatever the object. Its surface keeps close to the lattice's
faces, where the shell is; a rounder one would be drawn inwards."""
LEAST_SIDE = CUBIC + 1
PROGRAM_CAP = 0.01
"""Beyond the end rows, in whatever unit the contours are."""


class _Matched(NamedTuple):
    """Layers, and how their contours were matched."""

    layers: list[Layer]
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
        parameters = triples_of(undeformed, points, "thesis")
    else:
        parameters = triples_of(undeformed, level_points(model, steps, azimuths), "auto")
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


def _checked_sides(layer: tuple[int, int]) -> tuple[int, int]:
    if len(layer) != 2 or min(layer) < LEAST_SIDE:
        raise ValueError(
            f"layer must be two numbers of points, at least {LEAST_SIDE} each, got {layer}"
        )
    return layer


def _by_azimuth(stack: Stack, sides: tuple[int, int]) -> _Matched:
    azimuths = ray_azimuths(stack.points.shape[1])
    matches = [match_contour(points, azimuths) for points in stack.points]
    return _Matched(
        [make_layer(match.points, sides) for match in matches],
        np.array([match.one_to_one for match in matches]),
        np.array([match.degenerate for match in matches]),
        np.array([match.self_intersecting for match in matches]),
    )


def _by_number(stack: Stack, sides: tuple[int, int]) -> _Matched:
    flat = np.ptp(stack.points, axis=1).max(axis=1) == 0.0
    return _Matched(
        [make_program_layer(points, sides) for points in stack.points],
        np.ones(len(flat), bool),
        flat,
        np.array([crosses_itself(points) for points in stack.points]) & ~flat,
    )


def _undeformed(counts: tuple[int, ...]) -> Volume:
    """The lattice over the cube from -1 to 1, with control points at even steps: (2.19)."""
    s, t, u = (clamped_basis(count, min(CUBIC, count - 1)) for count in counts)
    cube = upright_frame(np.full(3, -1.0), np.full(3, 2.0))
    return Volume(cube.even_control((s.count, t.count, u.count)), (s, t, u))


def _lattice(control: Floats, undeformed: Volume, stack: Stack) -> Lattice:
    """The lattice over the contours' box: parameters are the same in it as in the cube."""
    deformed, before = (
        Volume(stack.box.points(0.5 * (places + 1.0)), undeformed.bases)
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
