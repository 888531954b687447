"""What must hold of the node template. Run it with ``python -m pytest`` in this folder."""

from __future__ import annotations

from palpate.messages.types import SurfacePatch
from palpate.testing import assert_same, drive, example, messages_on
from palpate.tools.templates.node import NODE, Template


def patch(touch: int, curvature: float, kind: str = "smooth") -> tuple[str, SurfacePatch]:
    """What the node receives of one touch; fields that do not matter are 0."""
    return "/touch/patch", example(SurfacePatch, touch=touch, k1=curvature, kind=kind)


def test_each_place_that_bends_more_than_all_before_is_told() -> None:
    """Those in between are passed over."""
    published = drive(NODE, [patch(0, 20.0), patch(1, 15.0), patch(2, 40.0), patch(3, 40.0)])
    assert [(one.touch, one.curvature) for one in messages_on(published, "/template")] == [
        (0, 20.0),
        (2, 40.0),
    ]


def test_what_is_not_smooth_has_no_curvature_to_tell() -> None:
    """Edges and corners are none of its business."""
    assert drive(NODE, [patch(0, 50.0, "edge"), patch(1, 50.0, "miss")]) == []


def test_the_launch_file_may_say_what_is_little() -> None:
    """A parameter is given as in the launch file."""
    published = drive(NODE, [patch(0, 20.0), patch(1, 40.0)], {"least": 30.0})
    assert_same(published, [("/template", example(Template, touch=1, curvature=40.0))])
