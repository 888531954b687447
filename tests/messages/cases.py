"""Tables of cases, addresses of a run, a full disk, and messages drawn within their schema."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.messages import schema
from palpate.messages.bus import Addresses


def cases(names: str, *rows: Any, ids: Any = None) -> pytest.MarkDecorator:
    """Has a test run once for each row of values."""
    return pytest.mark.parametrize(names, rows, ids=ids)


def addresses(folder: Path, *names: str) -> Addresses:
    """Of a run of nodes within this machine, all files in a folder."""

    def each(kind: str, scheme: str = "") -> dict[str, str]:
        return {name: f"{scheme}{folder / kind}_{name}" for name in names}

    files = {kind: each(kind) for kind in ("journals", "times", "pasts")}
    sockets = {kind: each(kind, "ipc://") for kind in ("endpoints", "taps")}
    control = f"ipc://{folder / 'control'}"
    return Addresses(run=7, epoch=0, depth=1000, control=control, tools="", **files, **sockets)


@contextmanager
def file_limit(size: int) -> Iterator[None]:
    """Within it no file of this process can grow beyond a size: the disk is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


Rule = dict[str, Any]


def drawn(cls: type, seed: int = 0) -> Any:
    """A message of a type."""
    rng = np.random.default_rng(seed)
    return cls(**{name: _value(rule, rng) for name, rule in schema(cls)["properties"].items()})


def _value(rule: Rule, rng: np.random.Generator) -> Any:
    if "anyOf" in rule:
        return _value(rule["anyOf"][0], rng) if rng.integers(4) else None
    if "enum" in rule:
        return rule["enum"][int(rng.integers(len(rule["enum"])))]
    if "dtype" in rule:
        shape = [int(rng.integers(1, 5)) if length is None else length for length in rule["shape"]]
        return (3.0 * rng.normal(size=shape)).astype(rule["dtype"])
    match rule["type"]:
        case "array":
            return tuple(_value(rule["items"], rng) for _ in range(int(rng.integers(4))))
        case "object":
            return {f"figure {i}": float(rng.normal()) for i in range(3)}
        case "number":
            return float(rng.normal())
        case "integer":
            return int(rng.integers(-(1 << 62), 1 << 62))
        case "boolean":
            return bool(rng.integers(2))
    return "a reason, µm"[: int(rng.integers(1, 13))]
