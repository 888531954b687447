"""How messages travel between processes.

Reliable topics with a handshake by epoch and sequence, a lossy tap for tools, control. To be
tuned: queue depths, memory of the message log, timeouts, each a named constant on top of its
chapter; the order of handshake, log and journal must stay, since restarts without a gap rest on
it. Rests on zmq, and is the only room with sockets.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.messages.bus.control import FROM_HOSTS, FROM_NODES, FROM_TOOLS, TO_HOSTS, TO_NODES
    from palpate.messages.bus.control import TO_TOOLS, ControlClient, ControlMessage, ControlServer
    from palpate.messages.bus.handshake import GREETING, check_node_name, greeting, in_step_notice
    from palpate.messages.bus.handshake import join_call, join_cursor, read_epoch, read_reply
    from palpate.messages.bus.handshake import read_request, resent_frame
    from palpate.messages.bus.message_log import Cause, Consumed, Journal, MessageLog, SendTimes
    from palpate.messages.bus.message_log import OutsideMessage, ParameterLog, SourceProgress
    from palpate.messages.bus.node_sockets import LOG_TOPIC, PAST_BATCH, STATUS_TOPIC, NodeSockets
    from palpate.messages.bus.node_sockets import PastReader, TapReader
    from palpate.messages.bus.publisher import Publisher
    from palpate.messages.bus.sockets import LAUNCHER, QUEUE_DEPTH, Addresses, SocketContext, bind
    from palpate.messages.bus.sockets import make_key
    from palpate.messages.bus.subscriber import Received, Subscriber
else:
    __getattr__, __dir__ = lazy(__name__)
