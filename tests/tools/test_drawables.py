"""Drawables of messages, on which views, pages, films and exports rest."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from palpate.messages import types
from palpate.nodes.runtime.testing import example
from palpate.nodes.specs.sensors import pad_of_info
from palpate.tools.drawables import LAYERS, TYPES_DRAWN, Known, drawables, pad_body
from tests.tools.recordings import WORLD, frame


@pytest.fixture
def messages(explored_messages):
    """A message of each drawn type, by its type."""
    return {type(message): message for _, message in reversed(explored_messages)}


@pytest.fixture
def drawn(explored_messages):
    """The drawables of all of them, in the order in which they come."""
    known, shown = Known(), []
    for _, message in explored_messages:
        known.take(message)
        shown += drawables(message, known)
    return shown


def test_touched_taxels_lie_in_the_world(drawn, sensor, patch):
    contacts, taxels = (drawable.shape for drawable in drawn if drawable.path == "touched")
    assert np.array_equal(taxels.points, patch.points)
    assert np.array_equal(taxels.normals, patch.normals)
    assert contacts.radius > taxels.radius and LAYERS["touched"].accumulates
    body = trimesh.Trimesh(*pad_body(pad_of_info(sensor)))
    assert body.is_watertight and body.volume > 0.0


def test_contours_are_strips_between_their_gaps(contour):
    points = np.arange(15.0).reshape(5, 3)
    whole = {"points": points, "normals": np.zeros((5, 3)), "curvature": np.zeros(5)}
    gap = {"gap_starts": points[1:2], "gap_ends": points[2:3], "gap_reasons": ("missed",)}
    none = {"gap_starts": points[:0], "gap_ends": points[:0], "gap_reasons": ()}
    for status, gaps, lengths in (
        ("closed", none, [6]),
        ("closed", gap, [2, 4]),
        ("occluded", none, [5]),
        ("occluded", gap, [2, 3]),
    ):
        (drawable,) = drawables(replace(contour, **whole, **gaps, status=status), Known())
        assert [len(strip) for strip in drawable.shape.strips] == lengths
        assert len(drawable.shape.pieces()) == sum(lengths) - len(lengths)
    (drawable,) = drawables(replace(contour, **whole, **none, status="closed"), Known())
    assert drawable.shape.strips[0][-1].tolist() == points[0].tolist()


def test_lattice_is_drawn_as_its_outer_lines(messages):
    control = np.arange(3.0 * 4 * 5 * 3).reshape(3, 4, 5, 3)
    model = replace(messages[types.ShapeModel], control=control)
    strips = drawables(model, Known())[1].shape.strips
    assert Counter(map(len, strips)) == {3: 14, 4: 12, 5: 10}  # around each of three blocks


def test_mesh_knows_deviation_before_uncertainty(messages):
    model, known = messages[types.ShapeModel], Known()
    stated = drawables(model, known)[0].shape
    assert [*stated.scalars()] == ["uncertainty"] == [*stated.known]
    silent = replace(model, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0))
    assert drawables(silent, known)[0].shape.scalars() == {}
    known.take(messages[types.Truth])
    both = drawables(model, known)[0].shape
    assert [*both.scalars()] == ["deviation", "uncertainty"] == [*both.known]
    beside, on = both.scalars("deviation", [0, 1])["deviation"]  # the truth begins 1 mm beside
    assert (beside, on) == (pytest.approx(0.001), pytest.approx(0.0, abs=1e-9))


def test_every_layer_is_drawn_and_space_has_its_boundaries(messages, drawn):
    assert {*LAYERS} <= {drawable.layer for drawable in drawn}
    space = messages[types.SpaceMap]
    for path, state in (("free", 1), ("unknown", 0)):
        points = next(drawable.shape.points for drawable in drawn if drawable.path == path)
        places = np.rint((points - space.low) / space.step).astype(int)
        assert len(places) and (space.states[tuple(places.T)] == state).all()


def test_empty_messages_have_no_drawables(messages, patch, sensor):
    known = Known()
    assert [drawable.shape.pad for drawable in drawables(frame(0), known)] == [None]
    assert [drawable.path for drawable in drawables(messages[types.TactileImage], known)] == [
        "compression/2"
    ]
    known.take(sensor)
    empty = {"points": np.zeros((0, 3)), "normals": np.zeros((0, 3))}
    grasp = replace(messages[types.GraspContacts], **empty, fingers=np.zeros(0, np.int32))
    untouched = replace(patch, **empty)
    estimate = example(types.PlanEstimate, rms_bound_95=None)
    done = replace(messages[types.PlanDone], open_places=np.zeros((0, 3)))
    assert [drawables(empty, known) for empty in (grasp, untouched, estimate, done)] == [[]] * 4
    assert drawables(WORLD, known) == drawables(sensor, known) == []
    assert {type(message).__name__ for message in messages.values()} == TYPES_DRAWN | {"World"}
