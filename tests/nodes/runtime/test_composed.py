from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from palpate.bench.bus.toy_node import ToyParams, toy
from palpate.core.rebuild import closed_sides
from palpate.core.rebuild.side import radial
from palpate.core.rebuild.solid import Solid
from palpate.core.rebuild.surface.meshing import SurfaceMesh
from palpate.messages.types.model import ShapeModel
from palpate.nodes import reconstructor
from palpate.nodes.planning import phases
from palpate.nodes.runtime.composed import run_composed
from palpate.nodes.runtime.node import Wiring
from palpate.nodes.specs.objects import ObjectSpec

Exploration = Callable[..., tuple[Wiring, ...]]
SCHEDULES = 100
FEW = 26  # Touches: a contour and a few probes beside it


def mesh_sha256(model: ShapeModel) -> str:
    return hashlib.sha256(model.vertices.tobytes() + model.faces.tobytes()).hexdigest()


def places_of(solid: Solid, final: bool) -> SurfaceMesh:
    """Points of its surface, in place of a mesh."""
    v, turns = np.meshgrid(np.linspace(0.0, 1.0, 24), np.arange(16) / 16)
    points = solid.surface.at(v, turns).reshape(-1, 3)
    return SurfaceMesh(points, np.zeros((0, 3), np.int32), v.ravel(), turns.ravel())


def test_the_loop_closes_and_ends(ball: ObjectSpec, exploration: Exploration, ears: Any):
    wirings = exploration(ball, 3)
    watch = ("/score", "/model/shape", "/contour/traced")
    ending = run_composed(wirings, ends="evaluator", watch=watch, watcher=ears)
    assert (ending.status, ending.gaps, ending.duplicates) == ("finished", 0, 0)
    assert [contour.status for contour in ears.of("/contour/traced")] == ["closed"] * 3
    score = ears.of("/score")[-1]
    assert score.final
    assert score.watertight
    assert score.genus == 0
    # Three contours of a ball feel nearly all of it.
    assert score.chamfer < 2e-4 * score.size
    assert score.sampling_floor > 0.0


def told(value: Any) -> bytes:
    """All that a value says, to the last byte."""
    if isinstance(value, np.ndarray):
        return str(value.shape).encode() + value.tobytes()
    if dataclasses.is_dataclass(value):
        return told([getattr(value, field.name) for field in dataclasses.fields(value)])
    if isinstance(value, Mapping):
        return b"".join(told(one) for pair in value.items() for one in pair)
    if isinstance(value, (tuple, list)):
        return b"(" + b"".join(map(told, value)) + b")"
    return repr(value).encode() + b","


def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """A pure function that computes only once what it is asked again, to the last byte."""
    known: dict[bytes, Any] = {}

    def call(*arguments: Any) -> Any:
        # Who counts the time of its steps changes nothing.
        key = hashlib.sha256(told([one for one in arguments if not callable(one)])).digest()
        if key not in known:
            known[key] = function(*arguments)
        return known[key]

    return call


@pytest.fixture
def coarse_spans(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Few spans along the side; what follows from their number is kept no longer than that."""
    tables = (radial.along_basis, radial.even_spans, radial.bending_root)
    monkeypatch.setattr(radial, "SPANS", 9)
    monkeypatch.setattr(radial, "HALVED", 1)
    for table in tables:
        table.cache_clear()
    yield
    for table in tables:
        table.cache_clear()


@pytest.fixture
def coarse_side(coarse_spans: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """A side with few coefficients, and places of the surface for a mesh, each computed once."""
    for module, name in (
        (reconstructor, "rebuild_set"),
        (reconstructor, "coarse_model"),
        (phases, "fit_object_frame"),
    ):
        monkeypatch.setattr(module, name, remembered(getattr(module, name)))
    monkeypatch.setattr(radial, "AROUND", 16)
    monkeypatch.setattr(reconstructor, "_mesh", places_of)
    monkeypatch.setattr(closed_sides, "ROWS", 17)
    monkeypatch.setattr(closed_sides, "TURNS", 32)


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_side")
def test_no_order_of_the_edges_changes_the_solid(
    ball: ObjectSpec, exploration: Exploration, ears: Any
):
    graph = exploration(ball, 1, most_touches=FEW)
    wirings = [one for one in graph if one.name != "evaluator"]
    found = set()
    for schedule in range(SCHEDULES):
        ears.messages.clear()
        ending = run_composed(
            wirings, ends="reconstructor", watch=("/model/shape",), watcher=ears, schedule=schedule
        )
        assert ending.status == "stalled", ending.reason  # quiet, and nobody says Finished
        models = ears.of("/model/shape")
        assert models[-1].final
        found.add(tuple(mesh_sha256(model) for model in models))
    assert len(found) == 1


def test_a_node_that_raises_ends_the_graph_with_its_words(
    ball: ObjectSpec, exploration: Exploration, ears: Any, monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: object, **__: object) -> None:
        raise ValueError("a taxel came off")

    monkeypatch.setattr("palpate.nodes.filter.clean", fail)
    ending = run_composed(exploration(ball, 1), ends="evaluator", watch=(), watcher=ears)
    assert ending.status == "died"
    assert "filter handling /touch/raw 0" in ending.reason
    assert "a taxel came off" in ending.reason


def test_a_graph_that_falls_quiet_has_stalled(
    ball: ObjectSpec, exploration: Exploration, ears: Any
):
    wirings = [one for one in exploration(ball, 1) if one.name != "tracer"]
    ending = run_composed(wirings, ends="evaluator", watch=(), watcher=ears)
    assert (ending.status, ending.reason) == (
        "stalled",
        "all is quiet, and evaluator has not finished",
    )


def test_what_each_node_published_and_handled_is_counted(ears: Any):
    wirings = [
        toy("source", ToyParams(burst=5), subscribers=("counter",)),
        toy("counter", ToyParams(expects=5), upstream="source"),
    ]
    ending = run_composed(wirings, ends="counter", watch=(), watcher=ears)
    assert ending.status == "finished"
    for name, messages, sent in (("source", 0, 5), ("counter", 5, 0)):
        found = ending.statuses[name]
        assert (found.node, found.messages, found.sent) == (name, messages, sent)
        assert (found.gaps, found.duplicates) == (0, 0)
        assert 0.0 < sum(found.steps.values()) <= found.cpu
        assert set(found.steps) == {name}
