"""``palpate bag``: what can be done with recordings."""

from __future__ import annotations

from palpate.launch.cli.verbs import Verbs

command = Verbs(
    "bag",
    "palpate.launch.cli.bag",
    {
        "diff": "Compare two recordings, message by message.",
    },
    "Look into recordings, recover, compare and export them.",
)
