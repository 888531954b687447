import csv
import math

import numpy as np
import pytest
from ruamel.yaml import YAML

from palpate.tools.introspection.echo import TextStyle, csv_line, yaml_lines

WHOLE = TextStyle(full=True)


def read(value, style=WHOLE):
    """A value written in YAML and read again."""
    return YAML(typ="safe", pure=True).load("\n".join(yaml_lines({"x": value}, style)))["x"]


@pytest.mark.parametrize(
    "value",
    [
        0,
        -(1 << 62),
        0.1,
        1e-6,
        1e22,
        -2.5e-300,
        True,
        None,
        "hit",
        "",
        "yes",
        "null",
        "3",
        "a: b",
        "- a",
        "# no comment",
        "two\nlines",
        'with "quotes" and \\',
        "naïve \x85\u2028",
        " spaced ",
        "~",
        "{a}",
        "...",
        {},
        {"condition": 1.5, "12": 2.0},
        {"deep": {"deeper": [1, 2]}},
        [],
        [{"a": 1}, {"b": "c, d"}],
    ],
)
@pytest.mark.parametrize("flow", [False, True])
def test_every_value_is_read_as_what_was_written(value, flow):
    found = read(value, TextStyle(full=True, flow=flow))
    assert found == value
    assert type(found) is type(value)


def test_numbers_that_are_none_are_read_as_such():
    assert math.isnan(read(math.nan))
    assert read(-math.inf) == -math.inf


def test_an_array_is_read_as_what_was_written():
    values = np.linspace(-1e-7, 1.0, 30).reshape(5, 3, 2)
    assert np.array_equal(np.array(read(values)), values)
    assert read(np.zeros((0, 3))) == []
    assert read(np.array([True, False])) == [True, False]


def test_a_long_array_is_shortened_and_a_short_one_is_not():
    values = np.full((16, 16), 2e-6)
    assert read(values, TextStyle()) == "16 x 16 float64: 2.0e-06, 2.0e-06, 2.0e-06, ..."
    assert read(tuple(range(17)), TextStyle()) == "17 int: 0, 1, 2, ..."
    assert read(np.arange(16.0), TextStyle()) == list(range(16))


def test_without_arrays_only_their_shape_is_shown():
    assert read(np.zeros(3), TextStyle(arrays=False)) == "3 float64"
    assert read((), TextStyle(arrays=False)) == "0 values"


def test_a_row_has_a_column_for_each_element():
    values = [3, "a,b", np.array([[1.0, 2.0]]), (4, 5), {"k": 0.5}, None]
    (row,) = csv.reader([csv_line(values, WHOLE)])
    assert row == ["3", "a,b", "1.0", "2.0", "4", "5", "0.5", "null"]
    assert csv_line(values[2:3], TextStyle(arrays=False)) == "1 x 2 float64"
