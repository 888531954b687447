from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from palpate.bench import speed
from palpate.bench.speed import SceneSpeed, Timed, handler_seconds, waits_of
from palpate.launch.files import InputError
from palpate.messages.recording import RecordedMessage

GOOD: dict[str, Any] = {
    "chamfer_m": 1e-4,
    "size_m": 0.1,
    "sampling_floor_m": 1e-5,
    "contours": 9,
    "touches": 200,
    "gaps": 0,
    "duplicates": 0,
    "watertight": True,
    "genus": 0,
    "mesh_sha256": "a",
}


def run(wall: float = 8.0, cpu: float = 10.0, **changes: Any) -> Timed:
    nodes, steps = {"planner": 1.0, "reconstructor": 3.0}, {"mesh": 0.5}
    return Timed({**GOOD, **changes}, wall, cpu, 1.0, 2.0, 40.0, {"model": 2.0}, nodes, steps)


def test_a_scene_tells_its_times_its_solid_and_where_the_time_went():
    told = SceneSpeed("vase", [run(), run(9.0), run(7.0)], [])
    assert (told.missed, told.holds) == ([], True)
    head, nodes, steps, waits = str(told).splitlines()
    assert head.split() == [
        *("vase", "0.100", "%", "0.010", "%", "200", "40"),
        *("8.00", "10.00", "1.00", "2.00"),
    ]
    assert nodes.split() == ["nodes", "reconstructor", "3.00,", "planner", "1.00"]
    assert (steps.split()[0], waits.split()) == ("steps", ["waits", "model", "2.00"])
    figures = {one.name: (one.value, one.unit) for one in told.figures}
    assert figures["wall"] == (8.0, "s") and figures["chamfer"] == (pytest.approx(0.1), "mm")
    assert figures["reconstructor"] == (3.0, "s") and figures["touches"] == (200, "")
    assert len(str(next(speed.scene_rows(quick=True)))) == len(head)


def test_an_older_checkout_is_told_as_ratios_of_medians():
    told = SceneSpeed("vase", [run(4.0, 2.0)], [run(8.0, 10.0)])
    assert str(told).splitlines()[0].split()[-2:] == ["0.20", "0.50"]
    ratios = {one.name: one.value for one in told.figures if "older" in one.name}
    assert ratios == {"cpu over older": pytest.approx(0.2), "wall over older": 0.5}


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"chamfer_m": 3e-4}, "chamfer"),
        ({"contours": 16}, "contours"),
        ({"gaps": 1}, "lost"),
        ({"duplicates": 1, "gaps": 1}, "lost"),
        ({"watertight": False}, "not watertight"),
        ({"genus": 1}, "has handles"),
        ({"mesh_sha256": "b"}, "not repeatable"),
    ],
)
def test_each_missed_demand_is_named(changes, fault):
    found = SceneSpeed("vase", [run(**changes), run()], [])
    assert (found.missed, found.holds) == ([fault], False)
    assert str(found).splitlines()[0].endswith(f"MISSED {fault}")


def test_what_is_waited_for_is_told_while_no_finger_is_at_work():
    def message(topic: str, second: float) -> RecordedMessage:
        return RecordedMessage(topic, "it", "It", 0, 0, 0, round(1e9 * second), 0, b"")

    said = [
        ("/hand/goal", 1.0),
        ("/hand/contacts", 1.5),  # the hand: 0.5
        ("/touch/raw", 1.6),
        ("/contour/goal", 2.0),  # the planner: 0.5
        ("/model/goal", 2.5),  # a finger is at work
        ("/finger_1/contour/traced", 4.0),
        ("/model/goal", 4.25),  # the planner: 0.25
        ("/model/shape", 6.0),  # a model: 1.75
        ("/plan/done", 6.5),
        ("/model/shape", 7.0),
    ]
    assert waits_of([message(*one) for one in reversed(said)]) == pytest.approx(
        {"hand": 0.5, "planner": 1.25, "model": 1.75, "final model": 0.5}
    )


def test_a_touch_is_told_by_all_who_handle_it():
    spent = handler_seconds(8)
    assert set(spent) == {"tracing", "casting", "filter", "curvature", "contacts"}
    assert all(0.0 < seconds < 0.1 for seconds in spent.values())


def test_growth_is_a_power_of_the_touches_that_were_made(monkeypatch):
    asked: list[tuple[str, ...]] = []

    def fake(scene: str, *more: str) -> Timed:
        asked.append(more)
        slices = re.search(r"count: (\d+)", more[-1])
        touches = 17 * int(slices[1]) if slices else 100
        return run(cpu=0.1 * touches**1.5, touches=touches)

    monkeypatch.setattr(speed, "run_timed", fake)
    rows = {row.name: row for row in speed.growth_rows(True)}
    power = rows["power of the touches"]
    assert (power.value, power.holds) == ("1.50", False)
    assert {one[-2] for one in asked} == {"--set", "--fingers"}
    assert "102 touches: processor time" in rows


def test_what_is_no_checkout_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="must be a checkout of palpate"):
        next(iter(speed.scene_rows(True, against=tmp_path)))


@pytest.mark.slow
def test_a_scene_is_timed_from_its_command_to_its_exit():
    found = speed.run_timed("sphere")
    assert 0.0 < found.first < found.wall and 0.0 < found.last < found.wall
    assert found.cpu > sum(found.nodes.values()) > 0.0
    assert sum(found.waits.values()) < found.wall
