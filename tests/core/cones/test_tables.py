from collections import Counter
from itertools import combinations_with_replacement as multisets

import numpy as np
import pytest

from palpate.core.cones import interpretations, row_of, solve_orientation, solve_origin
from palpate.core.cones.tables import (
    APEX_OFF_ENDS,
    DROPPED_ROWS,
    ENDS_SKEW,
    FACES_NOT_PARALLEL,
    FEE_ROWS,
    FFE_ROWS,
    MERIDIAN_SLOPES,
    ORIENTATION_ROWS,
    ORIGIN_ROWS,
    SIDE_OR_BOTTOM,
    SIDE_OR_TOP,
)

PLACE_ROWS = (*FEE_ROWS, *FFE_ROWS)
EXACT = 1e-9  # Of the cone's size, and rad


def by_name(rows):
    return pytest.mark.parametrize("row", rows, ids=[one.combination for one in rows])


@by_name(ORIENTATION_ROWS)
def test_every_row_of_the_first_table_gives_the_axis(row, cones):
    for cone in cones:
        found = solve_orientation(cone.features(row.features))
        if not found.sense_known:  # Vertices alone do not say which end is the top
            assert set(row.features) in ({"V_T"}, {"V_B"})
            found = found._replace(axis=found.axis * np.sign(found.axis @ cone.axis))
        assert np.linalg.norm(found.axis - cone.axis) < EXACT
        assert found.redundancy == row.redundancy
        assert found.residual_sigma < EXACT


@by_name(ORIGIN_ROWS)
def test_every_row_of_the_second_table_gives_the_apex(row, cones):
    for cone in cones:
        found = solve_origin(cone.features(row.features))
        assert np.linalg.norm(found.point - cone.apex) < EXACT * cone.size
        assert found.redundancy == row.redundancy
        assert found.residual_sigma < EXACT


@by_name(PLACE_ROWS)
@pytest.mark.parametrize("normals", [True, False])
def test_every_row_of_the_last_tables_stands_where_it_is_true(row, normals, cones):
    for cone in cones[:5]:
        touched = cone.features(row.features, place=False, normals=normals)
        (found,) = (one for one in interpretations(touched) if one.name == row.combination)
        assert found.refusals == ()
        assert found.row == row
        assert found.redundancy == row.redundancy
        assert found.residual_sigma < EXACT
        if found.orientation is not None:
            assert np.linalg.norm(found.orientation.axis - cone.axis) < EXACT
        if found.origin is not None:
            assert np.linalg.norm(found.origin.point - cone.apex) < EXACT * cone.size
        assert (found.orientation is None) == ("F_T" not in row.features) & (
            "F_B" not in row.features
        ) & (sum(name in ("E_T", "E_B") for name in row.features) < 2)


def test_one_rule_makes_twelve_and_eight_combinations():
    edges, faces = ("E_B", "E_T", "E_m"), ("F_B", "F_S", "F_T")

    def adds(names):  # No end is touched twice as a face, nor by a face and an edge that bounds it
        ends = Counter(name[-1] for name in names if name[0] == "F" and name != "F_S")
        bounds = {name[-1] for name in names if name[0] == "E"}
        return max(ends.values(), default=0) < 2 and not bounds & set(ends)

    fee = {(*pair, face) for pair in multisets(edges, 2) for face in faces}
    ffe = {(edge, *pair) for edge in edges for pair in multisets(faces, 2)}
    assert {row.features for row in FEE_ROWS} == set(filter(adds, fee))
    assert {row.features for row in FFE_ROWS} == set(filter(adds, ffe))
    assert (len(fee), len(ffe), len(FEE_ROWS), len(FFE_ROWS)) == (18, 18, 12, 8)


def test_every_corrected_row_says_what_is_printed_and_why_not():
    rows = (*ORIENTATION_ROWS, *ORIGIN_ROWS, *PLACE_ROWS, *DROPPED_ROWS)
    assert all(bool(row.printed) == bool(row.refutation) for row in rows)
    assert all(row.features == tuple(sorted(row.features)) for row in rows)


def test_a_row_is_found_in_any_order_and_a_parabolic_point_counts_as_a_meridian():
    assert row_of(["F_S", "E_T", "P_m"]) == row_of(["E_m", "F_S", "E_T"])
    assert row_of(["F_T", "E_T", "E_m"]) is None


FACES = {SIDE_OR_TOP: {"S", "T"}, SIDE_OR_BOTTOM: {"S", "B"}, ENDS_SKEW: {"S"}}


@by_name([row for row in FEE_ROWS if row.constraint in FACES and row.combination != "E_B E_m F_S"])
def test_the_face_beside_two_edges_is_what_the_row_says_and_nothing_else(row, cones):
    for cone in cones[:5]:
        found = interpretations(cone.features(row.features, place=False))
        faces = {one.features[2].place for one in found if one.stands}
        assert faces == FACES[row.constraint]


@by_name([row for row in PLACE_ROWS if row.constraint == APEX_OFF_ENDS])
def test_a_face_through_the_apex_is_no_end(row, cones):
    for cone in cones[:5]:
        found = interpretations(cone.features(row.features, place=False))
        for one in found:
            if "E_m" in one.name and ("F_T" in one.name or "F_B" in one.name):
                assert not one.stands
        twin = row.combination.replace("F_S", "F_T", 1)
        (end,) = (one for one in found if one.name == twin)
        assert APEX_OFF_ENDS in end.refusals


@by_name([row for row in PLACE_ROWS if row.constraint == MERIDIAN_SLOPES])
def test_an_edge_parallel_to_an_end_is_no_meridian(row, cones):
    for cone in cones[:5]:
        touched = cone.features(row.features, place=False)
        for one in interpretations(touched):
            ends = [two for two in one.features if two.group == "F" and two.place != "S"]
            level = [two for two in one.features if two.place == "M"]
            parallel = any(
                abs(two.direction @ three.normals[0]) < EXACT for two in level for three in ends
            )
            assert not (parallel and one.stands)
            if parallel and one.residual_sigma < 1.0:
                assert MERIDIAN_SLOPES in one.refusals


def test_parallel_faces_are_the_ends(cones):
    (row,) = (one for one in FFE_ROWS if one.constraint == FACES_NOT_PARALLEL)
    for cone in cones[:5]:
        found = interpretations(cone.features(row.features, place=False))
        listed = [one for one in found if one.stands and one.row]
        assert {one.row for one in listed} == {row}
        mixed = [one for one in found if one.name in ("E_m F_B F_S", "E_m F_S F_T")]
        assert all(FACES_NOT_PARALLEL in one.refusals for one in mixed)
