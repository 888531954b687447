"""The planners that palpate has, and how a user's own is found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any, cast

from palpate.core.explore.planners.choice import Planner
from palpate.core.named_class import class_called

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
    found = class_called(
        name, what="planner", names=NAMES, package=str(__package__), attribute="PLANNER"
    )
    wanted = name.rpartition(":")[2]
    frozen = is_dataclass(found) and getattr(found, "__dataclass_params__").frozen  # noqa: B009
    if not isinstance(found, type) or not frozen or not callable(getattr(found, "next", None)):
        raise ValueError(
            f"{name!r} is no planner: {wanted!r} must be a frozen dataclass with next(known)"
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
