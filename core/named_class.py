"""A class by its name: one that comes with palpate, or a user's own as ``module:Class``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import is_dataclass
from importlib import import_module
from typing import get_type_hints


def class_called(
    name: str, *, what: str, names: Sequence[str], package: str, attribute: str
) -> object:
    """What stands under a name; whether it is of any use is for the caller to see.

    Parameters
    ----------
    name : str
        One of `names`, or ``module:Class``.
    what : str
        The kind of thing, for complaints: "effect".
    names : sequence of str
        Modules of `package`, each with one such thing.
    package, attribute : str
        Where those are, and what they call it.

    Raises
    ------
    LookupError
        If there is none of this name.
    ValueError
        If the module cannot be imported.
    """
    module, colon, wanted = name.partition(":")
    if name in names:
        module, wanted = f"{package}.{name}", attribute
    elif not colon:
        raise LookupError(f"there is no {what} {name!r}; there are {', '.join(names)}")
    if module.startswith("."):
        raise ValueError(f"the {what} {name!r} must name its module in full, without a leading dot")
    try:
        found: object = getattr(import_module(module), wanted, None)
        get_type_hints(found) if is_dataclass(found) else None
    except (Exception, SystemExit) as error:  # a user's module may do anything when imported
        kind = type(error).__name__
        raise ValueError(f"the {what} {name!r} cannot be imported: {kind}: {error}") from None
    return found
