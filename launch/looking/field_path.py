"""The path to a value within a message, as people write it: ``pose[2]``, ``health.condition``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from palpate.launch.nearest import hint
from palpate.messages.codec import codec_of

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
PATH = rf"{_NAME}(?:\.{_NAME}|\[[0-9]+\])*"
"""Pattern of a path."""
_STEP = re.compile(rf"\.?({_NAME})|\[([0-9]{{1,9}})\]")


class FieldPath(NamedTuple):
    """Steps from a message to one of its values."""

    text: str
    """As it was written."""
    steps: tuple[str | int, ...]
    """Field, then keys of tables and indices of sequences."""

    def of(self, fields: Mapping[str, Any]) -> Any:
        """The value at this path.

        Raises
        ------
        LookupError
            If this message has none there.
        """
        value: Any = fields
        for step in self.steps:
            if not isinstance(value, (np.ndarray, tuple) if isinstance(step, int) else Mapping):
                raise LookupError(self.text)
            value = value[step]  # type: ignore[index]
        return value.item() if isinstance(value, np.generic) else value


def read_path(text: str, cls: type) -> FieldPath:
    """A path in messages of one type; ``m.`` before it means the message and may be left out.

    Raises
    ------
    ValueError
        If it cannot be read, or the type has no such field.
    """
    wanted = text.removeprefix("m.")
    if not re.fullmatch(PATH, wanted):
        raise ValueError(f"{text!r} is no field; expected something like pose[2] or robot_time")
    steps = tuple(int(index) if index else name for name, index in _STEP.findall(wanted))
    known = codec_of(cls).names
    if steps[0] not in known:
        raise ValueError(f"{cls.__name__} has no field {steps[0]!r}; {hint(str(steps[0]), known)}")
    return FieldPath(text, steps)
