import dataclasses
import io
import json
import sys

from palpate.launch.progress import (
    Display,
    LineDisplay,
    LiveDisplay,
    Progress,
    ProgressWatcher,
    open_display,
    progress_text,
)
from palpate.messages.types.catalogue import LogRecord, NodeStatus


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


def test_plain_lines_come_once_a_score_and_once_a_warning(score):
    stream = io.StringIO()
    lines = LineDisplay(stream)
    progress = Progress(contours=1, touches=40, wall=2.0)
    lines.ready(8, 1.25)
    lines.show(progress)
    progress.scores.append((1.0, score))
    lines.show(progress)
    lines.show(progress)
    for one in (record(), record(), record("all is well", "info")):
        lines.note(one)
    lines.close()
    assert stream.getvalue().splitlines() == [
        "ready    8 nodes in 1.2 s",
        "tracing  1 contours  40 touches  error 0.300 mm (1.000 %)  2 s",
        "warning  tracer: the pad slipped",
    ]


def test_a_line_of_progress_fits_on_a_screen_and_the_live_one_is_taken_away(score, capfd):
    progress = Progress(contours=200, touches=99999, wall=99999.0, scores=[(1.0, score)])
    assert len(progress_text(progress)) <= 70
    live = LiveDisplay()
    live.show(Progress(scores=[(1.0, score)]))
    live.note(record())
    live.close()
    live.close()
    assert "warning  tracer: the pad slipped" in capfd.readouterr().err


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
