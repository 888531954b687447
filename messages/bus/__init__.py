"""How messages travel between processes.

Reliable topics with a handshake by epoch and sequence, a lossy tap for tools, control. To be
tuned: queue depths, memory of the message log, timeouts, each a named constant on top of its
chapter; the order of handshake, log and journal must stay, since restarts without a gap rest on
it. Rests on zmq, and is the only room with sockets.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.messages.bus.control import FROM_HOSTS as FROM_HOSTS
    from palpate.messages.bus.control import FROM_NODES as FROM_NODES
    from palpate.messages.bus.control import FROM_TOOLS as FROM_TOOLS
    from palpate.messages.bus.control import TO_HOSTS as TO_HOSTS
    from palpate.messages.bus.control import TO_NODES as TO_NODES
    from palpate.messages.bus.control import TO_TOOLS as TO_TOOLS
    from palpate.messages.bus.control import ControlClient as ControlClient
    from palpate.messages.bus.control import ControlMessage as ControlMessage
    from palpate.messages.bus.control import ControlServer as ControlServer
    from palpate.messages.bus.handshake import GREETING as GREETING
    from palpate.messages.bus.handshake import check_node_name as check_node_name
    from palpate.messages.bus.handshake import greeting as greeting
    from palpate.messages.bus.handshake import in_step_notice as in_step_notice
    from palpate.messages.bus.handshake import join_call as join_call
    from palpate.messages.bus.handshake import join_cursor as join_cursor
    from palpate.messages.bus.handshake import read_epoch as read_epoch
    from palpate.messages.bus.handshake import read_reply as read_reply
    from palpate.messages.bus.handshake import read_request as read_request
    from palpate.messages.bus.handshake import resent_frame as resent_frame
    from palpate.messages.bus.message_log import Cause as Cause
    from palpate.messages.bus.message_log import Consumed as Consumed
    from palpate.messages.bus.message_log import Journal as Journal
    from palpate.messages.bus.message_log import MessageLog as MessageLog
    from palpate.messages.bus.message_log import SendTimes as SendTimes
    from palpate.messages.bus.message_log import SourceProgress as SourceProgress
    from palpate.messages.bus.node_sockets import LOG_TOPIC as LOG_TOPIC
    from palpate.messages.bus.node_sockets import STATUS_TOPIC as STATUS_TOPIC
    from palpate.messages.bus.node_sockets import NodeSockets as NodeSockets
    from palpate.messages.bus.node_sockets import TapReader as TapReader
    from palpate.messages.bus.publisher import Publisher as Publisher
    from palpate.messages.bus.sockets import LAUNCHER as LAUNCHER
    from palpate.messages.bus.sockets import QUEUE_DEPTH as QUEUE_DEPTH
    from palpate.messages.bus.sockets import Addresses as Addresses
    from palpate.messages.bus.sockets import SocketContext as SocketContext
    from palpate.messages.bus.sockets import bind as bind
    from palpate.messages.bus.sockets import make_key as make_key
    from palpate.messages.bus.subscriber import Received as Received
    from palpate.messages.bus.subscriber import Subscriber as Subscriber
else:
    __getattr__, __dir__ = lazy(__name__)
