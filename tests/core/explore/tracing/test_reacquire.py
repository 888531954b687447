from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from palpate.core.explore.tracing.commands import ProcedureResult, SliceSpec, TouchCommand, resume
from palpate.core.explore.tracing.contour_path import Path
from palpate.core.explore.tracing.following import REACQUIRE_STEP, Stride, reacquire
from palpate.core.explore.tracing.slice_arc import SliceArc
from palpate.core.touch.pad import Pad


def arc(begin: float, end: float) -> Path:
    """Points of a circle of 30 mm."""
    azimuth = np.linspace(begin, end, max(int(30 * (end - begin)), 2))
    away = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))])
    flat = np.zeros(len(azimuth))
    return Path(0.03 * away, away, flat, flat, flat)


def reacquired(
    pad: Pad, path: Path, felt: Sequence[SliceArc | None]
) -> TouchCommand | ProcedureResult[Stride | None]:
    return resume(lambda: reacquire(SliceSpec(pad, 0.0), path, np.zeros(2), 0.1), felt)


def test_approaches_come_from_ever_farther_round_up_to_the_start(flat) -> None:
    path = arc(0.0, math.pi)
    aims = [reacquired(flat, path, [None] * count) for count in range(6)]
    headings = [aim.heading for aim in aims if isinstance(aim, TouchCommand)]
    assert headings == pytest.approx([math.pi + REACQUIRE_STEP * turn for turn in range(1, 7)])
    assert reacquired(flat, path, [None] * 6) == ProcedureResult(None)


def test_what_is_met_is_the_way_on_and_the_stretch_before_it_is_probed(flat) -> None:
    path, beyond = arc(0.0, math.pi), arc(math.pi + 0.45, math.pi + 0.6)
    met = SliceArc(*beyond, 0.0, beyond.points[0], beyond.points[0], 5, 5)
    aim = reacquired(flat, path, [met])
    assert isinstance(aim, TouchCommand)
    middle = 0.5 * (path.points[-1] + beyond.points[0])
    assert np.allclose(aim.place, middle[:2])
    found = reacquired(flat, path, [met, None])
    assert isinstance(found, ProcedureResult)
    assert isinstance(found.result, Stride)
    assert len(found.result.new.points) == len(beyond.points)
    [gap] = found.result.gaps
    assert gap.extent == pytest.approx(2 * 0.03 * math.sin(0.225))
