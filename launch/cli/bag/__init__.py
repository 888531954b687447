"""``palpate bag``: what can be done with recordings."""

from __future__ import annotations

from palpate.launch.cli.verbs import Verbs

command = Verbs(
    "bag",
    "palpate.launch.cli.bag",
    {
        "play": "Say again what a recording holds, at its own pace.",
        "pause": "Have a player stand still.",
        "resume": "Have a player go on.",
        "step": "Have a player that stands still say the next message.",
        "diff": "Name the first message in which two recordings differ.",
    },
    "Look into recordings, recover, compare, export and play them.",
)
