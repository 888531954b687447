"""Laws of plug-ins: classes by name, ranges and units of parameters, places of errors."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
import pytest

from palpate.core import plugins
from palpate.core.plugins import Range, class_by_name, code_place, describe_error, in_base_unit


@dataclass(frozen=True, kw_only=True)
class Described:
    kind: ClassVar = "no number"
    length: Annotated[float, Range(0.0, 2e-3, "m")] = 1e-3
    share: Annotated[float, Range(0.1, 0.9, "1")] = 0.5
    count: Annotated[int | None, Range(1, 32, "1")] = None
    free: float = math.inf

    def __post_init__(self) -> None:
        plugins.check_ranges(self)


def test_errors_name_the_last_line_of_user_code():
    with pytest.raises(ValueError) as caught:
        Described(length=-1.0)
    place = code_place(caught.value)
    line = Described.__post_init__.__code__.co_firstlineno + 1
    assert (place.is_own, place.function, place.line) == (True, "__post_init__", line)
    with pytest.raises(TypeError) as caught:
        np.linalg.norm(code_place)
    assert describe_error(caught.value).endswith(f"({code_place(caught.value)})")
    outer = RuntimeError("outer")
    outer.__cause__ = caught.value
    assert code_place(outer) == code_place(caught.value)
    assert code_place(RuntimeError("never raised")) is None
    assert describe_error(RuntimeError("two\nlines")) == "RuntimeError: two"
    with pytest.raises(SyntaxError) as caught:
        compile("a b", "script.py", "exec")
    assert describe_error(caught.value).endswith("(script.py:1)")


def test_ranges_are_read_from_annotations():
    length, share = Range(0.0, 2e-3, "m"), Range(0.1, 0.9, "1")
    assert plugins.ranges_of(Described) == {
        "length": length,
        "share": share,
        "count": Range(1, 32, "1"),
    }
    assert (str(length), str(share)) == ("0 to 0.002 m", "0.1 to 0.9")
    # Both ends belong to a range, any kind of number is one, and None is left out.
    Described(length=0, share=np.float64(0.1), count=np.int64(1))
    Described(length=2e-3, share=0.9, count=32)


def test_texts_with_units_are_read():
    options = {"length": "0.5mm", "share": "0.5", "free": "1mm", "other": "2mm"}
    assert plugins.in_base_units(Described, options) == {**options, "length": 5e-4}
    exact = {"10um": 1e-5, "10 µm": 1e-5, "1e1 μm": 1e-5, "+2.5in": 0.0635, " .5 cm ": 0.005}
    assert {text: in_base_unit(text, plugins.UNITS["m"]) for text in exact} == exact
    assert in_base_unit("-5 min", plugins.UNITS["s"]) == -300.0


UNIT = "length is '1s'; expected number: the unit 's' is none of m, cm, mm, um, in, ft, as in 0.2mm"


def test_classes_are_found_by_name():
    own = {"what": "room", "names": ("plain_steps",), "package": "collections"}
    assert class_by_name("collections:Counter", **own).__name__ == "Counter"
    own = {"what": "kind", "names": ("decoder",), "package": "json"}
    assert class_by_name("decoder", **own) is None  # json.decoder has no class Decoder
    with pytest.raises(LookupError, match="there is no kind 'other'; there are decoder"):
        class_by_name("other", **own)
    with pytest.raises(ValueError, match=r"'\.a:B' must name its module in full"):
        class_by_name(".a:B", **own)
    with pytest.raises(ValueError, match="'no_such_module:B' cannot be imported: ModuleNotFound"):
        class_by_name("no_such_module:B", **own)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Described(length="1e-3"), "length is '1e-3'; expected a number, 0 to 0.002 m"),
        (lambda: Described(length=None), "length is None; expected a number, 0 to 0.002 m"),
        (lambda: Described(share=[0.5]), "share is [0.5]; expected a number, 0.1 to 0.9"),
        (lambda: Described(count=2.0), "count is 2.0; expected a whole number, 1 to 32"),
        (lambda: Described(count=True), "count is True; expected a whole number, 1 to 32"),
        (lambda: Described(length=3e-3), "length is 0.003 m; expected 0 to 0.002 m"),
        (lambda: Described(length=-1e-9), "length is -1e-09 m; expected 0 to 0.002 m"),
        (lambda: Described(share=0.0), "share is 0; expected 0.1 to 0.9"),
        (lambda: Described(share=math.nan), "share is nan; expected 0.1 to 0.9"),
        (lambda: Described(length=math.inf), "length is inf m; expected 0 to 0.002 m"),
        (lambda: Described(count=33), "count is 33; expected 1 to 32"),
        (lambda: plugins.in_base_units(Described, {"length": "1s"}), UNIT),
        (lambda: in_base_unit("1", plugins.UNITS["s"]), "must have a unit: s, min, h, as in 0.2s"),
        (lambda: in_base_unit("mm", plugins.UNITS["m"]), "must be a number with a unit, as 0.2mm"),
    ],
)
def test_bad_values_are_refused(call, words):
    with pytest.raises(ValueError) as caught:
        call()
    assert str(caught.value) == words
