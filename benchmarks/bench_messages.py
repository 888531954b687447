"""One message: encoded, framed, split, decoded. Run with ``./go test benchmarks``."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from palpate.messages.codec import decode, encode, schema_hash
from palpate.messages.header import Header, pack_frame, split_frame
from palpate.messages.types import TactileFrame

FRAME = TactileFrame(
    goal=1,
    touch=2,
    finger=1,
    direction=np.array([0.0, 0.0, 1.0]),
    pose=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    outcome="hit",
    array=np.random.default_rng(0).random((16, 16)),
    robot_time=1.5,
)


def bench_both_sides_of_a_frame(benchmark: Any) -> None:
    schema = schema_hash(TactileFrame)

    def both() -> TactileFrame:
        header = Header(1, 0, 7, time.monotonic_ns(), 1.5, schema)
        return decode(TactileFrame, split_frame(pack_frame("/touch/raw", header, encode(FRAME)))[2])

    assert benchmark(both).goal == 1
