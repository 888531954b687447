"""Errata on Fearing's tables of what three fingers on a cone tell."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.cones import (
    Feature,
    InsufficientFeaturesError,
    interpretations,
    solve_orientation,
    solve_origin,
)
from palpate.core.cones.tables import DROPPED_ROWS, FEE_ROWS, FFE_ROWS
from tests.core.cones.drawing import Cone, draw_cone

RNG = np.random.default_rng(21)
CONES = [draw_cone(RNG) for _ in range(20)]


def finds_apex(cone: Cone, touched: list[Feature]) -> bool:
    off = np.linalg.norm(solve_origin(touched).point - cone.apex)
    return bool(off < 1e-9 * cone.size)


def faces_that_stand(touched: list[Feature]) -> set[str]:
    """Places of the one face whose place is asked for."""
    return {one.features[0].place for one in interpretations(touched) if one.is_possible}


def test_one_face_and_two_edges_are_no_combination_of_two_faces():
    (stray,) = DROPPED_ROWS
    groups = {row.printed: Counter(name[0] for name in row.features) for row in FFE_ROWS}
    assert stray.printed == "F_B E_T E_T"
    assert Counter(name[0] for name in stray.features) == {"E": 2, "F": 1}
    assert all(group == {"E": 1, "F": 2} for group in groups.values())
    assert stray.combination in {row.combination for row in FEE_ROWS if row.kind == "i"}
    assert len(FFE_ROWS) == 8  # as the text counts, where nine rows are printed


def test_two_contacts_on_the_top_are_one_plane_and_give_no_apex():
    for cone in CONES:
        top = cone.feature("F_T")
        other = replace(top, point=top.point + 0.01 * cone.rotation[:, 0])
        printed = [top, other, cone.feature("E_m")]
        with pytest.raises(InsufficientFeaturesError, match="anywhere on one meridian"):
            solve_origin(printed)
        assert solve_orientation(printed).redundancy == 3  # the second contact is left over
        assert finds_apex(cone, cone.features(["F_T", "F_S", "E_m"]))


def test_an_edge_of_the_bottom_and_a_parabolic_point_are_a_row_that_is_there_already():
    (row,) = (one for one in FEE_ROWS if one.printed == "F_S E_B P")
    assert row.combination == "E_B E_T F_S"
    for cone in CONES[:5]:
        touched = cone.features(["F_S", "E_B", "P_m"], place=False)
        (found,) = (one for one in interpretations(touched) if one.name == "F_S E_B P_m")
        assert found.is_possible and found.row.combination == "E_B E_m F_S"  # two rows above
    # All pairs of places of two edges beside a side.
    assert len({row.features for row in FEE_ROWS if "F_S" in row.features}) == 6


def test_an_edge_of_one_end_is_parallel_to_the_other():
    for row in (row for row in FFE_ROWS if row.kind == "i"):
        assert row.printed == "E . n is not 0"
        for cone in CONES:
            edge, *faces = cone.features(row.features)
            (end,) = (one for one in faces if one.place != "S")
            assert abs(edge.direction @ end.normals[0]) < 1e-12
            assert abs(cone.feature("E_m").direction @ end.normals[0]) > 0.5


def test_where_meridians_meet_outside_a_face_it_is_no_base():
    for cone in CONES[:10]:
        for end in "TB":
            touched = cone.features([f"F_{end}", "E_m", "E_m"], place=False)
            assert faces_that_stand(touched) == {end, "S"}


def test_a_face_beside_edges_of_one_end_may_be_the_top():
    outside, inside = Counter[str](), Counter[str]()
    for cone in CONES[:5]:
        edge = {(end, i): touch_edge(cone, end, i) for end in "TB" for i in (2, 4)}
        for end in "TB":
            for other in (edge[end, 4], touch_side(cone, 4)):
                outside.update(faces_that_stand([touch_side(cone, 3), edge[end, 2], other]))
                inside.update(faces_that_stand([touch_side(cone, 0), edge[end, 2], other]))
    assert outside == {"S": 20, "T": 20}  # sides 2 and 4 meet beyond side 3
    assert inside["S"] == 20 and inside["B"] >= 19 and inside["T"] == 0  # and behind side 0


def touch_edge(cone: Cone, end: str, chord: int) -> Feature:
    """A touch in the middle of an edge of an end, of unknown place."""
    start, stop, along, side = cone.chord(chord)
    normals = np.stack([cone.axis if end == "T" else -cone.axis, side])
    point = cone.apex + cone.depths["TB".index(end)] * (start + stop) / 2.0
    return Feature(group="E", point=point, direction=along, normals=normals)


def touch_side(cone: Cone, chord: int) -> Feature:
    """A touch in the middle of a side, of unknown place."""
    start, stop, _, side = cone.chord(chord)
    point = cone.apex + 0.7 * cone.size * (start + stop) / 2.0
    return Feature(group="F", point=point, normals=side[None])


def test_an_apex_is_on_the_plane_of_neither_end():
    for rows in (FEE_ROWS, FFE_ROWS):
        (row,) = (row for row in rows if row.kind == "ii")
        for cone in CONES[:5]:
            found = interpretations(cone.features(row.features, place=False))
            bases = [one for one in found if {"E_m", "F_B"} <= set(one.name.split())]
            assert not any(one.is_possible for one in bases)


def test_an_end_need_not_be_touched_on_its_face():
    for cone in CONES:
        touched = cone.features(["E_T", "E_B", "E_m", "E_m"])
        assert np.linalg.norm(solve_orientation(touched).axis - cone.axis) < 1e-9
        assert finds_apex(cone, touched)
        with pytest.raises(InsufficientFeaturesError, match="nothing of top or bottom"):
            solve_orientation(touched[2:])


def test_an_edge_and_a_parabolic_point_are_a_row_of_the_second_table():
    for cone in CONES:
        assert finds_apex(cone, cone.features(["P_m", "E_m"]))
        three = [*cone.features(["P_m", "P_m"]), cone.feature("E_T")]  # P E P as printed
        assert solve_origin(three).redundancy == solve_origin(three[:2]).redundancy
