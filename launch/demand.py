"""What is asked of an exploration against what its sensor, its fingers and its object allow.

Each node checks its own parameters; this is what only all of them together can tell.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate.core.explore.planners.catalogue import make_planner
from palpate.core.explore.planners.uniform import Uniform
from palpate.core.explore.survey import APART
from palpate.core.measure.robot_time import PRESETS
from palpate.launch.entry import Entry
from palpate.launch.graph import Graph
from palpate.nodes import planner, simulator
from palpate.nodes.effects import build_pipeline
from palpate.nodes.object import build_shape
from palpate.nodes.sensor import info_of, resolution_of_info
from palpate.nodes.wiring import Wiring


def check_demand(graph: Graph, wirings: Sequence[Wiring]) -> None:
    """Refuse a tolerance that the sensor cannot tell, and fingers that have nothing to do.

    Says nothing of a graph that has no planner or no simulator of palpate's own.

    Raises
    ------
    InputError
        With file and line where they are known.
    """
    places = {entry.name: entry for entry in graph.entries}
    plans = [one for one in wirings if isinstance(one.params, planner.Params)]
    fingers = [one for one in wirings if isinstance(one.params, simulator.Params)]
    if len(plans) == 1 and fingers:
        asked, place = plans[0].params, places[plans[0].name]
        _check_tolerance(asked, place, fingers[0].params)
        if len(fingers) > 1:
            _check_room(asked, place, fingers[0].params, len(fingers))


def _check_tolerance(asked: planner.Params, place: Entry, feels: simulator.Params) -> None:
    pipeline = build_pipeline(feels.sensor, feels.effects, PRESETS[feels.robot])
    resolution = resolution_of_info(info_of(feels.sensor, pipeline.noise))
    if asked.tolerance < resolution:
        raise place.settings.error(
            ("tolerance",),
            f"tolerance is {asked.tolerance} m; it must be at least what the sensor can tell, "
            f"{resolution:g} m",
        )


def _check_room(asked: planner.Params, place: Entry, feels: simulator.Params, fingers: int) -> None:
    rule = make_planner(asked.planner, asked.settings)
    if isinstance(rule, Uniform) and rule.count < fingers:
        raise place.settings.error(
            ("settings", "count"),
            f"count is {rule.count}, but there are {fingers} fingers; a finger would have nothing "
            "to do: ask for more slices or take fewer fingers",
        )
    low, high = build_shape(feels.object).bounds()
    apart = APART * feels.sensor.pitch * max(feels.sensor.rows, feels.sensor.cols)
    room = int((high[2] - low[2]) / apart) + 1
    if fingers > room:
        raise place.error(
            f"fingers is {fingers}, but an object of {high[2] - low[2]:.3g} m has room for {room}, "
            f"{apart:.3g} m apart; take fewer fingers"
        )
