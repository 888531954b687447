"""What is known of objects with a simple formula, without a touch."""

from types import SimpleNamespace

import numpy as np
import pytest

from palpate.core.explore.planners.coverage import estimate_error
from palpate.core.explore.planners.protocol import (
    Height,
    Observation,
    ObservedSlice,
    SliceOutcome,
    Stop,
    slice_without_contour,
)

HEIGHT = 0.09
TURNS = 16
BAND = 7e-3
STEP = 1e-4


def round_slice(side, share, unit=1.0, **changes):
    """A slice of a round body: radii over height as shares of the height, in any unit."""
    size = HEIGHT * unit
    below, here, above = (side(share + d) for d in (-STEP, 0.0, STEP))
    slope = (above - below) / (2.0 * STEP)
    bend = -(above - 2.0 * here + below) / STEP**2 / (1.0 + slope**2) ** 1.5
    reach = BAND * unit / np.sqrt(1.0 + slope**2)
    fields = {
        "height": share * size,
        "outcome": SliceOutcome.CLOSED,
        "radii": np.full(TURNS, here * size),
        "slopes": np.full(TURNS, slope),
        "curvatures": np.full(TURNS, bend / size),
        "contact_low": np.full(TURNS, share * size - reach),
        "contact_high": np.full(TURNS, share * size + reach),
    }
    return ObservedSlice(**(fields | changes))


def failed_slice(height, outcome=SliceOutcome.FAILED):
    return slice_without_contour(height, outcome)


def known_of(slices=(), unit=1.0, **changes):
    fields = {
        "low": 0.0,
        "high": HEIGHT * unit,
        "tolerance": 0.0025 * HEIGHT * unit,
        "resolution": 1e-5 * unit,
        "feature": 2.5e-3 * unit,
        "slices": tuple(slices),
    }
    return Observation(**(fields | changes))


def walk_over(planner, side, unit=1.0, top=1.0, **changes):
    """Heights asked for, as shares, and the end with what is known then; None after 60 slices."""
    slices = []
    while len(slices) < 60:
        choice = planner.next(known_of(slices, unit, **changes))
        if not isinstance(choice, Height):
            assert isinstance(choice, Stop)
            known = estimate_error(known_of(slices, unit, **changes))
            names = ("rms_bound_95", "largest_untouched", "reached", "halving", "prediction")
            told = {name: getattr(known, name) for name in names}
            end = SimpleNamespace(reason=choice.reason, **told)
            return [one.height / (HEIGHT * unit) for one in slices], end
        share = choice.height / (HEIGHT * unit)
        if share < top:
            slices.append(round_slice(side, share, unit))
        else:
            slices.append(failed_slice(choice.height, SliceOutcome.LOST))
    return [one.height / (HEIGHT * unit) for one in slices], None


@pytest.fixture
def slice_of():
    return round_slice


@pytest.fixture
def failed():
    return failed_slice


@pytest.fixture
def observation():
    return known_of


@pytest.fixture
def explored():
    return walk_over


def _vase(z):
    return float(0.28 + 0.09 * np.sin(8.5 * z + 0.4))


def _bottle(z):
    return float(0.35 - 0.11 * (1.0 + np.tanh((z - 0.7) / 0.04)))


def _ball(z):
    return float(np.sqrt(max(z * (1.0 - z), 1e-9)))


def _cylinder(z):
    return 0.3


@pytest.fixture
def sides():
    return {"vase": _vase, "bottle": _bottle, "ball": _ball, "cylinder": _cylinder}
