"""What is given to Rerun, by a module that stands in for it, and the file that the real one writes.

The real one is 740 MB: pip install 'palpate[rerun]' runs the last test as well.
"""

import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.core.poses import transform_points
from palpate.launch import rgb
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.model import PlanEstimate
from palpate.messages.types.touch import TactileFrame, TactileImage
from palpate.messages.types.world import Truth, World
from palpate.nodes.specs.sensors import pad_of_info
from palpate.tools.cli import command_line as cli

TURNED = np.array([0.01, 0.02, 0.03, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
ARCHETYPES = (
    *("Transform3D", "Boxes3D", "DepthImage", "Points3D", "LineStrips3D", "Mesh3D", "Clear"),
    *("AnyValues", "Scalars", "TextLog", "Quaternion"),
)
VIEWS = (
    *("Blueprint", "Horizontal", "Vertical", "Spatial3DView", "Spatial2DView", "TimeSeriesView"),
    *("TextLogView", "TimePanel", "VisibleTimeRange", "VisibleTimeRanges"),
)


class Made(NamedTuple):
    """What a constructor of the stand-in was called with."""

    kind: str
    given: tuple[Any, ...]
    named: dict[str, Any]


class Logged(NamedTuple):
    """What was logged, and when; None if for all times."""

    time: float | None
    archetypes: dict[str, Made]


class Stream:
    """A recording that keeps in memory what is logged."""

    logged: dict[str, list[Logged]]

    def __init__(self, name):
        assert name == "palpate"
        Stream.logged, self.time = {}, None

    def save(self, path, default_blueprint):
        path.write_text(repr(default_blueprint))

    def set_time(self, timeline, duration):
        assert timeline == "robot_time"
        self.time = duration

    def log(self, entity, *archetypes, static):
        time = None if static else self.time
        by_kind = {getattr(one, "kind", str(one)): one for one in archetypes}
        Stream.logged.setdefault(entity, []).append(Logged(time, by_kind))

    def disconnect(self):
        """Nothing is open."""


def stand_in(name, kinds, **more):
    module = ModuleType(name)
    for kind in kinds:
        setattr(module, kind, lambda *given, kind=kind, **named: Made(kind, given, named))
    for key, value in more.items():
        setattr(module, key, value)
    return module


@pytest.fixture
def rerun(monkeypatch):
    """A module in the place of rerun-sdk's, with nothing but the names that are needed."""
    bounds = stand_in("boundary", ("infinite", "cursor_relative"))
    blueprint = stand_in("rerun.blueprint", VIEWS, TimeRangeBoundary=bounds)
    axes = stand_in("axes", (), RIGHT_HAND_Z_UP="z up")
    radius = stand_in("radius", ("ui_points",))
    more = {"blueprint": blueprint, "ViewCoordinates": axes, "Radius": radius}
    module = stand_in("rerun", ARCHETYPES, RecordingStream=Stream, **more)
    monkeypatch.setitem(sys.modules, "rerun", module)
    monkeypatch.setitem(sys.modules, "rerun.blueprint", blueprint)


@pytest.fixture
def messages(sensor, patch, contour, tetrahedron, score):
    """One of each kind, and a contour and a model more."""
    touch = {"goal": 1, "touch": 0, "finger": 2, "direction": np.array([1.0, 0.0, 0.0])}
    touch |= {"pose": TURNED, "outcome": "hit", "robot_time": 0.5}
    moved = tetrahedron.vertices + np.array([0.001, 0.0, 0.0])
    places = {"vertices": moved, "floor_vertices": moved}
    faces = {"faces": tetrahedron.faces, "floor_faces": tetrahedron.faces}
    ring = np.arange(9.0).reshape(3, 3)
    late = {"id": 7, "points": ring, "normals": np.zeros((3, 3)), "curvature": np.zeros(3)}
    nothing = {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int32)}
    image = {"compression": np.full((2, 3), 1e-4), "mask": patch.mask, "impulses": 0}
    return [
        ("/world", World(platform=0.0, reach=0.3, fingers=1, seed=3)),
        ("/truth", Truth(**places, **faces, height=0.03)),
        ("/touch/info", sensor),
        ("/touch/raw", TactileFrame(**touch, array=np.zeros((2, 3)))),
        ("/touch/image", TactileImage(**touch, **image)),
        ("/touch/patch", replace(patch, pose=TURNED)),
        ("/contour/traced", contour),
        ("/contour/traced", replace(contour, **late, status="occluded", robot_time=16.0)),
        ("/contour/traced", replace(contour, **late, robot_time=17.0)),
        ("/model/shape", tetrahedron),
        ("/model/shape", replace(tetrahedron, **nothing, robot_time=30.0)),
        ("/score", score),
        ("/plan/estimate", estimate(0.0005)),
        ("/plan/estimate", estimate(None)),
        ("/log", LogRecord(node="filter", level="warning", text="too hot", robot_time=1.0)),
    ]


def estimate(bound):
    counts = {"number": 1, "contours": 2, "touches": 40}
    halving = {"halving_touches": None, "halving_seconds": None}
    known = {"rms_bound_95": bound, "largest_untouched": 0.01, "robot_time": 21.0}
    return PlanEstimate(**counts, **known, **halving)


@pytest.fixture
def bag(record, messages):
    return record(messages)


def export(bag, *more):
    out = bag.with_name("out.rrd")
    code = cli.run(["bag", "export", str(bag), "--format", "rerun", "-o", str(out), *more])
    return code, out


@pytest.fixture
def logged(rerun, bag):
    code, out = export(bag)
    assert (code, out.is_file()) == (0, True)
    return Stream.logged


def test_each_kind_of_message_is_shown_at_its_robot_time(logged):
    assert {entity: [one.time for one in many] for entity, many in logged.items()} == {
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


def test_what_is_shown_is_counted_of_the_topics_that_hold_it(rerun, bag, capsys):
    assert export(bag)[0] == 0
    # All but the world, the sensor, and an estimate without a bound.
    assert capsys.readouterr().out.endswith("out.rrd: 12 messages of 10 topics\n")


def test_z_is_up_and_touched_points_stay(rerun, bag):
    _, out = export(bag)
    assert list(Stream.logged["world"][0].archetypes) == ["z up"]
    layout = out.read_text()
    assert "{'world/touched': Made(kind='VisibleTimeRanges'" in layout
    assert "Made(kind='TimePanel', given=(), named={'timeline': 'robot_time'})" in layout


def test_touched_taxels_lie_in_the_world(logged, sensor, patch):
    x, y = pad_of_info(sensor).grid()
    cells = np.column_stack([x[patch.mask], y[patch.mask], patch.height[patch.mask]])
    (points,) = logged["world/touched"][0].archetypes["Points3D"].given
    np.testing.assert_allclose(points, transform_points(TURNED, cells), atol=1e-12)
    assert len(points) == 4


def test_the_pad_has_its_pose_and_its_image(logged):
    shown = logged["world/finger_2"][0].archetypes
    assert shown["Transform3D"].named["translation"].tolist() == [0.01, 0.02, 0.03]
    turn = shown["Transform3D"].named["rotation"].named["xyzw"]
    assert turn == pytest.approx([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    assert shown["Boxes3D"].named["half_sizes"][0] == pytest.approx([0.0015, 0.001, 0.0015])
    (image,) = logged["tactile/finger_2"][0].archetypes["DepthImage"].given
    assert image.tolist() == np.float32([[0.0, 1e-4, 1e-4], [0.0, 1e-4, 1e-4]]).tolist()


def test_contours_are_lines_in_the_colour_of_contours(logged):
    opened, closed = (one.archetypes["LineStrips3D"] for one in logged["world/contours/7"])
    assert [len(one.given[0][0]) for one in (opened, closed)] == [3, 4]
    assert closed.given[0][0][-1].tolist() == [0.0, 1.0, 2.0]
    assert opened.named["colors"] == closed.named["colors"] == rgb("contour")


def test_a_model_is_a_mesh_with_colours_and_goes_when_there_is_none(logged, tetrahedron):
    model, gone = logged["world/model"]
    mesh = model.archetypes["Mesh3D"].named
    np.testing.assert_array_equal(mesh["vertex_positions"], tetrahedron.vertices)
    np.testing.assert_array_equal(mesh["triangle_indices"], tetrahedron.faces)
    assert model.archetypes["AnyValues"].named["coloured_by"] == "deviation"
    # The truth begins 1 mm beside two corners, on it lies the third.
    assert bytes(mesh["vertex_colors"][0]).hex() == "440154"
    assert bytes(mesh["vertex_colors"][1]).hex() != "440154"
    normals = mesh["vertex_normals"]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert (normals[0] < 0.0).all()
    assert (gone.time, list(gone.archetypes)) == (30.0, ["Clear"])
    truth = logged["world/truth"][0].archetypes["Mesh3D"].named
    assert np.unique(truth["vertex_colors"]).tolist() == [*{*rgb("truth")}]


def test_error_bound_and_log_are_told(logged):
    assert logged["error_mm/rms"][0].archetypes["Scalars"].given == pytest.approx((0.4,))
    assert logged["error_mm/bound_95"][0].archetypes["Scalars"].given == pytest.approx((0.5,))
    line = logged["log/filter"][0].archetypes["TextLog"]
    assert (line.given, line.named) == (("too hot",), {"level": "WARN"})


def test_topics_that_are_not_wanted_are_not_shown_yet_give_colours(rerun, bag):
    assert export(bag, "--topics", "/model/shape")[0] == 0
    assert set(Stream.logged) == {"world", "world/model"}
    told = Stream.logged["world/model"][0].archetypes["AnyValues"].named
    assert told["coloured_by"] == "deviation"


def test_without_truth_and_uncertainty_a_model_has_no_colours(rerun, record, tetrahedron):
    unknown = replace(tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0))
    assert export(record([("/model/shape", unknown)]))[0] == 0
    shown = Stream.logged["world/model"][0].archetypes
    assert list(shown) == ["Mesh3D"]
    assert shown["Mesh3D"].named["vertex_colors"] is None


def test_a_patch_without_its_sensor_has_no_size_and_is_not_shown(rerun, record, patch):
    export(record([("/touch/patch", patch)]))
    assert set(Stream.logged) == {"world"}


def test_what_cannot_be_shown_is_refused_in_a_sentence(rerun, bag, capsys):
    code, out = export(bag, "--topics", "/world")
    assert code == 2
    assert "/world hold nothing that Rerun would show" in capsys.readouterr().err
    assert not out.exists()


def test_without_rerun_it_is_told_how_to_get_it(bag, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    code, _ = export(bag)
    assert code == 2
    told = capsys.readouterr().err
    assert told == "palpate: --format rerun needs rerun-sdk: pip install 'palpate[rerun]'\n"
    assert [one.name for one in bag.parent.iterdir()] == [bag.name]


def test_the_real_one_writes_a_file_that_it_reads(bag, monkeypatch):
    pytest.importorskip("rerun", reason="rerun-sdk is not there: pip install 'palpate[rerun]'")
    code, out = export(bag)
    assert code == 0
    path = os.pathsep.join(sys.path)
    call = partial(
        subprocess.run,
        env={**os.environ, "PYTHONPATH": path, "RERUN_ANALYTICS": "0"},
        capture_output=True,
        text=True,
        timeout=60.0,
    )
    command = (sys.executable, "-m", "rerun", "rrd")
    assert "1 file verified without error" in call([*command, "verify", str(out)]).stderr
    printed = call([*command, "print", str(out)]).stdout
    found = dict(re.findall(r"with \d+ rows? \(.*?\) - (\S+) - .*?\[(.*?)\]", printed))
    for entity, column in (
        ("/world", "ViewCoordinates:xyz"),
        ("/world/truth", "Mesh3D:vertex_positions"),
        ("/world/finger_2", "Transform3D:translation"),
        ("/tactile/finger_2", "DepthImage:buffer"),
        ("/world/touched", "Points3D:positions"),
        ("/world/contours/7", "LineStrips3D:strips"),
        ("/error_mm/rms", "Scalars:scalars"),
        ("/error_mm/bound_95", "Scalars:scalars"),
        ("/log/filter", "TextLog:text"),
    ):
        assert column in found[entity]
    models = [one for entity, one in re.findall(r"- (\S+) - .*?\[(.*?)\]", printed)]
    assert any("Mesh3D:vertex_colors" in one and "coloured_by" in one for one in models)
