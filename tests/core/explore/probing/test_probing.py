"""Single touches of an object's ends: where they go, in what order, and when they are enough."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.explore import probing
from palpate.core.explore.probing import ProbeCommand, ProbeResult, SideContour, next_probe
from palpate.core.explore.tracing import deepest_point
from palpate.core.geometry import winding_number
from palpate.core.poses import FACING_DOWN, Pose, rotations_from_vectors
from palpate.core.shapes import PosedShape, Shape, Superquadric
from palpate.core.touch import DEFAULT_CONTACT, HITS, Pad, fit_patch, guarded_move

PAD = Pad(16, 16, 1e-3, 3e-3, 1.0 / 0.015, 0.8)
WIDTH = 0.015
UP = np.array([0.0, 0.0, 1.0])
BALL = Superquadric(np.array([0.03, 0.03, 0.04]), np.ones(2))
# An upper end at 40 mm of an object of 80 mm.
END = probing.EndObservation(
    height=0.04, deviation=5e-4, other_height=-0.04, radius=0.03, width=WIDTH, tolerance=2e-4
)
Answer = Callable[[ProbeCommand], ProbeResult]


def column(radius: float) -> Superquadric:
    return Superquadric(np.array([radius, radius, 0.04]), np.array([0.1, 1.0]))


def ring(radius: float, height: float, lean: float = 0.0, below=7e-3, above=0.0) -> SideContour:
    """A round contour of a wall that leans, whose touches reached so far below and above it."""
    turn = 2.0 * math.pi * np.arange(60) / 60
    out, level = np.column_stack([np.cos(turn), np.sin(turn)]), np.full(60, height)
    normals = np.column_stack([math.cos(lean) * out, np.full(60, math.sin(lean))])
    return SideContour(
        np.column_stack([radius * out, level]), normals, level - below, level + above
    )


def press(shape: Shape) -> Answer:
    """Simulated touches of a solid."""

    def answer(command: ProbeCommand) -> ProbeResult:
        end = guarded_move(shape, PAD, command.pose, command.reach, 1e-3)
        position, axes = command.pose
        if end.outcome not in HITS:
            return ProbeResult(command, end.outcome, position, -axes[:, 2])
        touched = end.compression > DEFAULT_CONTACT.min_compression
        surface = PAD.surface(end.compression, touched)
        normal = axes @ np.asarray(fit_patch(PAD, surface, touched, axes[2], 0.0).normal)
        point = end.pose.to_outer(deepest_point(PAD, surface, touched)[None])[0]
        return ProbeResult(command, end.outcome, point, normal)

    return answer


def plane(height: float, slopes=(0.0, 0.0), edge_off=(0.0,)) -> Answer:
    """Exact touches of a plane, and of its edge so far behind where it is expected, in turn."""
    normal = np.array([-slopes[0], -slopes[1], 1.0])
    edges = [0]

    def answer(command: ProbeCommand) -> ProbeResult:
        inward = command.pose.axes[:, 2]
        if command.reason == "edge":
            edges[0] += 1
            off = edge_off[edges[0] % len(edge_off)]
            return ProbeResult(command, "hit", command.target + off * inward, -inward)
        place = command.target[:2]
        point = np.array([*place, height + place @ slopes])
        return ProbeResult(command, "hit", point, normal / np.linalg.norm(normal))

    return answer


def probe(answer: Answer, end: str = "upper", **known: Any):
    """Probes to the end: the reason to stop, with everything that was made."""
    observation = replace(END, **known)
    while isinstance(command := next_probe(end, observation), ProbeCommand):
        observation = replace(observation, probes=(*observation.probes, answer(command)))
        assert len(observation.probes) <= 40
    return command, observation.probes


def reasons(probes: tuple[ProbeResult, ...]) -> str:
    return "".join(one.command.reason[0] for one in probes)


def targets(probes: tuple[ProbeResult, ...], reason: str) -> Floats:
    chosen = [one.command.target for one in probes if one.command.reason == reason]
    return np.array(chosen).reshape(-1, 3)


@pytest.mark.parametrize("height", [0.04, 0.06])
def test_end_is_found_by_one_touch_along_axis(height):
    done, probes = probe(press(BALL), height=height)
    assert (len(probes), done.reason, done.untouched) == (1, "the end is found", 0.0)
    assert probes[0].point == pytest.approx([0.0, 0.0, 0.04], abs=1e-3)
    assert probes[0].point[2] == pytest.approx(0.04, abs=5e-5)
    position, axes = probes[0].command.pose
    assert axes[:, 2] == pytest.approx(-UP, abs=1e-12)
    # A contour reaches higher than the end may lie.
    high = next_probe("upper", replace(END, contour=ring(0.02, 0.04, above=4e-3))).pose.position[2]
    assert high - next_probe("upper", END).pose.position[2] == pytest.approx(2.5e-3)
    # It starts above everything the end may be, and may go down to the middle.
    assert height + 3.0 * END.deviation < position[2] < height + 0.01
    assert position[2] - probes[0].command.reach == pytest.approx(0.5 * (height - 0.04))


def test_object_off_axis_is_found_and_flank_climbed_to_top():
    aside = PosedShape(BALL, Pose(np.array([0.013, -0.01, 0.0]), np.eye(3)))
    heights = [one.point[2] for one in probe(press(aside))[1]]
    assert heights[0] < 0.0395 and max(heights) == pytest.approx(0.04, abs=1e-4)
    assert len(heights) <= 4
    beside = PosedShape(column(0.01), Pose(np.array([0.02, 0.0, 0.0]), np.eye(3)))
    done, probes = probe(press(beside))
    assert [one.outcome for one in probes] == ["miss", "hit"] and done.reason == "the end is found"
    turn = rotations_from_vectors(np.array([[0.0, math.radians(12.0), 0.0]]))[0]
    tip = Superquadric(np.array([0.015, 0.015, 0.045]), np.ones(2))
    leaning = PosedShape(tip, Pose(np.zeros(3), turn))  # its pole lies beside the first touch
    contour = ring(0.0115, 0.03, math.radians(35.0), above=2e-3)
    heights = [one.point[2] for one in probe(press(leaning), contour=contour)[1]]
    assert max(heights) == pytest.approx(leaning.bounds()[1, 2], abs=1e-4)
    assert 2 <= len(heights) <= 3


def leaning_touch(x: float, height: float, lean: float = 0.0, outcome: str = "hit") -> ProbeResult:
    target = np.array([x, 0.002, height])
    normal = np.array([math.sin(lean), 0.0, math.cos(lean)])
    command = ProbeCommand(Pose(target, FACING_DOWN), 0.03, "search", target)
    return ProbeResult(command, outcome, target, normal)


def test_climb_goes_uphill_within_pad_and_ends_at_top():
    def following(*probes: ProbeResult):
        return next_probe("upper", replace(END, probes=probes))

    step = following(leaning_touch(0.01, 0.03, 0.3)).pose.position[:2] - [0.01, 0.002]
    assert step[1] == pytest.approx(0.0) and -0.5 * WIDTH < step[0] < -0.25 * WIDTH
    assert not isinstance(following(leaning_touch(0.01, 0.03, math.radians(2.7))), ProbeCommand)
    top = leaning_touch(0.0, 0.04)
    assert not isinstance(following(leaning_touch(0.03, 0.03, 0.5), top), ProbeCommand)
    tried = leaning_touch(0.01 + step[0], 0.04, outcome="miss")
    assert not isinstance(following(leaning_touch(0.01, 0.04, 0.3), tried), ProbeCommand)
    ramp = [leaning_touch(-0.1 * k, 0.04 + 0.01 * k, 0.3) for k in range(20)]
    climbs = [isinstance(following(*ramp[:k]), ProbeCommand) for k in range(1, 20)]
    assert 3 < sum(climbs) < 12 and climbs == sorted(climbs, reverse=True)


def test_end_higher_than_expected_is_approached_from_farther_off():
    done, (one, two) = probe(press(BALL), height=0.02)
    assert (one.outcome, two.outcome, done.reason) == ("inside", "hit", "the end is found")
    assert two.command.pose.position[2] - one.command.pose.position[2] == pytest.approx(WIDTH)
    assert two.command.reach - one.command.reach == pytest.approx(WIDTH)
    probes: tuple[ProbeResult, ...] = ()
    for _ in range(5):  # at most four times
        command = next_probe("upper", replace(END, probes=probes))
        probes = (*probes, ProbeResult(command, "inside", np.zeros(3), UP))
    first, last = (probes[number].command.pose.position[2] for number in (0, -1))
    assert last - first == pytest.approx(4 * WIDTH)
    assert np.linalg.norm(next_probe("upper", replace(END, probes=probes)).pose.position[:2]) > 0.01


@pytest.mark.parametrize("contour", [None, ring(0.025, 0.03)], ids=["no contour", "a contour"])
def test_search_of_empty_space_ends(contour):
    nothing = lambda command: ProbeResult(command, "miss", command.target, UP)  # noqa: E731
    done, probes = probe(nothing, contour=contour)
    assert done.reason == "nothing was touched" and done.untouched >= 0.05
    assert 1 < len(probes) <= 19
    places = np.array([one.command.pose.position[:2] for one in probes])
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(len(places))
    assert apart.min() > 0.35 * WIDTH
    limit = END.radius if contour is None else 0.025
    assert np.linalg.norm(places, axis=1).max() < limit + 1e-9


def test_pole_and_narrow_top_take_one_touch_despite_noise():
    for radius, noise in ((0.014, 0.0), (0.0048, 1e-4)):  # no whole pad lies on the narrow one
        contour = ring(radius - 2e-4, 0.037, above=2e-3)
        done, probes = probe(press(column(radius)), contour=contour, noise=noise)
        assert reasons(probes) == "s" and done.untouched < 0.0105
    for noise in (0.0, 1e-4):
        contour = ring(0.0103, 0.0376, math.radians(67.0), above=1e-3)
        done, probes = probe(press(BALL), contour=contour, noise=noise)
        assert reasons(probes) == "s" and done.untouched < 0.01
        assert done.reason == "nothing larger than a pad is untouched"


@pytest.mark.parametrize("radius", [0.024, 0.014, 0.011])
def test_flat_top_takes_touches_by_its_share_of_surface_and_noise(radius):
    contour = ring(radius, 0.037, above=2e-3)
    _, probes = probe(plane(0.04), contour=contour, noise=1e-4)
    share = radius / (2.0 * (radius + END.height - END.other_height))
    enough = share * (1e-4 / (0.05 * END.tolerance)) ** 2
    assert abs(len(probes) - max(enough, 5.0)) <= 1.0
    assert len(probe(plane(0.04), contour=contour, noise=1e-6)[1]) <= 5 < enough


def test_face_is_touched_where_largest_disc_is_untouched():
    contour = ring(0.025, 0.037, above=3e-3)
    _, probes = probe(plane(0.04), contour=contour)
    points = np.array([one.point[:2] for one in probes])
    grid = np.stack(np.meshgrid(*[np.linspace(-0.025, 0.025, 101)] * 2), axis=-1).reshape(-1, 2)
    grid = grid[np.linalg.norm(grid, axis=1) < 0.025]
    for count in range(1, 5):

        def clear(places, made=points[:count]):
            away = np.linalg.norm(places[:, None] - made, axis=2).min(axis=1) - 0.35 * WIDTH
            return np.minimum(away, 0.025 - np.linalg.norm(places, axis=1))

        assert clear(points[count][None])[0] > clear(grid).max() - 1.2e-3  # of the room's grid
    turn = np.linspace(-0.4 * math.pi, 1.4 * math.pi, 40)
    out = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    horseshoe = np.concatenate([0.03 * out, 0.02 * out[::-1]]) + 0.03 * UP
    level = np.full(80, 0.03)
    contour = SideContour(horseshoe, np.tile([1.0, 0.0, 0.0], (80, 1)), level, level)
    place = next_probe("upper", replace(END, contour=contour)).target[None, :2]
    assert winding_number(horseshoe[:, :2], place)[0] != 0  # within, not at its middle


def test_leaning_face_is_touched_along_its_normal_in_its_plane():
    lean = 0.3
    _, probes = probe(plane(0.03, (-math.tan(lean), 0.1)), contour=ring(0.02, 0.01))
    faces = [one for one in probes if one.command.reason == "face"]
    assert len(faces) >= 4
    for one in faces:
        inward = one.command.pose.axes[:, 2]
        assert inward == pytest.approx(-one.normal, abs=1e-6)
        assert one.command.target == pytest.approx(one.point, abs=1e-9)
    level = [one.command for one in probe(plane(0.03, (0.05, 0.0)), contour=ring(0.02, 0.01))[1]]
    assert all(one.pose.axes[2, 2] == -1.0 for one in level if one.reason == "face")
    edge = np.array([0.9, 0.0, 0.4]) / math.hypot(0.9, 0.4)  # normals of an edge are not believed
    points = np.array([[0.0, 0.0, 0.04], [0.00525, 0.0, 0.0401], [0.0, 0.012, 0.04]])
    made = [ProbeResult(level[0]._replace(target=one), "hit", one, edge) for one in points]
    known = replace(END, contour=ring(0.025, 0.02), probes=tuple(made))
    target = next_probe("upper", known).target
    assert target[2] == pytest.approx(0.04 + 1e-4 / 0.00525 * target[0], abs=1e-6)


@pytest.mark.parametrize("case", ["step", "lean", "hollow", "dish", "wide"])
def test_top_that_is_no_plane_is_touched_all_over(case):
    def answer(command: ProbeCommand) -> ProbeResult:
        x, y = command.target[:2]
        depth = {"step": 2e-3 * (x > 0.008), "dish": 4e-3 - 4.0 * (x * x + y * y), "wide": 0.1 * x}
        lean = 0.1 * (y > 0.008) if case == "lean" else 0.0
        normal = np.array([0.0, lean, math.sqrt(1.0 - lean**2)])
        return ProbeResult(command, "hit", np.array([x, y, 0.04 - depth.get(case, 0.0)]), normal)

    radius, above = 0.09 if case == "wide" else 0.028, 20e-3 if case == "hollow" else 3e-3
    done, probes = probe(answer, contour=ring(radius, 0.037, above=above))
    touches = len(probes) - len(targets(probes, "edge"))
    if case == "wide":
        assert touches == 14 and done.untouched > WIDTH
        assert done.reason == "14 touches have not reached all of it"
    else:
        assert 5 < touches <= 14
        assert done.reason == "nothing larger than a pad is untouched"


def test_touch_outside_contour_is_no_touch_of_face():
    around = ring(0.0103, 0.0376, math.radians(67.0), above=1e-3)
    start = np.array([0.027, 0.0, 0.06])
    over = ProbeCommand(Pose(start, FACING_DOWN), 0.05, "search", start - 0.02 * UP)
    aside = press(BALL)(over)
    first = next_probe("upper", replace(END, contour=around, probes=(aside,)))
    assert first.reason == "face" and first.target[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    made = aside, ProbeResult(first, "miss", first.target, UP)
    again = next_probe("upper", replace(END, contour=around, probes=made))
    assert not isinstance(again, ProbeCommand) or np.linalg.norm(again.target[:2]) > 1e-3


@pytest.mark.parametrize("lean", [0.0, math.radians(20.0)])
def test_edge_is_where_wall_meets_face(lean):
    slope = 0.0 if lean == 0.0 else 0.08
    _, probes = probe(plane(0.04, (slope, 0.0)), contour=ring(0.025, 0.03, lean, above=1e-3))
    edges = targets(probes, "edge")
    assert 4 <= len(edges) <= 8
    assert edges[:, 2] == pytest.approx(0.04 + slope * edges[:, 0], abs=3e-4)
    cone = 0.025 - math.tan(lean) * (edges[:, 2] - 0.03)
    assert np.linalg.norm(edges[:, :2], axis=1) == pytest.approx(cone, abs=2e-4)
    for one in probes:
        if one.command.reason == "edge":
            position, axes = one.command.pose
            out = np.array([*one.command.target[:2], 0.0])
            out /= np.linalg.norm(out)
            assert axes[:, 2] == pytest.approx(-math.sqrt(0.5) * (out + UP), abs=0.1)
            assert position + WIDTH * axes[:, 2] == pytest.approx(one.command.target)
            assert WIDTH < one.command.reach < 2.0 * WIDTH
    turns = np.sort(np.arctan2(edges[:, 1], edges[:, 0]))
    assert np.diff(turns).min() > math.radians(30.0)


@pytest.mark.parametrize(
    ("contour", "off", "edges"),
    [
        (ring(0.025, 0.03), (1e-3, 1.1e-3), range(4, 5)),  # touches that agree
        (ring(0.035, 0.03), (0.0, 1e-3), range(8, 9)),  # that differ
        (ring(0.008, 0.03), (0.0, 1e-3), range(1, 4)),  # a narrow edge
        (ring(0.004, 0.03), (0.0,), range(1)),  # under a touch of the face
        (ring(0.025, 0.03, above=8e-3), (0.0,), range(1)),  # where band and face nearly meet
        (ring(0.025, 0.03, math.radians(40.0)), (0.0,), range(1)),  # a wall that leans over the end
    ],
)
def test_edge_takes_touches_until_they_agree(contour, off, edges):
    _, probes = probe(plane(0.04, edge_off=off), contour=contour)
    assert len(targets(probes, "edge")) in edges


def test_edge_that_is_never_met_is_reported_untouched():
    flat = plane(0.04)

    def answer(command: ProbeCommand) -> ProbeResult:
        made = flat(command)
        return made._replace(outcome="miss") if command.reason == "edge" else made

    done, probes = probe(answer, contour=ring(0.035, 0.03), tolerance=2e-4)
    assert len(targets(probes, "edge")) == 8
    assert done.untouched >= 0.01
    command = ProbeCommand(Pose(0.0 * UP, np.eye(3)), 0.01, "edge", np.zeros(3))
    alone = ProbeResult(command, "hit", np.zeros(3), UP)  # it is no touch of the face
    stop = next_probe("upper", replace(END, contour=ring(0.02, 0.03), probes=(alone,)))
    assert (stop.reason, stop.untouched) == ("only its edge was touched", 0.0)


def turned(array: Floats) -> Floats:
    return array * [1.0, -1.0, -1.0]


def test_lower_end_is_upper_one_turned_over():
    contour = ring(0.025, 0.03, above=3e-3)
    done, probes = probe(press(column(0.025)), contour=contour)
    assert (reasons(probes), done.reason) == ("sffffeeee", "5 touches lie in one plane")
    low, high = -contour.contact_high, -contour.contact_low
    below = SideContour(turned(contour.points), turned(contour.normals), low, high)
    below = replace(END, height=-0.04, other_height=0.04, contour=below)
    for made in probes:
        command, upper = next_probe("lower", below), made.command
        for one, other in zip(
            (*command.pose, command.target), (*upper.pose, upper.target), strict=True
        ):
            assert pytest.approx(turned(other.T), abs=1e-9) == one.T
        assert (command.reach, command.reason) == (pytest.approx(upper.reach), upper.reason)
        result = ProbeResult(command, made.outcome, turned(made.point), turned(made.normal))
        below = replace(below, probes=(*below.probes, result))
    assert next_probe("lower", below) == done
    below = replace(below, is_standing=True, probes=(), contour=ring(0.025, -0.03, below=6e-3))
    stop = next_probe("lower", below)
    assert stop.reason == "it stands on the platform" and stop.untouched == pytest.approx(4e-3)
    assert next_probe("lower", replace(below, contour=None)).untouched == 0.0
    with pytest.raises(ValueError, match="height of the upper end must lie beyond the other one's"):
        next_probe("upper", below)


@settings(derandomize=True, deadline=None, max_examples=3)
@given(
    st.tuples(st.floats(0.008, 0.06), st.floats(0.008, 0.06)),
    st.tuples(st.floats(0.1, 1.6), st.floats(0.1, 1.6)),
    st.floats(-1.0, 1.0),
)
@example((0.0546875, 0.052734375), (0.90625, 0.625), 0.34375)
def test_every_end_is_done_in_24_touches_none_above_solid(size, exponents, lean):
    turn = rotations_from_vectors(np.array([[0.4 * lean, 0.3 * lean, 0.0]]))[0]
    solid = Superquadric(np.array([*size, 0.04]), np.array(exponents))
    shape = PosedShape(solid, Pose(np.zeros(3), turn))
    low, high = shape.bounds()[:, 2]
    around = 2.0 * math.pi * np.arange(24) / 24
    out = np.column_stack([np.cos(around), np.sin(around), 0.0 * around])
    level = low + 0.9 * (high - low)
    ways = np.array([shape.cast((0.2 * one + level * UP)[None], -one, 0.4)[0] for one in out])
    hits, contour = np.isfinite(ways), None
    if hits.sum() > 2:
        band = np.full(hits.sum(), level)
        points = out[hits] * (0.2 - ways[hits, None]) + level * UP
        contour = SideContour(points, out[hits], band - 5e-3, band + 3e-3)
    known = {"height": float(high), "other_height": float(low), "deviation": 1e-3, "radius": 0.06}
    done, probes = probe(press(shape), **known, noise=1e-4, contour=contour)
    assert len(probes) <= 24 and done.untouched >= 0.0
    if contour is not None and done.reason != "nothing was touched":
        # How far the solid reaches: the dual norm. The bounds are those of a tessellation.
        across, along = 2.0 / (2.0 - solid.exponents[1]), 2.0 / (2.0 - solid.exponents[0])
        x, y, z = np.abs(solid.size * turn[2])
        top = ((x**across + y**across) ** (along / across) + z**along) ** (1.0 / along)
        assert high <= top + 1e-9
        assert max(one.point[2] for one in probes if one.touched) <= top + 1e-6


RING = ring(0.025, 0.03)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"radius": 0.0}, "radius must be positive and finite, got 0.0 m"),
        ({"width": -1.0}, "width must be positive"),
        ({"tolerance": math.nan}, "tolerance must be positive"),
        ({"deviation": -1e-3}, "deviation must be 0 or more and finite, got -0.001 m"),
        ({"noise": math.inf}, "noise must be 0 or more and finite"),
        ({"height": -0.04}, "height must be finite and differ from that of the other end"),
        ({"other_height": math.inf}, "height must be finite and differ"),
        ({"contour": SideContour(*(one[:2] for one in RING))}, "at least 3, got 2"),
        ({"contour": RING._replace(normals=RING.normals[:3])}, "contour.normals must"),
        ({"contour": RING._replace(contact_high=RING[3][:3])}, "contour.contact_high must"),
        ({"contour": RING._replace(contact_low=np.nan * RING[2])}, "contact_low must be finite"),
    ],
)
def test_invalid_end_observation_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        replace(END, **change)
