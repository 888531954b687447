"""What holds for all tests."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

# Before numpy is imported: with several threads BLAS rounds differently from run to run, and
# bodies are compared to the last bit. Nodes run with one thread each as well.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

# Under nohup SIGHUP is ignored, and would be by every process that a test starts.
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# Hundreds of interpreters are started, most of them for the same modules: whoever wants no
# bytecode beside the sources has it in a folder that is no part of the tree.
if sys.dont_write_bytecode:
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(Path(__file__).parent.parent / ".pytest_cache" / "bytecode")
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import numpy as np  # noqa: E402
import pytest  # noqa: E402

from palpate.core.poses import IDENTITY_POSE  # noqa: E402
from palpate.messages.types.model import Score, ShapeModel  # noqa: E402
from palpate.messages.types.motion import Contour  # noqa: E402
from palpate.nodes.runtime.testing import example  # noqa: E402

Write = Callable[[str, str], Path]
ALL = "--all"
LEFT_OUT = pytest.StashKey[dict[str, int]]()  # Slow tests that were left out, by folder


LONGEST_FILES = ("test_pasted.py", "test_hard_objects.py", "test_workers.py", "test_system.py")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("palpate")
    group.addoption(ALL, action="store_true", help="Run the tests that are marked slow as well.")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker more than cores: tests of processes wait more than they compute."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # Files whose tests take up to a minute each come first, so that no worker ends with them alone.
    items.sort(key=lambda item: item.path.name not in LONGEST_FILES)
    if config.getoption(ALL) or "slow" in str(config.option.markexpr):
        return
    left_out = [item for item in items if item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not item.get_closest_marker("slow")]
    counts = Counter(item.nodeid.partition("::")[0].split("/")[1] for item in left_out)
    config.stash[LEFT_OUT] = dict(counts)
    if hasattr(config, "workeroutput"):  # a worker of pytest-xdist: its controller reports
        config.workeroutput["left_out"] = dict(counts)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Every worker collects the same tests."""
    node.config.stash[LEFT_OUT] = getattr(node, "workeroutput", {}).get("left_out", {})


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Say how many tests of which folder were left out, and what runs them."""
    if counts := config.stash.get(LEFT_OUT, {}):
        folders = ", ".join(f"{count} of {name}" for name, count in sorted(counts.items()))
        terminalreporter.write_line(
            f"left out: {sum(counts.values())} slow tests ({folders}); ./go test --all runs them"
        )


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder in which palpate is started; its modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    yield tmp_path
    for name, module in [*sys.modules.items()]:
        if str(getattr(module, "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder for running graphs; its path is short, as paths of sockets must be."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield Path(folder)


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a finished run, with its recording; nobody may change it."""
    from tests.recorded_run import make_run

    return make_run(tmp_path_factory.mktemp("recorded"))


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a text into a file of the test's own folder."""

    def do(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return do


@pytest.fixture
def tetrahedron() -> ShapeModel:
    """The smallest closed solid."""
    fields: dict[str, Any] = {"contours": (0, 1), "dropped": (2,), "frame": IDENTITY_POSE}
    fields |= dict.fromkeys(("control", "undeformed"), np.zeros((4, 4, 4, 3)))
    fields |= dict.fromkeys(("knots_columns", "knots_rows", "knots_layers"), np.zeros(8))
    fields["vertices"] = np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.02, 0], [0, 0, 0.03]])
    fields["faces"] = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    fields |= {"uncertainty_height": np.array([0.0]), "uncertainty": np.array([0.001])}
    fields |= {"health": {"condition": 3.5, "fallbacks": 0.0}, "dropped_reasons": ("too short",)}
    fields |= {"number": 1, "deviation": 0.0, "touches": 40, "robot_time": 20.0, "final": True}
    return example(ShapeModel, **fields)


@pytest.fixture
def contour() -> Contour:
    """A contour of one point."""
    fields: dict[str, Any] = {"points": np.zeros((1, 3)), "normals": np.array([[1.0, 0, 0]])}
    fields |= {"frame": IDENTITY_POSE, "curvature": np.zeros(1), "status": "closed"}
    return example(Contour, finger=1, height=0.01, touches=30, robot_time=15.0, **fields)


@pytest.fixture
def score() -> Score:
    """A score of the tetrahedron."""
    errors = {"chamfer": 0.0003, "rms": 0.0004, "p95": 0.0008, "hausdorff": 0.002, "normal": 3.0}
    fields: dict[str, Any] = {"number": 1, "contours": 2, "touches": 40, "robot_time": 20.0}
    fields |= {"volume_error": -0.01, "sampling_floor": 0.00005, "size": 0.03, "watertight": True}
    return example(Score, exposed_rms=0.0003, final=True, **errors, **fields)
