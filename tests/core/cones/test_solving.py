import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.cones import (
    Feature,
    InsufficientFeaturesError,
    residual_sigma,
    scaled_radii,
    solve_orientation,
    solve_origin,
)
from palpate.core.poses import rotations_from_vectors

NAMES = ("F_T", "F_B", "E_T", "E_T", "E_B", "V_T", "V_B", "P_m", "P_m", "E_m", "E_m", "F_S", "F_S")
ANGLE, POSITION = math.radians(1.0), 1e-4
MOST_OFF = 0.15  # Of what the Jacobian foretells


def noisy(features, rng, angle=ANGLE, position=POSITION):
    """Directions and normals turned, points moved; edges keep no normals."""

    def turned(vectors):
        turns = angle * rng.normal(size=(len(vectors), 3))
        return np.einsum("bij,bj->bi", rotations_from_vectors(turns), vectors)

    return [
        replace(
            one,
            point=one.point + position * rng.normal(size=3),
            direction=None if one.direction is None else turned(one.direction[None])[0],
            normals=turned(one.normals) if one.group == "F" else one.normals,
        )
        for one in features
    ]


def test_all_features_at_once_give_axis_apex_and_angles(cones):
    for cone in cones:
        touched = cone.features(NAMES)
        axis, apex = solve_orientation(touched), solve_origin(touched)
        assert np.linalg.norm(axis.axis - cone.axis) < 1e-9
        assert np.linalg.norm(apex.point - cone.apex) < 1e-9 * cone.size
        # Faces 2 each, edges 1, points of top 4 and bottom 3 less one offset each; less 2. Lines 2
        # each, faces 1; less 3.
        assert (axis.redundancy, apex.redundancy) == (10, 7)
        assert residual_sigma(axis, apex) < 1e-9


def test_the_rotation_is_the_corrected_matrix_of_its_angles(cones):
    for cone in cones:
        found = solve_orientation(cone.features(["F_T"]))
        (c, s), (cp, sp) = ((math.cos(x), math.sin(x)) for x in (found.phi, found.psi))
        right = np.array([[c * cp, -s, c * sp], [s * cp, c, s * sp], [-sp, 0.0, cp]])
        assert np.allclose(found.rotation, right, rtol=0, atol=1e-14)
        assert np.allclose(found.rotation[:, 2], cone.axis, rtol=0, atol=1e-14)


def test_the_fit_turns_and_moves_with_the_features(draw, rotations):
    touched = noisy(draw(np.random.default_rng(3)).features(NAMES), np.random.default_rng(4))
    axis, apex = solve_orientation(touched), solve_origin(touched)
    turn, shift = rotations(1)[0], np.array([0.3, -0.1, 0.7])
    moved = [
        replace(
            one,
            point=turn @ one.point + shift,
            direction=None if one.direction is None else turn @ one.direction,
            normals=one.normals @ turn.T,
        )
        for one in touched
    ]
    other, elsewhere = solve_orientation(moved), solve_origin(moved)
    assert np.allclose(other.axis, turn @ axis.axis, rtol=0, atol=1e-12)
    assert np.allclose(elsewhere.point, turn @ apex.point + shift, rtol=0, atol=1e-11)
    assert np.allclose(other.covariance, turn @ axis.covariance @ turn.T, rtol=0, atol=1e-12)
    assert elsewhere.residual_sigma == pytest.approx(apex.residual_sigma)


def test_the_sign_of_a_direction_means_nothing(draw):
    touched = draw(np.random.default_rng(6)).features(NAMES)
    turned = [
        one if one.direction is None else replace(one, direction=-one.direction) for one in touched
    ]
    assert np.allclose(
        solve_orientation(touched).axis, solve_orientation(turned).axis, rtol=0, atol=1e-14
    )
    assert np.allclose(solve_origin(touched).point, solve_origin(turned).point, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "names", [["V_T", "V_T", "V_T", "E_m"], ["V_B", "V_B", "V_B", "P_m"], ["V_B", "V_B", "E_T"]]
)
def test_what_lies_elsewhere_says_which_end_is_the_top(names, cones):
    for cone in cones:
        found = solve_orientation(cone.features(names, normals=False))
        assert found.sense_known
        assert np.linalg.norm(found.axis - cone.axis) < 1e-9


def test_two_parallel_edges_of_one_end_still_span_its_plane(cones):
    for cone in cones:
        edge = cone.feature("E_T", 0)
        beside = replace(edge, point=cone.feature("V_T", 1).point)
        assert np.linalg.norm(solve_orientation([edge, beside]).axis - cone.axis) < 1e-9


def test_the_radius_at_a_meridian_is_told_and_nothing_more_of_the_scale(cones):
    for cone in cones:
        touched = cone.features(NAMES)
        axis = solve_orientation(touched)
        found = scaled_radii(touched, axis, solve_origin(touched))
        assert len(found) == 4
        for one, feature in zip(found, [x for x in touched if x.place == "M"], strict=True):
            ray = axis.rotation @ [
                one.radius * math.cos(one.azimuth), one.radius * math.sin(one.azimuth), -1.0
            ]  # fmt: skip
            ray = ray / np.linalg.norm(ray)
            assert np.allclose(np.abs(ray @ feature.direction), 1.0, rtol=0, atol=1e-9)
            assert one.half_angle == pytest.approx(math.acos(-ray @ axis.axis))


def test_only_sides_never_give_the_axis(cones):
    with pytest.raises(InsufficientFeaturesError, match="nothing of top or bottom was touched"):
        solve_orientation(cones[0].features(["E_m", "E_m", "P_m", "F_S", "F_S"]))


def test_only_ends_never_give_the_apex(cones):
    with pytest.raises(InsufficientFeaturesError, match="nothing of the sides was touched"):
        solve_origin(cones[0].features(["F_T", "F_B", "E_T", "V_B"]))


def shifted(feature, along):
    return replace(feature, point=feature.point + along)


def parallel_ends(cone):
    edge = cone.feature("E_T")
    return [edge, replace(cone.feature("E_B"), direction=edge.direction)]


def one_line(cone):
    edge = cone.feature("E_B")
    return [edge, shifted(edge, 0.01 * edge.direction)]


def vertices_on_a_line(cone):
    vertex = cone.feature("V_T")
    return [shifted(vertex, x * cone.rotation[:, 0]) for x in (0.0, 0.01, 0.02)]


def vertex_on_edge(cone):
    edge = cone.feature("E_T")
    return [edge, replace(cone.feature("V_T"), point=edge.point + 0.01 * edge.direction)]


@pytest.mark.parametrize(
    ("touched", "why"),
    [
        (lambda cone: cone.features(["E_T", "E_m"]), "one edge or vertex of an end"),
        (lambda cone: cone.features(["V_T"]), "one edge or vertex of an end"),
        (lambda cone: cone.features(["V_T", "V_T"]), "two vertices"),
        (lambda cone: cone.features(["V_T", "E_B"]), "two vertices, or an edge and a vertex"),
        (parallel_ends, "the edges of top and bottom are parallel"),
        (one_line, "the edges lie on one line"),
        (vertices_on_a_line, "what was touched of the ends lies along one direction"),
        (vertex_on_edge, "the vertices lie on the line of the edge"),
    ],
)
def test_an_axis_that_stays_free_is_refused_with_the_reason(touched, why, cones):
    for cone in cones:
        with pytest.raises(InsufficientFeaturesError, match=f"the axis is free: {why}"):
            solve_orientation(touched(cone))


def parallel_meridians(cone):
    line = cone.feature("E_m")
    return [line, replace(cone.feature("P_m"), direction=line.direction)]


def collinear_meridians(cone):
    line = cone.feature("E_m")
    return [line, shifted(line, 0.02 * line.direction)]


def meridian_in_face(cone):
    face = cone.feature("F_S")
    ray = cone.chord(0)[0]
    point = cone.apex + 0.06 * ray
    return [replace(cone.feature("E_m"), point=point, direction=ray / np.linalg.norm(ray)), face]


def coplanar_faces(cone):
    face = cone.feature("F_S")
    return [face, shifted(face, 0.01 * cone.chord(0)[2]), cone.feature("F_S", 1)]


@pytest.mark.parametrize(
    ("touched", "why"),
    [
        (lambda cone: cone.features(["E_m", "F_T"]), "it may be anywhere on one meridian"),
        (lambda cone: cone.features(["F_S", "F_S"]), "it may be anywhere on a plane"),
        (parallel_meridians, "the meridians are parallel"),
        (collinear_meridians, "the meridians are collinear"),
        (meridian_in_face, "the meridians lie in the planes of the faces"),
        (coplanar_faces, "the faces are coplanar, or meet in one line"),
    ],
)
def test_an_apex_that_stays_free_is_refused_with_the_reason(touched, why, cones):
    for cone in cones:
        with pytest.raises(InsufficientFeaturesError, match=f"the apex is free: {why}"):
            solve_origin(touched(cone))


def test_what_is_nearly_degenerate_is_refused_by_its_noise(draw):
    cone = draw(np.random.default_rng(8))
    first, second = cone.feature("E_T"), cone.feature("E_B")
    turn = rotations_from_vectors(math.radians(2.0) * cone.axis[None])[0]
    edges = [first, replace(second, direction=turn @ first.direction)]
    exact = solve_orientation(edges, angle_noise=1e-6)
    assert np.linalg.norm(exact.axis - cone.axis) < 1e-9
    with pytest.raises(InsufficientFeaturesError, match=r"parallel: E_T E_B \(known to 40"):
        solve_orientation(edges, angle_noise=ANGLE)


def test_features_without_a_place_and_bad_noise_are_refused(cones):
    touched = cones[0].features(["F_T", "E_m"], place=False)
    with pytest.raises(ValueError, match=r"feature 0 \(F\) must have a place, got None"):
        solve_orientation(touched)
    with pytest.raises(ValueError, match="angle_noise must be positive and finite, got 0"):
        solve_orientation(cones[0].features(["F_T"]), angle_noise=0.0)
    with pytest.raises(ValueError, match="position_noise must be positive and finite, got nan"):
        solve_origin(cones[0].features(["F_S"]), position_noise=math.nan)


def test_more_features_are_never_known_worse(cones):
    for cone in cones:
        touched = cone.features(NAMES)
        few, all_ = solve_orientation(touched[:2]), solve_orientation(touched)
        assert (np.linalg.eigvalsh(few.covariance - all_.covariance) > -1e-12).all()


def test_an_upright_axis_has_no_azimuth():
    face = Feature(group="F", place="T", point=np.zeros(3), normals=np.array([[0.0, 0.0, 1.0]]))
    found = solve_orientation([face])
    assert found.psi == 0.0
    assert found.angle_covariance[0, 0] == math.inf
    assert found.angle_covariance[1, 1] == pytest.approx(ANGLE**2)


def test_other_places_than_the_true_ones_leave_residuals_above_three(cones):
    for cone in cones:
        side = replace(cone.feature("F_S"), place="T")
        assert solve_orientation([cone.feature("F_B"), side]).residual_sigma > 3.0
        upside_down = replace(cone.feature("F_B"), place="T")
        assert solve_orientation([cone.feature("F_T"), upside_down]).residual_sigma > 3.0
        face = cone.feature("F_T")
        assert solve_orientation([face, replace(face, normals=-face.normals)]).residual_sigma > 3.0
        lines = cone.features(["E_m", "E_m"])
        aside = shifted(lines[0], 0.03 * np.cross(lines[0].direction, lines[1].direction))
        assert solve_origin([aside, lines[1]]).residual_sigma > 3.0


@pytest.mark.parametrize("trials", [150, pytest.param(2000, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "names",
    [
        ["F_T", "E_m", "E_m"],
        ["E_T", "E_B", "F_S", "P_m"],
        ["V_B", "V_B", "V_B", "F_S", "F_S", "F_S"],
        NAMES,
    ],
    ids=["least", "edges", "vertices", "all"],
)
def test_errors_are_those_that_the_jacobian_foretells(names, trials, draw):
    rng = np.random.default_rng(11)
    touched = draw(rng).features(names)
    exact = solve_orientation(touched), solve_origin(touched)
    errors, residuals = [], []
    for _ in range(trials):
        measured = noisy(touched, rng)
        axis, apex = solve_orientation(measured), solve_origin(measured)
        sign = np.sign(axis.axis @ exact[0].axis)
        errors.append((axis.axis * sign - exact[0].axis, apex.point - exact[1].point))
        residuals.append(residual_sigma(axis, apex) ** 2)
    for index, one in enumerate(exact):
        drawn = rng.multivariate_normal(np.zeros(3), one.covariance, 20_000)
        foretold = np.median(np.linalg.norm(drawn, axis=1))
        found = np.median([np.linalg.norm(error[index]) for error in errors])
        room = MOST_OFF + 2.0 / math.sqrt(trials)  # Standard error of a median, about 0.8 each
        assert found / foretold == pytest.approx(1.0, abs=room if trials < 2000 else MOST_OFF)
    left = exact[0].redundancy + exact[1].redundancy
    if left:
        assert np.mean(residuals) == pytest.approx(1.0, abs=5.0 * math.sqrt(2.0 / left / trials))
