"""``palpate topic``: the topics of a running graph."""

from __future__ import annotations

from palpate.launch.cli.verbs import Verbs

command = Verbs(
    "topic",
    "palpate.launch.cli.topic",
    {
        "list": "Name the topics.",
        "info": "Say what a topic carries, from whom to whom.",
        "echo": "Print the messages of a topic.",
        "hz": "Measure how often topics are published.",
        "bw": "Measure how many bytes topics carry.",
        "delay": "Measure how long messages are on their way.",
        "pub": "Publish a message on a console's topic.",
    },
    "Hear and speak on the topics of a running graph.",
)
