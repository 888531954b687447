"""The effects that palpate has, in the order in which they act."""

from __future__ import annotations

from importlib import import_module

from palpate.core.touch.effect import Effect

NAMES = (
    "pose_error",
    "arm_backlash",
    "arm_compliance",
    "aperture",
    "hardening",
    "saturation",
    "half_space",
    "tenting",
    "creep",
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
    """The description of an effect, by its name or, with a dot in it, by its module's.

    Raises
    ------
    LookupError
        If there is no such effect.
    ValueError
        If the module cannot be imported, or holds no effect.
    """
    if name in NAMES:
        module = f"{__package__}.{name}"
    elif "." in name:
        module = name
    else:
        raise LookupError(f"there is no effect {name!r}")
    try:
        found = import_module(module)
    except ImportError as error:
        raise ValueError(f"the effect {name!r} cannot be imported: {error}") from None
    described = getattr(found, "EFFECT", None)
    if not isinstance(described, type) or not hasattr(described, "place"):
        raise ValueError(f"the module {name!r} holds no effect: it needs EFFECT = a dataclass")
    return described


def rank(name: str) -> int:
    """Where an effect stands among those of its place; a user's own come last."""
    return NAMES.index(name) if name in NAMES else len(NAMES)
