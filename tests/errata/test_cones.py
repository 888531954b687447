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
from tests.core.cones.conftest import draw_cone


def random_cones(count):
    rng = np.random.default_rng(21)
    return [draw_cone(rng) for _ in range(count)]


def of_kind(rows, kind):
    return [row for row in rows if row.kind == kind]


def groups(row):
    return Counter(name[0] for name in row.features)


def faces_that_stand(touched):
    """Places of the one face whose place is asked for."""
    return {one.features[0].place for one in interpretations(touched) if one.stands}


def test_one_face_and_two_edges_are_no_combination_of_two_faces():
    (stray,) = DROPPED_ROWS
    assert stray.printed == "F_B E_T E_T"
    assert groups(stray) == {"E": 2, "F": 1}
    assert all(groups(row) == {"E": 1, "F": 2} for row in FFE_ROWS)
    assert stray.combination in {row.combination for row in of_kind(FEE_ROWS, "i")}
    assert len(FFE_ROWS) == 8  # as the text counts, where nine rows are printed


def test_two_contacts_on_the_top_are_one_plane_and_give_no_apex():
    for cone in random_cones(20):
        top = cone.feature("F_T")
        other = replace(top, point=top.point + 0.01 * cone.rotation[:, 0])
        printed, right = [top, other, cone.feature("E_m")], cone.features(["F_T", "F_S", "E_m"])
        with pytest.raises(InsufficientFeaturesError, match="anywhere on one meridian"):
            solve_origin(printed)
        assert solve_orientation(printed).redundancy == 3  # The second contact is left over
        assert np.linalg.norm(solve_origin(right).point - cone.apex) < 1e-9 * cone.size


def test_an_edge_of_the_bottom_and_a_parabolic_point_are_a_row_that_is_there_already():
    (row,) = (one for one in FEE_ROWS if one.printed == "F_S E_B P")
    assert row.combination == "E_B E_T F_S"
    for cone in random_cones(5):
        touched = cone.features(["F_S", "E_B", "P_m"], place=False)
        (found,) = (one for one in interpretations(touched) if one.name == "F_S E_B P_m")
        assert found.stands
        assert found.row.combination == "E_B E_m F_S"  # printed two rows above
    pairs = {row.features for row in FEE_ROWS if "F_S" in row.features}
    assert len(pairs) == 6  # all pairs of places of two edges beside a side


def test_an_edge_of_one_end_is_parallel_to_the_other():
    for row in of_kind(FFE_ROWS, "i"):
        assert row.printed == "E . n is not 0"
        for cone in random_cones(20):
            edge, *faces = cone.features(row.features)
            (end,) = (one for one in faces if one.place != "S")
            assert abs(edge.direction @ end.normals[0]) < 1e-12
            assert abs(cone.feature("E_m").direction @ end.normals[0]) > 0.5


def test_where_meridians_meet_outside_a_face_it_is_no_base():
    for cone in random_cones(10):
        top, bottom = (cone.features([end, "E_m", "E_m"], place=False) for end in ("F_T", "F_B"))
        assert faces_that_stand(top) == {"T", "S"}
        assert faces_that_stand(bottom) == {"B", "S"}


def rim_edge(cone, end, chord):
    """A touch in the middle of an edge of an end, of unknown place."""
    start, along_end, along, side = cone.chord(chord)
    depth = cone.depths["TB".index(end)]
    return Feature(
        group="E",
        point=cone.apex + depth * (start + along_end) / 2.0,
        direction=along,
        normals=np.stack([cone.axis if end == "T" else -cone.axis, side]),
    )


def side_face(cone, chord):
    """A touch in the middle of a side, of unknown place."""
    start, end, _, side = cone.chord(chord)
    return Feature(
        group="F", point=cone.apex + 0.7 * cone.size * (start + end) / 2.0, normals=side[None]
    )


def test_a_face_beside_edges_of_one_end_may_be_the_top():
    outside, inside = Counter(), Counter()
    for cone in random_cones(5):
        for end in "TB":
            edge = rim_edge(cone, end, 2)
            for other in (rim_edge(cone, end, 4), side_face(cone, 4)):
                outside.update(faces_that_stand([side_face(cone, 3), edge, other]))
                inside.update(faces_that_stand([side_face(cone, 0), edge, other]))
    assert outside == {"S": 20, "T": 20}  # Sides 2 and 4 meet beyond side 3
    assert inside == {"S": 20, "B": 19}  # And behind side 0


def test_an_apex_is_on_the_plane_of_neither_end():
    for kind, rows in (("ii", FEE_ROWS), ("ii", FFE_ROWS)):
        (row,) = of_kind(rows, kind)
        for cone in random_cones(5):
            for one in interpretations(cone.features(row.features, place=False)):
                if "E_m" in one.name and "F_B" in one.name:
                    assert not one.stands


def test_an_end_need_not_be_touched_on_its_face():
    for cone in random_cones(20):
        touched = cone.features(["E_T", "E_B", "E_m", "E_m"])
        assert np.linalg.norm(solve_orientation(touched).axis - cone.axis) < 1e-9
        assert np.linalg.norm(solve_origin(touched).point - cone.apex) < 1e-9 * cone.size
        with pytest.raises(InsufficientFeaturesError, match="nothing of top or bottom"):
            solve_orientation(touched[2:])


def test_an_edge_and_a_parabolic_point_are_a_row_of_the_second_table():
    for cone in random_cones(20):
        found = solve_origin(cone.features(["P_m", "E_m"]))
        assert np.linalg.norm(found.point - cone.apex) < 1e-9 * cone.size
        three = [*cone.features(["P_m", "P_m"]), cone.feature("E_T")]  # P E P as printed
        assert solve_origin(three).redundancy == solve_origin(three[:2]).redundancy
