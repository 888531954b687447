"""Laws of the classification of touches as features of a cone."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.core import cones
from palpate.core.arrays import Floats
from palpate.core.cones import Feature, feature_of_contact

PITCH, ACROSS = 1e-3, 15  # 15 by 15 taxels
DEPTH = 2.5e-3  # [m] of the press
EXACT = 1e-9  # fraction of the patch's width, and [rad]
UP = np.array([0.0, 0.0, 1.0])
POSES = Rotation.random(8, random_state=5).as_matrix()


def tilted(angle: float, azimuth: float) -> Floats:
    """Outward normal of a face that leans away."""
    lean = np.sin(angle)
    return np.array([lean * np.cos(azimuth), lean * np.sin(azimuth), np.cos(angle)])


def taxels(height: Callable[[Floats, Floats], Floats]) -> Floats:
    """Surface points (n, 3) under the taxels that touch."""
    side = (np.arange(ACROSS) - 0.5 * (ACROSS - 1)) * PITCH
    x, y = (one.ravel() for one in np.meshgrid(side, side))
    z = height(x, y)
    return np.column_stack([x, y, z])[z > z.max() - DEPTH]


def roof(*normals: Floats, ridge: Floats | tuple[float, ...] = (0.0, 0.0, 0.0)) -> Floats:
    """Taxels on a solid between planes through one point."""

    def height(x: Floats, y: Floats) -> Floats:
        planes = [(n[0] * (x - ridge[0]) + n[1] * (y - ridge[1])) / n[2] for n in normals]
        return ridge[2] - np.max(planes, axis=0)

    return taxels(height)


def test_planes_are_classified_as_face_edge_and_vertex():
    rng = np.random.default_rng(1)
    cases = [
        ("smooth", "F", [0.05], "flat both ways"),
        *(("edge", "E", leans, "two faces meet")
          for leans in ([0.25, 0.3], [0.1, 0.6], [0.7, 0.7], [0.05, 0.05])),
        ("corner", "V", [0.3, 0.45, 0.6], "three faces meet"),
    ]  # fmt: skip
    for pose in POSES:
        for kind, group, leans, reason in cases:
            begin, count = rng.uniform(0, 2 * np.pi), len(leans)
            azimuths = begin + np.arange(count) * 2 * np.pi / count
            normals = [tilted(lean, one) for lean, one in zip(leans, azimuths, strict=True)]
            ridge, shift = np.append(rng.uniform(-1e-3, 1e-3, 2), 0), rng.uniform(-0.2, 0.2, 3)
            points = roof(*normals, ridge=ridge) @ pose.T + shift
            result = feature_of_contact(kind, points, pose @ UP)
            assert (result.feature.group, result.feature.place) == (group, None)
            assert result.reason == reason and result.misfit < 1e-12
            for normal in normals:
                apart = np.linalg.norm(result.feature.normals - pose @ normal, axis=1)
                assert apart.min() < EXACT
            away = result.feature.point - pose @ ridge - shift
            if group == "F":
                assert abs(away @ pose @ normals[0]) < 1e-12
            elif group == "E":
                along = pose @ np.cross(*normals) / np.linalg.norm(np.cross(*normals))
                assert np.linalg.norm(np.cross(result.feature.direction, along)) < EXACT
                assert np.linalg.norm(np.cross(away, along)) < 1e-12 / np.sin(sum(leans))
            else:
                assert np.linalg.norm(away) < 1e-12


def test_cylinder_is_classified_as_parabolic_point():
    radius = 0.012
    clean = taxels(lambda x, y: np.sqrt(radius**2 - x**2) - radius)
    for pose in POSES:
        result = feature_of_contact(
            "smooth",
            clean @ pose.T,
            pose @ UP,
            principal=(1 / radius, 0.01),
            principal_error=(0.5, 0.5),
            principal_direction=pose[:, 0],
        ).feature
        assert result.group == "P" and result.curvature == 1 / radius
        assert np.linalg.norm(np.cross(result.direction, pose[:, 1])) < EXACT
        x, _, z = result.point @ pose  # on the cylinder, up to a polynomial's misfit
        assert np.hypot(x, z + radius) == pytest.approx(radius, abs=2e-5)


def bulge(k1: float, k2: float, error: float = 0.5, noise: float = 0.0) -> cones.ContactFeature:
    points = taxels(lambda x, y: -0.5 * (k1 * x**2 + k2 * y**2))
    return feature_of_contact(
        "smooth",
        points,
        UP,
        principal=(k1, k2),
        principal_error=(error, error),
        principal_direction=[1, 0, 0],
        noise=noise,
    )


WEDGE = roof(tilted(0.3, 0.0), tilted(0.3, np.pi))
STEEP = roof(tilted(0.7, 0.0), tilted(1.1, np.pi))
FLAT = roof(UP)
ROUGH = FLAT + 1e-6 * np.random.default_rng(4).normal(size=FLAT.shape)


@pytest.mark.parametrize(("reading", "words"), [
    (bulge(60.0, 50.0), "curved both ways, by 60 and 50 1/m"),
    (bulge(60.0, -50.0), "curved both ways"),
    (bulge(0.1, -40.0), "concave, by -40 1/m"),
    (feature_of_contact("miss", np.empty((0, 3)), UP), "the touch is called miss"),
    (feature_of_contact("invalid", np.empty((0, 3)), UP), "the touch is called invalid"),
    (feature_of_contact("insufficient", FLAT, UP), "the touch is called insufficient"),
    (feature_of_contact("edge", FLAT, UP), "the touched points do not lie on two faces"),
    (feature_of_contact("edge", ROUGH, UP, noise=1e-6), "the faces meet at 0.0"),
    (feature_of_contact("edge", WEDGE * [1, 1, -1], UP), "the edge is hollow: a cone is conv"),
    (feature_of_contact("edge", np.outer(np.arange(9.0), [1, 0, 0]), UP), "the touched points"),
    # one row of a face
    (feature_of_contact("edge", STEEP[STEEP[:, 0] > -1.5e-3], UP), "the touched points do not"),
    (feature_of_contact("corner", WEDGE[:3], UP), "the touched points span no plane"),
])  # fmt: skip
def test_touch_without_feature_states_reason(reading: cones.ContactFeature, words: str):
    assert reading.feature is None and reading.reason.startswith(words)


def test_noise_is_not_classified_as_feature():
    assert bulge(20.0, -10.0, error=8.0, noise=5e-5).feature.group == "F"
    result = feature_of_contact("corner", WEDGE, UP)
    assert result.reason == "the point that stands out farthest"
    assert result.feature.point[2] == WEDGE[:, 2].max()
    rng, errors = np.random.default_rng(3), []
    clean = roof(tilted(0.3, 0.0), tilted(0.4, np.pi))
    for _ in range(12):
        points = clean + 2e-5 * rng.normal(size=clean.shape)
        points[rng.choice(len(points), 4, replace=False)] += [0, 0, 4e-4]  # outliers
        edge = feature_of_contact("edge", points, UP, noise=2e-5).feature
        x, _, z = edge.point
        errors.append([math.hypot(x, z), math.hypot(edge.direction[0], edge.direction[2])])
    assert (np.median(errors, axis=0) < [1.5e-5, np.radians(0.08)]).all()


def feature(**changes: object) -> Feature:
    good = {"group": "E", "point": np.zeros(3), "direction": UP}
    return Feature(**{**good, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(("call", "words"), [
    (lambda: feature(group="X"), "group must be V, E, F or P, got 'X'"),
    (lambda: feature(place="S"), "place of E must be T, B, M or None, got 'S'"),
    (lambda: feature(point=np.zeros(2)), r"point must have shape \(3\), got \(2,\)"),
    (lambda: feature(point=np.full(3, np.nan)), "point must be finite"),
    (lambda: feature(direction=None), "direction must be given for E and P alone, group is E"),
    (lambda: feature(group="V"), "direction must be given for E and P alone, group is V"),
    (lambda: feature(direction=2 * UP), r"direction must be of length 1, got \[2.0\]"),
    (lambda: feature(normals=UP[None]), r"E has \(0, 2\) normals, got 1"),
    (lambda: feature(normals=[UP, 2 * UP]), r"normals must be of length 1, got \[1.0, 2.0\]"),
    (lambda: feature(curvature=1.0), "curvature must be positive for P and 0 otherwise, got 1"),
    (lambda: feature(group="P"), "curvature must be positive for P and 0 otherwise, got 0.0"),
    (lambda: feature_of_contact("round", FLAT, UP), "kind must be one of"),
    (lambda: feature_of_contact("edge", FLAT, UP, noise=-1.0), "noise must be 0 or more and"),
    (lambda: feature_of_contact("edge", FLAT, 2 * UP), "normal must be of length 1"),
])  # fmt: skip
def test_invalid_input_raises(call: Callable[[], object], words: str):
    with pytest.raises(ValueError, match=words):
        call()
