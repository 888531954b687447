"""How messages travel between processes.

Reliable topics with a handshake by epoch and sequence, a lossy tap for tools, control. Times and
sizes are fields of `SocketSettings`, or parameters of the message log. The order of handshake, log
and journal is fixed, since restarts without a gap depend on it. This package uses zmq, and is the
only one with sockets.
"""

from palpate.messages.bus.control import (
    FROM_HOSTS as FROM_HOSTS,
    FROM_NODES as FROM_NODES,
    FROM_TOOLS as FROM_TOOLS,
    TO_HOSTS as TO_HOSTS,
    TO_NODES as TO_NODES,
    TO_TOOLS as TO_TOOLS,
    ControlClient as ControlClient,
    ControlMessage as ControlMessage,
    ControlServer as ControlServer,
)
from palpate.messages.bus.handshake import (
    GREETING as GREETING,
    check_node_name as check_node_name,
    greeting as greeting,
    in_step_notice as in_step_notice,
    join_call as join_call,
    join_cursor as join_cursor,
    read_epoch as read_epoch,
    read_reply as read_reply,
    read_request as read_request,
    resent_frame as resent_frame,
)
from palpate.messages.bus.message_log import (
    Cause as Cause,
    Consumed as Consumed,
    Journal as Journal,
    MessageLog as MessageLog,
    OutsideMessage as OutsideMessage,
    ParameterLog as ParameterLog,
    SendTimes as SendTimes,
    SourceProgress as SourceProgress,
)
from palpate.messages.bus.node_sockets import (
    LOG_TOPIC as LOG_TOPIC,
    PAST_BATCH as PAST_BATCH,
    STATUS_TOPIC as STATUS_TOPIC,
    NodeSockets as NodeSockets,
    PastReader as PastReader,
    TapReader as TapReader,
)
from palpate.messages.bus.publisher import (
    Publisher as Publisher,
)
from palpate.messages.bus.sockets import (
    DEFAULT_QUEUE_DEPTH as DEFAULT_QUEUE_DEPTH,
    LAUNCHER as LAUNCHER,
    Addresses as Addresses,
    SocketContext as SocketContext,
    SocketSettings as SocketSettings,
    bind as bind,
    make_key as make_key,
)
from palpate.messages.bus.subscriber import (
    Received as Received,
    Subscriber as Subscriber,
)
