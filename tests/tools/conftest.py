"""The command line called in process, and a recording with a message of most kinds."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.launch.run import Run
from palpate.messages.types import (
    GraspContacts,
    LogRecord,
    PlanDone,
    PlanEstimate,
    SensorInfo,
    SpaceMap,
    SurfacePatch,
    TactileImage,
    Truth,
)
from palpate.nodes.runtime.composed import Ending
from palpate.nodes.runtime.testing import example
from palpate.tools.cli.command_line import run
from palpate.tools.view.timeline import Timeline, read_timeline
from tests.tools.recordings import POSE, WORLD, frame, write_recording
from tests.tools.toy_graph import ToyGraph, toy_graph


class Printed(NamedTuple):
    """What a command has come to."""

    code: int
    out: str
    err: str


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Callable[..., Printed]:
    """Runs a command in this process: the verb's words in one text, then its arguments."""

    def do(verb: str, *arguments: Any) -> Printed:
        capsys.readouterr()
        code = run([*verb.split(), *map(str, arguments)])
        return Printed(code, *capsys.readouterr())

    return do


@pytest.fixture
def refusal(call: Callable[..., Printed]) -> Callable[..., str]:
    """The one sentence on standard error with which a command is refused."""

    def do(verb: str, *arguments: Any) -> str:
        code, out, err = call(verb, *arguments)
        assert (code, out, err.count("\n")) == (2, "", 1), err
        assert err.startswith("palpate: ")
        return err

    return do


@pytest.fixture(scope="module")
def line(run_folder: Path) -> Timeline:
    """What happened in a run; its touches and models may be changed by no test."""
    return read_timeline(run_folder)


@pytest.fixture
def performed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Has every exploration die at once; the plans that were to be performed, and how."""
    asked = []
    figures = {"status": "died", "reason": "the tracer fell", "missed": ["too coarse"]}

    def perform(plan: Any, *, composed: bool, display: Any) -> Run:
        asked.append((plan, composed, display))
        return Run(tmp_path, Ending(status="died", reason="the tracer fell"), figures, None, 3)

    monkeypatch.setattr("palpate.tools.exploration.perform", perform)
    return asked


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., Path]:
    """Writes a recording of some messages into the test's folder."""

    def write(messages: Any, *, name: str = "topics.mcap", **how: Any) -> Path:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        return write_recording(tmp_path / name, messages, **how)

    return write


@pytest.fixture
def sensor() -> SensorInfo:
    """An array of two rows and three columns."""
    fields = {"rows": 2, "cols": 3, "pitch": 0.001, "thickness": 0.003, "dome": 0.0}
    fields |= {"signal": "time", "sound_speed": 1000.0, "taxel_stiffness": 100.0}
    fields |= {"gain": np.ones((2, 3)), "offset": np.zeros((2, 3)), "saturation": 0.5}
    return example(SensorInfo, **fields, face="springs", face_decay=0.0, noise=0.0)


@pytest.fixture
def patch() -> SurfacePatch:
    """A touch of which four taxels of six felt something."""
    fields = {"goal": 1, "finger": 2, "pose": POSE, "outcome": "hit", "kind": "smooth"}
    fields |= {"height": np.array([[0.0, 1e-4, 2e-4], [0.0, 3e-4, 4e-4]]), "umbilic": False}
    fields |= {"points": 1e-3 * np.arange(12.0).reshape(4, 3), "normals": np.eye(4, 3)}
    mask = np.array([[False, True, True], [False, True, True]])
    return example(SurfacePatch, **fields, mask=mask, robot_time=0.5)


@pytest.fixture
def explored_messages(sensor, patch, contour, tetrahedron, score) -> list[tuple[str, Any]]:
    """A message of each kind that is drawn; the truth lies 1 mm beside the model."""
    turned = np.array([0.01, 0.02, 0.03, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    touch = {"goal": 1, "finger": 2, "pose": turned, "outcome": "hit", "robot_time": 0.5}
    moved = tetrahedron.vertices + np.array([0.001, 0.0, 0.0])
    places = {"vertices": moved, "floor_vertices": moved}
    faces = {"faces": tetrahedron.faces, "floor_faces": tetrahedron.faces}
    longer = {"points": np.arange(9.0).reshape(3, 3), "normals": np.zeros((3, 3))}
    longer |= {"curvature": np.zeros(3)}
    gap = {"gap_starts": np.ones((1, 3)), "gap_ends": np.ones((1, 3)), "gap_reasons": ("missed",)}
    empty = {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int32)}
    empty |= {"control": np.zeros((4, 4, 5, 3)), "health": {"condition": 1.5, "folds": 2.0}}
    empty |= {"dropped_reasons": ("too short", 'Lücke, "offen"')}
    image = {"compression": np.full((2, 3), 1e-4), "mask": patch.mask}
    contacts = {"points": np.eye(3), "normals": np.eye(3), "fingers": np.arange(3, dtype=np.int32)}
    states = np.zeros((5, 5, 5), np.uint8)
    states[1:4, 1:4, 1:4], states[2, 2, 2] = 1, 2
    space = {"number": 1, "low": np.zeros(3), "step": 0.01, "states": states}
    done = {"reason": "within, all of it", "reached": True, "rms_bound_95": None}
    return [
        ("/world", WORLD),
        ("/truth", Truth(**places, **faces, height=0.03)),
        ("/touch/info", sensor),
        ("/hand/contacts", example(GraspContacts, **contacts, robot_time=0.25)),
        ("/touch/raw", frame(0, **touch)),
        ("/touch/image", example(TactileImage, **touch, **image)),
        ("/touch/patch", replace(patch, pose=turned)),
        ("/contour/traced", contour),
        ("/contour/traced", replace(contour, **longer, **gap, id=1, status="occluded")),
        ("/contour/traced", replace(contour, **longer, id=7, status="occluded", robot_time=16.0)),
        ("/contour/traced", replace(contour, **longer, id=7, robot_time=17.0)),
        ("/model/shape", tetrahedron),
        ("/model/space", example(SpaceMap, **space)),
        ("/model/shape", replace(tetrahedron, **empty, number=2, robot_time=30.0)),
        ("/score", score),
        ("/plan/estimate", example(PlanEstimate, rms_bound_95=0.0005, robot_time=21.0)),
        ("/plan/estimate", example(PlanEstimate, rms_bound_95=None, robot_time=22.0)),
        ("/log", LogRecord(node="filter", level="warning", text="a, b\n=c", robot_time=1.0)),
        ("/plan/done", example(PlanDone, **done, open_places=np.eye(3), robot_time=31.0)),
    ]


@pytest.fixture
def explored(record, explored_messages) -> Path:
    """Their recording."""
    return record(explored_messages)


@pytest.fixture
def graph(runtime: Path) -> Iterator[ToyGraph]:
    """A graph of this user that runs; the test starts it."""
    with toy_graph() as running:
        yield running
