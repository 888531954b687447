"""``palpate param``: the parameters of a running graph's nodes."""

from __future__ import annotations

from palpate.launch.cli.verbs import Verbs

command = Verbs(
    "param",
    "palpate.launch.cli.param",
    {"dump": "Print parameters in YAML."},
    "Look at the parameters of a running graph's nodes.",
)
