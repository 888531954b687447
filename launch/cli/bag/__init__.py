"""``palpate bag``: what a recording holds, and what can be made of it."""

from __future__ import annotations

from palpate.launch.cli.verbs import Verbs

command = Verbs(
    "bag",
    "palpate.launch.cli.bag",
    {
        "info": "Say what a recording holds.",
        "play": "Say again what a recording holds, at its own pace.",
        "pause": "Have a player stand still.",
        "resume": "Have a player go on.",
        "step": "Have a player that stands still say the next message.",
        "recover": "Save what is whole of a damaged recording.",
        "diff": "Name the first message in which two recordings differ.",
        "export": "Write a recording in a format that other programs read.",
    },
    "Look into recordings, play, recover and compare them, and hand them on.",
)
