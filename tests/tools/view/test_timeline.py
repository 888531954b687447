from dataclasses import replace

import numpy as np
import pytest

from palpate.messages.types import Score, SensorInfo, ShapeModel, SurfacePatch
from palpate.tools.bag import open_decoded
from palpate.tools.view import Timeline, read_timeline
from palpate.tools.view.timeline import MOST_POINTS


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


def told(line):
    """What a timeline holds, as far as it can be compared."""
    touches = [(one.time, one.goal, one.number, one.points.tobytes()) for one in line.touches]
    models = [(one.robot_time, one.number) for one in line.models]
    contours = [(one.robot_time, one.id) for one in line.contours]
    return touches, models, contours, sorted(line.scores), sorted(line.spaces), line.end


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_order_of_arrival_does_not_matter(seed, messages, line):
    mixed = [messages[i] for i in np.random.default_rng(seed).permutation(len(messages))]
    assert told(timeline_of(mixed)) == told(line)


def test_an_image_is_its_touchs_own_whenever_it_comes(messages, line):
    late = sorted(messages, key=lambda one: type(one).__name__ == "TactileImage")
    forces = [one.force for one in line.touches]
    assert np.isfinite(forces).any()
    assert np.array_equal([one.force for one in timeline_of(late).touches], forces, equal_nan=True)


def test_nothing_is_taken_back_as_time_passes(line):
    times = np.linspace(-1.0, line.end + 1.0, 500)
    moments = np.array([line.at(time) for time in times])
    assert (np.diff(moments, axis=0) >= 0).all()
    assert not moments[0].any()
    kinds = (line.touches, line.grasps, line.contours, line.models)
    assert tuple(moments[-1]) == tuple(map(len, kinds))


def test_a_touch_is_there_from_its_end_on(line):
    for number, one in enumerate(line.touches, 1):
        assert line.at(one.time).touches >= number
        assert line.at(np.nextafter(one.time, 0.0)).touches < number


def test_patches_that_come_before_the_sensor_is_known_wait_for_it(messages, line):
    patches = [one for one in messages if isinstance(one, SurfacePatch)]
    sensor = next(one for one in messages if isinstance(one, SensorInfo))
    early = timeline_of(patches)
    assert early.touches == []
    early.add(sensor)
    assert [one.time for one in early.touches] == [one.time for one in line.touches]


def test_scores_belong_to_models_by_their_number(messages):
    score = next(one for one in messages if isinstance(one, Score))
    better = replace(score, number=score.number + 100, rms=1e-9)
    line = timeline_of([better, score])
    assert line.scores[score.number].rms == score.rms
    assert line.scores[score.number + 100].rms == 1e-9


def test_a_model_without_triangles_is_none_to_show(messages):
    model = next(one for one in messages if isinstance(one, ShapeModel))
    bare = replace(model, vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), np.int32))
    assert timeline_of([bare]).models == []


def test_what_was_touched_lies_on_the_true_surface(line):
    hits = [one for one in line.touches if one.outcome == "hit"]
    assert len(hits) > 10
    points = np.concatenate([one.points for one in hits])
    assert max(len(one.points) for one in hits) <= MOST_POINTS
    assert line.surface is not None
    assert line.surface.deviations(points).max() < 1e-4
