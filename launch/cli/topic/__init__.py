"""``palpate topic``: the topics of a running graph."""

from __future__ import annotations

from palpate.launch.cli.verbs import Verbs

command = Verbs(
    "topic",
    "palpate.launch.cli.topic",
    {"pub": "Publish a message on a console's topic."},
    "Hear and speak on the topics of a running graph.",
)
