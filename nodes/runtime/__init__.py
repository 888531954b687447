"""What a node is, and how one runs.

In a process of its own, composed with others, or under test, always by the same steps. To be
tuned: heartbeat, poll and flush times on top of `loop` and `sources`; handlers are handed over
in one order whatever the way of running, and that is not to be touched. Rests on
`palpate.messages`; the only part of `palpate.nodes` that reads a clock.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.nodes.runtime.composed import Ending, MessageQueue, Watcher, run_composed
    from palpate.nodes.runtime.loop import FAILED, enter_process
    from palpate.nodes.runtime.node import MAX_FINGERS, RECORDER, AnyNode, Deferred, Finger
    from palpate.nodes.runtime.node import Finished, Input, Node, OnExit, Outputs, RecordedNode
    from palpate.nodes.runtime.node import NotReadyError, Sink, Source, Timed, Wiring
    from palpate.nodes.runtime.node import describe_wirings, is_persistent, load_node
    from palpate.nodes.runtime.node import publishers_of, recorded_nodes
    from palpate.nodes.runtime.node import schemas_of, with_description, with_parameter
    from palpate.nodes.runtime.preloading import PRELOAD_VARIABLE, SAFE_PATH_VARIABLE
    from palpate.nodes.runtime.preloading import THREAD_VARIABLES, open_closed_streams
    from palpate.nodes.runtime.testing import assert_same, drive, example, feed, messages_on
    from palpate.nodes.runtime.testing import recorded
    from palpate.nodes.runtime.work import ContractError, NodeWork, Outgoing, failure_records
    from palpate.nodes.runtime.work import recorded_changes
else:
    __getattr__, __dir__ = lazy(__name__)
