import numpy as np
import pytest

from palpate.core.cones import Feature, feature_of_contact

PITCH, ACROSS = 1e-3, 15  # 15 by 15 taxels
DEPTH = 2.5e-3  # Of the press
EXACT = 1e-9  # Of the patch's width, and rad
UP = np.array([0.0, 0.0, 1.0])


def tilted(angle, azimuth):
    """Outward normal of a face that leans away."""
    lean = np.sin(angle)
    return np.array([lean * np.cos(azimuth), lean * np.sin(azimuth), np.cos(angle)])


def taxels(height, rotation=None, shift=(0.0, 0.0, 0.0)):
    """Surface points (n, 3) under the taxels that touch, in the world frame."""
    side = (np.arange(ACROSS) - 0.5 * (ACROSS - 1)) * PITCH
    x, y = (one.ravel() for one in np.meshgrid(side, side))
    z = height(x, y)
    touched = z > z.max() - DEPTH
    points = np.column_stack([x, y, z])[touched]
    return points if rotation is None else points @ rotation.T + shift


def roof(normals, ridge):
    """Height of the solid that all these planes through one point bound."""

    def height(x, y):
        return np.min(
            [ridge[2] - (n[0] * (x - ridge[0]) + n[1] * (y - ridge[1])) / n[2] for n in normals],
            axis=0,
        )

    return height


def off_line(edge, point, along):
    """Distance of an edge from a line, m, and the sine of the angle between them."""
    apart = np.cross(edge.point - point, along)
    return np.linalg.norm(apart), np.linalg.norm(np.cross(edge.direction, along))


def test_taxels_of_a_plane_are_a_face(rotations):
    for rotation in rotations(20):
        normal = tilted(0.05, 1.0)
        points = taxels(roof([normal], [0, 0, 0]), rotation)
        found = feature_of_contact("smooth", points, rotation @ UP)
        assert (found.feature.group, found.feature.place) == ("F", None)
        assert np.linalg.norm(found.feature.normals[0] - rotation @ normal) < EXACT
        assert found.misfit < 1e-12


@pytest.mark.parametrize("lean", [(0.25, 0.3), (0.1, 0.6), (0.7, 0.7), (0.05, 0.05)])
def test_taxels_of_two_planes_are_their_edge(lean, rotations):
    rng = np.random.default_rng(1)
    for rotation in rotations(20):
        azimuth, ridge = rng.uniform(0, 2 * np.pi), np.append(rng.uniform(-1e-3, 1e-3, 2), 0)
        turned = [tilted(lean[0], azimuth), tilted(lean[1], azimuth + np.pi)]
        shift = rng.uniform(-0.2, 0.2, 3)
        points = taxels(roof(turned, ridge), rotation, shift)
        found = feature_of_contact("edge", points, rotation @ UP)
        along = np.cross(*turned)
        distance, sine = off_line(
            found.feature, rotation @ ridge + shift, rotation @ along / np.linalg.norm(along)
        )
        assert (found.feature.group, found.reason) == ("E", "two faces meet")
        assert distance < 1e-12 / np.sin(sum(lean))
        assert sine < EXACT
        for normal in turned:
            apart = np.linalg.norm(found.feature.normals - rotation @ normal, axis=1)
            assert apart.min() < EXACT


def test_taxels_of_three_planes_are_their_vertex(rotations):
    rng = np.random.default_rng(2)
    for rotation in rotations(20):
        azimuths = rng.uniform(0, 2 * np.pi) + np.array([0.0, 2.1, 4.2]) + rng.uniform(-0.3, 0.3, 3)
        turned = [tilted(rng.uniform(0.3, 0.6), one) for one in azimuths]
        tip, shift = np.append(rng.uniform(-1e-3, 1e-3, 2), 0), rng.uniform(-0.2, 0.2, 3)
        points = taxels(roof(turned, tip), rotation, shift)
        found = feature_of_contact("corner", points, rotation @ UP)
        assert (found.feature.group, found.reason) == ("V", "three faces meet")
        assert np.linalg.norm(found.feature.point - rotation @ tip - shift) < 1e-12
        assert len(found.feature.normals) == 3


def test_a_corner_of_which_one_face_is_hardly_touched_is_the_point_that_stands_out():
    turned = [tilted(0.3, 0.0), tilted(0.3, np.pi)]
    points = taxels(roof(turned, [0, 0, 0]))
    found = feature_of_contact("corner", points[:3], UP)
    assert found.feature is None
    found = feature_of_contact("corner", points, UP)
    assert found.reason == "the point that stands out farthest"
    assert found.feature.point[2] == points[:, 2].max()


def test_taxels_of_a_cylinder_are_a_parabolic_point(rotations):
    radius = 0.012
    for rotation in rotations(20):
        points = taxels(lambda x, y: np.sqrt(radius**2 - x**2) - radius, rotation)
        found = feature_of_contact(
            "smooth",
            points,
            rotation @ UP,
            principal=(1 / radius, 0.01),
            principal_error=(0.5, 0.5),
            principal_direction=rotation[:, 0],
        )
        assert found.feature.group == "P"
        assert np.linalg.norm(np.cross(found.feature.direction, rotation[:, 1])) < EXACT
        assert found.feature.curvature == 1 / radius
        place = found.feature.point @ rotation  # On the cylinder but for a polynomial's misfit
        assert np.hypot(place[0], place[2] + radius) == pytest.approx(radius, abs=2e-5)


@pytest.mark.parametrize(
    ("principal", "why"),
    [
        ((60.0, 50.0), "curved both ways, by 60 and 50 1/m"),
        ((60.0, -50.0), "curved both ways"),
        ((0.1, -40.0), "concave, by -40 1/m"),
    ],
)
def test_balls_saddles_and_hollows_are_no_features(principal, why):
    points = taxels(lambda x, y: -0.5 * (principal[0] * x**2 + principal[1] * y**2))
    found = feature_of_contact(
        "smooth",
        points,
        UP,
        principal=principal,
        principal_error=(0.5, 0.5),
        principal_direction=[1, 0, 0],
    )
    assert found.feature is None
    assert found.reason.startswith(why)


def test_a_curvature_within_its_error_is_none():
    points = taxels(roof([UP], [0, 0, 0]))
    noisy = {"principal": (20.0, -10.0), "principal_error": (8.0, 8.0), "noise": 5e-5}
    assert feature_of_contact("smooth", points, UP, **noisy).feature.group == "F"


def test_edges_are_found_in_noise_and_past_outliers():
    rng = np.random.default_rng(3)
    turned, along = [tilted(0.3, 0.0), tilted(0.4, np.pi)], np.array([0.0, 1.0, 0.0])
    errors = []
    for _ in range(20):
        points = taxels(roof(turned, [0, 0, 0]))
        points = points + 2e-5 * rng.normal(size=points.shape)
        points[rng.choice(len(points), 4, replace=False)] += [0, 0, 4e-4]
        found = feature_of_contact("edge", points, UP, noise=2e-5)
        errors.append(off_line(found.feature, np.zeros(3), along))
    assert np.median(errors, axis=0)[0] < 1.5e-5
    assert np.median(errors, axis=0)[1] < np.radians(0.08)


@pytest.mark.parametrize(
    ("kind", "why"),
    [("miss", "the touch is called miss"), ("insufficient", "the touch is called insufficient")],
)
def test_touches_that_say_nothing_are_no_features(kind, why):
    assert feature_of_contact(kind, np.empty((0, 3)), UP) == (None, why, 0.0)


def test_flat_hollow_and_thin_patches_are_no_edges():
    flat = taxels(roof([UP], [0, 0, 0]))
    same = feature_of_contact("edge", flat, UP)
    assert same == (None, "the touched points do not lie on two faces", 0.0)
    flat = flat + 1e-6 * np.random.default_rng(4).normal(size=flat.shape)
    found = feature_of_contact("edge", flat, UP, noise=1e-6)
    assert found.feature is None
    assert found.reason.startswith("the faces meet at 0.0")
    points = taxels(roof([tilted(0.2, 0.0), tilted(0.2, np.pi)], [0, 0, 0]))
    hollow = feature_of_contact("edge", points * [1, 1, -1], UP)
    assert hollow.reason == "the edge is hollow: a cone is convex"
    line = np.outer(np.arange(9.0), [1e-3, 0, 0])
    assert feature_of_contact("edge", line, UP).reason == "the touched points span no plane"


def test_a_face_of_which_one_row_was_touched_makes_no_edge():
    points = taxels(roof([tilted(0.7, 0.0), tilted(1.1, np.pi)], [0, 0, 0]))
    row = points[(points[:, 0] >= 0) | (points[:, 0] > -1.5e-3) & (points[:, 0] < 0)]
    found = feature_of_contact("edge", row, UP)
    assert found == (None, "the touched points do not lie on two faces", 0.0)


GOOD = {"group": "E", "point": np.zeros(3), "direction": UP}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"group": "X"}, "group must be V, E, F or P, got 'X'"),
        ({"place": "S"}, "place of E must be T, B, M or None, got 'S'"),
        ({"point": np.zeros(2)}, r"point must have shape \(3\), got \(2,\)"),
        ({"point": np.full(3, np.nan)}, "point must be finite"),
        ({"direction": None}, "direction must be given for E and P alone, group is E"),
        ({"direction": 2 * UP}, r"direction must be of length 1, got \[2.0\]"),
        ({"normals": UP[None]}, r"E has \(0, 2\) normals, got 1"),
        ({"normals": np.stack([UP, 2 * UP])}, r"normals must be of length 1, got \[1.0, 2.0\]"),
        ({"curvature": 1.0}, "curvature must be positive for P and 0 otherwise, got 1.0 1/m"),
        ({"group": "P"}, "curvature must be positive for P and 0 otherwise, got 0.0 1/m"),
        ({"group": "V"}, "direction must be given for E and P alone, group is V"),
    ],
)
def test_features_that_no_cone_has_are_refused(change, why):
    with pytest.raises(ValueError, match=why):
        Feature(**{**GOOD, **change})


def test_bad_touches_are_refused():
    points = taxels(roof([UP], [0, 0, 0]))
    with pytest.raises(ValueError, match="kind must be one of"):
        feature_of_contact("round", points, UP)
    with pytest.raises(ValueError, match="noise must be 0 or more and finite, got -1"):
        feature_of_contact("edge", points, UP, noise=-1.0)
    with pytest.raises(ValueError, match="normal must be of length 1"):
        feature_of_contact("edge", points, 2 * UP)


def test_a_feature_is_named_as_the_tables_name_it():
    assert Feature(**GOOD).name == "E"
    assert Feature(**GOOD, place="M").name == "E_m"
    assert Feature(**GOOD, place="T").name == "E_T"
