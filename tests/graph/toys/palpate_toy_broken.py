"""A node that breaks at its third message, in the way that it is told."""

from __future__ import annotations

import dataclasses
import os
import signal
import sys

import msgspec

from palpate.messages.types import LogRecord, TactileFrame
from palpate.nodes.runtime.node import Node, Outputs


class Params(msgspec.Struct, frozen=True, kw_only=True):
    how: str


def _start(params: Params) -> tuple[int, Outputs]:
    if params.how == "start":
        raise RuntimeError("no world to start in")
    return 0, []


def _on_frame(params: Params, received: int, message: TactileFrame) -> tuple[int, Outputs]:
    if received < 2:
        return received + 1, []
    if params.how == "tell":
        heavy = {"scipy", "trimesh", "rich", "mcap", "numpy.random", "palpate.launch"}
        settings = {key: os.environ[key] for key in ("OPENBLAS_NUM_THREADS", "PYTHONHASHSEED")}
        raise RuntimeError(f"{sorted(heavy & sys.modules.keys())} {settings} {os.nice(0)}")
    if params.how == "raise":
        raise ZeroDivisionError("cannot divide by the number of touches")
    if params.how == "exit":
        os._exit(7)
    if params.how == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    outputs: Outputs = {
        "undeclared": [("/nowhere", message)],
        "wrong type": [("/out", LogRecord(node="", level="info", text="", robot_time=0.0))],
        "not finite": [("/out", dataclasses.replace(message, robot_time=float("nan")))],
    }[params.how]
    return received, outputs


NODE = Node(
    params=Params,
    start=_start,
    inputs={"/in": (TactileFrame, _on_frame)},
    outputs={"/out": TactileFrame},
)
