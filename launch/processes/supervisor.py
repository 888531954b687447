"""Supervision of one graph: it is started, watched and ended, and tools are answered.

Answers to a tool that has been stopped or killed are dropped.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import count
from typing import Any, Literal, NamedTuple

from palpate.launch.processes.fork_server import Interrupts
from palpate.launch.processes.node_status import (
    DEFAULT_SUPERVISION,
    Edge,
    LauncherSockets,
    MessageCounts,
    NodeStatusTable,
    SupervisionSettings,
    TerminationDetector,
)
from palpate.launch.processes.process_table import ProcessHosts, ProcessTable
from palpate.launch.processes.registry import Announcement
from palpate.messages import decode
from palpate.messages.bus import LAUNCHER, Addresses, ControlMessage, ControlServer
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.runtime.composed import Ending, Watcher
from palpate.nodes.runtime.loop import FAILED
from palpate.nodes.runtime.node import (
    AnyNode,
    Node,
    Sink,
    Source,
    Wiring,
    load_node,
    with_parameter,
)


class Verdict(NamedTuple):
    """How a graph ends."""

    status: Literal["finished", "died", "stalled", "interrupted"]
    reason: str


class Supervisor:
    """Starts and watches the processes of one graph until the node `ends` has finished.

    `sources`: the topics to which the launcher itself subscribes, by publisher. `ahead_ns` returns
    how far this machine's clock is ahead of that of a node's machine [ns]. `going`: the nodes
    continue an earlier run, without waiting for each other.
    """

    def __init__(
        self,
        wirings: Sequence[Wiring],
        *,
        ends: str,
        sources: Mapping[str, Sequence[str]],
        watcher: Watcher,
        place: Addresses,
        sockets: LauncherSockets,
        announcement: Announcement,
        hosts: ProcessHosts,
        ahead_ns: Callable[[str], int],
        interrupts: Interrupts,
        going: bool = False,
        settings: SupervisionSettings = DEFAULT_SUPERVISION,
    ) -> None:
        self._wirings, self._ends, self._settings = wirings, ends, settings
        self._watcher, self._sockets = watcher, sockets
        self._hosts, self._interrupts = hosts, interrupts
        names = [wiring.name for wiring in wirings]
        edges = [Edge(w.name, i.publisher, i.topic) for w in wirings for i in w.inputs]
        edges += [Edge(LAUNCHER, source, topic) for source in sources for topic in sources[source]]
        self._detector = TerminationDetector([*names, LAUNCHER], edges, settings.answer_time)
        timeouts = {wiring.name: wiring.handler_timeout for wiring in wirings}
        self._reports = NodeStatusTable(names, timeouts, settings.silence_limit)
        self._processes = ProcessTable(wirings, place, hosts, sockets, ahead_ns)
        lines = sockets.tools, sockets.line
        self._tools = ToolServer(*lines, self._processes, self._reports, announcement)
        self._finished: str | None = None
        self._going, self._stopping = going, False
        self._next_tick = 0.0

    def run(self, began: float) -> Ending:
        """Start all nodes and watch them to the end; `began`: monotonic time of the launch [s]."""
        verdict = self._start() or self._watch(began)
        if verdict.status == "finished":
            verdict = self._stop() or verdict
        self._hosts.end()
        self._receive_reports()
        if verdict.status == "died" and self._interrupts.came and not self._reports.failed:
            verdict = self._interrupted()  # a signal to the whole group ended a node first
        statuses, subscriber = self._reports.statuses, self._sockets.subscriber
        return Ending(
            status=verdict.status,
            reason=verdict.reason,
            statuses=statuses,
            gaps=subscriber.gaps + sum(status.gaps for status in statuses.values()),
            duplicates=subscriber.duplicates + sum(s.duplicates for s in statuses.values()),
            restarts={name: n for name, n in self._processes.restarts.counts.items() if n},
        )

    def _start(self) -> Verdict | None:
        for wiring in self._wirings:
            if self._interrupts.came:
                return self._interrupted()
            try:
                self._processes.spawn(wiring.name, going=self._going)
                self._hosts.receive()  # otherwise other machines consider a busy launcher lost
            except ChildProcessError as error:
                return Verdict("died", str(error))
        return None

    def _watch(self, began: float) -> Verdict:
        names = {wiring.name for wiring in self._wirings}
        while True:
            verdict = self._turn() or self._finished_or_stalled()
            if verdict is not None:
                return verdict
            if self._going:
                self._ask_for_counts()
            elif self._reports.ready == names and self._sockets.subscriber.in_step:
                self._going = True
                self._tell(names, "go")
                self._processes.let_begin()
                self._watcher.ready(time.monotonic() - began)

    def _stop(self) -> Verdict | None:
        """Stop all nodes; returns a verdict if that fails."""
        self._stopping = True
        self._tell(self._processes.living, "stop")
        deadline = time.monotonic() + self._settings.stop_time
        while self._processes.living:
            verdict = self._turn()
            if verdict is not None:
                return verdict
            if time.monotonic() > deadline:
                late = ", ".join(self._processes.living)
                return Verdict("died", f"{late} did not stop within {self._settings.stop_time:g} s")
        return None

    def _turn(self) -> Verdict | None:
        """Wait for events and handle them; returns a verdict if one of them ends the graph."""
        ended = self._sockets.wait(5 if self._finished else 50)
        self._hosts.receive()
        self._receive_reports()
        self._receive_messages()
        self._tools.serve()
        self._tick()
        died = [verdict for sentinel in ended if (verdict := self._bury(sentinel))]
        if self._interrupts.came:
            return self._interrupted()
        if LAUNCHER in self._reports.failed:
            return Verdict("died", f"{LAUNCHER} failed while {self._reports.failed[LAUNCHER]}")
        return died[0] if died else None

    def _bury(self, sentinel: int) -> Verdict | None:
        name, code = self._processes.bury(sentinel)
        report_time = self._settings.report_time if code in (0, FAILED) else 0.0
        deadline = time.monotonic() + report_time
        while name not in self._reports.failed and name not in self._reports.exiting:
            if time.monotonic() >= deadline:
                break
            self._sockets.wait(10)
            self._receive_reports()
        if name in self._reports.exiting:
            return None
        failed = self._reports.left(name)
        self._tools.buried(name)
        return self._after_death(name, self._processes.how_it_died(name, code, failed), failed)

    def _after_death(self, name: str, how: str, failed: str | None) -> Verdict | None:
        """Restart a node that has died, or continue without it; a verdict if the run must end."""
        wiring = self._processes.wirings[name]
        if self._interrupts.came:
            return self._interrupted()
        if self._stopping and wiring.outputs:
            return None  # it has nothing more to publish, and no file to write
        if wiring.on_exit == "ignore":
            self._warn(name, f"{name} {how}; the run goes on without it")
            self._detector.drop(name)
            return None
        refusal: str | None = f"{name} {how}"
        # A node that fails while it starts or stops would fail again.
        if failed is None or (self._going and not self._stopping):
            now = time.monotonic()
            refusal = self._processes.restarts.refusal(name, how, failed is not None, now)
        if refusal is not None:
            return Verdict("died", refusal)
        self._warn(name, f"{name} {how}; it is started again")
        try:
            self._processes.spawn(name, going=self._going)
        except ChildProcessError as error:
            return Verdict("died", str(error))
        return None

    def _warn(self, name: str, text: str) -> None:
        self._watcher.log(LogRecord(node=name, level="warning", text=text[:1000], robot_time=0.0))

    def _finished_or_stalled(self) -> Verdict | None:
        if self._finished is not None and self._detector.settled:
            return Verdict("finished", self._finished)
        if self._detector.still_for(time.monotonic()) < self._settings.stall_time:
            return None
        gaps = {name: status.gaps for name, status in self._reports.statuses.items()}
        faults = [f"{name} misses {count} messages" for name, count in gaps.items() if count]
        faults += self._detector.complaints()
        state = "has finished, yet" if self._finished is not None else "has not finished, and"
        stall = f"nothing has moved for {self._settings.stall_time:g} s"
        why = "; ".join(faults) or "every message was consumed"
        return Verdict("stalled", f"{self._ends} {state} {stall}: {why}")

    def _interrupted(self) -> Verdict:
        return Verdict("interrupted", f"{self._interrupts.came} was received")

    def _receive_reports(self) -> None:
        try:
            while (report := self._sockets.line.receive()) is not None:
                name, word = report
                for line in self._reports.receive(name, word):
                    self._watcher.log(line)
                self._processes.sign(name, word["kind"])
                if self._stopping and word["kind"] == "alive":
                    self._sockets.line.send(name, "stop")
                if word["kind"] == "finished" and name == self._ends and self._finished is None:
                    self._finished = str(word["reason"])
                    self._detector.forget()
                elif word["kind"] == "acknowledged":
                    self._tools.done(word["ticket"])
                elif word["kind"] == "refused":
                    self._tools.refused(word["ticket"], str(word["text"]), again=word["again"])
                elif word["kind"] == "count":
                    consumed = {(p, t): number for p, t, number in word["consumed"]}
                    counts = word["sent"], consumed, tuple(word["waits"]), word["can_publish"]
                    self._take_counts(name, word["round"], MessageCounts(*counts))
        except ValueError as error:
            self._reports.failed[LAUNCHER] = f"listening to the nodes: {error}"

    def _receive_messages(self) -> None:
        for _ in range(self._settings.max_batch):
            try:
                message, tapped = self._sockets.receive(), self._sockets.receive_tap()
            except ValueError as error:
                self._reports.failed[LAUNCHER] = f"receiving: {error}"
                return
            if message is not None:
                self._watcher.received(*message)
            if isinstance(tapped, NodeStatus):
                self._reports.statuses[tapped.node] = tapped
            elif isinstance(tapped, LogRecord):
                self._watcher.log(tapped)
            if message is None and tapped is None:
                return

    def _tick(self) -> None:
        now = time.monotonic()
        if now >= self._next_tick:
            self._next_tick = now + self._settings.tick_period
            self._processes.kill_hung(now)
            for line in self._reports.silent(now):
                self._watcher.log(line)
            self._watcher.tick(self._reports.statuses)

    def _ask_for_counts(self) -> None:
        round_ = self._detector.round
        for name in self._detector.to_ask(time.monotonic()):
            if name == LAUNCHER:
                self._take_counts(LAUNCHER, round_, MessageCounts({}, dict(self._sockets.consumed)))
            else:
                self._sockets.line.send(name, "count", round=round_)

    def _take_counts(self, name: str, round_: int, count: MessageCounts) -> None:
        is_running, settings = self._finished is None, self._settings
        pause = settings.count_pause if is_running else settings.final_count_pause
        self._detector.answer(name, round_, count, time.monotonic(), pause)

    def _tell(self, names: Iterable[str], kind: str) -> None:
        for name in names:
            self._sockets.line.send(name, kind)


class ToolServer:
    """Answers the tools of one graph on `line`, and asks its nodes on `nodes`.

    It answers at most `max_answers` requests at a time, and remembers `max_pending` requests that
    nodes have not answered yet.
    """

    def __init__(
        self,
        line: ControlServer,
        nodes: ControlServer,
        processes: ProcessTable,
        reports: NodeStatusTable,
        announcement: Announcement,
        max_answers: int = 8,
        max_pending: int = 1000,
    ) -> None:
        self._line, self._nodes, self._processes, self._reports = line, nodes, processes, reports
        self._announcement = announcement
        self._max_answers, self._max_pending = max_answers, max_pending
        self._params: dict[str, Any] = {}  # changed parameters by node
        self._began = time.monotonic()
        self._pending: dict[int, tuple[str, str, ControlMessage]] = {}  # tool, node and request
        self._tickets = count()

    def serve(self) -> None:
        """Answer requests that have arrived."""
        for _ in range(self._max_answers):
            try:
                request = self._line.receive()
            except ValueError:
                continue
            if request is None:
                return
            tool, word = request
            # A request to a node is answered only when the node has fulfilled it.
            answer = self._status() if word["kind"] == "status" else self._tell(tool, word)
            if answer is not None:
                self._line.send(tool, **answer)

    def done(self, ticket: int) -> None:
        """Tell a tool that a node has fulfilled its request."""
        tool, node, word = self._pending.pop(ticket, ("", "", {"kind": ""}))
        if word["kind"] == "set":
            params = self._with_set(node, word)
            self._params[node] = params
            self._announcement.set(node, params)
        if tool:
            self._line.send(tool, "done")

    def refused(self, ticket: int, text: str, *, again: bool) -> None:
        """Tell a tool that a node refuses its request; `again`: it may succeed later."""
        tool, _, _ = self._pending.pop(ticket, ("", "", {}))
        if tool:
            self._line.send(tool, "not_ready" if again else "refused", text=text)

    def buried(self, name: str) -> None:
        """Tell tools that a node died before it had fulfilled their requests."""
        for ticket, (tool, node, _) in list(self._pending.items()):
            if node == name:
                del self._pending[ticket]
                self._line.send(tool, "refused", text=f"{name} died before it had done that")

    def _status(self) -> dict[str, Any]:
        now, counts = time.monotonic(), self._processes.restarts.counts
        living = set(self._processes.living)
        nodes = {
            name: {
                "pid": self._processes.pid(name) if name in living else 0,
                "restarts": counts[name],
                "silent_s": self._reports.silence(name, now),
            }
            for name in self._processes.wirings
        }
        for_s = now - self._began
        return {"kind": "status", "launcher": os.getpid(), "for_s": for_s, "nodes": nodes}

    def _tell(self, tool: str, word: ControlMessage) -> dict[str, Any] | None:
        """Pass a request to a node, which reports when it has fulfilled it."""
        name, ticket = str(word["node"]), next(self._tickets)
        try:
            self._check(name, word)
        except ValueError as error:
            return {"kind": "refused", "text": str(error)}
        fields = {key: value for key, value in word.items() if key not in ("kind", "node")}
        if not self._nodes.send(name, word["kind"], **{**fields, "ticket": ticket}):
            return {"kind": "not_ready", "text": f"{name} is not up"}
        self._pending[ticket] = tool, name, word
        while len(self._pending) > self._max_pending:
            self._pending.pop(next(iter(self._pending)))
        return None

    def _check(self, name: str, word: ControlMessage) -> None:
        """Raise ValueError for a request that a node cannot fulfil."""
        wiring = self._processes.wirings.get(name)
        if wiring is None:
            raise ValueError(f"there is no node {name!r}")
        node = load_node(wiring.module)
        if word["kind"] == "set":
            self._with_set(name, word)
            return
        if word["kind"] == "publish":
            self._check_message(wiring, node, word)
        elif not isinstance(node, Source):
            raise ValueError(f"{name} is no source: it publishes when it receives something")

    @staticmethod
    def _check_message(wiring: Wiring, node: AnyNode, word: ControlMessage) -> None:
        """Raise ValueError for a message that a node cannot publish, or not again after it died."""
        outputs = wiring.outputs.items()
        local = next((name for name, wire in outputs if wire == word["topic"]), None)
        if local is None or isinstance(node, Sink):
            raise ValueError(f"{wiring.name} does not publish {word['topic']!r}")
        if isinstance(node, Source) and node.repeats:
            raise ValueError(
                f"{wiring.name} publishes {word['topic']} as a file has it: nothing can be added"
            )
        types = node.outputs(wiring.params) if isinstance(node, Source) else node.outputs
        decode(types[local], word["body"])

    def _with_set(self, name: str, word: ControlMessage) -> Any:
        """A node's parameters with one that a tool sets; ValueError if it cannot be set."""
        wiring, param = self._processes.wirings[name], word["param"]
        node = load_node(wiring.module)
        settable = sorted(node.settable) if isinstance(node, Node) else []
        if param not in settable:
            can = ", ".join(settable) or "none"
            raise ValueError(f"{name}.{param} cannot be set while it runs; of {name} can: {can}")
        return with_parameter(self._params.get(name, wiring.params), param, word["value"])
