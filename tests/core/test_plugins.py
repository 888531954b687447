import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
import pytest

from palpate.core.plugins import (
    Range,
    check_ranges,
    code_place,
    in_base_units,
    ranges_of,
    told_error,
)


@dataclass(frozen=True, kw_only=True)
class Described:
    kind: ClassVar = "no number"
    length: Annotated[float, Range(0.0, 2e-3, "m")] = 1e-3
    share: Annotated[float, Range(0.1, 0.9, "1")] = 0.5
    count: Annotated[int | None, Range(1, 32, "1")] = None
    free: float = math.inf

    def __post_init__(self):
        check_ranges(self)


def test_an_error_comes_from_the_last_line_of_the_user_s_code():
    def broken(value):
        return Described(length=value)

    with pytest.raises(ValueError) as caught:
        broken(-1.0)
    place = code_place(caught.value)
    assert (place.is_own, place.function, place.line) == (
        True,
        "__post_init__",
        Described.__post_init__.__code__.co_firstlineno + 1,
    )
    with pytest.raises(TypeError) as caught:
        np.linalg.norm(broken)
    assert told_error(caught.value).endswith(f"({code_place(caught.value)})")
    outer = RuntimeError("outer")
    outer.__cause__ = caught.value
    assert code_place(outer) == code_place(caught.value)
    assert code_place(RuntimeError("raised by nobody")) is None


def test_ranges_are_read_off_the_fields_that_have_one():
    assert ranges_of(Described) == {
        "length": Range(0.0, 2e-3, "m"),
        "share": Range(0.1, 0.9, "1"),
        "count": Range(1, 32, "1"),
    }


def test_a_range_is_stated_with_its_unit_unless_it_has_none():
    assert str(Range(0.0, 2e-3, "m")) == "0 to 0.002 m"
    assert str(Range(0.1, 0.9, "1")) == "0.1 to 0.9"


def test_a_length_given_as_text_is_read_by_its_unit_and_nothing_else_is_changed():
    given = {"length": "0.5mm", "share": "0.5", "free": "1mm", "other": "2mm"}
    assert in_base_units(Described, given) == {**given, "length": 5e-4}
    with pytest.raises(ValueError, match="length is '1s'; expected number: the unit 's'"):
        in_base_units(Described, {"length": "1s"})


def test_both_ends_of_a_range_belong_to_it():
    Described(length=0.0, share=0.1, count=1)
    Described(length=2e-3, share=0.9, count=32)


def test_a_number_that_was_left_out_is_not_checked():
    assert Described(count=None).count is None


def test_any_kind_of_number_is_one():
    Described(length=0, share=np.float64(0.5), count=np.int64(3))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"length": "1e-3"}, "length is '1e-3'; expected a number, 0 to 0.002 m"),
        ({"length": None}, "length is None; expected a number, 0 to 0.002 m"),
        ({"share": [0.5]}, "share is [0.5]; expected a number, 0.1 to 0.9"),
        ({"count": 2.0}, "count is 2.0; expected a whole number, 1 to 32"),
        ({"count": True}, "count is True; expected a whole number, 1 to 32"),
    ],
)
def test_what_is_no_number_or_no_whole_one_is_refused(given, words):
    with pytest.raises(ValueError) as caught:
        Described(**given)
    assert str(caught.value) == words


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"length": 3e-3}, "length is 0.003 m; expected 0 to 0.002 m"),
        ({"length": -1e-9}, "length is -1e-09 m; expected 0 to 0.002 m"),
        ({"share": 0.0}, "share is 0; expected 0.1 to 0.9"),
        ({"share": math.nan}, "share is nan; expected 0.1 to 0.9"),
        ({"length": math.inf}, "length is inf m; expected 0 to 0.002 m"),
        ({"count": 33}, "count is 33; expected 1 to 32"),
    ],
)
def test_a_number_outside_its_range_is_refused(given, words):
    with pytest.raises(ValueError) as caught:
        Described(**given)
    assert str(caught.value) == words
