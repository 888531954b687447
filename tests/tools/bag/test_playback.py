import os
from types import SimpleNamespace

import pytest

from palpate.launch.files.source_map import InputError
from palpate.tools.bag import playback
from palpate.tools.bag.playback import PLAYER_NAME, RIGHT, SPACE, PlaybackWatcher, read_remap


def test_keys_step_pause_and_resume_the_player_of_this_process(monkeypatch, capsys):
    cards = [SimpleNamespace(pid=pid) for pid in (0, os.getpid())]
    sent = []
    monkeypatch.setattr(playback, "running_graphs", lambda: cards)
    monkeypatch.setattr(playback, "notify", lambda card, kind, **more: sent.append((kind, more)))
    wiring = SimpleNamespace(params=SimpleNamespace(paused=False))
    keys = SimpleNamespace(pressed=lambda: [RIGHT, SPACE, b"x", SPACE])
    watcher = PlaybackWatcher(wiring, quiet=False, keys=keys)
    watcher.tick({PLAYER_NAME: SimpleNamespace(sent=7)})
    node = {"node": PLAYER_NAME}
    assert sent == [("step", {**node, "number": 1}), ("pause", node), ("resume", node)]
    assert capsys.readouterr().out == "paused\ngoes on\n"
    assert watcher.sent == 7


def test_topics_are_renamed_by_pairs():
    assert read_remap(["/a:=/b", "/c:=/d"]) == {"/a": "/b", "/c": "/d"}
    with pytest.raises(InputError, match="--remap /a: must look like"):
        read_remap(["/a"])
