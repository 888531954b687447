"""A run shown in the browser on this machine alone: a recording played, or a graph as it runs.

A graph is never held up: its messages come as copies, as to palpate topic echo, and what was
published before is asked for, as by palpate bag record.
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
from palpate.tools.view.browser import NARROW, Scene
from palpate.tools.view.panel import FORWARD, SPEEDS, Panel
from palpate.tools.view.timeline import TYPES_DRAWN, Timeline, read_timeline

HOST = "127.0.0.1"
PORTS = 20  # That are tried from the asked one on
TICK = 0.05  # Robot time passes this often, s
NICE = 10  # A view beside a run gives way to it
AWAITED = 0.25  # A graph that is to begin is looked for this often, s
Echo = Callable[[str], None]


@dataclass(slots=True)
class View:
    """One view: a timeline, and where in robot time everybody who looks is."""

    server: viser.ViserServer
    line: Timeline
    recorded: bool
    following: bool = True  # A running graph is shown at its latest, else from its beginning
    when: float = 0.0  # Robot time that is shown, s
    playing: bool = True
    watched: bool = False  # Whether somebody has looked
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
        panel.on_wish(lambda _: self.draw())
        self.server.on_client_connect(self._welcome)
        self.draw()

    def _welcome(self, client: viser.ClientHandle) -> None:
        self.watched, narrow = True, list[bool]()

        def point(camera: viser.CameraHandle) -> None:
            if narrow != [camera.aspect < NARROW]:  # at first, and once its window has its shape
                narrow[:] = [camera.aspect < NARROW]
                self.scene.point(camera)

        point(client.camera)
        client.camera.on_update(point)

    def _scrubbed(self, event: Any) -> None:
        if event.client is not None:  # somebody's hand, and not the time that passes
            with self._lock:
                self.seek(self.panel.scrubbed())

    def add(self, messages: list[Any]) -> None:
        """Take messages of a running graph."""
        with self._lock:
            for one in messages:
                self.line.add(one)

    def pass_time(self, seconds: float) -> None:
        """Let so much time pass; what is to come is made ready meanwhile."""
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
            self.scene.prepare(self.panel.wishes())

    def finish(self) -> None:
        """Go on as with a recording: the graph has ended."""
        with self._lock:
            self.recorded = self.panel.recorded = True
            self.panel.follow.visible = False

    def seek(self, when: float) -> None:
        """Show a robot time, s, and stay there."""
        with self._lock:
            self.when, self.playing = min(when, self.line.end), False
            self.draw()

    def step(self, way: int) -> None:
        """Show the next touch, or the one before, and stay there."""
        with self._lock:
            number = self.line.at(self.when).touches - 1 + way
            if 0 <= number < len(self.line.touches):
                self.seek(self.line.touches[number].time)

    def toggle(self) -> None:
        """Pause or go on; at its end a recording begins anew."""
        with self._lock:
            if not self.playing and self.recorded and self.when >= self.line.end:
                self.when = 0.0
            self.playing = not self.playing
            self.draw()

    def draw(self) -> None:
        """Draw what has changed."""
        with self._lock:
            moment, wishes = self.line.at(self.when), self.panel.wishes()
            known = len(self.line.touches), len(self.line.scores), len(self.line.estimates)
            what = (moment, wishes, known, self.line.truth is None, self.line.known.pad is None)
            if what != self._drawn:
                self._drawn = what
                self.scene.show(moment, wishes)
            self.panel.play.label = "Pause" if self.playing else "Play"
            self.panel.show(self.line, self.when, moment, self.scene)
            self.panel.plot(self.line, moment, now=not self.playing)


def view_run(run: Path | None, *, port: int, attached: bool = False, echo: Echo) -> None:
    """Show a run, named by its directory, its recording or, while it runs, its name, until Ctrl-C.

    Left out: the graph that `find_run` finds, or else the last run. `attached`: the run is about
    to begin, and whoever begins it holds standard input open for as long as the view shall last.
    Raises InputError if there is none, or its recording cannot be read.
    """
    with until_ctrl_c() as interrupted:
        ended = _until_parent_ends(interrupted) if attached else interrupted
        card = None if attached else _running(run)
        line = Timeline() if attached or card is not None else _recorded(run or _last_run())
        with serving(port) as server:
            echo(f"view  {address_of(server)}  (Ctrl-C ends it)")
            if attached and run is not None:
                card = _awaited(run, ended)
                if card is None and not ended():
                    line = _recorded(run)
            view = View(server, line, recorded=card is None, following=not attached)
            if card is not None and show_graph(view, card, ended):
                view.finish()
                echo(f"{card.name} has ended; the view stays")
            stay(view, ended)


def _recorded(run: Path) -> Timeline:
    line = read_timeline(run)
    if not line.end:
        raise InputError(f"{run}: holds no touch, contour or solid to show")
    return line


def _awaited(run: Path, ended: Callable[[], bool]) -> RunCard | None:
    """The graph of a run directory, once it runs; None if it is over, or the view is to end."""
    while not ended() and not (run / SUMMARY).exists():
        if (card := _running(run)) is not None:
            return card
        time.sleep(AWAITED)
    return None


def _until_parent_ends(interrupted: Callable[[], bool]) -> Callable[[], bool]:
    """Tells whether Ctrl-C came, or standard input has ended: that of a parent that was killed."""
    os.nice(NICE)

    def ended() -> bool:
        if interrupted():
            return True
        readable, _, _ = select.select([sys.stdin.fileno()], [], [], 0.0)
        return bool(readable) and not os.read(sys.stdin.fileno(), 1)

    return ended


def _running(run: Path | None) -> RunCard | None:
    """The running graph that is meant, if there is one."""
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
        told = f"no graph of yours is running, and {RUNS}/latest holds no recording: name a run"
        raise InputError(told) from None
    return RUNS / "latest"


@contextmanager
def serving(port: int) -> Iterator[viser.ViserServer]:
    """A server on this machine alone, at the port or the next that is free."""
    with redirect_stdout(io.StringIO()):  # it greets with a banner
        server = viser.ViserServer(host=HOST, port=_free_port(port), label="palpate", verbose=False)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


def _free_port(port: int) -> int:
    for one in range(port, min(port + PORTS, 1 << 16)):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, one))
            except OSError:
                continue
            return one
    raise InputError(f"--port {port}: it is taken, and so are the {PORTS - 1} after it")


def address_of(server: viser.ViserServer) -> str:
    """Where a browser on this machine finds it."""
    return f"http://{HOST}:{server.get_port()}"


def show_graph(view: View, card: RunCard, ended: Callable[[], bool]) -> bool:
    """Show a graph until it ends, then true, or until the view is to end.

    Raises InputError if the graph was started by another version of palpate.
    """
    known = topics_of(card).values()
    topics = {one.name: one for one in known if one.type in TYPES_DRAWN}
    with GraphMessages(card, [*topics.values()]) as messages:
        for batch in messages.batches(tick=TICK):
            with as_input_errors():
                view.add([message_of(topics[name], head, body) for name, head, body in batch])
            view.pass_time(TICK)
            if ended():
                return False
    return not is_running(card)  # else it was Ctrl-C


def stay(view: View, ended: Callable[[], bool]) -> None:
    """Let time pass until it is ended."""
    before = time.monotonic()
    while not ended():
        time.sleep(TICK)
        now = time.monotonic()
        view.pass_time(now - before)
        before = now
