"""Procedures by name, and their settings."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import partial
from typing import Any

from palpate.core.plugins import class_by_name
from palpate.core.procedures.protocol import Procedure, Session, TouchSetup

# Procedure to the number of fingers that it moves at once.
PROCEDURE_NAMES: Mapping[str, int] = {
    "containment": 1,
    "planar": 1,
    "follower": 2,
    "fearing": 3,
    "openings": 1,
}


def procedure_of(name: str, settings: Mapping[str, Any]) -> Procedure:
    """A procedure by its name, or a user's by ``module:function``, with its settings bound.

    `settings` are numbers by parameter name; a parameter called ``settings`` is not among them.
    Raises LookupError if there is no such name. Raises ValueError if the module cannot be
    imported, the object is not callable, or the procedure has no such setting.
    """
    path = f"palpate.core.procedures.{name}:{name}" if name in PROCEDURE_NAMES else name
    if ":" not in path:
        raise LookupError(f"there is no procedure {name!r}; there are {', '.join(PROCEDURE_NAMES)}")
    procedure = class_by_name(path, what="procedure", names=(), package="palpate.core.procedures")
    if not callable(procedure):
        raise ValueError(f"the procedure {name!r} is no function: {procedure!r:.60}")
    known = [key for key in list(inspect.signature(procedure).parameters)[1:] if key != "settings"]
    for key in settings:
        if key not in known:
            hint = f"it has {', '.join(known)}" if known else "it has none"
            raise ValueError(f"the procedure {name!r} has no setting {key!r}; {hint}")
    return partial(procedure, **settings)


def begin_procedure(name: str, settings: Mapping[str, Any], setup: TouchSetup) -> Session:
    """A session of a procedure, before its first move; raises what `procedure_of` raises."""
    return Session(partial(procedure_of(name, settings), setup))
