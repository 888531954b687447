"""Graphs on several machines: addresses and the key, remote machines, the agent that lends one.

Only the key file decides who may start processes: change nothing there without reading
docs/bus.md. Rests on launch.processes, whose protocol it speaks over the network.
"""

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.launch.hosts.remote_hosts import RemoteHosts as RemoteHosts
    from palpate.launch.hosts.remote_hosts import free_endpoints as free_endpoints
    from palpate.launch.hosts.remote_hosts import key_file as key_file
    from palpate.launch.hosts.remote_hosts import read_host as read_host
    from palpate.launch.hosts.remote_hosts import run_host_agent as run_host_agent
else:
    __getattr__, __dir__ = lazy(__name__)
