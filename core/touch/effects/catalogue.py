"""The effects that palpate has, in the order in which they act; how one is found by its name."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import cast

from palpate.core.plugins import class_by_name
from palpate.core.touch.pipeline import Effect, Phase

# Each with its module; by phase first, as `palpate.core.touch.Phase` has them.
MODULES = {
    "pose_error": "arm",
    "arm_backlash": "arm",
    "aperture": "echoes",
    "half_space": "rubber",
    "hardening": "rubber",
    "saturation": "rubber",
    "tenting": "rubber",
    "creep": "rubber",
    "arm_compliance": "arm",
    "temperature": "echoes",
    "echo_loss": "echoes",
    "crosstalk": "echoes",
    "gain_offset": "electronics",
    "drift": "electronics",
    "gaussian_noise": "electronics",
    "salt_and_pepper": "electronics",
    "dead_taxels": "electronics",
    "quantisation": "electronics",
    "transport": "electronics",
}
EFFECT_NAMES = tuple(MODULES)


def effect_type(name: str) -> type[Effect]:
    """The description of an effect: by its name, or a user's own as ``module:Class``.

    Raises LookupError if there is none; ValueError if its module holds none, or cannot be imported.
    """
    place = name
    if name in MODULES:
        place = f"{__package__}.{MODULES[name]}:{name.title().replace('_', '')}"
    found = class_by_name(place, what="effect", names=EFFECT_NAMES, package="")
    wanted = name.rpartition(":")[2]
    if not is_dataclass(found) or not isinstance(found, type) or not hasattr(found, "prepare"):
        raise ValueError(f"{name!r} is no effect: {wanted!r} must be a dataclass with prepare()")
    if not isinstance(getattr(found, "phase", None), Phase):
        raise ValueError(f"{name!r} is no effect: its phase must be one of Phase, as Phase.SIGNAL")
    return cast("type[Effect]", found)


def rank(name: str) -> int:
    """Where an effect stands among those of its phase; a user's own come last."""
    return EFFECT_NAMES.index(name) if name in EFFECT_NAMES else len(EFFECT_NAMES)
