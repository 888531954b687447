"""How high the boxes of a column stand: so that lines to them are straight where that can be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

from palpate.launch.drawing import sizes
from palpate.launch.drawing.form import Form
from palpate.launch.drawing.strands import Strand

STRAIGHT = 0.05
"""Two heights that differ by less are the same, pixels."""


def tops_of(columns: Sequence[Sequence[int]], forms: Mapping[int, Form]) -> dict[int, float]:
    """Height of the top of each box; a column is placed by what the one before sends it."""
    tops: dict[int, float] = {}
    for number, column in enumerate(columns):
        steps = [0.0]
        for upper, lower in pairwise(column):
            steps.append(steps[-1] + forms[upper].height + sizes.GAP + forms[lower].back)
        wanted = [_wanted(forms[box], number, tops, forms) for box in column]
        free = [0.0 if top is None else top - step for top, step in zip(wanted, steps, strict=True)]
        weights = [0.1 if top is None else 1.0 for top in wanted]
        for box, top, step in zip(column, _ascending(free, weights), steps, strict=True):
            tops[box] = top + step
    return tops


def bent(
    strands: Sequence[Strand],
    column_of: Mapping[int, int],
    tops: Mapping[int, float],
    forms: Mapping[int, Form],
) -> set[int]:
    """Columns with a box that a line from the column before does not reach straight."""
    return {
        column_of[target]
        for one in strands
        if one.way != "below"
        for target in one.wire.targets
        if column_of[target] == one.column + 1
        and abs(_start(one, tops, forms) - tops[target] - forms[target].left[one]) > STRAIGHT
    }


def _wanted(
    form: Form, number: int, tops: Mapping[int, float], forms: Mapping[int, Form]
) -> float | None:
    """Top at which lines from the column before are straight, in the mean; None without such.

    Lines that go to this column alone count; what forks has other branches, too.
    """
    straight = [one for one in form.left if one.way == "straight"]
    if not straight:
        straight = [one for one in form.left if one.way == "above" and one.column == number - 1]
    shifts = [_start(one, tops, forms) - form.left[one] for one in straight]
    return sum(shifts) / len(shifts) if shifts else None


def _start(strand: Strand, tops: Mapping[int, float], forms: Mapping[int, Form]) -> float:
    return tops[strand.wire.source] + forms[strand.wire.source].right[strand]


def _ascending(values: Sequence[float], weights: Sequence[float]) -> list[float]:
    """The ascending numbers nearest to these, in the sense of weighted least squares."""
    blocks: list[tuple[float, float, int]] = []
    for value, weight in zip(values, weights, strict=True):
        blocks.append((value, weight, 1))
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (a, v, m), (b, w, n) = blocks[-2:]
            blocks[-2:] = [((a * v + b * w) / (v + w), v + w, m + n)]
    return [value for value, _, number in blocks for _ in range(number)]
