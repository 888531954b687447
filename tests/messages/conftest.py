from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.fuzz.messages import any_message


@pytest.fixture
def example() -> Callable[[type, int], Any]:
    """Makes a message of any type from a seed."""
    return lambda cls, seed=0: any_message(cls, np.random.default_rng(seed))
