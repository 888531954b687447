"""Tests of the node template. Run them with ``python -m pytest`` in this folder."""

from __future__ import annotations

from palpate.messages.types import SurfacePatch
from palpate.testing import assert_same, drive, example, messages_on
from palpate.tools.templates.node import NODE, Template


def patch(touch: int, curvature: float, kind: str = "smooth") -> tuple[str, SurfacePatch]:
    """Patch of a touch; unused fields are 0."""
    return "/touch/patch", example(SurfacePatch, touch=touch, k1=curvature, kind=kind)


def test_each_larger_curvature_is_published() -> None:
    """Touches with smaller or equal curvatures are ignored."""
    published = drive(NODE, [patch(0, 20.0), patch(1, 15.0), patch(2, 40.0), patch(3, 40.0)])
    assert [(place.touch, place.curvature) for place in messages_on(published, "/template")] == [
        (0, 20.0),
        (2, 40.0),
    ]


def test_patches_that_are_not_smooth_are_ignored() -> None:
    """Edges, corners and misses have no curvature."""
    assert drive(NODE, [patch(0, 50.0, "edge"), patch(1, 50.0, "miss")]) == []


def test_smallest_curvature_is_a_parameter() -> None:
    """Parameters are written as in the launch file."""
    published = drive(NODE, [patch(0, 20.0), patch(1, 40.0)], {"least": 30.0})
    assert_same(published, [("/template", example(Template, touch=1, curvature=40.0))])
