"""What is handed to Rerun, by a module that stands in for it; the real package is 740 MB."""

import sys
from dataclasses import replace
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.launch.colours import rgb
from palpate.tools.drawables import LAYERS


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


def test_each_drawable_is_logged_at_its_robot_time_in_its_colour(export, explored):
    out, logged = export(explored)
    # All but the world, the sensor, and an estimate without a bound.
    assert out.endswith("out.rrd: 16 messages of 13 topics\n")
    assert [*logged["world"][0][1]] == ["z up"]
    assert {
        entity: [(time, *kinds) for time, kinds in many] for entity, many in logged.items()
    } == {
        "world": [(None, "z up")],
        "world/truth": [(None, "Mesh3D", "AnyValues")],
        "world/touched": [(0.25, "Points3D"), (0.5, "Points3D")],
        "world/finger/2": [(0.5, "Transform3D", "Boxes3D")],
        "compression/2": [(0.5, "DepthImage")],
        "force_N/2": [(0.5, "Scalars", "SeriesLines")],
        "world/contours/0": [(15.0, "LineStrips3D")],
        "world/contours/1": [(15.0, "LineStrips3D")],
        "world/contours/7": [(16.0, "LineStrips3D"), (17.0, "LineStrips3D")],
        "world/solid": [(20.0, "Mesh3D", "AnyValues"), (30.0, "Clear")],
        "world/lattice": [(20.0, "LineStrips3D"), (30.0, "Clear")],
        "world/free": [(20.0, "Points3D")],
        "world/unknown": [(20.0, "Points3D")],
        "error_mm/rms": [(20.0, "Scalars", "SeriesLines")],
        "error_mm/bound_95": [(21.0, "Scalars", "SeriesLines")],
        "log/filter": [(1.0, "TextLog")],
        "world/untouched": [(31.0, "Points3D")],
    }
    layout = explored.with_name("out.rrd").read_text()
    assert "{'world/touched': Made(kind='VisibleTimeRanges'" in layout
    assert "'- $origin/truth'" in layout and "name': 'true solid'" in layout
    assert "Made(kind='TimePanel', given=(), named={'timeline': 'robot_time'})" in layout
    kinds = {"touched": "Points3D", "free": "Points3D", "unknown": "Points3D"}
    kinds |= {"untouched": "Points3D", "lattice": "LineStrips3D", "contours/7": "LineStrips3D"}
    for path, kind in (kinds | {"finger/2": "Boxes3D"}).items():
        made = logged[f"world/{path}"][0][1][kind]
        assert made.named["colors"] == LAYERS[path.partition("/")[0]].rgb
    truth = logged["world/truth"][0][1]["Mesh3D"].named
    assert truth["albedo_factor"] == (*LAYERS["truth"].rgb, 102) and truth["vertex_colors"] is None
    assert logged["error_mm/rms"][0][1]["SeriesLines"].named == {"colors": rgb("error")}


def test_pad_taxels_curves_and_log_have_recorded_values(export, explored, patch):
    _, logged = export(explored)
    shown = logged["world/finger/2"][0][1]
    assert shown["Transform3D"].named["translation"].tolist() == [0.01, 0.02, 0.03]
    turn = shown["Transform3D"].named["rotation"].named["xyzw"]
    assert turn == pytest.approx([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    assert shown["Boxes3D"].named["half_sizes"][0] == pytest.approx([0.0015, 0.001, 0.0015])
    (image,) = logged["compression/2"][0][1]["DepthImage"].given
    assert image.tolist() == np.float32([[0.0, 1e-4, 1e-4]] * 2).tolist()
    (points,) = logged["world/touched"][1][1]["Points3D"].given
    assert np.array_equal(points, patch.points)
    assert logged["error_mm/rms"][0][1]["Scalars"].given == pytest.approx((0.4,))
    assert logged["error_mm/bound_95"][0][1]["Scalars"].given == pytest.approx((0.5,))
    assert logged["error_mm/bound_95"][0][1]["SeriesLines"].named == {"colors": rgb("bound")}
    assert logged["force_N/2"][0][1]["Scalars"].given == pytest.approx((100.0 * image.sum(),))
    line = logged["log/filter"][0][1]["TextLog"]
    assert (line.given, line.named) == (("a, b\n=c",), {"level": "WARN"})
    opened, closed = (one["LineStrips3D"].given[0][0] for _, one in logged["world/contours/7"])
    assert [len(opened), len(closed), closed[-1].tolist()] == [3, 4, [0.0, 1.0, 2.0]]


def test_model_mesh_is_coloured_by_first_known_scalar(export, explored, record, patch, tetrahedron):
    _, logged = export(explored, "--topics", "/model/shape")  # the truth is not shown, but known
    assert {*logged} == {"world", "world/solid", "world/lattice"}
    shown = logged["world/solid"][0][1]
    mesh = shown["Mesh3D"].named
    np.testing.assert_array_equal(mesh["vertex_positions"], tetrahedron.vertices)
    np.testing.assert_array_equal(mesh["triangle_indices"], tetrahedron.faces)
    assert shown["AnyValues"].named["coloured_by"] == "deviation"
    # The truth begins 1 mm beside two corners, on it lies the third.
    shades = [bytes(one).hex() == "440154" for one in mesh["vertex_colors"][:2]]
    assert shades == [True, False]
    np.testing.assert_allclose(np.linalg.norm(mesh["vertex_normals"], axis=1), 1.0)
    assert (mesh["vertex_normals"][0] < 0.0).all()
    unknown = replace(tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0))
    _, logged = export(record([("/model/shape", unknown)]))
    plain = logged["world/solid"][0][1]["Mesh3D"].named
    assert (plain["vertex_colors"], plain["albedo_factor"]) == (None, (*rgb("solid"), 255))
    _, logged = export(record([("/touch/patch", patch)]))
    assert {*logged} == {"world", "world/touched"}


def test_exports_that_cannot_be_are_refused(export, explored, refusal, monkeypatch):
    asked = (explored, "--format", "rerun", "-o", explored.with_name("out.rrd"))
    message = refusal("bag export", *asked, "--topics", "/world")
    assert "/world hold nothing that rerun would show" in message
    monkeypatch.setitem(sys.modules, "rerun", None)
    message = refusal("bag export", *asked)
    assert message == "palpate: --format rerun needs rerun-sdk: pip install 'palpate[rerun]'\n"
    assert [one.name for one in explored.parent.iterdir()] == [explored.name]


def test_real_rerun_writes_a_file(explored, call):
    pytest.importorskip("rerun", reason="rerun-sdk is not there: pip install 'palpate[rerun]'")
    out = explored.with_name("out.rrd")
    assert call("bag export", explored, "--format", "rerun", "-o", out).code == 0
    assert out.read_bytes()[:4] in (b"RRF2", b"RRF3")
