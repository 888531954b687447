"""A ball, a world and a sensor that the tests of nodes share."""

from __future__ import annotations

import pytest

from palpate.messages.types import SensorInfo, World
from palpate.nodes.specs.sensors import SensorSpec, info_of
from tests.nodes.loop import ball_spec


@pytest.fixture
def ball():
    """A ball of 60 mm that stands on height 0."""
    return ball_spec()


@pytest.fixture
def info() -> SensorInfo:
    return info_of(SensorSpec(), noise=0.0)


@pytest.fixture
def world() -> World:
    return World(platform=0.0, reach=0.15, fingers=1, seed=0)
