"""Which boxes stand in which column, and in which order within it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

Edges = Mapping[int, Sequence[int]]
"""Box to the boxes that hear it."""
_SWEEPS = 8


def layers_of(edges: Edges) -> list[list[int]]:
    """Columns of boxes from left to right: whoever hears stands right of whom it hears.

    Edges that go back to where they came from are not asked. The column is the length of the
    longest way to a box; within it, boxes are ordered by the mean place of their neighbours,
    which lessens crossings.

    Parameters
    ----------
    edges : map
        Every box, in the order in which the ways begin, to its listeners.
    """
    back = back_edges(edges)
    forward = {
        box: [target for target in targets if (box, target) not in back]
        for box, targets in edges.items()
    }
    depth = _depths(forward)
    columns: list[list[int]] = [[] for _ in range(max(depth.values(), default=-1) + 1)]
    for box in edges:
        columns[depth[box]].append(box)
    return _untangled(columns, forward)


def back_edges(edges: Edges) -> set[tuple[int, int]]:
    """Edges to a box from which the way to their source has come; without them is no cycle."""
    back: set[tuple[int, int]] = set()
    seen: set[int] = set()
    for start in edges:
        # A way is kept by hand: a launch file may be deeper than Python's own stack.
        way = [] if start in seen else [(start, iter(edges[start]))]
        on_way = {start}
        seen.add(start)
        while way:
            box, rest = way[-1]
            target = next(rest, None)
            if target is None:
                way.pop()
                on_way.discard(box)
            elif target in on_way:
                back.add((box, target))
            elif target not in seen:
                seen.add(target)
                on_way.add(target)
                way.append((target, iter(edges[target])))
    return back


def _depths(forward: Edges) -> dict[int, int]:
    """Edges of the longest way to each box."""
    depth = dict.fromkeys(forward, 0)
    waits = dict.fromkeys(forward, 0)
    for targets in forward.values():
        for target in targets:
            waits[target] += 1
    free = [box for box, number in waits.items() if number == 0]
    for box in free:
        for target in forward[box]:
            depth[target] = max(depth[target], depth[box] + 1)
            waits[target] -= 1
            if waits[target] == 0:
                free.append(target)
    return depth


def _untangled(columns: list[list[int]], forward: Edges) -> list[list[int]]:
    """The columns, ordered by the mean place of neighbours, rightwards and leftwards in turn."""
    before: dict[int, list[int]] = {box: [] for box in forward}
    for box, targets in forward.items():
        for target in targets:
            before[target].append(box)
    place = {box: spot for column in columns for box, spot in _spots(column).items()}
    for sweep in range(_SWEEPS):
        near = before if sweep % 2 == 0 else forward
        for column in columns if sweep % 2 == 0 else reversed(columns):
            mean = {
                box: sum(place[one] for one in near[box]) / len(near[box])
                for box in column
                if near[box]
            }
            column.sort(key=lambda box: mean.get(box, place[box]))
            place |= _spots(column)
    return columns


def _spots(column: Sequence[int]) -> dict[int, float]:
    """Places of a column's boxes, from 0 at its upper end to 1 at its lower."""
    return {box: (i + 0.5) / len(column) for i, box in enumerate(column)}
