"""How messages travel between processes.

Reliable topics with a handshake by epoch and sequence, a lossy tap for tools, control. To be
tuned: queue depths, memory of the message log, timeouts, each a named constant on top of its
chapter; the order of handshake, log and journal must stay, since restarts without a gap rest on
it. Rests on zmq, and is the only room with sockets.
"""

from palpate.messages.bus.control import (
    FROM_HOSTS,
    FROM_NODES,
    FROM_TOOLS,
    TO_HOSTS,
    TO_NODES,
    TO_TOOLS,
    ControlClient,
    ControlMessage,
    ControlServer,
)
from palpate.messages.bus.handshake import (
    GREETING,
    check_node_name,
    greeting,
    in_step_notice,
    join_call,
    join_cursor,
    read_epoch,
    read_reply,
    read_request,
    resent_frame,
)
from palpate.messages.bus.message_log import (
    Cause,
    Consumed,
    Journal,
    MessageLog,
    OutsideMessage,
    ParameterLog,
    SendTimes,
    SourceProgress,
)
from palpate.messages.bus.node_sockets import (
    LOG_TOPIC,
    PAST_BATCH,
    STATUS_TOPIC,
    NodeSockets,
    PastReader,
    TapReader,
)
from palpate.messages.bus.publisher import Publisher
from palpate.messages.bus.sockets import (
    LAUNCHER,
    QUEUE_DEPTH,
    Addresses,
    SocketContext,
    bind,
    make_key,
)
from palpate.messages.bus.subscriber import Received, Subscriber
