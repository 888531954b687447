"""What the bus loses, which is nothing, and what a message, the lock between machines.

A tool that listens and a start cost. Numbers of messages, stalls and laps may be changed; the
two nodes (`toy_node`, `stalling_node`) are modules by themselves, since a process imports a node
by its module's name, and `start` imports nothing heavy, since it measures that. It rests on the
launcher and on messages.bus, and is one of the few rooms that open sockets.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.bench.bus.cost import TURNS as TURNS
    from palpate.bench.bus.cost import hop_rows as hop_rows
    from palpate.bench.bus.cost import introspection_rows as introspection_rows
    from palpate.bench.bus.cost import lock_rows as lock_rows
    from palpate.bench.bus.losses import loss_rows as loss_rows
    from palpate.bench.bus.losses import reliability_rows as reliability_rows
    from palpate.bench.bus.start import start_rows as start_rows
else:
    __getattr__, __dir__ = lazy(__name__)
