"""How an object lies that was turned over, from contacts of the hand on the solid as known."""

import numpy as np
import pytest

from palpate.core import geometry
from palpate.core.arrays import Floats
from palpate.core.explore.placing import KnownSurface, Placement, place_object
from palpate.core.geometry import RestingSolid, areas_and_normals, sample_surface
from palpate.core.poses import Pose, rotation_angle, rotations_from_vectors
from palpate.core.shapes import Mesh, Superquadric
from palpate.core.touch import set_down

NOISE = 0.1e-3
UPSIDE_DOWN = Pose(np.array([0.0, 0.0, 0.03]), np.diag([1.0, -1.0, -1.0]))
BLOCK = Superquadric(np.array([0.03, 0.02, 0.015]), np.array([0.2, 0.4])).mesh(5)
X, Y, Z = BLOCK.vertices.T
# It is wider at one end, and thicker at one side: it looks alike from nowhere else.
WEDGE = Mesh(np.column_stack([X, Y * (1.0 + 10.0 * X), Z * (1.0 + 12.0 * Y)]), BLOCK.faces)
CAN = Superquadric(np.array([0.03, 0.03, 0.02]), np.array([0.1, 1.0])).mesh(5)


def known(mesh: Mesh, error: float = 0.1e-3) -> KnownSurface:
    corners = mesh.vertices[mesh.faces]
    points, faces = sample_surface(corners, 8000, np.random.default_rng(0))
    normals = areas_and_normals(corners)[1][faces]
    return KnownSurface(points, normals, np.full(8000, error))


def met(mesh: Mesh, lies: Pose, seed: int, count: int = 40) -> tuple[Floats, Floats]:
    """What a hand meets all around, but below."""
    rng = np.random.default_rng(seed)
    corners = mesh.vertices[mesh.faces]
    points, faces = sample_surface(corners, 4000, rng)
    normals = areas_and_normals(corners)[1][faces] @ lies.axes.T
    points = lies.to_outer(points)
    chosen = rng.choice(np.flatnonzero(normals[:, 2] > -0.5), count, replace=False)
    return points[chosen] + NOISE * rng.normal(size=(count, 3)), normals[chosen]


def placed(mesh: Mesh, lies: Pose, seed: int = 0) -> Placement | None:
    contacts = met(mesh, lies, seed)
    return place_object(known(mesh), RestingSolid(*mesh), *contacts, UPSIDE_DOWN.axes, 0.0)


def off_along_normals(mesh: Mesh, found: Pose, true: Pose) -> float:
    surface = known(mesh)
    off = found.to_outer(surface.points) - true.to_outer(surface.points)
    along = np.einsum("ni,ni->n", off, surface.normals @ true.axes.T)
    return float(np.sqrt(np.mean(along**2)))


@pytest.mark.parametrize("seed", range(2))
def test_pose_is_found_whatever_the_turn_about_the_vertical(seed):
    lies = set_down(RestingSolid(*WEDGE), UPSIDE_DOWN, 0.0, seed, 1)
    found = placed(WEDGE, lies, seed)
    assert found is not None and not found.alternatives
    assert off_along_normals(WEDGE, found.pose, lies) < 0.1e-3
    assert off_along_normals(WEDGE, found.pose, lies) < 3.0 * found.error
    assert rotation_angle(found.pose.axes, lies.axes) < np.radians(0.6)


def test_object_that_rolled_onto_another_side_is_recognised():
    side = Pose(np.array([0.0, 0.0, 0.03]), np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    lies = set_down(RestingSolid(*WEDGE), side, 0.0, 5, 1)
    found = placed(WEDGE, lies)
    assert found is not None and off_along_normals(WEDGE, found.pose, lies) < 0.1e-3
    assert found.pose.axes[2] @ UPSIDE_DOWN.axes[2] < 0.5


def test_can_turns_freely_and_is_said_to_look_alike():
    lies = set_down(RestingSolid(*CAN), UPSIDE_DOWN, 0.0, 1, 1)
    found = placed(CAN, lies)
    assert found is not None and found.alternatives
    true = lies.to_outer(CAN.vertices)
    search = geometry.nearest_search(true[CAN.faces])
    for one in (found.pose, *found.alternatives):  # of the same surface
        off = geometry.nearest_points(search, one.to_outer(CAN.vertices)).distances
        assert np.sqrt(np.mean(off**2)) < 0.1e-3


@pytest.mark.parametrize(
    ("platform", "error", "raised"),
    [(0.0, 2e-3, 0.0), (-1e-3, 2e-3, 0.0), (0.0, 0.1e-3, 2e-3)],
)
def test_height_of_what_was_met_on_upright_sides_alone_is_that_at_which_it_stands(
    platform, error, raised
):
    """Nothing else tells of it. A ripple under it raises it only if it is said to be known."""
    prism = Superquadric(np.array([0.03, 0.02, 0.025]), np.array([0.02, 0.5])).mesh(5)
    lies = set_down(RestingSolid(*prism), UPSIDE_DOWN, 0.0, 1, 1)
    points, normals = met(prism, lies, 0, 400)
    upright = (np.abs(normals[:, 2]) < 0.02) & (np.abs(points[:, 2] - 0.025) < 0.015)
    assert upright.sum() > 40
    surface, tip = known(prism), np.array([[0.01, 0.0, 0.027]])  # below all else, upside down
    rippled = KnownSurface(
        np.concatenate([surface.points, tip]),
        np.concatenate([surface.normals, [[0.0, 0.0, 1.0]]]),
        np.append(surface.errors, error),
    )
    resting = RestingSolid(np.concatenate([prism.vertices, tip]), prism.faces)
    contacts = points[upright], normals[upright]
    found = place_object(rippled, resting, *contacts, UPSIDE_DOWN.axes, platform)
    height = lies.position[2] + platform + raised
    assert found.pose.position[2] == pytest.approx(height, abs=0.1e-3)


def test_contacts_of_another_object_or_too_few_give_no_pose():
    lies = set_down(RestingSolid(*WEDGE), UPSIDE_DOWN, 0.0, 1, 1)
    contacts, larger = met(WEDGE, lies, 0), Mesh(1.5 * WEDGE.vertices, WEDGE.faces)
    solid = known(larger), RestingSolid(*larger)
    assert place_object(*solid, *contacts, UPSIDE_DOWN.axes, 0.0) is None
    few = [each[:7] for each in contacts]
    assert place_object(known(WEDGE), RestingSolid(*WEDGE), *few, UPSIDE_DOWN.axes, 0.0) is None


def test_places_of_which_little_is_known_say_little():
    """With the upper side off by a millimetre, and said to be unsure, the rest tells the pose."""
    lies = set_down(RestingSolid(*WEDGE), UPSIDE_DOWN, 0.0, 2, 1)
    points, normals = met(WEDGE, lies, 0, 80)
    surface = known(WEDGE)
    unsure = surface.normals[:, 2] < -0.9  # faces up now
    shifted = surface.points - unsure[:, None] * [0.0, 0.0, 1.0e-3]
    errors = np.where(unsure, 3.0e-3, 0.1e-3)
    resting = RestingSolid(*WEDGE)
    off = []
    for told in (errors, np.full(len(errors), 0.1e-3)):
        believed = KnownSurface(shifted, surface.normals, told)
        found = place_object(believed, resting, points, normals, UPSIDE_DOWN.axes, 0.0)
        off.append(1.0 if found is None else off_along_normals(WEDGE, found.pose, lies))
    assert off[0] < 0.12e-3 and off[0] < off[1]


def test_motion_of_everything_moves_the_pose_alone():
    lies = set_down(RestingSolid(*WEDGE), UPSIDE_DOWN, 0.0, 1, 1)
    points, normals = met(WEDGE, lies, 0)
    turn = rotations_from_vectors(np.array([[0.0, 0.0, 0.7]]))[0]
    first, contacts = placed(WEDGE, lies), (points @ turn.T + [0.01, 0.0, 0.0], normals @ turn.T)
    solid = known(WEDGE), RestingSolid(*WEDGE)
    moved = place_object(*solid, *contacts, UPSIDE_DOWN.axes, 0.0)
    back = Pose(turn.T @ (moved.pose.position - [0.01, 0.0, 0.0]), turn.T @ moved.pose.axes)
    assert off_along_normals(WEDGE, back, first.pose) < 0.02e-3
