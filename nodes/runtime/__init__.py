"""What a node is, and how one runs.

In a process of its own, composed with others, or under test, always by the same steps. To be
tuned: heartbeat, poll and flush times on top of `loop` and `sources`; handlers are handed over
in one order whatever the way of running, and that is not to be touched. Rests on
`palpate.messages`; the only part of `palpate.nodes` that reads a clock.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.nodes.runtime.composed import Ending as Ending
    from palpate.nodes.runtime.composed import MessageQueue as MessageQueue
    from palpate.nodes.runtime.composed import Watcher as Watcher
    from palpate.nodes.runtime.composed import run_composed as run_composed
    from palpate.nodes.runtime.loop import FAILED as FAILED
    from palpate.nodes.runtime.loop import enter_process as enter_process
    from palpate.nodes.runtime.node import MAX_FINGERS as MAX_FINGERS
    from palpate.nodes.runtime.node import RECORDER as RECORDER
    from palpate.nodes.runtime.node import AnyNode as AnyNode
    from palpate.nodes.runtime.node import Deferred as Deferred
    from palpate.nodes.runtime.node import Finger as Finger
    from palpate.nodes.runtime.node import Finished as Finished
    from palpate.nodes.runtime.node import Input as Input
    from palpate.nodes.runtime.node import Node as Node
    from palpate.nodes.runtime.node import OnExit as OnExit
    from palpate.nodes.runtime.node import Outputs as Outputs
    from palpate.nodes.runtime.node import RecordedNode as RecordedNode
    from palpate.nodes.runtime.node import Sink as Sink
    from palpate.nodes.runtime.node import Source as Source
    from palpate.nodes.runtime.node import Timed as Timed
    from palpate.nodes.runtime.node import Wiring as Wiring
    from palpate.nodes.runtime.node import describe_wirings as describe_wirings
    from palpate.nodes.runtime.node import is_persistent as is_persistent
    from palpate.nodes.runtime.node import load_node as load_node
    from palpate.nodes.runtime.node import publishers_of as publishers_of
    from palpate.nodes.runtime.node import recorded_nodes as recorded_nodes
    from palpate.nodes.runtime.node import schemas_of as schemas_of
    from palpate.nodes.runtime.node import with_description as with_description
    from palpate.nodes.runtime.preloading import PRELOAD_VARIABLE as PRELOAD_VARIABLE
    from palpate.nodes.runtime.preloading import THREAD_VARIABLES as THREAD_VARIABLES
    from palpate.nodes.runtime.testing import assert_same as assert_same
    from palpate.nodes.runtime.testing import drive as drive
    from palpate.nodes.runtime.testing import example as example
    from palpate.nodes.runtime.testing import feed as feed
    from palpate.nodes.runtime.testing import messages_on as messages_on
    from palpate.nodes.runtime.testing import recorded as recorded
    from palpate.nodes.runtime.work import ContractError as ContractError
    from palpate.nodes.runtime.work import NodeWork as NodeWork
    from palpate.nodes.runtime.work import Outgoing as Outgoing
else:
    __getattr__, __dir__ = lazy(__name__)
