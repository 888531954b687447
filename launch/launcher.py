"""Launch a graph: every node a process of its own, watched from the start to the end."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from palpate.launch.processes.desk import Desk
from palpate.launch.processes.folder import place_of, private_folder
from palpate.launch.processes.interrupts import Interrupts
from palpate.launch.processes.nursery import Nursery
from palpate.launch.processes.supervisor import Supervisor
from palpate.messages.bus.join import check_name
from palpate.messages.bus.place import DEPTH, LAUNCHER
from palpate.nodes.ending import Ending, Watcher
from palpate.nodes.wiring import Wiring


def launch(
    wirings: Sequence[Wiring],
    *,
    ends: str,
    hear: Sequence[str],
    watcher: Watcher,
    work_dir: Path | None = None,
    depth: int = DEPTH,
) -> Ending:
    """Run a graph until it ends, and leave nothing behind.

    Parameters
    ----------
    wirings : sequence of Wiring
        The nodes.
    ends : str
        Name of the node whose `Finished` ends the graph.
    hear : sequence of str
        Topics of which the watcher is told every message.
    watcher : Watcher
        Is told what happens. What it raises ends the graph, and is raised again.
    work_dir : Path, optional
        Where the private folder of the sockets is made; by default where such folders belong.
    depth : int
        Most messages in a queue between two nodes.

    Returns
    -------
    Ending
        How it ended. A Ctrl-C, SIGTERM or SIGHUP ends it as ``interrupted``.

    Raises
    ------
    ValueError
        If the wirings do not fit together, or the folder cannot be made or has too long a path;
        no process has been started then.
    RuntimeError
        If this is not the main thread.
    """
    began = time.monotonic()
    _check(wirings, ends)
    sources = _sources(wirings, hear)
    names = [wiring.name for wiring in wirings]
    with Interrupts() as interrupts, private_folder(work_dir) as folder:
        place = place_of(folder, names, depth)
        modules = [wiring.module for wiring in wirings]
        with Desk(place, sources) as desk, Nursery(modules) as nursery:
            supervisor = Supervisor(
                [_with_launcher(wiring, hear) for wiring in wirings],
                ends=ends,
                sources=sources,
                watcher=watcher,
                place=place,
                desk=desk,
                nursery=nursery,
                interrupts=interrupts,
            )
            return supervisor.run(began)


def _check(wirings: Sequence[Wiring], ends: str) -> None:
    names = [check_name(wiring.name) for wiring in wirings]
    if LAUNCHER in names:
        raise ValueError(f"no node may be called {LAUNCHER!r}: that is the launcher's own name")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"each node needs a name of its own, {twice[0]!r} is there twice")
    if ends not in names:
        raise ValueError(f"no node {ends!r} that could end the graph; there are {sorted(names)}")
    said = {(wiring.name, topic) for wiring in wirings for topic in wiring.outputs.values()}
    for wiring in wirings:
        topics = [one.topic for one in wiring.inputs]
        twice = sorted({topic for topic in topics if topics.count(topic) > 1})
        if twice:
            raise ValueError(f"{wiring.name} hears {twice[0]} twice, once is enough")
        for one in wiring.inputs:
            if (one.publisher, one.topic) not in said:
                raise ValueError(
                    f"{wiring.name} hears {one.topic} from {one.publisher}, who does not publish it"
                )


def _sources(wirings: Sequence[Wiring], hear: Sequence[str]) -> dict[str, list[str]]:
    """Who publishes each topic that the launcher hears."""
    publisher = {topic: w.name for w in wirings for topic in w.outputs.values()}
    sources: dict[str, list[str]] = {}
    for topic in hear:
        if topic not in publisher:
            raise ValueError(f"nobody publishes {topic}; there are {sorted(publisher)}")
        sources.setdefault(publisher[topic], []).append(topic)
    return sources


def _with_launcher(wiring: Wiring, hear: Sequence[str]) -> Wiring:
    listeners = dict(wiring.listeners)
    for topic in set(hear) & set(wiring.outputs.values()):
        known = listeners.get(topic, ())
        listeners[topic] = known if LAUNCHER in known else (*known, LAUNCHER)
    return replace(wiring, listeners=listeners)
