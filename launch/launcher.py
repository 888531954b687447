"""Launch a graph: each node is a process, and all are watched until the end."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Self

from palpate.core.plugins import entry_points_of
from palpate.launch.graph import HOSTS
from palpate.launch.processes.fork_server import Interrupts
from palpate.launch.processes.node_status import (
    DEFAULT_SUPERVISION,
    LauncherSockets,
    SupervisionSettings,
    check_open_files,
)
from palpate.launch.processes.process_table import (
    DEFAULT_HOST_SETTINGS,
    ForkServer,
    HostSettings,
    NodeHost,
    ProcessHosts,
)
from palpate.launch.processes.registry import (
    Announcement,
    EarlierRun,
    RunCard,
    addresses_of,
    message_log_folder,
    private_folder,
)
from palpate.launch.processes.supervisor import Supervisor
from palpate.messages.bus import DEFAULT_QUEUE_DEPTH, LAUNCHER, Addresses, check_node_name
from palpate.nodes.runtime.composed import Ending, Watcher
from palpate.nodes.runtime.node import Wiring, describe_wirings, recorded_nodes


def launch(
    wirings: Sequence[Wiring],
    *,
    ends: str,
    watch: Sequence[str],
    watcher: Watcher,
    name: str = "graph",
    run_dir: Path | None = None,
    work_dir: Path | None = None,
    depth: int = DEFAULT_QUEUE_DEPTH,
    before: EarlierRun | None = None,
    settings: SupervisionSettings = DEFAULT_SUPERVISION,
    host_settings: HostSettings = DEFAULT_HOST_SETTINGS,
) -> Ending:
    """Run a graph until it ends, and remove its processes and private files.

    `ends`: name of the node whose `Finished` ends the graph. `watch`: topics of the messages that
    the `watcher` gets; its exceptions end the graph, and are raised. `name`: by which tools find
    the run. `run_dir`: the folder for messages that exceed the memory of nodes. `work_dir`: parent
    of the private folder of the sockets, by default `runtime_folder`. `depth`: maximum number of
    messages in a queue between two nodes. `before`: an earlier run that this one continues.

    Returns how it ended; Ctrl-C, SIGTERM or SIGHUP end it as ``interrupted``. Raises ValueError
    before any process is started if the wirings do not fit together, the folder cannot be made or
    has too long a path, or another machine gives no answer; RuntimeError if this is not the main
    thread.
    """
    began = time.monotonic()
    _check(wirings, ends)
    check_open_files(len(wirings))
    sources = _sources(wirings, watch)
    names = [wiring.name for wiring in wirings]
    with (
        Interrupts() as interrupts,
        private_folder(work_dir) as folder,
        message_log_folder(run_dir, folder) as past,
        _machines(wirings, f"{name} {folder.name}", host_settings) as remote,
    ):
        place = remote.reach(addresses_of(folder, names, depth, past))
        with (
            LauncherSockets(place, sources) as sockets,
            ForkServer([wiring.module for wiring in wirings], host_settings) as server,
        ):
            hosts = ProcessHosts(server, remote.nodes)
            complete = _with_subscribers(wirings, watch)
            if before is not None:
                before.write(complete, place)
            card = _card(wirings, place, name, ends, run_dir)
            return Supervisor(
                complete,
                ends=ends,
                sources=sources,
                watcher=watcher,
                place=place,
                sockets=sockets,
                announcement=Announcement(folder, card),
                hosts=hosts,
                ahead_ns=remote.ahead_ns,
                interrupts=interrupts,
                going=before is not None,
                settings=settings,
            ).run(began)


class ThisMachine:
    """The machines of a graph with all nodes on this machine."""

    nodes: Mapping[str, NodeHost] = {}  # machines of nodes that run elsewhere

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def reach(self, place: Addresses) -> Addresses:
        """`place` with addresses that all machines can reach."""
        return place

    def ahead_ns(self, name: str) -> int:
        """How far this machine's clock is ahead of that of a node's machine [ns]."""
        return 0


def _machines(wirings: Sequence[Wiring], run: str, settings: HostSettings) -> ThisMachine:
    """The machines of a graph; `launch.graph` has checked that other machines are supported."""
    if not any(wiring.host for wiring in wirings):
        return ThisMachine()
    machines: ThisMachine = entry_points_of(HOSTS)["machines"].load()(wirings, run, settings)
    return machines


def _card(
    wirings: Sequence[Wiring], place: Addresses, name: str, ends: str, run_dir: Path | None
) -> RunCard:
    return RunCard(
        run=f"{place.run:016x}",
        name=name,
        pid=os.getpid(),
        began=time.strftime("%Y-%m-%dT%H:%M:%S"),
        folder="" if run_dir is None else str(run_dir.resolve()),
        started_in=os.getcwd(),
        ends=ends,
        nodes=recorded_nodes(describe_wirings(wirings)),
        taps=dict(place.taps),
        tools=place.tools,
        key=place.key,
    )


def _check(wirings: Sequence[Wiring], ends: str) -> None:
    names = [check_node_name(wiring.name) for wiring in wirings]
    if LAUNCHER in names:
        raise ValueError(f"no node may be named {LAUNCHER!r}: that is the name of the launcher")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"each node needs its own name, and {twice[0]!r} occurs twice")
    if ends not in names:
        raise ValueError(f"no node {ends!r} that can end the graph; there are {sorted(names)}")
    published = {(wiring.name, topic) for wiring in wirings for topic in wiring.outputs.values()}
    for wiring in wirings:
        topics = [edge.topic for edge in wiring.inputs]
        twice = sorted({topic for topic in topics if topics.count(topic) > 1})
        if twice:
            raise ValueError(f"{wiring.name} subscribes to {twice[0]} twice, once is enough")
        for edge in wiring.inputs:
            if (edge.publisher, edge.topic) not in published:
                raise ValueError(
                    f"{wiring.name} subscribes to {edge.topic} of {edge.publisher}, "
                    "who does not publish it"
                )


def _sources(wirings: Sequence[Wiring], watch: Sequence[str]) -> dict[str, list[str]]:
    """Topics to which the launcher subscribes, by publisher."""
    publisher = {topic: w.name for w in wirings for topic in w.outputs.values()}
    sources: dict[str, list[str]] = {}
    for topic in watch:
        if topic not in publisher:
            raise ValueError(f"no node publishes {topic}; there are {sorted(publisher)}")
        sources.setdefault(publisher[topic], []).append(topic)
    return sources


def _with_subscribers(wirings: Sequence[Wiring], watch: Sequence[str]) -> list[Wiring]:
    """The wirings, each with all subscribers of its topics."""
    subscribers: dict[str, list[str]] = {topic: [LAUNCHER] for topic in watch}
    for wiring in wirings:
        for edge in wiring.inputs:
            subscribers.setdefault(edge.topic, []).append(wiring.name)
    return [
        replace(w, subscribers={t: tuple(subscribers.get(t, ())) for t in w.outputs.values()})
        for w in wirings
    ]
