"""On which side an object is set down, and what is open as it lies now."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from palpate.core import shapes
from palpate.core.explore import planners
from palpate.core.explore.planners import Touch, Touches, choose_turn, estimate_error
from palpate.core.explore.planners.turning import TurningSettings
from palpate.core.poses import Pose
from tests.core.explore.planners.sides import known
from tests.core.explore.planners.test_touches import EXACT, solid
from tests.core.geometry.bodies import arrays

SIZE = np.array([0.03, 0.02, 0.015])
BRICK = shapes.Superquadric(SIZE, np.array([0.15, 0.15])).mesh(4)
BRICK = shapes.Mesh(BRICK.vertices + [0.0, 0.0, SIZE[2]], BRICK.faces)
UPSIDE_DOWN = Pose(np.array([0.0, 0.0, 2.0 * SIZE[2]]), np.diag([1.0, -1.0, -1.0]))


def standing(mesh=BRICK, foot=0.0):
    """A solid of which all is known but its underside."""
    return solid(mesh, EXACT, lambda at: 12e-3 if at[2] < foot + 1e-3 else 1e-3).surface


@pytest.mark.parametrize("gap", [0.0, 3e-3])
def test_underside_that_must_be_known_is_turned_to_where_fingers_reach_it(gap):
    """What is lowest stands, however high a solid is said to end."""
    raised = shapes.Mesh(BRICK.vertices + [0.0, 0.0, gap], BRICK.faces)
    surface = standing(raised, gap)
    assert surface.findings.underside_share == pytest.approx(0.24, abs=0.06)
    motion = choose_turn(surface, 2e-4, underside=True)
    moved = motion.to_outer(raised.vertices)
    assert moved[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert moved[:, :2].mean(axis=0) == pytest.approx([0.0, 0.0], abs=1e-3)
    assert motion.axes[2, 2] < -0.9  # upside down: lying on a side a part of it would stay low
    assert choose_turn(surface, 2e-4, underside=False) is None  # it is taken for flat
    touched = solid(raised, EXACT).surface  # no side brings more
    assert choose_turn(touched, 2e-4, underside=False) is None
    assert choose_turn(replace(surface, platform=None), 2e-4, underside=True) is None


def test_thin_object_is_not_laid_flat_where_no_hand_can_feel_it():
    blade = shapes.Superquadric(np.array([0.03, 0.0015, 0.02]), np.array([0.15, 0.15])).mesh(4)
    blade = shapes.Mesh(blade.vertices + [0.0, 0.0, 0.02], blade.faces)
    surface, thin = standing(blade), TurningSettings(min_thickness=0.0)
    flat = choose_turn(surface, 2e-4, underside=True, settings=thin)
    assert flat is not None and np.ptp(flat.to_outer(blade.vertices)[:, 2]) < 4e-3
    assert choose_turn(surface, 2e-4, underside=True) is None  # on its edges it is not firm


def test_what_it_stood_on_is_flat_until_touched_and_is_touched_next():
    """After half a turn the old underside faces up."""
    before = standing()
    mesh = shapes.Mesh(UPSIDE_DOWN.to_outer(BRICK.vertices), BRICK.faces)
    turned = replace(before, mesh=mesh, pose=UPSIDE_DOWN)
    share = turned.findings.underside_share
    assert share == pytest.approx(before.findings.underside_share, abs=0.06)
    demanded = replace(known(surface=turned, general=True, tolerance=2e-4), underside_share=0.0)
    choice = Touches().next(demanded)
    assert isinstance(choice, Touch) and choice.pose.axes[2, 2] < -0.5  # from above
    names = [one.name for one in estimate_error(demanded).verdict.failed]
    assert "underside" in names
    fine = replace(demanded, tolerance=1e-5)  # of the rest no touch tells more
    assert isinstance(Touches().next(fine), Touch)
    touched = replace(turned, distances=np.full(len(mesh.vertices), 1e-3))
    assert touched.findings.underside_share == 0.0


def test_no_finger_comes_up_through_the_ring_on_which_an_object_stands():
    torus = trimesh.creation.torus(0.05, 0.012, 96, 48)
    mesh = arrays(torus.apply_translation([0.0, 0.0, 0.012]))
    inner = lambda at: 1e-3 if np.hypot(*at[:2]) < 0.042 else 1e-5  # noqa: E731
    surface = solid(mesh, inner).surface
    assert len(surface.offers)
    for offer in surface.offers:
        start = offer.pose.position
        assert np.hypot(*start[:2]) > 0.05 or start[2] > 0.0
    held = solid(mesh, inner, platform=None).surface
    assert any(
        offer.pose.position[2] < 0.0 and np.hypot(*offer.pose.position[:2]) < 0.05
        for offer in held.offers
    )
    assert isinstance(planners.check_choice(Touches(), known(surface=held, general=True)), Touch)
