"""Recordings of a running graph from outside, and recordings played again."""

import pytest

from palpate.launch.files.source_map import InputError
from palpate.messages import encode
from palpate.messages.recording import open_recording
from palpate.nodes.runtime.node import recorded_nodes
from palpate.tools.bag.playback import player_entry, read_remap
from tests.tools.recordings import frame
from tests.tools.toy_graph import NODES, Bends


@pytest.mark.parametrize("copied", [True, False])
def test_recording_holds_what_was_published_before_it_began(graph, call, tmp_path, copied):
    frames = [frame(touch) for touch in range(50)]  # more than come in one answer
    for one in frames:
        graph.publish("/t", one, copied=copied)
    graph.publish("/own", Bends(goal=1, curvature=2.0))
    graph.start()
    path = tmp_path / "a.mcap"
    code, out, _ = call("bag record --duration 0.01 -o", path, "--topics", "/t,/own")
    first, last = out.splitlines()
    assert first == f"recording 2 topics of vase into {path}; Ctrl-C ends it"
    assert (code, last) == (0, f"{path}: 51 messages on 2 topics")
    found = open_recording(path)
    bodies = [one.body for one in found.messages() if one.topic == "/t"]
    assert bodies == [encode(one) for one in frames] and found.closed
    assert [one.name for one in recorded_nodes(found.graph)] == [one.name for one in NODES]
    assert call("bag info", path).code == 0


def test_lost_copies_are_asked_for_and_lost_messages_counted(graph, call, tmp_path):
    for touch in range(3):
        graph.publish("/t", frame(touch))
    for seq in (5, 8):  # the talker does not have the others any more
        graph.copy("/t", seq, frame(seq))
    graph.copy("/t", 9, frame(9), run=1)  # of another run
    graph.start()
    path = tmp_path / "a.mcap"
    code, out, _ = call("bag record --duration 0.5 -o", path, "--topics", "/t")
    assert code == 1 and out.endswith("5 messages on 1 topics; not recorded: 4 of /t\n")
    assert [one.seq for one in open_recording(path).messages()] == [0, 1, 2, 5, 8]


def test_recordings_that_cannot_be_are_refused(graph, refusal, tmp_path):
    (tmp_path / "there").touch()
    for topic, name, words in (
        ("/log", "a", "/log cannot be recorded"),
        ("/node/status", "a", "/node/status cannot be recorded"),
        ("/none", "a", "nobody publishes /none"),
        ("/t", "there", "there: exists already; it is not overwritten"),
    ):
        assert words in refusal("bag record -o", tmp_path / name, "--topics", topic)
    assert [one.name for one in tmp_path.iterdir()] == ["there"]


def test_player_publishes_a_recording_under_other_names(record, tmp_path):
    remap = read_remap(["/a:=/b", "/c:=/d"])
    assert remap == {"/a": "/b", "/c": "/d"}
    path = record([("/a", frame(0))])
    entry = player_entry(tmp_path, {"rate": 2.0}, remap)
    assert entry.params == {"path": str(path), "rate": 2.0} and entry.remap == remap
    for wrong in ("/a", "/a:=", ":=/b"):
        with pytest.raises(InputError, match=f"--remap {wrong}: must look like"):
            read_remap([wrong])
