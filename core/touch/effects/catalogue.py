"""The effects in the order in which they act, and their look-up by name."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import cast

from palpate.core.plugins import class_by_name
from palpate.core.touch.pipeline import Effect, Phase

# Effect to module, ordered by `palpate.core.touch.Phase` first.
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
    """Class of an effect: by its name, or a user's own as ``module:Class``.

    Raises LookupError if there is no such effect; ValueError if the class is none, or its module
    cannot be imported.
    """
    import_path = name
    if name in MODULES:
        import_path = f"{__package__}.{MODULES[name]}:{name.title().replace('_', '')}"
    effect = class_by_name(import_path, what="effect", names=EFFECT_NAMES, package="")
    class_name = name.rpartition(":")[2]
    if not is_dataclass(effect) or not isinstance(effect, type) or not hasattr(effect, "prepare"):
        raise ValueError(
            f"{name!r} is no effect: {class_name!r} must be a dataclass with prepare()"
        )
    if not isinstance(getattr(effect, "phase", None), Phase):
        raise ValueError(f"{name!r} is no effect: its phase must be one of Phase, as Phase.SIGNAL")
    return cast("type[Effect]", effect)


def rank(name: str) -> int:
    """Position of an effect among those of its phase; a user's own come last."""
    return EFFECT_NAMES.index(name) if name in EFFECT_NAMES else len(EFFECT_NAMES)
