"""Plug-ins: a class by its name, and the declared ranges and units of its parameters.

Effects and planners of palpate have names, a user's are ``module:Class``. Each declares the range
and unit of its numbers beside its fields; they are checked here. A length or a time may also be a
text with a unit, ``0.2mm``.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from decimal import Decimal
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from numbers import Integral, Real
from traceback import walk_tb
from types import NoneType
from typing import TYPE_CHECKING, Any, NamedTuple, get_args, get_type_hints

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

# [m]
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
TIMES = {"s": 1.0, "min": 60.0, "h": 3600.0}  # [s]
UNITS = {"m": LENGTHS, "s": TIMES}  # accepted units by base unit
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Zµμ]*)\s*")
PACKAGE = __name__.partition(".")[0]
# Folders of code that is neither the user's nor palpate's.
INSTALLED = frozenset(
    {"site-packages", "dist-packages", f"python{sys.version_info.major}.{sys.version_info.minor}"}
)


def class_by_name(name: str, *, what: str, names: Sequence[str], package: str) -> object:
    """Object with a name; the caller checks whether it is suitable.

    `name`: one of `names`, or ``module:Class``. `what`: kind of the object, for error messages:
    "effect". `names`: modules of `package`, each with a class of its own name. Raises LookupError
    if there is no such name. Raises ValueError if the module cannot be imported.
    """
    module, colon, wanted = name.partition(":")
    if name in names:
        module, wanted = f"{package}.{name}", name.title().replace("_", "")
    elif not colon:
        raise LookupError(f"there is no {what} {name!r}; there are {', '.join(names)}")
    if module.startswith("."):
        raise ValueError(f"the {what} {name!r} must name its module in full, without a leading dot")
    try:
        result: object = getattr(import_module(module), wanted, None)
        get_type_hints(result) if is_dataclass(result) else None
    except (Exception, SystemExit) as error:  # a user's module may do anything when imported
        raise ValueError(
            f"the {what} {name!r} cannot be imported: {describe_error(error)}"
        ) from None
    return result


class CodePlace(NamedTuple):
    """A line of a program."""

    file: str
    line: int
    function: str  # empty if it is not known
    is_own: bool  # whether it is the user's code, not palpate's

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" + (f" in {self.function}" if self.function else "")


def code_place(error: BaseException) -> CodePlace | None:
    """Origin of an error: the last line of the user's code, or else of palpate's.

    Its causes are searched too. None if neither code is in the traceback.
    """
    origin: CodePlace | None = None
    following: BaseException | None = error
    while following is not None:
        for place in _places(following):
            if place.is_own or origin is None or not origin.is_own:
                origin = place
        hidden = following.__suppress_context__
        following = following.__cause__ or (None if hidden else following.__context__)
    return origin


def describe_error(error: BaseException) -> str:
    """Type and first line of an error, and its origin in the user's code."""
    words = error.msg if isinstance(error, SyntaxError) else str(error)
    what, place = next(iter(words.splitlines()), ""), code_place(error)
    text = f"{type(error).__name__}: {what}"
    return f"{text} ({place})" if place is not None and place.is_own else text


def _places(error: BaseException) -> Iterator[CodePlace]:
    for frame, line in walk_tb(error.__traceback__):
        file, module = frame.f_code.co_filename, str(frame.f_globals.get("__name__", ""))
        ours = module.partition(".")[0] == PACKAGE
        if ours or not (file.startswith("<") or INSTALLED.intersection(file.split("/"))):
            yield CodePlace(file, line, frame.f_code.co_name, not ours)
    if isinstance(error, SyntaxError) and error.filename is not None:
        yield CodePlace(error.filename, error.lineno or 1, "", is_own=True)


class Range(NamedTuple):
    """Closed range of a number, and its unit; ``"1"`` is no unit."""

    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.low:g} to {self.high:g}{unit}"


def ranges_of(described: type) -> Mapping[str, Range]:
    """The ranges that a dataclass declares: ``sigma: Annotated[float, Range(0, 1, "m")]``."""
    hints = get_type_hints(described, include_extras=True)
    notes = ((name, note) for name in hints for note in getattr(hints[name], "__metadata__", ()))
    return {name: note for name, note in notes if isinstance(note, Range)}


def check_ranges(value: Any) -> None:
    """Check the numbers of a dataclass against their ranges; call it in ``__post_init__``.

    Raises ValueError with field, value, range and unit if a value is outside, no number, or not
    whole where that is declared.
    """
    described: type = type(value)
    for name, (allowed, members) in _declared(described).items():
        number = getattr(value, name)
        if number is None and NoneType in members:  # an optional number
            continue
        whole = float not in members
        of_kind = isinstance(number, Real) and not isinstance(number, bool)
        if of_kind and not (math.isfinite(number) and allowed.low <= number <= allowed.high):
            unit = "" if allowed.unit == "1" else f" {allowed.unit}"
            raise ValueError(f"{name} is {number:g}{unit}; expected {allowed}")
        if not of_kind or (whole and not isinstance(number, Integral)):
            what = "a whole number" if whole else "a number"
            raise ValueError(f"{name} is {number!r}; expected {what}, {allowed}")


def in_base_unit(text: str, units: Mapping[str, float]) -> float:
    """A number with its unit, ``0.2mm`` or ``5 min``, in m or s; `units` as in `UNITS`.

    Raises ValueError if there is no number, no unit or another one; its message has no subject.
    """
    match = _QUANTITY.fullmatch(text)
    example = f"0.2{'mm' if 'mm' in units else 's'}"
    if match is None:
        raise ValueError(f"must be a number with a unit, as {example}")
    number, unit = match.groups()
    unit = unit.replace("µ", "u").replace("μ", "u")
    if unit not in units:
        what = f"the unit {unit!r} is none of" if unit else "must have a unit:"
        raise ValueError(f"{what} {', '.join(units)}, as in {example}")
    try:
        return float(Decimal(number) * Decimal(repr(units[unit])))  # 10um is 1e-5, to the last bit
    except ArithmeticError:
        return float(number)  # so large or small that no unit matters


def in_base_units(described: type, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a dataclass, with texts of lengths and times converted to m and s.

    Raises ValueError with the parameter and the text if one cannot be read.
    """
    result, ranges = dict(parameters), ranges_of(described)
    for name, value in parameters.items():
        units = UNITS.get(ranges[name].unit) if name in ranges else None
        if isinstance(value, str) and units is not None:
            try:
                result[name] = in_base_unit(value, units)
            except ValueError as error:
                raise ValueError(f"{name} is {value!r}; expected number: {error}") from None
    return result


class Ranged:
    """Base of dataclasses that check their numbers by `check_ranges` when they are made."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check_ranges(self)


@cache
def _declared(described: type) -> Mapping[str, tuple[Range, tuple[type, ...]]]:
    """Range of each number, and the types of its annotation: two for ``int | None``."""
    hints = get_type_hints(described)
    ranges = ranges_of(described).items()
    return {name: (allowed, get_args(hints[name]) or (hints[name],)) for name, allowed in ranges}


def entry_points_of(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name, without those whose module is not installed.

    Built-in names should not be looked up here: the import of `importlib.metadata` is slow.
    """
    from importlib.metadata import entry_points

    return {point.name: point for point in entry_points(group=group) if _is_installed(point)}


def _is_installed(point: EntryPoint) -> bool:
    try:
        return find_spec(point.module) is not None
    except ModuleNotFoundError:  # a package above it
        return False
