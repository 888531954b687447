"""The planner by itself: contacts and models in, goals out."""

import numpy as np

from palpate.messages.types import GraspContacts, Probe, Superquadric, World
from palpate.nodes import planner
from palpate.nodes.specs.sensors import SensorSpec, info_of
from palpate.testing import drive, example, messages_on

START = [
    ("/world", example(World, reach=0.15, platform=0.0, fingers=1)),
    ("/touch/info", info_of(SensorSpec(), noise=0.0)),
]


def grasp_contacts():
    """64 contacts on a spiral around a ball of radius 30 mm."""
    angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    height = np.linspace(0.005, 0.055, 64)
    ring = np.sqrt(0.03**2 - (height - 0.03) ** 2)
    points = np.column_stack([ring * np.cos(5 * angle), ring * np.sin(5 * angle), height])
    normals = (points - [0.0, 0.0, 0.03]) / 0.03
    return example(GraspContacts, points=points, normals=normals, robot_time=30.0)


GRASPED = [
    ("/hand/contacts", grasp_contacts()),
    (
        "/model/coarse",
        example(
            Superquadric, size=np.full(3, 0.03), exponents=np.ones(2), residuals=np.zeros(64),
            pose=np.array([0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 1.0]),
        ),
    ),
]  # fmt: skip


def test_hand_closes_first():
    [goal] = messages_on(drive(planner.NODE, START), "/hand/goal")
    assert goal.number == 0 and goal.opening > 0.05


def test_contacts_lead_to_a_coarse_model_then_an_end_touch():
    published = drive(planner.NODE, [*START, *GRASPED[:1]])
    [goal] = messages_on(published, "/model/goal")
    assert (goal.closings, goal.contours) == (1, ())
    [touch] = messages_on(drive(planner.NODE, [*START, *GRASPED]), "/probe/goal")
    assert touch.pose[2] > 0.06  # from above the ball


def test_thesis_starts_at_half_height():
    params = {"planner": "thesis", "touch_ends": False}
    [goal] = messages_on(drive(planner.NODE, [*START, *GRASPED], params), "/contour/goal")
    assert abs(goal.height + goal.frame[2] - 0.03) < 1e-3


def test_spent_budget_ends_the_plan():
    published = drive(planner.NODE, [*START, *GRASPED], {"most_touches": 1})
    [touch] = messages_on(published, "/probe/goal")
    result = example(Probe, id=touch.id, finger=1, touches=1, outcome="miss", point=np.zeros(3))
    published = drive(
        planner.NODE, [*START, *GRASPED, ("/probe/traced", result)], {"most_touches": 1}
    )
    [done] = messages_on(published, "/plan/done")
    assert "the budget is spent: 1 of 1 touches" in done.reason
