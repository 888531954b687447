from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.explore.probing.end_observation import ProbeCommand, ProbeResult, SideContour
from palpate.core.explore.probing.faces import EndFace, FaceEdge, expected_edge, next_edge
from palpate.core.poses import split_pose

WIDTH, ALLOWED = 0.015, 2e-4
LEVEL = EndFace(0.04, np.zeros(2))
MIDDLE = np.array([[0.0, 0.0, 0.04]])


def _edge(contour: SideContour, face: EndFace = LEVEL, top: float = 0.05) -> FaceEdge:
    return expected_edge(face, contour, MIDDLE, 5e-3, top)


def _made(probing: ProbeCommand, off: float = 0.0) -> ProbeResult:
    way = split_pose(probing.pose)[1][:, 2]
    return ProbeResult(probing, "hit", probing.target + off * way, -way)


def _all_touches(edge: FaceEdge, off: list[float]) -> tuple[list[ProbeResult], float]:
    made: list[ProbeResult] = []
    while isinstance(found := next_edge(edge, made, WIDTH, ALLOWED), ProbeCommand):
        made.append(_made(found, off[len(made) % len(off)]))
    return made, found


def test_no_edge_lies_beyond_the_end(ring) -> None:
    rising = EndFace(0.04, np.array([1.0, 0.0]))
    edge = _edge(ring(0.025, 0.03, above=4e-3), rising, top=0.045)
    assert edge.places[:, 2].max() == pytest.approx(0.045)
    assert edge.untouched.max() == pytest.approx(0.045 - 0.034)


def test_an_upright_wall_meets_a_level_face_over_the_contour(ring) -> None:
    contour = ring(0.025, 0.03, above=4e-3)
    edge = _edge(contour)
    np.testing.assert_allclose(edge.places[:, :2], contour.points[:, :2])
    np.testing.assert_allclose(edge.places[:, 2], 0.04)
    np.testing.assert_allclose(edge.untouched, 6e-3)


def test_a_cone_is_carried_on_to_a_leaning_face(ring) -> None:
    contour = ring(0.025, 0.03, lean=math.radians(20.0))
    edge = _edge(contour, EndFace(0.04, np.array([0.2, 0.0])))
    radius = np.linalg.norm(edge.places[:, :2], axis=1)
    cone = 0.025 - math.tan(math.radians(20.0)) * (edge.places[:, 2] - 0.03)
    np.testing.assert_allclose(radius, cone, atol=1e-12)
    np.testing.assert_allclose(edge.places[:, 2], 0.04 + 0.2 * edge.places[:, 0], atol=1e-12)


def test_where_band_and_face_meet_no_touch_is_made(ring) -> None:
    edge = _edge(ring(0.025, 0.03, above=8e-3))
    assert next_edge(edge, [], WIDTH, ALLOWED) == pytest.approx(2e-3)


def test_a_wall_that_leans_over_the_end_has_no_edge(ring) -> None:
    assert _edge(ring(0.025, 0.03, lean=math.radians(40.0))).untouched.max() == 0.0


def test_an_edge_under_a_touch_of_the_face_is_felt(ring) -> None:
    assert _edge(ring(0.004, 0.03)).untouched.max() == 0.0


def test_a_touch_comes_at_45_degrees_from_outside(ring) -> None:
    found = next_edge(_edge(ring(0.025, 0.03)), [], WIDTH, ALLOWED)
    assert isinstance(found, ProbeCommand)
    position, axes = split_pose(found.pose)
    out = np.array([*found.target[:2] / 0.025, 0.0])
    np.testing.assert_allclose(axes[:, 2], -math.sqrt(0.5) * (out + [0.0, 0.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(position + WIDTH * axes[:, 2], found.target, atol=1e-12)
    assert found.reach > WIDTH


def test_four_touches_that_agree_are_enough(ring) -> None:
    made, untouched = _all_touches(_edge(ring(0.025, 0.03)), [1e-3, 1.1e-3])
    assert len(made) == 4 and untouched == 0.0
    turns = np.sort([math.atan2(one.point[1], one.point[0]) for one in made])
    assert np.diff(turns).min() > math.radians(60.0)


def test_touches_that_differ_are_eight_at_most(ring) -> None:
    made, _ = _all_touches(_edge(ring(0.035, 0.03)), [0.0, 1e-3])
    assert len(made) == 8


def test_a_narrow_edge_takes_fewer(ring) -> None:
    made, _ = _all_touches(_edge(ring(0.008, 0.03)), [0.0, 1e-3])
    assert len(made) <= 3


def test_an_edge_that_nobody_met_is_told_as_unfelt(ring) -> None:
    edge = _edge(ring(0.035, 0.03))
    made: list[ProbeResult] = []
    while isinstance(found := next_edge(edge, made, WIDTH, ALLOWED), ProbeCommand):
        made.append(ProbeResult(found, "miss", found.target, np.array([0.0, 0.0, 1.0])))
    assert len(made) == 8 and found == pytest.approx(0.01)
