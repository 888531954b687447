"""Exploring, measured: tracing, grasps, planners, and whole explorations with what they cost."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

from palpate.launch import bench_tracing
from palpate.launch.bench_explore_calibration import calibration_rows
from palpate.launch.bench_explore_fingers import finger_rows
from palpate.launch.bench_explore_frames import direction_rows, tilted_rows
from palpate.launch.bench_explore_peer import peer_rows
from palpate.launch.bench_explore_planners import planner_rows as planners_whole_rows
from palpate.launch.bench_explore_whole import whole_rows
from palpate.launch.bench_grasp import grasp_rows
from palpate.launch.bench_planners import planner_rows
from palpate.launch.bench_row import Group, Row

GROUPS: Mapping[str, tuple[Group, ...]] = {
    "tracing": bench_tracing.GROUPS,
    "grasp": (grasp_rows,),
    "planners": (planner_rows,),
    "whole": (whole_rows,),
    "tilted": (tilted_rows,),
    "directions": (direction_rows,),
    "fingers": (finger_rows,),
    "planners_whole": (planners_whole_rows,),
    "calibration": (calibration_rows,),
    "peer": (peer_rows,),
}
"""What ``palpate bench explore`` measures, the quickest first."""


def bench(
    *,
    quick: bool,
    only: str | None = None,
    as_json: bool = False,
    echo: Callable[[str], None] = print,
) -> int:
    """Print figures, each as soon as it is known.

    Parameters
    ----------
    quick : bool
        Fewer objects and runs.
    only : str or None
        One group; all of them if left out.
    as_json : bool
        One JSON object a line, with the group's name.
    echo : callable
        Takes one line.

    Returns
    -------
    int
        0 if every demand is met, else 1.
    """
    missed = False
    for name in GROUPS if only is None else (only,):
        if not as_json:
            echo(f"-- {name}")
        for group in GROUPS[name]:
            for row in group(quick):
                missed = missed or not row.holds
                echo(_json(name, row) if as_json else str(row))
    return int(missed)


def _json(group: str, row: Row) -> str:
    return json.dumps({"group": group, **row._asdict()})
