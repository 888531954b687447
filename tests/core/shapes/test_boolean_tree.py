from __future__ import annotations

import numpy as np

from palpate.core.shapes.boolean_tree import (
    Complement,
    Intersection,
    Union,
    complement,
    difference,
    leaves,
    unbounded_part,
    within,
)
from palpate.core.shapes.half_space import HalfSpace
from palpate.core.shapes.superquadric import Superquadric

A, B, C = (Superquadric(np.full(3, 0.01 * n), np.ones(2)) for n in (1, 2, 3))
UP = HalfSpace(np.array([0.0, 0.0, 1.0]), 0.02)


def test_leaves_come_in_the_order_of_the_tree() -> None:
    tree = Union((difference(A, B, UP), Complement(C)))
    found = list(leaves(tree))
    assert found[:2] == [A, B]
    assert isinstance(found[2], HalfSpace)
    assert found[3] is C


def test_the_complement_of_a_complement_is_the_part_and_a_half_space_is_turned() -> None:
    assert complement(complement(A)) is A
    turned = complement(UP)
    assert isinstance(turned, HalfSpace)
    assert turned.normal.tolist() == [0.0, 0.0, -1.0]
    assert turned.offset == -0.02


def test_membership_is_that_of_sets() -> None:
    a, b, c = np.array([[bool(n & bit) for bit in (1, 2, 4)] for n in range(8)]).T
    cases = (
        (Union((A, B, C)), a | b | c),
        (Intersection((A, B, C)), a & b & c),
        (difference(A, B, C), a & ~b & ~c),
        (Union((Complement(A), Intersection((B, Complement(C))))), ~a | (b & ~c)),
    )
    for tree, wanted in cases:
        assert np.array_equal(within(tree, iter([a, b, c])), wanted)


def test_the_part_that_makes_a_tree_unbounded_is_named() -> None:
    assert (
        unbounded_part(Union((A, Complement(B)))) == "the complement that is union[1] of the tree"
    )
    assert unbounded_part(UP) == "the half-space that is the tree"
