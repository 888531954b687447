"""What happened in robot time: the same whatever the order in which messages come."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.core.geometry import is_closed, signed_volume
from palpate.messages.types import Score, SensorInfo, ShapeModel, SurfacePatch
from palpate.tools.bag.decoding import open_decoded
from palpate.tools.view.picture import finger_mesh
from palpate.tools.view.timeline import Timeline, read_timeline


@pytest.fixture(scope="module")
def messages(run_folder):
    return [one.message for one in open_decoded(run_folder).published()]


@pytest.fixture(scope="module")
def line(run_folder):
    return read_timeline(run_folder)


def timeline_of(messages):
    line = Timeline()
    for one in messages:
        line.add(one)
    return line


def contents(line):
    """What a timeline holds, as far as it can be compared."""
    touches = [
        (one.time, one.goal, one.number, one.points.tobytes(), np.float64(one.force).tobytes())
        for one in line.touches
    ]
    models = [(one.robot_time, one.number) for one in line.models]
    contours = [(one.robot_time, one.id) for one in line.contours]
    return touches, models, contours, sorted(line.scores), sorted(line.spaces), line.end


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_order_of_arrival_does_not_matter(seed, messages, line):
    mixed = [messages[i] for i in np.random.default_rng(seed).permutation(len(messages))]
    assert contents(timeline_of(mixed)) == contents(line)
    assert np.isfinite([one.force for one in line.touches]).any()


def test_nothing_is_taken_back_as_time_passes(line):
    times = np.linspace(-1.0, line.end + 1.0, 500)
    moments = np.array([line.at(time) for time in times])
    assert (np.diff(moments, axis=0) >= 0).all() and not moments[0].any()
    kinds = (line.touches, line.grasps, line.contours, line.models)
    assert tuple(moments[-1]) == tuple(map(len, kinds))
    for number, one in enumerate(line.touches, 1):  # a touch is there from its end on
        assert line.at(one.time).touches >= number
        assert line.at(np.nextafter(one.time, 0.0)).touches < number


def test_messages_wait_for_what_they_need(messages, line):
    early = timeline_of([one for one in messages if isinstance(one, SurfacePatch)])
    assert early.touches == []
    early.add(next(one for one in messages if isinstance(one, SensorInfo)))
    assert [one.time for one in early.touches] == [one.time for one in line.touches]
    score = next(one for one in messages if isinstance(one, Score))
    better = replace(score, number=score.number + 100, rms=1e-9)
    assert timeline_of([better, score]).scores[score.number].rms == score.rms
    model = next(one for one in messages if isinstance(one, ShapeModel))
    bare = replace(model, vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), np.int32))
    assert timeline_of([bare]).models == []


def test_touched_points_lie_on_the_true_surface(line):
    hits = [one for one in line.touches if one.outcome == "hit"]
    assert len(hits) > 10 and max(len(one.points) for one in hits) <= 48
    assert line.surface.deviations(np.concatenate([one.points for one in hits])).max() < 1e-4


def test_drawn_finger_is_closed_with_its_tip_at_the_pad():
    vertices, faces = finger_mesh(np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]))
    assert is_closed(faces) and signed_volume(vertices[faces]) > 0.0
    assert vertices[:, 2].max() == pytest.approx(0.3)
    assert np.abs(vertices - [0.1, 0.2, 0.3]).sum(axis=1).min() == 0.0
