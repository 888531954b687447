"""The planners that palpate has, and how a user's own is found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from importlib import import_module
from typing import Any, cast, get_type_hints

from palpate.core.explore.planners.choice import Planner

NAMES = ("predicted", "uniform", "thesis", "fuzzy")
"""The default first."""


def planner_type(name: str) -> type[Planner]:
    """The description of a planner: by its name, or a user's own as ``module:Class``.

    Raises
    ------
    LookupError
        If there is no such planner.
    ValueError
        If the module cannot be imported, or holds no such planner.
    """
    if name in NAMES:
        module, attribute = f"{__package__}.{name}", "PLANNER"
    else:
        module, colon, attribute = name.partition(":")
        if not colon:
            raise LookupError(f"there is no planner {name!r}; there are {', '.join(NAMES)}")
    if module.startswith("."):
        raise ValueError(f"the planner {name!r} must name its module in full, with no leading dot")
    try:
        found = getattr(import_module(module), attribute, None)
        get_type_hints(found) if is_dataclass(found) else None
    except (Exception, SystemExit) as error:  # a user's module may do anything when imported
        kind = type(error).__name__
        raise ValueError(f"the planner {name!r} cannot be imported: {kind}: {error}") from None
    frozen = is_dataclass(found) and getattr(found, "__dataclass_params__").frozen  # noqa: B009
    if not isinstance(found, type) or not frozen or not callable(getattr(found, "next", None)):
        raise ValueError(
            f"{name!r} is no planner: {attribute!r} must be a frozen dataclass with next(known)"
        )
    return cast("type[Planner]", found)


def make_planner(name: str, settings: Mapping[str, Any]) -> Planner:
    """A planner with its numbers.

    Raises
    ------
    LookupError
        If there is no such planner.
    ValueError
        If the module is none, or a number is unknown or out of its range.
    """
    described = planner_type(name)
    known = set(getattr(described, "__dataclass_fields__"))  # noqa: B009
    unknown = sorted(set(settings) - known)
    if unknown:
        raise ValueError(
            f"the planner {name!r} has no {', '.join(unknown)}; it has {', '.join(sorted(known))}"
        )
    try:
        return described(**settings)
    except TypeError as error:  # one that must be given is missing, say
        raise ValueError(f"the planner {name!r} cannot be made: {error}") from None
