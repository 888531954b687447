import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.cones import Feature, interpretations
from palpate.core.cones.interpretation import (
    BETWEEN_ENDS,
    CONVEX,
    FITS,
    OUTWARD,
    RIM_NORMAL,
    RIM_SUPPORTS,
    SECTION_HOLDS_AXIS,
)
from palpate.core.cones.tables import BELOW_APEX
from tests.core.cones.test_solving import noisy


def named(found, name):
    (one,) = (two for two in found if two.name == name)
    return one


def test_those_that_stand_come_first_and_all_places_are_tried(cones):
    for cone in cones[:5]:
        found = interpretations(cone.features(["F_B", "E_m", "E_T"], place=False))
        assert len(found) == 27
        stands = [one.stands for one in found]
        assert stands == sorted(stands, reverse=True)
        assert all(one.residual_sigma <= 3.0 for one in found if one.stands)
        assert all(one.stands or one.refusals for one in found)


def test_known_places_are_kept(cones):
    touched = cones[0].features(["F_T", "E_m"]) + cones[0].features(["E_B"], place=False)
    found = interpretations(touched)
    assert [one.name[:7] for one in found] == ["F_T E_m"] * 3
    assert found[0].name == "F_T E_m E_B"


def test_the_truth_stands_under_noise(cones):
    rng = np.random.default_rng(9)
    names = ["F_T", "E_m", "E_m", "F_S"]
    for cone in cones:
        found = interpretations(noisy(cone.features(names, place=False), rng))
        truth = named(found, " ".join(names))
        assert truth.stands, truth.refusals
        assert math.acos(min(truth.orientation.axis @ cone.axis, 1.0)) < math.radians(5.0)
        assert np.linalg.norm(truth.origin.point - cone.apex) < 0.15 * cone.size


def test_both_ends_and_meridians_have_one_interpretation(cones):
    for cone in cones[:8]:
        for names in (["F_B", "P_m", "E_m", "F_S"], ["F_T", "F_B", "E_m", "E_m"]):
            found = interpretations(cone.features(names, place=False))
            assert [one.name for one in found if one.stands] == [" ".join(names)]


def test_parabolic_points_are_meridians_of_the_tables(cones):
    found = interpretations(cones[0].features(["F_T", "E_m", "P_m"], place=False))
    truth = named(found, "F_T E_m P_m")
    assert truth.stands
    assert truth.row.combination == "E_m E_m F_T"


def test_combinations_that_the_tables_leave_out_have_no_row(cones):
    truth = named(
        interpretations(cones[0].features(["F_T", "E_T", "E_m"], place=False)), "F_T E_T E_m"
    )
    assert truth.stands
    assert truth.row is None


def test_interpretations_turn_and_move_with_the_features(cones, rotations):
    turn, shift = rotations(1)[0], np.array([0.1, -0.4, 0.2])
    touched = cones[3].features(["F_S", "E_m", "E_T"], place=False)
    moved = [
        replace(
            one,
            point=turn @ one.point + shift,
            direction=None if one.direction is None else turn @ one.direction,
            normals=one.normals @ turn.T,
        )
        for one in touched
    ]
    here, there = ({one.name for one in interpretations(x) if one.stands} for x in (touched, moved))
    assert here == there


def test_a_meridian_above_the_apex_is_refused(cones):
    for cone in cones[:5]:
        touched = cone.features(["F_T", "E_m", "E_m"], place=False)
        mirrored = replace(touched[1], point=2.0 * cone.apex - touched[1].point)
        found = named(interpretations([touched[0], mirrored, touched[2]]), "F_T E_m E_m")
        assert BELOW_APEX in found.refusals


def test_a_face_turned_inside_out_is_refused(cones):
    for cone in cones[:5]:
        face, *lines = cone.features(["F_T", "E_m", "E_m"], place=False)
        found = named(
            interpretations([replace(face, normals=-face.normals), *lines]), "F_T E_m E_m"
        )
        assert CONVEX in found.refusals
        found = named(interpretations([face, *lines]), "F_B E_m E_m")
        assert OUTWARD in found.refusals or BELOW_APEX in found.refusals


def test_a_contact_above_the_top_is_refused(cones):
    for cone in cones[:5]:
        edges = cone.features(["E_T", "E_T"], normals=False)
        line = replace(cone.feature("E_m"), point=cone.apex + 0.3 * cone.depths[0] * cone.ray(0.1))
        vertex = cone.feature("V_B")
        found = interpretations([*edges, vertex, line])[0]
        assert BETWEEN_ENDS in found.refusals


def test_one_face_beside_an_edge_of_an_end_is_that_end(cones):
    for cone in cones[:5]:
        edge = cone.feature("E_T")
        tilted = (edge.normals[0] + edge.normals[1]) / np.linalg.norm(edge.normals.sum(axis=0))
        wrong = replace(edge, normals=np.stack([tilted, edge.normals[1]]))
        face = cone.feature("F_B")
        assert RIM_NORMAL not in interpretations([face, edge])[0].refusals
        assert RIM_NORMAL in interpretations([face, wrong])[0].refusals


def test_the_body_lies_on_one_side_of_the_plane_through_apex_and_edge(cones):
    for cone in cones[:5]:
        touched = [*cone.features(["F_T", "E_m", "E_m", "P_m"]), cone.feature("E_T", normals=False)]
        assert interpretations(touched)[0].stands
        inner = cone.apex + cone.depths[0] * cone.rotation @ [*cone.middle, -1.0]
        radial = cone.feature("V_T", 0).point - cone.feature("V_T", 2).point
        edge = replace(touched[4], point=inner, direction=radial / np.linalg.norm(radial))
        lines = [cone.feature("P_m", 0), cone.feature("E_m", 0), cone.feature("E_m", 1)]
        assert RIM_SUPPORTS in interpretations([touched[0], *lines, edge])[0].refusals


def test_what_does_not_fit_is_refused(cones):
    for cone in cones[:5]:
        face, line, other = cone.features(["F_T", "E_m", "E_m"])
        aside = 0.03 * np.cross(line.direction, other.direction)
        found = interpretations([face, replace(line, point=line.point + aside), other])[0]
        assert FITS in found.refusals
        assert found.residual_sigma > 3.0


def test_a_section_beside_the_axis_is_a_cone_unless_it_is_said_to_hold_it(draw):
    rng, held = np.random.default_rng(12), []
    for _ in range(10):
        cone = draw(rng, beside=1.5)
        touched = cone.features(["F_T", "E_m", "E_m", "F_S", "F_S", "F_S"])
        assert interpretations(touched)[0].stands
        found = interpretations(touched, section_holds_axis=True)[0]
        assert found.refusals in ((), (SECTION_HOLDS_AXIS,))
        upward = all(one.normals[0] @ cone.axis > 0.0 for one in touched if one.place == "S")
        assert found.stands or not upward
        held.append(found.stands)
    assert not all(held)


def test_top_and_bottom_change_places_unless_the_section_holds_the_axis(cones):
    for cone in cones[:5]:
        touched = cone.features(["F_T", "F_S", "E_B"], place=False)
        open_ = {one.name for one in interpretations(touched) if one.stands}
        assert {"F_T F_S E_B", "F_B F_S E_T"} <= open_
        found = interpretations(touched, section_holds_axis=True)
        assert "F_B F_S E_T" not in {one.name for one in found if one.stands}
        assert named(found, "F_T F_S E_B").stands


def test_the_bottom_lies_below_the_top(cones):
    for cone in cones[:5]:
        level = replace(cone.feature("V_T"), place="B")
        assert BETWEEN_ENDS in interpretations([cone.feature("F_T"), level])[0].refusals
        assert interpretations(cone.features(["F_T", "V_B"]))[0].stands


def test_an_apex_that_is_hardly_known_is_no_ground_to_refuse_a_top(cones):
    for cone in cones:  # The meridian is next to the face
        touched = [cone.feature("F_S", 1), cone.feature("E_m", 1), cone.feature("F_T")]
        assert interpretations(touched)[0].refusals == ()


def test_an_apex_that_is_free_along_a_level_line_need_not_rise():
    c, s = math.cos(0.3), math.sin(0.3)
    sides = []
    for sign in (1.0, -1.0):  # Two sides of a wedge about z that meet in the y axis
        normal, down = np.array([sign * c, 0.0, s]), np.array([sign * s, 0.0, -c])
        sides.append(Feature(group="F", place="S", point=0.08 * down, normals=normal[None]))
    edge = Feature(
        group="E",
        place="T",
        point=0.04 * np.array([s, 0.0, -c]),
        direction=np.array([0.0, 1.0, 0.0]),
        normals=np.array([[0.0, 0.0, 1.0], [c, 0.0, s]]),
    )
    found = interpretations([*sides, edge])[0]
    assert found.refusals == ()
    assert found.origin is None


def test_wrong_numbers_of_features_and_bad_noise_are_refused(cones):
    touched = cones[0].features(["F_T", "E_m"])
    with pytest.raises(ValueError, match="features must be 1 to 6, got 0"):
        interpretations([])
    with pytest.raises(ValueError, match="features must be 1 to 6, got 8"):
        interpretations(touched * 4)
    with pytest.raises(ValueError, match="tolerance must be positive and finite, got 0"):
        interpretations(touched, tolerance=0.0)
    with pytest.raises(ValueError, match="angle_noise must be positive"):
        interpretations(touched, angle_noise=-1.0)


def test_a_single_touch_may_be_anything():
    vertex = Feature(group="V", point=np.zeros(3))
    assert {one.name for one in interpretations([vertex]) if one.stands} == {"V_T", "V_B"}
