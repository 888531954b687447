"""The effects that palpate has, in the order in which they act."""

from __future__ import annotations

from dataclasses import is_dataclass
from importlib import import_module
from typing import cast, get_type_hints

from palpate.core.touch.effect import Effect, Place

NAMES = (
    "pose_error",
    "arm_backlash",
    "aperture",
    "half_space",
    "hardening",
    "saturation",
    "tenting",
    "creep",
    "arm_compliance",
    "temperature",
    "echo_loss",
    "crosstalk",
    "gain_offset",
    "drift",
    "gaussian_noise",
    "salt_and_pepper",
    "dead_taxels",
    "quantisation",
    "transport",
)
"""By place first, as `palpate.core.touch.effect.Place` has them."""


def effect_type(name: str) -> type[Effect]:
    """The description of an effect: by its name, or a user's own as ``module:Class``.

    Raises
    ------
    LookupError
        If there is no such effect.
    ValueError
        If the module cannot be imported, or holds no such effect.
    """
    if name in NAMES:
        module, attribute = f"{__package__}.{name}", "EFFECT"
    else:
        module, colon, attribute = name.partition(":")
        if not colon:
            raise LookupError(f"there is no effect {name!r}")
    if module.startswith("."):
        raise ValueError(f"the effect {name!r} must name its module in full, without a leading dot")
    try:
        found = getattr(import_module(module), attribute, None)
        get_type_hints(found) if is_dataclass(found) else None
    except (Exception, SystemExit) as error:  # a user's module may do anything when imported
        kind = type(error).__name__
        raise ValueError(f"the effect {name!r} cannot be imported: {kind}: {error}") from None
    if not is_dataclass(found) or not isinstance(found, type) or not hasattr(found, "prepare"):
        raise ValueError(f"{name!r} is no effect: {attribute!r} must be a dataclass with prepare()")
    if not isinstance(getattr(found, "place", None), Place):
        raise ValueError(f"{name!r} is no effect: its place must be one of Place, as Place.SIGNAL")
    return cast("type[Effect]", found)


def rank(name: str) -> int:
    """Where an effect stands among those of its place; a user's own come last."""
    return NAMES.index(name) if name in NAMES else len(NAMES)
