"""``palpate bag``: what a recording holds, and what can be made of it."""

from __future__ import annotations

from palpate.launch.cli.verbs import Verbs

command = Verbs(
    "bag",
    "palpate.launch.cli.bag",
    {
        "info": "Say what a recording holds.",
        "recover": "Save what is whole of a damaged recording.",
        "export": "Write a recording in a format that other programs read.",
    },
    "Look into recordings, recover them, and hand them on.",
)
