"""The planner by itself: what was found goes in, what is to be done comes out."""

import numpy as np

from palpate.messages.types import GraspContacts, Probe, Superquadric, World
from palpate.nodes import planner
from palpate.nodes.specs.sensors import SensorSpec, info_of
from palpate.testing import drive, example, messages_on

BEGUN = [
    ("/world", example(World, reach=0.15, platform=0.0, fingers=1)),
    ("/touch/info", info_of(SensorSpec(), noise=0.0)),
]
turn = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
height = np.linspace(0.005, 0.055, 64)
ring = np.sqrt(0.03**2 - (height - 0.03) ** 2)
POINTS = np.column_stack([ring * np.cos(5 * turn), ring * np.sin(5 * turn), height])
NORMALS = (POINTS - [0.0, 0.0, 0.03]) / 0.03
GRASPED = [
    ("/hand/contacts", example(GraspContacts, points=POINTS, normals=NORMALS, robot_time=30.0)),
    (
        "/model/coarse",
        example(
            Superquadric, size=np.full(3, 0.03), exponents=np.ones(2), residuals=np.zeros(64),
            pose=np.array([0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 1.0]),
        ),
    ),
]  # fmt: skip


def test_hand_closes_first():
    [goal] = messages_on(drive(planner.NODE, BEGUN), "/hand/goal")
    assert goal.number == 0 and goal.opening > 0.05


def test_enough_contacts_give_a_coarse_model_then_a_touch_of_the_end():
    published = drive(planner.NODE, [*BEGUN, *GRASPED[:1]])
    [asked] = messages_on(published, "/model/goal")
    assert (asked.closings, asked.contours) == (1, ())
    [touch] = messages_on(drive(planner.NODE, [*BEGUN, *GRASPED]), "/probe/goal")
    assert touch.pose[2] > 0.06  # from above the ball


def test_thesis_begins_at_half_height():
    params = {"planner": "thesis", "touch_ends": False}
    [goal] = messages_on(drive(planner.NODE, [*BEGUN, *GRASPED], params), "/contour/goal")
    assert abs(goal.height + goal.frame[2] - 0.03) < 1e-3


def test_budget_ends_it():
    published = drive(planner.NODE, [*BEGUN, *GRASPED], {"most_touches": 1})
    [touch] = messages_on(published, "/probe/goal")
    result = example(Probe, id=touch.id, finger=1, touches=1, outcome="miss", point=np.zeros(3))
    published = drive(
        planner.NODE, [*BEGUN, *GRASPED, ("/probe/traced", result)], {"most_touches": 1}
    )
    [done] = messages_on(published, "/plan/done")
    assert "the budget is spent: 1 of 1 touches" in done.reason
