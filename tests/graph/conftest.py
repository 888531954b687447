import time
from functools import cache
from pathlib import Path

import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.progress import Display
from palpate.launch.run import perform, plan_run
from palpate.messages.types.catalogue import LogRecord
from palpate.nodes.runtime.node import Input, Wiring


class Listening:
    """A watcher that keeps all that it is told."""

    def __init__(self):
        self.seconds: list[float] = []
        self.messages: list[tuple[str, object]] = []
        self.lines: list[LogRecord] = []
        self.ticks = 0

    def ready(self, seconds):
        self.seconds.append(seconds)

    def received(self, topic, message):
        self.messages.append((topic, message))

    def log(self, record):
        self.lines.append(record)

    def tick(self, statuses):
        self.ticks += 1


@pytest.fixture
def watcher():
    return Listening()


class Toys:
    """Wirings of the toy nodes beside this file."""

    def broken(self, how, upstream="source"):
        return Wiring(
            name="broken",
            module="palpate_toy_broken",
            params={"how": how},
            inputs=(Input(upstream, f"/{upstream}", "/in", "TactileFrame"),),
            outputs={"/out": "/broken"},
            subscribers={},
            on_exit="stop",
        )

    def sink(self, path, upstream="source", **params):
        return Wiring(
            name="sink",
            module="palpate_toy_sink",
            params={"path": str(path), **params},
            inputs=(Input(upstream, f"/{upstream}", f"/{upstream}", "TactileFrame"),),
            outputs={},
            subscribers={},
        )

    def needy(self, need, upstream):
        return Wiring(
            name="needy",
            module="palpate_toy_needy",
            params={},
            inputs=(
                Input(need, f"/{need}", "/need", "TactileFrame"),
                Input(upstream, f"/{upstream}", "/in", "TactileFrame"),
            ),
            outputs={},
            subscribers={},
        )


@pytest.fixture
def toys(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent / "toys"))
    return Toys()


TOYS = Path(__file__).parent / "toys"


@pytest.fixture(scope="session")
def explored(tmp_path_factory):
    """Run directories of explorations by the toy planner in one process, by number of fingers."""

    @cache
    def of(fingers):
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(str(TOYS.parent))
            return explore_heights(tmp_path_factory.mktemp("toy") / "run", fingers, composed=True)

    return of


def explore_heights(out, fingers, *, composed, killed=False):
    """A run of the toy planner; its folder. Who was killed publishes some messages twice."""
    args = {"fingers": SourceMapped(fingers, "fingers")}
    plan = plan_run(TOYS / "fingers.yaml", args, {}, name="fingers", out=out)
    run = perform(plan, composed=composed, display=Display())
    assert run.ending.status == "finished", run.ending.reason
    assert run.ending.gaps == 0
    assert killed or run.ending.duplicates == 0
    return out


def _living(group):
    """Processes of a group; one that only waits to be buried does not count."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            try:
                state, _, its_group = (folder / "stat").read_text().rpartition(")")[2].split()[:3]
            except (FileNotFoundError, ProcessLookupError):
                continue
            if int(its_group) == group and state != "Z":
                found.append(int(folder.name))
    return found


@pytest.fixture
def group_is_gone():
    """Waits for the last living process of a group to end; false if that takes too long."""
    return _group_is_gone


def _group_is_gone(group, within):
    deadline = time.monotonic() + within
    while _living(group):
        if time.monotonic() > deadline:
            return False
    return True
