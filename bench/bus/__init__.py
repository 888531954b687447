"""What a message and the lock between machines cost.

Numbers of laps may be changed; the node (`toy_node`) is a module by itself, since a process imports
a node by its module's name. It rests on the launcher and on messages.bus, and is one of the few
rooms that open sockets.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.bench.bus.cost import finished, ring_times
    from palpate.bench.bus.toy_node import token_ring
else:
    __getattr__, __dir__ = lazy(__name__)
