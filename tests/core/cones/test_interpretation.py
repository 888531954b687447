"""Laws of the places that contact features may have on a cone."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations_with_replacement as multisets

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.core.cones import Feature, Interpretation, interpretations, row_of
from tests.core.cones.drawing import cones, draw_cone, moved, noisy

EXACT = 1e-9  # fraction of the cone's size, and [rad]
EDGES, FACES = ("E_B", "E_T", "E_m"), ("F_B", "F_S", "F_T")
TRIPLES = sorted(
    {tuple(sorted((*pair, face))) for pair in multisets(EDGES, 2) for face in FACES}
    | {tuple(sorted((edge, *pair))) for edge in EDGES for pair in multisets(FACES, 2)}
)


def adds_something(names: Sequence[str]) -> bool:
    """Whether no end has two faces, or a face and an edge that bounds it."""
    ends = Counter(name[-1] for name in names if name in ("F_T", "F_B"))
    bounds = {name[-1] for name in names if name[0] == "E"}
    return max(ends.values(), default=0) < 2 and not bounds & set(ends)


ROWS = [row_of(names) for names in TRIPLES if adds_something(names)]
APEX_OFF_ENDS = "the apex is not on the plane of an end face"
MERIDIAN_SLOPES = "a meridian is not parallel to an end face"
NOT_PARALLEL = "end and side planes are not parallel"
BELOW_APEX = "a contact lies below the apex"
BETWEEN_ENDS = "every contact lies between the planes of the ends, the top above the bottom"
RIM_NORMAL = "one of the faces beside an edge of an end is that end"


def named(assigned: Iterable[Interpretation], name: str) -> Interpretation:
    (item,) = (item for item in assigned if item.name == name)
    return item


def possible_names(features: Sequence[Feature], **options: bool) -> set[str]:
    return {one.name for one in interpretations(features, **options) if one.is_possible}


def test_tables_have_twelve_and_eight_combinations():
    assert [row_of(names) is not None for names in TRIPLES] == [*map(adds_something, TRIPLES)]
    assert Counter(row.table for row in ROWS) == {"1.3": 12, "1.4": 8}
    for row in ROWS:
        assert row_of(row.features[::-1]) == row
        assert row.combination == " ".join(sorted(row.features))
        assert bool(row.printed) == bool(row.refutation)
    assert row_of(["F_S", "E_T", "P_m"]) == row_of(["E_m", "F_S", "E_T"])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.combination)
def test_row_is_possible_where_it_is_true(row):
    for number, cone in enumerate(cones()[:3]):
        touched = cone.features(row.features, place=False, normals=number != 1)
        assigned = interpretations(touched)
        truth = named(assigned, row.combination)
        assert truth.violations == () and truth.row == row
        assert truth.redundancy == row.redundancy and truth.residual_sigma < EXACT
        if truth.orientation is not None:
            assert np.linalg.norm(truth.orientation.axis - cone.axis) < EXACT
        if truth.origin is not None:
            assert np.linalg.norm(truth.origin.point - cone.apex) < EXACT * cone.size
        rims = sum(name in ("E_T", "E_B") for name in row.features)
        has_end = "F_T" in row.features or "F_B" in row.features
        assert (truth.orientation is not None) == (has_end or rims == 2)
        if number == 1:
            continue
        possible = [one for one in assigned if one.is_possible]
        if row.constraint == APEX_OFF_ENDS:  # a face through the apex is no end
            assert not any("E_m" in one.name and "F_S" not in one.name for one in possible)
            twin = named(assigned, row.combination.replace("F_S", "F_T", 1))
            assert APEX_OFF_ENDS in twin.violations
        if row.constraint == MERIDIAN_SLOPES:  # an edge parallel to an end is no meridian
            for item in assigned:
                ends = [f for f in item.features if f.group == "F" and f.place != "S"]
                lines = [f for f in item.features if f.place == "M"]
                if any(abs(x.direction @ y.normals[0]) < EXACT for x in lines for y in ends):
                    assert not item.is_possible
                    assert item.residual_sigma >= 1.0 or MERIDIAN_SLOPES in item.violations
        if row.constraint == NOT_PARALLEL:  # parallel faces are the ends
            assert {one.row for one in possible if one.row} == {row}
            for name in ("E_m F_B F_S", "E_m F_S F_T"):
                assert NOT_PARALLEL in named(assigned, name).violations


def test_all_places_are_tried_and_possible_ones_come_first():
    touched = cones()[0].features(["F_B", "E_m", "E_T"], place=False)
    assigned = interpretations(touched)
    assert len(assigned) == 27
    possible = [item.is_possible for item in assigned]
    assert possible == sorted(possible, reverse=True)
    for item in assigned:
        assert item.residual_sigma <= 3.0 if item.is_possible else item.violations
    turn, shift = Rotation.random(random_state=1).as_matrix(), np.array([0.1, -0.4, 0.2])
    assert possible_names(moved(touched, turn, shift)) == possible_names(touched)
    known = cones()[0].features(["F_T", "E_m"]) + cones()[0].features(["E_B"], place=False)
    names = [item.name for item in interpretations(known)]
    assert [name[:7] for name in names] == ["F_T E_m"] * 3 and names[0] == "F_T E_m E_B"
    vertex = Feature(group="V", point=np.zeros(3))
    assert possible_names([vertex]) == {"V_T", "V_B"}


def test_true_places_are_possible_under_noise():
    rng, names = np.random.default_rng(9), ["F_T", "E_m", "E_m", "F_S"]
    for cone in cones()[:4]:
        assigned = interpretations(noisy(cone.features(names, place=False), rng))
        truth = named(assigned, " ".join(names))
        assert truth.is_possible, truth.violations
        assert math.acos(min(truth.orientation.axis @ cone.axis, 1.0)) < math.radians(5.0)
        assert np.linalg.norm(truth.origin.point - cone.apex) < 0.15 * cone.size


def test_end_and_meridians_have_one_interpretation():
    for cone in cones()[:2]:
        for names in (["F_B", "P_m", "E_m", "F_S"], ["F_T", "F_B", "E_m", "E_m"]):
            assert possible_names(cone.features(names, place=False)) == {" ".join(names)}
    for names, row in ("F_T E_m P_m", row_of(["E_m", "E_m", "F_T"])), ("F_T E_T E_m", None):
        item = named(interpretations(cones()[0].features(names.split())), names)
        assert item.is_possible and item.row == row


def violations(*features: Feature) -> tuple[str, ...]:
    """Violated constraints of features with known places."""
    return interpretations(features)[0].violations


def test_violated_constraints_are_reported():
    for cone in cones()[:5]:
        face, line, other = cone.features(["F_T", "E_m", "E_m"])
        assert violations(face, line, other) == ()
        mirrored = replace(line, point=2.0 * cone.apex - line.point)
        assert BELOW_APEX in violations(face, mirrored, other)
        hollow = replace(face, normals=-face.normals)
        assert "no contact lies outside a touched face" in violations(hollow, line, other)
        upside_down = violations(replace(face, place="B"), line, other)
        outward = "a top face faces along the axis, and a bottom face against it"
        assert outward in upside_down or BELOW_APEX in upside_down
        aside = replace(line, point=line.point + 0.03 * np.cross(line.direction, other.direction))
        item = interpretations([face, aside, other])[0]
        assert "the equations of these places hold within the noise" in item.violations
        assert item.residual_sigma > 3.0
        high = replace(line, point=cone.apex + 0.3 * cone.depths[0] * cone.ray(0.1))
        edges = cone.features(["E_T", "E_T"], normals=False)
        assert BETWEEN_ENDS in violations(*edges, cone.feature("V_B"), high)
        assert BETWEEN_ENDS in violations(face, replace(cone.feature("V_T"), place="B"))
        assert violations(*cone.features(["F_T", "V_B"])) == ()


def test_rims_bound_their_end_and_support_body():
    for cone in cones()[:5]:
        edge, bottom = cone.feature("E_T"), cone.feature("F_B")
        tilted = edge.normals.sum(axis=0) / np.linalg.norm(edge.normals.sum(axis=0))
        wrong = replace(edge, normals=np.stack([tilted, edge.normals[1]]))
        assert RIM_NORMAL not in violations(bottom, edge)
        assert RIM_NORMAL in violations(bottom, wrong)
        face, *lines = cone.features(["F_T", "E_m", "E_m", "P_m"])
        bare = cone.feature("E_T", normals=False)
        assert violations(face, *lines, bare) == ()
        inner = cone.apex + cone.depths[0] * cone.rotation @ [*cone.middle, -1.0]
        radial = cone.feature("V_T", 0).point - cone.feature("V_T", 2).point
        across = replace(bare, point=inner, direction=radial / np.linalg.norm(radial))
        lines = [cone.feature("P_m", 0), cone.feature("E_m", 0), cone.feature("E_m", 1)]
        supports = "the body lies on one side of the plane through the apex and an edge of an end"
        assert supports in violations(face, *lines, across)


def test_section_may_lie_beside_axis():
    rng, held, words = np.random.default_rng(12), [], "a side face looks away from the axis and up"
    for _ in range(6):
        cone = draw_cone(rng, beside=1.5)
        touched = cone.features(["F_T", "E_m", "E_m", "F_S", "F_S", "F_S"])
        assert interpretations(touched)[0].is_possible
        item = interpretations(touched, section_holds_axis=True)[0]
        assert all(one.startswith(words) for one in item.violations)
        upward = all(one.normals[0] @ cone.axis > 0.0 for one in touched if one.place == "S")
        assert item.is_possible or not upward
        held.append(item.is_possible)
    assert not all(held)
    for cone in cones()[:3]:
        touched = cone.features(["F_T", "F_S", "E_B"], place=False)
        assert {"F_T F_S E_B", "F_B F_S E_T"} <= possible_names(touched)
        names = possible_names(touched, section_holds_axis=True)
        assert "F_B F_S E_T" not in names and "F_T F_S E_B" in names


def test_uncertain_apex_violates_nothing():
    for cone in cones():  # the meridian is next to the face
        touched = [cone.feature("F_S", 1), cone.feature("E_m", 1), cone.feature("F_T")]
        assert violations(*touched) == ()
    # Two sides of a wedge about z meet in the y axis: the apex is free along a level line.
    c, s, sides = math.cos(0.3), math.sin(0.3), []
    for sign in (1.0, -1.0):
        normal, down = np.array([sign * c, 0.0, s]), np.array([sign * s, 0.0, -c])
        sides.append(Feature(group="F", place="S", point=0.08 * down, normals=normal[None]))
    edge = Feature(
        group="E",
        place="T",
        point=0.04 * np.array([s, 0.0, -c]),
        direction=np.array([0.0, 1.0, 0.0]),
        normals=np.array([[0.0, 0.0, 1.0], [c, 0.0, s]]),
    )
    item = interpretations([*sides, edge])[0]
    assert item.violations == () and item.origin is None


@pytest.mark.parametrize(("times", "options", "words"), [
    (0, {}, "features must be 1 to 6, got 0"),
    (4, {}, "features must be 1 to 6, got 8"),
    (1, {"tolerance": 0.0}, "tolerance must be positive and finite, got 0"),
    (1, {"angle_noise": -1.0}, "angle_noise must be positive"),
    (1, {"position_noise": math.inf}, "position_noise must be positive"),
])  # fmt: skip
def test_invalid_input_raises(times: int, options: dict, words: str):
    with pytest.raises(ValueError, match=words):
        interpretations(cones()[0].features(["F_T", "E_m"]) * times, **options)
