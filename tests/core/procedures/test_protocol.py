"""Sessions of procedures, moves that keep off the platform, and procedures by name."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.procedures import (
    PROCEDURE_NAMES,
    Findings,
    HandContacts,
    Session,
    TouchSetting,
    approach,
    begin_procedure,
    procedure_of,
)
from palpate.core.procedures.protocol import UP, kept_clear
from palpate.core.touch import Pad

PAD = Pad(16, 16, 1e-3, 3e-3, 66.0, 0.8)
SETTING = TouchSetting(PAD, 0.0, 0.0, 0.12)
MET = HandContacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int32), 0.0)


def counting():
    """A procedure that yields numbers in place of moves, and counts how often it was begun."""
    begun = []

    def procedure():
        begun.append(1)
        for number in range(3):
            _ = yield number
        return Findings(status="done", reason="counted")

    return procedure, begun


def test_a_session_goes_on_without_beginning_anew():
    procedure, begun = counting()
    session = Session(procedure)
    assert [session.after((MET,) * n) for n in range(3)] == [0, 1, 2]
    assert session.after((MET,) * 3).reason == "counted" and len(begun) == 1


def test_the_same_results_give_the_same_move_whatever_was_asked_before():
    procedure, begun = counting()
    session = Session(procedure)
    assert session.after((MET, MET)) == 2
    assert session.after((MET,)) == 1 and session.after((MET, MET)) == 2
    assert session.after((MET, MET)) == 2 and len(begun) == 3


def test_a_move_is_shortened_to_stay_above_the_platform():
    down = kept_clear(SETTING, approach(np.array([0.0, 0, 0.0]), UP, 0.05, 0.02))
    assert down is not None and down.reach == pytest.approx(0.05)
    level = approach(np.array([0.0, 0, 0.004]), np.array([1.0, 0, 0]), 0.05, 0.0)
    assert kept_clear(SETTING, level) is None
    assert kept_clear(SETTING, approach(np.array([0.0, 0, 0.02]), np.array([1.0, 0, 0]), 0.05, 0.0))
    below = approach(np.array([0.0, 0, 0.004]), -UP, 0.05, 0.0)
    assert kept_clear(SETTING, below) is None


@pytest.mark.parametrize("name", PROCEDURE_NAMES)
def test_every_procedure_is_found_by_its_name(name):
    assert begin_procedure(name, {}, SETTING).after(()) is not None


def test_unknown_names_and_settings_are_refused_with_what_there_is():
    with pytest.raises(LookupError, match="no procedure 'planer'; there are containment, planar"):
        procedure_of("planer", {})
    with pytest.raises(ValueError, match="'planar' has no setting 'steps'; it has none"):
        procedure_of("planar", {"steps": 3})
    with pytest.raises(ValueError, match="'openings' has no setting 'step'; it has pitch"):
        procedure_of("openings", {"step": 3})
    with pytest.raises(ValueError, match="cannot be imported"):
        procedure_of("no_such_module:explore", {})
    with pytest.raises(ValueError, match="is no function"):
        procedure_of("palpate.core.procedures.protocol:POINT_ERROR", {})
