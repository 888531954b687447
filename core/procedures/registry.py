"""Procedures by their names, and their settings."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import partial
from typing import Any

from palpate.core.plugins import class_by_name
from palpate.core.procedures.protocol import Procedure, Session, TouchSetting

# How many fingers each needs at once.
PROCEDURE_NAMES: Mapping[str, int] = {
    "containment": 1,
    "planar": 1,
    "follower": 2,
    "fearing": 3,
    "openings": 1,
}


def procedure_of(name: str, settings: Mapping[str, Any]) -> Procedure:
    """A procedure by its name, or a user's by ``module:function``; it is not begun.

    Raises LookupError if there is none of this name. Raises ValueError if its module cannot be
    imported, it is no function, or it has no such setting.
    """
    where = f"palpate.core.procedures.{name}:{name}" if name in PROCEDURE_NAMES else name
    found = class_by_name(
        where, what="procedure", names=(), package="palpate.core.procedures"
    ) if ":" in where else None  # fmt: skip
    if found is None and ":" not in where:
        raise LookupError(f"there is no procedure {name!r}; there are {', '.join(PROCEDURE_NAMES)}")
    if not callable(found):
        raise ValueError(f"the procedure {name!r} is no function: {found!r:.60}")
    known = list(inspect.signature(found).parameters)[1:]
    for key in settings:
        if key not in known:
            told = f"it has {', '.join(known)}" if known else "it has none"
            raise ValueError(f"the procedure {name!r} has no setting {key!r}; {told}")
    return partial(found, **settings)


def begin_procedure(name: str, settings: Mapping[str, Any], setting: TouchSetting) -> Session:
    """A procedure that is ready to be asked for its first move; errors as of `procedure_of`."""
    return Session(partial(procedure_of(name, settings), setting))
