"""Refusals of bad numbers, shapes and trees: one sentence that names what is wrong, and where."""

from math import inf, nan
from typing import Any

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.shapes import (
    Bend,
    BooleanShape,
    DeformedSuperquadric,
    Dent,
    GeneralisedCylinder,
    HalfSpace,
    Hyperquadric,
    Intersection,
    SplineSection,
    SuperellipseSection,
    Superquadric,
    Union,
    regular_points,
    superquadric_volume,
)
from palpate.core.shapes.boolean_solids import complement, conjunction, disjunction
from tests.core.shapes.definitions import AXES, DOWN, FORMS, ball

ONE, THREE, STRAIGHT = np.ones(2), np.ones(3), np.zeros(2)
UNIT = Superquadric(THREE, ONE)
BALL, FAR, LARGE = (case.solid for case in (ball(), ball(0.2), ball(radius=0.04)))
UPPER, LOWER, ABOVE = HalfSpace(DOWN, 0.0), HalfSpace(DOWN, -1.0), HalfSpace(-DOWN, -1.0)
TWELVE = np.concatenate([AXES, AXES + [0, 0, 0, 1.5]])
# Six planes through nearly one point, whose powers leave a speck about it.
NORMALS = np.concatenate([np.eye(3), np.eye(3) + 0.5]) / 0.04
SPECK = np.column_stack([NORMALS, [0, 0, 0, 1e-7, 0, 0]])
PIERCED = ball().solid
PIERCED.mesh = lambda level: shapes.Mesh(BALL.mesh(level).vertices, BALL.mesh(level).faces[1:])


def bent(taper: Any, curvature: float) -> DeformedSuperquadric:
    base = Superquadric(np.array([0.03, 0.02, 0.05]), ONE)
    return DeformedSuperquadric(base, np.array(taper), Bend(curvature))


def cylinder(**words: Any) -> GeneralisedCylinder:
    made = {"heights": [0.0, 0.05, 0.1], "scales": [1.0, 1.0, 1.0], **words}
    section = SuperellipseSection(0.03 * ONE, 1.0)
    return GeneralisedCylinder(section, np.array(made.pop("heights"), float), **made)


@pytest.mark.parametrize(("make", "sentence"), [
    (lambda: Superquadric([0.0, 1, 1], ONE), r"size must be positive, got \[0.0, 1.0, 1.0\] m"),
    (lambda: Superquadric(ONE, ONE), r"size must have shape \(3\), got \(2,\)"),
    (lambda: Superquadric([1, 1, nan], ONE), "size must be finite"),
    (lambda: Superquadric(THREE, [0.019, 1]), r"must lie between 0.02 and 2.0, got \[0.019"),
    (lambda: Superquadric(THREE, [1.0]), r"exponents must have shape \(2\)"),
    (lambda: UNIT.mesh(-1), "level must be between 0 and 8, got -1"),
    (lambda: shapes.inside_outside([THREE], [0.0, 1]), r"must be above 0 and up to 2, got \["),
    (lambda: shapes.inside_outside([THREE], [1.0, 2.1]), "exponents must be above 0 and up to 2"),
    (lambda: shapes.inside_outside([THREE], [1.0]), r"exponents must have shape \(2\)"),
    (lambda: shapes.inside_outside([[0, nan, 1]], ONE), "scaled must be finite"),
    (lambda: shapes.inside_outside(THREE, ONE), r"scaled must have shape \(any, 3\)"),
    (lambda: regular_points(UNIT, [0, 0], [0, 0, 0]), r"omega must have shape \(2\), got \(3,"),
    (lambda: shapes.trigonometric_points(UNIT, [inf], [0]), "eta must be finite"),
    (lambda: superquadric_volume([0.0, 1, 1], ONE), r"positive, got \[0.0, 1.0, 1.0\] m"),
    (lambda: superquadric_volume(THREE, [0, 1]), r"exponents must be positive, got \[0.0, 1.0"),
    (lambda: shapes.superquadric_moments(UNIT, [1, 0]), "taper must lie between -1 and 1"),
    (lambda: shapes.sampled_surface(UNIT, STRAIGHT, Bend(1.5)), "all that is bent must be nearer"),
    (lambda: shapes.Taper(1.0, 0.0, 1.0), r"taper must lie between -1 and 1, got \[1.0, 0.0\]"),
    (lambda: Bend(nan), "finite curvature and direction, got nan 1/m and 0.0 rad"),
    (lambda: Bend(1.0, inf), "finite curvature and direction, got 1.0 1/m and inf rad"),
    (lambda: Bend(0.5)(np.array([[2.5, 0, 0]])), "centre 2 m from the axis: .* got 2.5 m"),
    (lambda: Bend(-0.5)(np.array([[-2.0, 0, 0]])), "a bend of -0.5 1/m has .* got 2 m"),
    (lambda: Bend(-0.5)(np.array([[0, 0, -6.3]])), "circle 6.28 m above and .* got 6.3 m"),
    (lambda: bent([1, 0], 0.0), "taper must lie between -1 and 1"),
    (lambda: bent([0, 0], 32.7), "between -32.67 and 32.67 1/m, or this solid folds, got 32.7"),
    (lambda: Hyperquadric(AXES[:2], ONE), "must face in three independent directions"),
    (lambda: Hyperquadric(AXES[[0, 0, 1]], THREE), "or the solid is unbounded"),
    (lambda: Hyperquadric(TWELVE, [2] * 6), "nowhere below 1, the least that was found is 3.37"),
    (lambda: Hyperquadric(np.tile(AXES, (9, 1)), [2] * 27), "planes must be at most 24, got 27"),
    (lambda: Hyperquadric(AXES, [2, 2, 0]), "exponents must lie between 0.1 and 100"),
    (lambda: Hyperquadric(AXES[:, :3], THREE), r"planes must have shape \(any, 4\)"),
    (lambda: Hyperquadric(SPECK, np.full(6, 0.15)), "so little inside that a grid of 16 cells"),
    (lambda: Dent(nan, FORMS[:2], ONE), "depth must be finite, got nan"),
    (lambda: Dent(1.0, np.zeros((0, 4)), []), "planes must be at least one, got none"),
    (lambda: Dent(1.0, FORMS[:2], [2]), r"exponents must have shape \(2\)"),
    (lambda: Dent(1.0, FORMS[:2], [2, 0.05]), "exponents must lie between 0.1 and 100"),
    (lambda: Dent(1.0, np.full((2, 4), inf), ONE), "planes must be finite"),
    (lambda: Dent(1.0, FORMS[:2] * [[1], [0]], ONE), r"planes\[1\] must .* long, got 0"),
    (lambda: Dent(1.0, FORMS[:2] * [[1e-300], [1]], ONE), r"planes\[0\] must face somewhere"),
    (lambda: HalfSpace(np.zeros(3), 0.0), "normal must have a length"),
    (lambda: HalfSpace(ONE, 0.0), r"normal must have shape \(3\)"),
    (lambda: HalfSpace(np.array([0, 0, nan]), 0.0), "normal must be finite"),
    (lambda: HalfSpace(THREE, inf), "offset must be finite"),
    (lambda: cylinder(heights=[0.0]), r"scales must have shape \(1\)"),
    (lambda: cylinder(heights=[0.0], scales=[1.0]), "heights must be 2 to 64, got 1"),
    (lambda: cylinder(heights=[0.0, 0.1, 0.1]), "heights must increase"),
    (lambda: cylinder(scales=[1, 0, 1]), "scales must be positive, but for 0 at an end"),
    (lambda: cylinder(scales=[1, 0.01, 1e-3], smooth=True), "curve through them down to -.* m"),
    (lambda: cylinder(tilt=1.4), "tilt must be at most 75 degrees, got 80.2"),
    (lambda: cylinder(tilt_direction=inf), "tilt_direction must be finite"),
    (lambda: SplineSection([0.03] * 2), "radii must be 3 to 64, got 2"),
    (lambda: SplineSection([1e-320] * 3), "radii must be positive, 1e-09 m or more"),
    (lambda: SplineSection([0.03, inf, 0.03]), "radii must be finite"),
    (lambda: SplineSection([1, 1, 1e-3, 1e-3, 1e-3, 1]), "curve through them reaches the axis"),
    (lambda: SuperellipseSection([0.03, 1e-320], 1.0), "size must be positive, 1e-09 m or more"),
    (lambda: SuperellipseSection([0.03], 1.0), r"size must have shape \(2\)"),
    (lambda: SuperellipseSection(ONE, 2.5), "exponent must lie between 0.02 and 2.0, got 2.5"),
    (lambda: Union((BALL,)), "union must have at least 2 parts, got 1"),
    (lambda: Intersection(()), "intersection must have at least 2 parts, got 0"),
    (lambda: shapes.difference(BALL), "difference must have at least 2 parts, got 1"),
    (lambda: conjunction(1.0, 1.0, -1.0), "omega must be above -1 and at most 1, got -1.0"),
    (lambda: disjunction(1.0, 1.0, 1.0 + 1e-12), "omega must be above -1 and at most 1, got 1"),
    (lambda: conjunction(1.0, 1.0, nan), "omega must be above -1 and at most 1, got nan"),
    (lambda: disjunction(1.0, 1.0, smoothness=-1), "smoothness must be 0 or more, got -1"),
    (lambda: disjunction(1.0, [1.0, nan]), "f2 must be finite"),
    (lambda: complement(inf), "f must be finite"),
])  # fmt: skip
def test_bad_numbers_are_refused(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()


NOT_BALL = shapes.complement_of(BALL)
DEEP = BALL
for _ in range(2000):
    DEEP = Union((DEEP, DEEP))


@pytest.mark.parametrize(("tree", "sentence"), [
    (NOT_BALL, "the complement that is the tree is unbounded"),
    (UPPER, "the half-space that is the tree is unbounded"),
    (Union((BALL, UPPER)), r"the half-space that is union\[1\] of the tree is unbounded"),
    (Union((BALL, Union((BALL, NOT_BALL)))), r"complement that is union\[1\] of union\[1\] of"),
    (shapes.difference(UPPER, BALL), "the intersection that is the tree is unbounded"),
    (Intersection((BALL, FAR)), "the tree leaves nothing"),
    (shapes.difference(BALL, LARGE), "the tree leaves nothing"),
    (Intersection((UPPER, LOWER, ABOVE, BALL)), "the tree leaves nothing"),
    (Union((Union((BALL, BALL)),) * 22), "the tree must have at most 64 parts in all"),
    (DEEP, "the tree must have at most 64 parts in all"),
    (Union((PIERCED, BALL)), "a leaf's tessellation is not closed"),
])  # fmt: skip
def test_unbounded_empty_and_oversized_trees_are_refused(tree, sentence):
    with pytest.raises(ValueError, match=sentence):
        BooleanShape(tree)


def test_limit_values_are_accepted():
    BooleanShape(Intersection((BALL, *(UPPER,) * 62)))
    Bend(0.5)(np.array([[1.998, 0.0, 0.0], [-18.0, 0.0, 6.28]]))
    bent([0.0, 0.0], 32.66)
    cylinder(tilt=np.radians(75.0))
