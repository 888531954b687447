import dataclasses
import io
import json
import sys

import numpy as np
import pytest

from palpate.core import IDENTITY_POSE
from palpate.launch.progress import (
    Display,
    LineDisplay,
    LiveDisplay,
    Progress,
    ProgressWatcher,
    open_display,
    progress_share,
    progress_text,
)
from palpate.messages.types.catalogue import LogRecord, NodeStatus
from palpate.messages.types.model import PlanEstimate
from palpate.messages.types.motion import ContourGoal


def record(text="the pad slipped", level="warning"):
    return LogRecord(node="tracer", level=level, text=text, robot_time=2.5)  # type: ignore[arg-type]


def status(node):
    counts = dict.fromkeys(("messages", "sent", "gaps", "duplicates"), 0)
    return NodeStatus(node=node, state="running", p50=0.0, p99=0.0, cpu=1.5, **counts)


def test_the_gatherer_adds_up_what_it_receives(contour, tetrahedron, score):
    gatherer = ProgressWatcher(3, Display(), io.StringIO())
    gatherer.ready(0.5)
    for message in (contour, dataclasses.replace(contour, robot_time=9.0), tetrahedron, score):
        gatherer.received("/any", message)
    gatherer.tick({})
    assert gatherer.progress.compute_at(1.0) is None
    gatherer.tick({name: status(name) for name in "ab"})
    progress = gatherer.progress
    assert (progress.contours, progress.touches, progress.robot_time) == (2, 60, 15.0)
    assert progress.ready == 0.5
    assert progress.model is tetrahedron
    assert progress.score is score
    assert 0.0 <= progress.made[tetrahedron.number] <= progress.wall
    assert progress.compute_at(progress.wall) == 3.0
    assert 0.0 <= progress.scores[0][0] <= progress.wall


def test_the_log_is_one_json_line_a_record():
    log = io.StringIO()
    ProgressWatcher(1, Display(), log).log(record())
    line = json.loads(log.getvalue())
    assert line.pop("wall_s") >= 0.0
    assert line == {
        "node": "tracer",
        "level": "warning",
        "text": "the pad slipped",
        "robot_time_s": 2.5,
    }


def goal():
    return ContourGoal(
        id=1, finger=1, frame=IDENTITY_POSE, height=0.035, centre=np.zeros(2), radius=0.05,
        not_before=0.0, reason="the widest gap",
    )  # fmt: skip


def estimate(bound):
    return PlanEstimate(
        number=2, contours=2, touches=40, robot_time=20.0, rms_bound_95=bound,
        largest_untouched=9e-3, halving_touches=None, halving_seconds=None,
    )  # fmt: skip


def test_plain_lines_come_once_a_contour_and_once_a_warning(score):
    stream = io.StringIO()
    lines = LineDisplay(stream)
    progress = Progress(touches=4, wall=1.0, tolerance=2e-4)
    lines.ready(8, 1.25)
    lines.show(progress)
    progress.contours, progress.touches, progress.wall = 1, 20, 2.0
    lines.show(progress)
    lines.show(progress)
    progress.contours, progress.estimates = 2, [(2.0, estimate(4e-4))]
    progress.scores.append((1.0, score))
    lines.show(progress)
    for one in (record(), record(), record("all is well", "info")):
        lines.note(one)
    progress.touches = 45
    lines.show(progress)
    lines.close()
    assert stream.getvalue().splitlines() == [
        "ready    8 nodes in 1.2 s",
        "tracing  1 contour  20 touches  2 s",
        "tracing  2 contours  20 touches  bound 0.400 of 0.2 mm  true 0.400 mm  2 s",
        "warning  tracer: the pad slipped",
        "tracing  2 contours  45 touches  bound 0.400 of 0.2 mm  true 0.400 mm  2 s",
    ]


def test_the_bar_goes_from_the_first_bound_to_the_tolerance_by_powers():
    progress = Progress(tolerance=1e-4)
    assert progress_share(progress) == 0.0
    for bound, share in ((1e-2, 0.0), (1e-3, 0.5), (None, 0.5), (1e-4, 1.0), (5e-5, 1.0)):
        progress.estimates.append((1.0, estimate(bound)))
        assert progress_share(progress) == pytest.approx(share)
    progress.tolerance = None
    assert progress_share(progress) == 0.0


def test_the_live_display_shows_bound_bar_and_contour_and_is_taken_away(score, capfd, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    most = [(1.0, estimate(91.977e-3))]
    progress = Progress(
        contours=99, touches=9999, wall=999.0, tolerance=2e-4, estimates=most,
        scores=[(1.0, score)], goal=goal(),
    )  # fmt: skip
    assert len(progress_text(progress)) <= 71
    live = LiveDisplay()
    live.show(progress)
    live.note(record())
    live.close()
    live.close()
    shown = capfd.readouterr().err
    assert "warning  tracer: the pad slipped" in shown
    assert "contour at 35 mm: the widest gap" in shown and "bound 91.977 of 0.2 mm" in shown


def test_the_display_suits_the_terminal_and_silence_is_silent(monkeypatch, score, capfd):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False, raising=False)
    assert type(open_display(quiet=False)) is LineDisplay
    assert type(open_display(quiet=True)) is Display
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert type(open_display(quiet=False)) is LiveDisplay
    silence = Display()
    silence.ready(1, 1.0)
    silence.show(Progress(scores=[(1.0, score)]))
    silence.note(record())
    silence.close()
    assert capfd.readouterr() == ("", "")
