"""What else may matter when something is wrong: versions, environment, graphs."""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version

from palpate.launch.processes.register import Card

VARIABLES = (
    "XDG_RUNTIME_DIR",
    "TMPDIR",
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
)
"""Variables of the environment by which palpate is affected."""


def report_lines(cards: list[Card]) -> Iterator[str]:
    """Lines for whoever helps: system, packages, environment, running graphs."""
    yield f"system    {platform.platform()}"
    yield f"python    {sys.executable}, {platform.python_version()}"
    for name in _required():
        yield f"package   {name} {_version(name)}"
    for name in VARIABLES:
        yield f"variable  {name}={os.environ.get(name, '')}"
    for card in cards:
        yield (
            f"graph     {card.run} ({card.name}), launcher {card.pid}, since {card.began}, "
            f"in {card.folder or 'no run directory'}: {', '.join(one.name for one in card.nodes)}"
        )


def _required() -> list[str]:
    """Names of the packages that palpate needs, if its installation says so."""
    try:
        lines = requires("palpate") or []
    except PackageNotFoundError:
        return []
    plain = [line for line in lines if "extra ==" not in line]
    return [match[0] for line in plain if (match := re.match(r"[A-Za-z0-9._-]+", line))]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "is not installed"
