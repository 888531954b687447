"""``palpate node``: the nodes of a running graph, and the kinds of node that there are."""

from __future__ import annotations

from palpate.launch.cli.verbs import Verbs

command = Verbs(
    "node",
    "palpate.launch.cli.node",
    {
        "list": "Name the nodes of a running graph.",
        "info": "Say how a running node is doing, what it hears and says.",
        "kinds": "List the kinds of node and what they hear and say.",
    },
    "Look at the nodes of a running graph, or at the kinds of node.",
)
