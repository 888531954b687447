import os
import signal
import subprocess
import sys
import threading

import pytest

from palpate.launch.processes.fork_server import (
    Interrupts,
    preloaded_modules,
    signals_as_ctrl_c,
    without_main_module,
)

RUNTIME = ("palpate.nodes.runtime.loop", "palpate.messages.types.catalogue")


def output_of(script, folder=None):
    """Lines that a new interpreter prints, which is started in a folder."""
    command = [sys.executable, *(["-P"] if folder else []), "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_the_script_is_hidden_only_for_a_moment():
    script = sys.modules["__main__"]
    with without_main_module():
        assert not hasattr(sys.modules["__main__"], "__file__")
    assert sys.modules["__main__"] is script


def test_each_kind_of_palpates_own_is_preloaded_once_and_none_of_a_users():
    tracer = "palpate.nodes.tracer"
    modules = [
        tracer,
        "my_lab.denoise",
        tracer,
        "palpate.nodes.filter",
        "palpate.bench.loop",
    ]
    assert preloaded_modules(modules) == (*RUNTIME, tracer, "palpate.nodes.filter")
    assert preloaded_modules([]) == RUNTIME


PRELOADED = """
import gc, os, sys
import zmq
opened = []
made = zmq.Context.__init__
zmq.Context.__init__ = lambda self, *a, **k: (opened.append(self), made(self, *a, **k))[1]
from palpate.launch.launch_source import named_modules
from palpate.launch.launch_source import EXPLORE
from palpate.launch.processes.fork_server import preloaded_modules
from palpate.preloading import preload
names = preloaded_modules(named_modules(EXPLORE))
preload(names)
print([name for name in names if name not in sys.modules])
print(len(opened), zmq.Context._instance)
effects = "palpate.core.touch.effects."
print([name for name in sys.modules if name.startswith(effects)])
print("scipy" in sys.modules, "trimesh" in sys.modules, "palpate.launch.run" in sys.modules)
print(gc.isenabled(), gc.get_freeze_count() > 1000)
if sys.platform == "linux":
    print(len(os.listdir("/proc/self/task")))
"""


def test_what_is_preloaded_for_exploring_has_no_socket_no_thread_and_no_effect(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    missing, sockets, effects, heavy, garbage, *threads = output_of(PRELOADED)
    assert missing == "[]"
    assert sockets == "0 None"
    assert effects == "['palpate.core.touch.effects.catalogue']"
    assert heavy == "True False False"
    assert garbage == "True True"
    assert threads in ([], ["1"])


BROKEN = """
import sys
from palpate.preloading import preload
preload(["palpate.nodes.nothing", "", "palpate.nodes.filter"])
print("palpate.nodes.filter" in sys.modules)
"""


def test_what_cannot_be_imported_keeps_nothing_else_from_being_preloaded():
    assert output_of(BROKEN) == ["True"]


SHADOWED = """
import multiprocessing
from palpate.launch.processes.fork_server import start_fork_server, without_main_module
start_fork_server(["palpate.nodes.filter"])
words = "'palpate.nodes.filter' in sys.modules, 'PYTHONSAFEPATH' in os.environ"
told = f"import os, sys; print({words})"
process = multiprocessing.get_context("forkserver").Process(target=exec, args=(told,))
with without_main_module():
    process.start()
process.join()
"""


def test_modules_where_palpate_is_started_do_not_hide_those_of_nodes(tmp_path):
    for name in ("palpate", "numpy", "signal"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the wrong one')")
    assert output_of(SHADOWED, tmp_path) == ["True False"]


DRAWN = """
import os
from palpate.preloading import preload
preload(["numpy.random"])
import numpy
drawn = []
for _ in range(2):
    readable, writable = os.pipe()
    if os.fork() == 0:
        os.write(writable, repr(numpy.random.random()).encode())
        os._exit(0)
    drawn.append(os.read(readable, 100))
print(drawn[0] != drawn[1])
"""


def test_two_nodes_that_draw_from_the_global_generator_draw_different_numbers():
    assert output_of(DRAWN) == ["True"]


LAUNCHED = """
from palpate.nodes.runtime import Watcher
from tests.studies.toy_node import ToyParams, toy
from palpate.launch.launcher import launch
from palpate.launch.processes.fork_server import start_fork_server
from palpate.nodes.runtime.node import Wiring
start_fork_server(["palpate.nodes.nothing", "palpate.nodes.filter"])
source = toy("source", ToyParams(burst=5))
nobody = dict(params={}, inputs=(), outputs={}, subscribers={})
lost = Wiring(name="lost", module="palpate.nodes.nothing", **nobody)
for graph in ([source, lost], [source, toy("counter", ToyParams(expects=5), upstream="source")]):
    ending = launch(graph, ends=graph[-1].name, watch=(), watcher=Watcher())
    print(ending.status, ending.reason)
"""


@pytest.mark.graph
def test_a_module_that_is_missing_is_told_and_the_next_graph_of_other_nodes_runs():
    first, second = output_of(LAUNCHED)
    assert first.startswith(
        "died lost failed while loading: ValueError: no module 'palpate.nodes.nothing'"
    )
    assert second.startswith("finished")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_is_noted_and_the_first_one_counts(number):
    with Interrupts() as interrupts:
        assert interrupts.came is None
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), signal.SIGINT)
        assert interrupts.came == number.name


def test_what_was_done_with_signals_before_is_done_again():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with Interrupts():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interrupts() as interrupts:
            os.kill(os.getpid(), signal.SIGHUP)
            assert interrupts.came is None
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_request_to_end_interrupts_as_ctrl_c_does(number):
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), signals_as_ctrl_c():
        os.kill(os.getpid(), number)
    assert signal.getsignal(number) is before


def test_in_another_thread_nothing_is_changed():
    seen: list[object] = []

    def look():
        with signals_as_ctrl_c():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join(10.0)
    assert seen == [signal.getsignal(signal.SIGTERM)]
