"""The effects that palpate has, in the order in which they act; how one is found by its name."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import cast

from palpate.core.plugins import class_by_name
from palpate.core.touch.pipeline import Effect, Phase

# By phase first, as `palpate.core.touch.Phase` has them.
EFFECT_NAMES = (
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


def effect_type(name: str) -> type[Effect]:
    """The description of an effect: by its name, or a user's own as ``module:Class``.

    Raises LookupError if there is no such effect. Raises ValueError if the module cannot be
    imported, or holds no such effect.
    """
    found = class_by_name(name, what="effect", names=EFFECT_NAMES, package=str(__package__))
    wanted = name.rpartition(":")[2]
    if not is_dataclass(found) or not isinstance(found, type) or not hasattr(found, "prepare"):
        raise ValueError(f"{name!r} is no effect: {wanted!r} must be a dataclass with prepare()")
    if not isinstance(getattr(found, "phase", None), Phase):
        raise ValueError(f"{name!r} is no effect: its phase must be one of Phase, as Phase.SIGNAL")
    return cast("type[Effect]", found)


def rank(name: str) -> int:
    """Where an effect stands among those of its phase; a user's own come last."""
    return EFFECT_NAMES.index(name) if name in EFFECT_NAMES else len(EFFECT_NAMES)
