"""The server from which nodes are forked, and the signals that reach a launcher and no node."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from palpate.launch.processes.fork_server import Interrupts, preloaded_modules, signals_as_ctrl_c

PRELOADED = """
import gc, os, re, signal, sys
import zmq
opened = []
made = zmq.Context.__init__
zmq.Context.__init__ = lambda self, *a, **k: (opened.append(self), made(self, *a, **k))[1]
from palpate.launch.launch_source import EXPLORE, named_modules
from palpate.launch.processes.fork_server import preloaded_modules
assert not {"numpy", "zmq.backend.none"} & set(sys.modules), "launch files are read lightly"
from palpate.preloading import preload
names = preloaded_modules(named_modules(EXPLORE))
preload([*names, "palpate.nodes.nothing", "", "numpy.random"])
print([name for name in names if name not in sys.modules])
print(len(opened), zmq.Context._instance)
effects = "palpate.core.touch.effects."
print([name for name in sys.modules if name.startswith(effects)])
print("scipy" in sys.modules, "trimesh" in sys.modules, "palpate.launch.run" in sys.modules)
print(gc.isenabled(), gc.get_freeze_count() > 1000)
print(len(os.listdir("/proc/self/task")) if sys.platform == "linux" else 1)
import numpy
drawn = []
for _ in range(2):
    readable, writable = os.pipe()
    if os.fork() == 0:
        os.write(writable, repr(numpy.random.random()).encode())
        os._exit(0)
    drawn.append(os.read(readable, 100))
print("nodes draw different numbers:", drawn[0] != drawn[1])
"""
SHADOWED = """
import multiprocessing, re, signal, sys
from multiprocessing import resource_tracker
from palpate.launch.processes.fork_server import start_fork_server, without_main_module
start_fork_server(["palpate.nodes.filter"])
words = "'palpate.nodes.filter' in sys.modules, 'PYTHONSAFEPATH' in os.environ"
told = f"import os, sys; print({words})"
process = multiprocessing.get_context("forkserver").Process(target=exec, args=(told,))
with without_main_module():
    process.start()
process.join()
if sys.platform == "linux":
    status = open(f"/proc/{resource_tracker._resource_tracker._pid}/status").read()
    [held] = re.findall(r"^SigBlk:\\s*(\\w+)$", status, re.MULTILINE)
    assert int(held, 16) >> (signal.SIGHUP - 1) & 1, "the tracker outlives a closed terminal"
assert not signal.pthread_sigmask(signal.SIG_BLOCK, ())
"""


def output_of(script, folder=None):
    """Lines that a new interpreter prints, which is started in a folder."""
    command = [sys.executable, *(["-P"] if folder else []), "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_preloaded_server_has_own_kinds_is_light_and_has_no_socket_or_thread(monkeypatch):
    tracer, own = "palpate.nodes.tracer", "my_lab.denoise"
    modules = [tracer, own, tracer, "palpate.nodes.filter", "palpate.launch.run"]
    preloaded = preloaded_modules(modules)
    always = preloaded_modules([])
    assert preloaded == (*always, tracer, "palpate.nodes.filter")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    assert output_of(PRELOADED) == [
        "[]",
        "0 None",
        "['palpate.core.touch.effects.catalogue']",
        "True False False",
        "True True",
        "1",
        "nodes draw different numbers: True",
    ]


def test_modules_in_current_folder_do_not_hide_those_of_nodes(tmp_path):
    for name in ("palpate", "numpy", "signal"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the wrong one')")
    assert output_of(SHADOWED, tmp_path) == ["True False"]


@pytest.fixture(autouse=True)
def _default_signals(monkeypatch):
    """As in a terminal, however the tests were started."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    for number in numbers:
        signal.signal(number, signal.default_int_handler)
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_first_signal_is_noted_and_handlers_are_restored(number):
    before = signal.getsignal(number)
    with Interrupts() as interrupts:
        assert interrupts.came is None and signal.getsignal(number) is not before
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), signal.SIGINT)
        assert interrupts.came == number.name
    assert signal.getsignal(number) is before
    with pytest.raises(KeyboardInterrupt), signals_as_ctrl_c():
        os.kill(os.getpid(), number)
    assert signal.getsignal(number) is before


def test_ignored_hangup_and_signals_of_another_thread_are_left_alone():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with Interrupts() as interrupts, signals_as_ctrl_c():
        os.kill(os.getpid(), signal.SIGHUP)
        assert interrupts.came is None
    seen: list[object] = []

    def look():
        with signals_as_ctrl_c():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join(10.0)
    assert seen == [signal.getsignal(signal.SIGTERM)]
