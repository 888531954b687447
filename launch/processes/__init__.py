"""The processes of a running graph: started, watched, started again, ended without a trace.

The supervisor knows the life of a run; the times after which a node counts as silent, hung or
stalled are constants at the top of each chapter and may be tuned. Rests on palpate.messages.bus
and on the runtime of palpate.nodes.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.launch.processes.fork_server import NODE_ENVIRONMENT, Interrupts, preloaded_modules
    from palpate.launch.processes.fork_server import signals_as_ctrl_c, start_fork_server
    from palpate.launch.processes.fork_server import until_ctrl_c, without_main_module
    from palpate.launch.processes.node_status import (
        SILENCE,
        LauncherSockets,
        check_open_files,
        open_files_needed,
    )
    from palpate.launch.processes.process_table import ForkServer, ProcessHosts, RemoteHost
    from palpate.launch.processes.registry import FOLDER_PREFIX, GRAPH_VARIABLE, LONGEST_SOCKET
    from palpate.launch.processes.registry import MESSAGE_LOG_FOLDER
    from palpate.launch.processes.registry import Announcement, EarlierRun, RunCard, SentMessage
    from palpate.launch.processes.registry import (
        addresses_of,
        find_run,
        message_log_folder,
        private_folder,
    )
    from palpate.launch.processes.registry import RUNS_FOLDER, remove_stale_folders, running_graphs
    from palpate.launch.processes.registry import runtime_folder, stale_folders
    from palpate.launch.processes.supervisor import Supervisor
else:
    __getattr__, __dir__ = lazy(__name__)
