"""What is handed to Rerun, by a module that stands in for it; the real package is 740 MB."""

import sys
from dataclasses import replace
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.core.poses import transform_points
from palpate.launch.colours import rgb
from palpate.messages.types import PlanEstimate, TactileImage, Truth
from palpate.nodes.runtime.testing import example
from palpate.nodes.specs.sensors import pad_of_info
from tests.tools.recordings import WORLD, frame

TURNED = np.array([0.01, 0.02, 0.03, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])


class Made(NamedTuple):
    """What a constructor of the stand-in was called with."""

    kind: str
    given: tuple[Any, ...]
    named: dict[str, Any]


class StandIn(ModuleType):
    """A module any of whose names makes something that can be looked at."""

    def __getattr__(self, name):
        if name in ("blueprint", "TimeRangeBoundary", "Radius"):
            return self
        return lambda *given, **named: Made(name, given, named)


class Stream:
    """A recording that keeps what is logged, by entity: the time, and archetypes by kind."""

    logged: dict[str, list[tuple[float | None, dict[str, Any]]]]

    def __init__(self, name):
        assert name == "palpate"
        Stream.logged, self.time = {}, None

    def save(self, path, default_blueprint):
        path.write_text(repr(default_blueprint))

    def set_time(self, timeline, duration):
        assert timeline == "robot_time"
        self.time = duration

    def log(self, entity, *archetypes, static):
        by_kind = {getattr(one, "kind", str(one)): one for one in archetypes}
        Stream.logged.setdefault(entity, []).append((None if static else self.time, by_kind))

    def disconnect(self):
        """Nothing is open."""


@pytest.fixture
def export(call, monkeypatch):
    """Exports a recording to the stand-in: what is printed, and what was logged."""
    module = StandIn("rerun")
    module.RecordingStream = Stream
    module.ViewCoordinates = type("Axes", (), {"RIGHT_HAND_Z_UP": "z up"})
    monkeypatch.setitem(sys.modules, "rerun", module)
    monkeypatch.setitem(sys.modules, "rerun.blueprint", module)

    def do(bag, *more):
        bag.with_name("out.rrd").unlink(missing_ok=True)
        asked = ("--format", "rerun", "-o", bag.with_name("out.rrd"))
        done = call("bag export", bag, *asked, *more)
        assert done.code == 0, done.err
        return done.out, Stream.logged

    return do


@pytest.fixture
def bag(record, explored_messages, patch, contour, tetrahedron):
    """A message of each kind that is shown; the truth lies 1 mm beside the model."""
    touch = {"goal": 1, "finger": 2, "pose": TURNED, "outcome": "hit", "robot_time": 0.5}
    moved = tetrahedron.vertices + np.array([0.001, 0.0, 0.0])
    places = {"vertices": moved, "floor_vertices": moved}
    faces = {"faces": tetrahedron.faces, "floor_faces": tetrahedron.faces}
    points = {"points": np.arange(9.0).reshape(3, 3), "normals": np.zeros((3, 3))}
    late = {"id": 7, "curvature": np.zeros(3), **points}
    nothing = {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int32)}
    image = {"compression": np.full((2, 3), 1e-4), "mask": patch.mask}
    known = {topic: message for topic, message in explored_messages if topic != "/model/shape"}
    return record(
        [
            ("/world", WORLD),
            ("/truth", Truth(**places, **faces, height=0.03)),
            ("/touch/info", known["/touch/info"]),
            ("/touch/raw", frame(0, **touch, array=np.zeros((2, 3)))),
            ("/touch/image", example(TactileImage, **touch, **image)),
            ("/touch/patch", replace(patch, pose=TURNED)),
            ("/contour/traced", contour),
            ("/contour/traced", replace(contour, **late, status="occluded", robot_time=16.0)),
            ("/contour/traced", replace(contour, **late, robot_time=17.0)),
            ("/model/shape", tetrahedron),
            ("/model/shape", replace(tetrahedron, **nothing, robot_time=30.0)),
            ("/score", known["/score"]),
            ("/plan/estimate", example(PlanEstimate, rms_bound_95=0.0005, robot_time=21.0)),
            ("/plan/estimate", example(PlanEstimate, rms_bound_95=None, robot_time=22.0)),
            ("/log", replace(known["/log"], robot_time=1.0)),
        ]
    )


def test_each_kind_of_message_is_shown_at_its_robot_time(export, bag):
    out, logged = export(bag)
    # All but the world, the sensor, and an estimate without a bound.
    assert out.endswith("out.rrd: 12 messages of 10 topics\n")
    assert [*logged["world"][0][1]] == ["z up"]
    assert {entity: [time for time, _ in many] for entity, many in logged.items()} == {
        "world": [None],
        "world/truth": [None],
        "world/finger_2": [0.5],
        "tactile/finger_2": [0.5],
        "world/touched": [0.5],
        "world/contours/0": [15.0],
        "world/contours/7": [16.0, 17.0],
        "world/model": [20.0, 30.0],
        "error_mm/rms": [20.0],
        "error_mm/bound_95": [21.0],
        "log/filter": [1.0],
    }
    layout = bag.with_name("out.rrd").read_text()
    assert "{'world/touched': Made(kind='VisibleTimeRanges'" in layout
    assert "Made(kind='TimePanel', given=(), named={'timeline': 'robot_time'})" in layout


def test_pad_and_touched_taxels_lie_in_the_world(export, bag, sensor, patch):
    _, logged = export(bag)
    shown = logged["world/finger_2"][0][1]
    assert shown["Transform3D"].named["translation"].tolist() == [0.01, 0.02, 0.03]
    turn = shown["Transform3D"].named["rotation"].named["xyzw"]
    assert turn == pytest.approx([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    assert shown["Boxes3D"].named["half_sizes"][0] == pytest.approx([0.0015, 0.001, 0.0015])
    (image,) = logged["tactile/finger_2"][0][1]["DepthImage"].given
    assert image.tolist() == np.float32([[0.0, 1e-4, 1e-4]] * 2).tolist()
    x, y = pad_of_info(sensor).grid()
    cells = np.column_stack([x[patch.mask], y[patch.mask], patch.height[patch.mask]])
    (points,) = logged["world/touched"][0][1]["Points3D"].given
    np.testing.assert_allclose(points, transform_points(TURNED, cells), atol=1e-12)


def test_contours_are_lines_and_models_coloured_meshes(export, bag, tetrahedron):
    _, logged = export(bag)
    opened, closed = (one["LineStrips3D"] for _, one in logged["world/contours/7"])
    assert [len(one.given[0][0]) for one in (opened, closed)] == [3, 4]
    assert closed.given[0][0][-1].tolist() == [0.0, 1.0, 2.0]
    assert opened.named["colors"] == closed.named["colors"] == rgb("contour")
    (_, model), (_, gone) = logged["world/model"]
    mesh = model["Mesh3D"].named
    np.testing.assert_array_equal(mesh["vertex_positions"], tetrahedron.vertices)
    np.testing.assert_array_equal(mesh["triangle_indices"], tetrahedron.faces)
    assert model["AnyValues"].named["coloured_by"] == "deviation" and [*gone] == ["Clear"]
    # The truth begins 1 mm beside two corners, on it lies the third.
    shades = [bytes(one).hex() == "440154" for one in mesh["vertex_colors"][:2]]
    assert shades == [True, False]
    np.testing.assert_allclose(np.linalg.norm(mesh["vertex_normals"], axis=1), 1.0)
    assert (mesh["vertex_normals"][0] < 0.0).all()
    truth = logged["world/truth"][0][1]["Mesh3D"].named
    assert np.unique(truth["vertex_colors"]).tolist() == [*{*rgb("truth")}]


def test_error_bound_and_log_are_plotted(export, bag):
    _, logged = export(bag)
    assert logged["error_mm/rms"][0][1]["Scalars"].given == pytest.approx((0.4,))
    assert logged["error_mm/bound_95"][0][1]["Scalars"].given == pytest.approx((0.5,))
    line = logged["log/filter"][0][1]["TextLog"]
    assert (line.given, line.named) == (("a, b\n=c",), {"level": "WARN"})


def test_models_are_coloured_by_what_is_known(export, bag, record, patch, tetrahedron):
    _, logged = export(bag, "--topics", "/model/shape")  # the truth is not shown, but known
    assert {*logged} == {"world", "world/model"}
    assert logged["world/model"][0][1]["AnyValues"].named["coloured_by"] == "deviation"
    unknown = replace(tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0))
    _, logged = export(record([("/model/shape", unknown)]))
    ((_, shown),) = logged["world/model"]
    assert [*shown] == ["Mesh3D"] and shown["Mesh3D"].named["vertex_colors"] is None
    _, logged = export(record([("/touch/patch", patch)]))  # without its sensor it has no size
    assert {*logged} == {"world"}


def test_exports_that_cannot_be_are_refused(export, bag, refusal, monkeypatch):
    asked = (bag, "--format", "rerun", "-o", bag.with_name("out.rrd"))
    told = refusal("bag export", *asked, "--topics", "/world")
    assert "/world hold nothing that rerun would show" in told
    monkeypatch.setitem(sys.modules, "rerun", None)
    told = refusal("bag export", *asked)
    assert told == "palpate: --format rerun needs rerun-sdk: pip install 'palpate[rerun]'\n"
    assert [one.name for one in bag.parent.iterdir()] == [bag.name]


def test_real_rerun_writes_a_file(bag, call):
    pytest.importorskip("rerun", reason="rerun-sdk is not there: pip install 'palpate[rerun]'")
    out = bag.with_name("out.rrd")
    assert call("bag export", bag, "--format", "rerun", "-o", out).code == 0
    assert out.read_bytes()[:4] in (b"RRF2", b"RRF3")
