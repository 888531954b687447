"""A run shown in the browser on this machine alone: a recording played, or a graph as it runs.

A view never delays a graph: it receives copies of messages, as palpate topic echo does, and asks
for what was published before, as palpate bag record does.
"""

from __future__ import annotations

import io
import os
import select
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import viser

from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.processes.fork_server import until_ctrl_c
from palpate.launch.processes.registry import RunCard, find_run, running_graphs
from palpate.launch.run_directory import RUNS, SUMMARY, find_bag
from palpate.tools.bag.live_recording import GraphMessages
from palpate.tools.introspection.topics import is_running, message_of, topics_of
from palpate.tools.view.browser import Scene
from palpate.tools.view.panel import FORWARD, SPEEDS, Panel
from palpate.tools.view.timeline import TYPES_DRAWN, Timeline, read_timeline

HOST = "127.0.0.1"
Echo = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveSettings:
    """How a view is served, and how often it is updated."""

    n_ports: int = 20  # ports that are tried, from the requested one on
    tick: float = 0.05  # [s] between two updates
    niceness: int = 10  # added to that of a view beside a run, so that the run has priority
    poll_interval: float = 0.25  # [s] between two checks for a graph that is about to start


DEFAULT_LIVE = LiveSettings()


@dataclass(slots=True)
class View:
    """One view: a timeline, and the robot time that all its clients see."""

    server: viser.ViserServer
    line: Timeline
    recorded: bool
    following: bool = True  # whether a running graph is shown at its latest, else from its start
    when: float = 0.0  # robot time that is shown [s]
    playing: bool = True
    watched: bool = False  # whether a client has connected
    panel: Panel = field(init=False)
    scene: Scene = field(init=False)
    _lock: threading.RLock = field(default_factory=threading.RLock)
    _drawn: Any = None

    def __post_init__(self) -> None:
        self.panel = panel = Panel(self.server.gui, self.recorded, self.following)
        self.scene = Scene(self.server, self.line)
        panel.play.on_click(lambda _: self.toggle())
        panel.steps.on_click(lambda event: self.step(1 if event.target.value == FORWARD else -1))
        panel.slider.on_update(self._scrubbed)
        panel.follow.on_update(lambda event: self.draw())
        panel.on_change(lambda _: self.draw())
        self.server.on_client_connect(self._welcome)
        self.draw()

    def _welcome(self, client: viser.ClientHandle) -> None:
        self.watched, narrow = True, list[bool]()

        def aim(camera: viser.CameraHandle) -> None:
            is_narrow = self.scene.is_narrow(camera.aspect)
            if narrow != [is_narrow]:  # at first, and when the shape of its window is known
                narrow[:] = [is_narrow]
                self.scene.aim(camera)

        aim(client.camera)
        client.camera.on_update(aim)

    def _scrubbed(self, event: Any) -> None:
        if event.client is not None:  # a user moved it, not the passing time
            with self._lock:
                self.seek(self.panel.scrubbed())

    def add(self, messages: list[Any]) -> None:
        """Take messages of a running graph."""
        with self._lock:
            for message in messages:
                self.line.add(message)

    def pass_time(self, seconds: float) -> None:
        """Advance by a time on the clock [s], and prepare one of the solids to come."""
        with self._lock:
            following = not self.recorded and self.panel.follow.value
            if self.playing and following:
                self.when = self.line.end
            elif self.playing and self.watched:
                self.when += seconds * SPEEDS[self.panel.speed.value]
            if self.recorded and self.when >= self.line.end:
                self.when, self.playing = self.line.end, False
            self.when = min(self.when, self.line.end)
            self.draw()
            self.scene.prepare(self.panel.options())

    def finish(self) -> None:
        """Continue as with a recording, when the graph has ended."""
        with self._lock:
            self.recorded = self.panel.recorded = True
            self.panel.follow.visible = False

    def seek(self, when: float) -> None:
        """Show a robot time [s], and pause."""
        with self._lock:
            self.when, self.playing = min(when, self.line.end), False
            self.draw()

    def step(self, count: int) -> None:
        """Show the touch that is `count` touches later, and pause."""
        with self._lock:
            number = self.line.at(self.when).touches - 1 + count
            if 0 <= number < len(self.line.touches):
                self.seek(self.line.touches[number].time)

    def toggle(self) -> None:
        """Pause or play; at its end a recording starts again."""
        with self._lock:
            if not self.playing and self.recorded and self.when >= self.line.end:
                self.when = 0.0
            self.playing = not self.playing
            self.draw()

    def draw(self) -> None:
        """Draw what has changed."""
        with self._lock:
            moment, options = self.line.at(self.when), self.panel.options()
            known = len(self.line.touches), len(self.line.scores), len(self.line.estimates)
            state = (moment, options, known, self.line.truth is None, self.line.known.pad is None)
            if state != self._drawn:
                self._drawn = state
                self.scene.show(moment, options)
            self.panel.play.label = "Pause" if self.playing else "Play"
            self.panel.show(self.line, self.when, moment, self.scene)
            self.panel.plot(self.line, moment, now=not self.playing)


def view_run(
    run: Path | None,
    *,
    port: int,
    attached: bool = False,
    echo: Echo,
    settings: LiveSettings = DEFAULT_LIVE,
) -> None:
    """Show a run until Ctrl-C.

    `run`: its directory, its recording or, while it runs, its name; None: the graph that `find_run`
    returns, or else the last run. `attached`: the run is about to start, and its process holds
    standard input open for as long as the view has to last. Raises InputError if there is no such
    run, or its recording cannot be read.
    """
    with until_ctrl_c() as interrupted:
        ended = _until_parent_ends(interrupted, settings.niceness) if attached else interrupted
        card = None if attached else _running(run)
        line = Timeline() if attached or card is not None else _recorded(run or _last_run())
        with serving(port, settings.n_ports) as server:
            echo(f"view  {address_of(server)}  (Ctrl-C ends it)")
            if attached and run is not None:
                card = _awaited(run, ended, settings.poll_interval)
                if card is None and not ended():
                    line = _recorded(run)
            view = View(server, line, recorded=card is None, following=not attached)
            if card is not None and show_graph(view, card, ended, settings.tick):
                view.finish()
                echo(f"{card.name} has ended; the view stays")
            stay(view, ended, settings.tick)


def _recorded(run: Path) -> Timeline:
    line = read_timeline(run)
    if not line.end:
        raise InputError(f"{run}: holds no touch, contour or solid to show")
    return line


def _awaited(run: Path, ended: Callable[[], bool], poll_interval: float) -> RunCard | None:
    """The graph of a run directory as soon as it runs; None if the run or the view ends first."""
    while not ended() and not (run / SUMMARY).exists():
        if (card := _running(run)) is not None:
            return card
        time.sleep(poll_interval)
    return None


def _until_parent_ends(interrupted: Callable[[], bool], niceness: int) -> Callable[[], bool]:
    """Test for Ctrl-C or the end of standard input, which comes when the parent process ends."""
    os.nice(niceness)

    def ended() -> bool:
        if interrupted():
            return True
        readable, _, _ = select.select([sys.stdin.fileno()], [], [], 0.0)
        return bool(readable) and not os.read(sys.stdin.fileno(), 1)

    return ended


def _running(run: Path | None) -> RunCard | None:
    """The running graph of this name, or the only one without a name; None if there is none."""
    cards = running_graphs()
    if not cards or (run is not None and not any(card.is_called(str(run)) for card in cards)):
        return None
    try:
        return find_run(None if run is None else str(run))
    except ValueError as error:
        raise InputError(str(error)) from None


def _last_run() -> Path:
    try:
        find_bag(RUNS / "latest")
    except InputError:
        raise InputError(
            f"no graph of yours is running, and {RUNS}/latest holds no recording: name a run"
        ) from None
    return RUNS / "latest"


@contextmanager
def serving(port: int, n_ports: int = DEFAULT_LIVE.n_ports) -> Iterator[viser.ViserServer]:
    """A server on this machine alone, at the first free of `n_ports` ports from `port` on.

    Raises InputError if none is free.
    """
    port = _free_port(port, n_ports)
    with redirect_stdout(io.StringIO()):  # viser prints a banner
        server = viser.ViserServer(host=HOST, port=port, label="palpate", verbose=False)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


def _free_port(port: int, n_ports: int) -> int:
    for number in range(port, min(port + n_ports, 1 << 16)):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, number))
            except OSError:
                continue
            return number
    raise InputError(f"--port {port}: it is taken, and so are the {n_ports - 1} after it")


def address_of(server: viser.ViserServer) -> str:
    """Address of a server for browsers on this machine."""
    return f"http://{HOST}:{server.get_port()}"


def show_graph(
    view: View, card: RunCard, ended: Callable[[], bool], tick: float = DEFAULT_LIVE.tick
) -> bool:
    """Show a graph until it or the view ends; returns whether the graph has ended.

    `tick` [s] between two updates. Raises InputError if the graph is of another version of palpate.
    """
    known = topics_of(card).values()
    topics = {topic.name: topic for topic in known if topic.type in TYPES_DRAWN}
    with GraphMessages(card, [*topics.values()]) as messages:
        for batch in messages.batches(tick=tick):
            with as_input_errors():
                view.add([message_of(topics[name], head, body) for name, head, body in batch])
            view.pass_time(tick)
            if ended():
                return False
    return not is_running(card)  # else Ctrl-C came


def stay(view: View, ended: Callable[[], bool], tick: float = DEFAULT_LIVE.tick) -> None:
    """Let time pass, in steps of `tick` [s], until the view has to end."""
    before = time.monotonic()
    while not ended():
        time.sleep(tick)
        now = time.monotonic()
        view.pass_time(now - before)
        before = now
