"""The processes of a running graph: started, watched, started again, ended without a trace.

The supervisor knows the life of a run; the times after which a node counts as silent, hung or
stalled are constants at the top of each chapter and may be tuned. Rests on palpate.messages.bus
and on the runtime of palpate.nodes.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.launch.processes.fork_server import NODE_ENVIRONMENT as NODE_ENVIRONMENT
    from palpate.launch.processes.fork_server import Interrupts as Interrupts
    from palpate.launch.processes.fork_server import preloaded_modules as preloaded_modules
    from palpate.launch.processes.fork_server import signals_as_ctrl_c as signals_as_ctrl_c
    from palpate.launch.processes.fork_server import start_fork_server as start_fork_server
    from palpate.launch.processes.fork_server import until_ctrl_c as until_ctrl_c
    from palpate.launch.processes.fork_server import without_main_module as without_main_module
    from palpate.launch.processes.node_status import SILENCE as SILENCE
    from palpate.launch.processes.node_status import LauncherSockets as LauncherSockets
    from palpate.launch.processes.process_hosts import ForkServer as ForkServer
    from palpate.launch.processes.process_hosts import ProcessHosts as ProcessHosts
    from palpate.launch.processes.process_hosts import RemoteHost as RemoteHost
    from palpate.launch.processes.registry import FOLDER_PREFIX as FOLDER_PREFIX
    from palpate.launch.processes.registry import MESSAGE_LOG_FOLDER as MESSAGE_LOG_FOLDER
    from palpate.launch.processes.registry import EarlierRun as EarlierRun
    from palpate.launch.processes.registry import RunCard as RunCard
    from palpate.launch.processes.registry import SentMessage as SentMessage
    from palpate.launch.processes.registry import addresses_of as addresses_of
    from palpate.launch.processes.registry import announce as announce
    from palpate.launch.processes.registry import find_run as find_run
    from palpate.launch.processes.registry import message_log_folder as message_log_folder
    from palpate.launch.processes.registry import private_folder as private_folder
    from palpate.launch.processes.registry import remove_stale_folders as remove_stale_folders
    from palpate.launch.processes.registry import running_graphs as running_graphs
    from palpate.launch.processes.registry import runtime_folder as runtime_folder
    from palpate.launch.processes.registry import stale_folders as stale_folders
    from palpate.launch.processes.supervisor import Supervisor as Supervisor
else:
    __getattr__, __dir__ = lazy(__name__)
