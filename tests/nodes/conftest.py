"""A world and a sensor that the tests of nodes share."""

from __future__ import annotations

import pytest

from palpate.messages.types import SensorInfo, World
from palpate.nodes.specs.sensors import SensorSpec, info_of


@pytest.fixture
def info() -> SensorInfo:
    return info_of(SensorSpec(), noise=0.0)


@pytest.fixture
def world() -> World:
    return World(platform=0.0, reach=0.15, fingers=1, seed=0)
