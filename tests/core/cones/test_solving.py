"""Laws of the axis and the apex of a cone from its contact features."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.core import cones
from palpate.core.arrays import Floats
from palpate.core.cones import Feature
from tests.core.cones import drawing
from tests.core.cones.drawing import Cone

NAMES = ("F_T", "F_B", "E_T", "E_T", "E_B", "V_T", "V_B", "P_m", "P_m", "E_m", "E_m", "F_S", "F_S")
EXACT = 1e-9  # fraction of the cone's size, and [rad]
AXIS, APEX = cones.solve_orientation, cones.solve_origin


@pytest.mark.parametrize(
    ("names", "redundancy"),
    [
        ("F_T", 0), ("F_B", 0), ("E_T E_T", 1), ("E_B E_B", 1), ("E_B E_T", 0),
        ("V_T V_T V_T", 0), ("V_B V_B V_B", 0), ("E_T V_T", 0), ("E_B V_B", 0),
        # 2 for each face, 1 for each edge, 4 - 1 and 3 - 1 for points of top and bottom; less 2.
        (" ".join(NAMES), 10),
    ],
)  # fmt: skip
def test_features_of_ends_determine_axis(names: str, redundancy: int):
    for cone in drawing.cones():
        fit = cones.solve_orientation(cone.features(names.split()))
        assert fit.sense_known == (names not in ("V_T V_T V_T", "V_B V_B V_B"))
        sign = 1.0 if fit.sense_known else np.sign(fit.axis @ cone.axis)
        assert np.linalg.norm(sign * fit.axis - cone.axis) < EXACT
        assert fit.redundancy == redundancy and fit.residual_sigma < EXACT


@pytest.mark.parametrize(
    ("names", "redundancy"),
    [
        ("P_m P_m", 1), ("E_m E_m", 1), ("E_m P_m", 1), ("E_m F_S", 0), ("F_S P_m", 0),
        ("F_S F_S F_S", 0),
        (" ".join(NAMES), 7),  # 2 for each line, 1 for each face; less 3
    ],
)  # fmt: skip
def test_features_of_sides_determine_apex(names: str, redundancy: int):
    for cone in drawing.cones():
        fit = cones.solve_origin(cone.features(names.split()))
        assert np.linalg.norm(fit.point - cone.apex) < EXACT * cone.size
        assert fit.redundancy == redundancy and fit.residual_sigma < EXACT


def test_other_features_determine_sense_of_axis():
    for cone in drawing.cones():
        for names in ("V_T V_T V_T E_m", "V_B V_B V_B P_m", "V_B V_B E_T"):
            fit = cones.solve_orientation(cone.features(names.split(), normals=False))
            assert fit.sense_known and np.linalg.norm(fit.axis - cone.axis) < EXACT
        edge = cone.feature("E_T", 0)
        beside = replace(edge, point=cone.feature("V_T", 1).point)  # parallel edges span the plane
        assert np.linalg.norm(cones.solve_orientation([edge, beside]).axis - cone.axis) < EXACT


def test_rotation_follows_angles():
    for cone in drawing.cones():
        fit = cones.solve_orientation(cone.features(["F_T"]))
        wanted = Rotation.from_euler("ZY", [fit.phi, fit.psi]).as_matrix()
        assert np.allclose(fit.rotation, wanted, rtol=0, atol=1e-14)
        assert np.allclose(fit.rotation[:, 2], cone.axis, rtol=0, atol=1e-14)
        x, y, z = fit.axis
        level = math.hypot(x, y)
        slopes = np.array([[-y, x, 0.0], [x * z * level, y * z * level, -(level**3)]]) / level**2
        wanted = slopes @ fit.covariance @ slopes.T
        assert np.allclose(fit.angle_covariance, wanted, rtol=1e-9, atol=1e-12)
    face = Feature(group="F", place="T", point=np.zeros(3), normals=np.array([[0.0, 0.0, 1.0]]))
    upright = cones.solve_orientation([face])
    assert upright.psi == 0.0 and upright.angle_covariance[0, 0] == math.inf
    assert upright.angle_covariance[1, 1] == pytest.approx(drawing.ANGLE**2)


def test_fit_moves_with_features():
    touched = drawing.noisy(drawing.cones()[0].features(NAMES), np.random.default_rng(4))
    axis, apex = cones.solve_orientation(touched), cones.solve_origin(touched)
    turn, shift = Rotation.random(random_state=5).as_matrix(), np.array([0.3, -0.1, 0.7])
    moved = drawing.moved(touched, turn, shift)
    opposed = [  # directions have either sign
        one if one.direction is None else replace(one, direction=-one.direction) for one in moved
    ]
    for features in (moved, opposed, moved[::-1]):
        other, elsewhere = cones.solve_orientation(features), cones.solve_origin(features)
        assert np.allclose(other.axis, turn @ axis.axis, rtol=0, atol=1e-12)
        assert np.allclose(elsewhere.point, turn @ apex.point + shift, rtol=0, atol=1e-11)
        assert np.allclose(other.covariance, turn @ axis.covariance @ turn.T, rtol=0, atol=1e-12)
        assert elsewhere.residual_sigma == pytest.approx(apex.residual_sigma)
    clean = drawing.cones()[0].features(NAMES)
    few, all_ = (cones.solve_orientation(part).covariance for part in (clean[:2], clean))
    assert (np.linalg.eigvalsh(few - all_) > -1e-12).all()


def test_meridians_determine_scaled_radii():
    for cone in drawing.cones():
        touched = cone.features(NAMES)
        axis, apex = cones.solve_orientation(touched), cones.solve_origin(touched)
        radii = cones.scaled_radii(touched, axis, apex)
        for radius, feature in zip(radii, [x for x in touched if x.place == "M"], strict=True):
            level = np.array([math.cos(radius.azimuth), math.sin(radius.azimuth)])
            ray = axis.rotation @ np.append(radius.radius * level, -1.0)
            ray = ray / np.linalg.norm(ray)
            assert abs(ray @ feature.direction) == pytest.approx(1.0, rel=0, abs=EXACT)
            assert radius.half_angle == pytest.approx(math.acos(-ray @ axis.axis))


@pytest.mark.parametrize(
    "names", ["F_T E_m E_m", "E_T E_B F_S P_m", "V_B V_B V_B F_S F_S F_S", " ".join(NAMES)]
)
def test_errors_have_stated_covariance(names: str):
    rng, trials = np.random.default_rng(11), 100
    touched = drawing.cones()[1].features(names.split())
    exact = cones.solve_orientation(touched), cones.solve_origin(touched)
    inverse = [np.linalg.pinv(one.covariance, rcond=1e-9, hermitian=True) for one in exact]
    squares, residuals = np.zeros(2), []
    for _ in range(trials):
        measured = drawing.noisy(touched, rng)
        axis, apex = cones.solve_orientation(measured), cones.solve_origin(measured)
        aligned = axis.axis * np.sign(axis.axis @ exact[0].axis)
        errors = aligned - exact[0].axis, apex.point - exact[1].point
        squares += [off @ one @ off for off, one in zip(errors, inverse, strict=True)]
        residuals.append(cones.residual_sigma(axis, apex) ** 2)
    # Chi-square of 2 and of 3 degrees of freedom; the limit is four standard deviations.
    for square, freedom in zip(squares, (2, 3), strict=True):
        limit = 4.0 * math.sqrt(2.0 / freedom / trials)
        assert square / freedom / trials == pytest.approx(1.0, abs=limit)
    left = exact[0].redundancy + exact[1].redundancy
    if left:
        limit = 5.0 * math.sqrt(2.0 / left / trials)
        assert np.mean(residuals) == pytest.approx(1.0, abs=limit)


def shifted(feature: Feature, along: Floats) -> Feature:
    return replace(feature, point=feature.point + along)


def degenerate(cone: Cone) -> dict[str, list[Feature]]:
    """Reasons, with features that for this reason leave the axis or the apex free."""
    edge, rim, vertex = cone.feature("E_T"), cone.feature("E_B"), cone.feature("V_T")
    line, other, face = cone.feature("E_m"), cone.feature("P_m"), cone.feature("F_S")
    ray = cone.chord(0)[0]
    inner = replace(line, point=cone.apex + 0.06 * ray, direction=ray / np.linalg.norm(ray))
    row = [shifted(vertex, x * cone.rotation[:, 0]) for x in (0.0, 0.01, 0.02)]
    on_edge = replace(vertex, point=edge.point + 0.01 * edge.direction)
    beside = shifted(face, 0.01 * cone.chord(0)[2])
    return {
        "the edges of top and bottom are parallel": [edge, replace(rim, direction=edge.direction)],
        "the edges lie on one line": [rim, shifted(rim, 0.01 * rim.direction)],
        "the touched features of the ends lie along one direction": row,
        "the vertices lie on the line of the edge": [edge, on_edge],
        "the meridians are parallel": [line, replace(other, direction=line.direction)],
        "the meridians are collinear": [line, shifted(line, 0.02 * line.direction)],
        "the meridians lie in the planes of the faces": [inner, face],
        "the faces are coplanar, or meet in one line": [face, beside, cone.feature("F_S", 1)],
    }


@pytest.mark.parametrize(("solve", "names", "words"), [
    (AXIS, "E_m E_m P_m F_S F_S", "the axis is free: nothing of top or bottom was touched"),
    (AXIS, "E_T E_m", "the axis is free: one edge or vertex of an end"),
    (AXIS, "V_T", "the axis is free: one edge or vertex of an end"),
    (AXIS, "V_T V_T", "the axis is free: two vertices"),
    (AXIS, "V_T E_B", "the axis is free: two vertices, or an edge and a vertex"),
    *((AXIS, None, words) for words in list(degenerate(drawing.cones()[0]))[:4]),
    (APEX, "F_T F_B E_T V_B", "the apex is free: nothing of the sides was touched"),
    (APEX, "E_m F_T", "the apex is free: it may be anywhere on one meridian"),
    (APEX, "F_S F_S", "the apex is free: it may be anywhere on a plane"),
    *((APEX, None, words) for words in list(degenerate(drawing.cones()[0]))[4:]),
])  # fmt: skip
def test_insufficient_features_raise_with_reason(solve, names: str | None, words: str):
    for cone in drawing.cones():
        features = cone.features(names.split()) if names else degenerate(cone)[words]
        with pytest.raises(cones.InsufficientFeaturesError, match=words):
            solve(features)


def test_nearly_degenerate_features_raise_under_noise():
    cone = drawing.cones()[2]
    first, second = cone.feature("E_T"), cone.feature("E_B")
    turn = Rotation.from_rotvec(math.radians(2.0) * cone.axis)
    edges = [first, replace(second, direction=turn.apply(first.direction))]
    exact = cones.solve_orientation(edges, angle_noise=1e-6)
    assert np.linalg.norm(exact.axis - cone.axis) < EXACT
    with pytest.raises(cones.InsufficientFeaturesError, match=r"parallel: E_T E_B \(known to 40"):
        cones.solve_orientation(edges, angle_noise=drawing.ANGLE)


@pytest.mark.parametrize(("solve", "options", "words"), [
    (cones.solve_orientation, {"place": False}, r"feature 0 \(F\) must have a place, got None"),
    (cones.solve_origin, {"place": False}, r"feature 0 \(F\) must have a place, got None"),
    (cones.solve_orientation, {"angle_noise": 0.0}, "angle_noise must be positive and finite"),
    (cones.solve_origin, {"position_noise": math.nan}, "position_noise must be positive and"),
])  # fmt: skip
def test_invalid_input_raises(solve, options: dict, words: str):
    place = options.pop("place", True)
    with pytest.raises(ValueError, match=words):
        solve(drawing.cones()[0].features(["F_T", "E_m"], place=place), **options)
