from dataclasses import replace

import numpy as np
import pytest

from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.model import PlanDone
from palpate.messages.types.touch import SurfacePatch, TactileFrame
from palpate.messages.types.world import SensorInfo, Truth

POSE = np.array([0.01, 0.02, 0.03, 0.0, 0.0, 0.0, 1.0])
MILLISECOND = 1_000_000


@pytest.fixture
def record(tmp_path):
    """Writes a recording of some messages, a few milliseconds apart."""

    def write(messages, *, name="topics.mcap", skip=0, graph="", close=True, publisher="somebody"):
        types = {topic: type(message).__name__ for topic, message in messages}
        publishers = dict.fromkeys(types, publisher)
        about = {"version": "1.2.3", "graph": graph}
        writer = RecordingWriter(tmp_path / name, types, publishers, about)
        counts = dict.fromkeys(types, 0)
        for number, (topic, message) in enumerate(messages):
            sent = (1000 + 7 * number) * MILLISECOND
            seq, counts[topic] = counts[topic], counts[topic] + 1
            if number >= skip:
                header = Header(7, 0, seq, sent, 0.0, schema_hash(type(message)))
                writer.write(topic, header, encode(message))
        killed = (tmp_path / name).read_bytes()
        writer.close()
        if not close:
            (tmp_path / name).write_bytes(killed)
        return tmp_path / name

    return write


@pytest.fixture
def sensor():
    """An array of two rows and three columns."""
    return SensorInfo(
        rows=2,
        cols=3,
        pitch=0.001,
        thickness=0.003,
        dome=0.0,
        signal="time",
        sound_speed=1000.0,
        taxel_stiffness=100.0,
        gain=np.ones((2, 3)),
        offset=np.zeros((2, 3)),
        saturation=0.5,
        face="springs",
        face_decay=0.0,
        noise=0.0,
    )


def frame(touch):
    return TactileFrame(
        goal=1,
        touch=touch,
        finger=2,
        direction=np.array([1.0, 0.0, 0.0]),
        pose=POSE + np.array([0.001 * touch, 0, 0, 0, 0, 0, 0]),
        outcome="hit",
        array=np.arange(6.0).reshape(2, 3) + touch,
        robot_time=0.5 * touch,
    )


@pytest.fixture
def patch():
    """A touch of which four taxels of six felt something."""
    return SurfacePatch(
        goal=1,
        touch=0,
        finger=2,
        direction=np.array([1.0, 0.0, 0.0]),
        pose=POSE,
        outcome="hit",
        height=np.array([[0.0, 1e-4, 2e-4], [0.0, 3e-4, 4e-4]]),
        mask=np.array([[False, True, True], [False, True, True]]),
        jet=np.zeros(0),
        jet_scale=0.001,
        normal=np.array([0.0, 0.0, -1.0]),
        normal_error=0.0,
        k1=20.0,
        k2=10.0,
        k1_error=0.0,
        k2_error=0.0,
        principal_direction=np.array([1.0, 0.0, 0.0]),
        umbilic=False,
        curvature_across=0.0,
        curvature_across_error=0.0,
        kind="smooth",
        confidence=0.5,
        residual=0.0,
        robot_time=0.5,
    )


@pytest.fixture
def explored(record, sensor, patch, contour, tetrahedron, score):
    """A recording with a message of most kinds."""
    truth = Truth(
        vertices=tetrahedron.vertices,
        faces=tetrahedron.faces,
        floor_vertices=tetrahedron.vertices,
        floor_faces=tetrahedron.faces,
        height=0.03,
    )
    longer = replace(
        contour,
        id=1,
        points=np.arange(9.0).reshape(3, 3),
        normals=np.zeros((3, 3)),
        curvature=np.zeros(3),
        status="occluded",
        gap_starts=np.ones((1, 3)),
        gap_ends=np.ones((1, 3)),
        gap_reasons=("missed",),
    )
    nothing = replace(
        tetrahedron,
        number=2,
        vertices=np.zeros((0, 3)),
        faces=np.zeros((0, 3), np.int32),
        control=np.zeros((4, 4, 5, 3)),
        dropped_reasons=("too short", 'Lücke, "offen"'),
        health={"condition": 1.5, "folds": 2.0},
    )
    done = PlanDone(
        number=1,
        contours=(0, 1),
        probes=(),
        touches=4,
        robot_time=2.0,
        reason="within, all of it",
        reached=True,
        rms_bound_95=None,
        largest_untouched=None,
        uncovered=0.0,
    )
    log = LogRecord(node="filter", level="warning", text="a, b\n=c", robot_time=0.0)
    return record(
        [
            ("/truth", truth),
            ("/touch/info", sensor),
            *(("/touch/raw", frame(touch)) for touch in range(3)),
            ("/touch/patch", patch),
            ("/contour/traced", contour),
            ("/contour/traced", longer),
            ("/model/shape", tetrahedron),
            ("/model/shape", nothing),
            ("/score", score),
            ("/log", log),
            ("/plan/done", done),
        ]
    )
