"""What holds for all tests."""

from __future__ import annotations

import os
from zlib import crc32

import pytest

# Before numpy is imported: with several threads BLAS rounds differently from run to run, and
# bodies are compared to the last bit. Nodes run with one thread each as well.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

SAMPLED = 10  # One slow test in so many runs with --slow-sample; which ones, their names decide


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("palpate")
    group.addoption("--slow", action="store_true", help="Run the statistics, marked slow, as well.")
    group.addoption("--slow-sample", action="store_true", help="Run a fixed tenth of them as well.")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--slow") or "slow" in str(config.option.markexpr):
        return
    every = SAMPLED if config.getoption("--slow-sample") else 0
    left = [one for one in items if one.get_closest_marker("slow") and not _sampled(one, every)]
    skipped = set(left)
    config.hook.pytest_deselected(items=left)
    items[:] = [one for one in items if one not in skipped]


def _sampled(item: pytest.Item, every: int) -> bool:
    return bool(every) and crc32(item.nodeid.encode()) % every == 0
